//! Geometry of the arm and its camera, and the limits of its motion: pure functions of joint angles.
//!
//! - [`Arm`]: Denavit-Hartenberg table, joint limits, forward kinematics.
//! - [`Coupling`]: joints 3 to 6 as functions of joints 1 and 2, so that the camera looks straight down
//!   from a constant height (the paper's restriction: two joints are free).
//! - [`Camera`]: pinhole projection, pixels to centred pixels and back.
//! - [`Rig`]: arm and camera as they really are, where that is not what the coupling takes them for.
//! - [`exact_move`]: the exact hand-eye map, the oracle that the learner never sees.
//! - [`limits`]: what one drive cycle may change in position and velocity.
//!
//! Angles are radians, lengths metres, f64 throughout. The base frame lies on the table plane: x ahead,
//! y to the left, z up, its origin on the axis of joint 1. Transforms are named `a_from_b`: they take
//! coordinates in `b` to coordinates in `a`.

#![cfg_attr(test, allow(clippy::unwrap_used))]

pub mod arm;
pub mod camera;
pub mod coupling;
pub mod exact;
pub mod limits;
pub mod rig;

pub use arm::{Arm, JOINTS, Link};
pub use camera::{Camera, CameraPose};
pub use coupling::{Coupling, CouplingError, Envelope};
pub use exact::exact_move;
pub use limits::{Limits, LimitsError, Motion};
pub use rig::Rig;
