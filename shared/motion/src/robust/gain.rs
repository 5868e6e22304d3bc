//! The local gain: light that changes from frame to frame, differently across the image.

use crate::pyramid::{LANES, Level};

/// The ratio of the local means of the newer and the compensated older frame (design notes on vision,
/// section 6 R3), at the pixels of level 3, bilinear in between.
#[derive(Clone, Debug)]
pub(crate) struct Gain {
    width: usize,
    height: usize,
    radius: usize,
    factors: Vec<f32>,
    /// Column sums of the window in work: older, newer, count.
    columns: [Vec<i32>; 3],
    blended: Vec<f32>,
    line: Vec<f32>,
}

/// Added to both means, in 1/16 grey level: black stays black.
const DARK: i32 = 4 * 16;
/// Half a window, level-3 px, where level 1 is 256 px high: 28 base px.
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
            blended: vec![1.0; width + 1],
            line: vec![1.0; padded],
        }
    }

    /// Measures it: `older` is level 3 of the older frame warped with no gain, valid in `spans`.
    pub(crate) fn measure(&mut self, older: &Level, newer: &Level, spans: &[(usize, usize)]) {
        let (w, h, r) = (self.width, self.height, self.radius);
        self.columns.iter_mut().for_each(|column| column.fill(0));
        let add = |columns: &mut [Vec<i32>; 3], y: usize, sign: i32| {
            let (from, to) = spans[y];
            let (a, b) = (&older.values[y * older.stride..][..w], &newer.values[y * newer.stride..][..w]);
            for x in from..to {
                columns[0][x] += sign * (i32::from(a[x]) + DARK);
                columns[1][x] += sign * (i32::from(b[x]) + DARK);
                columns[2][x] += sign;
            }
        };
        for y in 0..r.min(h) {
            add(&mut self.columns, y, 1);
        }
        for y in 0..h {
            if y + r < h {
                add(&mut self.columns, y + r, 1);
            }
            if y > r {
                add(&mut self.columns, y - r - 1, -1);
            }
            let (mut a, mut b, mut n) = (0i64, 0i64, 0i64);
            let step = |a: &mut i64, b: &mut i64, n: &mut i64, x: usize, sign: i64| {
                *a += sign * i64::from(self.columns[0][x]);
                *b += sign * i64::from(self.columns[1][x]);
                *n += sign * i64::from(self.columns[2][x]);
            };
            for x in 0..r.min(w) {
                step(&mut a, &mut b, &mut n, x, 1);
            }
            for x in 0..w {
                if x + r < w {
                    step(&mut a, &mut b, &mut n, x + r, 1);
                }
                if x > r {
                    step(&mut a, &mut b, &mut n, x - r - 1, -1);
                }
                self.factors[y * w + x] = if n > 0 && a > 0 { b as f32 / a as f32 } else { 1.0 };
            }
        }
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
