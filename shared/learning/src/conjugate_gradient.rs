//! Minimisation by conjugate gradients (paper, section 3: "these samples are used in a conjugated
//! gradient method").
//!
//! Polak-Ribière with β ≥ 0 and a strong Wolfe line search. The direction is restarted to −gradient when
//! β = 0, when two gradients in a row are far from orthogonal (Powell), after N iterations, and where it
//! does not descend.

use serde::{Deserialize, Serialize};

use crate::line_search::{Line, dot};

/// Wolfe's c2: how flat a step's end must be compared with its start.
pub const CURVATURE: f64 = 0.1;
/// Gradients in a row whose product is at least this share of the newer's square are not conjugate.
const POWELL: f64 = 0.2;
/// Size of the very first step, in units of the weights, at most.
const FIRST_STEP: f64 = 0.5;
/// A step is first tried at most this many times as long as the last.
const MAX_STEP_GROWTH: f64 = 10.0;
/// Largest component of the gradient that still counts as something to descend.
const FLAT: f64 = 1e-7;
/// Relative decrease that counts as none...
const NO_DECREASE: f64 = 1e-5;
/// ...and how many in a row end the descent.
const MAX_STALLS: u32 = 3;
/// Evaluations of the objective after which a descent ends: half more than 250 iterations need.
const MAX_EVALUATIONS: u32 = 800;

/// Why a descent ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Stop {
    /// The permitted number of iterations was done.
    Iterations,
    /// The objective was evaluated as often as is permitted.
    Evaluations,
    /// The gradient vanished.
    Flat,
    /// It did not get better any more.
    Stalled,
    /// No step along −gradient was lower, or the value was not finite at the start.
    Stuck,
    /// The caller called it off.
    Cancelled,
}

/// When a descent of any method ends before its last iteration.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Limits {
    stalls: u32,
}

impl Limits {
    /// A reason not to begin the next iteration. The gradient's sign does not matter.
    pub(crate) fn before(
        &self,
        gradient: &[f64],
        evaluations: u32,
        keep_going: &impl Fn() -> bool,
    ) -> Option<Stop> {
        if gradient.iter().all(|slope| slope.abs() < FLAT) {
            Some(Stop::Flat)
        } else if evaluations >= MAX_EVALUATIONS {
            Some(Stop::Evaluations)
        } else if !keep_going() {
            Some(Stop::Cancelled)
        } else {
            None
        }
    }

    /// Whether an iteration from one value to the other was one too many of those that did not help.
    pub(crate) fn stalled(&mut self, before: f64, after: f64) -> bool {
        self.stalls = if before - after < NO_DECREASE * before.abs() { self.stalls + 1 } else { 0 };
        self.stalls >= MAX_STALLS
    }
}

/// A descent under way, on a function of N variables.
#[derive(Clone, Debug)]
pub struct Descent<const N: usize> {
    point: [f64; N],
    value: f64,
    gradient: [f64; N],
    direction: [f64; N],
    curvature: f64,
    /// Length and initial slope of the last accepted step.
    last_step: Option<(f64, f64)>,
    since_restart: usize,
    evaluations: u32,
}

impl<const N: usize> Descent<N> {
    /// A descent from `start`. `objective` writes the gradient at a point and returns the value there;
    /// `curvature` is Wolfe's c2, [`CURVATURE`] if in doubt, near 0 for an all but exact line search.
    pub fn new(
        objective: &mut impl FnMut(&[f64; N], &mut [f64; N]) -> f64,
        start: [f64; N],
        curvature: f64,
    ) -> Descent<N> {
        let mut gradient = [0.0; N];
        let value = objective(&start, &mut gradient);
        let direction = gradient.map(|slope| -slope);
        Descent {
            point: start,
            value,
            gradient,
            direction,
            curvature,
            last_step: None,
            since_restart: 0,
            evaluations: 1,
        }
    }

    /// The lowest point so far.
    pub fn point(&self) -> &[f64; N] {
        &self.point
    }

    /// The value at [`Descent::point`].
    pub fn value(&self) -> f64 {
        self.value
    }

    /// The gradient at [`Descent::point`].
    pub fn gradient(&self) -> &[f64; N] {
        &self.gradient
    }

    /// How often the objective was evaluated.
    pub fn evaluations(&self) -> u32 {
        self.evaluations
    }

    /// One iteration: a step along the conjugate direction. The value never rises. `false`: there is no
    /// lower point to be found from here.
    pub fn iterate(&mut self, objective: &mut impl FnMut(&[f64; N], &mut [f64; N]) -> f64) -> bool {
        if !self.value.is_finite() {
            return false;
        }
        let mut slope = dot(&self.gradient, &self.direction);
        if self.since_restart >= N || slope >= 0.0 || slope.is_nan() {
            slope = self.restart();
        }
        let line = Line { point: &self.point, direction: &self.direction, value: self.value, slope };
        let (trial, evaluations) = line.search(objective, self.first_trial(slope), self.curvature);
        self.evaluations += evaluations;
        let Some(trial) = trial else {
            let steepest = self.since_restart == 0;
            self.restart();
            return !steepest;
        };
        let beta = polak_ribiere_plus(&trial.gradient, &self.gradient);
        for (direction, slope) in self.direction.iter_mut().zip(&trial.gradient) {
            *direction = beta * *direction - slope;
        }
        self.since_restart = if beta == 0.0 { 0 } else { self.since_restart + 1 };
        self.last_step = Some((trial.step, slope));
        self.point = trial.point;
        self.value = trial.value;
        self.gradient = trial.gradient;
        true
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
            if let Some(stop) = limits.before(&self.gradient, self.evaluations, &keep_going) {
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

    /// The step to try first: as the last one, scaled so that the first-order decrease is the same.
    fn first_trial(&self, slope: f64) -> f64 {
        match self.last_step {
            Some((step, last_slope)) => (step * last_slope / slope).min(MAX_STEP_GROWTH * step),
            None => FIRST_STEP.min(FIRST_STEP / dot(&self.gradient, &self.gradient).sqrt()),
        }
    }

    /// Turns to −gradient and returns the slope along it.
    fn restart(&mut self) -> f64 {
        self.direction = self.gradient.map(|slope| -slope);
        self.since_restart = 0;
        -dot(&self.gradient, &self.gradient)
    }
}

/// β of the next direction; 0 restarts.
fn polak_ribiere_plus<const N: usize>(newer: &[f64; N], older: &[f64; N]) -> f64 {
    let square = dot(newer, newer);
    let product = dot(newer, older);
    if product.abs() >= POWELL * square {
        return 0.0;
    }
    ((square - product) / dot(older, older)).max(0.0)
}

#[cfg(test)]
mod tests;
