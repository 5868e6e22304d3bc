//! `pursuit experiment change`: somebody turns the camera, changes the lens or the forearm, and nobody tells
//! the learner. Before the first move, in the middle of training, and while following.

mod cases;
mod knock;

use super::figures::{Moves, Spread, moves, moves_text, spread};
use super::{over_seeds, publish, seeds_text, write_plot};
use crate::cli::Experiment;
use crate::inprocess::Outcome;
use crate::report::{PAPER_MOVES_TO_3_CM, moves_to};
use crate::svg::{Mark, Plot, Series};
use cases::{COLOURS, Case, TRAINING};
use serde::Serialize;

/// The paper's rate for learning: a sample every 40 ms.
const LEARNING_RATE_HZ: f64 = 25.0;
/// Training moves before a change in the middle of training, and after it.
const MOVES_BEFORE: usize = 25;
const MOVES_AFTER: usize = 20;
/// Training moves with a cell that was changed from the start.
const MOVES_FROM_SCRATCH: usize = 30;
/// The error is told after so many further moves.
const FURTHER: [usize; 5] = [1, 2, 5, 10, 20];

/// How the map recovers from one change.
#[derive(Clone, Debug, Serialize)]
struct Learnt {
    change: &'static str,
    /// `start` or `move`, as in the config.
    when: &'static str,
    seeds: u64,
    /// One-shot error at the last move before the change; `null` where it is there from the start.
    before_cm: Option<Spread>,
    /// Moves after the change until the one-shot error is below that on two moves running.
    moves_to_3cm: Moves,
    moves_to_1cm: Moves,
    /// One-shot error after so many further moves.
    after_moves: [usize; 5],
    after_cm: [Spread; 5],
}

/// Runs it.
///
/// # Errors
/// A run fails, or the figures cannot be written.
pub fn run(options: &Experiment) -> Result<u8, String> {
    #[derive(Serialize)]
    struct Figures {
        learning: Vec<Learnt>,
        tracking: Vec<knock::Knocked>,
    }
    cases::check(&options.scenes)?;
    println!("a cell that changes and tells nobody, seeds {}; median / p90", seeds_text(options));
    println!("one-shot error: where one single move would end, over 300 places in view\n");
    let mut learning = Vec::new();
    for (when, title) in [("start", "from the first move on"), ("move", "after 25 training moves")] {
        let wanted: Vec<&Case> = TRAINING.iter().filter(|case| case.is_wanted(&options.scenes)).collect();
        if wanted.is_empty() {
            continue;
        }
        print_head(title, when);
        let mut curves = Vec::new();
        for case in wanted {
            let (learnt, curve) = recovery(options, case, when)?;
            print_row(&learnt, case);
            learning.push(learnt);
            curves.push((case.name, curve));
        }
        write_plot(options, &format!("experiment-change-{when}.svg"), &plot(title, curves).svg())?;
    }
    println!(
        "  the paper (1994): about {PAPER_MOVES_TO_3_CM} moves to 3 cm from scratch; of changes it has no figures\n"
    );
    let (tracking, svg) = knock::run(options)?;
    publish(options, &Figures { learning, tracking }, "experiment-change-tracking.svg", &svg)
}

/// All seeds with one change; also the median error after each move.
fn recovery(
    options: &Experiment,
    case: &Case,
    when: &'static str,
) -> Result<(Learnt, Vec<[f64; 2]>), String> {
    let (before, after) = if when == "move" { (MOVES_BEFORE, MOVES_AFTER) } else { (0, MOVES_FROM_SCRATCH) };
    let mut set = case.settings(when, before as f64);
    set.push(format!("camera.rate_hz={LEARNING_RATE_HZ:?}"));
    set.push(format!("learner.training_moves={}", before + after));
    set.push("simulator.frames=1".to_owned());
    let runs: Vec<Vec<f64>> = over_seeds(options, &set)?.iter().map(|(_, run)| errors(run)).collect();
    let at = |index: usize| spread(runs.iter().map(|errors| errors.get(index).copied().unwrap_or(f64::NAN)));
    let reached = |limit: f64| {
        moves(runs.iter().map(|errors| moves_to(errors.get(before..).unwrap_or_default(), limit)))
    };
    let learnt = Learnt {
        change: case.name,
        when,
        seeds: runs.len() as u64,
        before_cm: before.checked_sub(1).map(at),
        moves_to_3cm: reached(3.0),
        moves_to_1cm: reached(1.0),
        after_moves: FURTHER,
        after_cm: FURTHER.map(|further| at(before + further - 1)),
    };
    let longest = runs.iter().map(Vec::len).max().unwrap_or(0);
    Ok((learnt, (0..longest).map(|index| [index as f64 + 1.0, at(index).p50]).collect()))
}

/// One-shot error after each move, cm.
fn errors(run: &Outcome) -> Vec<f64> {
    run.moves.iter().map(|m| m.error_cm).collect()
}

fn print_head(title: &str, when: &str) {
    println!("  changed {title}");
    println!(
        "  {:<14} {:>9} {:>13} {:>13}   {:<58} prototype",
        "",
        if when == "move" { "before" } else { "" },
        "moves to 3 cm",
        "to 1 cm",
        "cm after 1, 2, 5, 10, 20 moves"
    );
}

fn print_row(learnt: &Learnt, case: &Case) {
    let after: Vec<String> =
        learnt.after_cm.iter().map(|spread| format!("{:>5.2} /{:>5.1}", spread.p50, spread.p90)).collect();
    println!(
        "  {:<14} {:>9} {:>13} {:>13}   {:<58} {}",
        learnt.change,
        learnt.before_cm.map_or_else(String::new, |before| format!("{:.2}", before.p50)),
        moves_text(learnt.moves_to_3cm),
        moves_text(learnt.moves_to_1cm),
        after.join("  "),
        if learnt.when == "move" { case.prototype_in_the_middle } else { case.prototype_at_start },
    );
}

fn plot(title: &str, curves: Vec<(&'static str, Vec<[f64; 2]>)>) -> Plot {
    let last = curves.iter().flat_map(|(_, points)| points).map(|p| p[0]).fold(1.0, f64::max);
    let mut series: Vec<Series> = curves
        .into_iter()
        .zip(COLOURS.iter().cycle())
        .map(|((name, points), colour)| Series { name: name.to_owned(), colour, points, mark: Mark::Line })
        .collect();
    series.push(Series {
        name: String::new(),
        colour: "#888888",
        points: vec![[1.0, 3.0], [last, 3.0]],
        mark: Mark::Dashed,
    });
    Plot {
        title: format!("Changed {title}: error of one single move, median over seeds"),
        x_label: "moves made".to_owned(),
        y_label: "cm".to_owned(),
        equal_axes: false,
        log_y: true,
        series,
    }
}
