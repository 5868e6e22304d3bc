//! The textures of [`Texture`] as periodic planes.

mod noise;
mod painted;
mod patterns;
mod photograph;

use crate::random::Random;

use super::plane::Plane;
use super::scenario::Texture;

/// Mean grey of every texture.
pub(super) const MEAN_GREY: f64 = 120.0;
/// Grey levels of a texture before light and noise.
const GREY_RANGE: [f32; 2] = [4.0, 251.0];
/// Places tried for a target that must not be cut from a flat one.
const CANDIDATES: usize = 24;

/// A texture with the given contrast, grey levels rms; periodic after `side` texels, a power of two, photographs
/// after twice their own sides.
pub(super) fn surface(texture: &Texture, contrast: f64, side: usize, random: &mut Random) -> Plane {
    let raw = match texture {
        Texture::Noise(exponent) => noise::fractal(side, *exponent, random),
        Texture::DeadLeaves => painted::dead_leaves(side, random),
        Texture::Gravel => painted::gravel(side, random),
        Texture::Grass => painted::grass(side, random),
        Texture::Checker => patterns::checker(side),
        Texture::Brick => patterns::brick(side, random),
        Texture::Flat => patterns::flat(side, random),
        Texture::TwoTextures => patterns::two_textures(side, random),
        Texture::Photograph(photograph) => photograph::tiled(photograph),
    };
    let mut plane = raw.standardised();
    let [least, most] = GREY_RANGE;
    let (factor, mean) = (contrast as f32, MEAN_GREY as f32);
    plane.grey.iter_mut().for_each(|g| *g = (*g * factor + mean).clamp(least, most));
    plane
}

/// Where in `plane` a target of `side_px` is cut from: far from `here`, and from a textured place where the
/// texture has others.
pub(super) fn cut(
    plane: &Plane,
    texture: &Texture,
    here: [f64; 2],
    side_px: f64,
    random: &mut Random,
) -> [f64; 2] {
    let periods = [plane.width as f64, plane.height as f64];
    let mut place =
        || [0, 1].map(|k| (here[k] + periods[k] * (0.3 + 0.4 * random.unit())).rem_euclid(periods[k]));
    if !matches!(texture, Texture::Flat | Texture::TwoTextures) {
        return place();
    }
    let half = (0.4 * side_px) as usize + 1;
    let mut best = (f64::NEG_INFINITY, [0.0; 2]);
    for _ in 0..CANDIDATES {
        let candidate = place();
        let roughness = plane.roughness_near(candidate, half);
        if roughness > best.0 {
            best = (roughness, candidate);
        }
    }
    best.1
}
