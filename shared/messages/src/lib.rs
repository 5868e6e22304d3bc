//! What travels between the processes of `pursuit`: fixed-layout payloads, the [`Stamp`] that every
//! message carries, and [`topics`], which is the wiring of the whole system on one screen.
//!
//! Every type is `repr(C)`, without padding that is read, and carries its version in its type name, so
//! that two processes of different builds refuse each other by name instead of misreading bytes.
//! Angles are radians, lengths metres, times nanoseconds, image coordinates pixels with the origin at
//! the centre of the top-left pixel (u to the right, v down).

pub mod health;
pub mod payload;
pub mod safety;
pub mod stamp;
pub mod topics;
pub mod world;

pub use health::{Health, Lack};
pub use payload::*;
pub use safety::{ArmEvent, ArmState, DriverState};
pub use stamp::{HOPS, ImageShape, Service, Stage, StageStamp, Stamp};
pub use world::*;
