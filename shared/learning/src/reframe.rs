//! After a change: is it only the image that turned or grew?
//!
//! A camera that was turned in its mount, or has another focal length, shows the same world in another
//! frame: what was learnt holds for M p in place of p, with M a turn and a scale. Two numbers are found from
//! one move, where a network would need ten; so the memory need not be forgotten. (Not in the paper. That a
//! turn of the image is a turn of the first layer's weights: design notes on the learner, section 10.)

use serde::{Deserialize, Serialize};

use crate::change::relative_error;
use crate::network::Network;
use crate::samples::Sample;

/// Steps of the search over all turns, and over scales from a half to the double.
const TURNS: u32 = 36;
const SCALES: i32 = 4;
/// Samples that the search looks at.
const LOOKED_AT: usize = 32;
/// The first step of the refinement in turn (rad) and in the logarithm of the scale, and how often it is
/// halved: to 1e-4.
const FIRST_STEP: f64 = 0.1;
const HALVINGS: u32 = 10;
/// Motion beside which an error counts, normalised units.
const FLOOR: f64 = 0.05;
/// A new frame has to leave this error at most, and this share of what there was without it.
const GOOD: (f64, f64) = (0.12, 0.4);

/// A turn and a scale of the image: p ↦ (a, −b; b, a) p.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Frame {
    a: f64,
    b: f64,
}

impl Default for Frame {
    /// No change.
    fn default() -> Frame {
        Frame { a: 1.0, b: 0.0 }
    }
}

impl Frame {
    /// Turned by `turn_rad` (from right to down) and `scale` times as large.
    pub fn new(turn_rad: f64, scale: f64) -> Frame {
        let (sin, cos) = turn_rad.sin_cos();
        Frame { a: scale * cos, b: scale * sin }
    }

    /// The frame that takes the image of now to the image that `network` was taught in, found from samples
    /// of now; `None` where no frame explains them well.
    ///
    /// The error is the mean over the samples of |N(M p) − o| / (|o| + floor): wild samples pull little.
    pub fn explaining(samples: &[Sample], network: &Network) -> Option<Frame> {
        let without = error(samples, network, Frame::default());
        let stride = samples.len().div_ceil(LOOKED_AT).max(1);
        let mut best = (f64::INFINITY, 0.0, 0.0);
        for turn in 0..TURNS {
            for octave in -SCALES..=SCALES {
                let turn = std::f64::consts::TAU * f64::from(turn) / f64::from(TURNS);
                let log_scale = std::f64::consts::LN_2 * f64::from(octave) / f64::from(SCALES);
                let frame = Frame::new(turn, log_scale.exp());
                let looked = samples.iter().step_by(stride);
                let left = mean(looked.map(|sample| error_of(sample, network, frame)));
                if left < best.0 {
                    best = (left, turn, log_scale);
                }
            }
        }
        let (left, frame) = refined(samples, network, best.1, best.2);
        (left < GOOD.0 && left < GOOD.1 * without).then_some(frame)
    }

    /// What brings the image that this frame leads to back.
    #[must_use]
    pub fn inverse(self) -> Frame {
        let square = self.a * self.a + self.b * self.b;
        Frame { a: self.a / square, b: -self.b / square }
    }

    /// First `self`, then `other`.
    #[must_use]
    pub fn then(self, other: Frame) -> Frame {
        Frame { a: self.a * other.a - self.b * other.b, b: self.a * other.b + self.b * other.a }
    }

    /// A point in the other image.
    pub fn of(self, [x, y]: [f64; 2]) -> [f64; 2] {
        [self.a * x - self.b * y, self.b * x + self.a * y]
    }

    /// The sample as it would have been in the other image.
    #[must_use]
    pub fn of_sample(self, sample: &Sample) -> Sample {
        let [x, y, theta2] = sample.input;
        let [x, y] = self.of([x, y]);
        let [drift_x, drift_y, rest @ ..] = sample.drift;
        let [drift_x, drift_y] = self.of([drift_x, drift_y]);
        let [theta2_drift, first, second] = rest;
        let drift = [drift_x, drift_y, theta2_drift, first, second];
        Sample { input: [x, y, theta2], drift, ..*sample }
    }
}

fn error_of(sample: &Sample, network: &Network, frame: Frame) -> f64 {
    relative_error(network, &frame.of_sample(sample), FLOOR)
}

fn error(samples: &[Sample], network: &Network, frame: Frame) -> f64 {
    mean(samples.iter().map(|sample| error_of(sample, network, frame)))
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0u32), |(sum, count), value| (sum + value, count + 1));
    sum / f64::from(count.max(1))
}

/// Downhill in steps along turn and scale that are halved when none leads lower.
fn refined(samples: &[Sample], network: &Network, turn: f64, log_scale: f64) -> (f64, Frame) {
    let at = |place: [f64; 2]| error(samples, network, Frame::new(place[0], place[1].exp()));
    let mut place = [turn, log_scale];
    let mut lowest = at(place);
    let mut step = FIRST_STEP;
    for _ in 0..HALVINGS {
        loop {
            let around = [[step, 0.0], [-step, 0.0], [0.0, step], [0.0, -step]];
            let mut moved = false;
            for [turn, scale] in around {
                let there = [place[0] + turn, place[1] + scale];
                let height = at(there);
                if height < lowest {
                    (lowest, place, moved) = (height, there, true);
                }
            }
            if !moved {
                break;
            }
        }
        step *= 0.5;
    }
    (lowest, Frame::new(place[0], place[1].exp()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    /// A network that says something like a real map: about proportional to the place.
    fn network() -> Network {
        let mut weights = [0.0; crate::WEIGHTS];
        let mut rng = ChaCha8Rng::seed_from_u64(8);
        for unit in 0..crate::HIDDEN {
            let (first, second) = if unit % 2 == 0 { (0.3, 0.02) } else { (-0.03, 0.4) };
            let spread = |rng: &mut ChaCha8Rng| rng.random_range(-0.05..0.05);
            let place = &mut weights[6 * unit..6 * unit + 6];
            place.copy_from_slice(&[
                first,
                second,
                spread(&mut rng),
                spread(&mut rng),
                0.5 * first,
                0.4 * second,
            ]);
        }
        Network::from_weights(&weights, true)
    }

    fn samples(network: &Network, frame: Frame) -> Vec<Sample> {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        (0..24)
            .map(|_| {
                let input = [0, 1, 2].map(|_| rng.random_range(-0.8..0.8));
                let old = frame.of_sample(&Sample { input, ..Sample::default() });
                Sample { input, output: network.predict(old.input), ..Sample::default() }
            })
            .collect()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]
        #[test]
        fn the_turn_and_the_scale_of_a_changed_camera_are_found(turn in -3.1..3.1f64, scale in 0.55..1.9f64) {
            let network = network();
            let truth = Frame::new(turn, scale);
            let same = turn.abs() < 0.05 && (scale - 1.0).abs() < 0.05;
            let found = Frame::explaining(&samples(&network, truth), &network);
            prop_assume!(!same);
            let found = found.unwrap();
            prop_assert!((found.a - truth.a).abs() < 2e-3 && (found.b - truth.b).abs() < 2e-3, "{found:?} {truth:?}");
        }

        #[test]
        fn there_and_back_is_no_change(turn in -3.1..3.1f64, scale in 0.1..9.0f64, x in -1.0..1.0f64, y in -1.0..1.0f64) {
            let frame = Frame::new(turn, scale);
            let there = frame.then(frame.inverse());
            prop_assert!((there.a - 1.0).abs() < 1e-12 && there.b.abs() < 1e-12);
            let [u, v] = Frame::new(0.3, 1.2).of(frame.of([x, y]));
            let [s, t] = frame.then(Frame::new(0.3, 1.2)).of([x, y]);
            prop_assert!((u - s).abs() < 1e-12 && (v - t).abs() < 1e-12);
        }
    }

    #[test]
    fn a_change_that_is_no_turn_and_no_zoom_is_not_explained_by_one() {
        let network = network();
        let mut samples = samples(&network, Frame::default());
        for sample in &mut samples {
            sample.output[1] = -sample.output[1];
        }
        assert_eq!(Frame::explaining(&samples, &network), None);
    }

    #[test]
    fn wild_samples_hardly_move_what_is_found() {
        let network = network();
        let truth = Frame::new(1.0, 0.8);
        let mut samples = samples(&network, truth);
        samples[4].output = [3.0, -3.0];
        samples[9].output = [-0.1, 0.9];
        let found = Frame::explaining(&samples, &network);
        // Two of 24 leave an error that is no longer "well explained", or the right frame: never a wrong one.
        assert!(
            found.is_none_or(|f| (f.a - truth.a).abs() < 0.02 && (f.b - truth.b).abs() < 0.02),
            "{found:?}"
        );
    }
}
