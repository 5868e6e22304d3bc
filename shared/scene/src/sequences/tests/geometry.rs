use super::*;

#[test]
fn pan_by_whole_pixels_shifts_the_picture_exactly() {
    let size = 128;
    let scenario = Scenario { pan: [3.0, -2.0], ..still() };
    let mut sequence = Sequence::new(&scenario, size, 7).unwrap();
    let (before, now) = (frame_of(&mut sequence, 3), frame_of(&mut sequence, 4));
    for y in 0..size - 2 {
        for x in 3..size {
            assert_eq!(now[y * size + x], before[(y + 2) * size + x - 3], "pixel {x}, {y}");
        }
    }
    assert_eq!(sequence.truth(4).background, [3.0, -2.0]);
}

/// Mean square of the difference between a patch of one frame and the place in the next where the geometry puts
/// each of its pixels, with an error added.
fn residual(sequence: &Sequence, frames: (&[f64], &[f64]), t: usize, at: [f64; 2], error: [f64; 2]) -> f64 {
    let (before, now) = (sequence.paths.pose(t as f64 - 1.0), sequence.paths.pose(t as f64));
    let mut sum = 0.0;
    for (dx, dy) in (-12..=12).flat_map(|dx| (-12..=12).map(move |dy| (dx, dy))) {
        let from = [at[0] + f64::from(dx), at[1] + f64::from(dy)];
        let to = now.image(before.world(from));
        let seen = between(frames.1, sequence.size(), [to[0] + error[0], to[1] + error[1]]);
        let step = seen - between(frames.0, sequence.size(), from);
        sum += step * step;
    }
    sum / 625.0
}

#[test]
fn texture_moves_as_the_camera_s_geometry_says_everywhere_in_the_picture() {
    let base = Scenario { texture: Texture::Noise(1.5), pan: [2.5, -1.5], ..still() };
    let scenarios = [
        Scenario { rotation_deg: 2.0, ..base.clone() },
        Scenario { zoom: 0.03, ..base.clone() },
        Scenario { slant: 1e-4, ..base.clone() },
        Scenario { rotation_deg: -1.0, zoom: -0.02, slant: -1e-4, jitter_px: 2.0, ..base },
    ];
    for (n, scenario) in scenarios.iter().enumerate() {
        let size = 256;
        let mut sequence = Sequence::new(scenario, size, 2).unwrap();
        let t = 7;
        let (before, now) = (frame_of(&mut sequence, t - 1), frame_of(&mut sequence, t));
        for at in [[40.0, 40.0], [210.0, 50.0], [127.0, 127.0], [60.0, 205.0], [205.0, 205.0]] {
            let residual = |error| residual(&sequence, (&before, &now), t, at, error);
            let right = residual([0.0, 0.0]);
            for error in [[0.4, 0.0], [-0.4, 0.0], [0.0, 0.4], [0.0, -0.4]] {
                let wrong = residual(error);
                assert!(1.5 * right < wrong, "scenario {n} at {at:?}: {right}, with {error:?}: {wrong}");
            }
        }
        let middle = [127.5, 127.5];
        let pose = |t: usize| sequence.paths.pose(t as f64);
        let moved = difference(pose(t).image(pose(t - 1).world(middle)), middle);
        assert!(distance(moved, sequence.truth(t).background) < 1e-9);
    }
}

#[test]
fn image_and_world_map_onto_each_other_and_magnification_is_the_map_s_determinant() {
    let scenario = Scenario { rotation_deg: 3.0, zoom: 0.02, slant: 1e-4, ..still() };
    let sequence = Sequence::new(&scenario, 256, 1).unwrap();
    for t in [0.0, 2.4, 8.0] {
        let pose = sequence.paths.pose(t);
        let (mut xs, mut ys) = (vec![0.0; 256], vec![0.0; 256]);
        pose.world_row(31.25, -0.25, 0.5, &mut xs, &mut ys);
        for (i, world) in xs.into_iter().zip(ys).map(|(x, y)| [x, y]).enumerate().step_by(17) {
            let image = [0.5 * i as f64 - 0.25, 31.25];
            assert!(distance(pose.image(world), image) < 1e-9);
            assert!(distance(pose.world(image), world) < 1e-9);
            let step = 1e-4;
            let across = difference(pose.image([world[0] + step, world[1]]), image);
            let down = difference(pose.image([world[0], world[1] + step]), image);
            let determinant = (across[0] * down[1] - across[1] * down[0]) / (step * step);
            assert!((pose.magnification(world) / determinant - 1.0).abs() < 1e-4);
        }
    }
}

#[test]
fn slant_squeezes_frames_of_every_size_alike() {
    let scenario = Scenario { slant: 1e-4, ..still() };
    let border = |size: usize| {
        let pose = Sequence::new(&scenario, size, 1).unwrap().paths.pose(8.0);
        pose.magnification(pose.world([size as f64 - 0.5, 0.5 * (size - 1) as f64]))
    };
    assert!((border(128) - 1.0).abs() > 0.2);
    assert!((border(128) / border(512) - 1.0).abs() < 1e-9);
}

#[test]
fn exposure_is_the_mean_over_the_way_of_the_picture() {
    let (size, t) = (128, 4);
    let sharp = Scenario { pan: [5.0, 0.0], ..still() };
    let one = frame(&sharp, size, 3, t);
    let blurred = frame(&Scenario { exposure: 1.0, ..sharp }, size, 3, t);
    for y in 0..size {
        for x in 2..size - 2 {
            let mean = one[y * size + x - 2..=y * size + x + 2].iter().sum::<f64>() / 5.0;
            let seen = blurred[y * size + x];
            assert!((seen - mean).abs() <= 1.0, "pixel {x}, {y}: {seen}, the way's mean is {mean}");
        }
    }
}

#[test]
fn strips_of_a_nearer_plane_move_faster_by_the_parallax() {
    let size = 512;
    let scenario = Scenario { pan: [4.0, 0.0], parallax: 0.5, ..still() };
    let mut sequence = Sequence::new(&scenario, size, 3).unwrap();
    let (before, now) = (frame_of(&mut sequence, 4), frame_of(&mut sequence, 5));
    let share_moved_by = |shift: usize| {
        let columns =
            (0..size - 8).filter(|x| (0..size).all(|y| before[y * size + x] == now[y * size + x + shift]));
        columns.count() as f64 / (size - 8) as f64
    };
    let (ground, strips) = (share_moved_by(4), share_moved_by(6));
    assert!((strips - 50.0 / 260.0).abs() < 0.11, "{strips} of the columns moved by 6 px");
    assert!(ground + strips > 0.95, "{ground} of the columns moved by 4 px");
}

#[test]
fn shake_has_the_deviation_asked_for() {
    let scenario = Scenario { jitter_px: 3.0, frames: 400, ..still() };
    let sequence = Sequence::new(&scenario, 64, 1).unwrap();
    let steps: Vec<f64> = (1..400).flat_map(|t| sequence.truth(t).background).collect();
    let (_, deviation) = mean_and_deviation(&steps);
    // the difference of two independent places
    assert!((deviation / (3.0 * 2f64.sqrt()) - 1.0).abs() < 0.1, "{deviation}");
}
