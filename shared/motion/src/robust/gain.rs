//! The local gain: light that changes from frame to frame, differently across the image.

use multiversion::multiversion;

use crate::pyramid::{LANES, Level};

/// The ratio of the local means of the newer and the compensated older frame (design notes on vision,
/// section 6 R3), at the pixels of level 3, bilinear in between.
#[derive(Clone, Debug)]
pub(crate) struct Gain {
    width: usize,
    height: usize,
    radius: usize,
    factors: Vec<f32>,
    /// Sums of the window's rows in each column: older, newer; a window of all of a level of 512 px fits.
    columns: [Vec<i32>; 2],
    /// Sums of those from the left.
    prefixes: [Vec<i32>; 2],
    blended: Vec<f32>,
    line: Vec<f32>,
    ones: Vec<f32>,
}

/// Added to both means, in 1/16 grey level: black stays black.
const DARK: i32 = 4 * 16;
/// A window as a share of the shorter side: 28 base px where level 1 is 256 px high.
const WINDOW_SHARE: f64 = 28.0 / 256.0;

impl Gain {
    /// Gain 1 for levels of `width` x `height` (level 3) under a row of up to `row` px.
    pub(crate) fn new(width: usize, height: usize, row: usize) -> Gain {
        let window = (WINDOW_SHARE * width.min(height) as f64).max(5.0);
        let padded = row.next_multiple_of(LANES) + LANES;
        Gain {
            width,
            height,
            radius: (window / 2.0) as usize,
            factors: vec![1.0; width * height],
            columns: std::array::from_fn(|_| vec![0; width]),
            prefixes: std::array::from_fn(|_| vec![0; width + 1]),
            blended: vec![1.0; width + 1],
            line: vec![1.0; padded],
            ones: vec![1.0; padded],
        }
    }

    /// Measures it: `older` is level 3 of the older frame warped with no gain, valid in `spans`.
    pub(crate) fn measure(&mut self, older: &Level, newer: &Level, spans: &[(usize, usize)]) {
        measure(self, older, newer, spans);
    }

    /// Factors that change nothing, for a row.
    pub(crate) fn none(&self) -> &[f32] {
        &self.ones
    }

    /// The factors along row `y` of level `k` (from 0), at least as many as the level is wide.
    #[inline(always)]
    pub(crate) fn row(&mut self, k: usize, y: usize) -> &[f32] {
        let step = 4 >> k;
        let (y0, part) = ((y / step).min(self.height - 1), (y % step) as f32 / step as f32);
        let y1 = (y0 + 1).min(self.height - 1);
        let (above, below) =
            (&self.factors[y0 * self.width..][..self.width], &self.factors[y1 * self.width..]);
        for ((blend, &a), &b) in self.blended.iter_mut().zip(above).zip(below) {
            *blend = a + part * (b - a);
        }
        self.blended[self.width] = self.blended[self.width - 1];
        match step {
            4 => stretch::<4>(&self.blended, &mut self.line),
            2 => stretch::<2>(&self.blended, &mut self.line),
            _ => stretch::<1>(&self.blended, &mut self.line),
        }
        &self.line
    }
}

/// Box means by sums over columns and, along them, prefix sums.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn measure(gain: &mut Gain, older: &Level, newer: &Level, spans: &[(usize, usize)]) {
    let (w, h, r) = (gain.width, gain.height, gain.radius);
    let Gain { columns: [a, b], prefixes: [pa, pb], factors, .. } = gain;
    a.fill(0);
    b.fill(0);
    for (y, &span) in spans[..r.min(h)].iter().enumerate() {
        add_row(a, older, y, span, 1);
        add_row(b, newer, y, span, 1);
    }
    for y in 0..h {
        if y + r < h {
            add_row(a, older, y + r, spans[y + r], 1);
            add_row(b, newer, y + r, spans[y + r], 1);
        }
        if y > r {
            add_row(a, older, y - r - 1, spans[y - r - 1], -1);
            add_row(b, newer, y - r - 1, spans[y - r - 1], -1);
        }
        sum_along(a, pa);
        sum_along(b, pb);
        let row = &mut factors[y * w..][..w];
        for (x, factor) in row.iter_mut().enumerate() {
            let (first, end) = (x.saturating_sub(r), (x + r + 1).min(w));
            let (a, b) = ((pa[end] - pa[first]) as f32, (pb[end] - pb[first]) as f32);
            *factor = if a > 0.0 { b / a } else { 0.0 };
        }
    }
    extend(factors, w);
}

/// Where the window holds no valid pixel (0), the gain is that of the nearest place in the row, else in the
/// column, whose window does: finer levels are valid nearer to the border.
#[inline(always)]
fn extend(factors: &mut [f32], width: usize) {
    for row in factors.chunks_exact_mut(width) {
        let (Some(first), Some(last)) =
            (row.iter().position(|&f| f > 0.0), row.iter().rposition(|&f| f > 0.0))
        else {
            continue;
        };
        let (left, right) = (row[first], row[last]);
        row[..first].fill(left);
        row[last + 1..].fill(right);
    }
    let empty = |row: &[f32]| row[0] <= 0.0;
    let rows = factors.len() / width;
    let seen = |y: &usize| !empty(&factors[y * width..]);
    let (Some(first), Some(last)) = ((0..rows).find(seen), (0..rows).rfind(seen)) else {
        factors.fill(1.0);
        return;
    };
    for y in (0..first).chain(last + 1..rows) {
        let from = y.clamp(first, last) * width;
        factors.copy_within(from..from + width, y * width);
    }
}

/// Adds a row's valid pixels to the sums of the columns.
#[inline(always)]
fn add_row(columns: &mut [i32], level: &Level, y: usize, (from, to): (usize, usize), sign: i32) {
    let row = &level.values[y * level.stride..][from..to];
    for (sum, &value) in columns[from..to].iter_mut().zip(row) {
        *sum += sign * (i32::from(value) + DARK);
    }
}

#[inline(always)]
fn sum_along(columns: &[i32], prefix: &mut [i32]) {
    let mut sum = 0;
    for (before, &column) in prefix[1..].iter_mut().zip(columns) {
        sum += column;
        *before = sum;
    }
}

/// `STEP` values for each one, linear in between.
#[inline(always)]
fn stretch<const STEP: usize>(values: &[f32], line: &mut [f32]) {
    const RUN: usize = 16;
    // Whole runs first, so that each is stored at once.
    let per_run = RUN / STEP;
    let whole = (values.len() - 1) / per_run;
    for (run, out) in line.as_chunks_mut::<RUN>().0[..whole].iter_mut().enumerate() {
        let from = &values[run * per_run..=(run + 1) * per_run];
        for l in 0..RUN {
            let (left, right) = (from[l / STEP], from[l / STEP + 1]);
            out[l] = left + (right - left) * ((l % STEP) as f32 / STEP as f32);
        }
    }
    let mut out = line[whole * RUN..].iter_mut();
    for pair in values[whole * per_run..].windows(2) {
        for i in 0..STEP {
            if let Some(value) = out.next() {
                *value = pair[0] + (pair[1] - pair[0]) * (i as f32 / STEP as f32);
            }
        }
    }
    let last = values[values.len() - 1];
    out.for_each(|value| *value = last);
}
