//! When a service that died is started again. Pure: time comes in, decisions go out.

/// Exit code that says: starting again does not help.
pub use pursuit_runtime::exit::DO_NOT_RESTART;

/// Delay before the second restart in a row, ns; the first comes at once.
const FIRST_DELAY_NS: u64 = 50_000_000;
/// No delay is longer, ns.
const MAX_DELAY_NS: u64 = 5_000_000_000;
/// A service that has run this long is healthy: its past is forgotten, ns.
const HEALTHY_NS: u64 = 10_000_000_000;
/// So many deaths without a healthy time in between, and the service is given up.
const INTENSITY: u32 = 8;

/// What to do about a service that ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Decision {
    /// Start it again at this time, ns.
    StartAt(u64),
    /// Leave it: it dies again and again.
    GiveUp,
}

/// One service's history of deaths.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct History {
    deaths: u32,
}

impl History {
    /// The service that was started at `started_ns` has died at `now_ns`.
    pub fn died(&mut self, started_ns: u64, now_ns: u64) -> Decision {
        if now_ns.saturating_sub(started_ns) >= HEALTHY_NS {
            self.deaths = 0;
        }
        self.deaths += 1;
        if self.deaths >= INTENSITY {
            return Decision::GiveUp;
        }
        let delay_ns = match self.deaths {
            1 => 0,
            n => FIRST_DELAY_NS.saturating_mul(1 << (n - 2).min(20)).min(MAX_DELAY_NS),
        };
        Decision::StartAt(now_ns + delay_ns)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_first_restart_comes_at_once() {
        assert_eq!(History::default().died(0, 500), Decision::StartAt(500));
    }

    #[test]
    fn who_dies_again_and_again_is_given_up() {
        let mut history = History::default();
        let mut now = 0;
        let mut starts = 0;
        while let Decision::StartAt(at) = history.died(now, now + 1) {
            now = at;
            starts += 1;
            assert!(starts <= INTENSITY);
        }
        assert_eq!(starts, INTENSITY - 1);
    }

    #[test]
    fn a_healthy_time_is_a_new_life() {
        let mut history = History::default();
        for _ in 0..100 {
            assert_eq!(history.died(0, HEALTHY_NS), Decision::StartAt(HEALTHY_NS));
        }
    }

    proptest! {
        #[test]
        fn delays_never_shrink_while_it_stays_ill(lives in prop::collection::vec(0..HEALTHY_NS, 1..20)) {
            let (mut history, mut now, mut last) = (History::default(), 0u64, 0u64);
            for life in lives {
                let died = now + life;
                let Decision::StartAt(at) = history.died(now, died) else { break };
                prop_assert!(at >= died);
                prop_assert!(at - died >= last && at - died <= MAX_DELAY_NS);
                last = at - died;
                now = at;
            }
        }
    }
}
