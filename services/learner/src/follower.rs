//! Where the target is going: three motions that it may be in, weighed by how well they explain what is
//! seen (an interacting multiple model, Blom and Bar-Shalom 1988), and the prediction over the robot's
//! delay (design notes on the learner, section 6, which leave the mixture open).
//!
//! Positions are those of the table chart (see [`Chart`](crate::chart::Chart)), in px: there a target that
//! drives straight on drives straight on, and noise is the same in all directions. In joint space neither
//! holds: where the arm is stretched 1 px of the image is three times the joint angle that it is elsewhere.
//! The paper has none of this: "no smoothing is carried out", and it names prediction as future work.

use serde::{Deserialize, Serialize};

/// Squared distance of a measurement from where it was expected, in variances, above which it is not
/// believed.
const GATE: f64 = 64.0;
/// A gap longer than this begins anew, s.
const MAX_GAP_S: f64 = 1.0;
/// Standard deviations of a fresh filter's velocity, px/s, and acceleration, px/s²: a vehicle of 0.2 m/s in
/// the default cell, on a circle of 0.2 m.
const FRESH: [f64; 2] = [100.0, 100.0];
/// Range of the measured noise of a detection, px.
const NOISE_RANGE_PX: [f64; 2] = [0.7, 8.0];
/// Detections nearer to each other than this, s, have one error in common: they are of pairs of frames that
/// overlap, and of a target that shows the same side. Noise is measured on detections so far apart, and each
/// of several within that time tells its share.
const ALIKE_S: f64 = 0.04;
/// Frames do not come to the nanosecond.
const NEARLY: f64 = 0.9;
/// Time over which the noise of detections is measured, s.
const NOISE_MEMORY_S: f64 = 4.0;
/// A target of which a part is not seen is not where its seen part is: standard deviation for what is
/// missing of the area, in roots of the whole area.
const MISSING: f64 = 0.1;
/// Time over which the whole area is remembered, s.
const AREA_MEMORY_S: f64 = 5.0;
/// Sum of the squared weights of a third difference (1, -3, 3, -1).
const THIRD_DIFFERENCE: f64 = 20.0;
/// A third difference counts for no more than so many times the variance that is expected of it.
const OUTLIER: f64 = 6.0;
/// A motion never becomes less likely than this: it could not come back.
const LEAST_WEIGHT: f64 = 1e-6;

/// An unseen target goes on for so long as it went, s, less and less: what stands still is not seen moving,
/// and an arm that ran on would lose it.
const COAST_S: f64 = 0.2;

/// How many motions there are.
const MODES: usize = 3;

type Matrix = [[f64; 3]; 3];

/// One way of moving.
#[derive(Clone, Copy, Debug)]
enum Mode {
    /// Constant velocity, disturbed by white acceleration of this density, px²/s³.
    Velocity(f64),
    /// Constant acceleration, disturbed by white jerk of this density, px²/s⁵.
    Acceleration(f64),
}

/// Straight on or round a long bend; into and out of bends; and sharply turning, starting or stopping, where
/// the acceleration of before says nothing of the one to come.
const MOTIONS: [Mode; MODES] =
    [Mode::Acceleration(100.0), Mode::Acceleration(3000.0), Mode::Velocity(2000.0)];
/// How long a motion lasts, s.
const LASTS_S: [f64; MODES] = [2.0, 2.0, 0.15];
/// What follows it when it ends.
const NEXT: [[f64; MODES]; MODES] = [[0.0, 0.9, 0.1], [0.9, 0.0, 0.1], [0.5, 0.5, 0.0]];
/// What a constant velocity says of acceleration, standard deviation, px/s²: what it may be once it is no
/// longer constant.
const ACCELERATION_SD: f64 = 60.0;

/// The target as one of the motions sees it: position, velocity and acceleration of both axes, their
/// common covariance, and the probability of this motion.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Belief {
    state: [[f64; 3]; 2],
    covariance: Matrix,
    weight: f64,
}

/// The filter.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Follower {
    beliefs: [Belief; MODES],
    time_ns: u64,
    noise: Noise,
}

/// The noise of detections as it is measured: the third difference of positions in a row is blind to
/// everything smooth, so that what is left of it is noise.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Noise {
    variance_px2: f64,
    /// What detections say of themselves on average, px².
    claimed_px2: f64,
    /// The largest visible area of late, px².
    whole_px2: f64,
    /// Detections at least nearly [`ALIKE_S`] apart, the newest first.
    last: [[f64; 2]; 3],
    /// Time since the newest of them, s.
    passed_s: f64,
    count: u32,
}

/// One detection on the chart.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sighting {
    /// Where, px.
    pub point_px: [f64; 2],
    /// When, ns.
    pub time_ns: u64,
    /// What it says of its own variance in each direction, px²; only its changes count. > 0.
    pub claimed_px2: f64,
    /// Visible area, px²; 0 where it is not known.
    pub area_px2: f64,
}

impl Follower {
    /// A fresh filter at a sighting; `variance_px2` is that of a detection until it has been measured.
    pub fn at(sighting: &Sighting, variance_px2: f64) -> Follower {
        let axis = |position: f64| [position, 0.0, 0.0];
        let belief = Belief {
            state: sighting.point_px.map(axis),
            covariance: [
                [variance_px2, 0.0, 0.0],
                [0.0, FRESH[0] * FRESH[0], 0.0],
                [0.0, 0.0, FRESH[1] * FRESH[1]],
            ],
            weight: 1.0 / MODES as f64,
        };
        Follower {
            beliefs: [belief; MODES],
            time_ns: sighting.time_ns,
            noise: Noise {
                variance_px2,
                claimed_px2: sighting.claimed_px2,
                whole_px2: sighting.area_px2,
                last: [sighting.point_px; 3],
                passed_s: 0.0,
                count: 1,
            },
        }
    }

    /// Takes a sighting; whether it was believed.
    pub fn take(&mut self, sighting: &Sighting) -> bool {
        let gap_s = sighting.time_ns.saturating_sub(self.time_ns) as f64 * 1e-9;
        if gap_s > MAX_GAP_S {
            *self = Follower::at(sighting, self.noise.variance_px2);
            return true;
        }
        let variance = self.noise.of(sighting) * (ALIKE_S / gap_s.max(1e-3)).max(1.0);
        let mut next = self.mixed(gap_s);
        let (mut nearest, mut total) = (f64::INFINITY, 0.0);
        for (belief, mode) in next.iter_mut().zip(MOTIONS) {
            belief.predict(&mode, gap_s);
            let before = belief.weight;
            let (distance, likelihood) = belief.correct(sighting.point_px, variance);
            nearest = nearest.min(distance);
            belief.weight = before * likelihood;
            total += belief.weight;
        }
        if nearest > GATE {
            return false;
        }
        for belief in &mut next {
            belief.weight = (belief.weight / total).max(LEAST_WEIGHT);
        }
        self.beliefs = next;
        self.time_ns = sighting.time_ns;
        self.noise.take(sighting, gap_s);
        true
    }

    /// Position of the target `ahead_ns` after `now_ns`, the time of the newest frame, px on the chart.
    /// Where it was not seen in that frame, it counts as slowing down since it was.
    pub fn predicted_px(&self, now_ns: u64, ahead_ns: u64) -> [f64; 2] {
        let unseen_s = now_ns.saturating_sub(self.time_ns) as f64 * 1e-9;
        let slowing = (-unseen_s / COAST_S).exp();
        let ahead_s = COAST_S * (1.0 - slowing) + slowing * ahead_ns as f64 * 1e-9;
        let mut point = [0.0; 2];
        let total: f64 = self.beliefs.iter().map(|belief| belief.weight).sum();
        for (belief, mode) in self.beliefs.iter().zip(MOTIONS) {
            for (sum, [position, velocity, acceleration]) in point.iter_mut().zip(belief.state) {
                let bend = match mode {
                    Mode::Velocity(_) => 0.0,
                    Mode::Acceleration(_) => 0.5 * acceleration * ahead_s * ahead_s,
                };
                *sum += belief.weight / total * (position + velocity * ahead_s + bend);
            }
        }
        point
    }

    /// Standard deviation of a detection as measured, px.
    pub fn noise_px(&self) -> f64 {
        self.noise.variance_px2.sqrt()
    }

    /// What each motion starts from after `gap_s`: all of them, as likely as they change into it.
    fn mixed(&self, gap_s: f64) -> [Belief; MODES] {
        let change = |from: usize, to: usize| {
            let stays = (-gap_s / LASTS_S[from]).exp();
            if from == to { stays } else { (1.0 - stays) * NEXT[from][to] }
        };
        std::array::from_fn(|to| {
            let shares: [f64; MODES] =
                std::array::from_fn(|from| change(from, to) * self.beliefs[from].weight);
            let weight: f64 = shares.iter().sum();
            let mut mixed = Belief { state: [[0.0; 3]; 2], covariance: [[0.0; 3]; 3], weight };
            for (belief, share) in self.beliefs.iter().zip(shares) {
                for (sums, values) in mixed.state.iter_mut().zip(belief.state) {
                    for (sum, value) in sums.iter_mut().zip(values) {
                        *sum += share / weight * value;
                    }
                }
            }
            for (belief, share) in self.beliefs.iter().zip(shares) {
                let off: [[f64; 3]; 2] = std::array::from_fn(|axis| {
                    [0, 1, 2].map(|k| belief.state[axis][k] - mixed.state[axis][k])
                });
                for k in 0..3 {
                    for l in 0..3 {
                        // The axes have one covariance: the spread of the means counts for both by half.
                        let spread = 0.5 * (off[0][k] * off[0][l] + off[1][k] * off[1][l]);
                        mixed.covariance[k][l] += share / weight * (belief.covariance[k][l] + spread);
                    }
                }
            }
            mixed
        })
    }
}

impl Belief {
    fn predict(&mut self, mode: &Mode, t: f64) {
        let (t2, t3) = (t * t, t * t * t);
        let (step, drive): (Matrix, Matrix) = match mode {
            Mode::Velocity(q) => (
                [[1.0, t, 0.0], [0.0, 1.0, 0.0], [0.0; 3]],
                [
                    [q * t3 / 3.0, q * t2 / 2.0, 0.0],
                    [q * t2 / 2.0, q * t, 0.0],
                    [0.0, 0.0, ACCELERATION_SD * ACCELERATION_SD],
                ],
            ),
            Mode::Acceleration(q) => (
                [[1.0, t, 0.5 * t2], [0.0, 1.0, t], [0.0, 0.0, 1.0]],
                [
                    [q * t2 * t3 / 20.0, q * t2 * t2 / 8.0, q * t3 / 6.0],
                    [q * t2 * t2 / 8.0, q * t3 / 3.0, q * t2 / 2.0],
                    [q * t3 / 6.0, q * t2 / 2.0, q * t],
                ],
            ),
        };
        for axis in &mut self.state {
            *axis = [0, 1, 2].map(|i| (0..3).map(|k| step[i][k] * axis[k]).sum());
        }
        let old = self.covariance;
        let half: Matrix = [0, 1, 2].map(|i| [0, 1, 2].map(|j| (0..3).map(|k| step[i][k] * old[k][j]).sum()));
        self.covariance = [0, 1, 2]
            .map(|i| [0, 1, 2].map(|j| (0..3).map(|k| half[i][k] * step[j][k]).sum::<f64>() + drive[i][j]));
    }

    /// Takes a measurement; its squared distance in variances, and its likelihood up to a factor that all
    /// motions have in common.
    fn correct(&mut self, measured: [f64; 2], variance: f64) -> (f64, f64) {
        let total = self.covariance[0][0] + variance;
        let gain = [0, 1, 2].map(|i| self.covariance[i][0] / total);
        let off = [0, 1].map(|axis| measured[axis] - self.state[axis][0]);
        for (axis, off) in self.state.iter_mut().zip(off) {
            for (value, gain) in axis.iter_mut().zip(gain) {
                *value += gain * off;
            }
        }
        let row = self.covariance[0];
        for (covariances, gain) in self.covariance.iter_mut().zip(gain) {
            for (covariance, first) in covariances.iter_mut().zip(row) {
                *covariance -= gain * first;
            }
        }
        let distance = (off[0] * off[0] + off[1] * off[1]) / total;
        // Never 0: all motions together must have a weight also at the gate.
        (distance, (-0.5 * distance.min(GATE)).exp() / total)
    }
}

impl Noise {
    /// Variance of a sighting, px²: what was measured, as much more or less as it says of itself.
    fn of(&self, sighting: &Sighting) -> f64 {
        let [least, most] = NOISE_RANGE_PX.map(|sd| sd * sd);
        let relative = (sighting.claimed_px2 / self.claimed_px2).clamp(0.5, 4.0);
        let missing_px2 = (self.whole_px2 - sighting.area_px2).max(0.0);
        let shift = if self.whole_px2 > 0.0 { MISSING * missing_px2 / self.whole_px2.sqrt() } else { 0.0 };
        (self.variance_px2 * relative).clamp(least, most) + shift * shift
    }

    fn take(&mut self, sighting: &Sighting, gap_s: f64) {
        let share = (gap_s / NOISE_MEMORY_S).min(0.1);
        self.claimed_px2 += share * (sighting.claimed_px2 - self.claimed_px2);
        self.whole_px2 = (self.whole_px2 * (-gap_s / AREA_MEMORY_S).exp()).max(sighting.area_px2);
        self.passed_s += gap_s;
        if self.passed_s < NEARLY * ALIKE_S {
            return;
        }
        let share = (self.passed_s / NOISE_MEMORY_S).min(0.1);
        self.passed_s = 0.0;
        let [newest, middle, oldest] = self.last;
        if self.count >= 3 {
            for axis in 0..2 {
                let third = sighting.point_px[axis] - 3.0 * newest[axis] + 3.0 * middle[axis] - oldest[axis];
                let variance = (third * third / THIRD_DIFFERENCE).min(OUTLIER * self.variance_px2);
                self.variance_px2 += share * (variance - self.variance_px2);
            }
        }
        self.last = [sighting.point_px, newest, middle];
        self.count = self.count.saturating_add(1);
    }
}

#[cfg(test)]
mod tests;
