//! Where the person who helps in training puts the blob: in view, within reach, not under the camera.

use pursuit_kinematics::{Coupling, Rig};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Share of the half image within which a blob is put, so that no part of it is cut off.
const SHARE_OF_VIEW: f64 = 0.9;
/// Least distance from under the camera, m: a shorter move teaches little.
const MIN_DISTANCE_M: f64 = 0.10;
/// Tries before the last place is taken as it is.
const TRIES: usize = 1000;

/// The place of training target number `index`, m on the table: a function of the seed, the number and
/// the pose (joints 1 and 2, rad) from which it must be seen.
pub fn place_blob(rig: &Rig, theta_rad: [f64; 2], seed: u64, index: u32) -> [f64; 2] {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    random.set_stream(u64::from(index) + 1);
    let half = [rig.camera().width, rig.camera().height].map(|side| f64::from(side) / 2.0);
    let under = rig.camera_xy(theta_rad);
    let mut place = under;
    let Some(joints) = rig.coupling().joints(theta_rad[0], theta_rad[1]) else { return place };
    let base_from_camera = rig.base_from_camera(&joints);
    for _ in 0..TRIES {
        let centred = half.map(|half| half * SHARE_OF_VIEW * random.random_range(-1.0..1.0));
        let Some(point) = rig.camera().table_point(&base_from_camera, centred) else { continue };
        place = point;
        let far = (point[0] - under[0]).hypot(point[1] - under[1]) > MIN_DISTANCE_M;
        if far && rig.reachable(point) {
            break;
        }
    }
    place
}

/// The pose from which a run starts: joints 1 and 2, rad, well inside the envelope.
pub fn start_pose(coupling: &Coupling, seed: u64) -> [f64; 2] {
    const MARGIN_RAD: f64 = 0.1;
    const SIDEWAYS_RAD: f64 = 0.5;
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let envelope = coupling.envelope();
    [
        random.random_range(-SIDEWAYS_RAD..SIDEWAYS_RAD),
        random.random_range(envelope.theta2_rad[0] + MARGIN_RAD..envelope.theta2_rad[1] - MARGIN_RAD),
    ]
}
