//! Times the parts of a step for the pure engine, which knows no clock.

use pursuit_messages::Votes;
use pursuit_motion::{Part, Probe};
use pursuit_runtime::clock::monotonic_ns;

/// Sums of computing time per part, ns.
pub struct Stopwatch {
    last_ns: u64,
    pyramid_ns: u64,
    votes_ns: u64,
    compensation_ns: u64,
    competition_ns: u64,
}

impl Stopwatch {
    /// Starts now.
    pub fn start() -> Stopwatch {
        let last_ns = monotonic_ns();
        Stopwatch { last_ns, pyramid_ns: 0, votes_ns: 0, compensation_ns: 0, competition_ns: 0 }
    }

    /// Notes the parts in the message.
    pub fn write(&self, votes: &mut Votes) {
        votes.pyramid_ns = self.pyramid_ns;
        votes.votes_ns = self.votes_ns;
        votes.compensation_ns = self.compensation_ns;
        votes.competition_ns = self.competition_ns;
    }
}

impl Probe for Stopwatch {
    fn ended(&mut self, part: Part) {
        let now = monotonic_ns();
        let spent = now - self.last_ns;
        self.last_ns = now;
        *match part {
            Part::Pyramid => &mut self.pyramid_ns,
            Part::Votes => &mut self.votes_ns,
            Part::Compensation => &mut self.compensation_ns,
            Part::Competition => &mut self.competition_ns,
        } += spent;
    }
}
