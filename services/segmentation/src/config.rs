//! Section `[segmentation]`.

use pursuit_config::Checker;
use pursuit_motion::{BlobParameters, Parameters, TrackerParameters};
use pursuit_runtime::settings;

/// What segmentation needs.
#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    /// Section `[run]`.
    pub run: settings::Run,
    /// Section `[camera]`.
    pub camera: settings::Camera,
    /// What decides on targets.
    pub decision: Decision,
    /// The bright-blob detector for training.
    pub blob: BlobParameters,
}

/// What decides whether there is a target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Decision {
    /// The segmenting part of the paper's method.
    pub paper: Parameters,
    /// Robust mode: confidence from which one pair alone shows a target.
    pub confidence: f64,
    /// Robust mode: how evidence is gathered over time.
    pub tracker: TrackerParameters,
}

impl Config {
    /// Reads the sections; faults go to the checker.
    pub fn read(checker: &Checker<'_>) -> Config {
        let run = settings::Run::read(checker);
        let camera = settings::Camera::read(checker);
        Config { run, camera, decision: read(checker), blob: BlobParameters::default() }
    }
}

/// Confidence from which one pair shows a target: about 1 % false alarms in sequences without one.
const CONFIDENCE: f64 = 0.5;

/// Reads `[segmentation]` alone, for who has no camera (`pursuit detect`).
pub fn read(checker: &Checker<'_>) -> Decision {
    let section = checker.section("segmentation");
    let mut paper = Parameters::default();
    let float = |key, range, default: f32| section.float_or(key, range, f64::from(default)) as f32;
    paper.blob_threshold = float("blob_threshold", 0.1..=100.0, paper.blob_threshold);
    paper.min_blob_cells = section.integer_or("min_blob_cells", 1..=1024, paper.min_blob_cells);
    paper.max_blob_cells = section.integer_or("max_blob_cells", 1..=1024, paper.max_blob_cells);
    if paper.min_blob_cells > paper.max_blob_cells {
        section.fault("min_blob_cells", "is larger than max_blob_cells");
    }
    paper.sum_threshold = float("sum_threshold", 0.0..=0.99, paper.sum_threshold);
    paper.search_radius = float("search_radius", 0.05..=1.0, paper.search_radius);
    paper.contrast_cut = float("contrast_cut", 0.0..=1000.0, paper.contrast_cut);
    let confidence = section.float_or("confidence", 0.0..=1.0, CONFIDENCE);
    let mut tracker = TrackerParameters::default();
    tracker.acceleration = section.float_or("acceleration_px", 0.01..=100.0, tracker.acceleration);
    tracker.gate = section.float_or("gate", 1.0..=20.0, tracker.gate);
    tracker.confirm = section.float_or("confirm", 0.5..=0.999, tracker.confirm);
    tracker.drop = section.float_or("drop", 0.001..=0.5, tracker.drop);
    tracker.coast_frames = section.integer_or("coast_frames", 0..=1000, tracker.coast_frames);
    Decision { paper, confidence, tracker }
}
