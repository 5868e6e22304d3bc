//! What the cell was some milliseconds ago, for a camera whose clock is off.

use pursuit_messages::payload::JOINTS;
use pursuit_scene::paths::Pose2;
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;

/// Joints and vehicle at one time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Instant {
    /// Measured joint positions, rad.
    pub(crate) position: [f64; JOINTS],
    /// Measured joint velocities, rad/s.
    pub(crate) velocity: [f64; JOINTS],
    /// Where the drives were told to be, rad.
    pub(crate) demanded: [f64; JOINTS],
    pub(crate) vehicle: Pose2,
}

/// The last instants, one for each step of the physics, the newest last.
#[derive(Serialize, Deserialize)]
pub(crate) struct Past(VecDeque<Instant>);

impl Past {
    /// A past of `steps` steps (of either sign) in which nothing moved.
    pub(crate) fn at_rest(now: Instant, steps: i64) -> Past {
        Past(std::iter::repeat_n(now, steps.unsigned_abs() as usize + 1).collect())
    }

    /// A step later it is `now`.
    pub(crate) fn take(&mut self, now: Instant) {
        self.0.pop_front();
        self.0.push_back(now);
    }

    /// What was as many steps ago as it was made for.
    pub(crate) fn oldest(&self) -> Instant {
        self.0[0]
    }
}
