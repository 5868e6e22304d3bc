//! The drives' queue of cycles with due times, and the set-point between them.

use pursuit_kinematics::JOINTS;
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;

/// Most cycles that can wait: 2.56 s of 10 ms cycles, far beyond any configured latency.
pub const CAPACITY: usize = 256;

/// Where all joints shall be at one time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TimedCycle {
    /// End of the cycle, simulated time, ns.
    pub due_ns: u64,
    /// Length of the cycle, ns: it begins at `due_ns - duration_ns`.
    pub duration_ns: u64,
    /// Joint positions at its end, rad.
    pub position: [f64; JOINTS],
    /// Joint velocities at its end, rad/s.
    pub velocity: [f64; JOINTS],
}

/// Why the drives refuse a command. Nothing of a refused command is taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CyclesError {
    /// A position or velocity is not finite, or the cycle has no length.
    #[error("cycle {index}: not finite or without length")]
    NotFinite {
        /// Place in the command, from 0.
        index: usize,
    },
    /// Due times must be ahead of the simulated time and rise.
    #[error("cycle {index} is due at {due_ns} ns, not after {after_ns} ns")]
    NotAhead {
        /// Place in the command, from 0.
        index: usize,
        /// Its due time, ns.
        due_ns: u64,
        /// What it has to be after, ns.
        after_ns: u64,
    },
    /// More cycles than the queue holds.
    #[error("{waiting} cycles are waiting, {more} more do not fit into {CAPACITY}")]
    Full {
        /// Cycles in the queue.
        waiting: usize,
        /// Cycles of the command.
        more: usize,
    },
}

/// The queue. Between two cycles the set-point is their cubic Hermite interpolation; when no cycle is
/// left the drives come to rest by themselves, all joints together, and hold.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Cycles {
    /// The last cycle that fell due.
    previous: TimedCycle,
    waiting: VecDeque<TimedCycle>,
    /// The last of `waiting` is the drives' own stop.
    stopping: bool,
    stop_rad_per_s2: [f64; JOINTS],
}

impl Cycles {
    /// An empty queue; the arm rests at `position`. `stop_rad_per_s2` is the deceleration of the drives'
    /// own stop.
    pub fn at_rest(position: [f64; JOINTS], stop_rad_per_s2: [f64; JOINTS]) -> Cycles {
        let previous = TimedCycle { due_ns: 0, duration_ns: 0, position, velocity: [0.0; JOINTS] };
        Cycles { previous, waiting: VecDeque::with_capacity(CAPACITY), stopping: false, stop_rad_per_s2 }
    }

    /// Appends `commands` at simulated time `now_ns`. A stop of the drives that is under way ends where
    /// it is.
    ///
    /// # Errors
    /// [`CyclesError`]; the queue is then unchanged.
    pub fn accept(&mut self, now_ns: u64, commands: &[TimedCycle]) -> Result<(), CyclesError> {
        let kept = if self.stopping { 0 } else { self.waiting.len() };
        if kept + commands.len() > CAPACITY {
            return Err(CyclesError::Full { waiting: kept, more: commands.len() });
        }
        let mut after_ns = if kept > 0 { self.last().due_ns.max(now_ns) } else { now_ns };
        for (index, cycle) in commands.iter().enumerate() {
            let finite = cycle.position.iter().chain(&cycle.velocity).all(|value| value.is_finite());
            if !finite || cycle.duration_ns == 0 {
                return Err(CyclesError::NotFinite { index });
            }
            if cycle.due_ns <= after_ns {
                return Err(CyclesError::NotAhead { index, due_ns: cycle.due_ns, after_ns });
            }
            after_ns = cycle.due_ns;
        }
        if commands.is_empty() {
            return Ok(());
        }
        if self.stopping {
            let (position, velocity) = self.at(now_ns);
            self.previous = TimedCycle { due_ns: now_ns, duration_ns: 0, position, velocity };
            self.waiting.clear();
            self.stopping = false;
        }
        self.waiting.extend(commands);
        Ok(())
    }

    /// The last accepted cycle, or the drives' own stop: what a stateless driver continues from.
    pub fn last(&self) -> &TimedCycle {
        self.waiting.back().unwrap_or(&self.previous)
    }

    /// How many cycles are not due yet.
    pub fn waiting(&self) -> usize {
        self.waiting.len()
    }

    /// Prepares the set-point for a step that begins at `now_ns`: lets the due cycles pass, and starts
    /// the drives' own stop where no cycle follows at once on a moving one.
    pub fn begin_step(&mut self, now_ns: u64) {
        self.end_step(now_ns);
        let moving = self.previous.velocity.iter().any(|velocity| *velocity != 0.0);
        let begins_ns = self.waiting.front().map_or(u64::MAX, |next| next.begins_ns());
        if moving && self.previous.due_ns <= now_ns && begins_ns > now_ns {
            self.stopping = self.waiting.is_empty();
            self.waiting.push_front(self.stop_from(&self.previous, begins_ns));
            self.end_step(now_ns);
        }
    }

    /// Position (rad) and velocity (rad/s) of the set-point at `time_ns`, up to the next due time.
    pub fn at(&self, time_ns: u64) -> ([f64; JOINTS], [f64; JOINTS]) {
        let Some(next) = self.waiting.front() else { return self.held() };
        let begin_ns = self.previous.due_ns.max(next.begins_ns());
        if time_ns < begin_ns || begin_ns >= next.due_ns {
            return self.held();
        }
        let length_s = (next.due_ns - begin_ns) as f64 * 1e-9;
        let share = ((time_ns - begin_ns) as f64 * 1e-9 / length_s).min(1.0);
        let mut position = [0.0; JOINTS];
        let mut velocity = [0.0; JOINTS];
        for joint in 0..JOINTS {
            let ends = [self.previous.position[joint], next.position[joint]];
            let slopes = [self.previous.velocity[joint], next.velocity[joint]];
            (position[joint], velocity[joint]) = hermite(ends, slopes, length_s, share);
        }
        (position, velocity)
    }

    /// Lets the cycles that are due at `now_ns` pass. The drives' own stop does not start yet: a command
    /// at this very time still continues the last cycle.
    pub fn end_step(&mut self, now_ns: u64) {
        while let Some(cycle) = self.waiting.front().copied().filter(|cycle| cycle.due_ns <= now_ns) {
            self.previous = cycle;
            self.waiting.pop_front();
        }
        self.stopping &= !self.waiting.is_empty();
    }

    fn held(&self) -> ([f64; JOINTS], [f64; JOINTS]) {
        (self.previous.position, [0.0; JOINTS])
    }

    /// Straight to rest, all joints in the time that the slowest needs, cut off where the next cycle
    /// begins.
    fn stop_from(&self, moving: &TimedCycle, before_ns: u64) -> TimedCycle {
        let longest_s = moving
            .velocity
            .iter()
            .zip(self.stop_rad_per_s2)
            .map(|(velocity, deceleration)| velocity.abs() / deceleration)
            .fold(0.0, f64::max);
        let room_ns = before_ns - moving.due_ns;
        let duration_ns = ((longest_s * 1e9).ceil().max(1.0) as u64).min(room_ns);
        let half_s = duration_ns as f64 * 1e-9 / 2.0;
        TimedCycle {
            due_ns: moving.due_ns + duration_ns,
            duration_ns,
            position: std::array::from_fn(|joint| moving.position[joint] + moving.velocity[joint] * half_s),
            velocity: [0.0; JOINTS],
        }
    }
}

impl TimedCycle {
    fn begins_ns(&self) -> u64 {
        self.due_ns.saturating_sub(self.duration_ns)
    }
}

/// Value and slope of the cubic Hermite polynomial at `share` of its length.
fn hermite(ends: [f64; 2], slopes: [f64; 2], length_s: f64, share: f64) -> (f64, f64) {
    let way = ends[1] - ends[0];
    // Coefficients of share^2 and share^3.
    let square = 3.0 * way - (2.0 * slopes[0] + slopes[1]) * length_s;
    let cube = (slopes[0] + slopes[1]) * length_s - 2.0 * way;
    let value = ends[0] + share * (slopes[0] * length_s + share * (square + share * cube));
    let slope = slopes[0] + share * (2.0 * square + 3.0 * share * cube) / length_s;
    (value, slope)
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    fn cycle(due_ms: u64, position: f64, velocity: f64) -> TimedCycle {
        TimedCycle {
            due_ns: due_ms * MS,
            duration_ns: 10 * MS,
            position: [position; JOINTS],
            velocity: [velocity; JOINTS],
        }
    }

    fn queue() -> Cycles {
        Cycles::at_rest([0.0; JOINTS], [8.0; JOINTS])
    }

    fn joint1(cycles: &Cycles, time_ns: u64) -> (f64, f64) {
        let (position, velocity) = cycles.at(time_ns);
        (position[0], velocity[0])
    }

    #[test]
    fn a_cycle_of_constant_acceleration_is_followed_exactly() {
        let mut cycles = queue();
        // 8 rad/s^2 from rest: 0.0004 rad and 0.08 rad/s after 10 ms.
        cycles.accept(0, &[cycle(10, 0.0004, 0.08), cycle(20, 0.0016, 0.16)]).unwrap();
        for ms in 0..=20 {
            cycles.begin_step(ms * MS);
            let time_s = ms as f64 * 1e-3;
            let (position, velocity) = joint1(&cycles, ms * MS);
            assert!((position - 4.0 * time_s * time_s).abs() < 1e-12, "{ms} ms: {position}");
            assert!((velocity - 8.0 * time_s).abs() < 1e-9, "{ms} ms: {velocity}");
        }
    }

    #[test]
    fn it_holds_until_the_first_cycle_begins() {
        let mut cycles = queue();
        cycles.accept(0, &[cycle(90, 0.0004, 0.08)]).unwrap();
        cycles.begin_step(79 * MS);
        assert_eq!(joint1(&cycles, 79 * MS), (0.0, 0.0));
        assert!(joint1(&cycles, 85 * MS).0 > 0.0);
    }

    #[test]
    fn when_the_cycles_run_out_the_drives_brake_and_hold() {
        let mut cycles = queue();
        cycles.accept(0, &[cycle(10, 0.0, 0.4)]).unwrap();
        for ms in 0..200 {
            cycles.begin_step(ms * MS);
        }
        // v^2 / 2a = 0.01 rad, after 50 ms.
        assert!((joint1(&cycles, 199 * MS).0 - 0.01).abs() < 1e-9);
        assert_eq!(cycles.last().velocity, [0.0; JOINTS]);
        assert_eq!(cycles.last().due_ns, 60 * MS);
        assert_eq!(cycles.waiting(), 0);
    }

    #[test]
    fn at_the_due_time_of_the_last_cycle_it_is_still_the_issued_one() {
        let mut cycles = queue();
        cycles.accept(0, &[cycle(10, 0.0, 0.4)]).unwrap();
        cycles.begin_step(9 * MS);
        cycles.end_step(10 * MS);
        assert_eq!(cycles.last().velocity[0], 0.4);
        cycles.accept(10 * MS, &[cycle(20, 0.004, 0.4)]).unwrap();
        cycles.begin_step(10 * MS);
        assert!((joint1(&cycles, 15 * MS).1 - 0.4).abs() < 1e-9);
    }

    #[test]
    fn a_command_ends_the_drives_own_stop_where_it_is() {
        let mut cycles = queue();
        cycles.accept(0, &[cycle(10, 0.0, 0.4)]).unwrap();
        for ms in 0..=35 {
            cycles.begin_step(ms * MS);
        }
        let before = joint1(&cycles, 35 * MS);
        assert!((before.1 - 0.2).abs() < 1e-9, "{before:?}");
        cycles.accept(35 * MS, &[cycle(45, 0.01, 0.1)]).unwrap();
        assert_eq!(joint1(&cycles, 35 * MS), before);
        assert_eq!(cycles.last().due_ns, 45 * MS);
    }

    #[test]
    fn a_gap_between_moving_cycles_is_stopped_in() {
        let mut cycles = queue();
        cycles.accept(0, &[cycle(10, 0.0, 0.4), cycle(40, 0.05, 0.4)]).unwrap();
        for ms in 0..=30 {
            cycles.begin_step(ms * MS);
        }
        assert_eq!(joint1(&cycles, 30 * MS).1, 0.0);
        assert_eq!(cycles.last().due_ns, 40 * MS);
    }

    #[test]
    fn bad_commands_change_nothing() {
        let mut cycles = queue();
        cycles.accept(0, &[cycle(10, 0.0, 0.0)]).unwrap();
        let before = cycles.clone();
        let mut endless = cycle(30, 0.0, 0.0);
        endless.velocity[5] = f64::INFINITY;
        let bad = cycles.accept(0, &[cycle(20, 0.1, 0.0), endless]);
        assert_eq!(bad, Err(CyclesError::NotFinite { index: 1 }));
        assert!(matches!(cycles.accept(0, &[cycle(10, 0.1, 0.0)]), Err(CyclesError::NotAhead { .. })));
        assert!(matches!(cycles.accept(50 * MS, &[cycle(50, 0.1, 0.0)]), Err(CyclesError::NotAhead { .. })));
        let many: Vec<TimedCycle> = (0..CAPACITY as u64).map(|k| cycle(20 + k, 0.0, 0.0)).collect();
        assert!(matches!(cycles.accept(0, &many), Err(CyclesError::Full { .. })));
        assert_eq!(cycles, before);
    }
}
