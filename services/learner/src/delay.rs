//! How long the arm takes to do what it is told, measured while it follows.
//!
//! A set-point is a straight line through time: position at its frame's exposure, and velocity. The arm
//! driver goes on along it up to the moment of each drive cycle ([`SetPoint`](pursuit_messages::SetPoint)
//! counts from the exposure), so that the time from the exposure to the command, which is in the Stamps, is
//! made up for already. What is left is the way from the drive cycle to the motion: the cable, the
//! controller's queue, the lag of the servos. Nobody but the joints knows it:
//! `q(t) = set-point(t - delay)`. Squared errors for a row of possible delays are summed up with
//! forgetting, and the smallest is looked for between them.

use serde::{Deserialize, Serialize};

/// Delays that are tried: 0 to 300 ms in steps of 10 ms.
const CANDIDATES: usize = 31;
/// Their distance, ns.
const STEP_NS: u64 = 10_000_000;
/// Set-points kept: more than the longest delay at 100 Hz.
const KEPT: usize = 32;
/// Time over which errors are summed up, s.
const MEMORY_S: f64 = 8.0;
/// What the configured delay counts for: as much as following for so long at 0.1 rad/s.
const PRIOR_S: f64 = 0.5;
/// A joint slower than this does not show its delay, rad/s.
const SLOW_RAD_PER_S: f64 = 0.02;

/// A set-point that begins this far from where the last one ends is half believed, rad: the limiter leads
/// the arm from one to the other, which takes time that is no delay. Believed in full, a longer delay would
/// be predicted over, make longer jumps at the next bend, and look longer still.
const JUMP_RAD: f64 = 0.01;

/// A set-point: exposure, ns; positions, rad; velocities, rad/s; and how far from the last one's end, rad.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Line {
    from_ns: u64,
    position: [f64; 2],
    velocity: [f64; 2],
    jump: f64,
}

/// The measurement.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Delay {
    /// The last set-points, newest first; `count` of them.
    lines: [Line; KEPT],
    count: usize,
    /// Sum of squared errors of each candidate times the time that they stand for, rad² s.
    errors: [f64; CANDIDATES],
}

impl Delay {
    /// The joints were there at the exposure of a frame, and moved so fast (rad, rad/s).
    pub fn observe(&mut self, joints: [f64; 2], now_ns: u64) {
        let Some(newest) = self.lines[..self.count].first() else { return };
        let span_s = now_ns.saturating_sub(newest.from_ns) as f64 * 1e-9;
        let fast = newest.velocity.iter().any(|velocity| velocity.abs() > SLOW_RAD_PER_S);
        let longest_ns = (CANDIDATES as u64 - 1) * STEP_NS;
        let reaches = self.lines[self.count - 1].from_ns + longest_ns <= now_ns;
        if !fast || !reaches || span_s > 0.5 {
            return;
        }
        let jump = self.lines[..self.count]
            .iter()
            .take_while(|line| line.from_ns + longest_ns >= now_ns)
            .map(|line| line.jump / JUMP_RAD)
            .fold(0.0, f64::max);
        let weight = span_s / (1.0 + jump * jump).powi(2);
        let keeps = (-weight / MEMORY_S).exp();
        for (index, sum) in self.errors.iter_mut().enumerate() {
            let told = told(&self.lines[..self.count], now_ns - index as u64 * STEP_NS);
            let error: f64 = (0..2).map(|k| (joints[k] - told[k]).powi(2)).sum();
            *sum = keeps * *sum + error * weight;
        }
    }

    /// The answer to the frame exposed at `from_ns` is this set-point.
    pub fn told(&mut self, from_ns: u64, position: [f64; 2], velocity: [f64; 2]) {
        let jump = if self.count == 0 {
            0.0
        } else {
            let before = told(&self.lines[..self.count], from_ns);
            (position[0] - before[0]).abs().max((position[1] - before[1]).abs())
        };
        self.lines.copy_within(..KEPT - 1, 1);
        self.lines[0] = Line { from_ns, position, velocity, jump };
        self.count = (self.count + 1).min(KEPT);
    }

    /// The arm was told something that is no line: what comes next is not compared with what was before.
    pub fn interrupt(&mut self) {
        self.count = 0;
    }

    /// The delay, ns, between 0 and 300 ms; `prior_ns` where nothing is known yet.
    pub fn estimate_ns(&self, prior_ns: u64) -> u64 {
        let cost = |index: usize| {
            let off_s = (index as f64 * STEP_NS as f64 - prior_ns as f64) * 1e-9;
            self.errors[index] + 0.01 * PRIOR_S * off_s * off_s
        };
        let mut best = 0;
        for index in 1..CANDIDATES {
            if cost(index) < cost(best) {
                best = index;
            }
        }
        // The vertex of the parabola through the best and its neighbours.
        let middle = best.clamp(1, CANDIDATES - 2);
        let (before, here, after) = (cost(middle - 1), cost(middle), cost(middle + 1));
        let curvature = before - 2.0 * here + after;
        let shift = if curvature > 0.0 { 0.5 * (before - after) / curvature } else { 0.0 };
        let steps = (middle as f64 + shift).clamp(0.0, (CANDIDATES - 1) as f64);
        (steps * STEP_NS as f64).round() as u64
    }
}

/// Where the joints were told to be at `time_ns`, newest line first.
fn told(lines: &[Line], time_ns: u64) -> [f64; 2] {
    let line = lines.iter().find(|line| line.from_ns <= time_ns).or(lines.last());
    line.map_or([0.0; 2], |line| {
        let ahead_s = time_ns.saturating_sub(line.from_ns) as f64 * 1e-9;
        [0, 1].map(|k| line.position[k] + line.velocity[k] * ahead_s)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const PRIOR_NS: u64 = 90_000_000;

    fn followed(delay_s: f64, period_s: f64, noise_rad: f64) -> Delay {
        let mut delay = Delay::default();
        let way = |t: f64| [0.4 * (0.9 * t).sin(), 0.6 + 0.2 * (0.7 * t).cos()];
        for frame in 0..(12.0 / period_s) as u64 {
            let t = frame as f64 * period_s;
            let now_ns = (t * 1e9).round() as u64;
            let wobble = noise_rad * if frame % 2 == 0 { 1.0 } else { -1.0 };
            delay.observe(way(t - delay_s).map(|joint| joint + wobble), now_ns);
            let (here, then) = (way(t), way(t + period_s));
            delay.told(now_ns, here, [0, 1].map(|k| (then[k] - here[k]) / period_s));
        }
        delay
    }

    proptest! {
        #[test]
        fn a_delay_is_found_at_any_rate(delay_ms in 0.0..250.0f64, rate in 0usize..3) {
            let period_s = [0.08, 0.04, 0.01][rate];
            let found = followed(1e-3 * delay_ms, period_s, 0.002).estimate_ns(PRIOR_NS) as f64 * 1e-6;
            prop_assert!((found - delay_ms).abs() < 6.0, "{found} ms for {delay_ms} ms");
        }
    }

    #[test]
    fn without_motion_the_prior_stays() {
        let mut delay = Delay::default();
        for frame in 0..100 {
            delay.observe([0.1, 0.6], frame * 80_000_000);
            delay.told(frame * 80_000_000, [0.1, 0.6], [0.0; 2]);
        }
        assert_eq!(delay.estimate_ns(PRIOR_NS), PRIOR_NS);
    }

    #[test]
    fn an_interruption_is_not_compared_across() {
        let mut delay = followed(0.08, 0.08, 0.0);
        let before = delay.errors;
        delay.interrupt();
        delay.observe([2.0, 2.0], 20_000_000_000);
        assert_eq!(delay.errors, before);
    }
}
