//! The older levels as the newer frame would show them if only the background moved.

use multiversion::multiversion;

use super::gain::Gain;
use super::model::{GlobalMotion, Row};
use crate::pyramid::Level;

/// Columns that are warped at once.
const RUN: usize = 16;
/// What comes from nearer to the border than this, level px, is not valid: it was blurred with the
/// repeated border.
const MARGIN: i32 = 2;
/// Added to a number, it leaves no room for a fraction: the sum's last bits are the nearest whole number.
const WHOLE: f32 = 12_582_912.0;

/// The columns of one row that come from inside of the older frame (first, end).
pub(crate) type Span = (usize, usize);

/// Writes `source` moved by `motion` and brightened by `gain` into `out`, and the valid part of each row
/// into `spans`: bilinear between the level's pixels. What is not valid is 0.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl", "x86_64+avx2", "aarch64+neon"))]
pub(crate) fn warp(
    source: &Level,
    motion: &GlobalMotion,
    (gain, light): (&mut Gain, bool),
    k: usize,
    out: &mut Level,
    spans: &mut [Span],
) {
    warp_body(source, motion, (gain, light), k, (out, spans), |_| true);
}

/// Rows between the beginnings of bands, and rows of a band: a sample of a level that costs a third.
const BAND_PERIOD: usize = 16;
const BAND_ROWS: usize = 10;

/// As [`warp`], but only bands of rows; nothing of the others is valid.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl", "x86_64+avx2", "aarch64+neon"))]
pub(crate) fn warp_bands(
    source: &Level,
    motion: &GlobalMotion,
    (gain, light): (&mut Gain, bool),
    k: usize,
    out: &mut Level,
    spans: &mut [Span],
) {
    let in_band = |y: usize| y % BAND_PERIOD < BAND_ROWS;
    warp_body(source, motion, (gain, light), k, (out, spans), in_band);
}

#[inline(always)]
fn warp_body(
    source: &Level,
    motion: &GlobalMotion,
    (gain, light): (&mut Gain, bool),
    k: usize,
    (out, spans): (&mut Level, &mut [Span]),
    wanted: impl Fn(usize) -> bool,
) {
    let mut guess = (0, source.width);
    for (y, span) in spans[..out.height].iter_mut().enumerate() {
        if !wanted(y) {
            *span = (0, 0);
            continue;
        }
        let factors = if light { gain.row(k, y) } else { gain.none() };
        let line = &mut out.values[y * out.stride..][..out.stride];
        *span = warp_row(source, motion, factors, ((k, y), guess), line);
        guess = *span;
    }
}

/// One row; `factors` are at least as many as the row's values, `guess` is where the valid columns may be.
#[inline(always)]
pub(crate) fn warp_row(
    source: &Level,
    motion: &GlobalMotion,
    factors: &[f32],
    ((k, y), guess): ((usize, usize), Span),
    line: &mut [i16],
) -> Span {
    let row = motion.row(k, y);
    let (from, to) = valid_columns(source, &row, y, guess);
    line[..from].fill(0);
    line[to..].fill(0);
    if from == to {
        return (0, 0);
    }
    // Runs lie inside of the valid columns, the last one ends with them.
    let last = to.max(from + RUN) - RUN;
    for start in (from..last).step_by(RUN).chain([last]) {
        // Within a run the displacement is as good as linear: its ends tell all.
        let x = start as u32 as f32;
        let ((u0, v0), (u1, v1)) = (row.at(x), row.at(x + LAST_LANE));
        let whole = (below(-0.5 * (u0 + u1)), below(-0.5 * (v0 + v1)));
        let run = Run {
            left: start as i32 + whole.0 as i32,
            top: y as i32 + whole.1 as i32,
            first: (-u0 - whole.0, -v0 - whole.1),
            last: (-u1 - whole.0, -v1 - whole.1),
        };
        let factors: &[f32; RUN] = factors[start..].first_chunk().expect("longer than a row");
        let values: &mut [i16; RUN] = line[start..].first_chunk_mut().expect("rows are padded");
        if run.is_straight() && fits(run.left, RUN, source.width) && fits(run.top, 1, source.height) {
            let at = run.top as usize * source.stride + run.left as usize;
            let above: &[i16; RUN + 1] = source.values[at..].first_chunk().expect("inside the level");
            let below: &[i16; RUN + 1] =
                source.values[at + source.stride..].first_chunk().expect("inside the level");
            let slope = run.slope();
            for l in 0..RUN {
                let corners = [above[l], above[l + 1], below[l], below[l + 1]];
                let lane = l as u32 as f32;
                let (dx, dy) = (run.first.0 + slope.0 * lane, run.first.1 + slope.1 * lane);
                values[l] = rounded(bilinear(corners, dx, dy) * factors[l]);
            }
        } else {
            look_up_run(source, &run, factors, values);
        }
    }
    line[to..].fill(0);
    (from, to)
}

/// The columns of row `y` that come from where the older level is valid (first, end).
#[inline(always)]
fn valid_columns(source: &Level, row: &Row, y: usize, guess: Span) -> Span {
    let inside = |x: usize| {
        let (u, v) = row.at(x as u32 as f32);
        let within =
            |s: f32, side: usize| (s >= MARGIN as f32) & (s < side as u32 as f32 - 1.0 - MARGIN as f32);
        // Also the newer level is blurred with its border.
        let own = |i: usize, side: usize| (i >= MARGIN as usize) & (i + (MARGIN as usize) < side);
        within(x as u32 as f32 - u, source.width)
            & within(y as u32 as f32 - v, source.height)
            & own(x, source.width)
            & own(y, source.height)
    };
    // Displacements change slowly along a row, so that the valid columns are an interval. Its ends are
    // mostly where they were in the row above, or beside it.
    let width = source.width;
    let first = (guess.0.saturating_sub(1)..width.min(guess.0 + 2)).find(|&x| inside(x));
    let last = (guess.1.saturating_sub(2)..width.min(guess.1 + 1)).rev().find(|&x| inside(x));
    if let (Some(first), Some(last)) = (first, last) {
        let found_first = first == 0 || !inside(first - 1);
        let found_last = last + 1 == width || !inside(last + 1);
        if found_first && found_last && first < last {
            return (first, last + 1);
        }
    }
    // From some column that is valid, the ends are found by halving.
    let Some(seed) = (0..=SEEDS).map(|i| i * (width - 1) / SEEDS).find(|&x| inside(x)) else { return (0, 0) };
    let end = |mut good: usize, mut bad: usize| {
        while good.abs_diff(bad) > 1 {
            let middle = usize::midpoint(good, bad);
            *(if inside(middle) { &mut good } else { &mut bad }) = middle;
        }
        good
    };
    let first = if inside(0) { 0 } else { end(seed, 0) };
    let last = if inside(width - 1) { width - 1 } else { end(seed, width - 1) };
    (first, last + 1)
}

/// Columns that are tried to find a valid one.
const SEEDS: usize = 8;

const LAST_LANE: f32 = (RUN - 1) as f32;

/// Where a run of pixels comes from.
#[derive(Clone, Copy, Debug)]
struct Run {
    /// Column and row of the first one, about.
    left: i32,
    top: i32,
    /// What is to be added to them, and for the last one.
    first: (f32, f32),
    last: (f32, f32),
}

impl Run {
    #[inline(always)]
    fn slope(&self) -> (f32, f32) {
        const PER_LANE: f32 = 1.0 / LAST_LANE;
        ((self.last.0 - self.first.0) * PER_LANE, (self.last.1 - self.first.1) * PER_LANE)
    }

    /// Whether all pixels lie beside each other where they come from: within the pixels from (left, top) on.
    #[inline(always)]
    fn is_straight(&self) -> bool {
        let within = |x: f32| (x - 0.5).abs() <= 0.5 + BEYOND;
        within(self.first.0) & within(self.first.1) & within(self.last.0) & within(self.last.1)
    }
}

/// A run pixel by pixel, the border repeated.
#[inline(never)]
fn look_up_run(source: &Level, run: &Run, factors: &[f32; RUN], values: &mut [i16; RUN]) {
    let slope = run.slope();
    for l in 0..RUN {
        let lane = l as u32 as f32;
        let (dx, dy) = (run.first.0 + slope.0 * lane, run.first.1 + slope.1 * lane);
        let (wx, wy) = (below(dx), below(dy));
        let (x, y) = (run.left + l as i32 + wx as i32, run.top + wy as i32);
        let column = |x: i32| x.clamp(0, source.width as i32 - 1) as usize;
        let line = |y: i32| y.clamp(0, source.height as i32 - 1) as usize * source.stride;
        let (c0, c1, r0, r1) = (column(x), column(x + 1), line(y), line(y + 1));
        let v = &source.values;
        let corners = [v[r0 + c0], v[r0 + c1], v[r1 + c0], v[r1 + c1]];
        values[l] = rounded(bilinear(corners, dx - wx, dy - wy) * factors[l]);
    }
}

/// The nearest whole number within what a level may hold.
#[inline(always)]
fn rounded(grey: f32) -> i16 {
    (grey.clamp(0.0, GREATEST) + WHOLE).to_bits() as i16
}

/// Greatest value that a derivative still fits 16 bits with: the gain may brighten beyond white.
const GREATEST: f32 = 4080.0;

/// Whether `count` columns or rows from `i` on, and the next one, are there.
#[inline(always)]
fn fits(i: i32, count: usize, side: usize) -> bool {
    i >= 0 && i + (count as i32) < side as i32
}

/// The whole number below; where `x` is one, this or the next lower.
#[inline(always)]
fn below(x: f32) -> f32 {
    ((x - 0.5) + WHOLE) - WHOLE
}

/// So far a bilinear surface is continued beyond its four pixels, that runs whose displacement is about a
/// whole number need not be looked up pixel by pixel. The error is a 30th of the second difference, a
/// quarter of the interpolation's own at its worst.
const BEYOND: f32 = 1.0 / 16.0;

#[inline(always)]
fn bilinear(corners: [i16; 4], fx: f32, fy: f32) -> f32 {
    let [a, b, c, d] = corners.map(f32::from);
    let (above, below) = (a + fx * (b - a), c + fx * (d - c));
    above + fy * (below - above)
}
