//! From two views of one static thing to a sample that is correct whatever the network did.

use serde::{Deserialize, Serialize};

/// Middle of the working range of joint 2, rad (34.5°).
pub const THETA2_MIDDLE_RAD: f64 = 34.5 * std::f64::consts::PI / 180.0;
/// Half of the working range of joint 2, rad (20.5°).
const THETA2_HALF_RANGE_RAD: f64 = 20.5 * std::f64::consts::PI / 180.0;
/// Displacement of joints 1 and 2 that is 1 in normalised units, rad.
const OUTPUT_UNIT_RAD: [f64; 2] = [0.5, 0.4];
/// A pair whose p lies farther out than this many half widths is not learnt from: the network is never
/// asked there.
const MAX_REACH: f64 = 1.6;

/// Step over which the effect of a clock offset is differentiated, s: some ms are to be made up for.
const DRIFT_STEP_S: f64 = 1e-3;

/// Where a thing was seen, and where the arm was when it was: both at the time of exposure.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct View {
    /// x of the paper: position in the image, px from the image's *centre*, right and down.
    pub point_px: [f64; 2],
    /// θ of the paper: joints 1 and 2 at the exposure, rad.
    pub joints: [f64; 2],
    /// Their velocities, rad/s.
    pub velocities: [f64; 2],
}

impl View {
    /// The view with the joints of `seconds` later.
    #[must_use]
    pub fn later(&self, seconds: f64) -> View {
        View { joints: [0, 1].map(|k| self.joints[k] + seconds * self.velocities[k]), ..*self }
    }
}

/// A learning sample in normalised units.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Sample {
    /// (p / half width, normalised θ2).
    pub input: [f64; 3],
    /// (Δθ1, Δθ2), normalised.
    pub output: [f64; 2],
    /// By how much input and output change for each second that the joints were read too early: see
    /// [`ClockOffset`](crate::ClockOffset).
    pub drift: [f64; 5],
    /// Running number of the sample, from 1.
    pub sequence: u64,
}

impl Sample {
    /// The sample as it had been made with joints of `seconds` later.
    #[must_use]
    pub fn later(&self, seconds: f64) -> Sample {
        let [x, y, theta2, first, second] = self.drift.map(|rate| seconds * rate);
        Sample {
            input: [self.input[0] + x, self.input[1] + y, self.input[2] + theta2],
            output: [self.output[0] + first, self.output[1] + second],
            ..*self
        }
    }
}

/// Scales between the world's units and the network's.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Normalisation {
    /// Half of the image's width, px.
    pub half_width_px: f64,
}

impl Normalisation {
    /// The network's input for a point (px from the image's centre) seen at the angle `theta2` (rad).
    pub fn input(&self, point_px: [f64; 2], theta2: f64) -> [f64; 3] {
        [
            point_px[0] / self.half_width_px,
            point_px[1] / self.half_width_px,
            (theta2 - THETA2_MIDDLE_RAD) / THETA2_HALF_RANGE_RAD,
        ]
    }

    /// The network's output for a displacement of joints 1 and 2, rad.
    pub fn output(&self, displacement: [f64; 2]) -> [f64; 2] {
        [displacement[0] / OUTPUT_UNIT_RAD[0], displacement[1] / OUTPUT_UNIT_RAD[1]]
    }

    /// The displacement of joints 1 and 2, rad, for an output of the network.
    pub fn displacement(&self, output: [f64; 2]) -> [f64; 2] {
        [output[0] * OUTPUT_UNIT_RAD[0], output[1] * OUTPUT_UNIT_RAD[1]]
    }

    /// What the arm's motion from `first` to `second` teaches: had the target been at p, that motion
    /// would have centred it. `None` where the joints moved less than `min_motion_rad` or p lies too far
    /// out.
    pub fn sample(
        &self,
        first: &View,
        second: &View,
        rotation_sign: f64,
        min_motion_rad: f64,
    ) -> Option<Sample> {
        let motion = [second.joints[0] - first.joints[0], second.joints[1] - first.joints[1]];
        let p = displacement_px(first, second, rotation_sign);
        let far = MAX_REACH * self.half_width_px;
        if motion[0].abs().max(motion[1].abs()) < min_motion_rad || p[0].abs().max(p[1].abs()) > far {
            return None;
        }
        let [now, later] = [0.0, DRIFT_STEP_S].map(|seconds| {
            let (first, second) = (first.later(seconds), second.later(seconds));
            let [x, y, theta2] = self.input(displacement_px(&first, &second, rotation_sign), first.joints[1]);
            let [a, b] = self.output([0, 1].map(|k| second.joints[k] - first.joints[k]));
            [x, y, theta2, a, b]
        });
        Some(Sample {
            input: [now[0], now[1], now[2]],
            output: [now[3], now[4]],
            drift: std::array::from_fn(|k| (later[k] - now[k]) / DRIFT_STEP_S),
            sequence: 0,
        })
    }
}

/// p of the paper, px: the point of the first image that the second image has at its centre.
///
/// p = x_i − Rot(s (θ1_j − θ1_i)) x_j. The image turns with joint 1, so x_j has to be turned back before it
/// is subtracted; s = −1 for an unmirrored camera that looks down. Mount angle, focal length and link
/// lengths do not enter: p is exact for any of them.
pub fn displacement_px(first: &View, second: &View, rotation_sign: f64) -> [f64; 2] {
    let turned = rotated(second.point_px, rotation_sign * (second.joints[0] - first.joints[0]));
    [first.point_px[0] - turned[0], first.point_px[1] - turned[1]]
}

fn rotated([x, y]: [f64; 2], angle: f64) -> [f64; 2] {
    let (sin, cos) = angle.sin_cos();
    [cos * x - sin * y, sin * x + cos * y]
}

#[cfg(test)]
mod tests;
