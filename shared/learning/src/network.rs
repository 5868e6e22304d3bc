//! The network: three inputs, [`HIDDEN`] tanh units, two linear outputs.

use crate::reframe::Frame;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use crate::activation::tanh;

/// Hidden units. 5 to 8 is what 1991's hardware would carry; from 12 on nothing is gained but time.
pub const HIDDEN: usize = 12;
/// Weights of one hidden unit: from x, y and θ2, its threshold, to Δθ1 and Δθ2.
pub(crate) const PER_UNIT: usize = 6;
/// All weights: the units one after the other, then the thresholds of the two outputs.
pub const WEIGHTS: usize = PER_UNIT * HIDDEN + 2;
/// First-layer weights and thresholds start within ± this.
const FIRST_LAYER_SPREAD: f64 = 0.5;
/// Second-layer weights start within ± this.
const SECOND_LAYER_SPREAD: f64 = 0.3;
/// A weight beyond this is taken for a diverged fit: inputs and outputs are of the order of 1.
const MAX_WEIGHT: f64 = 50.0;

/// Weights of the map (x, y, θ2) → (Δθ1, Δθ2), all in normalised units (see
/// [`Normalisation`](crate::Normalisation)).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Network {
    units: [[f64; PER_UNIT]; HIDDEN],
    offset: [f64; 2],
    anchored: bool,
}

impl Network {
    /// A network with small random weights.
    ///
    /// `anchored` (not in the paper): what each unit says at the centre of the image is subtracted from
    /// it and there are no output thresholds, so that a target in the centre moves the arm by exactly
    /// nothing, at every θ2, from the first moment on.
    pub fn random(rng: &mut ChaCha8Rng, anchored: bool) -> Network {
        let mut units = [[0.0; PER_UNIT]; HIDDEN];
        for unit in &mut units {
            for (index, weight) in unit.iter_mut().enumerate() {
                let spread = if index < 4 { FIRST_LAYER_SPREAD } else { SECOND_LAYER_SPREAD };
                *weight = rng.random_range(-spread..spread);
            }
        }
        Network { units, offset: [0.0; 2], anchored }
    }

    /// The network with these weights, in the order of [`Network::weights`]. The output thresholds of an
    /// anchored network are set to 0.
    pub fn from_weights(weights: &[f64; WEIGHTS], anchored: bool) -> Network {
        let mut network = Network { units: [[0.0; PER_UNIT]; HIDDEN], offset: [0.0; 2], anchored };
        network.set_weights(weights);
        network
    }

    /// All weights: per hidden unit (from x, from y, from θ2, threshold, to Δθ1, to Δθ2), then the
    /// thresholds of the two outputs.
    pub fn weights(&self) -> [f64; WEIGHTS] {
        let mut weights = [0.0; WEIGHTS];
        let (units, offset) = weights.split_at_mut(PER_UNIT * HIDDEN);
        units.copy_from_slice(self.units.as_flattened());
        offset.copy_from_slice(&self.offset);
        weights
    }

    /// Replaces all weights; as [`Network::from_weights`].
    pub fn set_weights(&mut self, weights: &[f64; WEIGHTS]) {
        let (units, offset) = weights.split_at(PER_UNIT * HIDDEN);
        self.units.as_flattened_mut().copy_from_slice(units);
        self.offset = if self.anchored { [0.0; 2] } else { [offset[0], offset[1]] };
    }

    /// Writes the weights that are in use to the front of `weights`, in the order of
    /// [`Network::weights`], and returns their number: an anchored network has no output thresholds.
    ///
    /// # Panics
    /// If there is not room for [`WEIGHTS`].
    pub fn export(&self, weights: &mut [f64]) -> usize {
        weights[..WEIGHTS].copy_from_slice(&self.weights());
        if self.anchored { WEIGHTS - 2 } else { WEIGHTS }
    }

    /// The network behind what [`Network::export`] wrote, `None` where the number of weights fits none.
    pub fn import(weights: &[f64]) -> Option<Network> {
        let anchored = match weights.len() {
            WEIGHTS => false,
            count if count + 2 == WEIGHTS => true,
            _ => return None,
        };
        let mut all = [0.0; WEIGHTS];
        all[..weights.len()].copy_from_slice(weights);
        Some(Network::from_weights(&all, anchored))
    }

    /// Whether the centre of the image means no displacement by construction.
    pub fn anchored(&self) -> bool {
        self.anchored
    }

    /// The network that says of an image what this one says of that image brought into `frame`.
    #[must_use]
    pub fn seen_through(&self, frame: Frame) -> Network {
        let mut network = self.clone();
        for unit in &mut network.units {
            // W1 (M p) = (W1 M) p: the transposed matrix turns the weights back.
            let [x, y] = [frame.of([1.0, 0.0]), frame.of([0.0, 1.0])];
            let (w_x, w_y) = (unit[0], unit[1]);
            (unit[0], unit[1]) = (w_x * x[0] + w_y * x[1], w_x * y[0] + w_y * y[1]);
        }
        network
    }

    /// Normalised displacement (Δθ1, Δθ2) for the normalised input (x, y, θ2).
    ///
    /// N(x, y, t) = W2 [tanh(W1 (x, y, t) + b1) − tanh(W1 (0, 0, t) + b1)]; not anchored: W2 tanh(…) + b2.
    pub fn predict(&self, input: [f64; 3]) -> [f64; 2] {
        let mut output = self.offset;
        for unit in &self.units {
            let activation = Activation::of(unit, input, self.anchored);
            output[0] += unit[4] * activation.difference();
            output[1] += unit[5] * activation.difference();
        }
        output
    }

    /// Adds to `gradient` the gradient of the error that one sample leaves, and returns that error.
    ///
    /// `error_of` turns the residual (prediction − taught output) into the error and its derivative
    /// with respect to the prediction.
    pub(crate) fn back_propagate(
        &self,
        input: [f64; 3],
        taught: [f64; 2],
        error_of: impl Fn([f64; 2]) -> (f64, [f64; 2]),
        gradient: &mut [f64; WEIGHTS],
    ) -> f64 {
        let mut activations = [Activation::default(); HIDDEN];
        let mut output = self.offset;
        for (activation, unit) in activations.iter_mut().zip(&self.units) {
            *activation = Activation::of(unit, input, self.anchored);
            output[0] += unit[4] * activation.difference();
            output[1] += unit[5] * activation.difference();
        }
        let (error, slope) = error_of([output[0] - taught[0], output[1] - taught[1]]);
        let (units, offset) = gradient.split_at_mut(PER_UNIT * HIDDEN);
        for ((g, unit), a) in
            units.as_chunks_mut::<PER_UNIT>().0.iter_mut().zip(&self.units).zip(&activations)
        {
            let back = unit[4] * slope[0] + unit[5] * slope[1];
            let here = back * (1.0 - a.here * a.here);
            // The anchor's share: an un-anchored unit has none.
            let centre = if self.anchored { back * (1.0 - a.centre * a.centre) } else { 0.0 };
            g[0] += here * input[0];
            g[1] += here * input[1];
            g[2] += (here - centre) * input[2];
            g[3] += here - centre;
            g[4] += slope[0] * a.difference();
            g[5] += slope[1] * a.difference();
        }
        if !self.anchored {
            offset[0] += slope[0];
            offset[1] += slope[1];
        }
        error
    }

    /// Whether all weights are finite and none has run away.
    pub fn is_sound(&self) -> bool {
        self.units.as_flattened().iter().chain(&self.offset).all(|weight| weight.abs() < MAX_WEIGHT)
    }
}

/// What one hidden unit says at a point of the image and at the image's centre.
#[derive(Clone, Copy, Default)]
struct Activation {
    here: f64,
    centre: f64,
}

impl Activation {
    fn of(unit: &[f64; PER_UNIT], [x, y, t]: [f64; 3], anchored: bool) -> Activation {
        // Written so that x = y = 0 gives the same argument twice, to the bit.
        let threshold = unit[2] * t + unit[3];
        let here = tanh(unit[0] * x + unit[1] * y + threshold);
        Activation { here, centre: if anchored { tanh(threshold) } else { 0.0 } }
    }

    fn difference(&self) -> f64 {
        self.here - self.centre
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use rand::SeedableRng;

    fn network(seed: u64, anchored: bool) -> Network {
        Network::random(&mut ChaCha8Rng::seed_from_u64(seed), anchored)
    }

    proptest! {
        #[test]
        fn a_target_in_the_centre_moves_an_anchored_arm_by_exactly_nothing(seed: u64, t in -2.0..2.0f64) {
            prop_assert_eq!(network(seed, true).predict([0.0, 0.0, t]), [0.0, 0.0]);
        }

        /// Section 10.8 of the design: turning the camera in the hand and the first layer with it
        /// changes nothing, which is why the mount angle needs no calibration.
        #[test]
        fn a_turned_camera_is_a_turned_first_layer(
            seed: u64, angle in -3.0..3.0f64, x in -1.0..1.0f64, y in -1.0..1.0f64, t in -1.0..1.0f64,
        ) {
            let network = network(seed, true);
            let (sin, cos) = angle.sin_cos();
            let mut turned = network.clone();
            for unit in &mut turned.units {
                (unit[0], unit[1]) = (cos * unit[0] - sin * unit[1], sin * unit[0] + cos * unit[1]);
            }
            let straight = network.predict([x, y, t]);
            let rotated = turned.predict([cos * x - sin * y, sin * x + cos * y, t]);
            prop_assert!((straight[0] - rotated[0]).abs() < 1e-12);
            prop_assert!((straight[1] - rotated[1]).abs() < 1e-12);
        }

        #[test]
        fn weights_survive_the_way_out_and_in(seed: u64, anchored: bool) {
            let network = network(seed, anchored);
            prop_assert_eq!(&Network::from_weights(&network.weights(), anchored), &network);
            let mut exported = [1.0; 192];
            let count = network.export(&mut exported);
            prop_assert_eq!(Network::import(&exported[..count]), Some(network));
            prop_assert_eq!(Network::import(&exported[..count - 1]), None);
        }
    }

    #[test]
    fn a_network_that_is_not_anchored_has_an_offset() {
        assert_ne!(network(1, false).predict([0.0, 0.0, 0.3]), [0.0, 0.0]);
    }

    #[test]
    fn runaway_and_not_a_number_are_unsound() {
        let mut weights = network(1, true).weights();
        assert!(Network::from_weights(&weights, true).is_sound());
        weights[7] = f64::NAN;
        assert!(!Network::from_weights(&weights, true).is_sound());
        weights[7] = -60.0;
        assert!(!Network::from_weights(&weights, true).is_sound());
    }
}
