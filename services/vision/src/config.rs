//! Section `[vision]`.

use pursuit_config::Checker;
use pursuit_messages::VisionMode;
use pursuit_messages::topics::MAX_BASELINE;
use pursuit_motion::{MotionModel, Parameters, RobustParameters, Smoothing};
use pursuit_runtime::settings;

/// What vision needs.
#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    /// Section `[run]`.
    pub run: settings::Run,
    /// Section `[camera]`.
    pub camera: settings::Camera,
    /// What looks at the frames.
    pub detector: Detector,
}

/// Time from the older frame of a pair to the newest, ms: the paper's period, in which a target at 0.1 m/s
/// moves 4 px.
const BASELINE_MS: f64 = 80.0;

/// A detector and its parameters; those of the other mode are not used.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Detector {
    /// Which one.
    pub mode: VisionMode,
    /// The voting part of the paper's method; the rest stays at its defaults.
    pub paper: Parameters,
    /// Parameters of robust mode.
    pub robust: RobustParameters,
    /// Time from the older frame of a pair to the newest, ms; frames of files are taken one after the other.
    pub baseline_ms: f64,
}

impl Config {
    /// Reads the sections; faults go to the checker.
    pub fn read(checker: &Checker<'_>) -> Config {
        let run = settings::Run::read(checker);
        let camera = settings::Camera::read(checker);
        Config { run, camera, detector: read(checker) }
    }

    /// Frames from the older one of a pair to the newest, where all of them are there: what comes nearest to
    /// the time that is wanted, 1 to [`MAX_BASELINE`].
    pub fn baseline(&self) -> u64 {
        let frames = self.detector.baseline_ms * 1e-3 * self.camera.rate_hz;
        (frames.round() as u64).clamp(1, MAX_BASELINE)
    }
}

/// Reads `[vision]` alone, for who has no camera (`pursuit detect`).
pub fn read(checker: &Checker<'_>) -> Detector {
    let section = checker.section("vision");
    let modes = [("robust", VisionMode::Robust), ("paper", VisionMode::Paper)];
    let mode = section.choice_or("mode", &modes, VisionMode::Robust);
    let mut paper = Parameters::default();
    let kernels = [("binomial", Smoothing::Binomial), ("gaussian", Smoothing::Gaussian)];
    paper.smoothing = section.choice_or("smoothing", &kernels, paper.smoothing);
    paper.passes = section.integer_or("passes", 0..=10, paper.passes);
    paper.floor = section.float_or("floor", 0.0..=12.0, paper.floor);
    let mut robust = RobustParameters::default();
    let models = [
        ("translation", MotionModel::Translation),
        ("similarity", MotionModel::Similarity),
        ("affine", MotionModel::Affine),
        ("planar", MotionModel::Planar),
    ];
    robust.model = section.choice_or("model", &models, robust.model);
    robust.light = section.flag_or("light", robust.light);
    robust.search = section.flag_or("search", robust.search);
    robust.competition = section.flag_or("competition", robust.competition);
    robust.symmetric = section.flag_or("symmetric", robust.symmetric);
    robust.turn = section.flag_or("turn", robust.turn);
    robust.evidence.untuned = section.flag_or("untuned", robust.evidence.untuned);
    let baseline_ms = section.float_or("baseline_ms", 1.0..=1000.0, BASELINE_MS);
    Detector { mode, paper, robust, baseline_ms }
}
