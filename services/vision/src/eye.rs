//! [`Eye`]: the detector that vision runs, in either mode, from frames to the message.

use crate::config::Detector;
use pursuit_messages::payload::{self, Votes};
use pursuit_messages::{PairOutcome, VisionMode};
use pursuit_motion::{EngineError, Findings, Image, Older, Outcome, Probe, RobustEngine, VoteEngine};

/// One of the two detectors.
pub enum Eye {
    /// The paper's.
    Paper(Box<VoteEngine>),
    /// Ours.
    Robust(Box<RobustEngine>),
}

impl Eye {
    /// A detector for frames of `width` x `height` px.
    ///
    /// # Errors
    /// A shape or a parameter that the detector does not take.
    pub fn new(width: usize, height: usize, detector: &Detector) -> Result<Eye, EngineError> {
        Ok(match detector.mode {
            VisionMode::Paper => Eye::Paper(Box::new(VoteEngine::new(width, height, &detector.paper)?)),
            VisionMode::Robust => Eye::Robust(Box::new(RobustEngine::new(width, height, &detector.robust)?)),
        })
    }

    /// The pure step: from two frames, `interval` frames apart, to the message.
    pub fn look(
        &mut self,
        older: Older<'_>,
        newer: Image<'_>,
        interval: u32,
        votes: &mut Votes,
        probe: &mut impl Probe,
    ) {
        votes.interval = interval;
        match self {
            Eye::Paper(engine) => vote(engine, older, newer, votes, probe),
            Eye::Robust(engine) => detect(engine, older, newer, votes, probe),
        }
    }

    /// Level `k` (0, 1, 2) of the newer frame's pyramid: columns, rows, values from row to row, values in
    /// 1/16 grey level.
    pub fn level(&self, k: usize) -> (usize, usize, usize, &[i16]) {
        match self {
            Eye::Paper(engine) => engine.level(k),
            Eye::Robust(engine) => engine.level(k),
        }
    }
}

fn vote(
    engine: &mut VoteEngine,
    older: Older<'_>,
    newer: Image<'_>,
    votes: &mut Votes,
    probe: &mut impl Probe,
) {
    let summary = engine.vote(older, newer, &mut votes.fields, probe);
    votes.mode = VisionMode::Paper as u32;
    votes.valid = u32::from(summary.valid);
    votes.columns = summary.columns as u32;
    votes.rows = summary.rows as u32;
    votes.passes = summary.passes;
    (votes.shift_u, votes.shift_v) = summary.shift;
    votes.cell_px = summary.cell_px;
    votes.coherence = summary.coherence;
    votes.coherence_sum = summary.coherence_sum;
    (votes.background_u, votes.background_v) = summary.background;
    votes.candidate_count = 0;
}

fn detect(
    engine: &mut RobustEngine,
    older: Older<'_>,
    newer: Image<'_>,
    votes: &mut Votes,
    probe: &mut impl Probe,
) {
    let findings = engine.detect(older, newer, probe);
    votes.mode = VisionMode::Robust as u32;
    votes.valid = u32::from(findings.outcome != Outcome::NoPair);
    let (columns, rows, cell_px) = engine.fields(&findings, &mut votes.fields);
    (votes.columns, votes.rows, votes.cell_px) = (columns as u32, rows as u32, cell_px as f32);
    (votes.background_u, votes.background_v) = findings.background.in_the_middle();
    votes.motion = findings.background.coefficients;
    votes.evidence = findings.evidence;
    votes.outcome = match findings.outcome {
        Outcome::NoPair => PairOutcome::NoPair,
        Outcome::Answered => PairOutcome::Answered,
        Outcome::Frozen => PairOutcome::Frozen,
        Outcome::Featureless => PairOutcome::Featureless,
        Outcome::Unexplained => PairOutcome::Unexplained,
    } as u32;
    tell_candidates(&findings, votes);
}

fn tell_candidates(findings: &Findings, votes: &mut Votes) {
    const { assert!(pursuit_motion::MAX_TARGETS == payload::MAX_CANDIDATES) };
    votes.candidate_count = findings.count as u32;
    for (told, found) in votes.candidates.iter_mut().zip(&findings.candidates) {
        *told = payload::Candidate {
            u: found.u,
            v: found.v,
            vu: found.vu,
            vv: found.vv,
            relative: found.relative,
            area_px: found.area_px,
            confidence: found.confidence,
            position_covariance: found.position_covariance,
            velocity_sd: found.velocity_sd,
            evidence: found.evidence,
            explained: found.explained,
        };
    }
}
