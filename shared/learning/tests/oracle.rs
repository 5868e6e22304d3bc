//! Our conjugate gradients against another library's (argmin), from the same start on real rings of samples.

#![allow(clippy::unwrap_used)]

mod support;

use argmin::core::{CostFunction, Error, Executor, Gradient};
use argmin::solver::conjugategradient::NonlinearConjugateGradient;
use argmin::solver::conjugategradient::beta::PolakRibierePlus;
use argmin::solver::linesearch::MoreThuenteLineSearch;
use pursuit_learning::{Batch, RefitJob, Settings, WEIGHTS, refit};
use support::job_after;

/// Both are stopped long before the minimum, on ways that part early: over the rings, the median ratio of the
/// values that they reach is this near to 1...
const MEDIAN_RATIO: f64 = 1.25;
/// ...and no single one is farther off.
const WORST_RATIO: f64 = 3.0;

struct Problem(Batch);

impl Problem {
    fn of(job: &RefitJob) -> Problem {
        Problem(Batch::new(&job.samples, job.huber, job.network.anchored()))
    }

    fn evaluate(&self, weights: &[f64]) -> (f64, [f64; WEIGHTS]) {
        let mut gradient = [0.0; WEIGHTS];
        let value = self.0.error_and_gradient(weights.try_into().unwrap(), &mut gradient);
        (value, gradient)
    }
}

impl CostFunction for Problem {
    type Param = Vec<f64>;
    type Output = f64;

    fn cost(&self, weights: &Vec<f64>) -> Result<f64, Error> {
        Ok(self.evaluate(weights).0)
    }
}

impl Gradient for Problem {
    type Param = Vec<f64>;
    type Gradient = Vec<f64>;

    fn gradient(&self, weights: &Vec<f64>) -> Result<Vec<f64>, Error> {
        Ok(self.evaluate(weights).1.to_vec())
    }
}

fn argmins_value(job: &RefitJob) -> f64 {
    let line_search = MoreThuenteLineSearch::new().with_c(1e-4, 0.1).unwrap();
    let solver = NonlinearConjugateGradient::new(line_search, PolakRibierePlus::new())
        .restart_iters(WEIGHTS as u64)
        .restart_orthogonality(0.2);
    let start = job.network.weights().to_vec();
    let iterations = u64::from(job.iterations);
    let run = Executor::new(Problem::of(job), solver)
        .configure(|state| state.param(start).max_iters(iterations))
        .run()
        .unwrap();
    run.state().get_best_cost()
}

#[test]
fn our_conjugate_gradients_get_as_low_as_argmins() {
    let mut ratios: Vec<f64> = (1..=12)
        .map(|seed| {
            let job =
                RefitJob { iterations: 60, ..job_after(3 + seed as u32, seed, &Settings::recommended()) };
            refit(&job, || true).error[1] / argmins_value(&job)
        })
        .collect();
    ratios.sort_by(f64::total_cmp);
    let median = ratios[ratios.len() / 2];
    assert!((1.0 / MEDIAN_RATIO..MEDIAN_RATIO).contains(&median), "{ratios:?}");
    assert!(ratios.iter().all(|ratio| (1.0 / WORST_RATIO..WORST_RATIO).contains(ratio)), "{ratios:?}");
}
