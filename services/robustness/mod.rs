//! `pursuit experiment robustness`: what the detectors find, and how precisely, in sequences of which the truth
//! is known; and `pursuit experiment ablation`: what each part of the robust one is good for.
//!
//! ```text
//! scenarios x sizes x seeds ─► sweep ─► judge ─► figures ─► print, plot, JSON
//!                                ▲
//!                              modes
//! ```

pub mod ablation;
mod frames;
mod judge;
mod modes;
mod plot;
mod print;
mod sweep;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;

use crate::cli::Experiment;
use crate::experiment::{publish, seeds_text};
use judge::{Figures, Tally};
use modes::Mode;
use serde::Serialize;
use sweep::{Group, Plan, Row, cases, sweep};

/// Sides of the frames, px.
const SIZES: [usize; 2] = [512, 256];
/// Where the plot goes.
const PLOT: &str = "experiment-robustness.svg";

/// All that is published.
#[derive(Serialize)]
struct Published {
    seeds: u64,
    first_seed: u64,
    scenes: Vec<Scene>,
    total: BTreeMap<&'static str, Total>,
}

/// What a mode did on a scenario.
#[derive(Serialize)]
struct Scene {
    name: &'static str,
    group: Group,
    size: usize,
    mode: &'static str,
    has_target: bool,
    #[serde(flatten)]
    figures: Figures,
}

/// What a mode did on all scenarios but the hard ones.
#[derive(Serialize)]
struct Total {
    #[serde(flatten)]
    figures: Figures,
    sizes: BTreeMap<String, Figures>,
}

/// Runs `pursuit experiment robustness`.
///
/// # Errors
/// In words: an unknown scenario, a size out of range, a file that cannot be written.
pub fn run(options: &Experiment) -> Result<u8, String> {
    let groups = [Group::WithTarget, Group::WithoutTarget, Group::Hard];
    let plan = plan(options, &groups, &SIZES, modes::all())?;
    println!("what the detectors find in sequences with exact truth, seeds {}", seeds_text(options));
    let rows = sweep(&plan)?;
    print::tables(&plan, &rows);
    let published = Published {
        seeds: options.seeds(),
        first_seed: options.first_seed,
        scenes: scenes(&plan, &rows),
        total: plan.modes.iter().enumerate().map(|(k, mode)| (mode.name, total(&plan, &rows, k))).collect(),
    };
    publish(options, &published, PLOT, &plot::svg(&plan, &rows))
}

/// What the options ask for, of these groups; of these sizes where the options name none.
fn plan(options: &Experiment, groups: &[Group], sizes: &[usize], modes: Vec<Mode>) -> Result<Plan, String> {
    Ok(Plan {
        cases: cases(groups, &options.scenes)?,
        sizes: if options.sizes.is_empty() { sizes.to_vec() } else { options.sizes.clone() },
        seeds: options.first_seed..options.first_seed + options.seeds(),
        modes,
        frames: options.frames.clone(),
    })
}

fn scenes(plan: &Plan, rows: &[Row]) -> Vec<Scene> {
    let of_row = |row: &Row| {
        let Row { name, group, size, has_target, .. } = *row;
        let of_mode = |(mode, tally): (&Mode, &Tally)| Scene {
            name,
            group,
            size,
            mode: mode.name,
            has_target,
            figures: tally.figures(),
        };
        plan.modes.iter().zip(&row.tallies).map(of_mode).collect::<Vec<_>>()
    };
    rows.iter().flat_map(of_row).collect()
}

fn total(plan: &Plan, rows: &[Row], mode: usize) -> Total {
    let sizes = plan.sizes.iter();
    Total {
        figures: overall(rows, mode, None),
        sizes: sizes.map(|&size| (size.to_string(), overall(rows, mode, Some(size)))).collect(),
    }
}

/// The figures of a mode over all scenarios but the hard ones, at one size or all.
fn overall(rows: &[Row], mode: usize, size: Option<usize>) -> Figures {
    let counts = |row: &&Row| row.group != Group::Hard && size.is_none_or(|size| row.size == size);
    Tally::sum(rows.iter().filter(counts).map(|row| &row.tallies[mode])).figures()
}
