//! The detectors that are compared. A new one is one more [`Kind`] and one more implementation of [`Eye`].

use pursuit_motion::{
    EngineError, FIELDS, Fields, Image, MAX_CELLS, NoProbe, Older, Parameters, RobustEngine,
    RobustParameters, SegmentScratch, Tracker, TrackerParameters, VoteEngine, segment,
};

use super::judge::Answer;

/// Where the robust detector's confidence is calibrated to be cut.
pub const CALIBRATED: Cut = Cut::Confidence(0.5);

/// A detector under test.
pub struct Mode {
    /// Its name in tables and files.
    pub name: &'static str,
    /// What it is.
    pub kind: Kind,
}

/// The detectors that there are.
pub enum Kind {
    /// The paper's method.
    Paper(Parameters),
    /// The robust method.
    Robust(RobustParameters, Cut),
    /// The robust method with evidence gathered over time: a track is the answer.
    Tracked(RobustParameters, TrackerParameters),
}

/// From when on a candidate of the robust detector is an answer.
#[derive(Clone, Copy)]
pub enum Cut {
    /// The most probable one, from this confidence.
    Confidence(f64),
    /// The one that stands out most, above this evidence. Knows nothing of how confidence was calibrated.
    Evidence(f64),
}

/// A detector at work on one sequence.
pub trait Eye {
    /// What it says of `newer`. Frames come in their order; `older` is missing for the first of a sequence.
    fn step(&mut self, older: Older<'_>, newer: Image<'_>) -> Option<Answer>;
}

/// All that `pursuit experiment robustness` compares.
pub fn all() -> Vec<Mode> {
    let robust = Kind::Robust(RobustParameters::default(), CALIBRATED);
    vec![
        Mode { name: "paper literal", kind: Kind::Paper(Parameters::literal()) },
        Mode { name: "paper", kind: Kind::Paper(Parameters::default()) },
        Mode { name: "robust", kind: robust },
        Mode {
            name: "robust+tracker",
            kind: Kind::Tracked(RobustParameters::default(), TrackerParameters::default()),
        },
    ]
}

impl Mode {
    /// The detector for a sequence of square frames of `size` px a side, without memory of any other sequence.
    ///
    /// # Errors
    /// A size or parameters that the detector does not take.
    pub fn eye(&self, size: usize) -> Result<Box<dyn Eye>, EngineError> {
        Ok(match &self.kind {
            Kind::Paper(parameters) => Box::new(PaperEye {
                engine: VoteEngine::new(size, size, parameters)?,
                parameters: *parameters,
                fields: Box::new([[0.0; MAX_CELLS]; FIELDS]),
                scratch: SegmentScratch::new(),
            }),
            Kind::Robust(parameters, cut) => {
                Box::new(RobustEye { engine: RobustEngine::new(size, size, parameters)?, cut: *cut })
            }
            Kind::Tracked(parameters, tracker) => Box::new(TrackedEye {
                engine: RobustEngine::new(size, size, parameters)?,
                tracker: Tracker::new(tracker),
            }),
        })
    }
}

struct PaperEye {
    engine: VoteEngine,
    parameters: Parameters,
    fields: Box<Fields>,
    scratch: SegmentScratch,
}

impl Eye for PaperEye {
    fn step(&mut self, older: Older<'_>, newer: Image<'_>) -> Option<Answer> {
        let votes = self.engine.vote(older, newer, &mut self.fields, &mut NoProbe);
        let target = segment(&self.fields, &votes, &self.parameters, &mut self.scratch).target.ok()?;
        Some(Answer { u: target.u, v: target.v, vu: target.vu, vv: target.vv })
    }
}

struct RobustEye {
    engine: RobustEngine,
    cut: Cut,
}

impl Eye for RobustEye {
    fn step(&mut self, older: Older<'_>, newer: Image<'_>) -> Option<Answer> {
        let findings = self.engine.detect(older, newer, &mut NoProbe);
        let target = match self.cut {
            Cut::Confidence(least) => findings.target(least),
            Cut::Evidence(least) => findings.candidates[..findings.count]
                .iter()
                .max_by(|a, b| a.evidence.total_cmp(&b.evidence))
                .filter(|candidate| candidate.evidence > least),
        }?;
        Some(Answer { u: target.u, v: target.v, vu: target.vu, vv: target.vv })
    }
}

struct TrackedEye {
    engine: RobustEngine,
    tracker: Tracker,
}

impl Eye for TrackedEye {
    fn step(&mut self, older: Older<'_>, newer: Image<'_>) -> Option<Answer> {
        let findings = self.engine.detect(older, newer, &mut NoProbe);
        self.tracker.step(&findings, 1);
        let track = self.tracker.target()?;
        let [u, v, ..] = track.mean;
        Some(Answer { u, v, vu: track.velocity[0], vv: track.velocity[1] })
    }
}
