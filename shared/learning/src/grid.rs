//! How good is the network? The error of one single move, over a fixed set of cases.

use serde::{Deserialize, Serialize};

use crate::network::Network;
use crate::samples::Normalisation;

/// One case: a target in the image, seen at an angle of joint 2.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct GridCase {
    /// Target, px from the image's centre.
    pub point_px: [f64; 2],
    /// Angle of joint 2, rad.
    pub theta2: f64,
}

/// Distribution of the error over the cases, in the unit of the error function.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct GridError {
    /// Half of the cases are better.
    pub median: f64,
    /// Nine of ten are better.
    pub p90: f64,
}

/// Error that one move of the network leaves, over all cases.
///
/// `error_after` gets the case and the commanded displacement of joints 1 and 2 (rad) and knows the exact
/// model, which nothing in this crate does.
///
/// # Panics
/// If there are no cases.
pub fn evaluate_grid(
    network: &Network,
    normalisation: &Normalisation,
    cases: &[GridCase],
    error_after: impl Fn(&GridCase, [f64; 2]) -> f64,
) -> GridError {
    assert!(!cases.is_empty(), "a grid without cases has no error");
    let mut errors: Vec<f64> = cases
        .iter()
        .map(|case| {
            let output = network.predict(normalisation.input(case.point_px, case.theta2));
            error_after(case, normalisation.displacement(output))
        })
        .collect();
    errors.sort_by(f64::total_cmp);
    let quantile = |share: f64| errors[((errors.len() - 1) as f64 * share).round() as usize];
    GridError { median: quantile(0.5), p90: quantile(0.9) }
}
