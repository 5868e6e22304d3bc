//! The joints at a frame's exposure, out of the readings around it.

use pursuit_messages::Joints;
use pursuit_runtime::settings::Clock;

/// Readings kept: more than half a second at 100 Hz.
const KEPT: usize = 64;
/// How far past the newest reading the joints may be extrapolated, ns: at 8 rad/s² that is 1.6 mrad off.
const MAX_EXTRAPOLATION_NS: u64 = 20_000_000;
/// Readings further apart than this are not interpolated, ns.
const MAX_GAP_NS: u64 = 100_000_000;

/// Position and velocity of joints 1 and 2, rad and rad/s.
pub type Moment = ([f64; 2], [f64; 2]);

#[derive(Clone, Copy)]
struct Reading {
    time_ns: u64,
    position: [f64; 2],
    velocity: [f64; 2],
}

/// The last readings of joints 1 and 2, in time order.
#[derive(Default)]
pub struct JointHistory {
    epoch: u64,
    readings: std::collections::VecDeque<Reading>,
}

impl JointHistory {
    /// Takes a reading; another epoch forgets the older ones, a reading that is not newer or not finite is
    /// passed over.
    pub fn take(&mut self, epoch: u64, joints: &Joints) {
        if epoch != self.epoch {
            self.readings.clear();
            self.epoch = epoch;
        }
        let reading = Reading {
            time_ns: joints.time_ns,
            position: [joints.position[0], joints.position[1]],
            velocity: [joints.velocity[0], joints.velocity[1]],
        };
        let finite = reading.position.iter().chain(&reading.velocity).all(|value| value.is_finite());
        if !finite || self.readings.back().is_some_and(|last| last.time_ns >= reading.time_ns) {
            return;
        }
        if self.readings.len() == KEPT {
            self.readings.pop_front();
        }
        self.readings.push_back(reading);
    }

    /// Joints at `time_ns`. In lock-step only the reading of that very time counts; on the wall clock it
    /// is interpolated (cubic Hermite) or, a little past the newest one, extrapolated.
    pub fn at(&self, epoch: u64, time_ns: u64, clock: Clock) -> Option<Moment> {
        // On the wall clock camera and arm have lives of their own and one clock in common.
        if clock == Clock::Lockstep && epoch != self.epoch {
            return None;
        }
        let after = self.readings.iter().position(|reading| reading.time_ns >= time_ns);
        if let Some(exact) = after.map(|k| self.readings[k]).filter(|reading| reading.time_ns == time_ns) {
            return Some((exact.position, exact.velocity));
        }
        match (clock, after) {
            (Clock::Lockstep, _) | (Clock::Wall, Some(0)) => None,
            (Clock::Wall, Some(k)) => between(&self.readings[k - 1], &self.readings[k], time_ns),
            (Clock::Wall, None) => beyond(self.readings.back()?, time_ns),
        }
    }
}

fn between(a: &Reading, b: &Reading, time_ns: u64) -> Option<Moment> {
    let gap_ns = b.time_ns - a.time_ns;
    if gap_ns > MAX_GAP_NS {
        return None;
    }
    let h = gap_ns as f64 * 1e-9;
    let s = (time_ns - a.time_ns) as f64 / gap_ns as f64;
    let hermite = |k: usize| {
        let (p0, p1, v0, v1) = (a.position[k], b.position[k], a.velocity[k] * h, b.velocity[k] * h);
        let slope = p1 - p0;
        let position =
            p0 + s * v0 + s * s * (3.0 * slope - 2.0 * v0 - v1) + s * s * s * (v0 + v1 - 2.0 * slope);
        let velocity =
            (v0 + 2.0 * s * (3.0 * slope - 2.0 * v0 - v1) + 3.0 * s * s * (v0 + v1 - 2.0 * slope)) / h;
        (position, velocity)
    };
    let (first, second) = (hermite(0), hermite(1));
    Some(([first.0, second.0], [first.1, second.1]))
}

fn beyond(last: &Reading, time_ns: u64) -> Option<Moment> {
    let ahead_ns = time_ns - last.time_ns;
    if ahead_ns > MAX_EXTRAPOLATION_NS {
        return None;
    }
    let ahead_s = ahead_ns as f64 * 1e-9;
    let position = [0, 1].map(|k| last.position[k] + last.velocity[k] * ahead_s);
    Some((position, last.velocity))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn readings(times_ms: &[u64]) -> JointHistory {
        let mut history = JointHistory::default();
        for &ms in times_ms {
            let t = ms as f64 * 1e-3;
            let mut joints = Joints { time_ns: ms * 1_000_000, ..Joints::default() };
            (joints.position[0], joints.velocity[0]) = (t * t * t, 3.0 * t * t);
            (joints.position[1], joints.velocity[1]) = (2.0 - t, -1.0);
            history.take(7, &joints);
        }
        history
    }

    #[test]
    fn a_cubic_is_interpolated_exactly() {
        let history = readings(&[0, 10, 20, 30]);
        let ([first, second], [rate, _]) = history.at(7, 17_000_000, Clock::Wall).unwrap();
        assert!((first - 0.017_f64.powi(3)).abs() < 1e-15);
        assert!((rate - 3.0 * 0.017 * 0.017).abs() < 1e-12);
        assert!((second - 1.983).abs() < 1e-12);
    }

    #[test]
    fn lockstep_takes_no_other_time() {
        let history = readings(&[0, 40]);
        assert!(history.at(7, 40_000_000, Clock::Lockstep).is_some());
        assert!(history.at(7, 39_000_000, Clock::Lockstep).is_none());
        assert!(history.at(8, 40_000_000, Clock::Lockstep).is_none());
    }

    #[test]
    fn neither_the_far_future_nor_the_past_is_made_up() {
        let history = readings(&[100, 110]);
        assert!(history.at(7, 125_000_000, Clock::Wall).is_some());
        assert!(history.at(7, 140_000_000, Clock::Wall).is_none());
        assert!(history.at(7, 99_000_000, Clock::Wall).is_none());
    }

    #[test]
    fn what_is_not_finite_or_not_newer_is_passed_over() {
        let mut history = readings(&[100]);
        let mut wrong = Joints { time_ns: 110_000_000, ..Joints::default() };
        wrong.velocity[0] = f64::NAN;
        history.take(7, &wrong);
        assert!(history.at(7, 110_000_000, Clock::Lockstep).is_none());
        history.take(7, &Joints { time_ns: 90_000_000, ..Joints::default() });
        assert!(history.at(7, 90_000_000, Clock::Lockstep).is_none());
    }
}
