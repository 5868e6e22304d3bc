//! The arm driver's pure step: the gates, the limiter, the coupling.
//!
//! The driver keeps nothing between two calls. The drives report the last cycle that they accepted
//! ([`Drives::issued_position`]); the next command continues from there, so a restarted driver goes on
//! without a jump, and nothing is derived from noisy measurements.
//!
//! Gates and numbers: the design notes on reliability, sections 4.1 and 4.3.

use pursuit_kinematics::{Coupling, JOINTS, Limits, LimitsError, Motion};
use pursuit_messages::stamp::LAYOUT;
use pursuit_messages::{DriveCycle, MAX_CYCLES, Refusal, SetPoint, Stamp, WorldCommand};

/// Drive cycle, ns: 10 ms, a tenth of the drives' own time-out.
pub const DEFAULT_CYCLE_NS: u64 = 10_000_000;
/// Highest age of the exposure behind a set-point, ns: 80 ms latency, two missed periods of 80 ms, one
/// cycle.
pub const DEFAULT_WATCHDOG_NS: u64 = 250_000_000;
/// How far theta2 may leave the working envelope, rad: 2 degrees, room for the tracking of a target at
/// its edge; joint 3 has its limit 2 degrees further.
pub const DEFAULT_SLACK_RAD: f64 = 2.0 * std::f64::consts::PI / 180.0;
/// How far joints 3 to 6 may be from the coupling before the driver refuses to pull them onto it, rad:
/// a hundred times what the drives' own stop can cause, and at the tool less than 1 cm.
pub const COUPLING_TOLERANCE_RAD: f64 = 0.02;

/// A joint position beyond this is absurd, rad: two turns, where no joint has one and a half.
pub const ABSURD_RAD: f64 = 4.0 * std::f64::consts::PI;
/// A joint velocity beyond this is absurd, rad/s: seventy times what the fastest joint can.
pub const ABSURD_RAD_PER_S: f64 = 100.0;

/// What bounds the motion. All numbers must be positive and finite, but for the tool's
/// speed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameters {
    /// Length of a drive cycle, ns.
    pub cycle_ns: u64,
    /// Highest age of the exposure behind a set-point, ns.
    pub watchdog_ns: u64,
    /// Highest speeds of joints 1 and 2, rad/s; joint 2 is also held to what joints 3 and 5 can follow.
    pub max_speed_rad_per_s: [f64; 2],
    /// Highest accelerations of joints 1 and 2, rad/s².
    pub max_acceleration_rad_per_s2: [f64; 2],
    /// How far theta2 may leave the envelope, rad.
    pub slack_rad: f64,
    /// Highest speed of the camera over the table, m/s; infinite for none.
    pub max_tool_speed_m_per_s: f64,
}

/// What the drives report.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Drives {
    /// Measured joint positions, rad.
    pub position: [f64; JOINTS],
    /// Measured joint velocities, rad/s.
    pub velocity: [f64; JOINTS],
    /// Position of the last accepted cycle, rad.
    pub issued_position: [f64; JOINTS],
    /// Velocity of the last accepted cycle, rad/s.
    pub issued_velocity: [f64; JOINTS],
}

/// What the drives shall do next.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Command {
    /// The cycles in time order; `count` are used.
    pub cycles: [DriveCycle; MAX_CYCLES],
    /// Cycles used. 0: nothing safe can be issued, the drives stop by themselves.
    pub count: usize,
    /// Why the set-point is not followed; the cycles then brake to rest.
    pub refusal: Option<Refusal>,
}

/// The arm driver's decisions. Immutable: all state is in the drives.
#[derive(Clone, Debug, PartialEq)]
pub struct Driver {
    parameters: Parameters,
    coupling: Coupling,
    limits: [Limits; 2],
}

impl Parameters {
    /// The defaults for an arm with that coupling: the arm's own speeds.
    pub fn for_coupling(coupling: &Coupling) -> Parameters {
        let links = &coupling.arm().links;
        Parameters {
            cycle_ns: DEFAULT_CYCLE_NS,
            watchdog_ns: DEFAULT_WATCHDOG_NS,
            max_speed_rad_per_s: [links[0].max_speed_rad_per_s, links[1].max_speed_rad_per_s],
            max_acceleration_rad_per_s2: [pursuit_kinematics::limits::DEFAULT_MAX_ACCELERATION_RAD_PER_S2; 2],
            slack_rad: DEFAULT_SLACK_RAD,
            max_tool_speed_m_per_s: f64::INFINITY,
        }
    }
}

impl Command {
    fn empty(refusal: Refusal) -> Command {
        Command { cycles: [DriveCycle::default(); MAX_CYCLES], count: 0, refusal: Some(refusal) }
    }

    /// The cycles that are used.
    pub fn used(&self) -> &[DriveCycle] {
        &self.cycles[..self.count]
    }

    /// The message to the simulated drives.
    pub fn message(&self, cycle_ns: u64, set_point: SetPoint) -> WorldCommand {
        WorldCommand {
            cycle_count: self.count as u32,
            refusal: self.refusal.map_or(0, |refusal| refusal as u32),
            cycle_ns,
            set_point,
            cycles: self.cycles,
        }
    }
}

impl Driver {
    /// A driver for the arm and envelope of `coupling`. Speeds above the arm's own are lowered to them.
    ///
    /// # Errors
    /// [`LimitsError`] when a parameter is not positive and finite.
    pub fn new(parameters: Parameters, coupling: Coupling) -> Result<Driver, LimitsError> {
        let envelope = coupling.envelope();
        let [low2, high2] = envelope.theta2_rad;
        let ranges = [envelope.theta1_rad, [low2 - parameters.slack_rad, high2 + parameters.slack_rad]];
        // One speed limit over the whole range of theta2: a limit that fell on the way would have to be
        // braked for. It costs a fifth of joint 2's speed.
        let arm_speeds =
            [coupling.arm().links[0].max_speed_rad_per_s, coupling.joint2_speed_limit_within(ranges[1])];
        let limits = |axis: usize| {
            // `min` would drop a NaN.
            let wanted = parameters.max_speed_rad_per_s[axis];
            let speed = if wanted > arm_speeds[axis] { arm_speeds[axis] } else { wanted };
            let cycle_s = parameters.cycle_ns as f64 * 1e-9;
            Limits::new(ranges[axis], speed, parameters.max_acceleration_rad_per_s2[axis], cycle_s)
        };
        if parameters.max_tool_speed_m_per_s.is_nan() || parameters.max_tool_speed_m_per_s <= 0.0 {
            return Err(LimitsError::ToolSpeed { max_tool_speed_m_per_s: parameters.max_tool_speed_m_per_s });
        }
        Ok(Driver { parameters, limits: [limits(0)?, limits(1)?], coupling })
    }

    /// What bounds the motion.
    pub fn parameters(&self) -> &Parameters {
        &self.parameters
    }

    /// The coupling of the other joints.
    pub fn coupling(&self) -> &Coupling {
        &self.coupling
    }

    /// Limits of joints 1 and 2 as they are enforced.
    pub fn limits(&self) -> &[Limits; 2] {
        &self.limits
    }

    /// The next `cycles` drive cycles (at most [`MAX_CYCLES`]) at time `now_ns` of the loop's clock.
    ///
    /// `epoch` is that of the newest frame. A set-point names the positions of joints 1 and 2 *at the
    /// exposure of its frame on this clock*, and how they go on: cycle `k` (from 1) aims at
    /// `position + velocity * (now + k * cycle - exposure)`, and brakes where that time is beyond the
    /// watchdog's. Latencies between command and motion are
    /// for the learner to predict. A set-point that fails a gate is not followed: joints 1 and 2 brake
    /// from the last *issued* state, in that direction, to rest.
    pub fn step(
        &self,
        now_ns: u64,
        epoch: u64,
        drives: &Drives,
        set_point: Option<(&SetPoint, &Stamp)>,
        cycles: usize,
    ) -> Command {
        self.go(now_ns, drives, self.judge(now_ns, epoch, set_point), cycles)
    }

    /// The next `cycles` drive cycles towards a goal, or, because of a refusal, of coming to rest or staying there.
    pub fn go(&self, now_ns: u64, drives: &Drives, goal: Result<Goal, Refusal>, cycles: usize) -> Command {
        let refusal = goal.err();
        let issued = match self.issued(drives) {
            Ok(issued) => issued,
            Err(refusal) => return Command::empty(refusal),
        };
        let mut command = Command { cycles: [DriveCycle::default(); MAX_CYCLES], count: 0, refusal };
        let mut motion = issued;
        for k in 0..cycles.min(MAX_CYCLES) {
            let time_ns = now_ns.saturating_add((k as u64 + 1).saturating_mul(self.parameters.cycle_ns));
            match self.cycle(motion, goal.ok().and_then(|goal| goal.at(time_ns, self.parameters.watchdog_ns)))
            {
                Some((next, cycle)) => {
                    motion = next;
                    command.cycles[k] = cycle;
                    command.count = k + 1;
                }
                None => {
                    command.refusal = command.refusal.or(Some(Refusal::OutOfRange));
                    break;
                }
            }
        }
        command
    }

    /// The gates, in order. What passes them is the goal.
    ///
    /// # Errors
    /// Why the set-point must not be followed.
    pub fn judge(
        &self,
        now_ns: u64,
        epoch: u64,
        set_point: Option<(&SetPoint, &Stamp)>,
    ) -> Result<Goal, Refusal> {
        let (set_point, stamp) = set_point.ok_or(Refusal::None)?;
        if stamp.layout != LAYOUT || stamp.epoch != epoch {
            return Err(Refusal::OldEpoch);
        }
        if !set_point.position.iter().chain(&set_point.velocity).all(|value| value.is_finite()) {
            return Err(Refusal::NotFinite);
        }
        let absurd = |values: &[f64; 2], most: f64| values.iter().any(|value| value.abs() > most);
        if absurd(&set_point.position, ABSURD_RAD) || absurd(&set_point.velocity, ABSURD_RAD_PER_S) {
            return Err(Refusal::Absurd);
        }
        let age_ns = now_ns.checked_sub(stamp.exposure_ns).ok_or(Refusal::FromTheFuture)?;
        if age_ns > self.parameters.watchdog_ns {
            return Err(Refusal::Stale);
        }
        // The flag before the range: the position of a hold means nothing.
        if set_point.follow != 1 {
            return Err(Refusal::Hold);
        }
        if !self.coupling.envelope().contains(set_point.position, self.parameters.slack_rad) {
            return Err(Refusal::OutOfRange);
        }
        Ok(Goal {
            exposure_ns: stamp.exposure_ns,
            motions: std::array::from_fn(|axis| {
                let limit = self.limits[axis].max_speed_rad_per_s();
                Motion {
                    position: set_point.position[axis],
                    velocity: set_point.velocity[axis].clamp(-limit, limit),
                }
            }),
        })
    }

    /// Last issued state of joints 1 and 2. Refused when it is not finite or the other joints are not on
    /// the coupling: pulling them there would be a jump.
    fn issued(&self, drives: &Drives) -> Result<[Motion; 2], Refusal> {
        let (position, velocity) = (&drives.issued_position, &drives.issued_velocity);
        if !position.iter().chain(velocity).all(|value| value.is_finite()) {
            return Err(Refusal::NotFinite);
        }
        let coupled = self.coupling.joints(position[0], position[1]).ok_or(Refusal::OutOfRange)?;
        if coupled.iter().zip(position).any(|(wanted, is)| (wanted - is).abs() > COUPLING_TOLERANCE_RAD) {
            return Err(Refusal::OutOfRange);
        }
        Ok([0, 1].map(|axis| Motion { position: position[axis], velocity: velocity[axis] }))
    }

    /// One cycle towards `goal`, or braking without one; `None` where the arm has no such pose.
    fn cycle(&self, issued: [Motion; 2], goal: Option<[Motion; 2]>) -> Option<([Motion; 2], DriveCycle)> {
        let mut next = issued;
        for axis in 0..2 {
            let limits = &self.limits[axis];
            let limited = match goal {
                Some(goal) => limits.next(issued[axis], goal[axis]),
                None => limits.brake(issued[axis]),
            };
            next[axis] = limited.ok()?;
        }
        if goal.is_some() {
            self.slow_the_tool(issued, &mut next);
        }
        let theta = next.map(|motion| motion.position);
        let position = self.coupling.joints(theta[0], theta[1])?;
        let velocity = self.coupling.velocities(theta, next.map(|motion| motion.velocity));
        Some((next, DriveCycle { position, velocity }))
    }
}

impl Driver {
    /// Takes speed out of both joints alike where the camera would be too fast over the table at either end
    /// of the cycle. Slower in the same direction is always within the other limits; where the acceleration
    /// does not suffice it is the one that is kept.
    fn slow_the_tool(&self, issued: [Motion; 2], next: &mut [Motion; 2]) {
        let velocity = next.map(|motion| motion.velocity);
        let at = |motions: &[Motion; 2]| {
            let [x, y] = self.coupling.camera_velocity(motions.map(|motion| motion.position), velocity);
            x.hypot(y)
        };
        let fastest = at(&issued).max(at(next));
        if fastest <= self.parameters.max_tool_speed_m_per_s {
            return;
        }
        let share = self.parameters.max_tool_speed_m_per_s / fastest;
        for axis in 0..2 {
            next[axis] = self.limits[axis].towards(issued[axis], share * velocity[axis]);
        }
    }
}

/// A set-point that has passed the gates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Goal {
    exposure_ns: u64,
    motions: [Motion; 2],
}

impl Goal {
    /// Where joints 1 and 2 shall be at `time_ns`; `None` where the set-point is too old for it.
    fn at(&self, time_ns: u64, watchdog_ns: u64) -> Option<[Motion; 2]> {
        let ahead_ns = time_ns.saturating_sub(self.exposure_ns);
        let ahead_s = ahead_ns as f64 * 1e-9;
        (ahead_ns <= watchdog_ns).then(|| {
            self.motions
                .map(|motion| Motion { position: motion.position + motion.velocity * ahead_s, ..motion })
        })
    }
}

#[cfg(test)]
mod tests;
