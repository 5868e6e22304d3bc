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
    /// Frames from the one before to that.
    gap: u32,
    before: Tracker,
    after: Tracker,
}

impl Memory {
    fn new(parameters: &TrackerParameters) -> Memory {
        let tracker = Tracker::new(parameters);
        Memory { frame: None, gap: 0, before: tracker.clone(), after: tracker }
    }

    /// Takes in what was found in a frame of an epoch.
    fn take(&mut self, frame: (u64, u64), findings: &Findings, interval: u32) -> &Tracker {
        let gap = match self.frame {
            Some((epoch, number)) if epoch == frame.0 && frame.1 > number => {
                self.before.clone_from(&self.after);
                u32::try_from(frame.1 - number).unwrap_or(u32::MAX)
            }
            Some(last) if last == frame && findings.outcome != Outcome::NoPair => {
                self.after.clone_from(&self.before);
                self.gap
            }
            // A restarted vision begins with frames that were answered before: without a pair, or out of
            // order, they tell nothing new.
            Some((epoch, _)) if epoch == frame.0 => return &self.after,
            // Another epoch: nothing that was known holds.
            _ => {
                *self = Memory::new(self.after.parameters());
                interval
            }
        };
        (self.frame, self.gap) = (Some(frame), gap);
        self.after.step_after(findings, interval, gap);
        &self.after
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
        let per_frame = per_frame(votes);
        let segmentation = segment(&votes.fields, &summary, &self.decision.paper, &mut self.segment_scratch);
        target.motion =
            segmentation.target.map_or_else(|_| Detection::default(), |found| message(&found, per_frame));
        (target.background_u, target.background_v) =
            (segmentation.background.0 * per_frame, segmentation.background.1 * per_frame);
        target.background_frames = votes.interval;
    }

    /// Robust mode: the most probable candidate of this pair, and the track.
    fn decide(&mut self, frame: (u64, u64), votes: &Votes, target: &mut Target) {
        let findings = findings(votes, self.shape);
        let tracker = self.memory.take(frame, &findings, votes.interval);
        let per_frame = per_frame(votes);
        if let Some(found) = findings.target(self.decision.confidence) {
            target.motion = candidate_message(found, per_frame);
        }
        if let Some(track) = tracker.target() {
            target.track = track_message(track);
            target.track_id = track.id;
        }
        let best = |a: &&Track, b: &&Track| a.existence.total_cmp(&b.existence);
        let surest = tracker.target().or_else(|| tracker.tracks().max_by(best));
        let mut phase = surest.map_or(TrackPhase::Lost, |track| phase(track.state));
        if phase == TrackPhase::Confirmed && findings.outcome != Outcome::Answered {
            // A camera that sends the same frame again and again shows nothing: the arm must not follow it.
            phase = TrackPhase::Coasting;
        }
        target.track_phase = phase as u32;
        let (u, v) = findings.background.in_the_middle();
        (target.background_u, target.background_v) = (u * per_frame, v * per_frame);
        if findings.outcome == Outcome::Answered {
            target.background_turn_rad = findings.background.turn_rad() * per_frame;
            target.background_frames = votes.interval;
        }
    }
}

/// The most probable candidate of this pair, however improbable; none in paper mode.
pub fn best_guess(votes: &Votes, shape: ImageShape) -> Option<Detection> {
    findings(votes, shape).target(0.0).map(|found| candidate_message(found, per_frame(votes)))
}

/// What makes a displacement per pair a velocity per frame.
fn per_frame(votes: &Votes) -> f64 {
    1.0 / f64::from(votes.interval.max(1))
}

fn phase(state: TrackState) -> TrackPhase {
    match state {
        TrackState::Tentative => TrackPhase::Tentative,
        TrackState::Confirmed => TrackPhase::Confirmed,
        TrackState::Coasting => TrackPhase::Coasting,
    }
}

/// What vision found, out of a message; numbers that cannot be are none.
fn findings(votes: &Votes, shape: ImageShape) -> Findings {
    let mut background = GlobalMotion::still(shape.width as usize, shape.height as usize);
    if votes.motion.iter().all(|a| a.is_finite()) {
        background.coefficients = votes.motion;
    }
    let outcome = match PairOutcome::from_number(votes.outcome) {
        Some(PairOutcome::Answered) if votes.valid == 1 && background.coefficients == votes.motion => {
            Outcome::Answered
        }
        Some(PairOutcome::Unexplained) => Outcome::Unexplained,
        Some(PairOutcome::Frozen) => Outcome::Frozen,
        Some(PairOutcome::Featureless) => Outcome::Featureless,
        _ => Outcome::NoPair,
    };
    let mut findings = Findings {
        outcome,
        background,
        candidates: [Candidate::default(); MAX_TARGETS],
        count: 0,
        evidence: if votes.evidence.is_finite() { votes.evidence } else { 0.0 },
    };
    for told in votes.candidates.iter().take(votes.candidate_count as usize) {
        let [uu, uv, vv] = told.position_covariance;
        let [ru, rv] = told.relative;
        let motion = [told.u, told.v, told.vu, told.vv, ru, rv];
        let rest = [told.area_px, told.evidence, told.explained, told.velocity_sd, uu, uv, vv];
        let sane = motion.iter().chain(&rest).all(|number| number.is_finite())
            && told.area_px >= 0.0
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
#[allow(clippy::unwrap_used)]
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

    /// Robust mode: something sure at u, over a pair.
    fn sighting(u: f64) -> Votes {
        let mut votes = Votes {
            valid: 1,
            mode: VisionMode::Robust as u32,
            outcome: PairOutcome::Answered as u32,
            interval: 1,
            candidate_count: 1,
            ..Votes::default()
        };
        votes.candidates[0] = pursuit_messages::Candidate {
            u,
            v: 100.0,
            vu: 4.0,
            relative: [4.0, 0.0],
            area_px: 400.0,
            confidence: 0.99,
            position_covariance: [1.0, 0.0, 1.0],
            velocity_sd: 0.2,
            evidence: 4.0,
            explained: 0.9,
            ..pursuit_messages::Candidate::default()
        };
        votes
    }

    #[test]
    fn a_frame_that_is_asked_for_again_gets_the_same_answer() {
        let mut segmenter = segmenter();
        segmenter.answer((1, 1), &sighting(50.0), None);
        let first = segmenter.answer((1, 2), &sighting(54.0), None);
        assert_eq!(segmenter.answer((1, 2), &sighting(54.0), None), first);
        assert_eq!(first.track_phase, TrackPhase::Confirmed as u32);
    }

    #[test]
    fn a_vision_that_starts_anew_takes_no_track_away() {
        let mut segmenter = segmenter();
        segmenter.answer((1, 1), &sighting(50.0), None);
        let before = segmenter.answer((1, 2), &sighting(54.0), None);
        // It begins with the frame before, which it has no pair for.
        let nothing = Votes { mode: VisionMode::Robust as u32, ..Votes::default() };
        segmenter.answer((1, 1), &nothing, None);
        assert_eq!(segmenter.answer((1, 2), &sighting(54.0), None), before);
        let after = segmenter.answer((1, 3), &sighting(58.0), None);
        assert_eq!(after.track_id, before.track_id);
    }

    #[test]
    fn another_epoch_begins_without_tracks() {
        let mut segmenter = segmenter();
        let first = segmenter.answer((1, 7), &sighting(50.0), None);
        let nothing = Votes { candidate_count: 0, ..sighting(0.0) };
        assert_eq!(segmenter.answer((2, 1), &nothing, None).track.found, 0);
        assert_eq!(first.track.found, 1);
    }

    #[test]
    fn a_track_in_frames_that_are_frozen_is_a_guess() {
        let mut segmenter = segmenter();
        segmenter.answer((1, 1), &sighting(50.0), None);
        let frozen = Votes { outcome: PairOutcome::Frozen as u32, candidate_count: 0, ..sighting(0.0) };
        let target = segmenter.answer((1, 2), &frozen, None);
        assert_eq!((target.track.found, target.track_phase), (1, TrackPhase::Coasting as u32));
    }

    #[test]
    fn frames_that_were_passed_over_do_not_break_a_track() {
        let mut segmenter = segmenter();
        let first = segmenter.answer((1, 1), &sighting(50.0), None);
        // Four frames on, 4 px each; the pair that is told of is of the last interval.
        let after = segmenter.answer((1, 5), &sighting(66.0), None);
        assert_eq!((after.track_id, after.track_phase), (first.track_id, TrackPhase::Confirmed as u32));
        assert!((after.track.u - 66.0).abs() < 1.0, "{:?}", after.track);
    }

    #[test]
    fn saved_tracks_go_on_where_they_were_but_not_with_other_parameters() {
        let mut first = segmenter();
        first.answer((1, 1), &sighting(50.0), None);
        let bytes = postcard::to_allocvec(first.memory()).unwrap();
        let memory: Memory = postcard::from_bytes(&bytes).unwrap();
        let mut second = segmenter();
        assert!(second.resume(memory.clone()));
        assert_eq!(second.answer((1, 2), &sighting(54.0), None), first.answer((1, 2), &sighting(54.0), None));
        let mut other = segmenter();
        other.decision.tracker.gate = 5.0;
        assert!(!other.resume(memory));
    }

    #[test]
    fn candidates_that_cannot_be_are_none() {
        let spoil: [fn(&mut pursuit_messages::Candidate); 8] = [
            |c| c.u = f64::NAN,
            |c| c.relative[1] = f64::INFINITY,
            |c| c.confidence = 1.5,
            |c| c.confidence = f64::NAN,
            |c| c.position_covariance = [1.0, 2.0, 1.0],
            |c| c.position_covariance[2] = f64::INFINITY,
            |c| c.velocity_sd = 0.0,
            |c| c.area_px = -1.0,
        ];
        for (i, spoil) in spoil.into_iter().enumerate() {
            let mut votes = sighting(50.0);
            spoil(&mut votes.candidates[0]);
            let target = segmenter().answer((1, 1), &votes, None);
            assert_eq!((target.motion.found, target.track.found), (0, 0), "spoilt in way {i}");
        }
        let mut votes = sighting(50.0);
        votes.candidate_count = u32::MAX;
        assert_eq!(segmenter().answer((1, 1), &votes, None).motion.found, 1, "others are not finite: none");
    }
}
