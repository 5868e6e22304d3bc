//! The batch refit: a job that can be sent to another thread, and its result.

use serde::{Deserialize, Serialize};

use crate::batch::Batch;
use crate::conjugate_gradient::{CURVATURE, Descent, Stop};
use crate::levenberg_marquardt::Damped;
use crate::network::{Network, WEIGHTS};
use crate::samples::Sample;
use crate::scaled_conjugate_gradient::Scaled;
use crate::settings::Method;

/// Everything that a refit needs. The same job gives the same result, bit for bit, on any thread.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RefitJob {
    /// Running number, from 1: a result is merged only into the state that waits for this number.
    pub number: u64,
    /// Weights to start from.
    pub network: Network,
    /// Other weights to start from, after a change of the world: see [`FRESH_SHARE`].
    pub fresh: Option<Network>,
    /// Samples to fit.
    pub samples: Vec<Sample>,
    /// See [`Settings::huber`](crate::Settings::huber).
    pub huber: Option<f64>,
    /// See [`Settings::method`](crate::Settings::method).
    pub method: Method,
    /// See [`Settings::iterations`](crate::Settings::iterations).
    pub iterations: u32,
}

/// What a refit came to.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RefitResult {
    /// Number of the job.
    pub number: u64,
    /// The fitted weights: the start weights where nothing better was found.
    pub network: Network,
    /// Mean error over the job's samples before and after.
    pub error: [f64; 2],
    /// Iterations done.
    pub iterations: u32,
    /// Evaluations of error and gradient.
    pub evaluations: u32,
    /// Why it ended.
    pub stop: Stop,
}

/// Where a descent came to.
struct Fit {
    weights: [f64; WEIGHTS],
    error: [f64; 2],
    ended: (Stop, u32),
    evaluations: u32,
}

/// A fit from fresh weights is preferred where it leaves less than this share of the error that the fit
/// from the old ones leaves (design notes on the learner, section 4).
const FRESH_SHARE: f64 = 0.5;

/// Fits the job's network to its samples, a few milliseconds for 100 of them. `keep_going` is asked before
/// each iteration; what has been reached when it says no is the result. Iterations allocate nothing.
pub fn refit(job: &RefitJob, keep_going: impl Fn() -> bool) -> RefitResult {
    let anchored = job.network.anchored();
    let mut batch = Batch::new(&job.samples, job.huber, anchored);
    let mut fit = fit_from(&job.network, &mut batch, job, &keep_going);
    if let Some(fresh) = &job.fresh {
        let other = fit_from(fresh, &mut batch, job, &keep_going);
        if other.error[1] < FRESH_SHARE * fit.error[1] {
            fit = Fit { error: [fit.error[0], other.error[1]], ..other };
        }
    }
    RefitResult {
        number: job.number,
        network: Network::from_weights(&fit.weights, anchored),
        error: fit.error,
        iterations: fit.ended.1,
        evaluations: fit.evaluations,
        stop: fit.ended.0,
    }
}

fn fit_from(start: &Network, batch: &mut Batch, job: &RefitJob, keep_going: impl Fn() -> bool) -> Fit {
    let start = start.weights();
    match job.method {
        Method::ConjugateGradient => {
            let mut objective = |weights: &_, gradient: &mut _| batch.error_and_gradient(weights, gradient);
            let mut descent = Descent::new(&mut objective, start, CURVATURE);
            let before = descent.value();
            let ended = descent.run(&mut objective, job.iterations, keep_going);
            let error = [before, descent.value()];
            Fit { weights: *descent.point(), error, ended, evaluations: descent.evaluations() }
        }
        Method::ScaledConjugateGradient => {
            let mut objective = |weights: &_, gradient: &mut _| batch.error_and_gradient(weights, gradient);
            let mut descent = Scaled::new(&mut objective, start);
            let before = descent.value();
            let ended = descent.run(&mut objective, job.iterations, keep_going);
            let error = [before, descent.value()];
            Fit { weights: *descent.point(), error, ended, evaluations: descent.evaluations() }
        }
        Method::LevenbergMarquardt => {
            let mut descent = Damped::new(batch, start, Method::MARQUARDT_RIDGE);
            let before = descent.value();
            let iterations = job.iterations.min(Method::MARQUARDT_ITERATIONS);
            let ended = descent.run(batch, iterations, keep_going);
            let error = [before, descent.value()];
            Fit { weights: *descent.point(), error, ended, evaluations: descent.evaluations() }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    pub(super) const METHODS: [Method; 3] =
        [Method::ConjugateGradient, Method::ScaledConjugateGradient, Method::LevenbergMarquardt];

    /// Samples of another network of the same kind, so that a fit exists.
    fn job(method: Method) -> RefitJob {
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        let teacher = Network::random(&mut rng, true);
        let samples = (1..=100)
            .map(|sequence| {
                let input = [1.0; 3].map(|spread: f64| rng.random_range(-spread..spread));
                Sample { input, output: teacher.predict(input), sequence, ..Sample::default() }
            })
            .collect();
        let network = Network::random(&mut rng, true);
        RefitJob { number: 3, network, fresh: None, samples, huber: Some(0.05), method, iterations: 60 }
    }

    #[test]
    fn every_method_fits_what_another_network_teaches() {
        for method in METHODS {
            let result = refit(&job(method), || true);
            assert!(result.error[1] < 2e-3 * result.error[0], "{method:?}: {result:?}");
            assert!(result.network.is_sound());
        }
    }

    #[test]
    fn a_sample_that_is_not_a_number_leaves_the_start_weights_with_every_method() {
        for method in METHODS {
            let mut job = job(method);
            job.samples[40].output[1] = f64::NAN;
            let result = refit(&job, || true);
            assert_eq!(result.network, job.network, "{method:?}");
        }
    }

    #[test]
    fn every_method_can_be_called_off_between_iterations() {
        for method in METHODS {
            let asked = std::cell::Cell::new(0);
            let result = refit(&job(method), || {
                asked.set(asked.get() + 1);
                asked.get() <= 3
            });
            assert_eq!((result.stop, result.iterations), (Stop::Cancelled, 3), "{method:?}");
            assert!(result.error[1] < result.error[0]);
        }
    }
}
