//! The one clock between processes.

use rustix::time::{ClockId, clock_gettime};

/// CLOCK_MONOTONIC, ns: common to all processes of one machine.
pub fn monotonic_ns() -> u64 {
    let now = clock_gettime(ClockId::Monotonic);
    now.tv_sec as u64 * 1_000_000_000 + now.tv_nsec as u64
}

/// Sleeps until `deadline_ns` on CLOCK_MONOTONIC; returns at once where it has passed.
pub fn sleep_until_ns(deadline_ns: u64) {
    let now = monotonic_ns();
    if deadline_ns > now {
        std::thread::sleep(std::time::Duration::from_nanos(deadline_ns - now));
    }
}
