//! The error that is minimised: Huber on each sample's residual, mean over the samples.

use crate::network::{Network, WEIGHTS};
use crate::samples::Sample;

/// Error of one residual and its derivative with respect to the residual.
///
/// Quadratic, ½|e|², up to `threshold`, linear beyond: one wild sample pulls no harder than one at the
/// threshold. `None` is the paper's plain average quadratic error.
pub fn huber(residual: [f64; 2], threshold: Option<f64>) -> (f64, [f64; 2]) {
    let squared = residual[0] * residual[0] + residual[1] * residual[1];
    match threshold {
        Some(threshold) if squared > threshold * threshold => {
            let length = squared.sqrt();
            let slope = threshold / length;
            let error = threshold * length - 0.5 * threshold * threshold;
            (error, [slope * residual[0], slope * residual[1]])
        }
        _ => (0.5 * squared, residual),
    }
}

/// Mean error over the samples; 0 for none.
pub fn mean_error(network: &Network, samples: &[Sample], threshold: Option<f64>) -> f64 {
    let sum: f64 = samples
        .iter()
        .map(|sample| {
            let output = network.predict(sample.input);
            huber([output[0] - sample.output[0], output[1] - sample.output[1]], threshold).0
        })
        .sum();
    sum / samples.len().max(1) as f64
}

/// Mean error over the samples and, in `gradient`, its derivative with respect to all weights. Allocates
/// nothing.
pub fn mean_error_and_gradient(
    network: &Network,
    samples: &[Sample],
    threshold: Option<f64>,
    gradient: &mut [f64; WEIGHTS],
) -> f64 {
    gradient.fill(0.0);
    let mut sum = 0.0;
    for sample in samples {
        sum += network.back_propagate(sample.input, sample.output, |e| huber(e, threshold), gradient);
    }
    let count = samples.len().max(1) as f64;
    for slope in gradient.iter_mut() {
        *slope /= count;
    }
    sum / count
}

/// One step of standard back-propagation on one sample: w ← w − η ∂E/∂w (paper, section 3: "every new
/// learning sample is used to adjust the weights"). Allocates nothing.
pub fn online_step(network: &mut Network, sample: &Sample, eta: f64, threshold: Option<f64>) {
    let mut gradient = [0.0; WEIGHTS];
    network.back_propagate(sample.input, sample.output, |e| huber(e, threshold), &mut gradient);
    let mut weights = network.weights();
    for (weight, slope) in weights.iter_mut().zip(&gradient) {
        *weight -= eta * slope;
    }
    network.set_weights(&weights);
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    fn random_samples(rng: &mut ChaCha8Rng, count: usize) -> Vec<Sample> {
        let mut number = |spread: f64| rng.random_range(-spread..spread);
        (0..count)
            .map(|_| Sample {
                input: [number(1.5), number(1.5), number(1.0)],
                output: [number(1.0), number(1.0)],
                ..Sample::default()
            })
            .collect()
    }

    const THRESHOLD: f64 = 0.05;

    /// The second derivative jumps at the threshold: differences across it say nothing about the first.
    fn off_the_kink(network: &Network, sample: &Sample) -> bool {
        let output = network.predict(sample.input);
        let residual = (output[0] - sample.output[0]).hypot(output[1] - sample.output[1]);
        (residual - THRESHOLD).abs() > 0.005
    }

    /// Central differences with Richardson's extrapolation: error of the order of step⁴.
    fn difference(value: impl Fn(f64) -> f64) -> f64 {
        let central = |step: f64| (value(step) - value(-step)) / (2.0 * step);
        (4.0 * central(1e-4) - central(2e-4)) / 3.0
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        #[test]
        fn the_gradient_is_the_derivative_of_the_error(seed: u64, anchored: bool, robust: bool) {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            let network = Network::random(&mut rng, anchored);
            let mut samples = random_samples(&mut rng, 20);
            samples.retain(|sample| off_the_kink(&network, sample));
            let threshold = robust.then_some(THRESHOLD);
            let mut gradient = [0.0; WEIGHTS];
            let error = mean_error_and_gradient(&network, &samples, threshold, &mut gradient);
            prop_assert!((error - mean_error(&network, &samples, threshold)).abs() < 1e-15);
            let largest = gradient.iter().fold(0.0f64, |m, g| m.max(g.abs()));
            for index in 0..WEIGHTS {
                let numeric = difference(|step| {
                    let mut weights = network.weights();
                    weights[index] += step;
                    mean_error(&Network::from_weights(&weights, anchored), &samples, threshold)
                });
                prop_assert!((gradient[index] - numeric).abs() < 1e-8 * largest, "{index}: {} {numeric}", gradient[index]);
            }
        }
    }

    #[test]
    fn a_wild_residual_pulls_no_harder_than_one_at_the_threshold() {
        let (_, slope) = huber([3.0, 4.0], Some(0.05));
        assert!((slope[0] - 0.03).abs() < 1e-15 && (slope[1] - 0.04).abs() < 1e-15);
        assert_eq!(huber([3.0, 4.0], None), (12.5, [3.0, 4.0]));
    }

    #[test]
    fn an_online_step_reduces_the_error_of_its_sample() {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let mut network = Network::random(&mut rng, true);
        let samples = random_samples(&mut rng, 1);
        let before = mean_error(&network, &samples, None);
        online_step(&mut network, &samples[0], 0.1, None);
        assert!(mean_error(&network, &samples, None) < before);
    }
}
