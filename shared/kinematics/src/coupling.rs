//! The coupling that leaves joints 1 and 2 free and lets the others keep the camera vertical.

use crate::arm::{Arm, JOINTS};
use serde::{Deserialize, Serialize};
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// How far a DH angle or length may be from the value that the closed form needs.
const TABLE_TOLERANCE: f64 = 1e-9;

/// Joints 3 to 6 as functions of joints 1 and 2: the camera looks straight down, elbow up, its centre
/// at a constant height above the table.
///
/// ```text
/// L3    = sqrt(a3^2 + d4^2)      gamma = atan2(d4, a3)      H = camera height + wrist to camera
/// psi   = -asin((d1 + a2 sin theta2 - H) / L3)              elevation of the forearm
/// theta3 = psi - gamma - theta2        theta5 = -pi - theta2 - theta3        theta4 = theta6 = 0
/// r     = a2 cos theta2 + L3 cos psi                        radial reach of the wrist = camera
/// ```
///
/// Source: the paper restricts its arm so ("theta5 = f(...)", section 3); the closed form is ours and is
/// tested against the full forward kinematics.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Coupling {
    arm: Arm,
    camera_height_m: f64,
    forearm_m: f64,
    forearm_angle_rad: f64,
    envelope: Envelope,
}

/// The part of the (theta1, theta2) plane in which the arm works.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Envelope {
    /// Lowest and highest theta1, rad.
    pub theta1_rad: [f64; 2],
    /// Lowest and highest theta2, rad.
    pub theta2_rad: [f64; 2],
}

/// Why an arm cannot be coupled so.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum CouplingError {
    /// The closed form needs the PUMA's structure.
    #[error(
        "link {link}: the coupling needs alpha = 90, 0, -90, 90, -90, 0 deg, a1 = a4 = a5 = a6 = 0, d2 = d5 = 0"
    )]
    Structure {
        /// Number of the link, from 1.
        link: usize,
    },
    /// A length is not a positive finite number.
    #[error("lengths a2, d4 and the camera height must be positive and finite")]
    Length,
    /// The working envelope cannot be reached at this height.
    #[error("camera height {camera_height_m} m: theta2 = {theta2_rad} rad of the envelope is out of reach")]
    Height {
        /// The wanted height of the camera, m.
        camera_height_m: f64,
        /// The first angle that has no solution, rad.
        theta2_rad: f64,
    },
}

impl Envelope {
    /// theta2 in [14, 55] degrees, |theta1| at most 150 degrees.
    ///
    /// Below 14 degrees the arm is almost stretched (dr/dtheta2 goes to 0), above 59 degrees joint 3
    /// meets its limit; 150 degrees keep 10 from the limit of joint 1. Valid for the default arm at a
    /// camera height of 0.5 m.
    pub fn default_cell() -> Envelope {
        Envelope {
            theta1_rad: [-150f64, 150.0].map(f64::to_radians),
            theta2_rad: [14f64, 55.0].map(f64::to_radians),
        }
    }

    /// Whether `theta_rad` = (theta1, theta2) is inside, with `slack_rad` more on both sides of theta2.
    /// Not a number is outside.
    pub fn contains(&self, theta_rad: [f64; 2], slack_rad: f64) -> bool {
        let [low1, high1] = self.theta1_rad;
        let [low2, high2] = self.theta2_rad;
        low1 <= theta_rad[0]
            && theta_rad[0] <= high1
            && low2 - slack_rad <= theta_rad[1]
            && theta_rad[1] <= high2 + slack_rad
    }

    /// The nearest point of the envelope, axis by axis; not a number stays so.
    pub fn clamp(&self, theta_rad: [f64; 2]) -> [f64; 2] {
        [
            theta_rad[0].clamp(self.theta1_rad[0], self.theta1_rad[1]),
            theta_rad[1].clamp(self.theta2_rad[0], self.theta2_rad[1]),
        ]
    }
}

impl Coupling {
    /// The coupling of `arm` with the camera at `camera_height_m` above the table, in the envelope
    /// [`Envelope::default_cell`].
    ///
    /// # Errors
    /// [`CouplingError`] when the arm has another structure or the envelope cannot be reached.
    pub fn new(arm: &Arm, camera_height_m: f64) -> Result<Coupling, CouplingError> {
        Coupling::with_envelope(arm, camera_height_m, Envelope::default_cell())
    }

    /// As [`Coupling::new`], with an envelope of one's own.
    ///
    /// # Errors
    /// [`CouplingError`] when the arm has another structure or the envelope cannot be reached.
    pub fn with_envelope(
        arm: &Arm,
        camera_height_m: f64,
        envelope: Envelope,
    ) -> Result<Coupling, CouplingError> {
        check_structure(arm)?;
        let [a2, a3, d4] = [arm.links[1].a_m, arm.links[2].a_m, arm.links[3].d_m];
        let positive = |length: f64| length > 0.0 && length.is_finite();
        if !(positive(a2) && positive(d4) && positive(camera_height_m)) {
            return Err(CouplingError::Length);
        }
        let coupling = Coupling {
            arm: *arm,
            camera_height_m,
            forearm_m: a3.hypot(d4),
            forearm_angle_rad: d4.atan2(a3),
            envelope,
        };
        for theta2_rad in envelope.theta2_rad {
            if coupling.joints(0.0, theta2_rad).is_none() {
                return Err(CouplingError::Height { camera_height_m, theta2_rad });
            }
        }
        Ok(coupling)
    }

    /// The arm that is coupled.
    pub fn arm(&self) -> &Arm {
        &self.arm
    }

    /// Height of the camera's centre above the table, m.
    pub fn camera_height_m(&self) -> f64 {
        self.camera_height_m
    }

    /// Height H of the wrist above the table, m.
    pub fn wrist_height_m(&self) -> f64 {
        self.camera_height_m + self.arm.wrist_to_camera_m()
    }

    /// The working envelope.
    pub fn envelope(&self) -> &Envelope {
        &self.envelope
    }

    /// All six joint angles for `theta1_rad`, `theta2_rad`; `None` where there is no such pose or a
    /// joint would leave its position limits. Not bound to the envelope.
    pub fn joints(&self, theta1_rad: f64, theta2_rad: f64) -> Option<[f64; JOINTS]> {
        let psi = self.forearm_elevation_rad(theta2_rad);
        let theta3 = psi - self.forearm_angle_rad - theta2_rad;
        let theta5 = wrapped(-PI - theta2_rad - theta3);
        let joints = [theta1_rad, theta2_rad, theta3, 0.0, theta5, 0.0];
        self.arm.within_limits(&joints).then_some(joints)
    }

    /// Velocities of all six joints, rad/s, when joints 1 and 2 stand at `theta_rad` and turn with
    /// `rate_rad_per_s`. Finite wherever [`Coupling::joints`] has an answer.
    pub fn velocities(&self, theta_rad: [f64; 2], rate_rad_per_s: [f64; 2]) -> [f64; JOINTS] {
        let [rate1, rate2] = rate_rad_per_s;
        let slope3 = self.theta3_per_theta2(theta_rad[1]);
        [rate1, rate2, slope3 * rate2, 0.0, self.theta5_per_theta2(theta_rad[1]) * rate2, 0.0]
    }

    /// dtheta3/dtheta2 at `theta2_rad`; NaN where the wrist height cannot be reached.
    pub fn theta3_per_theta2(&self, theta2_rad: f64) -> f64 {
        let psi = self.forearm_elevation_rad(theta2_rad);
        -self.upper_arm_m() * theta2_rad.cos() / (self.forearm_m * psi.cos()) - 1.0
    }

    /// dtheta5/dtheta2 at `theta2_rad`: the tool's angle theta2 + theta3 + theta5 is constant.
    pub fn theta5_per_theta2(&self, theta2_rad: f64) -> f64 {
        -1.0 - self.theta3_per_theta2(theta2_rad)
    }

    /// Radial reach r of wrist and camera at `theta2_rad`, m (without the shoulder's offset d3).
    pub fn reach_m(&self, theta2_rad: f64) -> f64 {
        let psi = self.forearm_elevation_rad(theta2_rad);
        self.upper_arm_m() * theta2_rad.cos() + self.forearm_m * psi.cos()
    }

    /// dr/dtheta2 at `theta2_rad`, m/rad.
    pub fn reach_per_theta2(&self, theta2_rad: f64) -> f64 {
        let psi = self.forearm_elevation_rad(theta2_rad);
        -self.upper_arm_m() * (theta2_rad - psi).sin() / psi.cos()
    }

    /// theta2 at which the radial reach is `reach_m`, elbow up; `None` when it is out of reach.
    /// Inverse of [`Coupling::reach_m`], in closed form (the cosine rule).
    pub fn theta2_for_reach(&self, reach_m: f64) -> Option<f64> {
        let rise = self.wrist_height_m() - self.arm.links[0].d_m;
        let [upper, fore] = [self.upper_arm_m(), self.forearm_m];
        let distance = reach_m.hypot(rise);
        let cosine = (upper * upper + distance * distance - fore * fore) / (2.0 * upper * distance);
        (-1.0..=1.0).contains(&cosine).then(|| rise.atan2(reach_m) + cosine.acos())
    }

    /// Point of the table under the camera, base frame, m.
    pub fn camera_xy(&self, theta1_rad: f64, theta2_rad: f64) -> [f64; 2] {
        let (sin, cos) = theta1_rad.sin_cos();
        let (r, d3) = (self.reach_m(theta2_rad), self.shoulder_offset_m());
        [r * cos + d3 * sin, r * sin - d3 * cos]
    }

    /// Velocity of the camera over the table along the reach and across it, m/s, when joints 1 and 2 stand at
    /// `theta_rad` and turn with `rate_rad_per_s`: the derivative of [`Coupling::camera_xy`], turned by theta1.
    pub fn camera_velocity(&self, theta_rad: [f64; 2], rate_rad_per_s: [f64; 2]) -> [f64; 2] {
        let [rate1, rate2] = rate_rad_per_s;
        let along = self.reach_per_theta2(theta_rad[1]) * rate2 + self.shoulder_offset_m() * rate1;
        [along, self.reach_m(theta_rad[1]) * rate1]
    }

    /// (theta1, theta2) that put the camera over the point `xy_m` of the table, theta1 in (-pi, pi];
    /// `None` when the arm cannot stand so. Inverse of [`Coupling::camera_xy`]. Not bound to the
    /// envelope.
    pub fn theta_over(&self, xy_m: [f64; 2]) -> Option<[f64; 2]> {
        let d3 = self.shoulder_offset_m();
        let squared = xy_m[0] * xy_m[0] + xy_m[1] * xy_m[1] - d3 * d3;
        let reach = if squared >= 0.0 { squared.sqrt() } else { return None };
        let theta1 = wrapped(xy_m[1].atan2(xy_m[0]) - (-d3).atan2(reach));
        let theta2 = self.theta2_for_reach(reach)?;
        self.joints(theta1, theta2).map(|_| [theta1, theta2])
    }

    /// Whether the camera can stand over the point `xy_m` of the table within the working envelope.
    pub fn reachable(&self, xy_m: [f64; 2]) -> bool {
        self.theta_over(xy_m).is_some_and(|theta| self.envelope.contains(theta, 0.0))
    }

    /// Highest speed of joint 2 at `theta2_rad` that keeps joints 2, 3 and 5 within their own, rad/s.
    pub fn joint2_speed_limit(&self, theta2_rad: f64) -> f64 {
        let speed = |link: usize| self.arm.links[link].max_speed_rad_per_s;
        speed(1)
            .min(speed(2) / self.theta3_per_theta2(theta2_rad).abs())
            .min(speed(4) / self.theta5_per_theta2(theta2_rad).abs())
    }

    /// Lowest of [`Coupling::joint2_speed_limit`] for theta2 in `range_rad`, from 256 places of it.
    /// A constant limit brakes nobody on the way.
    pub fn joint2_speed_limit_within(&self, range_rad: [f64; 2]) -> f64 {
        const PLACES: u32 = 256;
        (0..=PLACES)
            .map(|k| range_rad[0] + (range_rad[1] - range_rad[0]) * f64::from(k) / f64::from(PLACES))
            .map(|theta2| self.joint2_speed_limit(theta2))
            .fold(f64::INFINITY, f64::min)
    }

    /// Lateral offset d3 of the shoulder, m.
    pub fn shoulder_offset_m(&self) -> f64 {
        self.arm.links[2].d_m
    }

    fn upper_arm_m(&self) -> f64 {
        self.arm.links[1].a_m
    }

    /// psi: elevation of the line from elbow to wrist, rad; NaN where the height cannot be reached.
    fn forearm_elevation_rad(&self, theta2_rad: f64) -> f64 {
        let elbow_m = self.arm.links[0].d_m + self.upper_arm_m() * theta2_rad.sin();
        -((elbow_m - self.wrist_height_m()) / self.forearm_m).asin()
    }
}

/// The closed form holds for this structure only.
fn check_structure(arm: &Arm) -> Result<(), CouplingError> {
    let alphas = [FRAC_PI_2, 0.0, -FRAC_PI_2, FRAC_PI_2, -FRAC_PI_2, 0.0];
    for (i, (link, alpha)) in arm.links.iter().zip(alphas).enumerate() {
        let a_must_vanish = matches!(i, 0 | 3 | 4 | 5);
        let d_must_vanish = matches!(i, 1 | 4);
        let near_zero = |value: f64| value.abs() <= TABLE_TOLERANCE;
        let right = near_zero(link.alpha_rad - alpha)
            && (!a_must_vanish || near_zero(link.a_m))
            && (!d_must_vanish || near_zero(link.d_m));
        if !right {
            return Err(CouplingError::Structure { link: i + 1 });
        }
    }
    Ok(())
}

/// The same angle in (-pi, pi].
pub(crate) fn wrapped(angle_rad: f64) -> f64 {
    let angle = angle_rad.rem_euclid(TAU);
    if angle > PI { angle - TAU } else { angle }
}

#[cfg(test)]
mod tests;
