//! One frame's segmentation as a pure step over messages.

use crate::config::{Config, Decision};
use pursuit_bus::FrameMessage;
use pursuit_messages::payload::{MAX_CELLS, Target, Votes};
use pursuit_messages::{Detection, ImageShape, PairOutcome, Stamp, TrackPhase, VisionMode};
use pursuit_motion::{
    BlobParameters, BlobScratch, Candidate, Findings, GlobalMotion, Image, MAX_TARGETS, Outcome,
    SegmentScratch, Track, TrackState, Tracker, TrackerParameters, VoteSummary, detect_blob, segment,
};
use serde::{Deserialize, Serialize};

/// All detectors, their working memory, and the tracks. Nothing is allocated in a step.
pub struct Segmenter {
    decision: Decision,
    blob: BlobParameters,
    shape: ImageShape,
    segment_scratch: SegmentScratch,
    blob_scratch: BlobScratch,
    memory: Memory,
}

/// What is remembered from frame to frame: the tracks after a frame and before it, so that a frame that is
/// asked for again gets the same answer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Memory {
    /// Epoch and number of the last frame.
    frame: Option<(u64, u64)>,
    before: Tracker,
    after: Tracker,
}

impl Memory {
    fn new(parameters: &TrackerParameters) -> Memory {
        let tracker = Tracker::new(parameters);
        Memory { frame: None, before: tracker.clone(), after: tracker }
    }

    /// The tracks as they were before this frame.
    fn open(&mut self, frame: (u64, u64)) -> &mut Tracker {
        match self.frame {
            Some(last) if last == frame => self.after.clone_from(&self.before),
            Some((epoch, number)) if epoch == frame.0 && number < frame.1 => {
                self.before.clone_from(&self.after);
            }
            // Another epoch, or time that runs backward: nothing that was known holds.
            _ => *self = Memory::new(self.after.parameters()),
        }
        self.frame = Some(frame);
        &mut self.after
    }
}

impl Segmenter {
    /// Detectors for the configured camera.
    pub fn new(config: &Config) -> Segmenter {
        Segmenter::for_images(config.camera.shape(), config.decision, config.blob)
    }

    /// Detectors for images of one shape.
    pub fn for_images(shape: ImageShape, decision: Decision, blob: BlobParameters) -> Segmenter {
        Segmenter {
            decision,
            blob,
            shape,
            segment_scratch: SegmentScratch::new(),
            blob_scratch: BlobScratch::new(shape.width as usize, shape.height as usize),
            memory: Memory::new(&decision.tracker),
        }
    }

    /// What it remembers, to be saved.
    pub fn memory(&self) -> &Memory {
        &self.memory
    }

    /// Goes on with what was saved; not where its tracks were followed with other parameters.
    pub fn resume(&mut self, memory: Memory) -> bool {
        let fits = *memory.after.parameters() == self.decision.tracker;
        if fits {
            self.memory = memory;
        }
        fits
    }

    /// What is in the frame. Without `frame` there is no blob; votes that cannot be (an impossible grid)
    /// are answered as "no target".
    pub fn step(&mut self, stamp: &Stamp, votes: &Votes, frame: Option<&FrameMessage>) -> Target {
        let image = frame.filter(|frame| frame.stamp().image == self.shape).and_then(|frame| {
            let (width, height) = (self.shape.width as usize, self.shape.height as usize);
            Image::new(frame.pixels(), width, height, self.shape.stride as usize).ok()
        });
        self.answer((stamp.epoch, stamp.frame), votes, image)
    }

    /// As [`Segmenter::step`], for the frame of an epoch with a number, on an image that is not on the bus.
    pub fn answer(&mut self, frame: (u64, u64), votes: &Votes, image: Option<Image<'_>>) -> Target {
        let mut target = Target::default();
        if let Some(image) = image {
            let found = detect_blob(&image, &self.blob, &mut self.blob_scratch);
            target.blob = found.map_or_else(Detection::default, |found| message(&found, 1.0));
        }
        if votes.mode == VisionMode::Robust as u32 {
            self.decide(frame, votes, &mut target);
        } else {
            self.segment(votes, &mut target);
        }
        target
    }

    /// The paper's segmentation.
    fn segment(&mut self, votes: &Votes, target: &mut Target) {
        let Some(summary) = summary(votes) else { return };
        let per_frame = 1.0 / f64::from(votes.interval.max(1));
        let segmentation = segment(&votes.fields, &summary, &self.decision.paper, &mut self.segment_scratch);
        target.motion =
            segmentation.target.map_or_else(|_| Detection::default(), |found| message(&found, per_frame));
        (target.background_u, target.background_v) =
            (segmentation.background.0 * per_frame, segmentation.background.1 * per_frame);
    }

    /// Robust mode: the most probable candidate of this pair, and the track.
    fn decide(&mut self, frame: (u64, u64), votes: &Votes, target: &mut Target) {
        let (width, height) = (self.shape.width as usize, self.shape.height as usize);
        let findings = findings(votes, width, height);
        let tracker = self.memory.open(frame);
        tracker.step(&findings, votes.interval);
        let per_frame = 1.0 / f64::from(votes.interval.max(1));
        if let Some(found) = findings.target(self.decision.confidence) {
            target.motion = candidate_message(found, per_frame);
        }
        if let Some(track) = tracker.target() {
            target.track = track_message(track);
            target.track_id = track.id;
        }
        let surest = tracker.target().or_else(|| tracker.tracks().next());
        target.track_phase = surest.map_or(TrackPhase::Lost, |track| phase(track.state)) as u32;
        (target.background_u, target.background_v) =
            (votes.background_u * per_frame, votes.background_v * per_frame);
    }
}

fn phase(state: TrackState) -> TrackPhase {
    match state {
        TrackState::Tentative => TrackPhase::Tentative,
        TrackState::Confirmed => TrackPhase::Confirmed,
        TrackState::Coasting => TrackPhase::Coasting,
    }
}

/// What vision found, out of a message; numbers that cannot be are none.
fn findings(votes: &Votes, width: usize, height: usize) -> Findings {
    let mut background = GlobalMotion::still(width, height);
    background.coefficients = votes.motion;
    let outcome = match PairOutcome::from_number(votes.outcome) {
        Some(PairOutcome::Answered) if votes.valid == 1 && background.is_finite() => Outcome::Answered,
        Some(PairOutcome::Frozen) => Outcome::Frozen,
        Some(PairOutcome::Featureless) => Outcome::Featureless,
        _ => Outcome::NoPair,
    };
    let mut findings = Findings {
        outcome,
        background,
        candidates: [Candidate::default(); MAX_TARGETS],
        count: 0,
        evidence: votes.evidence,
    };
    for told in votes.candidates.iter().take(votes.candidate_count as usize) {
        let [uu, uv, vv] = told.position_covariance;
        let numbers =
            [told.u, told.v, told.vu, told.vv, told.relative[0], told.relative[1], told.area_px, uv];
        let sane = numbers.iter().all(|number| number.is_finite())
            && (0.0..=1.0).contains(&told.confidence)
            && uu > 0.0
            && uu * vv > uv * uv
            && told.velocity_sd > 0.0;
        if sane && outcome == Outcome::Answered {
            findings.candidates[findings.count] = Candidate {
                u: told.u,
                v: told.v,
                vu: told.vu,
                vv: told.vv,
                relative: told.relative,
                area_px: told.area_px,
                confidence: told.confidence,
                position_covariance: told.position_covariance,
                velocity_sd: told.velocity_sd,
                evidence: told.evidence,
                explained: told.explained,
                ..Candidate::default()
            };
            findings.count += 1;
        }
    }
    findings
}

/// A candidate as a detection; its displacements per pair become velocities per frame.
fn candidate_message(found: &Candidate, per_frame: f64) -> Detection {
    Detection {
        found: 1,
        reserved: 0,
        u: found.u,
        v: found.v,
        vu: found.vu * per_frame,
        vv: found.vv * per_frame,
        confidence: found.confidence,
        area_px: found.area_px,
        contrast: found.evidence,
        position_covariance: found.position_covariance,
        velocity_sd: found.velocity_sd * per_frame,
    }
}

fn track_message(track: &Track) -> Detection {
    let covariance = &track.covariance;
    Detection {
        found: 1,
        reserved: 0,
        u: track.mean[0],
        v: track.mean[1],
        vu: track.velocity[0],
        vv: track.velocity[1],
        confidence: track.existence,
        area_px: track.area_px,
        contrast: 0.0,
        position_covariance: [covariance[0][0], covariance[0][1], covariance[1][1]],
        velocity_sd: covariance[2][2].max(covariance[3][3]).sqrt(),
    }
}

/// The engine's summary out of a message; `None` where the numbers cannot be.
fn summary(votes: &Votes) -> Option<VoteSummary> {
    let (columns, rows) = (votes.columns as usize, votes.rows as usize);
    let cells = columns.checked_mul(rows)?;
    let sane = votes.valid == 1
        && (1..=MAX_CELLS).contains(&cells)
        && votes.cell_px.is_finite()
        && votes.background_u.is_finite()
        && votes.background_v.is_finite()
        && votes.coherence.iter().all(|c| c.is_finite());
    sane.then_some(VoteSummary {
        valid: true,
        columns,
        rows,
        cell_px: votes.cell_px,
        shift: (votes.shift_u, votes.shift_v),
        passes: votes.passes,
        coherence: votes.coherence,
        coherence_sum: votes.coherence_sum,
        background: (votes.background_u, votes.background_v),
    })
}

/// A detection as it travels; its velocity per pair becomes one per frame.
fn message(found: &pursuit_motion::Detection, per_frame: f64) -> Detection {
    Detection {
        found: 1,
        reserved: 0,
        u: found.u,
        v: found.v,
        vu: found.vu * per_frame,
        vv: found.vv * per_frame,
        confidence: found.confidence,
        area_px: found.area_px,
        contrast: found.contrast,
        ..Detection::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pursuit_config::{Checker, Document};

    fn segmenter() -> Segmenter {
        let text =
            "[run]\nclock = \"lockstep\"\nseed = 1\n[camera]\nwidth = 256\nheight = 256\nrate_hz = 25.0\n";
        let Ok(document) = Document::parse("test.toml", text) else { panic!("the config is right") };
        Segmenter::new(&Config::read(&Checker::new(&document)))
    }

    /// Field 3 (to the right) votes in a patch of 2 by 2 cells on a quiet ground.
    fn votes(interval: u32) -> Votes {
        let mut votes = Votes {
            valid: 1,
            columns: 16,
            rows: 16,
            cell_px: 16.0,
            interval,
            background_u: 3.0,
            ..Votes::default()
        };
        for cell in [5 * 16 + 9, 5 * 16 + 10, 6 * 16 + 9, 6 * 16 + 10] {
            votes.fields[2][cell] = 50.0;
        }
        votes.fields[2][200] = -1.0;
        votes
    }

    #[test]
    fn a_patch_of_votes_is_a_target_where_it_is() {
        let target = segmenter().answer((1, 1), &votes(1), None);
        assert_eq!((target.motion.found, target.blob.found), (1, 0));
        // Centre of the patch, and half of the displacement of 2 px to the right.
        assert!((target.motion.u - (10.0 * 16.0 + 1.0)).abs() < 1.0, "{:?}", target.motion);
        assert!((target.motion.v - 6.0 * 16.0).abs() < 1.0, "{:?}", target.motion);
    }

    #[test]
    fn velocities_are_per_frame_also_where_frames_were_passed_over() {
        let (near, far) =
            (segmenter().answer((1, 1), &votes(1), None), segmenter().answer((1, 1), &votes(2), None));
        assert!((near.motion.vu - 2.0 * far.motion.vu).abs() < 1e-9);
        assert!((near.background_u - 2.0 * far.background_u).abs() < 1e-9);
    }

    #[test]
    fn a_message_that_cannot_be_is_answered_with_no_target() {
        let mut segmenter = segmenter();
        let spoil: [fn(&mut Votes); 5] = [
            |votes| votes.valid = 0,
            |votes| (votes.columns, votes.rows) = (u32::MAX, 2),
            |votes| votes.columns = 0,
            |votes| votes.cell_px = f32::NAN,
            |votes| votes.background_v = f64::INFINITY,
        ];
        let mut votes = Box::new(votes(1));
        for spoil in spoil {
            let sound = votes.clone();
            spoil(&mut votes);
            assert_eq!(segmenter.answer((1, 1), &votes, None).motion.found, 0);
            votes = sound;
        }
        assert_eq!(segmenter.answer((1, 1), &votes, None).motion.found, 1);
    }
}
