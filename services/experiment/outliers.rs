//! `pursuit experiment outliers`: learning while a share of the detections is wrong.

use super::figures::{Moves, Spread, moves, moves_text, spread, spread_text};
use super::{over_seeds, publish, report, seeds_text};
use crate::cli::Experiment;
use crate::report::{PAPER_MOVES_TO_3_CM, Report};
use crate::svg::{Mark, Plot, Series};
use serde::Serialize;

/// The paper's rate for learning: a sample every 40 ms.
const LEARNING_RATE_HZ: f64 = 25.0;
/// Shares of the frames with a glare, %; of the kinematic prototype the moves to 3 cm and 1 cm and the error
/// after 30 moves (design notes on the learner, sections 4.1 and 4.3), where it has them; colours.
const SHARES: [(u32, &str, &str); 4] = [
    (0, "3/5, 9/14, .29/.42 cm", "#0072b2"),
    (5, "3/7, 13/18, .38/.57 cm", "#009e73"),
    (15, "1.05/2.7 cm", "#e69f00"),
    (30, "6.1/17 cm", "#d55e00"),
];

#[derive(Clone, Debug, Serialize)]
struct Misled {
    /// Share of the frames with a wrong detection that was asked for.
    glare_share: f64,
    /// Share of the training frames that had one.
    seen_share: f64,
    seeds: u64,
    moves_to_3cm: Moves,
    moves_to_1cm: Moves,
    first_target_moves_to_3cm: Moves,
    final_cm: Spread,
}

/// Runs it.
///
/// # Errors
/// A run fails, or the figures cannot be written.
pub fn run(options: &Experiment) -> Result<u8, String> {
    #[derive(Serialize)]
    struct Figures {
        outliers: Vec<Misled>,
    }
    println!("learning with wrong detections anywhere in the image, 25 Hz, seeds {}", seeds_text(options));
    println!("one-shot error: where one single move would end, median over 300 places in view\n");
    println!(
        "  {:<8} {:>15} {:>12} {:>26} {:>20}   prototype",
        "wrong", "moves to 3 cm", "to 1 cm", "3 cm of the first target", "at the end"
    );
    let (mut outliers, mut curves) = (Vec::new(), Vec::new());
    for (percent, prototype, colour) in SHARES {
        let set = [
            format!("simulator.glare_share={:?}", f64::from(percent) / 100.0),
            format!("camera.rate_hz={LEARNING_RATE_HZ:?}"),
            "simulator.frames=1".to_owned(),
        ];
        let runs = over_seeds(options, &set)?;
        let frames = runs.iter().flat_map(|(_, run)| &run.records);
        let glares = frames.clone().filter(|record| record.glare == 1).count();
        let reports: Vec<Report> = runs.iter().map(|(seed, run)| report(*seed, run)).collect();
        let misled = Misled {
            glare_share: f64::from(percent) / 100.0,
            seen_share: glares as f64 / frames.count() as f64,
            seeds: reports.len() as u64,
            moves_to_3cm: moves(reports.iter().map(|r| r.learning.moves_to_3cm)),
            moves_to_1cm: moves(reports.iter().map(|r| r.learning.moves_to_1cm)),
            first_target_moves_to_3cm: moves(reports.iter().map(|r| r.learning.first_target_moves_to_3cm)),
            final_cm: spread(
                reports.iter().map(|r| r.learning.moves.last().map_or(f64::NAN, |m| m.error_cm)),
            ),
        };
        println!(
            "  {:<8} {:>15} {:>12} {:>26} {:>20}   {prototype}",
            format!("{percent} %"),
            moves_text(misled.moves_to_3cm),
            moves_text(misled.moves_to_1cm),
            moves_text(misled.first_target_moves_to_3cm),
            spread_text(misled.final_cm, "cm"),
        );
        outliers.push(misled);
        curves.push(curve(percent, colour, &reports));
    }
    println!(
        "\n  the paper (1994): about {PAPER_MOVES_TO_3_CM} moves to 3 cm; of wrong detections it has no figures"
    );
    println!("  (median / 90th percentile over the seeds)");
    publish(options, &Figures { outliers }, "experiment-outliers.svg", &plot(curves).svg())
}

/// Median over the seeds of the error after each move.
fn curve(percent: u32, colour: &'static str, reports: &[Report]) -> Series {
    let longest = reports.iter().map(|r| r.learning.moves.len()).max().unwrap_or(0);
    let median_after = |index: usize| {
        let errors = reports.iter().filter_map(|r| r.learning.moves.get(index)).map(|m| m.error_cm);
        [index as f64 + 1.0, spread(errors).p50]
    };
    let points = (0..longest).map(median_after).collect();
    Series { name: format!("{percent} % wrong detections"), colour, points, mark: Mark::Line }
}

fn plot(mut series: Vec<Series>) -> Plot {
    let last = series.iter().flat_map(|s| &s.points).map(|p| p[0]).fold(1.0, f64::max);
    series.push(Series {
        name: "paper: 3 cm after about 5 moves".to_owned(),
        colour: "#888888",
        points: vec![[1.0, 3.0], [last, 3.0]],
        mark: Mark::Dashed,
    });
    Plot {
        title: "Error of one single move with wrong detections, median over seeds".to_owned(),
        x_label: "moves made".to_owned(),
        y_label: "cm".to_owned(),
        equal_axes: false,
        log_y: true,
        series,
    }
}
