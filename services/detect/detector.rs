//! The detector behind `pursuit detect`: frames in, a small answer out. All else of this verb depends on the
//! answer's types only, and does not know how the detector comes to it.

use std::time::{Duration, Instant};

use crate::check::Detection;
use pursuit_images::GreyImage;
use pursuit_messages::payload::{self, Votes};
use pursuit_messages::{ImageShape, PairOutcome, TrackPhase, VisionMode};
use pursuit_motion::{BlobParameters, EngineError, Image, ImageError, NOMINAL_VELOCITIES, Older};
use pursuit_segmentation::step::{Segmenter, best_guess};
use pursuit_vision::eye::Eye;
use pursuit_vision::probe::Stopwatch;
use thiserror::Error;

/// Spatial scales of the detector.
pub const SCALES: usize = 3;

/// What the detector says of one frame.
#[derive(Clone, Debug)]
pub struct Answer {
    /// The target, or in words why there is none: the track, where there is one that is sure enough, else
    /// what this pair shows alone.
    pub target: Result<Target, String>,
    /// The most probable answer of this pair alone, also where it is not sure enough.
    pub pair: Option<Target>,
    /// Background velocity (right, down), px/frame.
    pub background: (f64, f64),
    /// What it took.
    pub times: Times,
}

/// What moves independently.
#[derive(Clone, Copy, Debug)]
pub struct Target {
    /// Position, px from the centre of the top-left pixel to the right.
    pub u: f64,
    /// As `u`, downward.
    pub v: f64,
    /// Velocity in the image, px/frame to the right.
    pub vu: f64,
    /// As `vu`, downward.
    pub vv: f64,
    /// 0 to 1.
    pub confidence: f64,
    /// Area, px².
    pub area_px: f64,
    /// Covariance of the position (uu, uv, vv; px²) and standard deviation of the velocity (px/frame), where
    /// the detector knows them.
    pub uncertainty: Option<([f64; 3], f64)>,
    /// Number of the track, where it is one.
    pub track: Option<u32>,
    /// Whether it is not seen in this frame but carried on from those before.
    pub coasting: bool,
}

/// Time spent on one frame.
#[derive(Clone, Copy, Debug, Default)]
pub struct Times {
    /// Pyramids of the frames.
    pub pyramid: Duration,
    /// Derivatives and votes.
    pub votes: Duration,
    /// Estimating and undoing the camera's motion.
    pub compensation: Duration,
    /// From votes to the target.
    pub segmentation: Duration,
}

impl Times {
    /// What vision noted of its parts; the rest of `total` went from votes to the target.
    fn new(votes: &Votes, total: Duration) -> Times {
        let (pyramid, compensation) =
            (Duration::from_nanos(votes.pyramid_ns), Duration::from_nanos(votes.compensation_ns));
        let votes = Duration::from_nanos(votes.votes_ns);
        let segmentation = total.saturating_sub(pyramid + votes + compensation);
        Times { pyramid, votes, compensation, segmentation }
    }

    /// All of it.
    pub fn total(&self) -> Duration {
        self.pyramid + self.votes + self.compensation + self.segmentation
    }
}

/// One vote field of the last pair, after compensation.
#[derive(Clone, Copy, Debug)]
pub struct VoteField<'a> {
    /// Its number in the paper's figure 3, from 1.
    pub label: usize,
    /// Its nominal velocity (right, down), px/frame. Negative votes are for the opposite.
    pub velocity: [f64; 2],
    /// Cells in a row.
    pub columns: usize,
    /// Votes, cell by cell, rows from the top.
    pub votes: &'a [f32],
}

/// Frames that the detector does not take.
#[derive(Debug, Error)]
pub enum DetectorError {
    /// Not of this size, or not with these parameters.
    #[error(transparent)]
    Engine(#[from] EngineError),
    /// Not this frame.
    #[error(transparent)]
    Frame(#[from] ImageError),
}

/// The steps of vision and segmentation, as the services run them, and their memory.
pub struct Detector {
    shape: ImageShape,
    eye: Eye,
    segmenter: Segmenter,
    votes: Box<Votes>,
    frame: u64,
}

impl Detector {
    /// A detector for frames of this one's size.
    pub fn new(frame: &GreyImage, detection: &Detection) -> Result<Detector, DetectorError> {
        let shape = ImageShape::grey(frame.width, frame.height);
        Ok(Detector {
            shape,
            eye: Eye::new(frame.width as usize, frame.height as usize, &detection.vision)?,
            segmenter: Segmenter::for_images(shape, detection.segmentation, BlobParameters::default()),
            votes: Box::default(),
            frame: 0,
        })
    }

    /// The target in `newer`. `older` is the frame that was `newer` in the last call, `None` in the first.
    pub fn step(&mut self, older: Option<&GreyImage>, newer: &GreyImage) -> Result<Answer, DetectorError> {
        let interval = u32::from(older.is_some());
        let older = older.map(view).transpose()?.map_or(Older::Missing, Older::LastNewer);
        let newer = view(newer)?;
        let start = Instant::now();
        let mut stopwatch = Stopwatch::start();
        self.eye.look(older, newer, interval, &mut self.votes, &mut stopwatch);
        stopwatch.write(&mut self.votes);
        let said = self.segmenter.answer((0, self.frame), &self.votes, None);
        let times = Times::new(&self.votes, start.elapsed());
        self.frame += 1;
        let alone = (said.motion.found == 1).then(|| of_detection(&said.motion));
        let track = (said.track.found == 1).then(|| Target {
            track: Some(said.track_id),
            coasting: said.track_phase == TrackPhase::Coasting as u32,
            ..of_detection(&said.track)
        });
        Ok(Answer {
            target: track.or(alone).ok_or_else(|| self.reason()),
            pair: alone.or_else(|| self.best_guess()),
            background: (said.background_u, said.background_v),
            times,
        })
    }

    fn best_guess(&self) -> Option<Target> {
        best_guess(&self.votes, self.shape).as_ref().map(of_detection)
    }

    /// Why there is no target.
    fn reason(&self) -> String {
        if self.votes.valid == 0 {
            return "there is no frame before this one".to_owned();
        }
        if self.votes.mode == VisionMode::Paper as u32 {
            return "no blob of votes stands out".to_owned();
        }
        match (PairOutcome::from_number(self.votes.outcome), self.best_guess()) {
            (Some(PairOutcome::Frozen), _) => "this frame is the one before once more".to_owned(),
            (Some(PairOutcome::Featureless), _) => "nothing in the frames could be seen moving".to_owned(),
            (Some(PairOutcome::Unexplained), _) => "no motion of a camera explains the pair".to_owned(),
            (_, Some(best)) => format!("the best guess has a confidence of {:.2}", best.confidence),
            (_, None) => "nothing moves but the camera".to_owned(),
        }
    }

    /// The vote fields of the last step in order of their labels; none where it had no pair.
    pub fn vote_fields(&self) -> Vec<VoteField<'_>> {
        if self.votes.valid == 0 {
            return Vec::new();
        }
        let columns = self.votes.columns as usize;
        let cells = columns * self.votes.rows as usize;
        let fields = self.votes.fields.iter().zip(NOMINAL_VELOCITIES);
        (1..)
            .zip(fields)
            .map(|(label, (votes, velocity))| VoteField { label, velocity, columns, votes: &votes[..cells] })
            .collect()
    }

    /// The pyramid's levels of the newer frame of the last step, finest first, each of its own size; `None`
    /// before the first step.
    pub fn levels(&self) -> Option<[GreyImage; SCALES]> {
        (self.frame > 0).then(|| {
            std::array::from_fn(|k| {
                let (width, height, stride, values) = self.eye.level(k);
                // 16 steps per grey level.
                let grey = |&value: &i16| ((value + 8) >> 4).clamp(0, 255) as u8;
                let rows = values.chunks(stride).take(height);
                let pixels = rows.flat_map(|row| &row[..width]).map(grey).collect();
                GreyImage { width: width as u32, height: height as u32, pixels }
            })
        })
    }
}

fn of_detection(found: &payload::Detection) -> Target {
    let known = found.velocity_sd > 0.0;
    Target {
        u: found.u,
        v: found.v,
        vu: found.vu,
        vv: found.vv,
        confidence: found.confidence,
        area_px: found.area_px,
        uncertainty: known.then_some((found.position_covariance, found.velocity_sd)),
        track: None,
        coasting: false,
    }
}

fn view(frame: &GreyImage) -> Result<Image<'_>, ImageError> {
    let (width, height) = (frame.width as usize, frame.height as usize);
    Image::new(&frame.pixels, width, height, width)
}
