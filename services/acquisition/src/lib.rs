//! Acquisition: exposes, stamps and publishes frames, straight into the loaned sample.
//!
//! A frame's way: the camera says that one is due → a sample is loaned from the bus → the camera writes
//! its pixels into it → a look at whether it is an image of now ([`sanity`]) → FRAMES.

#![cfg_attr(test, allow(clippy::unwrap_used))]

pub mod camera;
pub mod config;
pub mod fault;
mod files;
mod kept;
mod recorded;
pub mod sanity;
mod simulated;

pub use camera::{Camera, CameraError, Exposure};
pub use files::FileCamera;
pub use recorded::RecordedCamera;
pub use simulated::{SimulatedCamera, view_of};

use config::{Config, Source};
use fault::FaultyCamera;
use pursuit_messages::{Lack, Service, Stage, Stamp};
use pursuit_runtime::clock::monotonic_ns;
use pursuit_runtime::settings::Clock;
use pursuit_runtime::{ServiceError, Station, TICK, place};
use sanity::Sanity;

/// Runs until stopped.
///
/// # Errors
/// [`ServiceError`] for a wrong config or a bus that fails; a camera that fails is reported and tried again.
pub fn run(mut station: Station) -> Result<(), ServiceError> {
    let config = station.config(Config::read)?;
    let shape = config.camera.shape();
    let frames = station.bus.frame_publisher(shape.bytes())?;
    let mut camera: Box<dyn Camera> = match &config.source {
        Source::Simulated(scene) => {
            let kept = station.directory().join(place::TEXTURES);
            Box::new(SimulatedCamera::new(&station.bus, scene, config.run.clock, &kept)?)
        }
        Source::Files(files) => Box::new(FileCamera::new(files, &config.camera)),
        Source::Recorded(recorded) => Box::new(RecordedCamera::new(recorded, shape)),
    };
    if config.faults {
        camera = Box::new(FaultyCamera::new(camera, station.directory().join(place::CAMERA_FAULT)));
    }
    let mut sanity = Sanity::new(config.frozen_ns);
    // A camera is opened by the first wait for it: only one process may have it.
    if !station.take_over()? {
        return Ok(());
    }
    while station.turn() {
        match camera.wait(TICK) {
            Ok(Some(exposure)) => {
                let begin = monotonic_ns();
                let mut loan = frames.loan(shape.bytes())?;
                if let Err(error) = camera.expose(&exposure, loan.pixels_mut()) {
                    tell(&mut station, Lack::Input, &error.to_string());
                    continue;
                }
                // In lock-step a frame may be asked for again, and each must be answered.
                let lack = match config.run.clock {
                    Clock::Wall => sanity.look(loan.pixels_mut(), shape.stride as usize, exposure.time_ns),
                    Clock::Lockstep => Lack::Nothing,
                };
                tell(&mut station, lack, lack.text());
                if lack == Lack::Frozen {
                    station.health.refused += 1;
                    continue;
                }
                let stamp = Stamp::new(exposure.epoch, exposure.frame, exposure.time_ns, shape).extended(
                    Service::Acquisition,
                    Stage::Expose,
                    begin,
                    monotonic_ns(),
                );
                loan.send(&stamp)?;
                station.answered(exposure.frame);
                station.health.skipped += exposure.skipped;
            }
            Ok(None) => frames.greet_new_readers(),
            Err(error) => tell(&mut station, Lack::Input, &error.to_string()),
        }
    }
    Ok(())
}

/// Says once what the camera lacks, and when it is well again.
fn tell(station: &mut Station, lack: Lack, why: &str) {
    let before = std::mem::replace(&mut station.health.degraded, lack as u32);
    match lack {
        _ if before == lack as u32 => {}
        Lack::Nothing => tracing::info!("the camera is well again"),
        Lack::Input => tracing::warn!("no frames: {why}; trying again, the arm holds meanwhile"),
        _ => tracing::warn!("{why}"),
    }
}
