//! What one drive cycle may change: position, velocity and acceleration limits of one joint.
//!
//! A cycle has constant acceleration: from (q, v) to (q', v') with `q' = q + (v + v') / 2 * dt`. A cubic
//! Hermite interpolation between the two is then that same parabola, so what holds at the ends of the
//! cycles holds between them.
//!
//! Braking is counted in whole cycles. From speed `w = n A + rest`, with `A` the largest change of speed
//! in one cycle, the shortest way to rest is `d(w) = dt (n (w - n A / 2) + (w - n A) / 2)`: it is longer
//! than `w^2 / 2a` because the last, partial step takes a whole cycle. The fastest next speed `w` that
//! still stops in time solves `(v + w) / 2 dt + d(w) = distance`, which is piecewise linear and has the
//! closed form in [`Limits::next`] (the discrete time-optimal law, known as Han's `fhan`).

use serde::{Deserialize, Serialize};

/// Acceleration limit of joints 1 and 2, rad/s²: about 14 times what a 0.2 m circle at 0.2 m/s needs
/// and 12 cycles of 10 ms from full speed of joint 2 to rest.
pub const DEFAULT_MAX_ACCELERATION_RAD_PER_S2: f64 = 8.0;

/// Beyond this distance only the speed limit matters; it keeps the arithmetic finite, rad.
const FAR_RAD: f64 = 1e6;

/// Position and velocity of one joint at one time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Motion {
    /// rad.
    pub position: f64,
    /// rad/s.
    pub velocity: f64,
}

/// Limits of one joint for cycles of one length.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Limits {
    position_rad: [f64; 2],
    max_speed_rad_per_s: f64,
    max_acceleration_rad_per_s2: f64,
    cycle_s: f64,
}

/// What the limiter refuses.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum LimitsError {
    /// A limit is not usable.
    #[error(
        "limits must be finite, positive and in order: position {position_rad:?} rad, speed \
         {max_speed_rad_per_s} rad/s, acceleration {max_acceleration_rad_per_s2} rad/s^2, cycle {cycle_s} s"
    )]
    Limits {
        /// Lowest and highest position, rad.
        position_rad: [f64; 2],
        /// Highest speed, rad/s.
        max_speed_rad_per_s: f64,
        /// Highest acceleration, rad/s².
        max_acceleration_rad_per_s2: f64,
        /// Length of a cycle, s.
        cycle_s: f64,
    },
    /// A limit of the tool's speed is not usable.
    #[error("the limit of the tool's speed must be positive, is {max_tool_speed_m_per_s} m/s")]
    ToolSpeed {
        /// Highest speed, m/s.
        max_tool_speed_m_per_s: f64,
    },
    /// The issued state or the goal is not finite.
    #[error("not finite: issued {issued:?}, goal {goal:?}")]
    NotFinite {
        /// The last issued state.
        issued: Motion,
        /// Where it shall go.
        goal: Motion,
    },
}

impl Motion {
    /// At rest at `position` rad.
    pub fn at_rest(position: f64) -> Motion {
        Motion { position, velocity: 0.0 }
    }

    /// Whether both numbers are finite.
    pub fn is_finite(&self) -> bool {
        self.position.is_finite() && self.velocity.is_finite()
    }
}

impl Limits {
    /// Checked limits: position range rad, speed rad/s, acceleration rad/s², length of a cycle s.
    ///
    /// # Errors
    /// [`LimitsError::Limits`] unless all are finite, the range is in order and the rest positive.
    pub fn new(
        position_rad: [f64; 2],
        max_speed_rad_per_s: f64,
        max_acceleration_rad_per_s2: f64,
        cycle_s: f64,
    ) -> Result<Limits, LimitsError> {
        let positive = |value: f64| value > 0.0 && value.is_finite();
        let range = position_rad[1] - position_rad[0];
        if positive(range)
            && positive(max_speed_rad_per_s)
            && positive(max_acceleration_rad_per_s2)
            && positive(cycle_s)
        {
            Ok(Limits { position_rad, max_speed_rad_per_s, max_acceleration_rad_per_s2, cycle_s })
        } else {
            Err(LimitsError::Limits {
                position_rad,
                max_speed_rad_per_s,
                max_acceleration_rad_per_s2,
                cycle_s,
            })
        }
    }

    /// Lowest and highest position, rad.
    pub fn position_rad(&self) -> [f64; 2] {
        self.position_rad
    }

    /// Highest speed, rad/s.
    pub fn max_speed_rad_per_s(&self) -> f64 {
        self.max_speed_rad_per_s
    }

    /// Highest acceleration, rad/s².
    pub fn max_acceleration_rad_per_s2(&self) -> f64 {
        self.max_acceleration_rad_per_s2
    }

    /// Length of a cycle, s.
    pub fn cycle_s(&self) -> f64 {
        self.cycle_s
    }

    /// State to issue at the end of the next cycle, on the fastest way from `issued` to `goal`.
    ///
    /// `goal` is where the joint shall be at the end of that cycle, and how fast it shall move then. A
    /// goal beyond the position or speed limits is followed up to them. Within the limits and able to
    /// stop in time, the joint never leaves the limits again nor overshoots a resting goal (rounding
    /// apart). An issued state outside the limits comes back with the acceleration that is allowed.
    ///
    /// # Errors
    /// [`LimitsError::NotFinite`] when a number is not finite; nothing may be issued then but
    /// [`Limits::brake`].
    pub fn next(&self, issued: Motion, goal: Motion) -> Result<Motion, LimitsError> {
        if !(issued.is_finite() && goal.is_finite()) {
            return Err(LimitsError::NotFinite { issued, goal });
        }
        // In the frame that moves with the goal, the goal rests.
        let goal_velocity = goal.velocity.clamp(-self.max_speed_rad_per_s, self.max_speed_rad_per_s);
        let goal_before = goal.position - goal_velocity * self.cycle_s;
        let wanted = goal_velocity
            + self.fastest_stopping_at(goal_before - issued.position, issued.velocity - goal_velocity);
        let [low, high] = self.position_rad;
        let slowest = self.fastest_stopping_at(low - issued.position, issued.velocity);
        let fastest = self.fastest_stopping_at(high - issued.position, issued.velocity);
        Ok(self.towards(issued, wanted.clamp(slowest, fastest)))
    }

    /// State to issue at the end of the next cycle while braking to rest as fast as allowed. A resting
    /// joint stays where it is, to the bit.
    ///
    /// # Errors
    /// [`LimitsError::NotFinite`] when the issued state is not finite.
    pub fn brake(&self, issued: Motion) -> Result<Motion, LimitsError> {
        if !issued.is_finite() {
            return Err(LimitsError::NotFinite { issued, goal: issued });
        }
        Ok(self.towards(issued, 0.0))
    }

    /// Way to rest from `speed_rad_per_s` in whole cycles, rad.
    pub fn braking_distance_rad(&self, speed_rad_per_s: f64) -> f64 {
        let step = self.speed_step();
        let speed = speed_rad_per_s.abs();
        let whole = (speed / step).floor();
        self.cycle_s * (whole * (speed - whole * step / 2.0) + (speed - whole * step) / 2.0)
    }

    /// Largest change of speed in one cycle, rad/s.
    fn speed_step(&self) -> f64 {
        self.max_acceleration_rad_per_s2 * self.cycle_s
    }

    /// The next velocity from which the joint just stops after `distance_rad` in all, counted from the
    /// start of the cycle with velocity `velocity`; not yet limited. Rises with the distance.
    fn fastest_stopping_at(&self, distance_rad: f64, velocity: f64) -> f64 {
        let rest = (distance_rad - velocity * self.cycle_s / 2.0).clamp(-FAR_RAD, FAR_RAD);
        let step = self.speed_step();
        // rest / (A dt) lies between the n-th and the next triangular number.
        let triangular = rest.abs() / (step * self.cycle_s);
        let whole = (((1.0 + 8.0 * triangular).sqrt() - 1.0) / 2.0).floor();
        let speed = rest.abs() / ((whole + 1.0) * self.cycle_s) + whole * step / 2.0;
        speed.copysign(rest)
    }

    /// The end of the cycle when the velocity goes towards `wanted` rad/s as far as speed and acceleration
    /// limits allow; the position limits are not looked at.
    pub fn towards(&self, issued: Motion, wanted: f64) -> Motion {
        let step = self.speed_step();
        let velocity = wanted
            .clamp(-self.max_speed_rad_per_s, self.max_speed_rad_per_s)
            .clamp(issued.velocity - step, issued.velocity + step);
        let position = issued.position + (issued.velocity + velocity) / 2.0 * self.cycle_s;
        Motion { position, velocity }
    }
}

#[cfg(test)]
mod tests;
