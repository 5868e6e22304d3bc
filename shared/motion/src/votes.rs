//! Derivatives and motion votes of one level, summed to cells in one sweep (paper, section 2.3.1). The
//! vote fields at pixel resolution are never stored.
//!
//! With A the older and B the newer level, S = A + B, D = B - A (first index row, second column), the
//! 2x2x2 cube of Horn and Schunck (the paper's reference 8) gives in units of 1/64 grey level
//!
//! ```text
//! It    = D00 + D01 + D10 + D11
//! Ix    = (S11 - S00) + (S01 - S10)      Ix + Iy = 2 (S11 - S00)
//! Iy    = (S11 - S00) - (S01 - S10)      Ix - Iy = 2 (S01 - S10)
//! ```
//!
//! exactly: all are below 4 x 4080 and nothing is rounded, so that swapped frames swap every sign. A
//! vote's weight is abs(It) + abs(d), which is sqrt 2 times the paper's sqrt(It^2 + d^2) within -1.44 %
//! to 0 % over the whole octave.
//!
//! Why 16 bits do: abs(It) + abs(Ix) is at most 4 x 4080 and even, so half of it, four times, is below
//! 2^15. For the diagonals, inside the octave, the sum is at most 23 081, and a quarter of it, rounded,
//! four times, is below 2^15 too.

use multiversion::multiversion;

use crate::cells::{LevelPlan, MAX_BLOCK, MAX_CELLS, WEIGHT_ONE};
use crate::pyramid::{LANES, Level};

/// Directions voted for on each level, in the order of the labels 4k+1..4k+4 of the paper's figure 3:
/// Ix - Iy, Ix + Iy, Ix, Iy.
pub(crate) const DIRECTIONS: usize = 4;
/// 1/sqrt(2) times 2^16. Both comparisons are strict, as in the paper; `b * ROOT_HALF >> 16` is the
/// floor of b/sqrt(2) but for 102 of the 16 321 possible b, where it is one more.
const ROOT_HALF: u32 = 46341;

/// The part of a level whose votes reach the cells: vote (x, y) is taken between the level's pixels x
/// and x + 1, y and y + 1. First and end, within the level's size less 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Region {
    pub(crate) columns: (usize, usize),
    pub(crate) rows: (usize, usize),
}

/// Sums over one whole level, for each direction.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct LevelSums {
    /// The votes: halves of abs(It) + abs(d) for the axes, quarters for the diagonals.
    pub(crate) votes: [i64; DIRECTIONS],
    /// abs(d).
    pub(crate) norms: [i64; DIRECTIONS],
}

/// Working memory of a sweep.
#[derive(Clone, Debug)]
pub(crate) struct SweepScratch {
    votes: [Vec<i16>; DIRECTIONS],
    norms: [Vec<u16>; DIRECTIONS],
    blocks: Vec<i32>,
    /// Per row of cells and direction, the vertically weighted votes of each column of blocks.
    rows: Vec<i32>,
}

impl SweepScratch {
    /// For levels up to `width` columns and grids of `grid_rows` rows of cells.
    pub(crate) fn new(width: usize, grid_rows: usize) -> SweepScratch {
        let padded = width.next_multiple_of(LANES) + MAX_BLOCK;
        SweepScratch {
            votes: std::array::from_fn(|_| vec![0; padded]),
            norms: std::array::from_fn(|_| vec![0; padded]),
            blocks: vec![0; width],
            rows: vec![0; grid_rows * DIRECTIONS * width],
        }
    }
}

/// Votes on one level of a pair; writes the four fields of cells (row by row, in grey levels per frame,
/// as the paper's M averaged over the cell, 0 outside the region) and returns the sums over the level.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl", "x86_64+avx2", "aarch64+neon"))]
pub(crate) fn sweep(
    pair: (&Level, &Level),
    region: Region,
    plan: &LevelPlan,
    scratch: &mut SweepScratch,
    fields: &mut [[f32; MAX_CELLS]],
) -> LevelSums {
    let sums = sweep_blocks(pair.0, pair.1, region, plan, scratch);
    let area = (plan.block * plan.block) as f64 * f64::from(WEIGHT_ONE) * f64::from(WEIGHT_ONE);
    let blocks = plan.horizontal.blocks;
    for (line, row) in scratch.rows.chunks_exact(blocks).enumerate().take(DIRECTIONS * plan.vertical.cells())
    {
        let (gy, direction) = (line / DIRECTIONS, line % DIRECTIONS);
        let scale = grey_per_unit(direction) / area;
        let cells = &mut fields[direction][gy * plan.horizontal.cells()..];
        for (cell, (first, weights)) in cells.iter_mut().zip(plan.horizontal.iter()) {
            let blocks = row[first..].iter().zip(weights);
            let sum: i64 = blocks.map(|(&block, &weight)| i64::from(block) * i64::from(weight)).sum();
            *cell = (sum as f64 * scale) as f32;
        }
    }
    sums
}

/// Grey levels per unit of a vote: axes are kept as (abs(It) + abs(d)) / 2, diagonals as a quarter of
/// the sum, in 1/64 grey level; the sum is sqrt 2 times the paper's weight.
pub(crate) fn grey_per_unit(direction: usize) -> f64 {
    let divisor = if direction < 2 { 4.0 } else { 2.0 };
    divisor / 64.0 * std::f64::consts::FRAC_1_SQRT_2
}

/// Fills `scratch.rows` with the vertically weighted votes of each column of blocks.
#[inline(always)]
fn sweep_blocks(
    older: &Level,
    newer: &Level,
    region: Region,
    plan: &LevelPlan,
    scratch: &mut SweepScratch,
) -> LevelSums {
    let SweepScratch { votes, norms, blocks, rows } = scratch;
    let blocks = &mut blocks[..plan.horizontal.blocks];
    let rows = &mut rows[..plan.vertical.cells() * DIRECTIONS * blocks.len()];
    let columns = newer.width - 1;
    let mut sums = LevelSums::default();
    rows.fill(0);
    for (top, bottom) in strips(plan.block, newer.height - 1, region.rows) {
        let rows_of = |level: &Level| top * level.stride..(bottom + 1) * level.stride;
        let (a, b) = (&older.values[rows_of(older)], &newer.values[rows_of(newer)]);
        for x in (0..columns).step_by(LANES) {
            let (v, n) = vote_columns(a, b, older.stride, bottom - top, x);
            for d in 0..DIRECTIONS {
                votes[d][x..x + LANES].copy_from_slice(&v[d]);
                norms[d][x..x + LANES].copy_from_slice(&n[d]);
            }
        }
        let inside = region.rows.0 <= top && bottom <= region.rows.1;
        for d in 0..DIRECTIONS {
            sums.votes[d] += i64::from(votes[d][..columns].iter().map(|&v| i32::from(v)).sum::<i32>());
            sums.norms[d] += i64::from(norms[d][..columns].iter().map(|&n| u32::from(n)).sum::<u32>());
            if !inside {
                continue;
            }
            votes[d][..region.columns.0].fill(0);
            votes[d][region.columns.1..].fill(0);
            sum_blocks(&votes[d], plan.block, blocks);
            let strip = top / plan.block;
            for (gy, (first, weights)) in plan.vertical.iter().enumerate() {
                let Some(&weight) = strip.checked_sub(first).and_then(|tap| weights.get(tap)) else {
                    continue;
                };
                let row = &mut rows[(gy * DIRECTIONS + d) * blocks.len()..][..blocks.len()];
                for (sum, block) in row.iter_mut().zip(&*blocks) {
                    *sum += weight * block;
                }
            }
        }
    }
    sums
}

/// The rows of blocks of `height` rows of votes, cut where the region begins and ends (first row, end).
#[inline(always)]
fn strips(block: usize, height: usize, region: (usize, usize)) -> impl Iterator<Item = (usize, usize)> {
    let mut top = 0;
    std::iter::from_fn(move || {
        let next = ((top / block + 1) * block).min(height);
        let cut = |bottom: usize, edge: usize| if top < edge && edge < bottom { edge } else { bottom };
        let strip = (top, cut(cut(next, region.1), region.0));
        top = strip.1;
        (strip.0 < strip.1).then_some(strip)
    })
}

/// Sums of `block` neighbouring columns each.
#[inline(always)]
fn sum_blocks(votes: &[i16], block: usize, blocks: &mut [i32]) {
    match block {
        4 => {
            for (sum, v) in blocks.iter_mut().zip(votes.chunks_exact(4)) {
                *sum = i32::from(v[0]) + i32::from(v[1]) + i32::from(v[2]) + i32::from(v[3]);
            }
        }
        2 => {
            for (sum, v) in blocks.iter_mut().zip(votes.chunks_exact(2)) {
                *sum = i32::from(v[0]) + i32::from(v[1]);
            }
        }
        _ => {
            for (sum, v) in blocks.iter_mut().zip(votes.chunks_exact(block)) {
                *sum = v.iter().map(|&v| i32::from(v)).sum();
            }
        }
    }
}

/// Votes of [`LANES`] columns from `x` on, summed over `rows` rows (1..=[`MAX_BLOCK`]); and the sums of
/// abs(d).
#[inline(always)]
pub(crate) fn vote_columns(
    a: &[i16],
    b: &[i16],
    stride: usize,
    rows: usize,
    x: usize,
) -> ([[i16; LANES]; DIRECTIONS], [[u16; LANES]; DIRECTIONS]) {
    let mut votes = [[0i16; LANES]; DIRECTIONS];
    let mut norms = [[0u16; LANES]; DIRECTIONS];
    let (p, q) = (lanes(a, x), lanes(b, x));
    let (mut s0, mut s1, mut d) = ([0i16; LANES], [0i16; LANES], [0i16; LANES]);
    for l in 0..LANES {
        s0[l] = p[l] + q[l];
    }
    for l in 0..LANES {
        s1[l] = p[l + 1] + q[l + 1];
    }
    for l in 0..LANES {
        d[l] = (q[l] - p[l]) + (q[l + 1] - p[l + 1]);
    }
    for row in 1..=rows {
        let (p, q) = (lanes(a, row * stride + x), lanes(b, row * stride + x));
        for l in 0..LANES {
            let below0 = p[l] + q[l];
            let below1 = p[l + 1] + q[l + 1];
            let d_below = (q[l] - p[l]) + (q[l + 1] - p[l + 1]);
            let it = d[l] + d_below;
            let falling = below1 - s0[l];
            let rising = s1[l] - below0;
            let (ix, iy) = (falling + rising, falling - rising);
            (s0[l], s1[l], d[l]) = (below0, below1, d_below);
            votes[0][l] += vote::<2>(it, 2 * rising);
            votes[1][l] += vote::<2>(it, 2 * falling);
            votes[2][l] += vote::<1>(it, ix);
            votes[3][l] += vote::<1>(it, iy);
            norms[0][l] += (2 * rising).unsigned_abs();
            norms[1][l] += (2 * falling).unsigned_abs();
            norms[2][l] += ix.unsigned_abs();
            norms[3][l] += iy.unsigned_abs();
        }
    }
    (votes, norms)
}

/// The pixels that the votes of [`LANES`] columns from `at` on need.
#[inline(always)]
fn lanes(level: &[i16], at: usize) -> &[i16; LANES + 1] {
    level[at..].first_chunk().expect("a level's rows are padded by the lanes of one block")
}

/// The paper's M = - sqrt(It^2 + d^2) sgn(It) sgn(d) T(It, d), in units of 1/64 grey level x `2^BITS` /
/// sqrt 2; T is 1 for 1/sqrt 2 < abs(It / d) < sqrt 2 and 0 elsewhere.
#[inline(always)]
fn vote<const BITS: u32>(it: i16, d: i16) -> i16 {
    let (a, b) = (it.abs(), d.abs());
    let tuned = (a > root_half(b)) & (b > root_half(a));
    let weight = ((a as u16 + b as u16 + (BITS as u16 - 1) * 2) >> BITS) as i16;
    let weight = if tuned { weight } else { 0 };
    let same_sign = !((it ^ d) >> 15);
    (weight ^ same_sign) - same_sign
}

/// Floor of x / sqrt 2 (see [`ROOT_HALF`]) for x >= 0.
#[inline(always)]
fn root_half(x: i16) -> i16 {
    ((u32::from(x as u16) * ROOT_HALF) >> 16) as i16
}
