//! The samples of a refit, laid out so that the processor computes several of them at once.

// One lane's index runs through several arrays: it says more than a chain of zips.
#![allow(clippy::needless_range_loop)]

use multiversion::multiversion;

use crate::activation::tanh;
use crate::levenberg_marquardt::{NormalEquations, Squares};
use crate::network::{HIDDEN, PER_UNIT, WEIGHTS};
use crate::samples::Sample;

/// Samples that are computed together.
const LANES: usize = 8;

/// One number for each of some samples.
type Lanes = [f64; LANES];

/// Some samples; those that only fill the place up have the weight 0.
#[derive(Clone, Copy, Debug)]
struct Block {
    input: [Lanes; 3],
    output: [Lanes; 2],
    weight: Lanes,
}

/// The samples of a refit. Made once, then evaluated without allocation.
#[derive(Clone, Debug)]
pub struct Batch {
    blocks: Vec<Block>,
    count: usize,
    /// Residual beyond which a sample pulls only linearly; infinite: quadratic.
    threshold: f64,
    anchored: bool,
}

impl Batch {
    /// The samples, for a network that is `anchored` or not; `threshold` as in
    /// [`huber`](crate::objective::huber).
    pub fn new(samples: &[Sample], threshold: Option<f64>, anchored: bool) -> Batch {
        let blocks = samples.chunks(LANES).map(Block::of).collect();
        Batch { blocks, count: samples.len(), threshold: threshold.unwrap_or(f64::INFINITY), anchored }
    }

    /// Mean error over the samples at these weights (in the order of
    /// [`Network::weights`](crate::Network::weights)) and, in `gradient`, its derivative with respect to
    /// them; 0 for no samples. Same bits with and without the processor's vector extensions: sums are
    /// taken in a fixed order, products and sums are not fused.
    pub fn error_and_gradient(&self, weights: &[f64; WEIGHTS], gradient: &mut [f64; WEIGHTS]) -> f64 {
        let mut sums = Sums::default();
        add_up(self, weights, &mut sums);
        let count = self.count.max(1) as f64;
        let mean = |lanes: &Lanes| lanes.iter().sum::<f64>() / count;
        let (units, offset) = gradient.split_at_mut(PER_UNIT * HIDDEN);
        for (slope, sum) in units.iter_mut().zip(sums.units.as_flattened()) {
            *slope = mean(sum);
        }
        for (slope, sum) in offset.iter_mut().zip(&sums.offset) {
            *slope = if self.anchored { 0.0 } else { mean(sum) };
        }
        mean(&sums.error)
    }
}

impl Squares<WEIGHTS> for Batch {
    fn value(&mut self, weights: &[f64; WEIGHTS]) -> f64 {
        self.error_and_gradient(weights, &mut [0.0; WEIGHTS])
    }

    /// Of Huber's error: a sample beyond the threshold counts by the share threshold / residual.
    fn normal_equations(
        &mut self,
        weights: &[f64; WEIGHTS],
        equations: &mut NormalEquations<WEIGHTS>,
    ) -> f64 {
        equations.clear();
        add_up_squares(self, weights, &mut equations.matrix);
        let count = self.count.max(1) as f64;
        for row in &mut equations.matrix {
            for product in row {
                *product /= count;
            }
        }
        self.error_and_gradient(weights, &mut equations.gradient)
    }
}

impl Block {
    fn of(samples: &[Sample]) -> Block {
        let mut block = Block { input: [[0.0; LANES]; 3], output: [[0.0; LANES]; 2], weight: [0.0; LANES] };
        for (lane, sample) in samples.iter().enumerate() {
            for axis in 0..3 {
                block.input[axis][lane] = sample.input[axis];
            }
            for axis in 0..2 {
                block.output[axis][lane] = sample.output[axis];
            }
            block.weight[lane] = 1.0;
        }
        block
    }
}

/// Sums over the blocks, lane by lane.
struct Sums {
    error: Lanes,
    units: [[Lanes; PER_UNIT]; HIDDEN],
    offset: [Lanes; 2],
}

impl Default for Sums {
    fn default() -> Sums {
        Sums { error: [0.0; LANES], units: [[[0.0; LANES]; PER_UNIT]; HIDDEN], offset: [[0.0; LANES]; 2] }
    }
}

/// What the hidden units say of a block's samples, and at the centre of the image.
struct Activations {
    here: [Lanes; HIDDEN],
    centre: [Lanes; HIDDEN],
}

// No fused multiply-add anywhere: the bits are the same on every processor.
#[multiversion(targets("x86_64+avx+avx2", "x86_64+avx"))]
fn add_up(batch: &Batch, weights: &[f64; WEIGHTS], sums: &mut Sums) {
    let (units, offset) = weights.split_at(PER_UNIT * HIDDEN);
    let units = units.as_chunks::<PER_UNIT>().0;
    let mut activations = Activations { here: [[0.0; LANES]; HIDDEN], centre: [[0.0; LANES]; HIDDEN] };
    for block in &batch.blocks {
        let mut slope = if batch.anchored { [0.0; 2] } else { [offset[0], offset[1]] }.map(|o| [o; LANES]);
        forward(block, units, batch.anchored, &mut activations, &mut slope);
        differentiate(block, batch.threshold, &mut slope, &mut sums.error);
        backward(block, units, batch.anchored, (&activations, &slope), &mut sums.units);
        for axis in 0..2 {
            for lane in 0..LANES {
                sums.offset[axis][lane] += slope[axis][lane];
            }
        }
    }
}

/// Adds up JᵀJ of all samples, the lower triangle.
#[multiversion(targets("x86_64+avx+avx2", "x86_64+avx"))]
fn add_up_squares(batch: &Batch, weights: &[f64; WEIGHTS], matrix: &mut [[f64; WEIGHTS]]) {
    let (units, offset) = weights.split_at(PER_UNIT * HIDDEN);
    let units = units.as_chunks::<PER_UNIT>().0;
    let mut activations = Activations { here: [[0.0; LANES]; HIDDEN], centre: [[0.0; LANES]; HIDDEN] };
    for block in &batch.blocks {
        let mut output = if batch.anchored { [0.0; 2] } else { [offset[0], offset[1]] }.map(|o| [o; LANES]);
        forward(block, units, batch.anchored, &mut activations, &mut output);
        for lane in 0..LANES {
            let residual = [0, 1].map(|axis| output[axis][lane] - block.output[axis][lane]);
            let length = (residual[0] * residual[0] + residual[1] * residual[1]).sqrt();
            let share = if length > batch.threshold { batch.threshold / length } else { 1.0 };
            let weight = share * block.weight[lane];
            for axis in 0..2 {
                let row = jacobian_row(block, units, &activations, batch.anchored, (lane, axis));
                for (index, slope) in row.iter().enumerate().filter(|(_, slope)| **slope != 0.0) {
                    let scaled = weight * slope;
                    for (sum, other) in matrix[index][..=index].iter_mut().zip(&row) {
                        *sum += scaled * other;
                    }
                }
            }
        }
    }
}

/// Derivative of one output of one sample with respect to all weights.
#[inline(always)]
fn jacobian_row(
    block: &Block,
    units: &[[f64; PER_UNIT]],
    activations: &Activations,
    anchored: bool,
    (lane, axis): (usize, usize),
) -> [f64; WEIGHTS] {
    let mut row = [0.0; WEIGHTS];
    let anchor = if anchored { 1.0 } else { 0.0 };
    let (slopes, offset) = row.split_at_mut(PER_UNIT * HIDDEN);
    for (index, (unit, slope)) in units.iter().zip(slopes.as_chunks_mut::<PER_UNIT>().0).enumerate() {
        let (here, centre) = (activations.here[index][lane], activations.centre[index][lane]);
        let steep = unit[4 + axis] * (1.0 - here * here);
        let threshold = steep - anchor * unit[4 + axis] * (1.0 - centre * centre);
        slope[0] = steep * block.input[0][lane];
        slope[1] = steep * block.input[1][lane];
        slope[2] = threshold * block.input[2][lane];
        slope[3] = threshold;
        slope[4 + axis] = here - centre;
    }
    offset[axis] = 1.0 - anchor;
    row
}

/// Adds what the units say to `output`.
#[inline(always)]
fn forward(
    block: &Block,
    units: &[[f64; PER_UNIT]],
    anchored: bool,
    activations: &mut Activations,
    output: &mut [Lanes; 2],
) {
    let [x, y, t] = &block.input;
    for ((unit, here), centre) in units.iter().zip(&mut activations.here).zip(&mut activations.centre) {
        for lane in 0..LANES {
            let threshold = unit[2] * t[lane] + unit[3];
            here[lane] = tanh(unit[0] * x[lane] + unit[1] * y[lane] + threshold);
            centre[lane] = threshold;
        }
        if anchored {
            for value in centre.iter_mut() {
                *value = tanh(*value);
            }
        } else {
            *centre = [0.0; LANES];
        }
        for lane in 0..LANES {
            output[0][lane] += unit[4] * (here[lane] - centre[lane]);
            output[1][lane] += unit[5] * (here[lane] - centre[lane]);
        }
    }
}

/// Turns outputs into the derivative of Huber's error with respect to them, and adds the errors up.
#[inline(always)]
fn differentiate(block: &Block, threshold: f64, output: &mut [Lanes; 2], error: &mut Lanes) {
    let [first, second] = output;
    for lane in 0..LANES {
        let residual = [first[lane] - block.output[0][lane], second[lane] - block.output[1][lane]];
        let squared = residual[0] * residual[0] + residual[1] * residual[1];
        let length = squared.sqrt();
        let linear = length > threshold;
        let far = threshold * length - 0.5 * threshold * threshold;
        let weight = block.weight[lane];
        error[lane] += weight * if linear { far } else { 0.5 * squared };
        let share = weight * if linear { threshold / length } else { 1.0 };
        first[lane] = share * residual[0];
        second[lane] = share * residual[1];
    }
}

/// Adds the block's share to the sums of the gradient.
#[inline(always)]
fn backward(
    block: &Block,
    units: &[[f64; PER_UNIT]],
    anchored: bool,
    (activations, slope): (&Activations, &[Lanes; 2]),
    sums: &mut [[Lanes; PER_UNIT]; HIDDEN],
) {
    let [x, y, t] = &block.input;
    let anchor = if anchored { 1.0 } else { 0.0 };
    for (((unit, sum), here), centre) in
        units.iter().zip(sums).zip(&activations.here).zip(&activations.centre)
    {
        for lane in 0..LANES {
            let back = unit[4] * slope[0][lane] + unit[5] * slope[1][lane];
            let steep = back * (1.0 - here[lane] * here[lane]);
            // The anchor's share: an un-anchored unit has none.
            let threshold = steep - anchor * back * (1.0 - centre[lane] * centre[lane]);
            let difference = here[lane] - centre[lane];
            sum[0][lane] += steep * x[lane];
            sum[1][lane] += steep * y[lane];
            sum[2][lane] += threshold * t[lane];
            sum[3][lane] += threshold;
            sum[4][lane] += slope[0][lane] * difference;
            sum[5][lane] += slope[1][lane] * difference;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::Network;
    use crate::objective::mean_error_and_gradient;
    use proptest::prelude::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    fn samples(rng: &mut ChaCha8Rng, count: usize) -> Vec<Sample> {
        let mut number = |spread: f64| rng.random_range(-spread..spread);
        (0..count)
            .map(|_| Sample {
                input: [number(1.5), number(1.5), number(1.0)],
                output: [number(0.3), number(0.3)],
                ..Sample::default()
            })
            .collect()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(60))]
        /// The oracle is the plain back-propagation, one sample after the other, whose gradient is checked
        /// against finite differences.
        #[test]
        fn together_they_give_what_one_after_the_other_gives(
            seed: u64, count in 0usize..40, anchored: bool, robust: bool,
        ) {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            let network = Network::random(&mut rng, anchored);
            let samples = samples(&mut rng, count);
            let threshold = robust.then_some(0.2);
            let mut expected = [0.0; WEIGHTS];
            let error = mean_error_and_gradient(&network, &samples, threshold, &mut expected);
            let batch = Batch::new(&samples, threshold, anchored);
            let mut gradient = [1.0; WEIGHTS];
            prop_assert!((batch.error_and_gradient(&network.weights(), &mut gradient) - error).abs() < 1e-14);
            for (slope, expected) in gradient.iter().zip(&expected) {
                prop_assert!((slope - expected).abs() < 1e-14, "{} {}", slope, expected);
            }
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(20))]
        /// The oracle: products of finite differences of what the network says, no sample beyond Huber's
        /// threshold.
        #[test]
        fn the_normal_equations_are_products_of_derivatives(seed: u64, anchored: bool) {
            const STEP: f64 = 1e-5;
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            let network = Network::random(&mut rng, anchored);
            let samples = samples(&mut rng, 11);
            let mut equations =
                NormalEquations { gradient: [0.0; WEIGHTS], matrix: vec![[0.0; WEIGHTS]; WEIGHTS] };
            let mut batch = Batch::new(&samples, None, anchored);
            let weights = network.weights();
            batch.normal_equations(&weights, &mut equations);
            let derivative = |sample: &Sample, index: usize| {
                let at = |step: f64| {
                    let mut moved = weights;
                    moved[index] += step;
                    Network::from_weights(&moved, anchored).predict(sample.input)
                };
                let (after, before) = (at(STEP), at(-STEP));
                [0, 1].map(|axis| (after[axis] - before[axis]) / (2.0 * STEP))
            };
            for (row, column) in [(0, 0), (8, 3), (17, 16), (70, 41), (70, 70), (WEIGHTS - 1, 5)] {
                let sum: f64 = samples
                    .iter()
                    .map(|sample| (derivative(sample, row), derivative(sample, column)))
                    .map(|(a, b)| a[0] * b[0] + a[1] * b[1])
                    .sum();
                let expected = sum / samples.len() as f64;
                prop_assert!((equations.matrix[row][column] - expected).abs() < 1e-8);
            }
        }
    }

    #[test]
    fn a_sample_that_is_not_a_number_is_seen_in_the_error() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let network = Network::random(&mut rng, true);
        let mut samples = samples(&mut rng, 9);
        samples[4].input[1] = f64::NAN;
        let batch = Batch::new(&samples, Some(0.05), true);
        assert!(batch.error_and_gradient(&network.weights(), &mut [0.0; WEIGHTS]).is_nan());
    }
}
