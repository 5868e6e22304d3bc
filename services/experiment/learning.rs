//! `pursuit experiment learning`: moves to 3 cm and 1 cm, per scheme.

use super::figures::{Moves, Spread, moves, moves_text, spread, spread_text};
use super::{over_seeds, publish, report, seeds_text};
use crate::cli::Experiment;
use crate::report::{PAPER_MOVES_TO_3_CM, Report};
use crate::svg::{Mark, Plot, Series};
use serde::Serialize;

/// The paper's rate for learning: a sample every 40 ms.
const LEARNING_RATE_HZ: f64 = 25.0;

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

/// Runs it.
///
/// # Errors
/// A run fails, or the figures cannot be written.
pub fn run(options: &Experiment) -> Result<u8, String> {
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
