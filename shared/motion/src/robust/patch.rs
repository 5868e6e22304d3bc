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
    let Lines { above: zeros, sum, .. } = lines;
    let zeros = &mut zeros[..w];
    zeros.fill(0.0);
    let sum = &mut sum[..w + 2 * PAD];
    sum[..PAD].fill(0.0);
    sum[PAD + w..].fill(0.0);
    for y in 0..h {
        let mut rows: [(&[f32], &[f32]); PAD] = [(&[], &[]); PAD];
        for (d, pair) in rows.iter_mut().enumerate().take(kernel.len()).skip(1) {
            let before = if y >= d { &values[(y - d) * w..][..w] } else { &*zeros };
            let after = if y + d < h { &values[(y + d) * w..][..w] } else { &*zeros };
            *pair = (before, after);
        }
        let middle = &values[y * w..][..w];
        for x in (0..w).step_by(RUN) {
            let mut total = run(middle, x);
            for value in &mut total {
                *value *= kernel[0];
            }
            for (&(before, after), &weight) in rows.iter().zip(kernel).skip(1) {
                let (before, after) = (run(before, x), run(after, x));
                for l in 0..RUN {
                    total[l] += weight * (before[l] + after[l]);
                }
            }
            sum[PAD + x..][..RUN].copy_from_slice(&total);
        }
        for x in (0..w).step_by(RUN) {
            let mut total = run(sum, PAD + x);
            for value in &mut total {
                *value *= kernel[0];
            }
            for (d, &weight) in (1..).zip(&kernel[1..]) {
                let (left, right) = (run(sum, PAD + x - d), run(sum, PAD + x + d));
                for l in 0..RUN {
                    total[l] += weight * (left[l] + right[l]);
                }
            }
            out[y * w + x..][..RUN].copy_from_slice(&total);
        }
    }
}

/// A run of values from `at` on.
#[inline(always)]
fn run(values: &[f32], at: usize) -> [f32; RUN] {
    *values[at..].first_chunk().expect("lines are padded by a run")
}

/// Side of the blocks over which a trial's advantage is summed, px.
const BLOCK: usize = 4;

/// How much better the level displaced by `u` explains `newer` than what left `rest`: the advantage summed
/// over blocks, so that noise cancels, and of the blocks those that gain.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl", "x86_64+avx2", "aarch64+neon"))]
pub(crate) fn score(
    level: &Level,
    (spans, place, u): (&[Span], Place, [f32; 2]),
    (rest, newer): (&[f32], &[f32]),
    lines: &mut Lines,
) -> f32 {
    let whole = u.map(|u| (-u).floor());
    let part = [-u[0] - whole[0], -u[1] - whole[1]];
    let (x0, y0) = (place.x + whole[0] as i32, place.y + whole[1] as i32);
    let w = place.width;
    let Lines { above, below, sum } = lines;
    let mut total = 0.0;
    load(level, x0, y0, &mut above[..=w]);
    sum[..w].fill(0.0);
    for y in 0..place.height {
        load(level, x0, y0 + y as i32 + 1, &mut below[..=w]);
        let (from, to) = valid(spans, place, y, u);
        let line = y * w;
        for x in (0..w).step_by(RUN) {
            if x + RUN <= from || x >= to {
                continue;
            }
            let (a0, a1, b0, b1) = (run(above, x), run(above, x + 1), run(below, x), run(below, x + 1));
            let (r, n) = (run(rest, line + x), run(newer, line + x));
            let mut held = run(sum, x);
            let (first, end) = (from as i32 - x as i32, to as i32 - x as i32);
            for l in 0..RUN {
                let top = a0[l] + part[0] * (a1[l] - a0[l]);
                let bottom = b0[l] + part[0] * (b1[l] - b0[l]);
                let grey = top + part[1] * (bottom - top);
                let inside = (l as i32 >= first) & ((l as i32) < end);
                held[l] += if inside { r[l] - (n[l] - grey).abs() } else { 0.0 };
            }
            sum[x..][..RUN].copy_from_slice(&held);
        }
        if y % BLOCK == BLOCK - 1 || y + 1 == place.height {
            for block in sum[..w].as_chunks::<BLOCK>().0 {
                let gain: f32 = block[0] + block[1] + block[2] + block[3];
                total += gain.max(0.0);
            }
            sum[..w].fill(0.0);
        }
        std::mem::swap(above, below);
    }
    total
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
