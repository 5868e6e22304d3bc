//! The pictures of a run: the paper's figures 6 and 7 from our own data, and the learning curve.

use crate::svg::{Mark, Plot, Series};
use pursuit_messages::Phase;
use pursuit_simulator::journal::{MoveRecord, Record};

const CAMERA: &str = "#0072b2";
const TARGET: &str = "#d55e00";
const MEASURED: &str = "#009e73";

/// All pictures of a run: file name and SVG.
pub fn of_run(records: &[Record], moves: &[MoveRecord]) -> Vec<(&'static str, String)> {
    let tracking: Vec<&Record> = records.iter().filter(|r| r.phase == Phase::Tracking as u32).collect();
    let mut pictures = vec![("learning.svg", learning_curve(moves).svg())];
    if !tracking.is_empty() {
        pictures.push(("figure6-trajectory.svg", trajectory(&tracking).svg()));
        pictures.push(("figure7-x-over-time.svg", x_over_time(&tracking).svg()));
    }
    pictures
}

/// The paper's figures 6 and 7 of these tracking frames.
pub fn following(records: &[Record]) -> [String; 2] {
    let records: Vec<&Record> = records.iter().collect();
    [trajectory(&records).svg(), x_over_time(&records).svg()]
}

/// The paper's figure 6: the camera from above while it follows.
fn trajectory(records: &[&Record]) -> Plot {
    let cm = |point: [f64; 2]| point.map(|axis| 100.0 * axis);
    Plot {
        title: "The hand from above while it follows the vehicle (paper: figure 6)".to_owned(),
        x_label: "x, cm".to_owned(),
        y_label: "y, cm".to_owned(),
        equal_axes: true,
        log_y: false,
        series: vec![
            series("vehicle", TARGET, Mark::Line, records.iter().map(|r| cm(r.target_m)).collect()),
            series("camera", CAMERA, Mark::Line, records.iter().map(|r| cm(r.camera_m)).collect()),
        ],
    }
}

/// The paper's figure 7: one coordinate of the camera and of the measured target over time.
fn x_over_time(records: &[&Record]) -> Plot {
    let start = records.first().map_or(0.0, |r| r.time_s);
    let over_time = |value: fn(&Record) -> f64| {
        records.iter().map(|r| [r.time_s - start, 100.0 * value(r)]).collect::<Vec<_>>()
    };
    let measured = records
        .iter()
        .map(|r| [r.time_s - start, if r.detected == 1 { 100.0 * r.aimed_m[0] } else { f64::NAN }])
        .collect();
    Plot {
        title: "Position over time (paper: figure 7)".to_owned(),
        x_label: "time, s".to_owned(),
        y_label: "x, cm".to_owned(),
        equal_axes: false,
        log_y: false,
        series: vec![
            series("vehicle", TARGET, Mark::Line, over_time(|r| r.target_m[0])),
            series("measured, through the learnt map", MEASURED, Mark::Dots, measured),
            series("camera", CAMERA, Mark::Line, over_time(|r| r.camera_m[0])),
        ],
    }
}

/// The paper's figure 5 of a run: velocities of background and target, px/frame.
pub fn velocity_plane(background: Vec<[f64; 2]>, target: Vec<[f64; 2]>) -> String {
    let plot = Plot {
        title: "Velocities in the image, right and down (paper: figure 5)".to_owned(),
        x_label: "right, px/frame".to_owned(),
        y_label: "down, px/frame".to_owned(),
        equal_axes: true,
        log_y: false,
        series: vec![
            series("background", CAMERA, Mark::Dots, background),
            series("target against the background", TARGET, Mark::Dots, target),
        ],
    };
    plot.svg()
}

/// How far one single move would end from a target, after each move.
fn learning_curve(moves: &[MoveRecord]) -> Plot {
    let over_moves = |value: fn(&MoveRecord) -> f64| {
        moves.iter().map(|m| [f64::from(m.number), value(m)]).collect::<Vec<_>>()
    };
    let ends = [moves.first(), moves.last()].map(|m| m.map_or(0.0, |m| f64::from(m.number)));
    Plot {
        title: "Error of one single move, anywhere in view".to_owned(),
        x_label: "moves made".to_owned(),
        y_label: "cm".to_owned(),
        equal_axes: false,
        log_y: true,
        series: vec![
            series("median", CAMERA, Mark::Line, over_moves(|m| m.error_cm)),
            series("90th percentile", MEASURED, Mark::Line, over_moves(|m| m.error_p90_cm)),
            series("paper: 3 cm after about 5 moves", TARGET, Mark::Dashed, ends.map(|x| [x, 3.0]).to_vec()),
        ],
    }
}

fn series(name: &str, colour: &'static str, mark: Mark, points: Vec<[f64; 2]>) -> Series {
    Series { name: name.to_owned(), colour, points, mark }
}
