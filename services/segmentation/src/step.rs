//! One frame's segmentation as a pure step over messages.

use crate::config::Config;
use pursuit_bus::FrameMessage;
use pursuit_messages::payload::{MAX_CELLS, Target, Votes};
use pursuit_messages::{Detection, ImageShape};
use pursuit_motion::{
    BlobParameters, BlobScratch, Image, Parameters, SegmentScratch, VoteSummary, detect_blob, segment,
};

/// Both detectors and their working memory. Nothing is allocated in a step, nothing is remembered.
pub struct Segmenter {
    motion: Parameters,
    blob: BlobParameters,
    shape: ImageShape,
    segment_scratch: SegmentScratch,
    blob_scratch: BlobScratch,
}

impl Segmenter {
    /// Detectors for the configured camera.
    pub fn new(config: &Config) -> Segmenter {
        let shape = config.camera.shape();
        Segmenter {
            motion: config.motion,
            blob: config.blob,
            shape,
            segment_scratch: SegmentScratch::new(),
            blob_scratch: BlobScratch::new(shape.width as usize, shape.height as usize),
        }
    }

    /// What is in the frame. Without `frame` there is no blob; votes that cannot be (an impossible grid)
    /// are answered as "no target".
    pub fn step(&mut self, votes: &Votes, frame: Option<&FrameMessage>) -> Target {
        let blob = frame.filter(|frame| frame.stamp().image == self.shape).and_then(|frame| {
            let (width, height) = (self.shape.width as usize, self.shape.height as usize);
            Image::new(frame.pixels(), width, height, self.shape.stride as usize).ok()
        });
        self.answer(votes, blob)
    }

    /// As [`Segmenter::step`], on an image that is not on the bus.
    pub fn answer(&mut self, votes: &Votes, image: Option<Image<'_>>) -> Target {
        let mut target = Target::default();
        if let Some(image) = image {
            let found = detect_blob(&image, &self.blob, &mut self.blob_scratch);
            target.blob = found.map_or_else(Detection::default, |found| message(&found, 1.0));
        }
        let Some(summary) = summary(votes) else { return target };
        let per_frame = 1.0 / f64::from(votes.interval.max(1));
        let segmentation = segment(&votes.fields, &summary, &self.motion, &mut self.segment_scratch);
        target.motion =
            segmentation.target.map_or_else(|_| Detection::default(), |found| message(&found, per_frame));
        (target.background_u, target.background_v) =
            (segmentation.background.0 * per_frame, segmentation.background.1 * per_frame);
        target
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
        let target = segmenter().answer(&votes(1), None);
        assert_eq!((target.motion.found, target.blob.found), (1, 0));
        // Centre of the patch, and half of the displacement of 2 px to the right.
        assert!((target.motion.u - (10.0 * 16.0 + 1.0)).abs() < 1.0, "{:?}", target.motion);
        assert!((target.motion.v - 6.0 * 16.0).abs() < 1.0, "{:?}", target.motion);
    }

    #[test]
    fn velocities_are_per_frame_also_where_frames_were_passed_over() {
        let (near, far) = (segmenter().answer(&votes(1), None), segmenter().answer(&votes(2), None));
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
            assert_eq!(segmenter.answer(&votes, None).motion.found, 0);
            votes = sound;
        }
        assert_eq!(segmenter.answer(&votes, None).motion.found, 1);
    }
}
