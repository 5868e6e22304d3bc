//! Robust Gauss-Newton fit of the global motion on one pyramid level.

use multiversion::multiversion;
use nalgebra::{SMatrix, SVector};

use super::model::{COEFFICIENTS, GlobalMotion, MotionModel};
use super::warp::Span;
use crate::pyramid::Level;

/// A block of pixels has one place in the model: its middle.
const BLOCK_WIDTH: usize = 16;
const BLOCK_HEIGHT: usize = 8;
/// Pixels at the image's border that do not count.
const BORDER: usize = 2;
/// Residuals beyond this many robust standard deviations count less and less.
const SCALE_SIGMAS: f32 = 2.0;
/// Normal deviates: standard deviation over median of the modulus.
const SIGMA_PER_MEDIAN: f32 = 1.4826;
/// Least scale of the residuals, 1/16 grey level: 0.3 grey levels, the rounding of the frame.
const LEAST_SCALE: f32 = 0.3 * 16.0;
/// Mean square of the gradient from which a block's say hardly grows, (1/16 grey level)^2.
const AMPLE_GRADIENT: f64 = 2.0 * 2.0 * 256.0;
/// Pixels whose residuals are looked at for their scale, about.
const SAMPLE: usize = 1024;
/// Largest modulus of a residual that the histogram tells apart, 1/16 grey level.
const BINS: usize = 1024;

/// Sums over a level that make up the normal equations: of the weighted gradient products and of
/// gradient times residual, times the monomials of the position up to degree 4 (2).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Moments {
    xx: [f64; 15],
    xy: [f64; 15],
    yy: [f64; 15],
    xr: [f64; 6],
    yr: [f64; 6],
}

/// Place of `x^i y^j` among the monomials.
const fn monomial((i, j): Powers) -> usize {
    let degree = i + j;
    degree * (degree + 1) / 2 + j
}

/// Powers of x and y.
type Powers = (usize, usize);
/// The monomials of u and v that each coefficient multiplies.
#[rustfmt::skip]
const BASIS: [(Option<Powers>, Option<Powers>); COEFFICIENTS] = [
    (Some((0, 0)), None), (Some((1, 0)), None), (Some((0, 1)), None),
    (None, Some((0, 0))), (None, Some((1, 0))), (None, Some((0, 1))),
    (Some((2, 0)), Some((1, 1))), (Some((1, 1)), Some((0, 2))),
];

impl Moments {
    fn add(&mut self, [x, y]: [f64; 2], [xx, xy, yy, xr, yr]: [f64; 5]) {
        let (x2, y2) = (x * x, y * y);
        let powers = [
            1.0,
            x,
            y,
            x2,
            x * y,
            y2,
            x2 * x,
            x2 * y,
            x * y2,
            y2 * y,
            x2 * x2,
            x2 * x * y,
            x2 * y2,
            x * y2 * y,
            y2 * y2,
        ];
        for (i, power) in powers.into_iter().enumerate() {
            self.xx[i] += xx * power;
            self.xy[i] += xy * power;
            self.yy[i] += yy * power;
        }
        for (i, power) in powers.into_iter().take(6).enumerate() {
            self.xr[i] += xr * power;
            self.yr[i] += yr * power;
        }
    }

    fn normal_equations(&self) -> (SMatrix<f64, 8, 8>, SVector<f64, 8>) {
        let product = |moments: &[f64; 15], a: Option<Powers>, b: Option<Powers>| {
            let (Some(a), Some(b)) = (a, b) else { return 0.0 };
            moments[monomial((a.0 + b.0, a.1 + b.1))]
        };
        let matrix = SMatrix::from_fn(|p, q| {
            let ((pu, pv), (qu, qv)) = (BASIS[p], BASIS[q]);
            product(&self.xx, pu, qu)
                + product(&self.xy, pu, qv)
                + product(&self.xy, pv, qu)
                + product(&self.yy, pv, qv)
        });
        let vector = SVector::from_fn(|p, _| {
            let (u, v) = BASIS[p];
            u.map_or(0.0, |u| self.xr[monomial(u)]) + v.map_or(0.0, |v| self.yr[monomial(v)])
        });
        (matrix, vector)
    }

    /// The correction of the coefficients `current` (both in px of the level), which are expected to be
    /// about as large as `prior` says; `None` where the image does not determine them. `deviation` is that
    /// of the residuals, 1/16 grey level.
    pub(crate) fn solve(
        &self,
        model: MotionModel,
        current: [f64; COEFFICIENTS],
        prior: [f64; COEFFICIENTS],
        deviation: f32,
    ) -> Option<[f64; COEFFICIENTS]> {
        let (mut matrix, mut vector) = self.normal_equations();
        for i in 0..COEFFICIENTS {
            let information = CORRELATED_PIXELS * f64::from(deviation).powi(2) / prior[i].powi(2);
            matrix[(i, i)] += information;
            vector[i] += information * current[i];
        }
        let step = match model {
            MotionModel::Translation => solve_in(matrix, vector, &TRANSLATION),
            MotionModel::Similarity => solve_in(matrix, vector, &SIMILARITY),
            MotionModel::Affine => solve_in(matrix, vector, &AFFINE),
            MotionModel::Planar => solve_in(matrix, vector, &PLANAR),
        }?;
        step.iter().all(|a| a.is_finite()).then(|| step.into())
    }
}

/// So many pixels say together what one independent pixel would: residuals of neighbours are alike.
const CORRELATED_PIXELS: f64 = 100.0;

/// Directions in the space of coefficients that a model may move along, as rows.
const TRANSLATION: [[f64; 8]; 2] = [unit(0), unit(3)];
const SIMILARITY: [[f64; 8]; 4] =
    [unit(0), unit(3), [0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0]];
const AFFINE: [[f64; 8]; 6] = [unit(0), unit(1), unit(2), unit(3), unit(4), unit(5)];
const PLANAR: [[f64; 8]; 8] = [unit(0), unit(1), unit(2), unit(3), unit(4), unit(5), unit(6), unit(7)];

const fn unit(i: usize) -> [f64; 8] {
    let mut row = [0.0; 8];
    row[i] = 1.0;
    row
}

/// Keeps an image of bars, whose shift along them nothing determines, from an infinite step: this share
/// of the mean curvature is added to each.
const RIDGE: f64 = 1e-5;

fn solve_in<const N: usize>(
    matrix: SMatrix<f64, 8, 8>,
    vector: SVector<f64, 8>,
    directions: &[[f64; 8]; N],
) -> Option<SVector<f64, 8>> {
    let directions = SMatrix::<f64, N, 8>::from_fn(|i, j| directions[i][j]);
    let mut inner = directions * matrix * directions.transpose();
    let ridge = RIDGE * inner.trace() / N as f64;
    for i in 0..N {
        inner[(i, i)] += ridge;
    }
    let rest = directions * vector;
    Some(directions.transpose() * inner.cholesky()?.solve(&rest))
}

/// Robust scale of the residuals of a level, 1/16 grey level, from a sample of its pixels: of those with
/// more gradient than the mean, so that large flat parts do not make the textured ones outliers.
pub(crate) fn residual_scale(older: &Level, newer: &Level, spans: &[Span], counts: &mut Histogram) -> f32 {
    // Some thousand pixels are enough.
    let step = ((newer.width * newer.height / SAMPLE).isqrt()).max(1);
    let rows = (BORDER..newer.height - BORDER).step_by(step);
    let (mut sum, mut total) = (0, 0);
    for y in rows.clone() {
        for x in (spans[y].0.max(BORDER)..spans[y].1.min(newer.width - BORDER)).step_by(step) {
            sum += gradient(newer, x, y);
            total += 1;
        }
    }
    let mean = sum / u32::max(total, 1);
    counts.fill(0);
    let mut chosen = 0;
    for y in rows {
        for x in (spans[y].0.max(BORDER)..spans[y].1.min(newer.width - BORDER)).step_by(step) {
            if gradient(newer, x, y) >= mean {
                let r = older.values[y * older.stride + x].abs_diff(newer.values[y * newer.stride + x]);
                counts[usize::from(r).min(BINS - 1)] += 1;
                chosen += 1;
            }
        }
    }
    let mut below = 0;
    let median = counts.iter().position(|&count| {
        below += count;
        2 * below >= chosen
    });
    SCALE_SIGMAS * SIGMA_PER_MEDIAN * median.unwrap_or(0) as f32 + LEAST_SCALE
}

/// Sum of the moduli of the gradient's components at a pixel, half grey levels times 16.
#[inline(always)]
fn gradient(level: &Level, x: usize, y: usize) -> u32 {
    let (at, v) = (y * level.stride + x, &level.values);
    u32::from(v[at + 1].abs_diff(v[at - 1])) + u32::from(v[at + level.stride].abs_diff(v[at - level.stride]))
}

pub(crate) type Histogram = [u32; BINS];

pub(crate) fn histogram() -> Box<Histogram> {
    vec![0; BINS].try_into().expect("as many as bins")
}

/// The sums of one Gauss-Newton step: residual r = newer - older, weighted by `1 / (1 + (r/scale)^2)^2`,
/// gradients by central differences of the mean of both frames. Places are the model's coordinates.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl", "x86_64+avx2", "aarch64+neon"))]
pub(crate) fn moments(
    older: &Level,
    newer: &Level,
    spans: &[Span],
    level: (usize, &GlobalMotion),
    scale: f32,
) -> Moments {
    moments_body(older, newer, spans, level, scale)
}

#[inline(always)]
pub(crate) fn moments_body(
    older: &Level,
    newer: &Level,
    spans: &[Span],
    (k, motion): (usize, &GlobalMotion),
    scale: f32,
) -> Moments {
    let mut moments = Moments::default();
    let pixel = f64::from(2u32 << k);
    let rows = BORDER..newer.height.saturating_sub(BORDER);
    for top in rows.clone().step_by(BLOCK_HEIGHT) {
        let bottom = (top + BLOCK_HEIGHT).min(rows.end);
        for x in (BORDER..newer.width.saturating_sub(BORDER)).step_by(BLOCK_WIDTH) {
            let sums = block(older, newer, spans, (x, top, bottom), 1.0 / scale);
            let centre = [
                (x as f64 + (BLOCK_WIDTH as f64 - 1.0) / 2.0) * pixel,
                ((top + bottom) as f64 - 1.0) / 2.0 * pixel,
            ];
            // A block's say grows with its texture only up to a point: area decides what the background
            // is, not contrast.
            let energy = (sums[0] + sums[2]) / (BLOCK_WIDTH * BLOCK_HEIGHT) as f64;
            let say = 1.0 / (1.0 + energy / AMPLE_GRADIENT);
            moments.add(motion.normalised(centre[0], centre[1]), sums.map(|sum| say * sum));
        }
    }
    moments
}

/// Weighted sums of gx gx, gx gy, gy gy, gx r, gy r over one block.
#[inline(always)]
fn block(
    older: &Level,
    newer: &Level,
    spans: &[Span],
    (x, top, bottom): (usize, usize, usize),
    per_scale: f32,
) -> [f64; 5] {
    let mut sums = [[0f32; BLOCK_WIDTH]; 5];
    let end = newer.width - BORDER;
    for y in top..bottom {
        // The gradient takes the pixel on each side as well, and the rows above and below.
        let (above, here, below) = (spans[y - 1], spans[y], spans[y + 1]);
        let from = above.0.max(here.0).max(below.0) + 1;
        let to = above.1.min(here.1).min(below.1).saturating_sub(1);
        let from = from.max(BORDER) as i32 - x as i32;
        let to = to.min(end) as i32 - x as i32;
        if from >= to {
            continue;
        }
        let at = |level: &Level, y: usize, x: usize| y * level.stride + x;
        let run = |level: &Level, y: usize, x: usize| -> [i16; BLOCK_WIDTH] {
            *level.values[at(level, y, x)..].first_chunk().expect("rows are padded")
        };
        let (left_a, left_b) = (run(older, y, x - 1), run(newer, y, x - 1));
        let (right_a, right_b) = (run(older, y, x + 1), run(newer, y, x + 1));
        let (above_a, above_b) = (run(older, y - 1, x), run(newer, y - 1, x));
        let (below_a, below_b) = (run(older, y + 1, x), run(newer, y + 1, x));
        let (a, b) = (run(older, y, x), run(newer, y, x));
        for l in 0..BLOCK_WIDTH {
            let gx = f32::from((right_a[l] + right_b[l]) - (left_a[l] + left_b[l])) * 0.25;
            let gy = f32::from((below_a[l] + below_b[l]) - (above_a[l] + above_b[l])) * 0.25;
            let r = f32::from(b[l] - a[l]);
            let lane = l as i32;
            let inside = if (lane >= from) & (lane < to) { 1.0 } else { 0.0 };
            let q = r * per_scale;
            let w = 1.0 + q * q;
            let w = inside / (w * w);
            let (wx, wy) = (w * gx, w * gy);
            sums[0][l] += wx * gx;
            sums[1][l] += wx * gy;
            sums[2][l] += wy * gy;
            sums[3][l] += wx * r;
            sums[4][l] += wy * r;
        }
    }
    sums.map(|lanes| f64::from(fold(lanes)))
}

/// Sum of the lanes in a fixed order.
#[inline(always)]
fn fold(lanes: [f32; BLOCK_WIDTH]) -> f32 {
    let mut half = [0f32; 8];
    for l in 0..8 {
        half[l] = lanes[l] + lanes[l + 8];
    }
    ((half[0] + half[4]) + (half[1] + half[5])) + ((half[2] + half[6]) + (half[3] + half[7]))
}

/// Mean of the residuals' moduli, each at most 20 grey levels: what tells the better of two fits.
pub(crate) fn mean_residual(older: &Level, newer: &Level, spans: &[Span]) -> f64 {
    const MOST: u16 = 20 * 16;
    let (mut sum, mut count) = (0u64, 0u64);
    for (y, &(from, to)) in spans[..newer.height].iter().enumerate() {
        let (a, b) =
            (&older.values[y * older.stride..][from..to], &newer.values[y * newer.stride..][from..to]);
        sum += a.iter().zip(b).map(|(a, b)| u32::from(a.abs_diff(*b).min(MOST))).sum::<u32>() as u64;
        count += (to - from) as u64;
    }
    // Little overlap must not look like a good fit: what is outside counts as a middling residual.
    let all = (newer.width * newer.height) as f64;
    (sum as f64 + 0.1 * f64::from(MOST) * (all - count as f64)) / all
}
