//! Watches whether what was learnt still holds, and says what to keep of it when it does not.

use serde::{Deserialize, Serialize};

use crate::change::{ChangeDetector, MOST_SAMPLES, Verdict, surprise};
use crate::network::Network;
use crate::reframe::Frame;
use crate::samples::Sample;

/// After a new frame was found, so many further moves make it more exact.
const SETTLING_MOVES: u32 = 4;

/// What a finished move showed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Review {
    /// How badly the weights that the move began with foretold it: see [`surprise`]. `None` where the
    /// move was too short to tell.
    pub surprise: Option<f64>,
    /// What that means.
    pub verdict: Verdict,
    /// After a change, or soon after one: the frame that brings the image of now to the one that was
    /// learnt before, where that is all that changed.
    pub frame: Option<Frame>,
}

/// What is known from before a change.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Before {
    /// Weights that were not taught by anything since.
    pub(crate) network: Network,
    /// Number of the last sample before.
    pub(crate) last_sample: u64,
}

/// The watch over the moves.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Watch {
    detector: ChangeDetector,
    /// Before the first move that is in doubt, or that showed a change.
    before: Before,
    /// What was seen since, within moves, [`MOST_SAMPLES`] at most.
    since: Vec<Sample>,
    /// Moves that still make the frame more exact.
    settling: u32,
    frame: Frame,
}

impl Watch {
    pub(crate) fn new(network: &Network) -> Watch {
        Watch {
            detector: ChangeDetector::default(),
            before: Before { network: network.clone(), last_sample: 0 },
            since: Vec::with_capacity(MOST_SAMPLES),
            settling: 0,
            frame: Frame::default(),
        }
    }

    /// Judges a finished move: the samples `within` it, and what there was when it began.
    pub(crate) fn review(&mut self, within: &[Sample], at_start: &Before) -> Review {
        let Some(surprise) = surprise(&at_start.network, within) else {
            // Too short a move neither clears nor condemns the one before.
            return Review { surprise: None, verdict: Verdict::Same, frame: None };
        };
        let known = self.detector;
        if !self.detector.is_suspicious() && self.settling == 0 {
            self.before.clone_from(at_start);
            self.since.clear();
        }
        let room = MOST_SAMPLES - self.since.len();
        self.since.extend(within.iter().take(room));
        let verdict = self.detector.judge(surprise);
        let frame = match verdict {
            Verdict::Changed => self.reframe_after(known),
            Verdict::Same | Verdict::Suspicious if self.settling > 0 => self.settle(),
            Verdict::Same | Verdict::Suspicious => None,
        };
        Review { surprise: Some(surprise), verdict, frame }
    }

    /// See [`ChangeDetector::usual`].
    pub(crate) fn usual(&self) -> f64 {
        self.detector.usual()
    }

    /// What was seen within moves since the last change, or since a move that is in doubt.
    pub(crate) fn since(&self) -> &[Sample] {
        &self.since
    }

    /// What is known from before.
    pub(crate) fn before(&self) -> &Before {
        &self.before
    }

    /// The frame that holds so far, for what is to be brought from it into a better one.
    pub(crate) fn frame(&self) -> Frame {
        self.frame
    }

    /// Takes over a better frame, or none.
    pub(crate) fn set_frame(&mut self, frame: Frame) {
        self.frame = frame;
    }

    fn reframe_after(&mut self, known: ChangeDetector) -> Option<Frame> {
        self.frame = Frame::default();
        let frame = Frame::explaining(&self.since, &self.before.network);
        self.settling = if frame.is_some() { SETTLING_MOVES } else { 0 };
        if frame.is_some() {
            self.detector = known.trusting();
        }
        frame
    }

    fn settle(&mut self) -> Option<Frame> {
        self.settling -= 1;
        Frame::explaining(&self.since, &self.before.network)
    }
}
