//! The arm as a table of numbers, and its forward kinematics.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};
use std::f64::consts::{FRAC_PI_2, PI};

/// Joints of the arm.
pub const JOINTS: usize = 6;

/// One row of a standard Denavit-Hartenberg table with the limits of its joint.
///
/// The link's transform is `Rz(theta) * Tz(d) * Tx(a) * Rx(alpha)`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Link {
    /// Length along the new x axis, m.
    pub a_m: f64,
    /// Twist about the new x axis, rad.
    pub alpha_rad: f64,
    /// Offset along the joint axis, m.
    pub d_m: f64,
    /// Lowest and highest joint angle, rad.
    pub position_limits_rad: [f64; 2],
    /// Highest joint speed, rad/s.
    pub max_speed_rad_per_s: f64,
}

/// A serial arm of six revolute joints with a camera on its flange.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Arm {
    /// The links from base to flange.
    pub links: [Link; JOINTS],
    /// Distance of the camera's centre of projection from the flange along its axis, m.
    pub flange_to_camera_m: f64,
}

impl Arm {
    /// The default arm: PUMA 560 lengths, the pedestal in the first offset, so that the base frame lies
    /// on the table.
    ///
    /// Lengths and position limits are the published ones; the speeds are the commonly quoted
    /// 82, 54, 122, 228, 241, 228 deg/s.
    pub fn puma_like() -> Arm {
        let link = |a_m, alpha_rad, d_m, limits_deg: [f64; 2], max_speed_rad_per_s| Link {
            a_m,
            alpha_rad,
            d_m,
            position_limits_rad: limits_deg.map(f64::to_radians),
            max_speed_rad_per_s,
        };
        Arm {
            links: [
                link(0.0, FRAC_PI_2, 0.672, [-160.0, 160.0], 1.43),
                link(0.4318, 0.0, 0.0, [-45.0, 225.0], 0.94),
                link(0.0203, -FRAC_PI_2, 0.15005, [-225.0, 45.0], 2.13),
                link(0.0, FRAC_PI_2, 0.4318, [-110.0, 170.0], 3.98),
                link(0.0, -FRAC_PI_2, 0.0, [-100.0, 100.0], 4.2),
                link(0.0, 0.0, 0.05625, [-266.0, 266.0], 3.98),
            ],
            flange_to_camera_m: 0.06375,
        }
    }

    /// This arm with a forearm (d4, from elbow to wrist) `factor` times as long.
    pub fn with_forearm(mut self, factor: f64) -> Arm {
        self.links[3].d_m *= factor;
        self
    }

    /// Poses of the six link frames (DH frames 1 to 6) in the base frame for joint angles
    /// `position_rad`; the last is the flange.
    pub fn base_from_links(&self, position_rad: &[f64; JOINTS]) -> [Isometry3<f64>; JOINTS] {
        let mut base_from_link = Isometry3::identity();
        std::array::from_fn(|i| {
            base_from_link *= self.links[i].parent_from_link(position_rad[i]);
            base_from_link
        })
    }

    /// Pose of the flange (DH frame 6) in the base frame for joint angles `position_rad`.
    pub fn base_from_flange(&self, position_rad: &[f64; JOINTS]) -> Isometry3<f64> {
        self.base_from_links(position_rad)[JOINTS - 1]
    }

    /// Pose of the camera in the flange frame: x to the right of the image, y down the image, z along
    /// the view.
    ///
    /// With `mount_rad = 0` and the camera looking down, image x points radially outward; a positive
    /// mount angle turns the camera about its own z axis.
    pub fn flange_from_camera(&self, mount_rad: f64) -> Isometry3<f64> {
        // The flange's x axis points back to the base when the tool hangs down: hence the half turn.
        Isometry3::from_parts(
            Translation3::new(0.0, 0.0, self.flange_to_camera_m),
            UnitQuaternion::from_axis_angle(&Vector3::z_axis(), PI + mount_rad),
        )
    }

    /// Pose of the camera in the base frame for joint angles `position_rad`.
    pub fn base_from_camera(&self, position_rad: &[f64; JOINTS], mount_rad: f64) -> Isometry3<f64> {
        self.base_from_flange(position_rad) * self.flange_from_camera(mount_rad)
    }

    /// Distance from the wrist (the crossing of axes 4, 5 and 6) to the camera along axis 6, m.
    pub fn wrist_to_camera_m(&self) -> f64 {
        self.links[5].d_m + self.flange_to_camera_m
    }

    /// Whether all joint angles are finite and within their position limits.
    pub fn within_limits(&self, position_rad: &[f64; JOINTS]) -> bool {
        self.links.iter().zip(position_rad).all(|(link, q)| {
            let [low, high] = link.position_limits_rad;
            low <= *q && *q <= high
        })
    }
}

impl Link {
    /// The link's frame in its parent's frame when its joint stands at `theta_rad`.
    pub fn parent_from_link(&self, theta_rad: f64) -> Isometry3<f64> {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), theta_rad);
        Isometry3::from_parts(Translation3::identity(), turn) * self.joint_from_link()
    }

    /// The constant part of the link's transform: `Tz(d) * Tx(a) * Rx(alpha)`.
    pub fn joint_from_link(&self) -> Isometry3<f64> {
        Isometry3::from_parts(
            Translation3::new(self.a_m, 0.0, self.d_m),
            UnitQuaternion::from_axis_angle(&Vector3::x_axis(), self.alpha_rad),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_zero_pose_is_the_one_of_the_table() {
        // Standard DH, all angles 0: written out by hand along the chain.
        let flange = Arm::puma_like().base_from_flange(&[0.0; JOINTS]);
        let expected = Vector3::new(0.4318 + 0.0203, -0.15005, 0.672 + 0.4318 + 0.05625);
        assert!((flange.translation.vector - expected).norm() < 1e-12, "{flange}");
    }

    #[test]
    fn joint_one_turns_everything_about_the_vertical() {
        let arm = Arm::puma_like();
        let pose = [0.0, 0.6, -2.8, 0.3, -0.8, 0.2];
        let mut turned = pose;
        turned[0] = 0.7;
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.7);
        let expected = Isometry3::from_parts(Translation3::identity(), turn) * arm.base_from_flange(&pose);
        let difference = expected.inv_mul(&arm.base_from_flange(&turned));
        assert!(difference.translation.vector.norm() < 1e-12 && difference.rotation.angle() < 1e-7);
    }

    #[test]
    fn angles_that_are_not_numbers_are_outside_the_limits() {
        let arm = Arm::puma_like();
        assert!(arm.within_limits(&[0.0; JOINTS]));
        assert!(!arm.within_limits(&[0.0, f64::NAN, 0.0, 0.0, 0.0, 0.0]));
        assert!(!arm.within_limits(&[2.8, 0.0, 0.0, 0.0, 0.0, 0.0]));
    }
}
