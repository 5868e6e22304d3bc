//! How far the joints' clock is ahead of the camera's.
//!
//! An image that was really taken τ after the time that it bears belongs to the joints of τ later. With joints
//! off by 20 ms nothing is learnt better than to 1 cm (design notes on the learner, section 3). It shows: the
//! map foretells the motion between two images, N(p) = Δθ(τ) = Δθ + τ (θ̇_j − θ̇_i), so the error of the map
//! goes with the change of joint velocity. What else is wrong with the map does not: over a whole move from
//! rest to rest an error in proportion to the motion adds up to Σ Δθ · dΔθ/dt = 0. (Not in the paper.)

use serde::{Deserialize, Serialize};

use crate::consensus::Sighting;
use crate::network::Network;
use crate::samples::{Normalisation, displacement_px};

/// Views that are remembered: 0.16 s at 100 Hz.
const REMEMBERED: usize = 16;
/// A view is compared with the newest that is at least so much older, ns...
const LAG_NS: u64 = 110_000_000;
/// ...and at most so much.
const MAX_LAG_NS: u64 = 400_000_000;
/// An error larger than this is not one of time, rad.
const MAX_ERROR_RAD: f64 = 0.1;
/// Evidence (sum of squared changes of velocity, rad²/s²) from which the estimate is corrected.
const ENOUGH: f64 = 4.0;
/// Share of what was found that is made up for at once: the map has learnt part of the error.
const GAIN: f64 = 0.7;
/// The estimate stays within this, s.
const MAX_OFFSET_S: f64 = 0.06;

/// Estimates τ from views of one still thing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ClockOffset {
    estimate_s: f64,
    /// Σ error · change of velocity, and Σ (change of velocity)², since the last correction.
    product: f64,
    square: f64,
    recent: [Sighting; REMEMBERED],
    count: usize,
}

impl ClockOffset {
    /// τ, s: add τ times the joint velocity to the joints that a stamp's time names.
    pub fn seconds(&self) -> f64 {
        self.estimate_s
    }

    /// Another thing is looked at: no pair spans the two.
    pub fn restart(&mut self) {
        self.count = 0;
    }

    /// Takes a view of a still thing, its joints with the estimate already made up for; the map is `network`, the sense of the image's turn
    /// `rotation_sign` (see [`displacement_px`]).
    pub fn observe(
        &mut self,
        seen: Sighting,
        network: &Network,
        normalisation: &Normalisation,
        rotation_sign: f64,
    ) {
        let age = |older: &Sighting| seen.time_ns.saturating_sub(older.time_ns);
        let partner = self.recent[..self.count].iter().rev().find(|older| age(older) >= LAG_NS);
        if let Some(older) = partner.filter(|older| age(older) <= MAX_LAG_NS) {
            let p = displacement_px(&older.view, &seen.view, rotation_sign);
            let input = normalisation.input(p, older.view.joints[1]);
            let foretold = normalisation.displacement(network.predict(input));
            for (joint, foretold) in foretold.into_iter().enumerate() {
                let error = foretold - (seen.view.joints[joint] - older.view.joints[joint]);
                let change = seen.view.velocities[joint] - older.view.velocities[joint];
                if error.abs() < MAX_ERROR_RAD {
                    self.product += error * change;
                    self.square += change * change;
                }
            }
        }
        if self.count == REMEMBERED {
            self.recent.rotate_left(1);
            self.count -= 1;
        }
        self.recent[self.count] = seen;
        self.count += 1;
    }

    /// A move or a lesson is over: corrects the estimate where there is evidence enough, and says by how
    /// much, s.
    pub fn settle(&mut self) -> f64 {
        self.restart();
        if self.square < ENOUGH {
            return 0.0;
        }
        let found = GAIN * self.product / self.square;
        (self.product, self.square) = (0.0, 0.0);
        let before = self.estimate_s;
        self.estimate_s = (before + found).clamp(-MAX_OFFSET_S, MAX_OFFSET_S);
        self.estimate_s - before
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::View;
    use pursuit_kinematics::{Arm, Camera, Coupling};
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    const NORMALISATION: Normalisation = Normalisation { half_width_px: 256.0 };
    const FRAME_NS: u64 = 40_000_000;

    /// From rest to rest, smoothly, in 24 frames, there or back: joints and their velocities.
    fn motion(seconds: f64, back: bool) -> ([f64; 2], [f64; 2]) {
        let whole = 24.0 * 0.04;
        let s = (seconds / whole).clamp(0.0, 1.0);
        let way = s * s * (3.0 - 2.0 * s);
        let speed = if (0.0..=whole).contains(&seconds) { 6.0 * s * (1.0 - s) / whole } else { 0.0 };
        let (way, speed) = if back { (1.0 - way, -speed) } else { (way, speed) };
        ([0.1 + 0.5 * way, 0.6 - 0.2 * way], [0.5 * speed, -0.2 * speed])
    }

    /// A map that is right about this arm where it is asked, taught by the exact model.
    fn taught(coupling: &Coupling, camera: &Camera) -> Network {
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        let mut samples = Vec::new();
        for k in 0..400u32 {
            let at = |step: u32, spread: f64| spread * (f64::from((k * step) % 41) / 20.0 - 1.0);
            let (point, theta2) = ([at(7, 150.0), at(13, 150.0)], 0.55 + at(3, 0.15));
            if let Some(displacement) = pursuit_kinematics::exact_move(coupling, camera, point, theta2) {
                samples.push(crate::Sample {
                    input: NORMALISATION.input(point, theta2),
                    output: NORMALISATION.output(displacement),
                    ..crate::Sample::default()
                });
            }
        }
        let job = crate::RefitJob {
            number: 1,
            network: Network::random(&mut rng, true),
            fresh: None,
            samples,
            huber: None,
            method: crate::Method::ConjugateGradient,
            iterations: 600,
        };
        crate::refit(&job, || true).network
    }

    #[test]
    fn an_image_taken_later_or_earlier_than_its_stamp_is_found_out() {
        let coupling = Coupling::new(&Arm::puma_like(), 0.5).unwrap();
        let camera = Camera::default_cell();
        let network = taught(&coupling, &camera);
        let target = coupling.camera_xy(0.35, 0.5);
        for tau in [0.02, -0.02, 0.0_f64] {
            let mut offset = ClockOffset::default();
            // What is wrong with the map itself has the other sign on the way back.
            for turn in 0..16 {
                let back = turn % 2 == 1;
                for frame in 0..34u64 {
                    let stamp_s = frame as f64 * 0.04 - 0.2;
                    let (truth, _) = motion(stamp_s + tau, back);
                    let all = coupling.joints(truth[0], truth[1]).unwrap();
                    let pose = coupling.arm().base_from_camera(&all, 0.0);
                    let point_px = camera.project(&pose, [target[0], target[1], 0.0]).unwrap();
                    let (read, velocities) = motion(stamp_s, back);
                    let joints = [0, 1].map(|k| read[k] + offset.seconds() * velocities[k]);
                    let view = View { point_px, joints, velocities };
                    let seen = Sighting { time_ns: frame * FRAME_NS, view };
                    offset.observe(seen, &network, &NORMALISATION, -1.0);
                }
                offset.settle();
            }
            assert!((offset.seconds() - tau).abs() < 3e-3, "{} for {tau}", offset.seconds());
        }
    }
}
