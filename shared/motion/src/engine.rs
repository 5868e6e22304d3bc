//! [`VoteEngine`]: from a pair of frames to the 12 vote fields after compensation.

use std::fmt;

use crate::cells::{Grid, LevelPlan, MAX_CELLS};
use crate::compensation::{coherence, rounded_shift, total, translation, voting_region};
use crate::image::{Image, MAX_SIDE, MIN_SIDE};
use crate::pair::FramePair;
use crate::parameters::{ParameterError, Parameters};
use crate::pyramid::{LEVELS, Pyramid};
use crate::votes::{DIRECTIONS, LevelSums, SweepScratch, sweep};

/// Signed vote fields: 3 scales x 4 directions (paper, section 2.3.1).
pub const FIELDS: usize = 12;
/// The vote fields of a pair, reduced to cells. Field `k` has the label `k + 1` of the paper's figure 3;
/// its first `columns * rows` values are used, row by row. Unit: grey levels per frame.
pub type Fields = [[f32; MAX_CELLS]; FIELDS];

/// The frame before.
#[derive(Clone, Copy, Debug)]
pub enum Older<'a> {
    /// There is none: nothing can be voted on.
    Missing,
    /// The very frame that was `newer` in the last call: its pyramid is still there and is used again.
    LastNewer(Image<'a>),
    /// Any frame. Always right, and costs one pyramid more; for a frame that is repeated, or after a gap.
    Frame(Image<'a>),
}

/// The parts of a voting step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// The pyramids of the frames as they are.
    Pyramid,
    /// Paper mode: the estimate of the translation and the pyramid of the shifted frame, once per pass. Robust
    /// mode: the fit of the global motion and the warped levels.
    Compensation,
    /// Derivatives, votes, cells; once more than the passes.
    Votes,
    /// Blobs of evidence and the motions that compete for them (robust mode).
    Competition,
}

/// Is told when a part of a step has ended, so that who has a clock can time the parts.
pub trait Probe {
    /// `part` has just ended. Parts come several times in one step: sum them.
    fn ended(&mut self, part: Part);
}

/// A probe that does nothing.
#[derive(Clone, Copy, Debug, Default)]
pub struct NoProbe;

impl Probe for NoProbe {
    fn ended(&mut self, _part: Part) {}
}

/// What is known of the vote fields beside themselves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VoteSummary {
    /// Whether there was a pair to vote on. Where not, all fields and all below but the grid are 0.
    pub valid: bool,
    /// Cells per row.
    pub columns: usize,
    /// Rows of cells.
    pub rows: usize,
    /// Side of a cell, full-resolution px; not always whole. Cell (x, y) has its centre at
    /// ((x + 0.5), (y + 0.5)) times this, counted from the centre of the top-left pixel.
    pub cell_px: f32,
    /// What the older frame was moved by (right, down), px.
    pub shift: (i32, i32),
    /// How often it was moved.
    pub passes: u32,
    /// Coherence of each field on the compensated pair: 1 where all moves at the nominal velocity, -1 at
    /// the opposite; up to 1.22 towards the upper end of the octave.
    pub coherence: [f64; FIELDS],
    /// Sum of the absolute coherences: how loud the background still is.
    pub coherence_sum: f64,
    /// Background velocity (right, down), px/frame: the shift plus what a further pass would add.
    pub background: (f64, f64),
}

/// Votes on pairs of frames of one shape. After construction nothing is allocated.
///
/// It has no memory that matters: the result is a function of the two frames alone.
#[derive(Clone, Debug)]
pub struct VoteEngine {
    pair: FramePair,
    parameters: Parameters,
    grid: Grid,
    plans: [LevelPlan; LEVELS],
    shifted: Pyramid,
    scratch: SweepScratch,
}

impl VoteEngine {
    /// An engine for frames of `width` x `height` px.
    ///
    /// # Errors
    /// A side outside [`MIN_SIDE`]`..=`[`MAX_SIDE`], or a parameter outside its range.
    pub fn new(width: usize, height: usize, parameters: &Parameters) -> Result<VoteEngine, EngineError> {
        let pair = FramePair::new(width, height, parameters.smoothing)?;
        parameters.check()?;
        let grid = Grid::new(width, height);
        let sizes = std::array::from_fn(|k| (pair.newer.levels[k].width, pair.newer.levels[k].height));
        let plans = LevelPlan::all(&grid, sizes);
        Ok(VoteEngine {
            parameters: *parameters,
            grid,
            plans,
            scratch: SweepScratch::new(sizes[0].0, grid.rows),
            shifted: pair.newer.clone(),
            pair,
        })
    }

    /// Columns and rows of the frames, px.
    pub fn size(&self) -> (usize, usize) {
        self.pair.size
    }

    /// Writes the vote fields of the pair after compensation; cells beyond the grid are left alone.
    ///
    /// The pass of the paper is: vote, estimate the translation, move the older frame, vote again. It is
    /// repeated until the rounded shift stays or [`Parameters::passes`] are done. Votes along the border
    /// whose partner came from outside count for the estimate, but never for the cells.
    ///
    /// # Panics
    /// If a frame is not of the engine's shape.
    pub fn vote(
        &mut self,
        older: Older<'_>,
        newer: Image<'_>,
        fields: &mut Fields,
        probe: &mut impl Probe,
    ) -> VoteSummary {
        let older = self.pair.take(older, &newer);
        probe.ended(Part::Pyramid);
        let Some(older) = older else {
            for field in fields.iter_mut() {
                field[..self.grid.columns * self.grid.rows].fill(0.0);
            }
            return self.summary(false, (0, 0), 0, [0.0; FIELDS]);
        };
        let (mut shift, mut passes) = ((0, 0), 0);
        loop {
            let coherence = self.vote_on_shifted(shift, passes > 0, fields);
            probe.ended(Part::Votes);
            let rest = translation(&coherence, self.parameters.floor);
            let better = rounded_shift(shift, rest, self.pair.size);
            if passes == self.parameters.passes || better == shift {
                return self.summary(true, shift, passes, coherence);
            }
            (shift, passes) = (better, passes + 1);
            self.shifted.build(&older, shift);
            probe.ended(Part::Compensation);
        }
    }

    /// Level `k` (0, 1, 2) of the newer frame of the last call: columns, rows, values from row to row, and
    /// the values, in 1/16 grey level.
    ///
    /// # Panics
    /// If there is no such level.
    pub fn level(&self, k: usize) -> (usize, usize, usize, &[i16]) {
        self.pair.level(k)
    }

    /// One sweep over all levels; the coherence of each field.
    fn vote_on_shifted(&mut self, shift: (i32, i32), shifted: bool, fields: &mut Fields) -> [f64; FIELDS] {
        let older = if shifted { &self.shifted } else { &self.pair.older };
        let mut sums = [LevelSums::default(); LEVELS];
        for (k, fields) in fields.chunks_exact_mut(DIRECTIONS).enumerate() {
            let pair = (&older.levels[k], &self.pair.newer.levels[k]);
            let size = (pair.1.width, pair.1.height);
            let region = voting_region(shift, self.parameters.smoothing, k, size);
            sums[k] = sweep(pair, region, &self.plans[k], &mut self.scratch, fields);
        }
        coherence(&sums)
    }

    fn summary(&self, valid: bool, shift: (i32, i32), passes: u32, coherence: [f64; FIELDS]) -> VoteSummary {
        let rest = translation(&coherence, self.parameters.floor);
        VoteSummary {
            valid,
            columns: self.grid.columns,
            rows: self.grid.rows,
            cell_px: self.grid.cell_px as f32,
            shift,
            passes,
            coherence,
            coherence_sum: total(&coherence),
            background: (f64::from(shift.0) + rest.0, f64::from(shift.1) + rest.1),
        }
    }
}

/// Why there is no engine for a shape and parameters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum EngineError {
    /// A side is outside the range.
    Size {
        /// Columns, px.
        width: usize,
        /// Rows, px.
        height: usize,
    },
    /// A parameter is outside its range.
    Parameter(ParameterError),
}

impl fmt::Display for EngineError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            EngineError::Size { width, height } => {
                write!(f, "frames are {width}x{height} px; each side must be {MIN_SIDE} to {MAX_SIDE} px")
            }
            EngineError::Parameter(error) => error.fmt(f),
        }
    }
}

impl std::error::Error for EngineError {}

impl From<ParameterError> for EngineError {
    fn from(error: ParameterError) -> EngineError {
        EngineError::Parameter(error)
    }
}
