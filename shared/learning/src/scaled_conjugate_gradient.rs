//! Minimisation by scaled conjugate gradients (M. Møller, "A scaled conjugate gradient algorithm for fast
//! supervised learning", Neural Networks 6, 1993): the step's length comes from a difference of gradients
//! and a trust region, no line is searched.
//!
//! Symbols of that paper: w [`point`](Scaled::point), E its value, r −gradient, p the direction, λ the scale
//! of the trust region, δ the curvature along p. Deviations: λ̄ is folded into λ (what is added to δ is the
//! difference of both), and a value that is not finite counts as a step that failed.

use crate::conjugate_gradient::{Limits, Stop};
use crate::line_search::dot;

/// Møller's σ: length over which the gradient is differenced.
const SIGMA: f64 = 1e-4;
/// Møller's λ₁.
const FIRST_SCALE: f64 = 1e-6;
/// A trust region narrower than this is of no use.
const MAX_SCALE: f64 = 1e15;

/// A descent under way, on a function of N variables.
#[derive(Clone, Debug)]
pub struct Scaled<const N: usize> {
    point: [f64; N],
    value: f64,
    /// r, −gradient.
    downhill: [f64; N],
    direction: [f64; N],
    scale: f64,
    since_restart: usize,
    evaluations: u32,
}

impl<const N: usize> Scaled<N> {
    /// A descent from `start`. `objective` writes the gradient at a point and returns the value there.
    pub fn new(objective: &mut impl FnMut(&[f64; N], &mut [f64; N]) -> f64, start: [f64; N]) -> Scaled<N> {
        let mut gradient = [0.0; N];
        let value = objective(&start, &mut gradient);
        let downhill = gradient.map(|slope| -slope);
        Scaled {
            point: start,
            value,
            downhill,
            direction: downhill,
            scale: FIRST_SCALE,
            since_restart: 0,
            evaluations: 1,
        }
    }

    /// The lowest point so far.
    pub fn point(&self) -> &[f64; N] {
        &self.point
    }

    /// The value at [`Scaled::point`].
    pub fn value(&self) -> f64 {
        self.value
    }

    /// How often the objective was evaluated.
    pub fn evaluations(&self) -> u32 {
        self.evaluations
    }

    /// One iteration: a step, in a trust region that is narrowed until the step leads down. The value never
    /// rises. `false`: there is no lower point to be found from here.
    pub fn iterate(&mut self, objective: &mut impl FnMut(&[f64; N], &mut [f64; N]) -> f64) -> bool {
        if !self.value.is_finite() {
            return false;
        }
        let mut slope = dot(&self.direction, &self.downhill);
        if slope <= 0.0 || self.since_restart >= N {
            self.restart();
            slope = dot(&self.direction, &self.downhill);
        }
        let square = dot(&self.direction, &self.direction);
        if square <= 0.0 || !square.is_finite() {
            return false;
        }
        let bend = self.curvature(objective, square.sqrt());
        while self.scale < MAX_SCALE {
            let mut curvature = bend + self.scale * square;
            if curvature <= 0.0 {
                // Møller's step 4: a curvature that is not positive is made so.
                let scale = 2.0 * (self.scale - curvature / square);
                curvature = -curvature + self.scale * square;
                self.scale = scale;
            }
            let step = slope / curvature;
            let trial: [f64; N] = std::array::from_fn(|i| self.point[i] + step * self.direction[i]);
            let mut gradient = [0.0; N];
            let value = objective(&trial, &mut gradient);
            self.evaluations += 1;
            // Δ: the decrease as a share of what the quadratic promises.
            let comparison = 2.0 * curvature * (self.value - value) / (slope * slope);
            let comparison = if comparison.is_finite() { comparison } else { -1.0 };
            if comparison < 0.25 {
                self.scale += curvature * (1.0 - comparison) / square;
            }
            if comparison > 0.0 {
                if comparison >= 0.75 {
                    self.scale *= 0.25;
                }
                self.accept(trial, value, gradient, slope);
                return true;
            }
        }
        false
    }

    /// Iterates until one of the reasons to stop, with the number of iterations. `keep_going` is asked
    /// before each.
    pub fn run(
        &mut self,
        objective: &mut impl FnMut(&[f64; N], &mut [f64; N]) -> f64,
        max_iterations: u32,
        keep_going: impl Fn() -> bool,
    ) -> (Stop, u32) {
        let mut limits = Limits::default();
        for iteration in 0..max_iterations {
            if let Some(stop) = limits.before(&self.downhill, self.evaluations, &keep_going) {
                return (stop, iteration);
            }
            let before = self.value;
            if !self.iterate(objective) {
                return (Stop::Stuck, iteration);
            }
            if limits.stalled(before, self.value) {
                return (Stop::Stalled, iteration + 1);
            }
        }
        (Stop::Iterations, max_iterations)
    }

    /// δ without its scale: pᵀs, s the difference of gradients along the direction.
    fn curvature(&mut self, objective: &mut impl FnMut(&[f64; N], &mut [f64; N]) -> f64, length: f64) -> f64 {
        let sigma = SIGMA / length;
        let ahead: [f64; N] = std::array::from_fn(|i| self.point[i] + sigma * self.direction[i]);
        let mut gradient = [0.0; N];
        objective(&ahead, &mut gradient);
        self.evaluations += 1;
        let bend = (dot(&gradient, &self.direction) + dot(&self.downhill, &self.direction)) / sigma;
        if bend.is_finite() { bend } else { 0.0 }
    }

    fn accept(&mut self, point: [f64; N], value: f64, gradient: [f64; N], slope: f64) {
        let downhill = gradient.map(|slope| -slope);
        let beta = (dot(&downhill, &downhill) - dot(&downhill, &self.downhill)) / slope;
        for (direction, downhill) in self.direction.iter_mut().zip(&downhill) {
            *direction = downhill + beta * *direction;
        }
        (self.point, self.value, self.downhill) = (point, value, downhill);
        self.since_restart += 1;
    }

    fn restart(&mut self) {
        self.direction = self.downhill;
        self.since_restart = 0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_functions::{Quadratic, rosenbrock};
    use proptest::prelude::*;

    #[test]
    fn a_quadratic_of_n_variables_takes_little_more_than_n_iterations() {
        for seed in 0..8 {
            let quadratic = Quadratic::<20>::random(seed, 50.0);
            let mut objective = |x: &[f64; 20], g: &mut [f64; 20]| quadratic.value(x, g);
            let mut descent = Scaled::new(&mut objective, [0.0; 20]);
            let steepness = |descent: &Scaled<20>| dot(&descent.downhill, &descent.downhill).sqrt();
            let start = steepness(&descent);
            let mut iterations = 0;
            while steepness(&descent) > 1e-6 * start {
                assert!(descent.iterate(&mut objective));
                iterations += 1;
                assert!(iterations <= 30, "{} of {start}", steepness(&descent));
            }
        }
    }

    #[test]
    fn rosenbrocks_valley_is_followed_to_its_end() {
        let mut descent = Scaled::new(&mut rosenbrock, [-1.2, 1.0]);
        for _ in 0..300 {
            descent.iterate(&mut rosenbrock);
        }
        assert!((descent.point()[0] - 1.0).abs() < 1e-5, "{:?}", descent.point());
    }

    proptest! {
        #[test]
        fn the_value_never_rises(x in -3.0..3.0f64, y in -3.0..3.0f64) {
            let mut descent = Scaled::new(&mut rosenbrock, [x, y]);
            for _ in 0..60 {
                let before = descent.value();
                descent.iterate(&mut rosenbrock);
                prop_assert!(descent.value() <= before);
            }
        }
    }

    #[test]
    fn a_start_that_is_not_finite_stays_where_it_is() {
        let mut objective = |_: &[f64; 2], gradient: &mut [f64; 2]| {
            *gradient = [f64::NAN; 2];
            f64::NAN
        };
        let mut descent = Scaled::new(&mut objective, [1.0, 2.0]);
        assert_eq!(descent.run(&mut objective, 60, || true), (Stop::Stuck, 0));
        assert_eq!(descent.point(), &[1.0, 2.0]);
    }

    #[test]
    fn a_cliff_of_numbers_that_are_none_narrows_the_region() {
        let mut cliff = |x: &[f64; 1], gradient: &mut [f64; 1]| {
            *gradient = [if x[0] > 1.0 { f64::NAN } else { 4.0 * (x[0] - 0.9).powi(3) }];
            if x[0] > 1.0 { f64::NAN } else { (x[0] - 0.9).powi(4) }
        };
        let mut descent = Scaled::new(&mut cliff, [-3.0]);
        descent.run(&mut cliff, 100, || true);
        assert!((descent.point()[0] - 0.9).abs() < 0.1, "{:?}", descent.point());
    }

    #[test]
    fn it_can_be_called_off() {
        let mut descent = Scaled::new(&mut rosenbrock, [-1.2, 1.0]);
        assert_eq!(descent.run(&mut rosenbrock, 60, || false), (Stop::Cancelled, 0));
    }
}
