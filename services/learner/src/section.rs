//! Section `[learner]`.

use crate::config::{Controller, Lead, Parameters, Profile};
use pursuit_config::Checker;
use pursuit_learning::Method;
use pursuit_runtime::settings;
use std::path::PathBuf;
use std::time::Duration;

/// What the learner needs.
#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    /// Section `[run]`.
    pub run: settings::Run,
    /// Parameters of learning and following.
    pub parameters: Parameters,
    /// Folder on a disk in which the state outlives run and machine; `None`: it lives as long as the run.
    pub keep: Option<PathBuf>,
}

impl Config {
    /// Reads the sections; faults go to the checker.
    pub fn read(checker: &Checker<'_>) -> Config {
        let section = checker.section("learner");
        let keep = PathBuf::from(section.text_or("keep", ""));
        if !keep.as_os_str().is_empty() && keep.is_relative() {
            section.fault("keep", format!("must be an absolute path, or empty, is {:?}", keep.display()));
        }
        let keep = Some(keep).filter(|folder| !folder.as_os_str().is_empty());
        Config { run: settings::Run::read(checker), parameters: read(checker), keep }
    }
}

fn read(checker: &Checker<'_>) -> Parameters {
    let section = checker.section("learner");
    let profiles = [("recommended", Profile::Recommended), ("paper", Profile::Paper)];
    let mut parameters = Parameters::of(section.choice_or("profile", &profiles, Profile::Recommended));
    parameters.training_moves =
        section.integer_or("training_moves", crate::config::TRAINING_MOVES, parameters.training_moves);
    parameters.moves_per_target =
        section.integer_or("moves_per_target", crate::config::MOVES_PER_TARGET, parameters.moves_per_target);
    parameters.bootstrap = section.flag_or("bootstrap", parameters.bootstrap);
    let home = section.floats_or("home_rad", 2, -3.2..=3.2, &parameters.home_rad);
    parameters.home_rad = [home[0], home[1]];
    parameters.reject_wild = section.flag_or("reject_wild", parameters.reject_wild);
    parameters.learn_while_following =
        section.flag_or("learn_while_following", parameters.learn_while_following);
    parameters.find_clock_offset = section.flag_or("find_clock_offset", parameters.find_clock_offset);
    let controllers = [("plain", Controller::Plain), ("predictive", Controller::Predictive)];
    parameters.controller = section.choice_or("controller", &controllers, parameters.controller);
    let measured = section.choice_or("lead", &[("measured", true), ("fixed", false)], true);
    let lead_ms = section.float_or("lead_ms", 0.0..=300.0, parameters.lead.prior().as_secs_f64() * 1e3);
    let lead = Duration::from_secs_f64(lead_ms * 1e-3);
    parameters.lead = if measured { Lead::Measured { prior: lead } } else { Lead::Fixed(lead) };
    parameters.measurement_px = section.float_or("measurement_px", 0.01..=100.0, parameters.measurement_px);
    let learning = &mut parameters.learning;
    learning.memory = section.integer_or("memory", crate::config::MEMORY, learning.memory);
    learning.eta = section.float_or("eta", crate::config::ETA, learning.eta);
    learning.iterations = section.integer_or("iterations", crate::config::ITERATIONS, learning.iterations);
    learning.detect_change = section.flag_or("detect_change", learning.detect_change);
    let methods = [
        ("cg", Method::ConjugateGradient),
        ("scg", Method::ScaledConjugateGradient),
        ("lm", Method::LevenbergMarquardt),
    ];
    learning.method = section.choice_or("trainer", &methods, learning.method);
    let signs = [("upright", -1.0), ("mirrored", 1.0)];
    learning.rotation_sign = section.choice_or("image", &signs, learning.rotation_sign);
    if let Some(fault) = parameters.fault() {
        section.fault(fault.split(' ').next().unwrap_or("profile"), fault);
    }
    parameters
}
