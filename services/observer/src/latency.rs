//! Where the time of each frame went. Pure: settled frames in, waiting and computing per hop out.

use crate::histogram::Histogram;
use crate::ledger::{Fate, Journey};
use pursuit_messages::{HOPS, Stamp};
use std::collections::VecDeque;

/// Frames that are remembered one by one.
pub const REMEMBERED: usize = 2048;
/// Worst frames that are told.
pub const WORST: usize = 10;

/// Times of one frame that was acted on, ns, per hop as in [`HOPS`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Times {
    /// From the hop before (the first: from the exposure) until it was taken.
    pub wait_ns: [u64; HOPS.len()],
    /// From being taken until the answer was handed over.
    pub compute_ns: [u64; HOPS.len()],
    /// From the exposure to the command.
    pub end_to_end_ns: u64,
}

impl Times {
    /// The times in a stamp that passed all hops. `exposure` says whether the exposure is on the clock of the
    /// stages: in lock-step it is simulated time, and the way begins with acquisition.
    pub fn of(stamp: &Stamp, exposure: bool) -> Option<Times> {
        let mut times = Times::default();
        let mut before = if exposure { Some(stamp.exposure_ns) } else { None };
        let mut start = before;
        for (hop, service) in HOPS.iter().enumerate() {
            let stage = stamp.passed().iter().find(|stage| stage.service == *service as u16)?;
            start = start.or(Some(stage.begin_ns));
            times.wait_ns[hop] = stage.begin_ns.saturating_sub(before.unwrap_or(stage.begin_ns));
            times.compute_ns[hop] = stage.end_ns.saturating_sub(stage.begin_ns);
            before = Some(stage.end_ns);
        }
        times.end_to_end_ns = before?.saturating_sub(start?);
        Some(times)
    }

    /// All parts: waiting and computing of each hop, ns.
    pub fn parts(&self) -> [(usize, bool, u64); 2 * HOPS.len()] {
        core::array::from_fn(|k| {
            let (hop, waits) = (k / 2, k % 2 == 0);
            (hop, waits, if waits { self.wait_ns[hop] } else { self.compute_ns[hop] })
        })
    }
}

/// A frame that is remembered.
#[derive(Clone, Copy, Debug)]
pub struct Told {
    /// Its stamp.
    pub stamp: Stamp,
    /// What became of it.
    pub fate: Fate,
    /// Its times, where it was acted on.
    pub times: Option<Times>,
    /// See [`Journey::restarted_at`].
    pub restarted_at: Option<usize>,
}

/// All histograms, and the last frames.
#[derive(Debug, Default)]
pub struct Latency {
    /// Waiting before each hop.
    pub wait: [Histogram; HOPS.len()],
    /// Computing of each hop.
    pub compute: [Histogram; HOPS.len()],
    /// From the exposure to the command.
    pub end_to_end: Histogram,
    /// The last frames, oldest first.
    pub frames: VecDeque<Told>,
    exposure: bool,
}

impl Latency {
    /// Nothing measured yet; for `exposure` see [`Times::of`].
    pub fn new(exposure: bool) -> Latency {
        Latency { exposure, ..Latency::default() }
    }

    /// Takes in a frame whose state is final.
    pub fn take(&mut self, journey: &Journey, fate: Fate) {
        let times = (fate == Fate::Acted).then(|| Times::of(&journey.stamp, self.exposure)).flatten();
        if let Some(times) = &times {
            for hop in 0..HOPS.len() {
                self.wait[hop].take(times.wait_ns[hop]);
                self.compute[hop].take(times.compute_ns[hop]);
            }
            self.end_to_end.take(times.end_to_end_ns);
        }
        if self.frames.len() == REMEMBERED {
            self.frames.pop_front();
        }
        self.frames.push_back(Told { stamp: journey.stamp, fate, times, restarted_at: journey.restarted_at });
    }

    /// The hop, and whether its waiting (else computing), that makes the slow tenth of the frames slow: where
    /// they are furthest above its median in sum.
    pub fn dominant(&self) -> Option<(usize, bool)> {
        let slow = self.end_to_end.quantile_ns(0.9);
        let mut excess = [0_u64; 2 * HOPS.len()];
        let slow_times = self.frames.iter().filter_map(|told| told.times).filter(|t| t.end_to_end_ns >= slow);
        for times in slow_times {
            for (sum, (hop, waits, ns)) in excess.iter_mut().zip(times.parts()) {
                *sum += ns.saturating_sub(self.median_ns(hop, waits));
            }
        }
        let worst = (0..excess.len()).max_by_key(|part| excess[*part])?;
        (excess[worst] > 0).then_some((worst / 2, worst % 2 == 0))
    }

    /// The worst frames: up to half of them the newest that were lost or dropped, then the slowest.
    pub fn worst(&self) -> Vec<Told> {
        let gone = |told: &&Told| matches!(told.fate, Fate::Lost { .. } | Fate::Dropped { .. });
        let mut worst: Vec<Told> = self.frames.iter().rev().filter(gone).take(WORST / 2).copied().collect();
        let mut slow: Vec<Told> = self.frames.iter().filter(|told| told.times.is_some()).copied().collect();
        slow.sort_by_key(|told| core::cmp::Reverse(told.times.map_or(0, |times| times.end_to_end_ns)));
        worst.extend(slow.into_iter().take(WORST - worst.len()));
        worst
    }

    /// A sentence: why a frame is among the worst.
    pub fn reason(&self, told: &Told) -> String {
        match (told.fate, told.times) {
            (Fate::Lost { hop, restarted: true }, _) => {
                format!("lost when {} was restarted", HOPS[hop].name())
            }
            (Fate::Lost { hop, .. }, _) => format!("never came out of {}", HOPS[hop].name()),
            (Fate::Superseded { hop, by }, _) => format!("{} took frame {by} instead", HOPS[hop].name()),
            (Fate::Dropped { hop, reason }, _) => {
                format!("{} refused it (reason {reason})", HOPS[hop].name())
            }
            (Fate::Acted, Some(_)) if told.restarted_at.is_some() => {
                let hop = told.restarted_at.unwrap_or_default();
                format!("{} was restarted meanwhile", HOPS[hop].name())
            }
            (Fate::Acted, None) => "its times are not known".to_owned(),
            (Fate::Acted, Some(times)) => {
                let late =
                    |(hop, waits, ns): &(usize, bool, u64)| ns.saturating_sub(self.median_ns(*hop, *waits));
                let parts = times.parts();
                let worst = parts.iter().max_by_key(|part| late(part)).unwrap_or(&parts[0]);
                let what = if worst.1 { "waited for" } else { "computed in" };
                format!("{what} {}, {:.2} ms more than usual", HOPS[worst.0].name(), late(worst) as f64 / 1e6)
            }
        }
    }

    fn median_ns(&self, hop: usize, waits: bool) -> u64 {
        if waits { self.wait[hop].quantile_ns(0.5) } else { self.compute[hop].quantile_ns(0.5) }
    }
}
