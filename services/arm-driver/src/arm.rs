//! What an arm has to be able to do so that the driver can move it.
//!
//! Small on purpose. The driver has already limited positions, velocities and accelerations; a backend
//! only carries cycles to its drives and readings back. Whatever a backend cannot promise it must say in
//! its error, not hide.

use crate::step::{Command, Drives};
use pursuit_kinematics as kinematics;

/// A simulated or real arm with six position-controlled joints.
pub trait Arm {
    /// What it is. Fixed for the life of the connection.
    fn info(&self) -> &ArmInfo;

    /// Switches the drives on, at rest where they stand. The reading after it must report that position
    /// as issued, with zero velocity.
    ///
    /// # Errors
    /// [`ArmError`] when the drives stay off.
    fn enable(&mut self) -> Result<(), ArmError>;

    /// Brings the arm to rest by the drives' own means, and leaves them holding. Must not depend on any
    /// further command, and must be safe to call at any time, also twice.
    ///
    /// # Errors
    /// [`ArmError::Lost`] when the drives cannot be told; they stop by their own time-out then.
    fn stop(&mut self) -> Result<(), ArmError>;

    /// The newest reading. Does not wait for a future one.
    ///
    /// # Errors
    /// [`ArmError`] when there is none, or the last one is too old to be of use.
    fn state(&mut self) -> Result<Reading, ArmError>;

    /// Hands over the next cycles, each `cycle_ns` long, to follow the ones already accepted.
    ///
    /// The deadline belongs to the command: when `deadline_ns` (on the loop's clock) passes without
    /// another command, the *drives* come to rest by themselves, whatever has become of this process.
    /// A backend whose drives cannot do so must refuse [`Arm::enable`].
    ///
    /// # Errors
    /// [`ArmError::Refused`] when nothing of the command was taken.
    fn command(&mut self, command: &Command, cycle_ns: u64, deadline_ns: u64) -> Result<(), ArmError>;
}

/// What an arm is.
#[derive(Clone, Debug, PartialEq)]
pub struct ArmInfo {
    /// Maker, type and serial number, for the log.
    pub name: String,
    /// Geometry and joint limits.
    pub arm: kinematics::Arm,
    /// Longest time from a missed deadline to the begin of the drives' own stop, ns.
    pub stop_delay_ns: u64,
    /// From a command to the motion of the joints, ns: the learner predicts this far ahead.
    pub latency_ns: u64,
}

/// One reading of the drives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// When the joints were read, on the loop's clock, ns.
    pub time_ns: u64,
    /// Measured and issued joint states.
    pub drives: Drives,
    /// Where the drives were told to be when the joints were read, rad.
    pub demanded: [f64; kinematics::JOINTS],
    /// Whether the drives are on and take commands.
    pub enabled: bool,
    /// Whether the emergency button is pressed; a backend that cannot tell says that it is.
    pub pressed: bool,
}

/// Why an arm does not do what it is told.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ArmError {
    /// No connection, or none any more.
    #[error("the arm does not answer: {reason}")]
    Lost {
        /// What was seen.
        reason: String,
    },
    /// The drives are off.
    #[error("the arm's drives are off: {reason}")]
    Disabled {
        /// What they report.
        reason: String,
    },
    /// The drives did not take the command.
    #[error("the arm refuses the command: {reason}")]
    Refused {
        /// What they report.
        reason: String,
    },
}
