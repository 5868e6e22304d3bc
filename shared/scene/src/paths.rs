//! Where the vehicle goes: a [`Path`] describes it, a [`Vehicle`] moves along it by steps, exactly or as a
//! steered vehicle would. All state is serialisable; what is read back continues to the bit.

mod bicycle;
mod curve;
mod lemniscate;
mod polygon;
mod profile;
mod vehicle;
mod walk;

pub use bicycle::Disturbance;
pub use curve::{Arena, Path, PathError};
pub use profile::SpeedProfile;
pub use vehicle::{Mode, Pose2, Vehicle};
