//! How good the learnt map is, against the exact one that only the simulator knows.

use pursuit_kinematics::Rig;
use pursuit_learning::{GridCase, GridError, Network, Normalisation, evaluate_grid};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Cases of the evaluation grid (design notes on the learner, head).
const CASES: usize = 300;
/// The cases are the same for every run and seed.
const GRID_SEED: u64 = 12345;

/// The evaluation grid of one cell: points all over the image, angles all over the envelope, within reach.
pub struct Evaluation {
    rig: Rig,
    cases: Vec<GridCase>,
    normalisation: Normalisation,
}

impl Evaluation {
    /// The grid for this arm and camera.
    pub fn new(rig: &Rig, normalisation: Normalisation) -> Evaluation {
        let mut random = ChaCha8Rng::seed_from_u64(GRID_SEED);
        let [low, high] = rig.coupling().envelope().theta2_rad;
        let half = [rig.camera().width, rig.camera().height].map(|side| f64::from(side) / 2.0);
        let mut cases = Vec::with_capacity(CASES);
        while cases.len() < CASES {
            let theta2 = random.random_range(low..high);
            let point_px = half.map(|half| half * random.random_range(-1.0..1.0));
            let Some(answer) = rig.exact_move(point_px, theta2) else { continue };
            if (low..=high).contains(&(theta2 + answer[1])) {
                cases.push(GridCase { point_px, theta2 });
            }
        }
        Evaluation { rig: *rig, cases, normalisation }
    }

    /// Distance that one single move of the network leaves between the camera's axis and the target, cm.
    /// `None` where the weights are no network.
    pub fn one_shot_cm(&self, weights: &[f64]) -> Option<GridError> {
        let network = Network::import(weights)?;
        let error_after = |case: &GridCase, command: [f64; 2]| {
            let Some(exact) = self.rig.exact_move(case.point_px, case.theta2) else {
                return f64::INFINITY;
            };
            // A command goes no further than the envelope, here as in the learner.
            let reached = self.rig.coupling().envelope().clamp([command[0], case.theta2 + command[1]]);
            let reached = self.rig.camera_xy(reached);
            let wanted = self.rig.camera_xy([exact[0], case.theta2 + exact[1]]);
            100.0 * (reached[0] - wanted[0]).hypot(reached[1] - wanted[1])
        };
        Some(evaluate_grid(&network, &self.normalisation, &self.cases, error_after))
    }
}
