//! A part of a level around a target, as numbers with a fraction, and what is computed on it.

use multiversion::multiversion;

use super::warp::Span;
use crate::pyramid::Level;

/// Lanes of the loops; patches are a multiple of it wide.
pub(crate) const RUN: usize = 16;
/// Room at both ends of a line for the widest kernel.
const PAD: usize = 16;

/// Where a patch lies in its level; it may reach over the level's border.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Place {
    pub(crate) x: i32,
    pub(crate) y: i32,
    pub(crate) width: usize,
    pub(crate) height: usize,
}

impl Place {
    pub(crate) fn pixels(&self) -> usize {
        self.width * self.height
    }
}

/// Working lines of the functions below.
#[derive(Clone, Debug)]
pub(crate) struct Lines {
    above: Vec<f32>,
    below: Vec<f32>,
    sum: Vec<f32>,
}

impl Lines {
    /// For patches up to `width` px wide.
    pub(crate) fn new(width: usize) -> Lines {
        let line = || vec![0.0; width + RUN + 2 * PAD];
        Lines { above: line(), below: line(), sum: line() }
    }
}

/// The level's grey levels (not their 16-fold) under the patch after a displacement by `u` level px: at
/// (x, y) the level's value at (x, y) - u, bilinear, the border repeated.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl", "x86_64+avx2", "aarch64+neon"))]
pub(crate) fn shifted(level: &Level, place: Place, u: [f32; 2], out: &mut [f32], lines: &mut Lines) {
    let whole = u.map(|u| (-u).floor());
    let part = [-u[0] - whole[0], -u[1] - whole[1]];
    let (x0, y0) = (place.x + whole[0] as i32, place.y + whole[1] as i32);
    let w = place.width;
    let Lines { above, below, .. } = lines;
    load(level, x0, y0, &mut above[..=w]);
    for (y, out) in out[..place.pixels()].chunks_exact_mut(w).enumerate() {
        load(level, x0, y0 + y as i32 + 1, &mut below[..=w]);
        let (a0, a1, b0, b1) = (&above[..w], &above[1..=w], &below[..w], &below[1..=w]);
        for x in 0..w {
            let top = a0[x] + part[0] * (a1[x] - a0[x]);
            let bottom = b0[x] + part[0] * (b1[x] - b0[x]);
            out[x] = top + part[1] * (bottom - top);
        }
        std::mem::swap(above, below);
    }
}

/// Row `y` of the level from column `x` on, the border repeated.
#[inline(always)]
fn load(level: &Level, x: i32, y: i32, line: &mut [f32]) {
    let y = y.clamp(0, level.height as i32 - 1) as usize;
    let row = &level.values[y * level.stride..][..level.width];
    let grey = |v: i16| f32::from(v) * (1.0 / 16.0);
    let before = ((-x).max(0) as usize).min(line.len());
    let first = (x.max(0) as usize).min(level.width);
    let inside = (level.width - first).min(line.len() - before);
    line[..before].fill(grey(row[0]));
    for (out, &v) in line[before..before + inside].iter_mut().zip(&row[first..]) {
        *out = grey(v);
    }
    line[before + inside..].fill(grey(row[level.width - 1]));
}

/// The columns of the patch's row `y` that are valid in the level both where they are and displaced back
/// by `u`, in patch coordinates (first, end).
#[inline(always)]
pub(crate) fn valid(spans: &[Span], place: Place, y: usize, u: [f32; 2]) -> (usize, usize) {
    let here = place.y + y as i32;
    let span = |row: i32| -> (i32, i32) {
        usize::try_from(row).ok().and_then(|row| spans.get(row)).map_or((0, 0), |s| (s.0 as i32, s.1 as i32))
    };
    let (from, to) = span(here);
    let back = span(here - u[1].round() as i32);
    let shift = u[0].round() as i32;
    let (from, to) = (from.max(back.0 + shift) - place.x, to.min(back.1 + shift) - place.x);
    let within = |x: i32| x.clamp(0, place.width as i32) as usize;
    let (from, to) = (within(from), within(to));
    if from < to { (from, to) } else { (0, 0) }
}

/// Convolves with a symmetric kernel (`kernel[0]` is its middle) in both directions; outside is 0.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl", "x86_64+avx2", "aarch64+neon"))]
pub(crate) fn blur(values: &[f32], place: Place, kernel: &[f32], out: &mut [f32], lines: &mut Lines) {
    let (w, h) = (place.width, place.height);
    let sum = &mut lines.sum[..w + 2 * PAD];
    sum[..PAD].fill(0.0);
    sum[PAD + w..].fill(0.0);
    for y in 0..h {
        let middle = &mut sum[PAD..PAD + w];
        let row = |y: usize| &values[y * w..][..w];
        for (s, v) in middle.iter_mut().zip(row(y)) {
            *s = kernel[0] * v;
        }
        for (d, &weight) in kernel.iter().enumerate().skip(1) {
            for other in [y.checked_sub(d), (y + d < h).then_some(y + d)].into_iter().flatten() {
                for (s, v) in middle.iter_mut().zip(row(other)) {
                    *s += weight * v;
                }
            }
        }
        let out = &mut out[y * w..][..w];
        for (o, s) in out.iter_mut().zip(&sum[PAD..]) {
            *o = kernel[0] * s;
        }
        for (d, &weight) in kernel.iter().enumerate().skip(1) {
            let (left, right) = (&sum[PAD - d..][..w], &sum[PAD + d..][..w]);
            for x in 0..w {
                out[x] += weight * (left[x] + right[x]);
            }
        }
    }
}

/// Sum of the positive values, in a fixed order.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl", "x86_64+avx2", "aarch64+neon"))]
pub(crate) fn sum_positive(values: &[f32]) -> f32 {
    let mut sums = [0f32; RUN];
    for run in values.as_chunks::<RUN>().0 {
        for l in 0..RUN {
            sums[l] += run[l].max(0.0);
        }
    }
    sums.iter().sum()
}

/// `rest - abs(b - a)`, 0 outside of the valid columns: how much better `a` explains `b` than what left
/// `rest`.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl", "x86_64+avx2", "aarch64+neon"))]
pub(crate) fn advantage(
    (rest, a, b): (&[f32], &[f32], &[f32]),
    (spans, place, u): (&[Span], Place, [f32; 2]),
    out: &mut [f32],
) {
    let w = place.width;
    for y in 0..place.height {
        let (from, to) = valid(spans, place, y, u);
        let line = y * w..(y + 1) * w;
        let out = &mut out[line.clone()];
        for (((o, r), a), b) in out.iter_mut().zip(&rest[line.clone()]).zip(&a[line.clone()]).zip(&b[line]) {
            *o = r - (b - a).abs();
        }
        out[..from].fill(0.0);
        out[to..].fill(0.0);
    }
}

/// Sums of a least-squares step for one displacement of the whole patch: gx gx, gx gy, gy gy, gx r, gy r,
/// with r = b - a, over the pixels where `chosen` is positive.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl", "x86_64+avx2", "aarch64+neon"))]
pub(crate) fn least_squares((a, b, chosen): (&[f32], &[f32], &[f32]), place: Place, scale: f32) -> [f64; 5] {
    let (w, h) = (place.width, place.height);
    let mut sums = [[0f32; RUN]; 5];
    let per_scale = 1.0 / scale;
    for y in 1..h - 1 {
        let line = y * w;
        let mut x = 1;
        while x + RUN < w {
            let at = line + x;
            let run = |values: &[f32], at: usize| -> [f32; RUN] {
                *values[at..].first_chunk().expect("inside the patch")
            };
            let (l_a, l_b, r_a, r_b) = (run(a, at - 1), run(b, at - 1), run(a, at + 1), run(b, at + 1));
            let (u_a, u_b, d_a, d_b) = (run(a, at - w), run(b, at - w), run(a, at + w), run(b, at + w));
            let (m_a, m_b, c) = (run(a, at), run(b, at), run(chosen, at));
            for l in 0..RUN {
                let gx = ((r_a[l] + r_b[l]) - (l_a[l] + l_b[l])) * 0.25;
                let gy = ((d_a[l] + d_b[l]) - (u_a[l] + u_b[l])) * 0.25;
                let r = m_b[l] - m_a[l];
                let q = r * per_scale;
                let robust = 1.0 + q * q;
                let weight = if c[l] > 0.0 { 1.0 / (robust * robust) } else { 0.0 };
                sums[0][l] += weight * gx * gx;
                sums[1][l] += weight * gx * gy;
                sums[2][l] += weight * gy * gy;
                sums[3][l] += weight * gx * r;
                sums[4][l] += weight * gy * r;
            }
            x += RUN;
        }
    }
    sums.map(|lanes| lanes.iter().map(|&v| f64::from(v)).sum())
}
