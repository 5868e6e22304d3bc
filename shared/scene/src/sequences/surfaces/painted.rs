//! Textures painted stroke by stroke, the later over the earlier.

use std::f64::consts::PI;

use crate::random::Random;

use super::super::plane::Plane;
use super::noise::octaves;

/// Softens the outlines so that they do not alias, texels.
const OUTLINE_SIGMA: f64 = 0.8;
/// How often the average texel is painted over.
const LAYERS: f64 = 4.0;
/// Radii of leaves, texels.
const LEAF_RADII: [f64; 2] = [4.0, 40.0];
/// Radii of pebbles, texels.
const PEBBLE_RADII: [f64; 2] = [3.0, 12.0];
/// Blades of grass: length and half width, texels.
const BLADE_LENGTHS: [f64; 2] = [20.0, 60.0];
const BLADE_HALF_WIDTHS: [f64; 2] = [0.6, 1.3];

/// Discs with a density of r^-3 of their radii.
pub(super) fn dead_leaves(side: usize, random: &mut Random) -> Plane {
    let mut plane = Plane::uniform(side, side, 0.0);
    for _ in 0..disc_count(side, LEAF_RADII) {
        let (centre, radius) = random_disc(side, LEAF_RADII, random);
        let shade = random.gaussian() as f32;
        stamp(&mut plane, centre, radius, |[dx, dy], _| {
            (dx * dx + dy * dy <= radius * radius).then_some(shade)
        });
    }
    plane.blurred(OUTLINE_SIGMA)
}

/// Round stones with a bright side, a dark rim and a grain of their own.
pub(super) fn gravel(side: usize, random: &mut Random) -> Plane {
    let mut plane = Plane::uniform(side, side, -1.6);
    for _ in 0..disc_count(side, PEBBLE_RADII) {
        let (centre, radius) = random_disc(side, PEBBLE_RADII, random);
        let shade = 0.7 * random.gaussian();
        let flatness = 0.6 + 0.4 * random.unit();
        stamp(&mut plane, centre, radius, |[dx, dy], _| {
            let (x, y) = (dx / radius, dy / (radius * flatness));
            let square = x * x + y * y;
            // light from the upper left on a dome; the rim is in the shade of its neighbours
            let dome = (1.0 - square).max(0.0).sqrt();
            let grey = shade - 0.7 * (x + y) * square - 1.3 * (1.0 - dome) * square;
            (square <= 1.0).then_some(grey as f32)
        });
    }
    let mut plane = plane.blurred(OUTLINE_SIGMA);
    plane.add(&octaves(side, 1, 2, 0.0, random), 0.3);
    plane
}

/// Blades, darker at their foot, in tufts that lean together.
pub(super) fn grass(side: usize, random: &mut Random) -> Plane {
    let lean = octaves(side, 32, 64, 1.0, random);
    let mut plane = Plane::uniform(side, side, -1.0);
    let mean_area =
        (BLADE_LENGTHS[0] + BLADE_LENGTHS[1]) * (BLADE_HALF_WIDTHS[0] + BLADE_HALF_WIDTHS[1]) / 2.0;
    for _ in 0..(LAYERS * (side * side) as f64 / mean_area) as usize {
        let [x, y] = [random.unit() * side as f64, random.unit() * side as f64];
        let tuft = f64::from(lean.grey[y as usize % side * side + x as usize % side]);
        let length = between(BLADE_LENGTHS, random);
        let half_width = between(BLADE_HALF_WIDTHS, random);
        let slope = 0.35 * tuft + 0.3 * random.gaussian();
        let bend = 0.4 * random.gaussian() / length;
        let shade = 0.8 * random.gaussian();
        for step in 0..length as usize {
            let up = step as f64;
            let centre = [x + up * (slope + bend * up), y - up];
            let grey_here = (shade + 1.4 * (up / length - 0.5)) as f32;
            let half = half_width * (1.0 - 0.5 * up / length);
            stamp(&mut plane, centre, half + 0.5, |[dx, dy], _| {
                (dy.abs() <= 0.5 && dx.abs() <= half).then_some(grey_here)
            });
        }
    }
    plane.blurred(OUTLINE_SIGMA)
}

/// Discs whose radii have the density r^-3 that paint the plane over [`LAYERS`] times.
fn disc_count(side: usize, [least, most]: [f64; 2]) -> usize {
    let narrow = 1.0 - (least / most) * (least / most);
    let mean_area = 2.0 * PI * least * least * libm::log(most / least) / narrow;
    (LAYERS * (side * side) as f64 / mean_area) as usize
}

fn random_disc(side: usize, [least, most]: [f64; 2], random: &mut Random) -> ([f64; 2], f64) {
    let narrow = 1.0 - (least / most) * (least / most);
    let radius = least / (1.0 - random.unit() * narrow).sqrt();
    ([random.unit() * side as f64, random.unit() * side as f64], radius)
}

pub(super) fn between([least, most]: [f64; 2], random: &mut Random) -> f64 {
    least + (most - least) * random.unit()
}

/// Paints within `reach` of `centre` in x and in y: `paint` turns the offset from the centre and the texel's
/// number into its new grey, if it gets one.
pub(super) fn stamp(
    plane: &mut Plane,
    centre: [f64; 2],
    reach: f64,
    paint: impl Fn([f64; 2], usize) -> Option<f32>,
) {
    let span = |c: f64| (c - reach).ceil() as i64..=(c + reach).floor() as i64;
    for row in span(centre[1]) {
        let line = row.rem_euclid(plane.height as i64) as usize * plane.width;
        let dy = row as f64 - centre[1];
        for column in span(centre[0]) {
            let texel = line + column.rem_euclid(plane.width as i64) as usize;
            if let Some(grey) = paint([column as f64 - centre[0], dy], texel) {
                plane.grey[texel] = grey;
            }
        }
    }
}
