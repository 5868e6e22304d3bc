//! Whether a service that does not beat hangs, or only has no core. Pure: what the kernel says comes in,
//! decisions go out.
//!
//! A beat that does not come proves nothing: a machine with too much to do beats late everywhere. The kernel
//! tells the cases apart. Who waits for a core is *runnable* and does not run: starved, which a kill would only
//! make worse. Who is in its loop wakes up each 10 ms, at any load; who sleeps through many of these has left it
//! for good. Who runs for seconds without a beat is in a loop of its own.

use pursuit_runtime::process::Activity;
use pursuit_runtime::station::BEAT_NS;

/// Without a beat for so long, somebody looks closer, ns.
pub const LATE_NS: u64 = 2 * BEAT_NS;
/// Without a beat for so long, a stopped one is ended, ns: three beats.
const LOST_NS: u64 = 3 * BEAT_NS;
/// Asleep for so long without waking up once, ns: a loop's longest wait is 10 ms.
const ASLEEP_NS: u64 = 300_000_000;
/// So much computing without a beat, ns: no step takes as long, in no build.
const SPUN_NS: u64 = 3_000_000_000;

/// What a service without a beat is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// It beats.
    Beats,
    /// Too early to tell, or it gets no core, or waits for a disk, or is held by a debugger.
    Late,
    /// It will not come back by itself.
    Hangs(Why),
}

/// How a service hangs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Why {
    /// Somebody stopped it (SIGSTOP).
    Stopped,
    /// It sleeps and does not wake up.
    Asleep,
    /// It computes and does not come back to its loop.
    Spinning,
}

impl Why {
    /// What is said about it.
    pub fn text(self) -> &'static str {
        match self {
            Why::Stopped => "it was stopped",
            Why::Asleep => "it slept and did not wake up",
            Why::Spinning => "it computed without an end",
        }
    }
}

/// One process's pulse.
#[derive(Clone, Copy, Debug)]
pub struct Pulse {
    beat_ns: u64,
    /// The first look after the last beat.
    first: Option<Activity>,
    /// Since when it has been seen asleep, and nothing else.
    asleep: Option<(u64, Activity)>,
}

impl Pulse {
    /// A process that was started, or beat, at `now_ns`.
    pub fn beat(now_ns: u64) -> Pulse {
        Pulse { beat_ns: now_ns, first: None, asleep: None }
    }

    /// Whether its last beat is so old that somebody should look closer.
    pub fn is_late(&self, now_ns: u64) -> bool {
        now_ns.saturating_sub(self.beat_ns) >= LATE_NS
    }

    /// What a process that is late is doing.
    pub fn look(&mut self, now_ns: u64, now: &Activity) -> Verdict {
        if !self.is_late(now_ns) {
            return Verdict::Beats;
        }
        let first = *self.first.get_or_insert(*now);
        let same = |before: &Activity| before.turns == now.turns && before.ran_ns == now.ran_ns;
        self.asleep = match self.asleep {
            _ if now.state != 'S' => None,
            Some((since, before)) if same(&before) => Some((since, before)),
            _ => Some((now_ns, *now)),
        };
        if now.state == 'T' && now_ns.saturating_sub(self.beat_ns) >= LOST_NS {
            Verdict::Hangs(Why::Stopped)
        } else if self.asleep.is_some_and(|(since, _)| now_ns - since >= ASLEEP_NS) {
            Verdict::Hangs(Why::Asleep)
        } else if now.ran_ns.saturating_sub(first.ran_ns) >= SPUN_NS {
            Verdict::Hangs(Why::Spinning)
        } else {
            Verdict::Late
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Looks each 20 ms, from the last beat on, for `seconds`; the time of the first verdict that it hangs, ms.
    fn verdict(seconds: u64, activity: impl Fn(u64) -> Activity) -> Option<(u64, Why)> {
        let mut pulse = Pulse::beat(0);
        (0..seconds * 50).find_map(|look| {
            let ms = look * 20;
            match pulse.look(ms * 1_000_000, &activity(ms)) {
                Verdict::Hangs(why) => Some((ms, why)),
                _ => None,
            }
        })
    }

    fn of(state: char, ran_ms: u64, turns: u64) -> Activity {
        Activity { state, ran_ns: ran_ms * 1_000_000, turns }
    }

    #[test]
    fn a_stopped_one_is_found_after_three_beats() {
        assert_eq!(verdict(1, |_| of('T', 5, 3)), Some((160, Why::Stopped)));
    }

    #[test]
    fn one_that_sleeps_for_good_is_found() {
        assert_eq!(verdict(1, |_| of('S', 5, 3)), Some((400, Why::Asleep)));
    }

    #[test]
    fn one_in_an_endless_loop_is_found() {
        assert_eq!(verdict(9, |ms| of('R', ms, 3 + ms / 10)), Some((3100, Why::Spinning)));
    }

    #[test]
    fn one_that_gets_no_core_is_left_alone() {
        assert_eq!(verdict(600, |_| of('R', 5, 3)), None);
        // A slice of a core now and then: it sleeps in between, but it wakes up.
        assert_eq!(verdict(20, |ms| of('S', ms / 10, ms / 280)), None);
    }

    #[test]
    fn waiting_for_a_disk_and_a_debugger_are_no_reason() {
        assert_eq!(verdict(600, |_| of('D', 5, 3)), None);
        assert_eq!(verdict(600, |_| of('t', 5, 3)), None);
    }

    proptest! {
        #[test]
        fn whoever_wakes_up_and_beats_is_never_killed(
            beats in prop::collection::vec((1..10u64, 0..250u64), 1..50),
        ) {
            // Beats come up to 9 periods late, it wakes up at least each 250 ms.
            let (mut now, mut turns, mut ran_ns) = (0, 0, 0);
            for (late, nap_ms) in beats {
                let mut pulse = Pulse::beat(now);
                for look in 0..late * 3 {
                    let at = now + look * 20_000_000;
                    turns += u64::from(nap_ms < 20 || (look * 20) % nap_ms < 20);
                    ran_ns += 1000;
                    let verdict = pulse.look(at, &Activity { state: 'S', ran_ns, turns });
                    prop_assert!(!matches!(verdict, Verdict::Hangs(_)));
                }
                now += late * 60_000_000;
            }
        }
    }
}
