//! Targets appear where the pinhole equation says.
#![allow(clippy::unwrap_used)]

mod common;

use common::{Image, SMOOTH_PX, about, blurred, noiseless, product, project, render};
use pursuit_scene::{Glare, Kind, Scene, SceneParameters, View};

/// Poses of the camera: position, turn about the vertical, tilts about the camera's own axes.
const POSES: [([f64; 3], f64, f64, f64); 6] = [
    ([0.63, 0.0, 0.5], 0.0, 0.0, 0.0),
    ([0.63, 0.0, 0.5], 2.1, 0.0, 0.0),
    ([0.50, -0.20, 0.42], -0.8, 0.0, 0.0),
    // a tool mounted off its axis: tilted and turned
    ([0.60, 0.10, 0.5], 0.4, 0.15, -0.1),
    ([0.75, 0.05, 0.6], -2.6, -0.25, 0.2),
    ([0.40, 0.30, 0.8], 1.2, 0.1, 0.3),
];

fn pose((position, yaw, tilt_x, tilt_y): ([f64; 3], f64, f64, f64), kind: Kind) -> View {
    let mut view = View::looking_down(position, yaw, kind);
    view.camera_rotation = product(product(view.camera_rotation, about(0, tilt_x)), about(1, tilt_y));
    view
}

/// Centroid of what is brighter than the cloth, weighted by how much.
fn bright_centroid(image: &Image) -> [f64; 2] {
    let (mut sum, mut x_sum, mut y_sum) = (0.0, 0.0, 0.0);
    for y in 0..image.height {
        for x in 0..image.width {
            let weight = (image.at(x, y) - 60.0).max(0.0);
            sum += weight;
            x_sum += weight * x as f64;
            y_sum += weight * y as f64;
        }
    }
    [x_sum / sum, y_sum / sum]
}

/// Centroid of a disc's image: the mean over the disc's points, each with the area of its image.
fn disc_centroid(view: &View, radius: f64) -> [f64; 2] {
    let (mut sum, mut x_sum, mut y_sum) = (0.0, 0.0, 0.0);
    for i in -40..=40 {
        for j in -40..=40 {
            let (dx, dy) = (f64::from(i) / 40.0, f64::from(j) / 40.0);
            if dx * dx + dy * dy > 1.0 {
                continue;
            }
            let at = |du: f64, dv: f64| {
                let [x, y] = view.target_position;
                project(view, [x + radius * dx + du, y + radius * dy + dv, 0.0])
            };
            let (p, a, b) = (at(0.0, 0.0), at(1e-6, 0.0), at(0.0, 1e-6));
            let area = ((a[0] - p[0]) * (b[1] - p[1]) - (a[1] - p[1]) * (b[0] - p[0])).abs();
            sum += area;
            x_sum += area * p[0];
            y_sum += area * p[1];
        }
    }
    [x_sum / sum, y_sum / sum]
}

#[test]
fn disc_is_within_a_twentieth_of_a_pixel_of_its_projection() {
    let mut scene = Scene::new(&noiseless());
    let mut worst: f64 = 0.0;
    for parameters in POSES {
        for offset in [[0.0, 0.0], [0.083, -0.0417], [-0.1213, 0.0931]] {
            let mut view = pose(parameters, Kind::Blob);
            view.target_position = [0, 1].map(|i| view.camera_position[i] + offset[i]);
            let seen = bright_centroid(&render(&mut scene, &view));
            let wanted = disc_centroid(&view, 0.025);
            let error = (seen[0] - wanted[0]).hypot(seen[1] - wanted[1]);
            worst = worst.max(error);
            assert!(error < 0.05, "{view:?}: seen {seen:?}, projected {wanted:?}");
        }
    }
    println!("largest error of the disc's centroid: {worst:.4} px");
}

/// The pixels that the vehicle changes: those where the frame differs from that of the empty table.
fn silhouette(view: &View) -> Vec<bool> {
    let mut scene = Scene::new(&noiseless());
    let with = render(&mut scene, view);
    let without = render(&mut scene, &View { target_position: [30.0, 30.0], ..*view });
    with.grey.iter().zip(&without.grey).map(|(a, b)| (a - b).abs() > 1.5).collect()
}

#[test]
fn vehicle_covers_the_projection_of_its_box_and_nothing_else() {
    for parameters in POSES {
        let mut view = pose(parameters, Kind::Vehicle);
        view.target_position = [view.camera_position[0] + 0.06, view.camera_position[1] - 0.1];
        view.target_heading = 0.9;
        let (s, c) = view.target_heading.sin_cos();
        let point = |x: f64, y: f64, z: f64| {
            let [px, py] = view.target_position;
            project(&view, [px + c * x - s * y, py + s * x + c * y, z])
        };
        // points of all six faces, densely
        let mut inside = vec![false; 512 * 512];
        let at = |i: i32| f64::from(i) / 100.0;
        for i in -100..=100 {
            for j in -100..=100 {
                for k in [-1.0, 1.0] {
                    let (u, v) = (at(i), at(j));
                    for (x, y, z) in [(u, v, k), (k, u, v), (u, k, v)] {
                        let [px, py] = point(0.075 * x, 0.05 * y, 0.03 + 0.03 * z);
                        inside[py.round() as usize * 512 + px.round() as usize] = true;
                    }
                }
            }
        }
        let seen = silhouette(&view);
        let near = |x: usize, y: usize| (y - 2..=y + 2).any(|v| (x - 2..=x + 2).any(|u| inside[v * 512 + u]));
        let (mut covered, mut total) = (0, 0);
        for y in 2..510 {
            for x in 2..510 {
                let here = y * 512 + x;
                assert!(!seen[here] || near(x, y), "{view:?}: pixel {x}, {y} changed far from the box");
                total += usize::from(inside[here]);
                covered += usize::from(inside[here] && seen[here]);
            }
        }
        let share = f64::from(covered as u32) / f64::from(total as u32);
        assert!(total > 2000 && share > 0.9, "{view:?}: {covered} of {total}");
    }
}

#[test]
fn roof_of_the_moving_vehicle_moves_with_its_own_parallax() {
    // the camera moves: table points shift by f/0.5 per metre, roof points by f/0.44
    let mut scene = Scene::new(&noiseless());
    let shift = |scene: &mut Scene, dx: f64, window: (usize, usize)| {
        let mut view = View::looking_down([0.6, 0.0, 0.5], 0.0, Kind::Vehicle);
        view.target_heading = 0.2;
        view.target_position = [0.6, 0.0];
        let a = blurred(&render(scene, &view), SMOOTH_PX);
        view.camera_position[0] += dx;
        let b = blurred(&render(scene, &view), SMOOTH_PX);
        common_shift(&a, &b, window)
    };
    let dx = 0.5 / 256.0 * 0.2;
    let roof = shift(&mut scene, dx, (240, 272));
    let table = shift(&mut scene, dx, (60, 160));
    let ratio = roof / table;
    assert!((ratio - 0.5 / 0.44).abs() < 0.02, "roof {roof}, table {table}, ratio {ratio}");
}

/// Shift along x of a square window by least squares on the mean gradient.
fn common_shift(a: &Image, b: &Image, (from, to): (usize, usize)) -> f64 {
    let (mut num, mut den) = (0.0, 0.0);
    for y in from..to {
        for x in from..to {
            let mean = |x: usize| 0.5 * (a.at(x, y) + b.at(x, y));
            let gradient = (mean(x - 2) - 8.0 * mean(x - 1) + 8.0 * mean(x + 1) - mean(x + 2)) / 12.0;
            num += gradient * (b.at(x, y) - a.at(x, y));
            den += gradient * gradient;
        }
    }
    -num / den
}

#[test]
fn no_border_shows_anywhere_within_a_metre_and_a_half() {
    for parameters in [noiseless(), SceneParameters { noise_sigma: 0.0, ..SceneParameters::reference() }] {
        let mut scene = Scene::new(&parameters);
        for i in 0..24 {
            let angle = f64::from(i) * std::f64::consts::TAU / 24.0;
            let tilt = if i % 2 == 0 { 0.0 } else { 0.3 };
            for radius in [0.2, 0.9, 1.6] {
                let position = [radius * angle.cos(), radius * angle.sin(), 0.5];
                let mut view = pose((position, angle, tilt, 0.0), Kind::Vehicle);
                view.target_position = [0.6, 0.0];
                let image = render(&mut scene, &view);
                // leaves are within 58 to 198
                let outside = image.grey.iter().filter(|&&g| !(50.0..=206.0).contains(&g)).count();
                assert_eq!(outside, 0, "{view:?}");
                // void would be flat: every block larger than the largest leaf has contrast
                for block in 0..16 {
                    let (x0, y0) = (block % 4 * 128, block / 4 * 128);
                    let values: Vec<f64> = (0..16384).map(|k| image.at(x0 + k % 128, y0 + k / 128)).collect();
                    let mean = values.iter().sum::<f64>() / 16384.0;
                    let sd = (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / 16384.0).sqrt();
                    assert!(sd > 8.0, "{view:?}: block at {x0}, {y0} has deviation {sd}");
                }
            }
        }
    }
}

#[test]
fn a_glare_is_where_it_is_said_to_be_and_changes_nothing_else() {
    let mut scene = Scene::new(&noiseless());
    for kind in [Kind::Blob, Kind::Vehicle] {
        let view = View::looking_down([0.6, 0.1, 0.5], 0.4, kind);
        let glare = Glare { centre_px: [130.5, 300.25], radius_px: 25.0 };
        let clear = render(&mut scene, &view);
        let glaring = render(&mut scene, &View { glare: Some(glare), ..view });
        for y in 0..512 {
            for x in 0..512 {
                let distance = (x as f64 - 130.5).hypot(y as f64 - 300.25);
                // The rim is some pixels of lens blur.
                if distance < 21.0 {
                    assert_eq!(glaring.at(x, y), 255.0, "{x} {y}");
                } else if distance > 29.0 {
                    assert_eq!(glaring.at(x, y), clear.at(x, y), "{x} {y}");
                }
            }
        }
        // What was drawn before leaves no trace.
        assert_eq!(render(&mut scene, &view).grey, clear.grey);
    }
}

#[test]
fn a_longer_lens_shows_the_middle_enlarged() {
    let mut scene = Scene::new(&noiseless());
    let mut view = View::looking_down([0.6, 0.1, 0.5], 0.4, Kind::Blob);
    view.target_position = [0.65, 0.06];
    let usual = bright_centroid(&render(&mut scene, &view));
    view.focal_px = 512.0;
    let long = bright_centroid(&render(&mut scene, &view));
    for axis in 0..2 {
        let expected = 255.5 + 2.0 * (usual[axis] - 255.5);
        assert!((long[axis] - expected).abs() < 0.1, "{long:?}, {usual:?}");
    }
}

#[test]
fn above_the_horizon_and_below_the_table_there_is_a_flat_grey() {
    let mut scene = Scene::new(&noiseless());
    let level = pose(([0.6, 0.0, 0.5], 0.0, std::f64::consts::FRAC_PI_2, 0.0), Kind::Vehicle);
    let image = render(&mut scene, &View { target_position: [5.0, 5.0], ..level });
    let flat = |rows: std::ops::Range<usize>| rows.clone().all(|y| (0..512).all(|x| image.at(x, y) == 128.0));
    assert!(flat(0..200) != flat(312..512), "one half is sky");
    let mut below = View::looking_down([0.6, 0.0, -0.2], 0.0, Kind::Blob);
    below.target_position = [0.6, 0.0];
    assert!(render(&mut scene, &below).grey.iter().all(|&g| g == 128.0));
}
