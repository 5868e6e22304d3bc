//! Section `[vision]`.

use pursuit_config::Checker;
use pursuit_motion::{Parameters, Smoothing};
use pursuit_runtime::settings;

/// What vision needs.
#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    /// Section `[run]`.
    pub run: settings::Run,
    /// Section `[camera]`.
    pub camera: settings::Camera,
    /// The voting part of the method's parameters; the others stay at their defaults.
    pub motion: Parameters,
}

impl Config {
    /// Reads the sections; faults go to the checker.
    pub fn read(checker: &Checker<'_>) -> Config {
        let run = settings::Run::read(checker);
        let camera = settings::Camera::read(checker);
        let mut motion = Parameters::default();
        read(checker, &mut motion);
        Config { run, camera, motion }
    }
}

/// Reads `[vision]` alone, for who has no camera (`pursuit detect`).
pub fn read(checker: &Checker<'_>, motion: &mut Parameters) {
    let section = checker.section("vision");
    // One mode in this version; the key is there so that configs name what they rely on.
    section.choice_or("mode", &[("paper", ())], ());
    let kernels = [("binomial", Smoothing::Binomial), ("gaussian", Smoothing::Gaussian)];
    motion.smoothing = section.choice_or("smoothing", &kernels, motion.smoothing);
    motion.passes = section.integer_or("passes", 0..=10, motion.passes);
    motion.floor = section.float_or("floor", 0.0..=12.0, motion.floor);
}
