//! The simulated cell's physics: a six-joint arm with drives, the table, the vehicle as an obstacle.
//!
//! A [`World`] is stepped by hand in simulated time and knows no clock, file or bus. Drive cycles go in
//! with their due times ([`World::accept`]), joint readings come out. It is
//! deterministic (same inputs, same bits) and serialisable as a whole: a restored world continues bit by
//! bit like the one that was saved.
//!
//! rapier computes in f32; everything that is read from here goes through the kinematics in f64.
//! Settings and numbers: the design notes on the simulator, sections 6, 7 and 9.

#![cfg_attr(test, allow(clippy::unwrap_used))]

mod body;
mod cycles;
mod drives;
mod world;

pub use body::VehiclePose;
pub use cycles::{CAPACITY, Cycles, CyclesError, TimedCycle};
pub use drives::{Drive, GRAVITY_M_PER_S2, LinkMass, PUMA_DRIVES, PUMA_MASSES, gravity_torque_nm};
pub use world::{FAST_SUBSTEPS, HARDWARE_SUBSTEPS, STEP_NS, World, WorldError, WorldParameters};

#[cfg(test)]
mod tests;
