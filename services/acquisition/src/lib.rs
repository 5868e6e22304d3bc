//! Acquisition: exposes, stamps and publishes frames, straight into the loaned sample.
//!
//! A frame's way: the camera says that one is due → a sample is loaned from the bus → the camera writes
//! its pixels into it → FRAMES.

pub mod camera;
pub mod config;
mod files;
mod simulated;

pub use camera::{Camera, CameraError, Exposure};
pub use files::FileCamera;
pub use simulated::{SimulatedCamera, view_of};

use config::{Config, Source};
use pursuit_messages::{Service, Stage, Stamp};
use pursuit_runtime::clock::monotonic_ns;
use pursuit_runtime::{ServiceError, Station, TICK};

/// Runs until stopped.
///
/// # Errors
/// [`ServiceError`] for a wrong config or a bus that fails; a camera that fails is reported and tried again.
pub fn run(mut station: Station) -> Result<(), ServiceError> {
    let config = station.config(Config::read)?;
    let shape = config.camera.shape();
    let frames = station.bus.frame_publisher(shape.bytes())?;
    let mut camera: Box<dyn Camera> = match &config.source {
        Source::Simulated(scene) => Box::new(SimulatedCamera::new(&station.bus, scene, config.run.clock)?),
        Source::Files(files) => Box::new(FileCamera::new(files, &config.camera)),
    };
    // A camera is opened by the first wait for it: only one process may have it.
    if !station.take_over()? {
        return Ok(());
    }
    while station.turn() {
        match camera.wait(TICK) {
            Ok(Some(exposure)) => {
                let begin = monotonic_ns();
                let mut loan = frames.loan(shape.bytes())?;
                match camera.expose(&exposure, loan.pixels_mut()) {
                    Ok(()) => {
                        let stamp = Stamp::new(exposure.epoch, exposure.frame, exposure.time_ns, shape)
                            .extended(Service::Acquisition, Stage::Expose, begin, monotonic_ns());
                        loan.send(&stamp)?;
                        station.answered(exposure.frame);
                        station.health.skipped += exposure.skipped;
                        recovered(&mut station);
                    }
                    Err(error) => failed(&mut station, &error),
                }
            }
            Ok(None) => frames.greet_new_readers(),
            Err(error) => failed(&mut station, &error),
        }
    }
    Ok(())
}

fn failed(station: &mut Station, error: &CameraError) {
    if station.health.degraded == 0 {
        tracing::warn!(%error, "no frames: trying again, the arm holds meanwhile");
    }
    station.health.degraded = 1;
}

fn recovered(station: &mut Station) {
    if station.health.degraded == 1 {
        tracing::info!("frames again");
    }
    station.health.degraded = 0;
}
