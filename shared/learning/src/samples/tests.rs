//! Oracle: the exact model of the arm, which nothing outside the tests knows.

use super::*;
use proptest::prelude::*;
use pursuit_kinematics::{Arm, Camera, Coupling, exact_move};

const UNMIRRORED: f64 = -1.0;

fn golden_camera() -> Camera {
    Camera { width: 256, height: 256, focal_px: 200.0, mount_rad: 0.0 }
}

/// What the camera sees of a point of the table; a mirrored camera sees y upside down.
fn view(camera: &Camera, target: [f64; 2], joints: [f64; 2], mirrored: bool) -> View {
    let arm = Arm::puma_like();
    let all = Coupling::new(&arm, 0.5).unwrap().joints(joints[0], joints[1]).unwrap();
    let pose = arm.base_from_camera(&all, camera.mount_rad);
    let [x, y] = camera.project(&pose, [target[0], target[1], 0.0]).unwrap();
    View { point_px: [x, if mirrored { -y } else { y }], joints, velocities: [0.0; 2] }
}

#[test]
fn the_golden_pair_teaches_the_golden_sample() {
    let [first, second] =
        [[0.0, 0.6], [0.1, 0.5]].map(|joints| view(&golden_camera(), [0.75, 0.0], joints, false));
    // The design prints x_j as 8.49168 and p as 25.91627; by hand 400 (0.75 cos 0.1 − r(0.5)) = 8.491628,
    // and p follows.
    let [x, y] = second.point_px;
    assert!((x - 8.491628).abs() < 1e-5 && (y + 30.06998).abs() < 1e-5, "{x} {y}");
    let p = displacement_px(&first, &second, UNMIRRORED);
    assert!((p[0] - 25.916258).abs() < 1e-5 && (p[1] + 29.25250).abs() < 1e-5, "{p:?}");
    let normalisation = Normalisation { half_width_px: 128.0 };
    let sample = normalisation.sample(&first, &second, UNMIRRORED, 0.03).unwrap();
    assert!((sample.input[0] - p[0] / 128.0).abs() < 1e-12);
    assert!((sample.output[0] - 0.2).abs() < 1e-12 && (sample.output[1] + 0.25).abs() < 1e-12);
}

proptest! {
    /// Section 10.7 of the design, both directions, any camera.
    #[test]
    fn p_is_the_point_that_the_motion_would_have_centred(
        from1 in -1.0..1.0f64, by1 in -0.3..0.3f64, from2 in 0.3..0.9f64, to2 in 0.3..0.9f64,
        radius in 0.5..0.8f64, bearing in -1.0..1.0f64,
        mount in -3.1..3.1f64, focal in 100.0..500.0f64, mirrored: bool,
    ) {
        let camera = Camera { mount_rad: mount, focal_px: focal, ..golden_camera() };
        let coupling = Coupling::new(&Arm::puma_like(), 0.5).unwrap();
        let target = [radius * bearing.cos(), radius * bearing.sin()];
        let (a, b) = ([from1, from2], [from1 + by1, to2]);
        for (from, to) in [(a, b), (b, a)] {
            let first = view(&camera, target, from, mirrored);
            let second = view(&camera, target, to, mirrored);
            let mut p = displacement_px(&first, &second, if mirrored { 1.0 } else { UNMIRRORED });
            if mirrored { p[1] = -p[1]; }
            let motion = exact_move(&coupling, &camera, p, from[1]).unwrap();
            prop_assert!((motion[0] - (to[0] - from[0])).abs() < 1e-6);
            prop_assert!((motion[1] - (to[1] - from[1])).abs() < 1e-6);
        }
    }

    /// Chaining frame by frame gives what the direct pair gives: needed to learn from image flow.
    #[test]
    fn displacements_chain(steps in prop::collection::vec((-0.05..0.05f64, -0.02..0.02f64), 12)) {
        let camera = golden_camera();
        let mut joints = [0.1, 0.6];
        let mut views = vec![view(&camera, [0.65, 0.1], joints, false)];
        for (d1, d2) in steps {
            joints = [joints[0] + d1, joints[1] + d2];
            views.push(view(&camera, [0.65, 0.1], joints, false));
        }
        let mut sum = [0.0; 2];
        for pair in views.windows(2) {
            let turned = UNMIRRORED * (pair[0].joints[0] - views[0].joints[0]);
            let p = rotated(displacement_px(&pair[0], &pair[1], UNMIRRORED), turned);
            sum = [sum[0] + p[0], sum[1] + p[1]];
        }
        let direct = displacement_px(&views[0], views.last().unwrap(), UNMIRRORED);
        prop_assert!((sum[0] - direct[0]).abs() < 1e-9 && (sum[1] - direct[1]).abs() < 1e-9);
    }

    #[test]
    fn scales_cancel(d1 in -1.0..1.0f64, d2 in -1.0..1.0f64) {
        let normalisation = Normalisation { half_width_px: 256.0 };
        let back = normalisation.displacement(normalisation.output([d1, d2]));
        prop_assert!((back[0] - d1).abs() < 1e-15 && (back[1] - d2).abs() < 1e-15);
    }
}

#[test]
fn a_pair_that_hardly_moved_or_reaches_too_far_teaches_nothing() {
    let normalisation = Normalisation { half_width_px: 256.0 };
    let at = |point_px, joints| View { point_px, joints, velocities: [0.0; 2] };
    let still = normalisation.sample(&at([9.0, 9.0], [0.0, 0.6]), &at([1.0, 1.0], [0.029, 0.6]), -1.0, 0.03);
    assert_eq!(still, None);
    let far = normalisation.sample(&at([255.0, 0.0], [0.0, 0.6]), &at([-200.0, 0.0], [0.0, 0.9]), -1.0, 0.03);
    assert_eq!(far, None);
}
