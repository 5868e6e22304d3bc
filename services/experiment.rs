//! `pursuit experiment NAME`: measured over many seeds, in lock-step, the paper's figure beside ours.

use crate::check;
use crate::cli::{Experiment, ExperimentName};
use crate::inprocess::{self, Outcome};
use crate::parallel;
use crate::report::{APPROACH_S, PAPER_MOVES_TO_3_CM, PAPER_TRACKING_CM, Report, percentile};
use crate::robustness;
use crate::svg::{Mark, Plot, Series};
use crate::up::write_json;
use pursuit_runtime::exit;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Frames of tracking per run, at 12.5 Hz: 30 s, of which 3 s are the approach.
const TRACKING_FRAMES: u64 = 375;
/// The paper's rate for learning: a sample every 40 ms.
const LEARNING_RATE_HZ: f64 = 25.0;
/// The paper's rate for tracking.
const TRACKING_RATE_HZ: f64 = 12.5;
/// Where plots go by default.
const PLOTS: &str = "pursuit-out";

/// Median and 90th percentile over seeds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
struct Spread {
    p50: f64,
    p90: f64,
}

/// A count that some seeds may never reach: those count as infinite, shown as `null`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
struct Moves {
    p50: Option<u32>,
    p90: Option<u32>,
}

#[derive(Clone, Debug, Serialize)]
struct Scheme {
    name: &'static str,
    seeds: u64,
    moves_to_3cm: Moves,
    moves_to_1cm: Moves,
    first_target_moves_to_3cm: Moves,
    after_5_moves_cm: Spread,
    final_cm: Spread,
}

#[derive(Clone, Debug, Serialize)]
struct Tracked {
    path: String,
    speed_m_per_s: f64,
    rate_hz: f64,
    latency_ms: f64,
    controller: &'static str,
    seeds: u64,
    rms_cm: Spread,
    median_cm: Spread,
    max_cm: Spread,
    detected_share: Spread,
    lost_share: f64,
    trajectory_sha256: Vec<Option<String>>,
}

/// Runs the verb.
pub fn run(options: &Experiment) -> u8 {
    let outcome = applicable(options).and_then(|()| match options.name {
        ExperimentName::Learning => learning(options),
        ExperimentName::Tracking => tracking(options),
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
    let of_detectors = !options.scenes.is_empty() || !options.sizes.is_empty() || options.frames.is_some();
    if of_the_arm && of_detectors {
        return Err("--scenes, --sizes and --frames are for robustness and ablation".to_owned());
    }
    if !of_the_arm && !options.set.is_empty() {
        return Err("--set is for learning and tracking: detectors are compared as they are".to_owned());
    }
    Ok(())
}

fn learning(options: &Experiment) -> Result<u8, String> {
    #[derive(Serialize)]
    struct Figures {
        schemes: Vec<Scheme>,
    }
    let mut schemes = Vec::new();
    let mut curves = Vec::new();
    println!("learning on the static blob, 25 Hz, seeds {}", seeds_text(options));
    println!("one-shot error: where one single move would end, median over 300 places in view\n");
    println!(
        "  {:<14} {:>15} {:>15} {:>20} {:>17}",
        "scheme", "moves to 3 cm", "to 1 cm", "after 5 moves", "at the end"
    );
    for name in ["recommended", "paper"] {
        let set = [
            format!("learner.profile={name}"),
            format!("camera.rate_hz={LEARNING_RATE_HZ:?}"),
            "simulator.frames=1".to_owned(),
        ];
        let runs = over_seeds(options, &set)?;
        let reports: Vec<Report> = runs.iter().map(|(seed, run)| report(*seed, run)).collect();
        let scheme = scheme(name, &reports);
        println!(
            "  {:<14} {:>15} {:>15} {:>20} {:>17}",
            name,
            moves_text(scheme.moves_to_3cm),
            moves_text(scheme.moves_to_1cm),
            spread_text(scheme.after_5_moves_cm, "cm"),
            spread_text(scheme.final_cm, "cm")
        );
        curves.push(curve(name, &reports));
        schemes.push(scheme);
    }
    println!("\n  the paper (1994): about {PAPER_MOVES_TO_3_CM} moves to the target until it is 3 cm");
    for scheme in &schemes {
        let name = scheme.name;
        println!(
            "  within 3 cm of the first target, {name}: {} moves",
            moves_text(scheme.first_target_moves_to_3cm)
        );
    }
    println!("  (median / 90th percentile over the seeds)");
    publish(options, &Figures { schemes }, "experiment-learning.svg", &learning_plot(curves).svg())
}

fn tracking(options: &Experiment) -> Result<u8, String> {
    #[derive(Serialize)]
    struct Figures {
        runs: Vec<Tracked>,
    }
    println!("following the camouflaged vehicle, seeds {}", seeds_text(options));
    println!(
        "distance from the camera's axis to the vehicle, without the first {APPROACH_S} s; median / p90"
    );
    println!("the paper (1994): in the order of {PAPER_TRACKING_CM} cm\n");
    println!(
        "  {:<11} {:>18} {:>18} {:>20} {:>20} {:>12}",
        "controller", "RMS", "median", "worst frame", "detection used", "> 20 cm off"
    );
    let (mut figures, mut curves) = (Vec::new(), Vec::new());
    for (controller, colour) in [("plain", "#009e73"), ("predictive", "#0072b2")] {
        let set = [
            format!("simulator.frames={TRACKING_FRAMES}"),
            format!("camera.rate_hz={TRACKING_RATE_HZ:?}"),
            format!("learner.controller={controller}"),
        ];
        let runs = over_seeds(options, &set)?;
        let checked = settled(options, &set, options.first_seed)?;
        let reports: Vec<Report> = runs.iter().map(|(seed, run)| report(*seed, run)).collect();
        let tracked = tracked(&checked, controller, &reports)?;
        println!(
            "  {:<11} {:>18} {:>18} {:>20} {:>20} {:>10.2} %",
            controller,
            spread_text(tracked.rms_cm, "cm"),
            spread_text(tracked.median_cm, "cm"),
            spread_text(tracked.max_cm, "cm"),
            spread_text(
                Spread { p50: 100.0 * tracked.detected_share.p50, p90: 100.0 * tracked.detected_share.p90 },
                "%"
            ),
            100.0 * tracked.lost_share
        );
        curves.push((controller, colour, reports));
        figures.push(tracked);
    }
    if let Some(run) = figures.first() {
        println!(
            "\n  {} at {} m/s, {} images per second, {} ms from command to motion",
            run.path, run.speed_m_per_s, run.rate_hz, run.latency_ms
        );
    }
    let plot = tracking_plot(&curves).svg();
    publish(options, &Figures { runs: figures }, "experiment-tracking.svg", &plot)
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

fn scheme(name: &'static str, reports: &[Report]) -> Scheme {
    let error_after =
        |report: &Report, index: usize| report.learning.moves.get(index).map_or(f64::NAN, |m| m.error_cm);
    let last = |report: &Report| report.learning.moves.last().map_or(f64::NAN, |m| m.error_cm);
    Scheme {
        name,
        seeds: reports.len() as u64,
        moves_to_3cm: moves(reports.iter().map(|r| r.learning.moves_to_3cm)),
        moves_to_1cm: moves(reports.iter().map(|r| r.learning.moves_to_1cm)),
        first_target_moves_to_3cm: moves(reports.iter().map(|r| r.learning.first_target_moves_to_3cm)),
        after_5_moves_cm: spread(reports.iter().map(|r| error_after(r, 4))),
        final_cm: spread(reports.iter().map(last)),
    }
}

fn tracked(
    checked: &check::Checked,
    controller: &'static str,
    reports: &[Report],
) -> Result<Tracked, String> {
    let tracking: Vec<_> = reports.iter().filter_map(|r| r.tracking).collect();
    if tracking.len() < reports.len() {
        return Err("a run ended before it came to tracking".to_owned());
    }
    let cell = &checked.simulator.cell;
    let shares = spread(tracking.iter().map(|t| -t.detected_share));
    Ok(Tracked {
        path: format!("{:?}", cell.path).split(' ').next().unwrap_or_default().to_lowercase(),
        speed_m_per_s: cell.path.speed_m_per_s(),
        rate_hz: checked.acquisition.camera.rate_hz,
        latency_ms: cell.latency_ns as f64 / 1e6,
        controller,
        seeds: reports.len() as u64,
        rms_cm: spread(tracking.iter().map(|t| t.rms_cm)),
        median_cm: spread(tracking.iter().map(|t| t.median_cm)),
        max_cm: spread(tracking.iter().map(|t| t.max_cm)),
        detected_share: Spread { p50: -shares.p50, p90: -shares.p90 },
        lost_share: tracking.iter().map(|t| t.lost_share).sum::<f64>() / tracking.len() as f64,
        trajectory_sha256: reports.iter().map(|r| r.trajectory_sha256.clone()).collect(),
    })
}

fn spread(values: impl Iterator<Item = f64>) -> Spread {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    Spread { p50: percentile(&values, 0.5), p90: percentile(&values, 0.9) }
}

fn moves(values: impl Iterator<Item = Option<u32>>) -> Moves {
    let never = f64::INFINITY;
    let Spread { p50, p90 } = spread(values.map(|value| value.map_or(never, f64::from)));
    let finite = |value: f64| value.is_finite().then_some(value as u32);
    Moves { p50: finite(p50), p90: finite(p90) }
}

fn moves_text(moves: Moves) -> String {
    let text = |value: Option<u32>| value.map_or_else(|| "never".to_owned(), |value| value.to_string());
    format!("{} / {}", text(moves.p50), text(moves.p90))
}

fn spread_text(spread: Spread, unit: &str) -> String {
    format!("{:.2} / {:.2} {unit}", spread.p50, spread.p90)
}

/// Median over the seeds of the error after each move.
fn curve(name: &'static str, reports: &[Report]) -> (&'static str, Vec<[f64; 2]>) {
    let longest = reports.iter().map(|r| r.learning.moves.len()).max().unwrap_or(0);
    let median_after = |index: usize| {
        let errors = reports.iter().filter_map(|r| r.learning.moves.get(index)).map(|m| m.error_cm);
        [index as f64 + 1.0, spread(errors).p50]
    };
    (name, (0..longest).map(median_after).collect())
}

fn learning_plot(curves: Vec<(&'static str, Vec<[f64; 2]>)>) -> Plot {
    let last = curves.iter().flat_map(|(_, points)| points).map(|p| p[0]).fold(1.0, f64::max);
    let mut series: Vec<Series> = curves
        .into_iter()
        .zip(["#0072b2", "#009e73"])
        .map(|((name, points), colour)| Series { name: name.to_owned(), colour, points, mark: Mark::Line })
        .collect();
    series.push(Series {
        name: "paper: 3 cm after about 5 moves".to_owned(),
        colour: "#d55e00",
        points: vec![[1.0, 3.0], [last, 3.0]],
        mark: Mark::Dashed,
    });
    Plot {
        title: "Error of one single move, median over seeds".to_owned(),
        x_label: "moves made".to_owned(),
        y_label: "cm".to_owned(),
        equal_axes: false,
        log_y: true,
        series,
    }
}

fn tracking_plot(curves: &[(&'static str, &'static str, Vec<Report>)]) -> Plot {
    let of = |reports: &[Report]| -> Vec<[f64; 2]> {
        reports.iter().filter_map(|r| Some([r.seed as f64, r.tracking?.rms_cm])).collect()
    };
    let mut series: Vec<Series> = curves
        .iter()
        .map(|(name, colour, reports)| Series {
            name: (*name).to_owned(),
            colour,
            points: of(reports),
            mark: Mark::Line,
        })
        .collect();
    let ends = series.first().map(|s| [s.points.first(), s.points.last()].map(|p| p.map_or(0.0, |p| p[0])));
    series.push(Series {
        name: "paper: in the order of 2 cm".to_owned(),
        colour: "#d55e00",
        points: ends.unwrap_or_default().map(|x| [x, PAPER_TRACKING_CM]).to_vec(),
        mark: Mark::Dashed,
    });
    Plot {
        title: "Following the vehicle: RMS distance per seed".to_owned(),
        x_label: "seed".to_owned(),
        y_label: "cm".to_owned(),
        equal_axes: false,
        log_y: true,
        series,
    }
}

/// Writes the plot under this name, and the figures where they are wanted.
///
/// # Errors
/// The plot cannot be written.
pub fn publish(options: &Experiment, figures: &impl Serialize, name: &str, svg: &str) -> Result<u8, String> {
    let folder = options.plots.clone().unwrap_or_else(|| PathBuf::from(PLOTS));
    let file = folder.join(name);
    std::fs::create_dir_all(&folder)
        .and_then(|()| std::fs::write(&file, svg))
        .map_err(|error| format!("cannot write {}: {error}", file.display()))?;
    println!("\n  plot: {}", file.display());
    Ok(options.json.as_deref().map_or(exit::OK, |json: &Path| write_json(json, figures)))
}
