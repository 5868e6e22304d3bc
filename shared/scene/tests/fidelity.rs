//! Motion below a pixel is rendered as motion: what vision measures is what moved.
#![allow(clippy::unwrap_used)]

mod common;

use common::{Image, SMOOTH_PX, about, blurred, noiseless, product, render};
use pursuit_scene::{Kind, Scene, SceneParameters, View};
use std::f64::consts::FRAC_PI_2;

/// Rows and columns left out at the border.
const BORDER: usize = 24;

/// The affine motion (a0 + a1 x + a2 y, b0 + b1 x + b2 y; pixels from the frame's middle) that explains the change
/// from `a` to `b` best: linear least squares with the gradient of their mean, differentiated to fourth order.
fn affine_motion(a: &Image, b: &Image) -> [f64; 6] {
    let (a, b) = (blurred(a, SMOOTH_PX), blurred(b, SMOOTH_PX));
    let mut normal = [[0.0; 7]; 6];
    for y in BORDER..a.height - BORDER {
        for x in BORDER..a.width - BORDER {
            let mean = |x: usize, y: usize| 0.5 * (a.at(x, y) + b.at(x, y));
            let fourth = |m2: f64, m1: f64, p1: f64, p2: f64| (m2 - 8.0 * m1 + 8.0 * p1 - p2) / 12.0;
            let gx = fourth(mean(x - 2, y), mean(x - 1, y), mean(x + 1, y), mean(x + 2, y));
            let gy = fourth(mean(x, y - 2), mean(x, y - 1), mean(x, y + 1), mean(x, y + 2));
            let (u, v) = (x as f64 - 255.5, y as f64 - 255.5);
            let row = [gx, gx * u, gx * v, gy, gy * u, gy * v];
            let change = a.at(x, y) - b.at(x, y);
            for i in 0..6 {
                for j in 0..6 {
                    normal[i][j] += row[i] * row[j];
                }
                normal[i][6] += row[i] * change;
            }
        }
    }
    solved(normal)
}

fn solved(mut m: [[f64; 7]; 6]) -> [f64; 6] {
    for i in 0..6 {
        let pivot = m[i];
        for (k, row) in m.iter_mut().enumerate() {
            if k != i {
                let factor = row[i] / pivot[i];
                row.iter_mut().zip(&pivot).for_each(|(r, p)| *r -= factor * p);
            }
        }
    }
    [0, 1, 2, 3, 4, 5].map(|i| m[i][6] / m[i][i])
}

fn empty_table(position: [f64; 3]) -> View {
    let mut view = View::looking_down(position, 0.3, Kind::Vehicle);
    view.target_position = [30.0, 30.0];
    view
}

/// The estimator itself, on sums of waves that are evaluated and not rendered.
#[test]
fn estimator_reads_an_analytic_shift_within_a_third_of_a_percent() {
    let image = |shift: f64| {
        let mut grey = vec![128.0; 512 * 512];
        for k in 1..40 {
            let angle = f64::from(k) * 2.4;
            let frequency = 0.02 + 0.035 * f64::from(k);
            let (c, s) = (frequency * angle.cos(), frequency * angle.sin());
            for (i, g) in grey.iter_mut().enumerate() {
                *g += 40.0 / f64::from(k)
                    * (c * ((i % 512) as f64 - shift) + s * (i / 512) as f64 + angle).cos();
            }
        }
        Image { width: 512, height: 512, grey }
    };
    let measured = affine_motion(&image(0.0), &image(0.25))[0];
    assert!((measured / 0.25 - 1.0).abs() < 0.0033, "read {measured}");
}

/// Without noise: with it, one pair of frames alone has a standard error of one percent here.
#[test]
fn quarter_pixel_shift_is_within_one_and_a_half_percent() {
    for (name, parameters) in [
        ("fast", noiseless()),
        ("reference", SceneParameters { noise_sigma: 0.0, ..SceneParameters::reference() }),
    ] {
        let mut scene = Scene::new(&parameters);
        let metres = 0.25 * 0.5 / 256.0;
        for (direction, angle) in [("x", 0.0), ("y", FRAC_PI_2), ("diagonal", 0.7)] {
            let mut view = empty_table([0.6, 0.05, 0.5]);
            let first = render(&mut scene, &view);
            // the camera's x axis points along (cos 0.3, sin 0.3)
            let along = 0.3 + angle;
            view.camera_position[0] += metres * f64::cos(along);
            view.camera_position[1] += metres * f64::sin(along);
            view.frame = 1;
            let second = render(&mut scene, &view);
            let motion = affine_motion(&first, &second);
            let size = motion[0].hypot(motion[3]);
            println!("{name}, {direction}: {size:.5} px for 0.25 px ({:+.2} %)", 400.0 * size - 100.0);
            assert!((size / 0.25 - 1.0).abs() < 0.015, "{name}, {direction}: {motion:?}");
        }
    }
}

#[test]
fn tenth_of_a_degree_of_rotation_is_within_one_and_a_half_percent() {
    let mut scene = Scene::new(&noiseless());
    let mut view = empty_table([0.6, 0.05, 0.5]);
    let first = render(&mut scene, &view);
    let angle = 0.1f64.to_radians();
    view.camera_rotation = product(view.camera_rotation, about(2, angle));
    let motion = affine_motion(&first, &render(&mut scene, &view));
    // the camera turns by +angle about z, the image by -angle: x' = x + angle y
    let rotation = 0.5 * (motion[2] - motion[4]);
    println!("rotation: {:+.2} %", 100.0 * rotation / angle - 100.0);
    assert!((rotation / angle - 1.0).abs() < 0.015, "{motion:?} for {angle}");
}

#[test]
fn millimetre_of_height_is_within_one_and_a_half_percent() {
    let mut scene = Scene::new(&noiseless());
    let first = render(&mut scene, &empty_table([0.6, 0.05, 0.5]));
    let second = render(&mut scene, &empty_table([0.6, 0.05, 0.499]));
    let motion = affine_motion(&first, &second);
    let growth = 0.5 * (motion[1] + motion[5]);
    let wanted = 0.5 / 0.499 - 1.0;
    println!("height: {:+.2} %", 100.0 * growth / wanted - 100.0);
    assert!((growth / wanted - 1.0).abs() < 0.015, "{motion:?} for {wanted}");
}
