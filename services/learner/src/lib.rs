//! Learner: turns detections into set-points, and learns how to while it works.
//!
//! A frame's way: TARGET and the joints *at its exposure* → one pure step (network forward, samples,
//! online backprop) → state saved → LEARNER_STATE, SETPOINT. The batch refit over the ring runs on a
//! thread of its own while the arm is idle; its result is merged before the next frame is answered.
//!
//! [`step`] is the pure answer to one frame; [`config`] its parameters.

#![cfg_attr(test, allow(clippy::unwrap_used))]

mod archive;
mod background;
pub mod chart;
pub mod config;
mod delay;
pub mod follower;
pub mod history;
pub mod moment;
mod refitter;
pub mod refusals;
mod rest;
pub mod section;
mod sightings;
pub mod step;
pub mod tracking;
mod training;

use config::Parameters;
use history::JointHistory;
use pursuit_bus::{Message, wait};
use pursuit_messages::topics::{JointStates, LearnerStates, SetPoints, Targets};
use pursuit_messages::{Service, SetPoint, Stage};
use pursuit_runtime::checkpoint::{self, Checkpoint, refused_name};
use pursuit_runtime::clock::monotonic_ns;
use pursuit_runtime::settings::Clock;
use pursuit_runtime::{ServiceError, Station, TICK};
use refitter::Refitter;
use refusals::Refused;
use section::Config;
use serde::{Deserialize, Serialize};
use std::path::Path;
use step::{Input, Learner, Output};

/// Version of the saved state.
const SCHEMA: u32 = 2;
/// Room for a saved state; a ring of 100 samples takes about 10 kB.
const CHECKPOINT_BYTES: usize = 1 << 18;
/// Longest wait for the joints at a frame's exposure on the wall clock, ns; then the frame is answered
/// with "hold".
const JOINTS_PATIENCE_NS: u64 = 100_000_000;

/// What survives a kill: the learner, and the epoch that its frames are of.
#[derive(Serialize, Deserialize)]
struct Saved<L> {
    epoch: u64,
    learner: L,
}

/// Runs until stopped.
///
/// # Errors
/// [`ServiceError`] for a wrong config, a bus or a file that fails.
pub fn run(mut station: Station) -> Result<(), ServiceError> {
    let config = station.config(Config::read)?;
    let mut refitter = Refitter::start(config.run.clock)
        .map_err(|e| ServiceError::Other(format!("no thread for refits: {e}")))?;
    let states = station.bus.publisher(LearnerStates)?;
    let set_points = station.bus.publisher(SetPoints)?;
    let targets = station.bus.subscriber(Targets)?;
    let joints = station.bus.subscriber(JointStates)?;
    let mut without_joints = 0;
    let mut history = JointHistory::default();
    let mut pending: Option<(Message<Targets>, u64)> = None;
    if !station.take_over()? {
        return Ok(());
    }
    let (mut checkpoint, saved) = Checkpoint::open(&station.checkpoint_file(), SCHEMA, CHECKPOINT_BYTES)?;
    let is_new_run = saved.is_none();
    let (archived, _keeper) = archive::open(&config, &mut checkpoint)?;
    let (mut epoch, mut learner) = restore(saved.or(archived), &config, &station.checkpoint_file());
    if is_new_run {
        // What was learnt in another run holds, its frame numbers do not.
        epoch = 0;
    }
    refitter.begin(&learner);
    while station.turn() {
        wait(&[&targets, &joints], TICK)?;
        states.greet_new_readers();
        set_points.greet_new_readers();
        if let Some((message, passed)) = targets.newest()? {
            station.health.skipped += passed;
            let since = pending.take().map_or_else(monotonic_ns, |(_, since)| since);
            pending = Some((message, since));
        }
        while let Some(message) = joints.receive()? {
            history.take(message.stamp().epoch, message.payload());
        }
        let Some((message, since)) = pending.take() else { continue };
        let begin = monotonic_ns();
        let stamp = *message.stamp();
        if stamp.epoch != epoch {
            tracing::info!(epoch = stamp.epoch, "frame numbers begin again");
            epoch = stamp.epoch;
            learner.start_epoch();
        }
        let output = match history.at(stamp.epoch, stamp.exposure_ns, config.run.clock) {
            Some((positions, velocities)) => {
                refitter.merge_into(&mut learner, config.run.clock == Clock::Lockstep)?;
                let mut output = learner.step(&Input {
                    frame: stamp.frame,
                    exposure_ns: stamp.exposure_ns,
                    image: stamp.image,
                    target: *message.payload(),
                    joints: positions,
                    velocities,
                });
                output.state.refit_ns = refitter.last_ns();
                save(&mut checkpoint, epoch, &learner)?;
                refitter.begin(&learner);
                output
            }
            None if config.run.clock == Clock::Lockstep || begin < since + JOINTS_PATIENCE_NS => {
                pending = Some((message, since));
                continue;
            }
            None => {
                without_joints += 1;
                learner.refuse(Refused::NoJoints);
                Output { set_point: SetPoint::default(), state: learner.report() }
            }
        };
        states.publish(&stamp, &output.state)?;
        let stamp = stamp.extended(Service::Learner, Stage::Learn, begin, monotonic_ns());
        set_points.publish(&stamp, &output.set_point)?;
        station.answered(stamp.frame);
        station.health.refused = without_joints + targets.refused() + joints.refused();
    }
    Ok(())
}

/// Goes on with the saved learner; without one, or with one that cannot be used, untrained. What cannot be used
/// is kept beside the checkpoint at `file`.
fn restore(saved: Option<Vec<u8>>, config: &Config, file: &Path) -> (u64, Learner) {
    let untrained = || (0, Learner::new(&config.parameters, config.run.seed));
    let Some(bytes) = saved else { return untrained() };
    match usable(&bytes, &config.parameters) {
        Ok(saved) => {
            tracing::info!("going on with what was learnt before");
            (saved.epoch, saved.learner)
        }
        Err(why) => {
            let kept = refused_name(file);
            let kept = std::fs::copy(file, &kept).map_or_else(
                |error| format!("and cannot be kept ({error})"),
                |_| format!("kept as {}", kept.display()),
            );
            tracing::warn!("the saved learner {why}; {kept}; starting untrained");
            untrained()
        }
    }
}

/// The learner whose state was saved last in `file`, if there is one that can be used; nothing is changed.
pub fn saved(file: &Path, parameters: &Parameters) -> Option<Learner> {
    let restored = checkpoint::read(file, SCHEMA, CHECKPOINT_BYTES).ok()?;
    usable(&restored.state?, parameters).ok().map(|saved| saved.learner)
}

/// The learner in a saved state, or why it is none.
fn usable(bytes: &[u8], parameters: &Parameters) -> Result<Saved<Learner>, String> {
    let saved: Saved<Learner> =
        postcard::from_bytes(bytes).map_err(|error| format!("cannot be read: {error}"))?;
    if *saved.learner.parameters() != *parameters {
        return Err("has other parameters than the config".to_owned());
    }
    if !saved.learner.network().is_sound() {
        return Err("has weights that are not finite or absurd".to_owned());
    }
    Ok(saved)
}

fn save(checkpoint: &mut Checkpoint, epoch: u64, learner: &Learner) -> Result<(), ServiceError> {
    checkpoint.save_value(&Saved { epoch, learner })?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_saved_learner_that_cannot_be_used_is_refused_by_name() {
        let parameters = Parameters::default();
        let bytes =
            postcard::to_allocvec(&Saved { epoch: 3, learner: Learner::new(&parameters, 7) }).unwrap();
        assert_eq!(usable(&bytes, &parameters).map(|saved| saved.epoch), Ok(3));
        let refused = |bytes: &[u8], parameters: &Parameters| usable(bytes, parameters).map(|s| s.epoch);
        assert!(refused(&bytes[..bytes.len() / 2], &parameters).unwrap_err().contains("cannot be read"));
        let other = Parameters { training_moves: 99, ..parameters };
        assert!(refused(&bytes, &other).unwrap_err().contains("other parameters"));
        let mut weights = [0.0; pursuit_learning::WEIGHTS];
        Learner::new(&parameters, 7).network().export(&mut weights);
        let at = bytes.windows(8).position(|eight| eight == weights[0].to_le_bytes()).unwrap();
        let mut spoilt = bytes.clone();
        spoilt[at..at + 8].copy_from_slice(&f64::NAN.to_le_bytes());
        assert!(refused(&spoilt, &parameters).unwrap_err().contains("not finite"));
    }
}
