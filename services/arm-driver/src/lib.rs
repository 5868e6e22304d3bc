//! Arm driver: the only one that moves the arm, and it trusts nobody.
//!
//! A frame's way: SETPOINT → gates (epoch, finite, age, range) → limits of joints 1 and 2 → coupling of
//! the others → drive cycles to the arm. JOINTS go out with every reading. The driver keeps no state of
//! its own: it goes on from what the drives report as issued, so a restarted driver makes no jump.

#![cfg_attr(test, allow(clippy::unwrap_used))]

pub mod arm;
pub mod config;
mod simulated;
pub mod step;

use arm::{Arm, ArmError};
use config::Config;
use pursuit_bus::{Message, wait};
use pursuit_messages::topics::{JointStates, SetPoints};
use pursuit_messages::{Joints, Service, Stage};
use pursuit_runtime::clock::monotonic_ns;
use pursuit_runtime::settings::Clock;
use pursuit_runtime::{ServiceError, Station, TICK};
use simulated::SimulatedArm;
use step::Driver;

/// Runs until stopped.
///
/// # Errors
/// [`ServiceError`] for a wrong config or a bus that fails.
pub fn run(mut station: Station) -> Result<(), ServiceError> {
    let config =
        station.config(Config::read)?.unwrap_or_else(|| unreachable!("a coupling that cannot be is a fault"));
    let driver =
        Driver::new(config.parameters, config.coupling).map_err(|e| ServiceError::Other(e.to_string()))?;
    let joints = station.bus.publisher(JointStates)?;
    let set_points = station.bus.subscriber(SetPoints)?;
    let mut arm = SimulatedArm::connect(&station.bus, config.coupling.arm())?;
    arm.enable().map_err(lost)?;
    let mut newest: Option<Message<SetPoints>> = None;
    let mut refusal = 0;
    let mut epoch = 0;
    while station.turn() {
        wait(&[&set_points, arm.wakes()], TICK)?;
        joints.greet_new_readers();
        arm.greet_new_readers();
        if let Some((message, _)) = set_points.newest()? {
            // Epochs are start times: an older one is of a camera that is gone.
            epoch = epoch.max(message.stamp().epoch);
            newest = Some(message);
        }
        let fresh = arm.refresh()?;
        let Ok(reading) = arm.state() else { continue };
        let world = *arm.stamp();
        if fresh {
            let (position, velocity) = (reading.drives.position, reading.drives.velocity);
            let following = u32::from(refusal == 0);
            let state = Joints { time_ns: reading.time_ns, position, velocity, following, refusal };
            joints.publish(&world, &state)?;
        }
        let answers = newest.as_ref().filter(|message| message.stamp().trace_id == world.trace_id);
        let (set_point, cycles) = match config.run.clock {
            // The answer to the frame that the world waits for, and to no other.
            Clock::Lockstep if answers.is_some() && arm.awaits_answer() => (answers, config.cycles_per_frame),
            Clock::Lockstep => continue,
            Clock::Wall if fresh => (newest.as_ref(), 1),
            Clock::Wall => continue,
        };
        let begin = monotonic_ns();
        let given = set_point.map(|message| (message.payload(), message.stamp()));
        let command = driver.step(reading.time_ns, epoch, &reading.drives, given, cycles);
        refusal = command.refusal.map_or(0, |refusal| refusal as u32);
        let cause = given.map_or(world, |(_, stamp)| *stamp);
        let stamp = cause.extended(Service::ArmDriver, Stage::Drive, begin, monotonic_ns());
        arm.answering(stamp, given.map(|(set_point, _)| *set_point).unwrap_or_default());
        let deadline_ns = reading.time_ns + config.parameters.watchdog_ns;
        match arm.command(&command, config.parameters.cycle_ns, deadline_ns) {
            Ok(()) => station.answered(stamp.frame),
            Err(error) => {
                tracing::error!(%error, "the command was not taken: the drives stop by themselves");
                station.health.refused += 1;
            }
        }
    }
    arm.stop().map_err(lost)
}

fn lost(error: ArmError) -> ServiceError {
    ServiceError::Other(error.to_string())
}
