//! Arm and camera as they really are, driven by a coupling that may take the arm for another one.

use crate::arm::{Arm, JOINTS};
use crate::camera::{Camera, CameraPose};
use crate::coupling::{Coupling, wrapped};
use crate::exact::{exact_move, table_offset};
use nalgebra::Isometry3;

/// The interval of theta2 is halved this often: down to the last bit.
const HALVINGS: u32 = 52;

/// Truth for simulation and evaluation: the physical arm and its camera, and the coupling of the *nominal*
/// arm that the driver computes with. Where the two arms differ in their lengths the camera stays vertical
/// (the joint angles still add up), but its reach and its height are others than the coupling thinks, and
/// its height changes with theta2 (design notes on the learner, section 2).
///
/// The physical arm must have the coupling's structure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rig {
    coupling: Coupling,
    arm: Arm,
    camera: Camera,
}

impl Rig {
    /// `arm` with `camera` in its hand, driven through `coupling`.
    pub fn new(coupling: &Coupling, arm: &Arm, camera: &Camera) -> Rig {
        Rig { coupling: *coupling, arm: *arm, camera: *camera }
    }

    /// The coupling that the arm is driven through.
    pub fn coupling(&self) -> &Coupling {
        &self.coupling
    }

    /// The camera.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// The camera in the base frame for joint angles `position_rad`, which need not be coupled.
    pub fn base_from_camera(&self, position_rad: &[f64; JOINTS]) -> Isometry3<f64> {
        self.arm.base_from_camera(position_rad, self.camera.mount_rad)
    }

    /// [`Rig::base_from_camera`] as plain numbers.
    pub fn camera_pose(&self, position_rad: &[f64; JOINTS]) -> CameraPose {
        self.base_from_camera(position_rad).into()
    }

    /// Point of the table under the camera, base frame, m; NaN where the coupling has no such pose.
    pub fn camera_xy(&self, theta_rad: [f64; 2]) -> [f64; 2] {
        if self.is_nominal() {
            return self.coupling.camera_xy(theta_rad[0], theta_rad[1]);
        }
        match self.coupling.joints(theta_rad[0], theta_rad[1]) {
            Some(joints) => {
                let place = self.base_from_camera(&joints).translation.vector;
                [place.x, place.y]
            }
            None => [f64::NAN; 2],
        }
    }

    /// As [`exact_move`], for the arm as it is. Where that is not the nominal one, only moves that end
    /// within the envelope of theta2 are found.
    pub fn exact_move(&self, centred_px: [f64; 2], theta2_rad: f64) -> Option<[f64; 2]> {
        if self.is_nominal() {
            return exact_move(&self.coupling, &self.camera, centred_px, theta2_rad);
        }
        let [reach, height] = self.reach_and_height_m(theta2_rad)?;
        let [u, v] = table_offset(&self.camera, height, centred_px);
        let (turn, theta2) = self.solve([reach + u, -self.arm.links[2].d_m - v])?;
        Some([turn, theta2 - theta2_rad])
    }

    /// Whether the camera can stand over the point `xy_m` of the table within the working envelope.
    pub fn reachable(&self, xy_m: [f64; 2]) -> bool {
        if self.is_nominal() {
            return self.coupling.reachable(xy_m);
        }
        let inside =
            |(theta1, theta2): (f64, f64)| self.coupling.envelope().contains([wrapped(theta1), theta2], 0.0);
        self.solve(xy_m).is_some_and(inside)
    }

    fn is_nominal(&self) -> bool {
        self.arm == *self.coupling.arm()
    }

    /// Radial reach of the camera and its height above the table, m.
    fn reach_and_height_m(&self, theta2_rad: f64) -> Option<[f64; 2]> {
        let joints = self.coupling.joints(0.0, theta2_rad)?;
        let place = self.base_from_camera(&joints).translation.vector;
        Some([place.x, place.z])
    }

    /// (theta1, theta2) with the camera over `xy_m`, theta2 within the envelope: by bisection, for there
    /// the reach falls with theta2, and with another forearm it has no inverse in closed form.
    fn solve(&self, xy_m: [f64; 2]) -> Option<(f64, f64)> {
        let d3 = self.arm.links[2].d_m;
        let squared = xy_m[0] * xy_m[0] + xy_m[1] * xy_m[1] - d3 * d3;
        let reach = if squared >= 0.0 { squared.sqrt() } else { return None };
        let theta1 = xy_m[1].atan2(xy_m[0]) - (-d3).atan2(reach);
        let [mut low, mut high] = self.coupling.envelope().theta2_rad;
        let beyond = |theta2| Some(self.reach_and_height_m(theta2)?[0] >= reach);
        if !beyond(low)? || beyond(high)? {
            return None;
        }
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            *(if beyond(middle)? { &mut low } else { &mut high }) = middle;
        }
        Some((theta1, 0.5 * (low + high)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn rig(forearm_factor: f64, camera: Camera) -> Rig {
        let arm = Arm::puma_like();
        Rig::new(&Coupling::new(&arm, 0.5).unwrap(), &arm.with_forearm(forearm_factor), &camera)
    }

    #[test]
    fn a_longer_forearm_sinks_as_the_design_says() {
        // Design notes on the learner, section 2: forearm x1.2, height 0.473 (theta2 14 deg), 0.420 (55 deg).
        let long = rig(1.2, Camera::default_cell());
        for (theta2_deg, height) in [(14f64, 0.473), (55.0, 0.420)] {
            let [_, found] = long.reach_and_height_m(theta2_deg.to_radians()).unwrap();
            assert!((found - height).abs() < 5e-4, "{theta2_deg} deg: {found} m");
        }
    }

    #[test]
    fn the_camera_of_another_forearm_still_looks_straight_down() {
        let joints = rig(0.8, Camera::default_cell()).coupling.joints(0.4, 0.7).unwrap();
        let pose = rig(0.8, Camera::default_cell()).base_from_camera(&joints);
        assert!((pose.rotation * nalgebra::Vector3::z() + nalgebra::Vector3::z()).norm() < 1e-9);
    }

    #[test]
    fn the_nominal_rig_is_the_closed_form_to_the_bit() {
        let camera = Camera { focal_px: 300.0, mount_rad: 0.3, ..Camera::default_cell() };
        let nominal = rig(1.0, camera);
        let px = [-40.0, 70.0];
        assert_eq!(nominal.exact_move(px, 0.6), exact_move(&nominal.coupling, &camera, px, 0.6));
        assert_eq!(nominal.camera_xy([0.3, 0.6]), nominal.coupling.camera_xy(0.3, 0.6));
    }

    #[test]
    fn what_is_out_of_reach_has_no_move() {
        let short = rig(0.8, Camera::default_cell());
        assert_eq!(short.exact_move([250.0, 0.0], 0.3), None);
        assert_eq!(short.exact_move([f64::NAN, 0.0], 0.6), None);
        assert!(!short.reachable([0.9, 0.0]) && short.reachable([0.5, 0.1]));
    }

    proptest! {
        /// Forward kinematics and projection are the oracle.
        #[test]
        fn the_move_centres_the_point_with_any_forearm(
            theta1 in -1.5..1.5f64, theta2 in 0.25..0.95f64, mount in -3.1..3.1f64,
            factor in 0.8..1.2f64, focal in 128.0..512.0f64, x in -120.0..120.0f64, y in -120.0..120.0f64,
        ) {
            let rig = rig(factor, Camera { focal_px: focal, mount_rad: mount, ..Camera::default_cell() });
            let pose = |theta: [f64; 2]| rig.base_from_camera(&rig.coupling.joints(theta[0], theta[1]).unwrap());
            let [px, py] = rig.camera.table_point(&pose([theta1, theta2]), [x, y]).unwrap();
            if let Some([d1, d2]) = rig.exact_move([x, y], theta2) {
                let after = pose([theta1 + d1, theta2 + d2]);
                let [u, v] = rig.camera.project(&after, [px, py, 0.0]).unwrap();
                prop_assert!(u.hypot(v) < 1e-6, "{} {}", u, v);
                let [cx, cy] = rig.camera_xy([theta1 + d1, theta2 + d2]);
                prop_assert!((cx - px).hypot(cy - py) < 1e-9);
                prop_assert!((theta1 + d1).abs() > 2.6 || rig.reachable([px, py]));
            } else {
                prop_assert!(!rig.reachable([px, py]));
            }
        }
    }
}
