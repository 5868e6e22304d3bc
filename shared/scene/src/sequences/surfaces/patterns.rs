//! Textures that are built: regular ones, and those of regions that differ.

use crate::random::Random;

use super::super::plane::Plane;
use super::noise::octaves;
use super::painted::{between, dead_leaves, stamp};

const CHECK_TEXELS: usize = 16;
const BRICK_TEXELS: [usize; 2] = [64, 32];
/// Width of the mortar, texels.
const MORTAR_TEXELS: usize = 5;
/// Flat objects: radii, texels, and how many texels there are for each object.
const OBJECT_RADII: [f64; 2] = [35.0, 110.0];
const TEXELS_PER_OBJECT: usize = 170 * 170;
/// Spacing of the struts in the textured region, texels.
const STRUT_TEXELS: usize = 32;

/// Squares of -1 and 1.
pub(super) fn checker(side: usize) -> Plane {
    let sign =
        |x: usize, y: usize| if (x / CHECK_TEXELS + y / CHECK_TEXELS).is_multiple_of(2) { -1.0 } else { 1.0 };
    Plane::from_fn(side, side, sign).blurred(1.0)
}

/// Bricks in courses, each shifted by half a brick.
pub(super) fn brick(side: usize, random: &mut Random) -> Plane {
    let [long, high] = BRICK_TEXELS;
    let per_course = side / long;
    let shades: Vec<f32> = (0..per_course * (side / high)).map(|_| 0.6 * random.gaussian() as f32).collect();
    let wall = Plane::from_fn(side, side, |x, y| {
        let course = y / high;
        let along = (x + course % 2 * long / 2) % side;
        if y % high < MORTAR_TEXELS || along % long < MORTAR_TEXELS {
            return 1.6;
        }
        shades[course * per_course + along / long] - 0.6
    });
    let mut wall = wall.blurred(0.9);
    wall.add(&octaves(side, 1, 8, 0.6, random), 0.35);
    wall
}

/// Dark with soft gradients, on it smooth round things with a rim, a few of them textured.
pub(super) fn flat(side: usize, random: &mut Random) -> Plane {
    let mut plane = octaves(side, 64, 64, 1.0, random);
    plane.grey.iter_mut().for_each(|g| *g *= 0.12);
    let grain = octaves(side, 1, 8, 0.7, random);
    for _ in 0..side * side / TEXELS_PER_OBJECT {
        let centre = [random.unit() * side as f64, random.unit() * side as f64];
        let radius = between(OBJECT_RADII, random);
        let flatness = between([0.6, 1.0], random);
        // most things are dark, some are bright
        let bright = random.unit();
        let shade = if bright < 0.35 { between([0.9, 2.0], random) } else { between([-0.6, 0.5], random) };
        let slope = [between([-0.5, 0.5], random), between([-0.5, 0.5], random)];
        let roughness = if random.unit() < 0.3 { 0.5 } else { 0.0 };
        let rim = 1.0 - between([3.0, 7.0], random) / radius;
        stamp(&mut plane, centre, radius, |[dx, dy], texel| {
            let (x, y) = (dx / radius, dy / (radius * flatness));
            let distance = (x * x + y * y).sqrt();
            let edge = if distance > rim { 0.5 } else { 0.0 };
            let grey = (shade + slope[0] * x + slope[1] * y + edge) as f32 + roughness * grain.grey[texel];
            (distance <= 1.0).then_some(grey)
        });
    }
    let mut plane = plane.blurred(1.0);
    plane.add(&grain, 0.012);
    plane
}

/// Bright sky with soft clouds; regions of small discs and struts before it.
pub(super) fn two_textures(side: usize, random: &mut Random) -> Plane {
    let cloud = octaves(side, 16, 64, 1.3, random);
    let regions = octaves(side, 64, 64, 1.0, random);
    let mut rough = dead_leaves(side, random).standardised();
    let strut = |x: usize, y: usize| {
        let near = |v: usize| v % STRUT_TEXELS < 3;
        if near(x) || near(x + y) || near(x + side - y) { 1.6 } else { 0.0 }
    };
    rough.add(&Plane::from_fn(side, side, strut).blurred(0.8), 1.0);
    let shares = regions.grey.iter().map(|r| ((r - 0.35) * 8.0).clamp(0.0, 1.0));
    let greys = cloud.grey.iter().zip(&rough.grey).zip(shares);
    let grey = greys.map(|((c, r), share)| (1.0 - share) * (0.8 + 0.12 * c) + share * (0.8 * r - 0.9));
    Plane { width: side, height: side, grey: grey.collect() }
}
