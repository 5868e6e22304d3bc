//! Observer: sees everything, and tells the loop nothing.
//!
//! It looks at all topics from time to time ([`ears`]); nobody wakes it, waits for it or reads what it makes.

#![cfg_attr(test, allow(clippy::unwrap_used))]

pub mod config;
pub mod ears;

use config::Config;
use ears::{Ears, Heard};
use pursuit_runtime::clock::{monotonic_ns, sleep_until_ns};
use pursuit_runtime::{ServiceError, Station};

/// Runs until stopped.
///
/// # Errors
/// [`ServiceError`] for a wrong config or a bus that fails.
pub fn run(mut station: Station) -> Result<(), ServiceError> {
    let config = station.config(Config::read)?;
    let ears = Ears::open(&station.bus)?;
    let look_ns = config.look().as_nanos() as u64;
    let mut failures = 0;
    while station.turn() {
        let begin = monotonic_ns();
        let mut newest = None;
        failures += ears.listen(|heard| {
            if let Heard::Frame(frame) = heard {
                newest = Some(frame.stamp().frame);
            }
        });
        if let Some(frame) = newest {
            station.answered(frame);
        }
        station.health.refused = ears.refused() + failures;
        sleep_until_ns(begin + look_ns);
    }
    Ok(())
}
