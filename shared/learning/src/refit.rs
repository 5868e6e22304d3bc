//! The batch refit: a job that can be sent to another thread, and its result.

use serde::{Deserialize, Serialize};

use crate::batch::Batch;
use crate::conjugate_gradient::{CURVATURE, Descent, Stop};
use crate::network::Network;
use crate::samples::Sample;

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

/// A fit from fresh weights is preferred where it leaves less than this share of the error that the fit
/// from the old ones leaves (design notes on the learner, section 4).
const FRESH_SHARE: f64 = 0.5;

/// Fits the job's network to its samples, some milliseconds for 100 of them. `keep_going` is asked before each
/// iteration; what has been reached when it says no is the result.
pub fn refit(job: &RefitJob, keep_going: impl Fn() -> bool) -> RefitResult {
    let batch = Batch::new(&job.samples, job.huber, job.network.anchored());
    let result = refit_from(&job.network, &batch, job, &keep_going);
    match job.fresh.as_ref().map(|fresh| refit_from(fresh, &batch, job, &keep_going)) {
        Some(fresh) if fresh.error[1] < FRESH_SHARE * result.error[1] => {
            RefitResult { error: [result.error[0], fresh.error[1]], ..fresh }
        }
        _ => result,
    }
}

fn refit_from(start: &Network, batch: &Batch, job: &RefitJob, keep_going: impl Fn() -> bool) -> RefitResult {
    let anchored = start.anchored();
    let mut objective = |weights: &_, gradient: &mut _| batch.error_and_gradient(weights, gradient);
    let mut descent = Descent::new(&mut objective, start.weights(), CURVATURE);
    let before = descent.value();
    let (stop, iterations) = descent.run(&mut objective, job.iterations, keep_going);
    RefitResult {
        number: job.number,
        network: Network::from_weights(descent.point(), anchored),
        error: [before, descent.value()],
        iterations,
        evaluations: descent.evaluations(),
        stop,
    }
}
