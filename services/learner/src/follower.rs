//! Where the target is going, in joint space: a constant-acceleration Kalman filter per joint, a gate
//! against detections that cannot be, and the prediction over the robot's delay (design notes on the learner, section 6).
//!
//! Each measurement is the absolute joint target at the exposure of its frame. The paper has none of
//! this: "no smoothing is carried out", and it names prediction as future work.

use serde::{Deserialize, Serialize};

/// Squared distance of a measurement from its prediction, in standard deviations, above which it is not
/// believed: 3.5 of them.
const GATE: f64 = 12.25;
/// Variances of a fresh filter beside that of its measurement: (rad/s)² and (rad/s²)².
const FRESH: [f64; 2] = [0.02, 0.02];
/// A gap longer than this begins anew, s.
const MAX_GAP_S: f64 = 1.0;

/// What the filter believes of noise.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Noise {
    /// Standard deviation of a measurement, rad.
    pub measurement_rad: f64,
    /// Density of the target's jerk, rad²/s⁵: how fast its acceleration may change.
    pub jerk: f64,
}

/// One joint: position, velocity, acceleration and their covariance.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Axis {
    state: [f64; 3],
    covariance: [[f64; 3]; 3],
}

/// The filter for joints 1 and 2.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Follower {
    axes: [Axis; 2],
    time_ns: u64,
}

impl Follower {
    /// A fresh filter at a measurement (rad) of the frame exposed at `time_ns`.
    pub fn at(measured_rad: [f64; 2], time_ns: u64, noise: &Noise) -> Follower {
        let variance = noise.measurement_rad * noise.measurement_rad;
        let axis = |position: f64| Axis {
            state: [position, 0.0, 0.0],
            covariance: [[variance, 0.0, 0.0], [0.0, FRESH[0], 0.0], [0.0, 0.0, FRESH[1]]],
        };
        Follower { axes: measured_rad.map(axis), time_ns }
    }

    /// Takes a measurement; whether it was believed.
    pub fn take(&mut self, measured_rad: [f64; 2], time_ns: u64, noise: &Noise) -> bool {
        let gap_s = time_ns.saturating_sub(self.time_ns) as f64 * 1e-9;
        if gap_s > MAX_GAP_S {
            *self = Follower::at(measured_rad, time_ns, noise);
            return true;
        }
        for axis in &mut self.axes {
            axis.predict(gap_s, noise.jerk);
        }
        self.time_ns = time_ns;
        let variance = noise.measurement_rad * noise.measurement_rad;
        let distance = |k: usize| {
            let axis = &self.axes[k];
            let off = measured_rad[k] - axis.state[0];
            off * off / (axis.covariance[0][0] + variance)
        };
        if distance(0).max(distance(1)) > GATE {
            return false;
        }
        for (axis, measured) in self.axes.iter_mut().zip(measured_rad) {
            axis.correct(measured, variance);
        }
        true
    }

    /// Positions (rad) and velocities (rad/s) of joints 1 and 2 over the target, predicted for `time_ns`.
    pub fn predicted(&self, time_ns: u64) -> ([f64; 2], [f64; 2]) {
        let ahead_s = time_ns.saturating_sub(self.time_ns) as f64 * 1e-9;
        let of = |axis: &Axis| {
            let [position, velocity, acceleration] = axis.state;
            let then = velocity + acceleration * ahead_s;
            (position + 0.5 * (velocity + then) * ahead_s, then)
        };
        let (first, second) = (of(&self.axes[0]), of(&self.axes[1]));
        ([first.0, second.0], [first.1, second.1])
    }
}

impl Axis {
    /// Constant acceleration over `t` s, driven by white jerk of density `jerk`.
    fn predict(&mut self, t: f64, jerk: f64) {
        let step = [[1.0, t, 0.5 * t * t], [0.0, 1.0, t], [0.0, 0.0, 1.0]];
        let (t2, t3) = (t * t, t * t * t);
        let drive = [
            [t2 * t3 / 20.0, t2 * t2 / 8.0, t3 / 6.0],
            [t2 * t2 / 8.0, t3 / 3.0, t2 / 2.0],
            [t3 / 6.0, t2 / 2.0, t],
        ];
        let old = self.covariance;
        self.state = [0, 1, 2].map(|i| (0..3).map(|k| step[i][k] * self.state[k]).sum());
        let half: [[f64; 3]; 3] =
            [0, 1, 2].map(|i| [0, 1, 2].map(|j| (0..3).map(|k| step[i][k] * old[k][j]).sum()));
        self.covariance = [0, 1, 2].map(|i| {
            [0, 1, 2].map(|j| (0..3).map(|k| half[i][k] * step[j][k]).sum::<f64>() + jerk * drive[i][j])
        });
    }

    fn correct(&mut self, measured: f64, variance: f64) {
        let total = self.covariance[0][0] + variance;
        let gain = [0, 1, 2].map(|i| self.covariance[i][0] / total);
        let off = measured - self.state[0];
        let row = self.covariance[0];
        for ((value, gain), covariances) in self.state.iter_mut().zip(gain).zip(&mut self.covariance) {
            *value += gain * off;
            for (covariance, first) in covariances.iter_mut().zip(row) {
                *covariance -= gain * first;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    const NOISE: Noise = Noise { measurement_rad: 0.03, jerk: 0.01 };
    const FRAME_NS: u64 = 80_000_000;

    /// A target on a slow circle in joint space.
    fn target(time_ns: u64) -> [f64; 2] {
        let phase = 0.5 * time_ns as f64 * 1e-9;
        [0.3 * phase.sin(), 0.6 + 0.3 * phase.cos()]
    }

    #[test]
    fn a_steady_target_is_predicted_without_lag() {
        let mut follower = Follower::at([0.0, 0.5], 0, &NOISE);
        let at = |t: u64| [0.1 * t as f64 * 1e-9, 0.5];
        for k in 1..100 {
            assert!(follower.take(at(k * FRAME_NS), k * FRAME_NS, &NOISE));
        }
        let later = 99 * FRAME_NS + 110_000_000;
        let (position, velocity) = follower.predicted(later);
        assert!((position[0] - at(later)[0]).abs() < 1e-4, "{position:?}");
        assert!((velocity[0] - 0.1).abs() < 1e-3 && velocity[1].abs() < 1e-6);
    }

    #[test]
    fn noise_is_smoothed_and_wild_measurements_are_not_believed() {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(7);
        let mut follower = Follower::at(target(0), 0, &NOISE);
        let (mut sum, mut believed_wild, mut wild) = (0.0, 0, 0);
        for k in 1..1000_u64 {
            let time_ns = k * FRAME_NS;
            let truth = target(time_ns);
            if k > 20 && random.random_range(0.0..1.0) < 0.15 {
                wild += 1;
                let side = if wild % 2 == 0 { 1.0 } else { -1.0 };
                believed_wild +=
                    u32::from(follower.take([truth[0] + 0.5 * side, truth[1] - 0.3], time_ns, &NOISE));
                continue;
            }
            // Uniform noise of standard deviation 0.03.
            let noisy = truth.map(|axis| axis + random.random_range(-0.052..0.052));
            follower.take(noisy, time_ns, &NOISE);
            let ahead = time_ns + 110_000_000;
            sum += (follower.predicted(ahead).0[0] - target(ahead)[0]).powi(2);
        }
        let rms = (sum / 1000.0_f64).sqrt();
        assert!(wild > 100 && believed_wild == 0, "{believed_wild} of {wild} believed");
        assert!(rms < 0.02, "predicted {rms} rad off, the measurements are 0.03");
    }

    #[test]
    fn a_long_gap_begins_anew() {
        let mut follower = Follower::at([0.0, 0.5], 0, &NOISE);
        assert!(follower.take([0.8, 0.5], 2_000_000_000, &NOISE));
        assert_eq!(follower.predicted(2_000_000_000).0, [0.8, 0.5]);
    }
}
