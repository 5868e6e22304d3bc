//! How much the map knows where it is asked: from where its samples lie.
//!
//! The posterior variance of a Gaussian process on the same samples, with a prior that says, as the anchored
//! network does, "no displacement for a target in the middle of the image": a process like that learns this
//! map about as well as the network (design notes on the learner, section 4.1), so its doubt is a fair measure
//! of the network's. Only the places of the samples enter, so it is computed once per change of the ring.
//! (Not in the paper.)

use serde::{Deserialize, Serialize};

use crate::samples::Sample;

/// Samples that are taken into account, evenly out of all: the paper's number.
const MOST: usize = 100;
/// How far a sample's word carries, normalised inputs (x, y, θ2).
const REACH: [f64; 3] = [1.2, 1.2, 1.5];
/// Variance of a sample's output beside the prior's.
const NOISE: f64 = 1e-4;

/// What is known where.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Coverage {
    places: Vec<[f64; 3]>,
    /// Lower triangle of the Cholesky factor of the samples' covariance, row after row.
    factor: Vec<f64>,
}

impl Default for Coverage {
    /// Nothing is known anywhere.
    fn default() -> Coverage {
        Coverage { places: Vec::with_capacity(MOST), factor: Vec::with_capacity(MOST * (MOST + 1) / 2) }
    }
}

impl Coverage {
    /// Takes the samples in place of the former ones; a third of a millisecond for 100. No allocation.
    pub fn take(&mut self, samples: &[Sample]) {
        self.places.clear();
        let count = samples.len().min(MOST);
        self.places.extend((0..count).map(|k| samples[k * samples.len() / count].input));
        self.factor.clear();
        for row in 0..count {
            for column in 0..=row {
                let mut rest = covariance(&self.places[row], &self.places[column]);
                for k in 0..column {
                    rest -= self.entry(row, k) * self.entry(column, k);
                }
                let entry = if row == column {
                    (rest + NOISE).max(NOISE).sqrt()
                } else {
                    rest / self.entry(column, column)
                };
                self.factor.push(entry);
            }
        }
    }

    fn entry(&self, row: usize, column: usize) -> f64 {
        self.factor[row * (row + 1) / 2 + column]
    }

    /// Standard deviation of what the map says at a (normalised) input, in normalised units of its output:
    /// 0 in the middle of the image, 1.4 at its edge where nothing is known.
    pub fn doubt(&self, input: [f64; 3]) -> f64 {
        let mut solved = [0.0; MOST];
        let mut variance = covariance(&input, &input);
        for row in 0..self.places.len() {
            let mut rest = covariance(&input, &self.places[row]);
            for k in 0..row {
                rest -= self.entry(row, k) * solved[k];
            }
            solved[row] = rest / self.entry(row, row);
            variance -= solved[row] * solved[row];
        }
        variance.max(0.0).sqrt()
    }
}

/// A·B (1 + exp(−d²/2)): linear in the place, by a factor that changes slowly from place to place.
fn covariance(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    let squared: f64 = (0..3).map(|k| ((a[k] - b[k]) / REACH[k]).powi(2)).sum();
    (a[0] * b[0] + a[1] * b[1]) * (1.0 + (-0.5 * squared).exp())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn sample(input: [f64; 3]) -> Sample {
        Sample { input, ..Sample::default() }
    }

    fn grid() -> Vec<Sample> {
        let at = |k: u32| -0.9 + 0.6 * f64::from(k);
        (0..4).flat_map(|x| (0..4).map(move |y| sample([at(x), at(y), 0.3]))).collect()
    }

    #[test]
    fn who_knows_nothing_doubts_everything_but_the_middle() {
        let nothing = Coverage::default();
        assert_eq!(nothing.doubt([0.0, 0.0, 0.5]), 0.0);
        assert!((nothing.doubt([0.6, 0.8, -0.5]) - 2.0_f64.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn there_is_little_doubt_among_samples_and_more_the_further_one_goes() {
        let mut coverage = Coverage::default();
        coverage.take(&grid());
        let [among, edge, beyond, other_angle] =
            [[0.2, -0.1, 0.3], [0.9, 0.9, 0.3], [1.6, 1.6, 0.3], [0.6, 0.6, -1.0]]
                .map(|input| coverage.doubt(input));
        assert!(among < 0.02 && among < edge && edge < beyond, "{among} {edge} {beyond}");
        assert!(other_angle > 5.0 * coverage.doubt([0.6, 0.6, 0.3]), "{other_angle}");
    }

    #[test]
    fn one_direction_says_nothing_of_the_other() {
        let mut coverage = Coverage::default();
        coverage.take(&(1..9).map(|k| sample([0.1 * f64::from(k), 0.0, 0.0])).collect::<Vec<_>>());
        assert!(coverage.doubt([0.5, 0.0, 0.0]) < 0.02);
        assert!(coverage.doubt([0.0, 0.5, 0.0]) > 0.5);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]
        /// Against the textbook: the variance of a Gaussian conditional by Gaussian elimination.
        #[test]
        fn it_is_the_posterior_of_a_gaussian_process(
            places in prop::collection::vec([-1.0..1.0f64, -1.0..1.0, -1.0..1.0], 1..12),
            input in [-1.0..1.0f64, -1.0..1.0, -1.0..1.0],
        ) {
            let samples: Vec<Sample> = places.iter().map(|place| sample(*place)).collect();
            let mut coverage = Coverage::default();
            coverage.take(&samples);
            let n = places.len();
            let mut rows: Vec<Vec<f64>> = (0..n)
                .map(|i| {
                    let mut row: Vec<f64> = places.iter().map(|p| covariance(&places[i], p)).collect();
                    row[i] += NOISE;
                    row.push(covariance(&places[i], &input));
                    row
                })
                .collect();
            for pivot in 0..n {
                for row in pivot + 1..n {
                    let factor = rows[row][pivot] / rows[pivot][pivot];
                    for column in pivot..=n {
                        rows[row][column] -= factor * rows[pivot][column];
                    }
                }
            }
            let mut weights = vec![0.0; n];
            for row in (0..n).rev() {
                let known: f64 = (row + 1..n).map(|k| rows[row][k] * weights[k]).sum();
                weights[row] = (rows[row][n] - known) / rows[row][row];
            }
            let explained: f64 = (0..n).map(|k| weights[k] * covariance(&places[k], &input)).sum();
            let expected = (covariance(&input, &input) - explained).max(0.0).sqrt();
            prop_assert!((coverage.doubt(input) - expected).abs() < 1e-5, "{} {expected}", coverage.doubt(input));
        }
    }
}
