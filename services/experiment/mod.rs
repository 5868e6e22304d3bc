//! `pursuit experiment NAME`: measured over many seeds, in lock-step, the paper's figure beside ours.

mod calibrated;
mod cells;
mod change;
pub mod figures;
mod learning;
mod outliers;
mod stopping;
mod tracking;

use crate::check;
use crate::cli::{Experiment, ExperimentName};
use crate::inprocess::{self, Outcome};
use crate::parallel;
use crate::report::Report;
use crate::robustness;
use crate::up::write_json;
use pursuit_runtime::exit;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Where plots go by default.
const PLOTS: &str = "pursuit-out";

/// Runs the verb.
pub fn run(options: &Experiment) -> u8 {
    let outcome = applicable(options).and_then(|()| match options.name {
        ExperimentName::Learning => learning::run(options),
        ExperimentName::Tracking => tracking::run(options),
        ExperimentName::Change => change::run(options),
        ExperimentName::Outliers => outliers::run(options),
        ExperimentName::Stopping => stopping::run(options),
        ExperimentName::Calibrated => calibrated::run(options),
        ExperimentName::Robustness => robustness::run(options),
        ExperimentName::Ablation => robustness::ablation::run(options),
    });
    match outcome {
        Ok(code) => code,
        Err(why) => {
            eprintln!("{why}");
            exit::DO_NOT_RESTART
        }
    }
}

/// Nothing, where the experiment knows all options that are given.
fn applicable(options: &Experiment) -> Result<(), String> {
    let of_the_arm = options.name.runs_the_arm();
    let chooses = !of_the_arm || options.name == ExperimentName::Change;
    if !chooses && !options.scenes.is_empty() {
        return Err("--scenes is for change, robustness and ablation".to_owned());
    }
    if options.name != ExperimentName::Learning && !options.schemes.is_empty() {
        return Err("--schemes is for learning".to_owned());
    }
    if of_the_arm && (!options.sizes.is_empty() || options.frames.is_some()) {
        return Err("--sizes and --frames are for robustness and ablation".to_owned());
    }
    if !of_the_arm && !options.set.is_empty() {
        return Err("--set is for experiments with the arm: detectors are compared as they are".to_owned());
    }
    let follows = matches!(options.name, ExperimentName::Tracking | ExperimentName::Calibrated);
    if !follows && options.names_conditions() {
        let names = "--paths, --speeds, --rates, --latencies and --controllers";
        return Err(format!("{names} are for tracking and calibrated"));
    }
    Ok(())
}

/// The seeds in words.
pub fn seeds_text(options: &Experiment) -> String {
    format!("{} to {}", options.first_seed, options.first_seed + options.seeds() - 1)
}

/// All runs of an experiment, in the order of the seeds.
fn over_seeds(options: &Experiment, set: &[String]) -> Result<Vec<(u64, Outcome)>, String> {
    let seed_of = |index: usize| options.first_seed + index as u64;
    let results = parallel::map(options.seeds() as usize, usize::MAX, |index| {
        let outcome = one_seed(options, set, seed_of(index));
        outcome.map_err(|why| format!("seed {}: {why}", seed_of(index)))
    })?;
    (options.first_seed..).zip(results).map(|(seed, result)| Ok((seed, result?))).collect()
}

fn one_seed(options: &Experiment, set: &[String], seed: u64) -> Result<Outcome, String> {
    inprocess::run(&settled(options, set, seed)?)
}

/// The built-in config with an experiment's settings, the command line's on top.
fn settled(options: &Experiment, set: &[String], seed: u64) -> Result<check::Checked, String> {
    let seed = [format!("run.seed={seed}")];
    let settings: Vec<String> = set.iter().chain(&options.set).chain(&seed).cloned().collect();
    let document = check::document(None, &settings).map_err(|faults| faults.to_string())?;
    check::all(&document).map_err(|faults| faults.to_string())
}

fn report(seed: u64, run: &Outcome) -> Report {
    let mut report = Report::of(seed, &run.records, &run.moves);
    report.trajectory_sha256 = Some(run.trajectory_sha256.clone());
    report
}

/// Writes the plot under this name, and the figures where they are wanted.
///
/// # Errors
/// The plot cannot be written.
pub fn publish(options: &Experiment, figures: &impl Serialize, name: &str, svg: &str) -> Result<u8, String> {
    write_plot(options, name, svg)?;
    Ok(options.json.as_deref().map_or(exit::OK, |json: &Path| write_json(json, figures)))
}

/// Writes a plot under this name and says where.
fn write_plot(options: &Experiment, name: &str, svg: &str) -> Result<(), String> {
    let folder = options.plots.clone().unwrap_or_else(|| PathBuf::from(PLOTS));
    let file = folder.join(name);
    std::fs::create_dir_all(&folder)
        .and_then(|()| std::fs::write(&file, svg))
        .map_err(|error| format!("cannot write {}: {error}", file.display()))?;
    println!("\n  plot: {}\n", file.display());
    Ok(())
}
