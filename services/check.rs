//! Configs: the built-in one, files, `--set`; and the check of all sections at once.

use pursuit_config::{Checker, Document, Faults, Scope};
use pursuit_runtime::exit;
use std::path::Path;

/// The default config, as it lies in the project.
pub const SIM: &str = include_str!("../config/sim.toml");
/// Its name in messages.
pub const SIM_NAME: &str = "config/sim.toml";

/// The config of a file, or the built-in one, with the settings of the command line on top.
///
/// # Errors
/// What cannot be read at all.
pub fn document(file: Option<&Path>, set: &[String]) -> Result<Document, Faults> {
    let mut document = match file {
        Some(file) => Document::load(file)?,
        None => Document::parse(SIM_NAME, SIM)?,
    };
    for setting in set {
        let (key, value) = setting.split_once('=').unwrap_or((setting, ""));
        document.set(key.trim(), value.trim())?;
    }
    Ok(document)
}

/// Reads every section of a run's config.
///
/// # Errors
/// All faults at once.
pub fn all(document: &Document) -> Result<Checked, Faults> {
    let checker = Checker::new(document);
    let acquisition = pursuit_acquisition::config::Config::read(&checker);
    let vision = pursuit_vision::config::Config::read(&checker);
    let segmentation = pursuit_segmentation::config::Config::read(&checker);
    let learner = pursuit_learner::section::Config::read(&checker);
    let arm = pursuit_arm_driver::config::Config::read(&checker);
    let simulator = pursuit_simulator::config::Config::read(&checker);
    let observer = pursuit_observer::config::Config::read(&checker);
    checker.finish(Scope::All)?;
    let arm = arm.unwrap_or_else(|| unreachable!("a missing coupling is a fault"));
    Ok(Checked { acquisition, vision, segmentation, learner, arm, simulator, observer })
}

/// A config that has passed.
pub struct Checked {
    /// Sections of acquisition.
    pub acquisition: pursuit_acquisition::config::Config,
    /// Sections of vision.
    pub vision: pursuit_vision::config::Config,
    /// Sections of segmentation.
    pub segmentation: pursuit_segmentation::config::Config,
    /// Sections of the learner.
    pub learner: pursuit_learner::section::Config,
    /// Sections of the arm driver.
    pub arm: pursuit_arm_driver::config::Config,
    /// Sections of the simulator.
    pub simulator: pursuit_simulator::config::Config,
    /// Sections of the observer.
    pub observer: pursuit_observer::config::Config,
}

/// What `pursuit detect` works with: `[vision]` and `[segmentation]`, all keys optional.
///
/// # Errors
/// All faults at once.
pub fn detection(file: Option<&Path>, set: &[String]) -> Result<Detection, Faults> {
    let document = document(file, set)?;
    let checker = Checker::new(&document);
    let vision = pursuit_vision::config::read(&checker);
    let segmentation = pursuit_segmentation::config::read(&checker);
    checker.finish(Scope::ReadSections)?;
    Ok(Detection { vision, segmentation })
}

/// Both halves of the detector.
#[derive(Clone, Copy, Debug)]
pub struct Detection {
    /// What looks at the frames.
    pub vision: pursuit_vision::config::Detector,
    /// What decides on targets.
    pub segmentation: pursuit_segmentation::config::Decision,
}

/// `pursuit check FILE`.
pub fn run(file: &Path) -> u8 {
    match document(Some(file), &[]).and_then(|document| all(&document)) {
        Ok(_) => {
            println!("{}: all is well", file.display());
            exit::OK
        }
        Err(faults) => {
            eprintln!("{faults}");
            exit::DO_NOT_RESTART
        }
    }
}
