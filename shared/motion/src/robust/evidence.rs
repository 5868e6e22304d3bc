//! Evidence of independent motion, as numbers that do not depend on contrast: the votes over what the
//! same gradients would vote at the nominal velocity, and the residual over the gradients.

use multiversion::multiversion;

use super::map::Map;
use super::parameters::{EvidenceParameters, SCALES};
use super::warp::Span;
use crate::FIELDS;
use crate::pyramid::{LANES, LEVELS, Level};
use crate::votes::{DIRECTIONS, grey_per_unit, vote_columns};

/// Cells along the shorter side, about: level 1 of 256 px has cells of 4 px.
const CELLS: usize = 64;
/// Rows of votes whose sums fit 16 bits (see `votes.rs`).
const STRIP: usize = 4;
/// Labels that have a meaning in the smallest windows: those of level 3 are wider than them.
const FINE_FIELDS: usize = 8;
/// Bins per unit of evidence in the quantile's histogram.
const BINS_PER_UNIT: f32 = 1024.0;
const BINS: usize = 4096;

/// Sums over cells at one window scale.
#[derive(Clone, Debug)]
struct Sums {
    columns: usize,
    rows: usize,
    /// Per label: votes, in grey levels as the paper's M, mean over the cell.
    votes: Vec<Vec<f32>>,
    /// Per label: sqrt 2 abs(d), grey levels.
    norms: Vec<Vec<f32>>,
    /// It^2, grey levels squared.
    residual: Vec<f32>,
    /// Ix^2 + Iy^2.
    gradient: Vec<f32>,
}

impl Sums {
    fn new(columns: usize, rows: usize) -> Sums {
        let cells = columns * rows;
        Sums {
            columns,
            rows,
            votes: vec![vec![0.0; cells]; FIELDS],
            norms: vec![vec![0.0; cells]; FIELDS],
            residual: vec![0.0; cells],
            gradient: vec![0.0; cells],
        }
    }
}

/// Evidence of one pair and the memory for it.
#[derive(Clone, Debug)]
pub(crate) struct Evidence {
    parameters: EvidenceParameters,
    cell: usize,
    sums: Vec<Sums>,
    /// Two channels of each scale: votes, residual.
    pub(crate) maps: Vec<Map>,
    votes: [Vec<i16>; DIRECTIONS],
    norms: [Vec<u16>; DIRECTIONS],
    energy: [Vec<u32>; 2],
    smooth: [Vec<f32>; 2],
    column: Vec<f32>,
    counts: Vec<u32>,
}

impl Evidence {
    /// For pyramids whose level 1 has `width` x `height` px.
    pub(crate) fn new(width: usize, height: usize, parameters: EvidenceParameters) -> Evidence {
        let cell = ((width.min(height) as f64 / CELLS as f64 / 4.0).round() as usize).max(1) * 4;
        let mut sums = vec![Sums::new(width / cell, height / cell)];
        for s in 1..SCALES {
            let (columns, rows) = ((sums[s - 1].columns / 2).max(1), (sums[s - 1].rows / 2).max(1));
            sums.push(Sums::new(columns, rows));
        }
        let map = |s: usize, untuned: bool| Map {
            columns: sums[s].columns,
            rows: sums[s].rows,
            cell: cell << s,
            values: vec![0.0; sums[s].columns * sums[s].rows],
            threshold: 1.0,
            untuned,
        };
        let maps = (0..SCALES).flat_map(|s| [map(s, false), map(s, true)]).collect();
        let padded = width.next_multiple_of(LANES) + LANES;
        let cells = sums[0].columns * sums[0].rows;
        Evidence {
            parameters,
            cell,
            maps,
            votes: std::array::from_fn(|_| vec![0; padded]),
            norms: std::array::from_fn(|_| vec![0; padded]),
            energy: std::array::from_fn(|_| vec![0; padded]),
            smooth: std::array::from_fn(|_| vec![0.0; cells]),
            column: vec![0.0; sums[0].columns + 4],
            counts: vec![0; BINS],
            sums,
        }
    }

    /// Votes on the compensated pair and fills the maps.
    pub(crate) fn measure(
        &mut self,
        older: &[Level; LEVELS],
        newer: &[Level; LEVELS],
        spans: &[Vec<Span>; LEVELS],
    ) {
        for k in 0..LEVELS {
            accumulate(self, (&older[k], &newer[k]), &spans[k], k);
        }
        for s in 1..SCALES {
            let (finer, coarser) = self.sums.split_at_mut(s);
            reduce_all(&finer[s - 1], &mut coarser[0], &mut self.column);
        }
        for s in 0..SCALES {
            weigh(self, s);
            for channel in 0..2 {
                self.set_threshold(s, channel);
            }
        }
    }

    /// The scene's own statistics: what most cells do not exceed.
    fn set_threshold(&mut self, s: usize, channel: usize) {
        let p = &self.parameters;
        let (floor, factor) = if channel == 0 {
            (p.vote_floor[s], p.vote_factor[s])
        } else {
            (p.residual_floor[s] / p.residual_weight, p.residual_factor[s] / p.residual_weight)
        };
        let map = &mut self.maps[2 * s + channel];
        let quantile = quantile(&map.values, p.quantile, &mut self.counts);
        map.threshold = floor.max(factor * quantile);
        if channel == 1 && !p.untuned {
            map.threshold = f32::INFINITY;
        }
    }

    /// Votes of all labels summed over some cells of scale `s`.
    pub(crate) fn votes_over(&self, s: usize, cells: &[usize]) -> [f64; FIELDS] {
        let votes = &self.sums[s].votes;
        std::array::from_fn(|i| cells.iter().map(|&cell| f64::from(votes[i][cell])).sum())
    }

    /// The scale whose cells are shown: the coarsest with enough of them to see a shape.
    fn shown(&self) -> usize {
        const LEAST: usize = 12;
        let enough = |s: &usize| self.sums[*s].columns.min(self.sums[*s].rows) >= LEAST;
        (0..SCALES).rev().find(enough).unwrap_or(0)
    }

    /// Cells per row, rows, and side of a cell in base px, of the scale that is shown.
    pub(crate) fn shown_grid(&self) -> (usize, usize, usize) {
        let s = self.shown();
        (self.sums[s].columns, self.sums[s].rows, self.cell << s)
    }

    /// The normalised votes of label `i` (from 0) at that scale, row by row.
    pub(crate) fn shown_votes(&self, i: usize) -> impl Iterator<Item = f32> {
        let sums = &self.sums[self.shown()];
        let least = self.parameters.least_gradient;
        sums.votes[i].iter().zip(&sums.norms[i]).map(move |(vote, norm)| vote / (norm + least))
    }

    /// Side of a cell of the finest scale, base px.
    pub(crate) fn cell(&self) -> usize {
        self.cell
    }
}

/// The value that a share of the cells does not exceed.
pub(crate) fn quantile(values: &[f32], share: f32, counts: &mut [u32]) -> f32 {
    counts.fill(0);
    for &value in values {
        counts[((value * BINS_PER_UNIT) as usize).min(BINS - 1)] += 1;
    }
    let wanted = (share * values.len() as f32) as u32;
    let mut below = 0;
    let bin = counts.iter().position(|&count| {
        below += count;
        below > wanted
    });
    bin.unwrap_or(BINS - 1) as f32 / BINS_PER_UNIT
}

/// Adds up level `k` in the cells of the finest scale.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn accumulate(evidence: &mut Evidence, pair: (&Level, &Level), spans: &[Span], k: usize) {
    let Evidence { cell, sums, votes, norms, energy, .. } = evidence;
    let sums = &mut sums[0];
    let cell = *cell >> k;
    let strip = cell.min(STRIP);
    let (older, newer) = pair;
    let columns = newer.width - 1;
    let per_cell = 1.0 / (cell * cell) as f32;
    for field in k * DIRECTIONS..(k + 1) * DIRECTIONS {
        sums.votes[field].fill(0.0);
        sums.norms[field].fill(0.0);
    }
    if k == 0 {
        sums.residual.fill(0.0);
        sums.gradient.fill(0.0);
    }
    for gy in 0..sums.rows {
        let line = gy * sums.columns;
        for top in (gy * cell..(gy + 1) * cell).step_by(strip) {
            let bottom = (top + strip).min((gy + 1) * cell).min(newer.height - 1);
            if top >= bottom {
                continue;
            }
            let rows = &spans[top..=bottom];
            let from = rows.iter().map(|span| span.0).max().unwrap_or(0);
            // A vote takes the pixel to its right as well.
            let to = rows.iter().map(|span| span.1).min().unwrap_or(0).saturating_sub(1).min(columns);
            if from >= to {
                continue;
            }
            let of = |level: &'_ Level| top * level.stride..(bottom + 1) * level.stride;
            let (a, b) = (&older.values[of(older)], &newer.values[of(newer)]);
            for x in (from / LANES * LANES..to).step_by(LANES) {
                let (v, n) = vote_columns(a, b, older.stride, bottom - top, x);
                for d in 0..DIRECTIONS {
                    votes[d][x..x + LANES].copy_from_slice(&v[d]);
                    norms[d][x..x + LANES].copy_from_slice(&n[d]);
                }
                if k == 0 {
                    let e = energy_columns(a, b, older.stride, bottom - top, x);
                    energy[0][x..x + LANES].copy_from_slice(&e[0]);
                    energy[1][x..x + LANES].copy_from_slice(&e[1]);
                }
            }
            let cells = line..line + sums.columns;
            for d in 0..DIRECTIONS {
                let field = k * DIRECTIONS + d;
                let vote = grey_per_unit(d) as f32 * per_cell;
                let norm = std::f32::consts::SQRT_2 / 64.0 * per_cell;
                clear_outside(&mut votes[d], from, to);
                clear_outside(&mut norms[d], from, to);
                add_cells(&votes[d], cell, vote, &mut sums.votes[field][cells.clone()]);
                add_cells(&norms[d], cell, norm, &mut sums.norms[field][cells.clone()]);
            }
            if k == 0 {
                // Units of 1/16 grey level.
                let grey = per_cell / 256.0;
                clear_outside(&mut energy[0], from, to);
                clear_outside(&mut energy[1], from, to);
                add_cells(&energy[0], cell, grey, &mut sums.residual[cells.clone()]);
                add_cells(&energy[1], cell, grey, &mut sums.gradient[cells]);
            }
        }
    }
}

#[inline(always)]
fn clear_outside<T: Copy + Default>(values: &mut [T], from: usize, to: usize) {
    values[..from].fill(T::default());
    values[to..].fill(T::default());
}

/// A value that sums exactly in 32 bits.
trait Count: Copy {
    fn count(self) -> f32;
}

impl Count for i16 {
    #[inline(always)]
    fn count(self) -> f32 {
        f32::from(self)
    }
}

impl Count for u16 {
    #[inline(always)]
    fn count(self) -> f32 {
        f32::from(self)
    }
}

impl Count for u32 {
    #[inline(always)]
    fn count(self) -> f32 {
        self as i32 as f32
    }
}

/// Adds the sums of `width` neighbouring values to each cell.
#[inline(always)]
fn add_cells<T: Count>(values: &[T], width: usize, scale: f32, cells: &mut [f32]) {
    match width {
        1 => add_groups::<1, T>(values, scale, cells),
        2 => add_groups::<2, T>(values, scale, cells),
        4 => add_groups::<4, T>(values, scale, cells),
        8 => add_groups::<8, T>(values, scale, cells),
        _ => {
            for (cell, group) in cells.iter_mut().zip(values.chunks_exact(width)) {
                *cell += scale * group.iter().map(|v| v.count()).sum::<f32>();
            }
        }
    }
}

#[inline(always)]
fn add_groups<const N: usize, T: Count>(values: &[T], scale: f32, cells: &mut [f32]) {
    for (cell, group) in cells.iter_mut().zip(values.as_chunks::<N>().0) {
        let mut sum = 0.0;
        for value in group {
            sum += value.count();
        }
        *cell += scale * sum;
    }
}

/// It^2 and Ix^2 + Iy^2 of [`LANES`] columns from `x` on, summed over `rows` rows, in (1/16 grey level)^2.
#[inline(always)]
fn energy_columns(a: &[i16], b: &[i16], stride: usize, rows: usize, x: usize) -> [[u32; LANES]; 2] {
    let lanes = |level: &[i16], at: usize| -> [i16; LANES + 1] {
        *level[at..].first_chunk().expect("a level's rows are padded by the lanes of one block")
    };
    let mut energy = [[0u32; LANES]; 2];
    for row in 0..rows {
        let (a0, a1) = (lanes(a, row * stride + x), lanes(a, (row + 1) * stride + x));
        let (b0, b1) = (lanes(b, row * stride + x), lanes(b, (row + 1) * stride + x));
        for l in 0..LANES {
            let it = (b0[l] - a0[l]) + (b0[l + 1] - a0[l + 1]) + (b1[l] - a1[l]) + (b1[l + 1] - a1[l + 1]);
            let falling = (a1[l + 1] + b1[l + 1]) - (a0[l] + b0[l]);
            let rising = (a0[l + 1] + b0[l + 1]) - (a1[l] + b1[l]);
            let (it, ix, iy) = (it >> 2, (falling + rising) >> 2, (falling - rising) >> 2);
            let square = |v: i16| (i32::from(v) * i32::from(v)) as u32;
            energy[0][l] += square(it);
            energy[1][l] += square(ix) + square(iy);
        }
    }
    energy
}

/// Blurs with `[1 3 3 1] / 8` and keeps every second cell between; outside counts 0.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn reduce_all(finer: &Sums, coarser: &mut Sums, line: &mut [f32]) {
    let from = (finer.columns, finer.rows);
    let to = (coarser.columns, coarser.rows);
    for i in 0..FIELDS {
        reduce(&finer.votes[i], from, &mut coarser.votes[i], to, line);
        reduce(&finer.norms[i], from, &mut coarser.norms[i], to, line);
    }
    reduce(&finer.residual, from, &mut coarser.residual, to, line);
    reduce(&finer.gradient, from, &mut coarser.gradient, to, line);
}

#[inline(always)]
fn reduce(
    finer: &[f32],
    (w, h): (usize, usize),
    coarser: &mut [f32],
    (columns, rows): (usize, usize),
    line: &mut [f32],
) {
    const TAPS: [f32; 4] = [0.125, 0.375, 0.375, 0.125];
    // Cell x of the finer scale lies at x + 1; what is beyond is 0.
    let line = &mut line[..2 * columns.max(w / 2) + 4];
    line.fill(0.0);
    for gy in 0..rows {
        let row = |j: usize| (2 * gy + j).checked_sub(1).filter(|y| *y < h).map(|y| &finer[y * w..][..w]);
        let inner = &mut line[1..=w];
        inner.fill(0.0);
        for (j, tap) in TAPS.into_iter().enumerate() {
            let Some(row) = row(j) else { continue };
            for (sum, value) in inner.iter_mut().zip(row) {
                *sum += tap * value;
            }
        }
        let pairs = line.as_chunks::<2>().0;
        for (out, pair) in coarser[gy * columns..][..columns].iter_mut().zip(pairs.windows(2)) {
            *out = TAPS[0] * (pair[0][0] + pair[1][1]) + TAPS[1] * (pair[0][1] + pair[1][0]);
        }
    }
}

/// Evidence of both channels at scale `s`.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn weigh(evidence: &mut Evidence, s: usize) {
    let Evidence { parameters, sums, maps, smooth: [p, q], column, .. } = evidence;
    let sums = &sums[s];
    let size = (sums.columns, sums.rows);
    let cells = size.0 * size.1;
    let (p, q) = (&mut p[..cells], &mut q[..cells]);
    let (votes, residual) = maps[2 * s..].split_at_mut(1);
    let (votes, residual) = (&mut votes[0].values, &mut residual[0].values);
    votes.fill(0.0);
    let fields = if s == 0 { FINE_FIELDS } else { FIELDS };
    for i in 0..fields {
        smooth_into(&sums.votes[i], size, p, column);
        smooth_into(&sums.norms[i], size, q, column);
        for ((e, vote), norm) in votes.iter_mut().zip(&*p).zip(&*q) {
            let c = vote / (norm + parameters.least_gradient);
            *e += c * c;
        }
    }
    for e in votes.iter_mut() {
        *e = e.sqrt();
    }
    smooth_into(&sums.residual, size, p, column);
    smooth_into(&sums.gradient, size, q, column);
    let least = parameters.least_energy * parameters.least_energy;
    for ((r, it), gradient) in residual.iter_mut().zip(&*p).zip(&*q) {
        *r = (it / (gradient + least)).sqrt();
    }
    if s + 1 < SCALES {
        clear_border(votes, size);
        clear_border(residual, size);
    }
}

/// The outermost cells see too little of their window.
#[inline(always)]
fn clear_border(values: &mut [f32], (w, h): (usize, usize)) {
    values[..w].fill(0.0);
    values[(h - 1) * w..].fill(0.0);
    for row in values.chunks_exact_mut(w) {
        row[0] = 0.0;
        row[w - 1] = 0.0;
    }
}

/// `[1 2 1] / 4` in both directions; outside counts 0.
#[inline(always)]
fn smooth_into(values: &[f32], (w, h): (usize, usize), out: &mut [f32], column: &mut [f32]) {
    for y in 0..h {
        let row = |y: usize| &values[y * w..][..w];
        let middle = row(y);
        let sums = &mut column[1..=w];
        match (y.checked_sub(1), (y + 1 < h).then_some(y + 1)) {
            (Some(above), Some(below)) => {
                let (above, below) = (row(above), row(below));
                for x in 0..w {
                    sums[x] = above[x] + 2.0 * middle[x] + below[x];
                }
            }
            (one, other) => {
                let near = one.or(other).map(row);
                for x in 0..w {
                    sums[x] = 2.0 * middle[x] + near.map_or(0.0, |near| near[x]);
                }
            }
        }
        column[0] = 0.0;
        column[w + 1] = 0.0;
        let line = &mut out[y * w..][..w];
        for x in 0..w {
            line[x] = (column[x] + 2.0 * column[x + 1] + column[x + 2]) / 16.0;
        }
    }
}
