//! Sections `[camera]` and `[acquisition]`.

use pursuit_config::Checker;
use pursuit_runtime::settings;
use pursuit_scene::{CONTRAST_SD, Lighting, NOISE_SIGMA, SceneParameters};
use std::path::PathBuf;

/// What acquisition needs.
#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    /// Section `[run]`.
    pub run: settings::Run,
    /// Section `[camera]`.
    pub camera: settings::Camera,
    /// Where frames come from.
    pub source: Source,
    /// The same image for so long is a stuck camera, ns; 0: never.
    pub frozen_ns: u64,
    /// Whether the camera can be told to fail.
    pub faults: bool,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Simulated,
    Files,
    Recording,
}

/// The same image for so long is a stuck camera, ms.
const FROZEN_MS: f64 = 100.0;

/// Where frames come from.
#[derive(Clone, Debug, PartialEq)]
pub enum Source {
    /// Rendered from the simulated world.
    Simulated(SceneParameters),
    /// Read from a folder.
    Files(Files),
    /// Played from a recording.
    Recorded(Recorded),
}

/// A recording as a camera.
#[derive(Clone, Debug, PartialEq)]
pub struct Recorded {
    /// The file.
    pub file: PathBuf,
    /// Times as fast as it was.
    pub speed: f64,
    /// Where it begins, ns after its first frame.
    pub from_ns: u64,
    /// Whether it begins again at its end.
    pub repeats: bool,
}

/// A folder of images as a camera.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Files {
    /// The folder.
    pub folder: PathBuf,
    /// Whether it begins again at its end.
    pub repeats: bool,
}

impl Config {
    /// Reads the sections; faults go to the checker.
    pub fn read(checker: &Checker<'_>) -> Config {
        let run = settings::Run::read(checker);
        let camera = settings::Camera::read(checker);
        let scene = scene(checker, &camera, run.seed);
        let section = checker.section("acquisition");
        let folder = section.path_or("folder", "");
        let repeats = section.flag_or("repeat", false);
        let file = section.path_or("file", "");
        let speed = section.float_or("speed", 0.01..=100.0, 1.0);
        let from_s = section.float_or("from_s", 0.0..=1e6, 0.0);
        let kinds = [("simulated", Kind::Simulated), ("files", Kind::Files), ("recording", Kind::Recording)];
        let kind = section.choice("source", &kinds);
        if kind == Kind::Files && folder.as_os_str().is_empty() {
            section.fault("folder", "is missing: source = \"files\" needs the folder of the images");
        }
        if kind == Kind::Recording && file.as_os_str().is_empty() {
            section.fault("file", "is missing: source = \"recording\" needs the recording");
        }
        if kind != Kind::Simulated && run.clock == settings::Clock::Lockstep {
            section.fault("source", "needs run.clock = \"wall\": only the simulator can keep lock-step");
        }
        let source = match kind {
            Kind::Simulated => Source::Simulated(scene),
            Kind::Files => Source::Files(Files { folder, repeats }),
            Kind::Recording => {
                Source::Recorded(Recorded { file, speed, from_ns: (from_s * 1e9) as u64, repeats })
            }
        };
        // Without noise two images may well be the same, and films have doubled frames.
        let repeats = match &source {
            Source::Files(_) | Source::Recorded(_) => true,
            Source::Simulated(scene) => scene.noise_sigma == 0.0,
        };
        let frozen_ms = section.float_or("frozen_ms", 0.0..=60_000.0, if repeats { 0.0 } else { FROZEN_MS });
        let faults = section.flag_or("faults", false);
        Config { run, camera, source, frozen_ns: (frozen_ms * 1e6) as u64, faults }
    }
}

/// The part of `[camera]` that only the simulated camera knows.
fn scene(checker: &Checker<'_>, camera: &settings::Camera, seed: u64) -> SceneParameters {
    let section = checker.section("camera");
    SceneParameters {
        seed,
        width: camera.width as usize,
        height: camera.height as usize,
        contrast_sd: section.float_or("contrast", 0.0..=73.0, CONTRAST_SD),
        noise_sigma: section.float_or("noise", 0.0..=50.0, NOISE_SIGMA),
        lighting: Lighting {
            gain: section.float_or("gain", 0.0..=10.0, 1.0),
            vignetting: section.float_or("vignetting", 0.0..=0.5, 0.0),
            flicker: section.float_or("flicker", 0.0..=1.0, 0.0),
            flicker_hz: section.float_or("flicker_hz", 0.0..=1000.0, 100.0),
        },
        ..SceneParameters::default()
    }
}
