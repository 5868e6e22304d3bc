//! What every service process shares: start-up, taking over, stop, clock, heartbeat, logs, checkpoints,
//! exit codes.
//!
//! Only this crate reads a clock. A service's loop looks like this:
//!
//! ```text
//! if !station.take_over()? { return Ok(()) }   // waits until the process before this one has left
//! while station.turn() {                       // beats, and ends on a stop
//!     pursuit_bus::wait(&[&input], station::TICK)?;
//!     while let Some(message) = input.receive()? { … one pure step … output.publish(…)? }
//! }
//! ```

pub mod checkpoint;
pub mod clock;
pub mod exit;
pub mod latch;
pub mod logging;
pub mod place;
pub mod process;
pub mod settings;
pub mod station;
pub mod systemd;

pub use station::{ServiceError, Station, TICK};
