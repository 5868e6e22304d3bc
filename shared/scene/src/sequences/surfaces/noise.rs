//! Noise with a power-law spectrum, as a sum of octaves.

use crate::random::Random;

use super::super::plane::Plane;

/// Spacing of the coarsest octave's lattice, texels: its spectrum peaks at a wavelength of 3.3 spacings, 213
/// texels, and falls with the fourth power of frequency below.
pub(super) const COARSEST: usize = 64;
/// Binomial kernels: cos^2(pi f) and its square, which is 0.73 at 8 texels' wavelength, 0.25 at 4, 0 at 2.
const BINOMIAL: [f32; 2] = [0.5, 0.25];
const BAND_LIMIT: [f32; 3] = [0.375, 0.25, 0.0625];

/// Noise whose amplitude falls as 1/f^`exponent`.
///
/// Deviation from noise shaped in the frequency domain: a sum of octaves that are each band-limited, so that the
/// spectrum has a ripple; limits are the same, no structure coarser than 256 texels and little beyond 0.35
/// cycles per texel.
pub(super) fn fractal(side: usize, exponent: f64, random: &mut Random) -> Plane {
    octaves(side, 1, COARSEST, exponent, random)
}

/// Octaves from lattice spacing `finest` to `coarsest`, powers of two, standardised.
///
/// An octave of spacing h occupies an area of 1/h^2 in the frequency plane around f = 1/(3.3 h). Its density,
/// amplitude^2 h^2, is to be f^(-2a), so its amplitude is h^(a - 1).
pub(super) fn octaves(
    side: usize,
    finest: usize,
    coarsest: usize,
    exponent: f64,
    random: &mut Random,
) -> Plane {
    let mut sum = Plane::uniform(side, side, 0.0);
    let mut spacing = finest;
    while spacing <= coarsest.min(side / 4) {
        let octave = octave(side, spacing, random);
        // its mean is 0
        let (_, deviation) = octave.mean_and_deviation();
        sum.add(&octave, (libm::pow(spacing as f64, exponent - 1.0) / deviation) as f32);
        spacing *= 2;
    }
    sum.standardised()
}

/// Smooth band-limited noise: random numbers on a lattice without their low frequencies, interpolated by the
/// cubic B-spline.
fn octave(side: usize, spacing: usize, random: &mut Random) -> Plane {
    let nodes = side / spacing;
    let mut lattice = Plane::uniform(nodes, nodes, 0.0);
    let mut state = (random.unit() * 2f64.powi(32)) as u64;
    lattice.grey.iter_mut().for_each(|g| *g = next_number(&mut state));
    let smooth = lattice.convolved(&BINOMIAL);
    lattice.add(&smooth, -1.0);
    if spacing == 1 {
        return lattice.convolved(&BAND_LIMIT);
    }
    spline_interpolated(&lattice, spacing)
}

/// Uniform in [-0.5, 0.5): SplitMix64 (G. Steele, D. Lea, C. Flood, 2014), for millions of numbers of which only
/// the sum over many counts.
fn next_number(state: &mut u64) -> f32 {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let z = (*state ^ *state >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ z >> 31) >> 40) as f32 * (1.0 / 16_777_216.0) - 0.5
}

/// Finer by the factor `spacing` in both directions.
fn spline_interpolated(lattice: &Plane, spacing: usize) -> Plane {
    let (nodes, side) = (lattice.width, lattice.width * spacing);
    let weights: Vec<[f32; 4]> = (0..spacing).map(|i| spline_weights(i as f32 / spacing as f32)).collect();
    let mut across = Plane::uniform(side, nodes, 0.0);
    for (source, target) in lattice.grey.chunks_exact(nodes).zip(across.grey.chunks_exact_mut(side)) {
        for (node, part) in target.chunks_exact_mut(spacing).enumerate() {
            let four: [f32; 4] = std::array::from_fn(|k| source[(node + nodes + k - 1) % nodes]);
            for (t, weight) in part.iter_mut().zip(&weights) {
                *t = four.iter().zip(weight).map(|(f, w)| f * w).sum();
            }
        }
    }
    let mut plane = Plane::uniform(side, side, 0.0);
    for (y, target) in plane.grey.chunks_exact_mut(side).enumerate() {
        let (node, weight) = (y / spacing, weights[y % spacing]);
        let row = |k: usize| &across.grey[(node + nodes + k - 1) % nodes * side..][..side];
        let rows = row(0).iter().zip(row(1)).zip(row(2).iter().zip(row(3)));
        for (t, ((a, b), (c, d))) in target.iter_mut().zip(rows) {
            *t = weight[0] * a + weight[1] * b + weight[2] * c + weight[3] * d;
        }
    }
    plane
}

/// Weights of the nodes before, at, and after a place `f` beyond its node.
fn spline_weights(f: f32) -> [f32; 4] {
    let g = 1.0 - f;
    let inner = |x: f32| (4.0 - 6.0 * x * x + 3.0 * x * x * x) / 6.0;
    [g * g * g / 6.0, inner(f), inner(g), f * f * f / 6.0]
}
