//! A texture's Gaussian-prefiltered levels, and which of them a camera at a given distance looks at.
//!
//! Level k has texels of 2^k base texels and is blurred with a Gaussian of c of its own texels (c from
//! [`Profile`](crate::Profile)). The level whose blur is half a pixel is what lens and pixel aperture would
//! have made of the scene; bilinear interpolation within it is then nearly free of aliasing.

use crate::texture::Torus;
use crate::warp::ROUNDING;

/// Blur of lens and pixel aperture together, standard deviation in pixels.
pub(crate) const PSF_SIGMA_PX: f64 = 0.5;
/// Levels of a texture: three doublings of the working distance.
const LEVELS: usize = 4;
/// Two levels are blended where the wanted level lies within this of half way between them, in octaves.
/// Elsewhere one level is locked: changing it would look like motion. 0.1 is 7 % of the distance.
const BLEND_OCTAVES: f64 = 0.1;
/// The Gaussian is cut off after so many standard deviations.
const CUT_SIGMAS: f64 = 4.0;

/// One level. Texel i's centre is at i * `texel_m`.
pub(crate) struct Level {
    /// Texels per side, a power of two.
    pub(crate) side: usize,
    /// Side of a texel, metres.
    pub(crate) texel_m: f64,
    /// Each texel with its neighbours to the right, below, and below right in the bytes from low to high, so that
    /// one load serves a bilinear look-up.
    pub(crate) quads: Vec<u32>,
}

/// All levels of one texture.
pub(crate) struct Levels {
    levels: Vec<Level>,
    /// Blur of level 0, metres.
    base_sigma_m: f64,
}

/// One level, or two with the share of the second.
pub(crate) struct Choice<'a> {
    pub(crate) level: &'a Level,
    pub(crate) blend: Option<(&'a Level, f32)>,
}

impl Levels {
    /// Filters `torus`, whose texels are `texel_m` wide, with `prefilter_texels` texels of blur on each level.
    pub(crate) fn new(torus: &Torus, texel_m: f64, prefilter_texels: f64) -> Self {
        let base = Plane { side: torus.side, grey: &torus.grey };
        let mut image = base.blurred(prefilter_texels, 1);
        let mut levels = Vec::with_capacity(LEVELS);
        for k in 0..LEVELS {
            let grey: Vec<u8> = image.grey.iter().map(|&g| ((g + ROUNDING).to_bits() & 255) as u8).collect();
            levels.push(Level::new(image.side, texel_m * f64::from(1u32 << k), &grey));
            if k + 1 < LEVELS {
                // from c to 2c texels of blur, then every second texel
                let finer = Plane { side: image.side, grey: &image.grey };
                image = finer.blurred(3f64.sqrt() * prefilter_texels, 2);
            }
        }
        Self { levels, base_sigma_m: prefilter_texels * texel_m }
    }

    /// How many grey levels [`Levels::grey`] gives for a texture of `side` texels per side.
    pub(crate) fn grey_len(side: usize) -> usize {
        (0..LEVELS).map(|k| (side >> k) * (side >> k)).sum()
    }

    /// The grey levels of all levels, finest first: what [`Levels::from_grey`] makes the same levels of.
    pub(crate) fn grey(&self) -> impl Iterator<Item = u8> {
        self.levels.iter().flat_map(|level| level.quads.iter().map(|quad| quad.to_le_bytes()[0]))
    }

    /// The levels that gave `grey`, [`Levels::grey_len`] grey levels, for a texture of `side` texels per side.
    pub(crate) fn from_grey(side: usize, mut grey: &[u8], texel_m: f64, prefilter_texels: f64) -> Self {
        let levels = (0..LEVELS).map(|k| {
            let (level, coarser) = grey.split_at((side >> k) * (side >> k));
            grey = coarser;
            Level::new(side >> k, texel_m * f64::from(1u32 << k), level)
        });
        Self { levels: levels.collect(), base_sigma_m: prefilter_texels * texel_m }
    }

    /// The level for a pixel's footprint of `footprint_m` metres. A function of the footprint alone, so that
    /// frames do not depend on those before them; continuous, so that a change of height is not a jump.
    pub(crate) fn choose(&self, footprint_m: f64) -> Choice<'_> {
        let last = self.levels.len() - 1;
        let ratio = (PSF_SIGMA_PX * footprint_m / self.base_sigma_m).clamp(1.0, f64::from(1u32 << last));
        let wanted = libm::log2(ratio);
        let lower = (wanted as usize).min(last);
        let share = (wanted - lower as f64 - 0.5 + BLEND_OCTAVES) / (2.0 * BLEND_OCTAVES);
        if share <= 0.0 || lower == last {
            Choice { level: &self.levels[lower], blend: None }
        } else if share >= 1.0 {
            Choice { level: &self.levels[lower + 1], blend: None }
        } else {
            Choice { level: &self.levels[lower], blend: Some((&self.levels[lower + 1], share as f32)) }
        }
    }
}

/// A toroidal image.
struct Plane<T> {
    side: usize,
    grey: T,
}

impl<G: Copy + Into<f32>> Plane<&Vec<G>> {
    /// Convolved with a Gaussian of `sigma` texels, keeping every `step`-th texel (1 or 2) of every `step`-th row.
    fn blurred(&self, sigma: f64, step: usize) -> Plane<Vec<f32>> {
        let kernel = gaussian_kernel(sigma);
        let side = self.side / step;
        let radius = kernel.len() / 2;
        let wrapped = |i: usize| (i + self.side * kernel.len() - radius) & (self.side - 1);
        // the row with its continuation at both ends; for step 2 its even texels, then its odd ones
        let half = (self.side + 2 * radius).div_ceil(step);
        let mut padded = vec![0.0; half * step];
        let mut across = vec![0.0; side * self.side];
        for (source, target) in self.grey.chunks_exact(self.side).zip(across.chunks_exact_mut(side)) {
            for (phase, part) in padded.chunks_exact_mut(half).enumerate() {
                for (i, p) in part.iter_mut().enumerate() {
                    *p = source[wrapped(i * step + phase)].into();
                }
            }
            let tap = |i: usize| &padded[i % step * half + i / step..][..side];
            sum_rows(target, kernel.iter().enumerate().map(|(i, &weight)| (tap(i), weight)));
        }
        let mut grey = vec![0.0; side * side];
        for (y, target) in grey.chunks_exact_mut(side).enumerate() {
            let tap = |i: usize| &across[wrapped(y * step + i) * side..][..side];
            sum_rows(target, kernel.iter().enumerate().map(|(i, &weight)| (tap(i), weight)));
        }
        Plane { side, grey }
    }
}

impl Level {
    /// Packs the rows of `grey` levels, `side` of `side`, for the look-up.
    fn new(side: usize, texel_m: f64, grey: &[u8]) -> Level {
        let mut quads = vec![0; side * side];
        let row = |y: usize| &grey[(y & (side - 1)) * side..][..side];
        for (y, quads) in quads.chunks_exact_mut(side).enumerate() {
            let (upper, lower) = (row(y), row(y + 1));
            for ((quad, above), below) in quads.iter_mut().zip(upper.windows(2)).zip(lower.windows(2)) {
                *quad = u32::from_le_bytes([above[0], above[1], below[0], below[1]]);
            }
            let last = side - 1;
            quads[last] = u32::from_le_bytes([upper[last], upper[0], lower[last], lower[0]]);
        }
        Level { side, texel_m, quads }
    }
}

fn gaussian_kernel(sigma: f64) -> Vec<f32> {
    let radius = (sigma * CUT_SIGMAS).ceil() as i32;
    let weights: Vec<f64> = (-radius..=radius)
        .map(|i| libm::exp(-0.5 * (f64::from(i) / sigma) * (f64::from(i) / sigma)))
        .collect();
    let sum: f64 = weights.iter().sum();
    weights.iter().map(|w| (w / sum) as f32).collect()
}

/// The weighted sum of rows.
fn sum_rows<'a>(target: &mut [f32], rows: impl Iterator<Item = (&'a [f32], f32)>) {
    target.fill(0.0);
    rows.for_each(|(row, weight)| add_row(target, row, weight));
}

#[multiversion::multiversion(targets("x86_64+avx2"))]
fn add_row(target: &mut [f32], source: &[f32], weight: f32) {
    for (t, s) in target.iter_mut().zip(source) {
        *t += weight * s;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wave(side: usize, cycles: f64) -> Torus {
        let value =
            |x: usize| 128.0 + 100.0 * (std::f64::consts::TAU * cycles * x as f64 / side as f64).cos();
        Torus { side, grey: (0..side * side).map(|i| (value(i % side) + 0.5) as u8).collect() }
    }

    fn amplitude(level: &Level, cycles: f64) -> f64 {
        let w = std::f64::consts::TAU * cycles / level.side as f64;
        let row = level.quads.iter().take(level.side).map(|q| f64::from(q & 255));
        2.0 / level.side as f64 * row.enumerate().map(|(x, g)| g * (w * x as f64).cos()).sum::<f64>()
    }

    #[test]
    fn each_level_attenuates_a_wave_as_its_gaussian_says() {
        let levels = Levels::new(&wave(256, 24.0), 0.001, 1.0);
        for (k, level) in levels.levels.iter().enumerate().take(3) {
            let radians_per_texel = std::f64::consts::TAU * 24.0 / 256.0;
            let sigma = f64::from(1 << k);
            let expected = 100.0 * (-0.5 * (radians_per_texel * sigma).powi(2)).exp();
            let measured = amplitude(level, 24.0);
            assert!((measured - expected).abs() < 0.4, "level {k}: {measured}, expected {expected}");
        }
    }

    #[test]
    fn quads_hold_the_neighbours_across_the_border() {
        let torus =
            Torus { side: 256, grey: (0..256 * 256).map(|i| ((i * 7 + i / 256 * 31) % 251) as u8).collect() };
        let level = &Levels::new(&torus, 0.001, 1.0).levels[0];
        let low = |x: usize, y: usize| level.quads[(y % 256) * 256 + x % 256] & 255;
        for (x, y) in [(0, 0), (255, 17), (40, 255), (255, 255)] {
            let packed = low(x, y) | low(x + 1, y) << 8 | low(x, y + 1) << 16 | low(x + 1, y + 1) << 24;
            assert_eq!(level.quads[y * 256 + x], packed, "{x}, {y}");
        }
    }

    #[test]
    fn level_is_locked_near_the_working_distance_and_continuous_elsewhere() {
        let levels = Levels::new(&wave(256, 3.0), 0.001, 1.0);
        let place = |distance: f64| {
            let choice = levels.choose(distance / 256.0);
            choice.level.texel_m.log2() - 0.001f64.log2()
                + choice.blend.map_or(0.0, |(_, share)| f64::from(share))
        };
        for distance in [0.25, 0.45, 0.5, 0.55, 0.65] {
            assert_eq!(place(distance), 0.0, "at {distance} m");
        }
        let mut last = place(0.1);
        let mut distance = 0.1;
        while distance < 5.0 {
            distance *= 1.001;
            let now = place(distance);
            assert!(now >= last && now - last < 0.01, "at {distance} m: from {last} to {now}");
            last = now;
        }
        assert_eq!(last, 3.0);
    }
}
