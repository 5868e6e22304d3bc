//! Where a large translation may have brought the image: exhaustive search on a small picture of it.

use multiversion::multiversion;

use crate::pyramid::Level;

/// Room for the picture that is searched; its shorter side is at most [`MAX_SHORTER`].
pub(crate) const MAX_SHORTER: usize = 96;
/// Search in each direction, share of the side.
const REACH_SHARE: usize = 5;
/// Lanes of the correlation.
const RUN: usize = 16;
/// Rows of a template of which every second one is looked at.
const MANY_ROWS: usize = 36;
/// A second peak is a candidate where its correlation is within this of the best.
const RIVAL: f32 = 0.15;
/// ... and at least so far away, px of the picture.
const RIVAL_DISTANCE: i32 = 3;

/// Working memory of the search.
#[derive(Clone, Debug)]
pub(crate) struct Search {
    width: usize,
    height: usize,
    reach: (usize, usize),
    template: Vec<i16>,
    picture: Vec<i16>,
    stride: usize,
    squares: Vec<i64>,
    sums: Vec<i64>,
    scores: Vec<f32>,
}

impl Search {
    /// For pictures of `width` x `height` px.
    pub(crate) fn new(width: usize, height: usize) -> Search {
        let reach = |side: usize| (side / REACH_SHARE).min(MAX_SHORTER / REACH_SHARE);
        let reach = (reach(width), reach(height));
        let stride = width.next_multiple_of(RUN) + RUN;
        Search {
            width,
            height,
            reach,
            template: vec![0; width.next_multiple_of(RUN) * height],
            picture: vec![0; stride * height],
            stride,
            squares: vec![0; (width + 1) * (height + 1)],
            sums: vec![0; (width + 1) * (height + 1)],
            scores: vec![0.0; (2 * reach.0 + 1) * (2 * reach.1 + 1)],
        }
    }

    /// The translation (right, down) with the highest normalised correlation, px of the picture, and a
    /// rival where another is nearly as good.
    pub(crate) fn candidates(&mut self, older: &Level, newer: &Level) -> [Option<(i32, i32)>; 2] {
        self.fill(older, newer);
        let (rx, ry) = (self.reach.0 as i32, self.reach.1 as i32);
        let inner = (self.width - 2 * self.reach.0, self.height - 2 * self.reach.1);
        correlate(self, inner);
        let columns = 2 * rx + 1;
        let scores = &self.scores;
        let best_of = |allowed: &dyn Fn(i32, i32) -> bool| {
            let mut best: Option<(f32, i32, i32)> = None;
            for (i, &score) in scores.iter().enumerate() {
                // The template stays where it is in the newer frame, the older is looked up at (x, y).
                let (u, v) = (rx - i as i32 % columns, ry - i as i32 / columns);
                // Of equals (bars, which look alike wherever along them) the shortest.
                let better = |(held, x, y): (f32, i32, i32)| {
                    score > held || (score == held && u * u + v * v < x * x + y * y)
                };
                if allowed(u, v) && best.is_none_or(better) {
                    best = Some((score, u, v));
                }
            }
            best
        };
        let Some((score, u, v)) = best_of(&|_, _| true) else { return [None; 2] };
        let rival = best_of(&|x, y| (x - u).abs().max((y - v).abs()) >= RIVAL_DISTANCE);
        let rival = rival.filter(|(other, ..)| *other > score - RIVAL);
        [Some((u, v)), rival.map(|(_, u, v)| (u, v))]
    }

    /// Both pictures in whole grey levels about 0, the template without its mean, and the integrals.
    fn fill(&mut self, older: &Level, newer: &Level) {
        let (w, h) = (self.width, self.height);
        for y in 0..h {
            let row = &older.values[y * older.stride..][..w];
            let line = &mut self.picture[y * self.stride..][..w];
            let (above, below) = (y * (w + 1), (y + 1) * (w + 1));
            let (mut sum, mut square) = (0, 0);
            for (x, (value, &grey)) in line.iter_mut().zip(row).enumerate() {
                *value = (grey >> 4) - 128;
                sum += i64::from(*value);
                square += i64::from(*value) * i64::from(*value);
                self.sums[below + x + 1] = self.sums[above + x + 1] + sum;
                self.squares[below + x + 1] = self.squares[above + x + 1] + square;
            }
        }
        let (rx, ry) = self.reach;
        let inner = (w - 2 * rx, h - 2 * ry);
        let rows = || (ry..ry + inner.1).map(|y| &newer.values[y * newer.stride + rx..][..inner.0]);
        let total: i64 = rows().flatten().map(|&grey| i64::from(grey)).sum();
        let mean = total / (16 * (inner.0 * inner.1) as i64);
        let padded = inner.0.next_multiple_of(RUN);
        self.template.fill(0);
        for (line, row) in self.template.chunks_exact_mut(padded).zip(rows()) {
            for (value, &grey) in line.iter_mut().zip(row) {
                *value = (grey >> 4) - mean as i16;
            }
        }
    }

    /// Sum and sum of squares of the window of `inner` px at (x, y).
    fn window(&self, (x, y): (usize, usize), inner: (usize, usize)) -> (f64, f64) {
        let stride = self.width + 1;
        let over = |table: &[i64]| {
            let at = |x: usize, y: usize| table[y * stride + x];
            let (x1, y1) = (x + inner.0, y + inner.1);
            (at(x1, y1) - at(x, y1) - at(x1, y) + at(x, y)) as f64
        };
        (over(&self.sums), over(&self.squares))
    }
}

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn correlate(search: &mut Search, inner: (usize, usize)) {
    let padded = inner.0.next_multiple_of(RUN);
    let columns = 2 * search.reach.0 + 1;
    let n = (inner.0 * inner.1) as f64;
    // Neighbouring rows say much the same: of a large template every second one is enough.
    let step = if inner.1 >= MANY_ROWS { 2 } else { 1 };
    for place in 0..search.scores.len() {
        let (x, y) = (place % columns, place / columns);
        let mut sums = [0i32; RUN];
        for row in (0..inner.1).step_by(step) {
            let line = &search.picture[(y + row) * search.stride + x..][..padded];
            let template = &search.template[row * padded..][..padded];
            let (line, template) = (line.as_chunks::<RUN>().0, template.as_chunks::<RUN>().0);
            for (a, t) in line.iter().zip(template) {
                for l in 0..RUN {
                    sums[l] += i32::from(a[l]) * i32::from(t[l]);
                }
            }
        }
        let product: i64 = sums.iter().map(|&sum| i64::from(sum)).sum();
        let (sum, squares) = search.window((x, y), inner);
        let deviation = (squares - sum * sum / n).max(1.0);
        search.scores[place] = (product as f64 / deviation.sqrt()) as f32;
    }
    // The template's own deviation is the same for all places: divide, so that scores are correlations.
    let rows = search.template.chunks_exact(padded).take(inner.1).step_by(step);
    let own: f64 = rows.flatten().map(|&t| f64::from(t) * f64::from(t)).sum();
    // The product and the template's deviation are over every `step`-th row, the picture's over all.
    let scale = (step as f64 / own.max(1.0)).sqrt() as f32;
    search.scores.iter_mut().for_each(|score| *score *= scale);
}
