//! Simulator: stands in for arm, camera stand, table and vehicle, and keeps the clock in lock-step.
//!
//! A frame's way in lock-step: WORLD_STATE n → … the five services … → WORLD_COMMAND n → the drives
//! accept it → the world moves on to exposure n + 1. Where no command comes, the simulator asks again: a
//! service that died answers after its restart, and the run goes on as if nothing had happened.

pub mod cell;
pub mod change;
pub mod config;
pub mod evaluation;
pub mod glare;
pub mod journal;
mod lockstep;
mod past;
pub mod placement;
mod wall;

use config::Config;
use pursuit_runtime::settings::Clock;
use pursuit_runtime::{ServiceError, Station};

/// Runs until stopped, or until the configured number of tracking frames is done.
///
/// # Errors
/// [`ServiceError`] for a wrong config, a bus or a file that fails, or physics that diverges.
pub fn run(mut station: Station) -> Result<(), ServiceError> {
    let config = station.config(Config::read)?;
    if !station.take_over()? {
        return Ok(());
    }
    match config.run.clock {
        Clock::Lockstep => lockstep::run(station, &config),
        Clock::Wall => wall::run(station, &config),
    }
}
