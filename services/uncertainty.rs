//! Where the learnt map is sure of itself: its uncertainty over the image, for some angles of joint 2.
//!
//! Joint 1 does not enter: turning it turns the image, and the map is the same.

use crate::svg;
use pursuit_learner::step::Learner;
use std::fmt::Write as _;

/// Squares of each picture, across and down.
const CELLS: usize = 24;
/// Side of one picture, px.
const SIDE: f64 = 216.0;
/// Between two pictures, px.
const GAP: f64 = 34.0;
/// Left and top of the first one, px.
const ORIGIN: [f64; 2] = [40.0, 76.0];
/// Pictures: angles of joint 2 over its range.
const ANGLES: usize = 4;
/// An uncertainty from here on is drawn in full colour, degrees.
const FULL_DEG: f64 = 4.0;
/// Steps of the scale.
const STEPS: usize = 8;
const COLOUR: &str = "#d55e00";

/// The picture of a learner that sees images of that half width.
pub fn picture(learner: &Learner, half_width_px: f64) -> String {
    let width = ORIGIN[0] + ANGLES as f64 * (SIDE + GAP);
    let height = ORIGIN[1] + SIDE + 96.0;
    let mut svg = svg::head((width, height), ORIGIN[0], "Uncertainty of the learnt map, degrees of a joint");
    let [low, high] = learner.parameters().theta2_rad;
    for index in 0..ANGLES {
        let theta2 = low + (high - low) * index as f64 / (ANGLES - 1) as f64;
        let left = ORIGIN[0] + index as f64 * (SIDE + GAP);
        panel(learner, half_width_px, theta2, left, &mut svg);
    }
    scale(height - 52.0, &mut svg);
    svg.push_str("</svg>\n");
    svg
}

/// The whole image at one angle of joint 2.
fn panel(learner: &Learner, half_width_px: f64, theta2: f64, left: f64, svg: &mut String) {
    let cell = SIDE / CELLS as f64;
    let at = |k: usize| ((k as f64 + 0.5) / CELLS as f64 * 2.0 - 1.0) * half_width_px;
    let mut worst = 0.0f64;
    for row in 0..CELLS {
        for column in 0..CELLS {
            let degrees = learner.uncertainty_rad([at(column), at(row)], half_width_px, theta2).to_degrees();
            worst = worst.max(degrees);
            let (x, y) = (left + column as f64 * cell, ORIGIN[1] + row as f64 * cell);
            let _ = writeln!(
                svg,
                "<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{:.1}\" height=\"{:.1}\" fill=\"{COLOUR}\" fill-opacity=\"{:.3}\"/>",
                cell + 0.3,
                cell + 0.3,
                opacity(degrees)
            );
        }
    }
    let middle = left + SIDE / 2.0;
    let _ = writeln!(
        svg,
        "<rect class=\"grid\" x=\"{left}\" y=\"{}\" width=\"{SIDE}\" height=\"{SIDE}\" fill=\"none\"/>\n\
         <text class=\"ink\" x=\"{middle}\" y=\"{}\" text-anchor=\"middle\">joint 2 at {:.0}°</text>\n\
         <text class=\"ink\" x=\"{middle}\" y=\"{}\" text-anchor=\"middle\">largest {worst:.2}°</text>",
        ORIGIN[1],
        ORIGIN[1] - 10.0,
        theta2.to_degrees(),
        ORIGIN[1] + SIDE + 18.0,
    );
}

/// What the colours mean.
fn scale(top: f64, svg: &mut String) {
    let step = 40.0;
    for index in 0..=STEPS {
        let degrees = FULL_DEG * (index as f64 / STEPS as f64).powi(2);
        let x = ORIGIN[0] + index as f64 * step;
        let _ = writeln!(
            svg,
            "<rect x=\"{x}\" y=\"{top}\" width=\"{step}\" height=\"14\" fill=\"{COLOUR}\" fill-opacity=\"{:.3}\"/>\n\
             <text class=\"ink\" x=\"{}\" y=\"{}\" text-anchor=\"middle\" font-size=\"11\">{degrees:.2}°</text>",
            opacity(degrees),
            x + step / 2.0,
            top + 28.0
        );
    }
    let x = ORIGIN[0] + (STEPS + 1) as f64 * step + 16.0;
    let _ = writeln!(
        svg,
        "<text class=\"ink\" x=\"{x}\" y=\"{}\" font-size=\"12\">each square: the whole image; middle: under the hand</text>",
        top + 12.0
    );
}

/// Small uncertainties are told apart, too.
fn opacity(degrees: f64) -> f64 {
    (degrees / FULL_DEG).max(0.0).sqrt().min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use pursuit_learner::config::Parameters;

    #[test]
    fn who_knows_nothing_is_sure_of_the_middle_alone() {
        let learner = Learner::new(&Parameters::default(), 1);
        let svg = picture(&learner, 256.0);
        assert_eq!(svg.matches("joint 2 at").count(), ANGLES);
        assert!(svg.matches("fill-opacity=\"1.000\"").count() > ANGLES * CELLS * CELLS / 2, "{svg:.2000}");
        let middle = learner.uncertainty_rad([0.0; 2], 256.0, 0.6);
        assert!(middle < 1e-9 && learner.uncertainty_rad([200.0, 0.0], 256.0, 0.6) > 0.1);
    }
}
