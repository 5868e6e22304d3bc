//! Speed over time, for example stop-and-go.

use serde::{Deserialize, Serialize};

/// Speeds at times, linear between them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SpeedProfile {
    /// (time in seconds, speed in metres per second), times rising from 0, speeds not negative.
    points: Vec<(f64, f64)>,
    /// Whether it starts again after the last point; otherwise the last speed stays.
    repeats: bool,
}

impl SpeedProfile {
    /// A profile through `points`, each (time in seconds, speed in metres per second); `None` unless the times start
    /// at 0 and rise, and the speeds are finite and not negative.
    pub fn new(points: Vec<(f64, f64)>, repeats: bool) -> Option<Self> {
        let rising = points.windows(2).all(|pair| pair[0].0 < pair[1].0);
        let valid = points.iter().all(|p| p.0.is_finite() && p.1.is_finite() && p.1 >= 0.0);
        let starts = points.first().is_some_and(|p| p.0 == 0.0) && (!repeats || points.len() > 1);
        (rising && valid && starts).then_some(Self { points, repeats })
    }

    /// Drives with `speed_m_per_s` for `go_s` seconds and stands for `stop_s`, over and over, with ramps of
    /// `ramp_s` seconds between; `None` unless all are positive.
    pub fn stop_and_go(speed_m_per_s: f64, go_s: f64, stop_s: f64, ramp_s: f64) -> Option<Self> {
        let stop = go_s + ramp_s;
        let points = vec![
            (0.0, speed_m_per_s),
            (go_s, speed_m_per_s),
            (stop, 0.0),
            (stop + stop_s, 0.0),
            (stop + stop_s + ramp_s, speed_m_per_s),
        ];
        Self::new(points, true)
    }

    /// Speed at a time, metres per second.
    pub fn speed_at(&self, t_s: f64) -> f64 {
        let (_, t) = self.periods(t_s);
        let next = self.points.partition_point(|p| p.0 <= t);
        match (self.points.get(next.wrapping_sub(1)), self.points.get(next)) {
            (Some(a), Some(b)) => a.1 + (b.1 - a.1) * (t - a.0) / (b.0 - a.0),
            (Some(a), None) => a.1,
            _ => self.points[0].1,
        }
    }

    /// Way until a time, metres.
    pub fn distance_at(&self, t_s: f64) -> f64 {
        let (periods, t) = self.periods(t_s);
        let within = self.within_period(t);
        if periods > 0.0 { periods * self.within_period(self.last_time()) + within } else { within }
    }

    fn within_period(&self, t: f64) -> f64 {
        let mut distance = 0.0;
        for pair in self.points.windows(2) {
            let (a, b) = (pair[0], pair[1]);
            if t < b.0 {
                let speed = a.1 + (b.1 - a.1) * (t - a.0) / (b.0 - a.0);
                return distance + 0.5 * (a.1 + speed) * (t - a.0);
            }
            distance += 0.5 * (a.1 + b.1) * (b.0 - a.0);
        }
        distance + (t - self.last_time()) * self.points[self.points.len() - 1].1
    }

    fn last_time(&self) -> f64 {
        self.points[self.points.len() - 1].0
    }

    /// Full periods before a time, and the time within the current one.
    fn periods(&self, t_s: f64) -> (f64, f64) {
        if !self.repeats {
            return (0.0, t_s);
        }
        let periods = (t_s / self.last_time()).floor();
        (periods, t_s - periods * self.last_time())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distance_is_the_integral_of_speed() {
        let repeating = SpeedProfile::stop_and_go(0.1, 2.0, 1.0, 0.5).unwrap();
        let once = SpeedProfile::new(vec![(0.0, 0.0), (1.0, 0.2), (4.0, 0.1)], false).unwrap();
        for profile in [repeating, once] {
            let (mut sum, dt) = (0.0, 1e-3);
            for i in 0..12_000 {
                sum += dt * profile.speed_at((f64::from(i) + 0.5) * dt);
            }
            assert!((profile.distance_at(12.0) - sum).abs() < 1e-6, "{profile:?}: {sum}");
        }
    }

    #[test]
    fn profiles_that_are_none_are_refused() {
        assert!(SpeedProfile::new(vec![], false).is_none());
        assert!(SpeedProfile::new(vec![(0.0, 0.1), (0.0, 0.2)], false).is_none());
        assert!(SpeedProfile::new(vec![(0.0, f64::NAN)], false).is_none());
        assert!(SpeedProfile::new(vec![(0.0, 0.1)], true).is_none());
    }
}
