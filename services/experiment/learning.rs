//! `pursuit experiment learning`: moves to 3 cm and 1 cm, per scheme.

use super::figures::{Moves, Spread, moves, moves_text, spread, spread_text};
use super::{one_seed, publish, report, seeds_text};
use crate::cli::Experiment;
use crate::parallel;
use crate::report::{PAPER_MOVES_TO_3_CM, Report};
use crate::svg::{Mark, Plot, Series};
use serde::Serialize;

/// The paper's rate for learning: a sample every 40 ms.
const LEARNING_RATE_HZ: f64 = 25.0;
/// Moves that the runs for the first target's figures may stay at it.
const FIRST_TARGET_MOVES: u32 = 12;
/// Turn of the camera from one seed to the next where its mounting is any: the golden angle, which spreads
/// any number of seeds evenly.
const MOUNT_STEP_DEG: f64 = 137.507_764_05;

/// Top of the plot, cm: above an untrained network's error there is room for the legend.
const LEGEND_ROOM_CM: f64 = 500.0;

/// A way to learn.
struct Variant {
    name: &'static str,
    colour: &'static str,
    /// Settings that make it.
    set: &'static [&'static str],
    /// Whether each seed's camera is mounted at another angle.
    any_mount: bool,
}

const VARIANTS: [Variant; 7] = [
    Variant { name: "recommended", colour: "#0072b2", set: &[], any_mount: false },
    Variant { name: "any mount", colour: "#56b4e9", set: &[], any_mount: true },
    Variant { name: "scg", colour: "#cc79a7", set: &["learner.trainer=scg"], any_mount: false },
    Variant { name: "lm", colour: "#009e73", set: &["learner.trainer=lm"], any_mount: false },
    Variant { name: "batch only", colour: "#e69f00", set: &["learner.eta=0.0"], any_mount: false },
    Variant { name: "online only", colour: "#888888", set: &["learner.iterations=0"], any_mount: false },
    Variant { name: "paper", colour: "#d55e00", set: &["learner.profile=paper"], any_mount: false },
];

#[derive(Clone, Debug, Serialize)]
struct Scheme {
    name: &'static str,
    seeds: u64,
    moves_to_3cm: Moves,
    moves_to_1cm: Moves,
    first_target_moves_to_3cm: Moves,
    first_target_moves_to_1cm: Moves,
    after_5_moves_cm: Spread,
    final_cm: Spread,
    /// Median over the seeds of the one-shot error after each move.
    error_after_move_cm: Vec<f64>,
    /// Of each seed: the run as one number.
    trajectory_sha256: Vec<Option<String>>,
}

/// Runs it.
///
/// # Errors
/// A run fails, or the figures cannot be written.
pub fn run(options: &Experiment) -> Result<u8, String> {
    #[derive(Serialize)]
    struct Figures {
        schemes: Vec<Scheme>,
    }
    let variants = wanted(options)?;
    println!(
        "learning on the static blob, 25 Hz, seeds {}; median / p90 over the seeds",
        seeds_text(options)
    );
    println!("first target: moves until the camera is that close to it, from nothing, at most");
    println!(
        "{FIRST_TARGET_MOVES}; one shot: where one single move would end, median over 300 places in view\n"
    );
    println!(
        "  {:<12} {:>16} {:>14} {:>15} {:>14} {:>17} {:>17}",
        "scheme", "first: to 3 cm", "to 1 cm", "one: to 3 cm", "to 1 cm", "after 5 moves", "at the end"
    );
    let mut schemes = Vec::new();
    for variant in &variants {
        let scheme = variant.measure(options)?;
        println!(
            "  {:<12} {:>16} {:>14} {:>15} {:>14} {:>17} {:>17}",
            scheme.name,
            moves_text(scheme.first_target_moves_to_3cm),
            moves_text(scheme.first_target_moves_to_1cm),
            moves_text(scheme.moves_to_3cm),
            moves_text(scheme.moves_to_1cm),
            spread_text(scheme.after_5_moves_cm, "cm"),
            spread_text(scheme.final_cm, "cm")
        );
        schemes.push(scheme);
    }
    let about = format!("about {PAPER_MOVES_TO_3_CM}");
    println!("  {:<12} {about:>16} {:>14}", "paper, 1994", "-");
    let plot = learning_plot(&schemes, &variants);
    publish(options, &Figures { schemes }, "experiment-learning.svg", &plot.svg())
}

/// The schemes that are asked for, all where none is named.
fn wanted(options: &Experiment) -> Result<Vec<&'static Variant>, String> {
    let unknown = options.schemes.iter().find(|name| VARIANTS.iter().all(|variant| variant.name != **name));
    if let Some(name) = unknown {
        let known = VARIANTS.each_ref().map(|variant| variant.name).join(", ");
        return Err(format!("--schemes: there is no {name:?}; there are {known}"));
    }
    let is_wanted =
        |variant: &&Variant| options.schemes.is_empty() || options.schemes.iter().any(|n| n == variant.name);
    Ok(VARIANTS.iter().filter(is_wanted).collect())
}

impl Variant {
    fn measure(&self, options: &Experiment) -> Result<Scheme, String> {
        let whole = self.reports(options, &[])?;
        let stays = [
            format!("learner.training_moves={FIRST_TARGET_MOVES}"),
            format!("learner.moves_per_target={FIRST_TARGET_MOVES}"),
        ];
        let first = self.reports(options, &stays)?;
        let error_after =
            |report: &Report, index: usize| report.learning.moves.get(index).map_or(f64::NAN, |m| m.error_cm);
        let last = |report: &Report| report.learning.moves.last().map_or(f64::NAN, |m| m.error_cm);
        Ok(Scheme {
            name: self.name,
            seeds: whole.len() as u64,
            moves_to_3cm: moves(whole.iter().map(|r| r.learning.moves_to_3cm)),
            moves_to_1cm: moves(whole.iter().map(|r| r.learning.moves_to_1cm)),
            first_target_moves_to_3cm: moves(first.iter().map(|r| moves_at_first_target(r, 3.0))),
            first_target_moves_to_1cm: moves(first.iter().map(|r| moves_at_first_target(r, 1.0))),
            after_5_moves_cm: spread(whole.iter().map(|r| error_after(r, 4))),
            final_cm: spread(whole.iter().map(last)),
            error_after_move_cm: medians_after_moves(&whole),
            trajectory_sha256: whole.into_iter().map(|report| report.trajectory_sha256).collect(),
        })
    }

    /// The reports of all seeds, in their order.
    fn reports(&self, options: &Experiment, more: &[String]) -> Result<Vec<Report>, String> {
        let results = parallel::map(options.seeds() as usize, usize::MAX, |index| {
            let seed = options.first_seed + index as u64;
            let outcome = one_seed(options, &self.settings(seed, more), seed);
            outcome.map(|run| report(seed, &run)).map_err(|why| format!("seed {seed}: {why}"))
        })?;
        results.into_iter().collect()
    }

    fn settings(&self, seed: u64, more: &[String]) -> Vec<String> {
        let mut settings =
            vec![format!("camera.rate_hz={LEARNING_RATE_HZ:?}"), "simulator.frames=1".to_owned()];
        settings.extend(self.set.iter().map(|setting| (*setting).to_owned()));
        settings.extend_from_slice(more);
        if self.any_mount {
            settings.push(format!("camera.mount_deg={:?}", mount_deg(seed)));
        }
        settings
    }
}

/// Where that seed's camera is mounted, -180 to 180.
fn mount_deg(seed: u64) -> f64 {
    (MOUNT_STEP_DEG * seed as f64).rem_euclid(360.0) - 180.0
}

/// First move that ended that close to the first target.
fn moves_at_first_target(report: &Report, limit_cm: f64) -> Option<u32> {
    let at_first = report.learning.moves.iter().take_while(|m| m.target == 0);
    at_first.zip(1..).find(|(m, _)| m.arrived_cm < limit_cm).map(|(_, number)| number)
}

fn medians_after_moves(reports: &[Report]) -> Vec<f64> {
    let longest = reports.iter().map(|r| r.learning.moves.len()).max().unwrap_or(0);
    let median_after = |index: usize| {
        spread(reports.iter().filter_map(|r| r.learning.moves.get(index)).map(|m| m.error_cm)).p50
    };
    (0..longest).map(median_after).collect()
}

fn learning_plot(schemes: &[Scheme], variants: &[&Variant]) -> Plot {
    let longest = schemes.iter().map(|scheme| scheme.error_after_move_cm.len()).max().unwrap_or(1);
    let mut series: Vec<Series> = schemes
        .iter()
        .zip(variants)
        .map(|(scheme, variant)| Series {
            name: scheme.name.to_owned(),
            colour: variant.colour,
            points: (1..).zip(&scheme.error_after_move_cm).map(|(n, cm)| [f64::from(n), *cm]).collect(),
            mark: Mark::Line,
        })
        .collect();
    series.push(Series {
        name: format!("1994: 3 cm after about {PAPER_MOVES_TO_3_CM} moves, first target"),
        colour: "#d55e00",
        points: vec![[1.0, 3.0], [longest.max(2) as f64, 3.0]],
        mark: Mark::Dashed,
    });
    // A line of one point shows nothing but widens the axis.
    series.push(Series {
        name: String::new(),
        colour: "none",
        points: vec![[1.0, LEGEND_ROOM_CM]],
        mark: Mark::Line,
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

#[cfg(test)]
mod tests {
    use super::*;
    use pursuit_simulator::journal::MoveRecord;

    #[test]
    fn only_moves_to_the_first_target_count_for_it() {
        let record = |number, target_index, arrived_cm| MoveRecord {
            number,
            target_index,
            arrived_cm,
            ..MoveRecord::default()
        };
        let moves = [record(1, 0, 20.0), record(2, 0, 2.0), record(3, 1, 0.5)];
        let report = Report::of(1, &[], &moves);
        assert_eq!(moves_at_first_target(&report, 3.0), Some(2));
        assert_eq!(moves_at_first_target(&report, 1.0), None);
    }

    #[test]
    fn mounts_go_all_the_way_round() {
        let mut angles: Vec<f64> = (1..=30).map(mount_deg).collect();
        angles.sort_by(f64::total_cmp);
        let widest = angles.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f64::max);
        assert!(angles.iter().all(|angle| (-180.0..=180.0).contains(angle)) && widest < 30.0, "{widest}");
    }
}
