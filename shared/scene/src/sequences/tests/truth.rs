use super::*;

/// With the target's texture far from the ground's, so that every pixel of it differs.
fn with_plain_target(scenario: Scenario, spec: TargetSpec) -> Scenario {
    Scenario { target: Some(TargetSpec { contrast: Some(0.0), ..spec }), noise: 0.0, ..scenario }
}

fn difficult() -> Vec<Scenario> {
    let camera = Scenario {
        rotation_deg: 2.0,
        zoom: 0.02,
        slant: 5e-5,
        jitter_px: 3.0,
        texture: Texture::Noise(0.5),
        ..Scenario::default()
    };
    let spec = TargetSpec { shape: Shape::Blob, spin_deg: 5.0, curve_deg: 4.0, ..TargetSpec::default() };
    let rectangle = TargetSpec { shape: Shape::Rectangle, spin_deg: -3.0, ..TargetSpec::default() };
    let small = TargetSpec { side_px: 24.0, velocity: [3.0, 2.0], ..TargetSpec::default() };
    vec![
        with_plain_target(camera.clone(), spec),
        with_plain_target(Scenario { exposure: 0.8, rotation_deg: 1.0, ..Scenario::default() }, rectangle),
        with_plain_target(camera, small.clone()),
        with_plain_target(Scenario { frames: 28, occluder: Some((9, 16)), ..Scenario::default() }, small),
    ]
}

#[test]
fn position_is_the_centroid_of_what_the_target_changes_in_the_picture() {
    let size = 256;
    for (n, scenario) in difficult().into_iter().enumerate() {
        let mut with = Sequence::new(&scenario, size, 3).unwrap();
        let mut without =
            Sequence::new(&Scenario { target: None, occluder: None, ..scenario }, size, 3).unwrap();
        let mut seen = 0;
        for t in 0..with.frames() {
            let (count, centroid) =
                where_different(&frame_of(&mut with, t), &frame_of(&mut without, t), size);
            let truth = with.truth(t);
            let Some(position) = truth.position else { continue };
            seen += 1;
            let error = distance(position, centroid);
            assert!(error < 0.5, "scenario {n}, frame {t}: {position:?}, changed are {centroid:?}");
            // pixels that are covered in part count as changed
            let rim = 8.0 * truth.area_px.sqrt() + 30.0;
            assert!((count as f64 - truth.area_px).abs() < rim, "{n}, {t}: {count} of {}", truth.area_px);
        }
        assert!(seen > 7, "scenario {n}: seen in {seen} frames");
    }
}

#[test]
fn velocity_is_the_motion_of_the_centroid_of_a_disc_in_full_view() {
    let spec = TargetSpec { velocity: [2.3, -1.6], curve_deg: 3.0, ..TargetSpec::default() };
    let scenario =
        Scenario { pan: [1.4, 0.7], pan_modulation: 0.5, target: Some(spec), ..Scenario::default() };
    let sequence = Sequence::new(&scenario, 512, 4).unwrap();
    for t in 1..sequence.frames() {
        let (before, now) = (sequence.truth(t - 1), sequence.truth(t));
        assert!(now.visible_share.min(before.visible_share) > 0.99);
        let moved = difference(now.position.unwrap(), before.position.unwrap());
        assert!(distance(moved, now.velocity) < 0.1, "frame {t}: {moved:?}, truth {:?}", now.velocity);
        let sum = [0, 1].map(|k| now.background[k] + now.relative_velocity[k]);
        assert!(distance(sum, now.velocity) < 1e-4, "frame {t}: without rotation the parts add up");
    }
}

#[test]
fn at_mid_sequence_velocities_are_what_the_scenario_says() {
    let spec = TargetSpec { velocity: [-7.0, 3.0], curve_deg: 2.0, ..TargetSpec::default() };
    let scenario = Scenario { pan: [5.0, -2.0], target: Some(spec), ..Scenario::default() };
    let truth = Sequence::new(&scenario, 128, 1).unwrap().truth(scenario.middle());
    assert!(distance(truth.background, [5.0, -2.0]) < 1e-4);
    assert!(distance(truth.relative_velocity, [-7.0, 3.0]) < 1e-4);
    assert!(distance(truth.velocity, [-2.0, 1.0]) < 1e-4);
    let turned = Scenario { rotation_deg: 4.0, ..scenario };
    let turned = Sequence::new(&turned, 128, 1).unwrap();
    for t in 0..turned.frames() {
        assert!(
            distance(turned.truth(t).background, [5.0, -2.0]) < 1e-4,
            "the pan is along the picture's axes"
        );
    }
}

#[test]
fn area_is_the_square_of_the_side_for_every_shape_and_scales_with_the_frame() {
    for shape in [Shape::Disc, Shape::Rectangle, Shape::Blob] {
        for (size, side) in [(512, 100.0), (256, 50.0), (1024, 200.0)] {
            let spec = TargetSpec { shape, side_px: 100.0, ..TargetSpec::default() };
            let scenario = Scenario { target: Some(spec), ..still() };
            let truth = Sequence::new(&scenario, size, 2).unwrap().truth(4);
            let side_seen = truth.area_px.sqrt();
            assert!((side_seen / side - 1.0).abs() < 0.005, "{shape:?} at {size}: side {side_seen}");
            assert!(truth.visible_share > 0.99, "{shape:?}: {}", truth.visible_share);
        }
    }
}

#[test]
fn visible_share_falls_as_the_target_leaves_the_frame() {
    let spec = TargetSpec { velocity: [40.0, 0.0], ..TargetSpec::default() };
    let scenario = Scenario { target: Some(spec), frames: 20, ..still() };
    let sequence = Sequence::new(&scenario, 512, 2).unwrap();
    let shares: Vec<f64> = (10..20).map(|t| sequence.truth(t).visible_share).collect();
    assert!(shares.is_sorted_by(|a, b| a >= b), "{shares:?}");
    assert_eq!((shares[0], shares[9]), (1.0, 0.0));
    for t in 10..20 {
        let truth = sequence.truth(t);
        assert_eq!(truth.position.is_some(), truth.visible_share >= LEAST_VISIBLE_SHARE);
        assert!(truth.centre.is_some());
    }
}

#[test]
fn occluder_hides_the_target_in_its_interval_and_not_long_after() {
    let scenario = with_target().into_iter().find(|s| s.name == "occlusion").unwrap();
    let scenario = Scenario { noise: 0.0, ..scenario };
    let mut with = Sequence::new(&scenario, 512, 5).unwrap();
    let empty = Scenario { target: None, occluder: None, ..scenario.clone() };
    let mut without = Sequence::new(&empty, 512, 5).unwrap();
    let (from, to) = scenario.occluder.unwrap();
    for t in from..to {
        let truth = with.truth(t);
        assert_eq!((truth.area_px, truth.position), (0.0, None), "frame {t}");
        assert!(truth.centre.is_some());
        assert_eq!(frame_of(&mut with, t), frame_of(&mut without, t), "frame {t}");
    }
    for t in [0, scenario.frames - 1] {
        assert!(with.truth(t).visible_share > 0.99, "frame {t}");
    }
}

#[test]
fn resting_target_moves_with_the_background() {
    let scenario = with_target().into_iter().find(|s| s.name == "stop_start").unwrap();
    let sequence = Sequence::new(&scenario, 256, 1).unwrap();
    for t in 0..scenario.frames {
        let rests = (8..16).contains(&t);
        let [x, y] = sequence.truth(t).relative_velocity;
        assert!((x.hypot(y) < 1e-9) == rests, "frame {t}: {x}, {y}");
    }
}

#[test]
fn following_camera_keeps_the_target_where_it_is() {
    let spec = TargetSpec { velocity: [9.0, -4.0], curve_deg: 6.0, ..TargetSpec::default() };
    let scenario = Scenario { camera_follows: true, target: Some(spec), ..still() };
    let sequence = Sequence::new(&scenario, 256, 1).unwrap();
    let place = sequence.truth(0).centre.unwrap();
    for t in 0..scenario.frames {
        let truth = sequence.truth(t);
        assert!(distance(truth.centre.unwrap(), place) < 1e-3);
        assert!(distance(truth.background, truth.relative_velocity.map(|v| -v)) < 1e-3);
    }
}
