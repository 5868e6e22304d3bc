//! Every mode on every sequence: each sequence is rendered once and given to all modes.

use std::io::{IsTerminal, Write};
use std::ops::Range;
use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use pursuit_motion::{Image, Older};
use pursuit_scene::sequences::{self, Scenario, Sequence, Truth};
use serde::Serialize;

use super::frames;
use super::judge::{Tally, judge};
use super::modes::Mode;
use crate::parallel;

/// Sequences in memory at a time: each takes up to 100 MB at 512 px.
const MOST_THREADS: usize = 4;

/// What a scenario is there for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Group {
    /// Something moves, in circumstances that a good detector bears.
    WithTarget,
    /// Nothing moves by itself.
    WithoutTarget,
    /// Where detectors begin to fail; not in the totals.
    Hard,
}

/// A scenario and what it is there for.
pub struct Case {
    /// What it is there for.
    pub group: Group,
    /// The scenario.
    pub scenario: Scenario,
}

/// What is to be run.
pub struct Plan {
    /// The scenarios.
    pub cases: Vec<Case>,
    /// Sides of the frames, px.
    pub sizes: Vec<usize>,
    /// The seeds.
    pub seeds: Range<u64>,
    /// The detectors.
    pub modes: Vec<Mode>,
    /// Where the first seed's frames and truths go.
    pub frames: Option<PathBuf>,
}

/// What the modes did on one scenario at one size.
pub struct Row {
    /// What the scenario is there for.
    pub group: Group,
    /// Its name.
    pub name: &'static str,
    /// Whether there is a target in it.
    pub has_target: bool,
    /// Side of the frames, px.
    pub size: usize,
    /// For each mode, over all seeds.
    pub tallies: Vec<Tally>,
}

/// A sequence as the detectors see it, and what is true of it.
pub struct Film {
    /// Side of the frames, px.
    pub size: usize,
    /// Grey levels, rows from the top.
    pub frames: Vec<Vec<u8>>,
    /// One for each frame.
    pub truths: Vec<Truth>,
}

/// The scenarios of these groups, or those of them that are named.
///
/// # Errors
/// A name that no scenario has.
pub fn cases(groups: &[Group], names: &[String]) -> Result<Vec<Case>, String> {
    let of_group = |&group: &Group| {
        let scenarios = match group {
            Group::WithTarget => sequences::with_target(),
            Group::WithoutTarget => sequences::without_target(),
            Group::Hard => sequences::hard(),
        };
        scenarios.into_iter().map(move |scenario| Case { group, scenario })
    };
    let mut cases: Vec<Case> = groups.iter().flat_map(of_group).collect();
    if let Some(unknown) = names.iter().find(|name| cases.iter().all(|case| case.scenario.name != *name)) {
        let known: Vec<&str> = cases.iter().map(|case| case.scenario.name).collect();
        return Err(format!("--scenes: {unknown:?} is none of {}", known.join(", ")));
    }
    cases.retain(|case| names.is_empty() || names.iter().any(|name| name == case.scenario.name));
    Ok(cases)
}

/// Runs it. Rows come in the order of the plan's sizes, within each in that of its scenarios.
///
/// # Errors
/// A size that cannot be rendered or detected in, frames that cannot be written.
pub fn sweep(plan: &Plan) -> Result<Vec<Row>, String> {
    let seeds = plan.seeds.clone().count();
    let in_a_size = plan.cases.len() * seeds;
    let count = in_a_size * plan.sizes.len();
    let done = AtomicUsize::new(0);
    let shows = std::io::stderr().is_terminal();
    let results = parallel::map(count, MOST_THREADS, |job| {
        let size = plan.sizes[job / in_a_size];
        let case = &plan.cases[job % in_a_size / seeds];
        let result = one_sequence(plan, case, size, plan.seeds.start + (job % seeds) as u64);
        let done = done.fetch_add(1, Ordering::Relaxed) + 1;
        if shows {
            let _ = write!(std::io::stderr(), "\r  {done} of {count} sequences");
        }
        result
    })?;
    if shows {
        let _ = write!(std::io::stderr(), "\r{:40}\r", "");
    }
    let results = results.into_iter().collect::<Result<Vec<_>, _>>()?;
    let of_row = |(row, tallies): (usize, &[Vec<Tally>])| {
        let case = &plan.cases[row % plan.cases.len()];
        let sum_of_mode = |mode: usize| Tally::sum(tallies.iter().map(|of_seed| &of_seed[mode]));
        Row {
            group: case.group,
            name: case.scenario.name,
            has_target: case.scenario.target.is_some(),
            size: plan.sizes[row / plan.cases.len()],
            tallies: (0..plan.modes.len()).map(sum_of_mode).collect(),
        }
    };
    Ok(results.chunks(seeds.max(1)).enumerate().map(of_row).collect())
}

fn one_sequence(plan: &Plan, case: &Case, size: usize, seed: u64) -> Result<Vec<Tally>, String> {
    let film = render(&case.scenario, size, seed).map_err(|why| {
        let name = case.scenario.name;
        format!("{name} at {size} px: {why}")
    })?;
    if let Some(folder) = plan.frames.as_ref().filter(|_| seed == plan.seeds.start) {
        frames::write(folder, case, seed, &film)?;
    }
    plan.modes.iter().map(|mode| watch(mode, &film)).collect()
}

fn render(scenario: &Scenario, size: usize, seed: u64) -> Result<Film, String> {
    let mut sequence = Sequence::new(scenario, size, seed).map_err(|error| error.to_string())?;
    let mut film = Film { size, frames: Vec::new(), truths: Vec::new() };
    for t in 0..sequence.frames() {
        let mut pixels = vec![0; size * size];
        sequence.render(t, &mut pixels);
        film.frames.push(pixels);
        film.truths.push(sequence.truth(t));
    }
    Ok(film)
}

/// Gives the mode every frame of the film, and judges what it says of each pair.
fn watch(mode: &Mode, film: &Film) -> Result<Tally, String> {
    let size = film.size;
    let mut eye = mode.eye(size).map_err(|error| error.to_string())?;
    let mut tally = Tally::default();
    let mut older = Older::Missing;
    for (t, (pixels, truth)) in film.frames.iter().zip(&film.truths).enumerate() {
        let newer = Image::new(pixels, size, size, size).map_err(|error| error.to_string())?;
        let start = Instant::now();
        let answer = eye.step(older, newer);
        let step = start.elapsed();
        if t > 0 {
            tally.add_time(1e6 * step.as_secs_f64());
            tally.add(judge(truth, answer, size));
        }
        older = Older::LastNewer(newer);
    }
    Ok(tally)
}
