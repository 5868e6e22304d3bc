//! What the robust detector says of one pair of frames.

use super::MAX_TARGETS;
use super::model::GlobalMotion;

/// Something that moves on its own.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Candidate {
    /// Position in the newer frame, px from the centre of the top-left pixel to the right.
    pub u: f64,
    /// As `u`, downward.
    pub v: f64,
    /// Displacement in the image over the pair, px.
    pub vu: f64,
    /// As `vu`, downward.
    pub vv: f64,
    /// Displacement relative to the background, px.
    pub relative: [f64; 2],
    /// Area, px².
    pub area_px: f64,
    /// Probability that this is a target, 0..1; calibrated so that 0.5 is the cut for a single pair.
    pub confidence: f64,
    /// Covariance of the position: uu, uv, vv, px².
    pub position_covariance: [f64; 3],
    /// Standard deviation of the velocity in each direction, px per pair.
    pub velocity_sd: f64,
    /// Largest evidence over its threshold: 1 is at the threshold.
    pub evidence: f64,
    /// The same of the normalised votes alone.
    pub votes_evidence: f64,
    /// The same of the residual alone.
    pub residual_evidence: f64,
    /// Largest evidence over its threshold anywhere else in the image.
    pub rival: f64,
    /// Share of the cells elsewhere whose evidence is above half of its threshold.
    pub clutter: f64,
    /// Share of the residual that the target's motion explains, 0..1; 0 without competition.
    pub explained: f64,
    /// Second moments of the extent: uu, uv, vv, px².
    pub spread: [f64; 3],
}

/// The answer to one pair.
#[derive(Clone, Debug, PartialEq)]
pub struct Findings {
    /// Why there is nothing to say, where there is not.
    pub outcome: Outcome,
    /// The background's motion.
    pub background: GlobalMotion,
    /// What moves on its own, strongest evidence first.
    pub candidates: [Candidate; MAX_TARGETS],
    /// How many of them there are.
    pub count: usize,
    /// The largest evidence over its threshold, also where it is below 1.
    pub evidence: f64,
}

impl Findings {
    /// The candidate that is most probably a target, if one is so with at least `confidence`.
    pub fn target(&self, confidence: f64) -> Option<&Candidate> {
        let best = self.candidates[..self.count].iter().max_by(|a, b| a.confidence.total_cmp(&b.confidence));
        best.filter(|candidate| candidate.confidence >= confidence)
    }
}

/// How far the detector came with a pair.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// All the way.
    Answered,
    /// There was no pair of frames.
    NoPair,
    /// Both frames are the same to the last bit: the camera has stopped sending, or nothing is alive.
    Frozen,
    /// A frame has no structure that could be seen moving.
    Featureless,
    /// No motion of a camera explains the pair: a cut, or something in front of the lens.
    Unexplained,
}
