//! Times the parts of a step for the pure engine, which knows no clock.

use pursuit_motion::{Part, Probe};
use pursuit_runtime::clock::monotonic_ns;

/// Sums of computing time per part, ns.
pub struct Stopwatch {
    last_ns: u64,
    pyramid_ns: u64,
    votes_ns: u64,
    compensation_ns: u64,
}

impl Stopwatch {
    /// Starts now.
    pub fn start() -> Stopwatch {
        Stopwatch { last_ns: monotonic_ns(), pyramid_ns: 0, votes_ns: 0, compensation_ns: 0 }
    }

    /// Pyramid, votes, compensation; ns.
    pub fn parts(&self) -> (u64, u64, u64) {
        (self.pyramid_ns, self.votes_ns, self.compensation_ns)
    }
}

impl Probe for Stopwatch {
    fn ended(&mut self, part: Part) {
        let now = monotonic_ns();
        let spent = now - self.last_ns;
        self.last_ns = now;
        match part {
            Part::Pyramid => self.pyramid_ns += spent,
            Part::Votes => self.votes_ns += spent,
            Part::Compensation => self.compensation_ns += spent,
            Part::Competition => self.votes_ns += spent,
        }
    }
}
