//! A kinematic bicycle that follows a point ahead of it (pure pursuit), with lags of steering and speed.
//!
//! The reference point is the middle of the body, half the wheelbase before the rear axle: with steering angle δ the
//! body's middle moves at the slip angle β = atan(½ tan δ) to the heading, on a curvature of 2 sin β / wheelbase.
//! The middle, not the rear axle, follows the path; the body then points a little to the inside of a bend's outer
//! tangent, as a car does.

use serde::{Deserialize, Serialize};

use super::curve::{CurvePoint, wrapped};
use super::walk::OrnsteinUhlenbeck;
use crate::random::Random;

/// From axle to axle, metres.
pub(super) const WHEELBASE_M: f64 = 0.11;
/// Distance of the pursued point, metres.
pub(super) const LOOK_AHEAD_M: f64 = 0.08;
/// Time constant of the steering, seconds.
const STEERING_LAG_S: f64 = 0.05;
/// Time constant of the speed, seconds.
const SPEED_LAG_S: f64 = 0.3;
/// What is slower than this, metres per second, and shall stand, stands: the lag alone would never end.
const REST_M_PER_S: f64 = 1e-3;
/// Largest steering angle, radians: curvature of 7 per metre.
const MAX_STEERING_RAD: f64 = 0.7;

/// Ornstein-Uhlenbeck disturbance of the steering and the speed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Disturbance {
    /// Standard deviation of the steering angle, radians.
    pub steering_sd_rad: f64,
    /// Standard deviation of the speed as a fraction of it.
    pub speed_sd: f64,
    /// How long it remembers itself, seconds.
    pub time_constant_s: f64,
}

impl Default for Disturbance {
    /// A degree of steering and a twentieth of the speed, changing within half a second.
    fn default() -> Self {
        Self { steering_sd_rad: 0.02, speed_sd: 0.05, time_constant_s: 0.5 }
    }
}

/// State of the bicycle.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Bicycle {
    pub(super) position: [f64; 2],
    /// Of the body, radians.
    pub(super) heading: f64,
    steering: f64,
    pub(super) speed: f64,
    steering_error: OrnsteinUhlenbeck,
    speed_error: OrnsteinUhlenbeck,
}

impl Bicycle {
    /// On `point` of a path in steady motion.
    pub(super) fn new(point: &CurvePoint, speed: f64) -> Self {
        let steering = steering_for(point.curvature);
        Self {
            position: point.position,
            heading: wrapped(point.heading - slip(steering)),
            steering,
            speed,
            steering_error: OrnsteinUhlenbeck::default(),
            speed_error: OrnsteinUhlenbeck::default(),
        }
    }

    /// Direction of the middle's motion, radians.
    pub(super) fn course(&self) -> f64 {
        self.heading + slip(self.steering)
    }

    /// Drives for `dt_s` seconds towards `goal` with a wanted speed.
    pub(super) fn advance(
        &mut self,
        goal: [f64; 2],
        wanted_speed: f64,
        dt_s: f64,
        disturbance: Option<&Disturbance>,
        random: &mut Random,
    ) {
        if let Some(d) = disturbance {
            self.steering_error.advance(d.steering_sd_rad, d.time_constant_s, dt_s, random);
            self.speed_error.advance(d.speed_sd, d.time_constant_s, dt_s, random);
        }
        let offset = [goal[0] - self.position[0], goal[1] - self.position[1]];
        let distance = libm::hypot(offset[0], offset[1]);
        let bearing = wrapped(libm::atan2(offset[1], offset[0]) - self.course());
        // the circle through the goal that is tangent to the course
        let curvature = if distance > 1e-6 { 2.0 * libm::sin(bearing) / distance } else { 0.0 };
        let wanted_steering = steering_for(curvature) + self.steering_error.value;
        self.steering += (1.0 - libm::exp(-dt_s / STEERING_LAG_S)) * (wanted_steering - self.steering);
        let wanted_speed = wanted_speed * (1.0 + self.speed_error.value).max(0.0);
        self.speed += (1.0 - libm::exp(-dt_s / SPEED_LAG_S)) * (wanted_speed - self.speed);
        if wanted_speed == 0.0 && self.speed < REST_M_PER_S {
            self.speed = 0.0;
        }
        self.roll(dt_s);
    }

    /// The motion at the present steering and speed, second order in the step.
    fn roll(&mut self, dt_s: f64) {
        let beta = slip(self.steering);
        let turn = self.speed * libm::sin(beta) / (0.5 * WHEELBASE_M) * dt_s;
        let course = self.heading + beta + 0.5 * turn;
        self.position[0] += self.speed * dt_s * libm::cos(course);
        self.position[1] += self.speed * dt_s * libm::sin(course);
        self.heading = wrapped(self.heading + turn);
    }
}

/// Angle between heading and course for a steering angle.
fn slip(steering: f64) -> f64 {
    libm::atan(0.5 * libm::tan(steering))
}

/// The steering angle for a curvature of the middle's way, within the limits.
fn steering_for(curvature: f64) -> f64 {
    let sine = (0.5 * WHEELBASE_M * curvature).clamp(-0.99, 0.99);
    libm::atan(2.0 * libm::tan(libm::asin(sine))).clamp(-MAX_STEERING_RAD, MAX_STEERING_RAD)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// No wheel slips sideways: each axle moves the way its wheels point. And the middle turns with the curvature
    /// that the steering was set for.
    #[test]
    fn axles_move_where_their_wheels_point() {
        for curvature in [-6.0, -2.0, 0.0, 1.0, 5.0] {
            let point = CurvePoint { position: [0.3, -0.2], heading: 0.4, curvature };
            let before = Bicycle::new(&point, 0.2);
            let mut after = before;
            let dt = 1e-4;
            after.roll(dt);
            for (axle, steering) in [(-0.5, 0.0), (0.5, before.steering)] {
                let at = |b: &Bicycle| {
                    let arm = axle * WHEELBASE_M;
                    [b.position[0] + arm * b.heading.cos(), b.position[1] + arm * b.heading.sin()]
                };
                let (p, q) = (at(&before), at(&after));
                let wheel = 0.5 * (before.heading + after.heading) + steering;
                let sideways = (q[1] - p[1]) * wheel.cos() - (q[0] - p[0]) * wheel.sin();
                assert!(
                    sideways.abs() < 1e-6 * 0.2 * dt + 1e-12,
                    "axle {axle}, curvature {curvature}: {sideways}"
                );
            }
            let turn = (after.course() - before.course()) / (0.2 * dt);
            assert!((turn - curvature).abs() < 1e-6, "curvature {curvature}: {turn}");
            assert!(wrapped(before.course() - 0.4).abs() < 1e-12);
        }
    }
}
