//! Robust mode: the paper's votes, with the camera's motion compensated to a fraction of a pixel and the
//! evidence weighed so that it means the same in every scene (design notes on vision, section 6).
//!
//! ```text
//! pair ─► pyramids ─► search ─► global motion ◄─► local gain        fit, level by level
//!                                     │
//!               older levels ─► warped older levels ─► votes / norms, residual / gradient ─► evidence
//!                                                                                            │
//!               target, velocity, covariance ◄─ competition of motions ◄─ blobs over the threshold
//! ```

mod background;
mod candidates;
pub(crate) mod competition;
pub(crate) mod confidence;
pub(crate) mod evidence;
mod findings;
pub(crate) mod fit;
pub(crate) mod gain;
pub(crate) mod map;
pub mod model;
pub mod parameters;
pub(crate) mod patch;
pub(crate) mod search;
pub(crate) mod turn;
pub(crate) mod warp;

use competition::Competition;
use evidence::Evidence;
pub use findings::{Candidate, Findings, Outcome};
use fit::{Histogram, histogram};
use gain::Gain;
use model::GlobalMotion;
use parameters::RobustParameters;
use search::{MAX_SHORTER, Search};
use warp::Span;

use crate::blobs::Flood;
use crate::cells::MAX_CELLS;
use crate::engine::{EngineError, Fields, Older, Part, Probe};
use crate::image::Image;
use crate::pair::FramePair;
use crate::parameters::Smoothing;
use crate::pyramid::{LEVELS, Level, Pyramid};

/// Targets that are told of one pair at most.
pub const MAX_TARGETS: usize = 4;
/// The fit does not begin on levels whose shorter side is below this.
const LEAST_SIDE: usize = 24;

/// The robust detector for frames of one shape. After construction nothing is allocated, and nothing of one
/// pair is remembered for the next but the pyramid of its newer frame.
#[derive(Clone, Debug)]
pub struct RobustEngine {
    pair: FramePair,
    parameters: RobustParameters,
    warped: [Level; LEVELS],
    spans: [Vec<Span>; LEVELS],
    coarsest: usize,
    search: Search,
    gain: Gain,
    counts: Box<Histogram>,
    evidence: Evidence,
    flood: Flood,
    blob: Vec<usize>,
    competition: Competition,
}

impl RobustEngine {
    /// An engine for frames of `width` x `height` px.
    ///
    /// # Errors
    /// A side outside [`MIN_SIDE`](crate::MIN_SIDE)`..=`[`MAX_SIDE`](crate::MAX_SIDE).
    pub fn new(
        width: usize,
        height: usize,
        parameters: &RobustParameters,
    ) -> Result<RobustEngine, EngineError> {
        let mut pair = FramePair::new(width, height, Smoothing::Binomial)?;
        pair.older = pair.older.with_thumbnails(MAX_SHORTER);
        pair.newer = pair.newer.with_thumbnails(MAX_SHORTER);
        let pyramid = &pair.newer;
        let shorter = |level: &Level| level.width.min(level.height);
        let coarsest = (0..LEVELS).rev().find(|&k| shorter(&pyramid.levels[k]) >= LEAST_SIDE).unwrap_or(0);
        let smallest = smallest(pyramid, coarsest);
        let [first, _, third] = &pyramid.levels;
        let evidence = Evidence::new(first.width, first.height, parameters.evidence);
        let cells = evidence.maps[0].values.len();
        Ok(RobustEngine {
            parameters: *parameters,
            warped: pyramid.levels.clone(),
            spans: std::array::from_fn(|k| vec![(0, 0); pyramid.levels[k].height]),
            coarsest,
            search: Search::new(smallest.width, smallest.height),
            gain: Gain::new(third.width, third.height, first.width),
            counts: histogram(),
            flood: Flood::new(cells),
            blob: Vec::with_capacity(cells),
            evidence,
            competition: Competition::new(),
            pair,
        })
    }

    /// What moves on its own between the two frames.
    ///
    /// # Panics
    /// If a frame is not of the engine's shape.
    pub fn detect(&mut self, older: Older<'_>, newer: Image<'_>, probe: &mut impl Probe) -> Findings {
        let pair = self.pair.take(older, &newer);
        probe.ended(Part::Pyramid);
        let mut findings = Findings {
            outcome: Outcome::Answered,
            background: GlobalMotion::still(self.pair.size.0, self.pair.size.1),
            candidates: [Candidate::default(); MAX_TARGETS],
            count: 0,
            evidence: 0.0,
        };
        if pair.is_none() {
            return Findings { outcome: Outcome::NoPair, ..findings };
        }
        let FramePair { older, newer, .. } = &self.pair;
        if (0..LEVELS).rev().all(|k| older.levels[k].values == newer.levels[k].values) {
            return Findings { outcome: Outcome::Frozen, ..findings };
        }
        if [older, newer].into_iter().any(|pyramid| is_flat(&pyramid.levels[self.coarsest])) {
            return Findings { outcome: Outcome::Featureless, ..findings };
        }
        let Some(background) = self.fit() else {
            return Findings { outcome: Outcome::Unexplained, ..findings };
        };
        findings.background = background;
        self.compensate(&background);
        probe.ended(Part::Compensation);
        self.evidence.measure(&self.warped, &self.pair.newer.levels, &self.spans);
        probe.ended(Part::Votes);
        self.find_candidates(&mut findings);
        probe.ended(Part::Competition);
        findings
    }

    /// Writes the normalised votes as fields, in windows of about a 16th of the frame: cells per row, rows, and the side of a
    /// cell, full-resolution px. All 0 where there was no answer.
    pub fn fields(&self, findings: &Findings, fields: &mut Fields) -> (usize, usize, f64) {
        let (columns, rows, cell) = self.evidence.shown_grid();
        // A long frame may have more cells than there is room for: then several are one.
        let block = (1..).find(|b| columns.div_ceil(*b) * rows.div_ceil(*b) <= MAX_CELLS).unwrap_or(1);
        let (wide, high) = (columns.div_ceil(block), rows.div_ceil(block));
        for (i, field) in fields.iter_mut().enumerate() {
            field[..wide * high].fill(0.0);
            if findings.outcome == Outcome::Answered {
                for (cell, vote) in self.evidence.shown_votes(i).enumerate() {
                    let (x, y) = (cell % columns / block, cell / columns / block);
                    field[y * wide + x] += vote / (block * block) as f32;
                }
            }
        }
        (wide, high, (2 * cell * block) as f64)
    }

    /// Level `k` (0, 1, 2) of the newer frame of the last call: columns, rows, values from row to row, and
    /// the values, in 1/16 grey level.
    ///
    /// # Panics
    /// If there is no such level.
    pub fn level(&self, k: usize) -> (usize, usize, usize, &[i16]) {
        self.pair.level(k)
    }
}

/// Whether all of a level is within one grey level. Any other shows it within its first pixels.
fn is_flat(level: &Level) -> bool {
    const GREY: i16 = 16;
    let (mut least, mut most) = (i16::MAX, i16::MIN);
    level.values.chunks(level.stride).flat_map(|row| &row[..level.width]).all(|&value| {
        (least, most) = (least.min(value), most.max(value));
        most - least < GREY
    })
}

/// The picture of a frame that large translations are searched on: the last thumbnail. There is none where the
/// last level is small already, and only there may the fit begin below it.
fn smallest(pyramid: &Pyramid, coarsest: usize) -> &Level {
    pyramid.thumbnails.last().unwrap_or(&pyramid.levels[coarsest])
}
