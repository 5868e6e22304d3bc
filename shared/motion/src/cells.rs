//! The grid of cells and the weights that bring a level's votes down to it (paper, section 2.3.2: "we
//! can thus blur and subsample the 12 fields of motion votes so as to reduce the smallest acceptable
//! target size to 1 pixel").
//!
//! 16 cells lie along the shorter side. design notes on vision, section 2 item 7 blurs and subsamples repeatedly with
//! `[1 3 3 1] / 8`; that is a subdivision scheme whose kernel is the quadratic B-spline with the cell's
//! width between its knots. Here each cell is weighted with that spline in one go, which works for cells
//! of any width. Two deviations: votes are first summed over blocks of a quarter of a cell, which then
//! have one weight (averaged over a block, the two kernels agree to 1 % of the peak, as a test says); and
//! at the frame's border the repeated kernel loses a part of the votes at each stage, the spline does not.

use crate::pyramid::LEVELS;

/// Room for the cells of one vote field.
pub const MAX_CELLS: usize = 1024;
/// Cells along the shorter side of the frame: 1 cell is then 1/256 of a square image, and "never more
/// than about 1/16 of the image" is 16 cells.
pub const CELLS_ALONG_SHORTER_SIDE: usize = 16;
/// Widest block of votes that is summed before it is weighted, level px. Four rows of votes just fit
/// 16 bits (see `votes.rs`).
pub(crate) const MAX_BLOCK: usize = 4;
/// The weights of a cell sum up to 1 in this fixed point. Block sums are below 2^17, so 32 bits hold a
/// weighted column.
pub(crate) const WEIGHT_ONE: i32 = 1 << 12;

/// Columns, rows and width of the cells of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Grid {
    pub(crate) columns: usize,
    pub(crate) rows: usize,
    /// Side of a cell, full-resolution px. Cell (x, y) has its centre at ((x + 0.5), (y + 0.5)) x this,
    /// counted from the centre of the top-left pixel: vote `i` of level `k` lies at `2^k (i + 0.5)`.
    pub(crate) cell_px: f64,
}

impl Grid {
    /// The grid of a frame of `width` x `height` px: 16 cells along the shorter side, fewer where the frame
    /// is so long (beyond 4 : 1) that they would exceed [`MAX_CELLS`].
    pub(crate) fn new(width: usize, height: usize) -> Grid {
        let (shorter, longer) = (width.min(height), width.max(height));
        let along = (1..=CELLS_ALONG_SHORTER_SIDE)
            .rev()
            .find(|along| along * (longer * along / shorter) <= MAX_CELLS)
            .unwrap_or(1);
        let columns = width * along / shorter;
        let rows = height * along / shorter;
        Grid { columns, rows, cell_px: shorter as f64 / along as f64 }
    }
}

/// How one level is reduced to the grid.
#[derive(Clone, Debug)]
pub(crate) struct LevelPlan {
    /// Side of the blocks whose votes are summed first, level px: a quarter of a cell, 1..=[`MAX_BLOCK`].
    pub(crate) block: usize,
    pub(crate) horizontal: AxisWeights,
    pub(crate) vertical: AxisWeights,
}

impl LevelPlan {
    /// The plans of all levels of a pyramid whose level `k` is `sizes[k]` (columns, rows).
    pub(crate) fn all(grid: &Grid, sizes: [(usize, usize); LEVELS]) -> [LevelPlan; LEVELS] {
        std::array::from_fn(|k| {
            let (width, height) = sizes[k];
            let cell = grid.cell_px / f64::from(2u32 << k);
            let block = ((cell / 4.0) as usize).clamp(1, MAX_BLOCK);
            let horizontal = AxisWeights::new(grid.columns, cell, block, width.div_ceil(block));
            let vertical = AxisWeights::new(grid.rows, cell, block, height.div_ceil(block));
            LevelPlan { block, horizontal, vertical }
        })
    }
}

/// For each cell along one axis, the blocks that count for it and their weights.
#[derive(Clone, Debug)]
pub(crate) struct AxisWeights {
    pub(crate) blocks: usize,
    taps: usize,
    first: Vec<usize>,
    weights: Vec<i32>,
}

impl AxisWeights {
    /// Weights of `cells` cells of `cell` level px over `blocks` blocks of `block` level px. Blocks
    /// outside the frame count 0.
    pub(crate) fn new(cells: usize, cell: f64, block: usize, blocks: usize) -> AxisWeights {
        let block = block as f64;
        // A cell narrower than a level pixel cannot be resolved: the spline stays a pixel wide.
        let knots = cell.max(1.0);
        let reach = 1.5 * knots;
        let taps = ((2.0 * reach / block).ceil() as usize + 1).min(blocks);
        let mut axis = AxisWeights { blocks, taps, first: Vec::new(), weights: Vec::new() };
        for g in 0..cells {
            let centre = (g as f64 + 0.5) * cell;
            let first = ((centre - reach) / block).floor().max(0.0) as usize;
            let first = first.min(blocks - taps);
            axis.first.push(first);
            for b in first..first + taps {
                let distance = ((b as f64 + 0.5) * block - centre) / knots;
                let weight = quadratic_spline(distance) * block / knots;
                axis.weights.push((weight * f64::from(WEIGHT_ONE)).round() as i32);
            }
        }
        axis
    }

    /// How many cells.
    #[inline(always)]
    pub(crate) fn cells(&self) -> usize {
        self.first.len()
    }

    /// The first block and the weights of each cell, in order.
    #[inline(always)]
    pub(crate) fn iter(&self) -> impl Iterator<Item = (usize, &[i32])> {
        self.first.iter().copied().zip(self.weights.chunks_exact(self.taps))
    }
}

/// The centred quadratic B-spline with knots 1 apart.
fn quadratic_spline(t: f64) -> f64 {
    let t = t.abs();
    if t < 0.5 {
        0.75 - t * t
    } else if t < 1.5 {
        0.5 * (1.5 - t) * (1.5 - t)
    } else {
        0.0
    }
}
