//! Arm driver: the only one that moves the arm, and it trusts nobody.
//!
//! A frame's way: SETPOINT → gates (epoch, rising, finite, age, range) → safety chain ([`safety`]: may the arm
//! move at all?) → limits of joints 1 and 2 → coupling of the others → drive cycles to the arm. JOINTS and
//! DRIVER_STATE go out with every reading. No motion is remembered: it goes on from what the drives report as
//! issued, so a restarted driver makes no jump. A stop outlives the driver as a file ([`pursuit_runtime::latch`]).

#![cfg_attr(test, allow(clippy::unwrap_used))]

pub mod arm;
pub mod config;
pub mod guard;
mod reporter;
pub mod safety;
mod simulated;
pub mod step;

use arm::{Arm, ArmError};
use config::Config;
use guard::{Guard, Turn};
use pursuit_bus::{Message, wait};
use pursuit_messages::topics::{DriverStates, JointStates, SetPoints};
use pursuit_messages::{Service, Stage};
use pursuit_runtime::clock::monotonic_ns;
use pursuit_runtime::latch::Latches;
use pursuit_runtime::settings::Clock;
use pursuit_runtime::{ServiceError, Station, TICK};
use reporter::Reporter;
use safety::{Chain, Verdict};
use simulated::SimulatedArm;
use step::Driver;

/// Who is asked to end brakes first; this is longer than it takes from full speed, ns.
const BRAKE_LIMIT_NS: u64 = 800_000_000;

/// Runs until stopped; ends with the arm at rest.
///
/// # Errors
/// [`ServiceError`] for a wrong config or a bus that fails.
pub fn run(mut station: Station) -> Result<(), ServiceError> {
    let config =
        station.config(Config::read)?.unwrap_or_else(|| unreachable!("a coupling that cannot be is a fault"));
    let driver =
        Driver::new(config.parameters, config.coupling).map_err(|e| ServiceError::Other(e.to_string()))?;
    let joints = station.bus.publisher(JointStates)?;
    let mut reporter = Reporter::new(station.bus.publisher(DriverStates)?);
    let set_points = station.bus.subscriber(SetPoints)?;
    if !station.take_over()? {
        return Ok(());
    }
    let mut arm = SimulatedArm::connect(&station.bus, config.coupling.arm())?;
    let latches = Latches::open(station.directory())
        .map_err(|e| ServiceError::Other(format!("cannot look for stops in the run-time directory: {e}")))?;
    latches.forget_wishes();
    let mut guard = Guard::new(driver, Chain::new(config.rules, config.coupling.arm()));
    arm.enable().map_err(lost)?;
    let mut newest: Option<Message<SetPoints>> = None;
    let (mut read_ns, mut not_taken) = (monotonic_ns(), 0);
    let (mut at_rest, mut leaving_ns) = (true, None);
    loop {
        if !station.turn() {
            // In lock-step no time passes to brake in, unless somebody answers: the drives stop by themselves.
            let since_ns = *leaving_ns.get_or_insert_with(monotonic_ns);
            if at_rest || config.run.clock == Clock::Lockstep || monotonic_ns() > since_ns + BRAKE_LIMIT_NS {
                break;
            }
            guard.end();
        }
        wait(&[&set_points, arm.wakes()], TICK)?;
        joints.greet_new_readers();
        reporter.greet_new_readers();
        arm.greet_new_readers();
        if let Some((message, _)) = set_points.newest()? {
            newest = Some(message);
        }
        let fresh = arm.refresh()?;
        let begin = monotonic_ns();
        read_ns = if fresh { begin } else { read_ns };
        // In lock-step the simulated time stands still while nobody answers: nothing is lost by that.
        let heard = config.run.clock == Clock::Lockstep || begin - read_ns <= config.parameters.watchdog_ns;
        let reading = arm.state().ok().filter(|_| heard);
        let world = *arm.stamp();
        if let Some(reading) = reading.filter(|_| fresh) {
            joints.publish(&world, &reporter.joints(&reading))?;
        }
        let given = newest.as_ref().map(|message| (message.payload(), message.stamp()));
        let answers = given.is_some_and(|(_, stamp)| stamp.trace_id == world.trace_id);
        // In lock-step the answer to the frame that the world waits for, and to no other.
        let (due, cycles) = match config.run.clock {
            Clock::Lockstep => (answers && arm.awaits_answer(), config.cycles_per_frame),
            Clock::Wall => (fresh, 1),
        };
        let now_ns = reading.map_or(begin, |reading| reading.time_ns);
        let (verdict, command) = guard.turn(&Turn {
            now_ns,
            reading: reading.as_ref(),
            given,
            latch: latches.set(),
            wish: latches.take_wish(),
            // Who leaves follows nothing any more.
            looks: (due || config.run.clock == Clock::Wall) && leaving_ns.is_none(),
            cycles: due.then_some(cycles),
        });
        at_rest = verdict.at_rest;
        reporter.take(guard.chain(), &verdict, fresh, &world)?;
        if let Some(command) = command {
            reporter.refusal = command.refusal;
            let cause = given.map_or(world, |(_, stamp)| *stamp);
            let stamp = cause.extended(Service::ArmDriver, Stage::Drive, begin, monotonic_ns());
            arm.answering(stamp, given.map(|(set_point, _)| *set_point).unwrap_or_default());
            let deadline_ns = now_ns + config.parameters.watchdog_ns;
            match arm.command(&command, config.parameters.cycle_ns, deadline_ns) {
                Ok(()) => station.answered(stamp.frame),
                Err(error) => {
                    tracing::error!(%error, "the command was not taken: the drives stop by themselves");
                    not_taken += 1;
                }
            }
        }
        station.health.refused = not_taken + set_points.refused();
        remember(&latches, &verdict);
    }
    guard.end();
    reporter.end(guard.chain())?;
    arm.stop().map_err(lost)
}

/// A stop that the driver made by itself outlives it; a reset ends all stops.
fn remember(latches: &Latches, verdict: &Verdict) {
    let done = match verdict.latch {
        Some(latch) => latches.latch(latch),
        None if verdict.released => latches.release(),
        None => Ok(()),
    };
    if let Err(error) = done {
        tracing::error!(%error, "a stop cannot be written down, or taken away");
    }
}

fn lost(error: ArmError) -> ServiceError {
    ServiceError::Other(error.to_string())
}
