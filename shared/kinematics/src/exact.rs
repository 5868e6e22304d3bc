//! The exact hand-eye map: what the network has to learn, here in closed form.

use crate::camera::Camera;
use crate::coupling::Coupling;

/// Exact move (dtheta1, dtheta2), rad, that brings the point of the table seen at `centred_px` to the
/// middle of the image, from a pose with joint 2 at `theta2_rad`; `None` when the point is out of reach.
///
/// Independent of theta1: the rotation about axis 1 carries arm, camera and image together. An oracle
/// for tests and evaluation; the learner must never see it. Not bound to the working envelope.
pub fn exact_move(
    coupling: &Coupling,
    camera: &Camera,
    centred_px: [f64; 2],
    theta2_rad: f64,
) -> Option<[f64; 2]> {
    let [u, v] = table_offset(camera, coupling.camera_height_m(), centred_px);
    let d3 = coupling.shoulder_offset_m();
    let point = [coupling.reach_m(theta2_rad) + u, -d3 - v];
    let squared = point[0] * point[0] + point[1] * point[1] - d3 * d3;
    let reach = if squared >= 0.0 { squared.sqrt() } else { return None };
    let theta2 = coupling.theta2_for_reach(reach)?;
    coupling.joints(0.0, theta2)?;
    Some([point[1].atan2(point[0]) - (-d3).atan2(reach), theta2 - theta2_rad])
}

/// Offset on the table from the camera's axis to the point seen at `centred_px` from `height_m` above it, m:
/// radially outward, and against the turn of joint 1.
pub(crate) fn table_offset(camera: &Camera, height_m: f64, centred_px: [f64; 2]) -> [f64; 2] {
    let metres_per_px = height_m / camera.focal_px;
    let (sin, cos) = camera.mount_rad.sin_cos();
    [
        metres_per_px * (cos * centred_px[0] - sin * centred_px[1]),
        metres_per_px * (sin * centred_px[0] + cos * centred_px[1]),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Arm;
    use proptest::prelude::*;

    /// The golden numbers are printed to six decimals.
    const GOLDEN_TOLERANCE: f64 = 2e-6;

    fn coupling() -> Coupling {
        Coupling::new(&Arm::puma_like(), 0.5).unwrap()
    }

    fn golden_camera(mount_rad: f64) -> Camera {
        Camera { width: 256, height: 256, focal_px: 200.0, mount_rad }
    }

    #[test]
    fn golden_moves() {
        let cases = [
            ([31.3635, -60.0200], [0.201426, -0.120369]),
            ([-60.0, 40.0], [-0.184621, 0.171962]),
            ([50.0, -30.0], [0.094715, -0.242039]),
            ([0.0, 80.0], [-0.281037, -0.136454]),
        ];
        for (px, expected) in cases {
            let found = exact_move(&coupling(), &golden_camera(0.0), px, 0.6).unwrap();
            for axis in 0..2 {
                assert!((found[axis] - expected[axis]).abs() < GOLDEN_TOLERANCE, "{px:?}: {found:?}");
            }
        }
    }

    #[test]
    fn the_golden_sample_has_the_golden_exact_inverse() {
        let found = exact_move(&coupling(), &golden_camera(0.0), [25.91627, -29.25250], 0.6).unwrap();
        assert!((found[0] - 0.1).abs() < GOLDEN_TOLERANCE && (found[1] + 0.1).abs() < GOLDEN_TOLERANCE);
    }

    #[test]
    fn a_point_out_of_reach_has_no_move() {
        assert_eq!(exact_move(&coupling(), &golden_camera(0.0), [400.0, 0.0], 0.6), None);
        assert_eq!(exact_move(&coupling(), &golden_camera(0.0), [f64::NAN, 0.0], 0.6), None);
    }

    proptest! {
        /// Full forward kinematics and projection are the oracle; theta1 does not enter the move.
        #[test]
        fn the_move_centres_the_point_from_any_theta1(
            theta1 in -1.5..1.5f64, theta2 in 0.25..0.95f64, mount in -3.1..3.1f64,
            radius in 0.45..0.8f64, bearing in -0.6..0.6f64,
        ) {
            let (arm, coupling, camera) = (Arm::puma_like(), coupling(), golden_camera(mount));
            let angle = theta1 + bearing;
            let target = [radius * angle.cos(), radius * angle.sin(), 0.0];
            let before = arm.base_from_camera(&coupling.joints(theta1, theta2).unwrap(), mount);
            let seen = camera.project(&before, target).unwrap();
            let [d1, d2] = exact_move(&coupling, &camera, seen, theta2).unwrap();
            let after = arm.base_from_camera(&coupling.joints(theta1 + d1, theta2 + d2).unwrap(), mount);
            let [x, y] = camera.project(&after, target).unwrap();
            prop_assert!(x.hypot(y) < 1e-9, "{} {}", x, y);
        }
    }
}
