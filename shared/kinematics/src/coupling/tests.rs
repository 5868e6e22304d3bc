use super::*;
use proptest::prelude::*;

fn coupling() -> Coupling {
    Coupling::new(&Arm::puma_like(), 0.5).unwrap()
}

/// theta2, theta3, theta5 (deg), r, rho (m), dr/dtheta2 (m/rad), dtheta3/dtheta2, as printed in the
/// design notes on the learner, section 2, so to half a unit of the last digit
/// (one unit for dr/dtheta2: at 15 degrees it is -0.28249).
const TABLE: [[f64; 7]; 6] = [
    [10.0, -114.39, -75.61, 0.8384, 0.8518, -0.206, -2.03],
    [15.0, -124.57, -70.43, 0.8171, 0.8308, -0.283, -2.04],
    [25.0, -145.16, -59.84, 0.7545, 0.7693, -0.435, -2.08],
    [35.0, -166.20, -48.80, 0.6653, 0.6820, -0.588, -2.14],
    [45.0, -188.06, -36.94, 0.5486, 0.5687, -0.754, -2.26],
    [55.0, -212.12, -22.88, 0.3969, 0.4243, -1.027, -2.66],
];

#[test]
fn the_design_table_is_met() {
    let coupling = coupling();
    for [theta2_deg, theta3_deg, theta5_deg, r, rho, dr, d3] in TABLE {
        let theta2 = theta2_deg.to_radians();
        let joints = coupling.joints(0.0, theta2).unwrap();
        let [x, y] = coupling.camera_xy(0.0, theta2);
        assert!((joints[2].to_degrees() - theta3_deg).abs() < 0.0051, "{joints:?}");
        assert!((joints[4].to_degrees() - theta5_deg).abs() < 0.0051, "{joints:?}");
        assert!((coupling.reach_m(theta2) - r).abs() < 0.51e-4);
        assert!((x.hypot(y) - rho).abs() < 0.51e-4);
        assert!((coupling.reach_per_theta2(theta2) - dr).abs() < 1e-3);
        assert!((coupling.theta3_per_theta2(theta2) - d3).abs() < 0.0051);
    }
}

#[test]
fn the_golden_pose_is_met() {
    let coupling = coupling();
    let joints = coupling.joints(0.0, 0.6).unwrap();
    let [x, y] = coupling.camera_xy(0.0, 0.6);
    assert!((joints[2] + 2.877479).abs() < 2e-6 && (joints[4] + 0.864113).abs() < 2e-6, "{joints:?}");
    assert!((x - 0.671591).abs() < 2e-6 && (y + 0.15005).abs() < 2e-6, "{x} {y}");
    assert!((coupling.wrist_height_m() - 0.62).abs() < 1e-12);
}

#[test]
fn joint_three_ends_the_range_before_sixty_degrees() {
    assert!(coupling().joints(0.0, 59f64.to_radians()).is_some());
    assert!(coupling().joints(0.0, 60f64.to_radians()).is_none());
    assert!(coupling().joints(3.0, 0.6).is_none());
    assert!(coupling().joints(0.0, f64::NAN).is_none());
}

#[test]
fn another_arm_or_height_is_refused() {
    let mut arm = Arm::puma_like();
    arm.links[1].d_m = 0.1;
    assert_eq!(Coupling::new(&arm, 0.5), Err(CouplingError::Structure { link: 2 }));
    let refused = Coupling::new(&Arm::puma_like(), 1.5);
    assert!(matches!(refused, Err(CouplingError::Height { .. })), "{refused:?}");
    assert_eq!(Coupling::new(&Arm::puma_like(), f64::NAN), Err(CouplingError::Length));
}

#[test]
fn the_envelope_is_the_designs() {
    let envelope = *coupling().envelope();
    assert!(envelope.contains([149f64.to_radians(), 0.6], 0.0));
    assert!(!envelope.contains([151f64.to_radians(), 0.6], 0.1));
    assert!(!envelope.contains([0.0, 13f64.to_radians()], 0.0));
    assert!(envelope.contains([0.0, 13f64.to_radians()], 2f64.to_radians()));
    assert!(!envelope.contains([f64::NAN, 0.6], 0.1) && !envelope.contains([0.0, f64::NAN], 0.1));
    assert_eq!(envelope.clamp([0.0, 2.0]), [0.0, 55f64.to_radians()]);
}

#[test]
fn the_reference_circle_is_reachable_and_the_far_corner_is_not() {
    let coupling = coupling();
    for k in 0..360 {
        let angle = f64::from(k).to_radians();
        assert!(coupling.reachable([0.63 + 0.2 * angle.cos(), 0.2 * angle.sin()]), "{k} deg");
    }
    assert!(!coupling.reachable([1.1, 0.5]));
    assert!(!coupling.reachable([0.05, 0.0]));
    assert!(!coupling.reachable([f64::NAN, 0.0]));
}

proptest! {
    /// Check 6: the closed form against the full forward kinematics.
    #[test]
    fn the_camera_hangs_straight_down_at_its_height(
        theta1 in -2.6..2.6f64, theta2 in 0.18..1.02f64, height in 0.45..0.55f64,
    ) {
        let arm = Arm::puma_like();
        // At the lower heights joint 3 ends the range earlier.
        let envelope = Envelope { theta1_rad: [-2.6, 2.6], theta2_rad: [0.3, 0.6] };
        let coupling = Coupling::with_envelope(&arm, height, envelope).unwrap();
        let Some(joints) = coupling.joints(theta1, theta2) else { return Ok(()) };
        let base_from_camera = arm.base_from_camera(&joints, 0.0);
        let [x, y] = coupling.camera_xy(theta1, theta2);
        let position = base_from_camera.translation.vector;
        prop_assert!((position.x - x).abs() < 1e-12 && (position.y - y).abs() < 1e-12);
        prop_assert!((position.z - height).abs() < 1e-12);
        let view = base_from_camera.rotation * nalgebra::Vector3::z();
        prop_assert!((view.z + 1.0).abs() < 1e-12, "{}", view);
    }

    #[test]
    fn derivatives_equal_central_differences(theta2 in 0.18..1.0f64) {
        let coupling = coupling();
        let step = 1e-6;
        let at = |theta2: f64| coupling.joints(0.3, theta2).unwrap();
        let (more, less) = (at(theta2 + step), at(theta2 - step));
        let velocities = coupling.velocities([0.3, theta2], [0.0, 1.0]);
        for joint in 1..JOINTS {
            let difference = (more[joint] - less[joint]) / (2.0 * step);
            prop_assert!((velocities[joint] - difference).abs() < 1e-7, "joint {}", joint + 1);
        }
        let slope = (coupling.reach_m(theta2 + step) - coupling.reach_m(theta2 - step)) / (2.0 * step);
        prop_assert!((coupling.reach_per_theta2(theta2) - slope).abs() < 1e-7);
    }

    #[test]
    fn theta_over_is_the_inverse_of_camera_xy(theta1 in -2.6..2.6f64, theta2 in 0.15..1.02f64) {
        let coupling = coupling();
        let [x, y] = coupling.camera_xy(theta1, theta2);
        let [theta1_back, theta2_back] = coupling.theta_over([x, y]).unwrap();
        prop_assert!((theta1 - theta1_back).abs() < 1e-9 && (theta2 - theta2_back).abs() < 1e-9);
    }

    #[test]
    fn the_speed_limit_of_joint_two_keeps_all_joints_within_theirs(theta2 in 0.21..0.99f64) {
        let coupling = coupling();
        let range = [0.21, 0.99];
        prop_assert!(coupling.joint2_speed_limit_within(range) <= coupling.joint2_speed_limit(theta2) + 1e-12);
        let velocities = coupling.velocities([0.0, theta2], [0.0, coupling.joint2_speed_limit(theta2)]);
        for (link, velocity) in coupling.arm().links.iter().zip(velocities) {
            prop_assert!(velocity.abs() <= link.max_speed_rad_per_s + 1e-12);
        }
    }
}
