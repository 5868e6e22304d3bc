//! The detector behind `pursuit detect`: frames in, a small answer out. All else of this verb depends on the
//! answer's types only, and does not know how the detector comes to it.

use std::time::{Duration, Instant};

use pursuit_images::GreyImage;
use pursuit_motion::{
    EngineError, FIELDS, Fields, Image, ImageError, MAX_CELLS, NOMINAL_VELOCITIES, Older, Parameters, Part,
    Probe, SegmentScratch, VoteEngine, VoteSummary, segment,
};
use thiserror::Error;

/// Spatial scales of the detector.
pub const SCALES: usize = 3;

/// What the detector says of one frame.
#[derive(Clone, Debug)]
pub struct Answer {
    /// The target, or in words why there is none.
    pub target: Result<Target, String>,
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

/// The two steps of the detector and their memory.
pub struct Detector {
    engine: VoteEngine,
    parameters: Parameters,
    fields: Box<Fields>,
    summary: Option<VoteSummary>,
    scratch: SegmentScratch,
}

impl Detector {
    /// A detector for frames of this one's size.
    pub fn new(frame: &GreyImage, parameters: &Parameters) -> Result<Detector, DetectorError> {
        Ok(Detector {
            engine: VoteEngine::new(frame.width as usize, frame.height as usize, parameters)?,
            parameters: *parameters,
            fields: Box::new([[0.0; MAX_CELLS]; FIELDS]),
            summary: None,
            scratch: SegmentScratch::new(),
        })
    }

    /// The target in `newer`. `older` is the frame that was `newer` in the last call, `None` in the first.
    pub fn step(&mut self, older: Option<&GreyImage>, newer: &GreyImage) -> Result<Answer, DetectorError> {
        let older = older.map(view).transpose()?.map_or(Older::Missing, Older::LastNewer);
        let newer = view(newer)?;
        let mut stopwatch = Stopwatch::start();
        let votes = self.engine.vote(older, newer, &mut self.fields, &mut stopwatch);
        let found = segment(&self.fields, &votes, &self.parameters, &mut self.scratch);
        stopwatch.lap(|times| &mut times.segmentation);
        self.summary = Some(votes);
        let target = found.target.map_err(|reason| reason.to_string()).map(|target| {
            let pursuit_motion::Detection { u, v, vu, vv, confidence, area_px, .. } = target;
            Target { u, v, vu, vv, confidence, area_px }
        });
        Ok(Answer { target, background: found.background, times: stopwatch.times })
    }

    /// The vote fields of the last step in order of their labels; none where it had no pair.
    pub fn vote_fields(&self) -> Vec<VoteField<'_>> {
        let Some(summary) = self.summary.filter(|summary| summary.valid) else { return Vec::new() };
        let cells = summary.columns * summary.rows;
        let fields = self.fields.iter().zip(NOMINAL_VELOCITIES);
        (1..)
            .zip(fields)
            .map(|(label, (votes, velocity))| VoteField {
                label,
                velocity,
                columns: summary.columns,
                votes: &votes[..cells],
            })
            .collect()
    }

    /// The pyramid's levels of the newer frame of the last step, finest first, each of its own size; `None`
    /// before the first step.
    pub fn levels(&self) -> Option<[GreyImage; SCALES]> {
        self.summary?;
        Some(std::array::from_fn(|k| {
            let (width, height, stride, values) = self.engine.level(k);
            // 16 steps per grey level.
            let grey = |&value: &i16| ((value + 8) >> 4).clamp(0, 255) as u8;
            let pixels = values.chunks(stride).take(height).flat_map(|row| &row[..width]).map(grey).collect();
            GreyImage { width: width as u32, height: height as u32, pixels }
        }))
    }
}

fn view(frame: &GreyImage) -> Result<Image<'_>, ImageError> {
    let (width, height) = (frame.width as usize, frame.height as usize);
    Image::new(&frame.pixels, width, height, width)
}

/// Adds up the parts of a step.
struct Stopwatch {
    last: Instant,
    times: Times,
}

impl Stopwatch {
    fn start() -> Stopwatch {
        Stopwatch { last: Instant::now(), times: Times::default() }
    }

    fn lap(&mut self, part: impl FnOnce(&mut Times) -> &mut Duration) {
        let now = Instant::now();
        *part(&mut self.times) += now - self.last;
        self.last = now;
    }
}

impl Probe for Stopwatch {
    fn ended(&mut self, part: Part) {
        self.lap(|times| match part {
            Part::Pyramid => &mut times.pyramid,
            Part::Compensation => &mut times.compensation,
            Part::Votes => &mut times.votes,
            Part::Competition => &mut times.segmentation,
        });
    }
}
