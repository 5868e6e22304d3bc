//! No single frame shows the vehicle; two frames do.
#![allow(clippy::unwrap_used)]

mod common;

use common::{Image, blurred, project, render};
use pursuit_scene::{Kind, Scene, SceneParameters, View};

/// A detector that knows the outline sees it only this much stronger than a place where there is none
/// (design notes on the simulator, section 3).
const MOST_RATIO: f64 = 1.3;

fn view(seed: u64) -> View {
    let mut view = View::looking_down([0.6, 0.0, 0.5], 0.37 * seed as f64, Kind::Vehicle);
    view.target_position = [0.63, 0.05];
    view.target_heading = 0.7 + seed as f64;
    view.frame = seed;
    view
}

/// Corners of the box's outline in the image: the convex hull of its eight projected corners.
fn outline(view: &View, place: [f64; 2]) -> Vec<[f64; 2]> {
    let (s, c) = view.target_heading.sin_cos();
    let mut points = Vec::new();
    for (x, y) in [(0.075, 0.05), (-0.075, 0.05), (-0.075, -0.05), (0.075, -0.05)] {
        for z in [0.0, 0.06] {
            points.push(project(view, [place[0] + c * x - s * y, place[1] + s * x + c * y, z]));
        }
    }
    let left =
        |o: [f64; 2], a: [f64; 2], b: [f64; 2]| (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0]);
    // gift wrapping
    let mut at = *points.iter().min_by(|a, b| a[0].total_cmp(&b[0])).unwrap();
    let mut hull: Vec<[f64; 2]> = vec![];
    while hull.first() != Some(&at) {
        hull.push(at);
        let others = points.iter().copied().filter(|&p| p != at);
        at = others.reduce(|best, p| if left(at, best, p) < 0.0 { p } else { best }).unwrap();
    }
    hull
}

/// Means along the outline of a vehicle at `place`: the magnitude of the gradient after a blur of one pixel, which is
/// the check of the design notes on the simulator, and the difference between the pixels 1.5 to each side, unblurred.
fn along_outline(image: &Image, view: &View, place: [f64; 2]) -> [f64; 2] {
    let smooth = blurred(image, 1.0);
    let corners = outline(view, place);
    let (mut sums, mut count) = ([0.0; 2], 0.0);
    for (i, p) in corners.iter().enumerate() {
        let q = corners[(i + 1) % corners.len()];
        let length = (q[0] - p[0]).hypot(q[1] - p[1]);
        let normal = [(q[1] - p[1]) / length, (p[0] - q[0]) / length];
        for step in 0..length as usize {
            let at = step as f64 / length;
            let [x, y] = [0, 1].map(|k| p[k] + at * (q[k] - p[k]));
            let change = |image: &Image, [dx, dy]: [f64; 2]| {
                image.between(x + dx, y + dy).unwrap() - image.between(x - dx, y - dy).unwrap()
            };
            let (across, along) = (change(&smooth, normal), change(&smooth, [normal[1], -normal[0]]));
            sums[0] += 0.5 * across.hypot(along);
            sums[1] += change(image, normal.map(|n| 1.5 * n)).abs();
            count += 1.0;
        }
    }
    sums.map(|sum| sum / count)
}

#[test]
fn outline_is_hardly_stronger_than_a_phantom_outline() {
    const SEEDS: u64 = 6;
    let (mut real, mut phantom) = ([0.0; 2], [0.0; 2]);
    for seed in 0..SEEDS {
        let mut scene = Scene::new(&SceneParameters { seed, texture_texels: 512, ..Default::default() });
        for turn in 0..4 {
            let mut view = view(seed);
            view.target_heading += f64::from(turn) * 0.8;
            view.target_position = [0.6 + 0.1 * f64::from(turn - 2), 0.05 * f64::from(turn)];
            let image = render(&mut scene, &view);
            let empty = render(&mut scene, &View { target_position: [30.0, 30.0], ..view });
            for (sums, image) in [(&mut real, &image), (&mut phantom, &empty)] {
                let means = along_outline(image, &view, view.target_position);
                sums.iter_mut().zip(means).for_each(|(sum, mean)| *sum += mean / (4.0 * SEEDS as f64));
            }
        }
    }
    let ratio = real[0] / phantom[0];
    println!("gradient along the outline {:.2}, phantom {:.2}, ratio {ratio:.3}", real[0], phantom[0]);
    println!(
        "sharp difference across it {:.1}, phantom {:.1}, ratio {:.3}",
        real[1],
        phantom[1],
        real[1] / phantom[1]
    );
    assert!(ratio < MOST_RATIO, "real {real:?}, phantom {phantom:?}");
}

#[test]
fn vehicle_and_table_have_the_same_mean_and_contrast() {
    let patch = |image: &Image, view: &View, place: [f64; 2], z: f64| {
        let [x, y] = project(view, [place[0], place[1], z]).map(|v| v.round() as usize);
        let values: Vec<f64> = (0..33 * 33).map(|k| image.at(x - 16 + k % 33, y - 16 + k / 33)).collect();
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        (mean, values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / values.len() as f64)
    };
    let (mut roofs, mut tables) = ((0.0, 0.0), (0.0, 0.0));
    const SEEDS: u64 = 16;
    for seed in 0..SEEDS {
        let parameters = SceneParameters { seed, texture_texels: 512, ..Default::default() };
        let mut scene = Scene::new(&parameters);
        let view = view(seed);
        let image = render(&mut scene, &view);
        let roof = patch(&image, &view, view.target_position, 0.06);
        roofs = (roofs.0 + roof.0, roofs.1 + roof.1);
        let empty = render(&mut scene, &View { target_position: [30.0, 30.0], ..view });
        for place in [[0.5, -0.15], [0.75, -0.2], [0.45, 0.2], [0.63, 0.05]] {
            let table = patch(&empty, &view, place, 0.0);
            tables = (tables.0 + table.0 / 4.0, tables.1 + table.1 / 4.0);
        }
    }
    let n = SEEDS as f64;
    let (roof_sd, table_sd) = ((roofs.1 / n).sqrt(), (tables.1 / n).sqrt());
    println!("roof {:.1} ± {roof_sd:.1}, table {:.1} ± {table_sd:.1}", roofs.0 / n, tables.0 / n);
    // the mean of a patch this small has a deviation of about 16 grey levels, so the mean of 16 of 4
    assert!((roofs.0 - tables.0).abs() / n < 12.0);
    assert!((roof_sd / table_sd - 1.0).abs() < 0.15);
}

#[test]
fn difference_of_two_frames_shows_the_vehicle_that_moved() {
    let mut scene = Scene::new(&SceneParameters::default());
    let before = view(0);
    let mut after = before;
    after.target_position[0] += 0.004;
    after.frame += 1;
    let (a, b) = (render(&mut scene, &before), render(&mut scene, &after));
    let [x, y] = project(&before, [0.63, 0.05, 0.06]).map(|v| v as usize);
    let mean = |x0: usize, y0: usize| {
        (0..441)
            .map(|k| (x0 + k % 21, y0 + k / 21))
            .map(|(x, y)| (a.at(x, y) - b.at(x, y)).abs())
            .sum::<f64>()
            / 441.0
    };
    let (vehicle, table) = (mean(x - 10, y - 10), mean(100, 100));
    assert!(vehicle > 3.0 * table, "on the vehicle {vehicle}, on the table {table}");
}
