//! When a service that died is started again. Pure: time comes in, decisions go out.

/// Exit code that says: starting again does not help.
pub use pursuit_runtime::exit::DO_NOT_RESTART;

/// Delay before the second restart in a row, ns; the first comes at once, each further one takes twice as long.
const FIRST_DELAY_NS: f64 = 100e6;
/// Delays are longer by up to this share, so that what died together does not start together.
const JITTER: f64 = 0.25;
/// So many deaths within [`WINDOW_NS`], and the service is given up.
pub const INTENSITY: usize = 5;
/// See [`INTENSITY`].
pub const WINDOW_NS: u64 = 10_000_000_000;
/// So much life makes one death forgotten, ns: who dies more rarely than this is started at once every time, who dies
/// more often waits longer and longer, and is given up.
const FORGIVEN_NS: f64 = (WINDOW_NS / (INTENSITY as u64 - 1)) as f64;
/// From so many deaths on that are not forgotten there is a delay.
const FREE_DEATHS: f64 = 1.9;

/// What to do about a service that ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Decision {
    /// Start it again at this time, ns.
    StartAt(u64),
    /// Leave it: it dies again and again.
    GiveUp,
}

/// One service's history of deaths.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct History {
    /// Deaths that life since then has not made forgotten.
    unforgotten: f64,
    /// Times of the last deaths, newest first, ns.
    last: [Option<u64>; INTENSITY],
}

impl History {
    /// The service that was started at `started_ns` has died at `now_ns`; `jitter` in [0, 1).
    pub fn died(&mut self, started_ns: u64, now_ns: u64, jitter: f64) -> Decision {
        let life_ns = now_ns.saturating_sub(started_ns) as f64;
        self.unforgotten = (self.unforgotten - life_ns / FORGIVEN_NS).max(0.0) + 1.0;
        self.last.rotate_right(1);
        self.last[0] = Some(now_ns);
        if self.last[INTENSITY - 1].is_some_and(|first| now_ns.saturating_sub(first) < WINDOW_NS) {
            return Decision::GiveUp;
        }
        if self.unforgotten < FREE_DEATHS {
            return Decision::StartAt(now_ns);
        }
        let delay_ns = FIRST_DELAY_NS * (self.unforgotten - 2.0).exp2();
        Decision::StartAt(now_ns + (delay_ns * (1.0 + JITTER * jitter)) as u64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// One that dies `life_ns` after each start, for ever; when it was started.
    fn starts(life_ns: u64, limit_ns: u64) -> (Vec<u64>, bool) {
        let (mut history, mut now, mut starts) = (History::default(), 0, vec![0]);
        while now < limit_ns {
            match history.died(now, now + life_ns, 0.0) {
                Decision::StartAt(at) => now = at,
                Decision::GiveUp => return (starts, true),
            }
            starts.push(now);
        }
        (starts, false)
    }

    #[test]
    fn the_first_restart_comes_at_once_and_the_next_ones_later_and_later() {
        let (starts, given_up) = starts(1_000_000, u64::MAX);
        let delays: Vec<u64> = starts.windows(2).map(|pair| (pair[1] - pair[0]) / 10_000_000).collect();
        assert_eq!(delays, [0, 10, 20, 40]);
        assert!(given_up);
    }

    #[test]
    fn who_dies_more_rarely_than_the_intensity_is_started_at_once_for_ever() {
        let (always, given_up) = starts(2_500_000_000, 1_000_000_000_000);
        assert!(!given_up && always.windows(2).all(|pair| pair[1] - pair[0] == 2_500_000_000));
        let (_, given_up) = starts(2_400_000_000, 1_000_000_000_000);
        assert!(given_up);
    }

    proptest! {
        #[test]
        fn never_more_starts_than_the_intensity(
            lives in prop::collection::vec((0..12_000_000_000u64, 0.0..1.0), 1..60),
        ) {
            let (mut history, mut now, mut starts) = (History::default(), 0u64, vec![0u64]);
            for (life, jitter) in lives {
                match history.died(now, now + life, jitter) {
                    Decision::StartAt(at) => now = at,
                    Decision::GiveUp => break,
                }
                starts.push(now);
                // The first start is nobody's death.
                let recent = starts[1..].iter().filter(|at| now - **at < WINDOW_NS).count();
                prop_assert!(recent <= INTENSITY);
            }
        }

        #[test]
        fn delays_never_shrink_while_it_stays_ill(
            lives in prop::collection::vec(0..FORGIVEN_NS as u64, 1..40),
        ) {
            let (mut history, mut now, mut last) = (History::default(), 0u64, 0u64);
            for life in lives {
                let died = now + life;
                let Decision::StartAt(at) = history.died(now, died, 0.0) else { break };
                prop_assert!(at >= died && at - died >= last);
                last = at - died;
                now = at;
            }
        }
    }
}
