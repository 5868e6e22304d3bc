//! Section `[segmentation]`.

use pursuit_config::Checker;
use pursuit_motion::{BlobParameters, Parameters};
use pursuit_runtime::settings;

/// What segmentation needs.
#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    /// Section `[run]`.
    pub run: settings::Run,
    /// Section `[camera]`.
    pub camera: settings::Camera,
    /// The segmenting part of the method's parameters.
    pub motion: Parameters,
    /// The bright-blob detector for training.
    pub blob: BlobParameters,
}

impl Config {
    /// Reads the sections; faults go to the checker.
    pub fn read(checker: &Checker<'_>) -> Config {
        let run = settings::Run::read(checker);
        let camera = settings::Camera::read(checker);
        let mut motion = Parameters::default();
        read(checker, &mut motion);
        Config { run, camera, motion, blob: BlobParameters::default() }
    }
}

/// Reads `[segmentation]` alone, for who has no camera (`pursuit detect`).
pub fn read(checker: &Checker<'_>, motion: &mut Parameters) {
    let section = checker.section("segmentation");
    let float = |key, range, default: f32| section.float_or(key, range, f64::from(default)) as f32;
    motion.blob_threshold = float("blob_threshold", 0.1..=100.0, motion.blob_threshold);
    motion.min_blob_cells = section.integer_or("min_blob_cells", 1..=1024, motion.min_blob_cells);
    motion.max_blob_cells = section.integer_or("max_blob_cells", 1..=1024, motion.max_blob_cells);
    if motion.min_blob_cells > motion.max_blob_cells {
        section.fault("min_blob_cells", "is larger than max_blob_cells");
    }
    motion.sum_threshold = float("sum_threshold", 0.0..=0.99, motion.sum_threshold);
    motion.search_radius = float("search_radius", 0.05..=1.0, motion.search_radius);
    motion.contrast_cut = float("contrast_cut", 0.0..=1000.0, motion.contrast_cut);
}
