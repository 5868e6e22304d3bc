//! What must hold whatever happens, checked on all that is said on the bus. Pure: messages and faults come in,
//! violations come out. The numbers are those of the invariants of our design notes on reliability, section 3.

use crate::chaos::frames::Frames;
use pursuit_arm_driver::safety::Travel;
use pursuit_arm_driver::step::Driver;
use pursuit_messages::{
    ArmState, DriverState, Health, LearnerState, Service, Stamp, WorldCommand, WorldState,
};
use pursuit_supervisor::policy::{INTENSITY, WINDOW_NS};
use std::collections::VecDeque;

/// Rounding of what is computed in one process and checked in another.
const ROUNDING: f64 = 1e-6;
/// Measured joints may be past a limit by the drives' own error, rad.
const MEASURED_RAD: f64 = 0.01;
/// Slower than this is at rest, rad/s: a drive that holds trembles.
const REST_RAD_PER_S: f64 = 0.05;
/// Readings that a command may have been made from: those of the last cycles.
const READINGS: usize = 6;
/// The newest of them is not older than this, ns, or some were not heard.
const HEARD_NS: u64 = 60_000_000;
/// Services, the supervisor not counted.
const SERVICES: usize = Service::ALL.len();

/// What the arm is held to.
#[derive(Clone, Debug)]
pub struct Bounds {
    driver: Driver,
    /// From the exposure behind the last set-point to rest, ns.
    rest_ns: u64,
}

impl Bounds {
    /// Those of a driver whose commands take effect after `latency_ns`.
    pub fn new(driver: Driver, latency_ns: u64) -> Bounds {
        let travel = Travel::worst(&driver, latency_ns as f64 * 1e-9);
        let cycles = 3 * driver.parameters().cycle_ns;
        let rest_ns = ((travel.reaction_s + travel.braking_s) * 1e9) as u64 + cycles;
        Bounds { driver, rest_ns }
    }
}

/// One thing that must not have happened.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Violation {
    /// When, CLOCK_MONOTONIC, ns.
    pub time_ns: u64,
    /// Which invariant.
    pub invariant: &'static str,
    /// What was seen.
    pub what: String,
}

/// The processes of one service.
#[derive(Default)]
struct Lives {
    /// Those that were the service, and when each was first heard, ns.
    pids: Vec<(u32, u64)>,
}

/// Watches a run.
pub struct Checker {
    bounds: Bounds,
    lives: [Lives; SERVICES],
    readings: VecDeque<WorldState>,
    /// Commands that were heard, until a reading is heard that is younger: who hears late hears many at once.
    waiting: VecDeque<(Stamp, WorldCommand)>,
    world_epoch: u64,
    /// Time of the first reading: what moved the arm before it was not heard.
    joined_ns: Option<u64>,
    /// Epoch and number of the newest frame that moved the arm.
    used: (u64, u64),
    /// Exposure behind the newest command that followed a set-point, and when it was given, ns.
    followed: Option<(u64, u64)>,
    driver: Option<DriverState>,
    reset_asked: bool,
    samples: u64,
    /// Learning samples that a restart lost.
    pub lost_samples: u64,
    /// Which frames were answered.
    pub frames: Frames,
    /// What must not have happened.
    pub violations: Vec<Violation>,
}

impl Checker {
    /// One that has seen nothing.
    pub fn new(bounds: Bounds) -> Checker {
        Checker {
            bounds,
            lives: Default::default(),
            readings: VecDeque::with_capacity(READINGS + 1),
            waiting: VecDeque::new(),
            world_epoch: 0,
            joined_ns: None,
            used: (0, 0),
            followed: None,
            driver: None,
            reset_asked: false,
            samples: 0,
            lost_samples: 0,
            frames: Frames::default(),
            violations: Vec::new(),
        }
    }

    /// Notes that something must not have happened.
    pub fn violated(&mut self, time_ns: u64, invariant: &'static str, what: String) {
        self.violations.push(Violation { time_ns, invariant, what });
    }

    /// An operator asks for a reset.
    pub fn reset_asked(&mut self) {
        self.reset_asked = true;
    }

    /// What the arm driver said last.
    pub fn driver(&self) -> Option<&DriverState> {
        self.driver.as_ref()
    }

    /// When the first process after `time_ns` was heard as the service, ns.
    pub fn reborn(&self, service: Service, time_ns: u64) -> Option<u64> {
        let lives = self.lives.get(index(service))?;
        lives.pids.iter().map(|(_, since)| *since).find(|since| *since > time_ns)
    }

    /// HEALTH: one process at a time is a service (I6), and none is started too often (I8).
    pub fn health(&mut self, health: &Health) {
        let Some(service) = Service::from_number(health.service as u16) else { return };
        if health.standing_by == 1 {
            return;
        }
        let Some(lives) = self.lives.get_mut(index(service)) else { return };
        let now = health.time_ns;
        match lives.pids.iter().rposition(|(pid, _)| *pid == health.pid) {
            Some(last) if last + 1 == lives.pids.len() => {}
            Some(_) => self.violated(now, "I6", format!("two processes are {} at once", service.name())),
            None => {
                lives.pids.push((health.pid, now));
                let recent = lives.pids.iter().filter(|(_, since)| now - since.min(&now) < WINDOW_NS).count();
                if recent > INTENSITY + 1 {
                    self.violated(
                        now,
                        "I8",
                        format!("{} was started {recent} times in 10 s", service.name()),
                    );
                }
            }
        }
    }

    /// WORLD_COMMAND, before the readings that it can have been made from, or with them.
    pub fn hear_command(&mut self, stamp: &Stamp, command: &WorldCommand) {
        self.waiting.push_back((*stamp, *command));
    }

    /// WORLD_STATE: first what was commanded before it.
    pub fn hear_world(&mut self, stamp: &Stamp, world: &WorldState) {
        while self.waiting.front().is_some_and(|(stamp, _)| begin_ns(stamp) < world.time_ns) {
            self.next_command();
        }
        self.world(stamp, world);
    }

    /// No reading comes any more.
    pub fn settle(&mut self) {
        while !self.waiting.is_empty() {
            self.next_command();
        }
    }

    fn next_command(&mut self) {
        if let Some((stamp, command)) = self.waiting.pop_front() {
            self.command(&stamp, &command);
        }
    }

    /// WORLD_STATE: joints within their limits (I1), and at rest when nothing fresh moves them (I4).
    fn world(&mut self, stamp: &Stamp, world: &WorldState) {
        if stamp.epoch != self.world_epoch {
            // Another world: its arm stands where it begins.
            self.world_epoch = stamp.epoch;
            self.readings.clear();
            self.followed = None;
        }
        if world.exposes == 1 {
            self.frames.exposed(stamp);
        }
        let now = world.time_ns;
        let ranges = self.bounds.driver.coupling().arm().links.map(|link| link.position_limits_rad);
        for (joint, (position, [low, high])) in world.position.iter().zip(ranges).enumerate() {
            if !(low - MEASURED_RAD..=high + MEASURED_RAD).contains(position) {
                self.violated(now, "I1", format!("joint {} is at {position} rad", joint + 1));
            }
        }
        let fastest = world.velocity.iter().fold(0.0f64, |most, v| most.max(v.abs()));
        let joined = *self.joined_ns.get_or_insert(now);
        let excused = self.followed.map_or(joined, |(exposure, _)| exposure.max(joined));
        let fresh = now <= excused + self.bounds.rest_ns;
        if !fresh && fastest > REST_RAD_PER_S && self.readings.len() == READINGS {
            let since = self.followed.map_or(0.0, |(exposure, _)| (now - exposure) as f64 * 1e-6);
            let what = format!("a joint moves at {fastest:.3} rad/s, {since:.0} ms after the last exposure");
            self.violated(now, "I4", what);
        }
        if self.readings.len() == READINGS {
            self.readings.pop_front();
        }
        self.readings.push_back(*world);
    }

    /// WORLD_COMMAND: within the limits (I1, I2), fresh (I3), frames rise (I7).
    fn command(&mut self, stamp: &Stamp, command: &WorldCommand) {
        let Some(stage) = stamp.passed().last() else { return };
        let now = stage.begin_ns;
        let answers_a_frame = stamp.passed().len() > 1;
        if answers_a_frame {
            self.frames.answered(stamp, stage.end_ns);
        }
        if command.refusal == 0 {
            let age_ns = now.saturating_sub(stamp.exposure_ns);
            let parameters = self.bounds.driver.parameters();
            if age_ns > parameters.watchdog_ns + parameters.cycle_ns {
                let what =
                    format!("a set-point was followed {:.0} ms after its exposure", age_ns as f64 * 1e-6);
                self.violated(now, "I3", what);
            }
            if (stamp.epoch, stamp.frame) < self.used {
                self.violated(now, "I7", format!("frame {} was followed after a later one", stamp.frame));
            }
            self.used = self.used.max((stamp.epoch, stamp.frame));
            self.followed = Some((stamp.exposure_ns, now));
        }
        self.limits_of(now, command);
    }

    fn limits_of(&mut self, now: u64, command: &WorldCommand) {
        let limits = *self.bounds.driver.limits();
        let mut broken = Vec::new();
        for cycle in &command.cycles[..(command.cycle_count as usize).min(command.cycles.len())] {
            for (axis, limits) in limits.iter().enumerate() {
                let ([low, high], speed) = (limits.position_rad(), cycle.velocity[axis].abs());
                // Not a number is in no range.
                if !(low - ROUNDING..=high + ROUNDING).contains(&cycle.position[axis]) {
                    broken
                        .push(("I1", format!("joint {} is sent to {} rad", axis + 1, cycle.position[axis])));
                }
                if !(0.0..=limits.max_speed_rad_per_s() + ROUNDING).contains(&speed) {
                    broken.push(("I2", format!("joint {} is sent there at {speed} rad/s", axis + 1)));
                }
            }
        }
        // What was made from a reading that nobody heard cannot be judged.
        let was_heard = self.readings.back().is_some_and(|newest| now < newest.time_ns + HEARD_NS);
        if let (Some(first), true) = (command.cycles.first(), was_heard) {
            let continues = |reading: &WorldState| {
                limits.iter().enumerate().all(|(axis, limits)| {
                    let change = (first.velocity[axis] - reading.issued_velocity[axis]).abs();
                    change <= limits.max_acceleration_rad_per_s2() * limits.cycle_s() + ROUNDING
                })
            };
            if command.cycle_count > 0 && !self.readings.iter().any(continues) {
                broken.push(("I2", "a command continues no reading of the drives".to_owned()));
            }
        }
        for (invariant, what) in broken {
            self.violated(now, invariant, what);
        }
    }

    /// DRIVER_STATE: a latched stop is left by a reset only (I5).
    pub fn driver_state(&mut self, state: &DriverState) {
        let latched = |state: &DriverState| {
            matches!(state.state(), Some(ArmState::EmergencyStop | ArmState::ProtectiveStop))
        };
        if self.driver.as_ref().is_some_and(latched) && !latched(state) {
            if !self.reset_asked {
                let to = state.state().map_or("?", ArmState::word);
                self.violated(state.time_ns, "I5", format!("a stop was left to {to} without a reset"));
            }
            self.reset_asked = false;
        }
        self.driver = Some(*state);
    }

    /// LEARNER_STATE: no sample is lost.
    pub fn learner(&mut self, state: &LearnerState) {
        self.lost_samples += self.samples.saturating_sub(state.samples);
        self.samples = state.samples;
    }
}

/// When a command was begun, ns.
fn begin_ns(stamp: &Stamp) -> u64 {
    stamp.passed().last().map_or(0, |stage| stage.begin_ns)
}

fn index(service: Service) -> usize {
    Service::ALL.iter().position(|one| *one == service).unwrap_or(usize::MAX)
}

#[cfg(test)]
#[path = "checker_tests.rs"]
mod tests;
