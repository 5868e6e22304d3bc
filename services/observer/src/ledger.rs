//! What became of each frame. Pure: messages in, any order, some missing; every frame number of an epoch ends
//! in exactly one state.

use pursuit_messages::{HOPS, Refusal, Service, Stamp};
use std::collections::VecDeque;

const LAST: usize = HOPS.len() - 1;
/// The state of a frame that was not acted on is final when this many newer ones have come.
const SETTLED: u64 = 32;
/// A jump of the frame number that is larger than this is taken for a beginning: nothing is asked of the gap.
const MAX_GAP: u64 = 10_000;

/// Where a frame ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fate {
    /// A command was issued for it.
    Acted,
    /// A newer frame took its place.
    Superseded {
        /// Hop that passed it over, as in [`HOPS`].
        hop: usize,
        /// The newer frame.
        by: u64,
    },
    /// A hop refused it.
    Dropped {
        /// That hop.
        hop: usize,
        /// Its reason as a number: [`pursuit_messages::Refusal`].
        reason: u32,
    },
    /// It never came out of a hop: a crash.
    Lost {
        /// That hop.
        hop: usize,
        /// Whether the hop's process was seen to be replaced meanwhile.
        restarted: bool,
    },
}

/// How many frames ended where.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sums {
    /// Frame numbers that were begun.
    pub captured: u64,
    /// See [`Fate::Acted`].
    pub acted: u64,
    /// See [`Fate::Superseded`].
    pub superseded: u64,
    /// See [`Fate::Dropped`].
    pub dropped: u64,
    /// See [`Fate::Lost`].
    pub lost: u64,
    /// Still on their way.
    pub open: u64,
}

impl Sums {
    /// Whether each frame is in exactly one state.
    pub fn agree(&self) -> bool {
        self.captured == self.acted + self.superseded + self.dropped + self.lost + self.open
    }
}

/// A frame and what is known of it.
#[derive(Clone, Copy, Debug)]
pub struct Journey {
    /// Its stamp with the most stages.
    pub stamp: Stamp,
    /// The hops that sent something of it.
    reached: [bool; HOPS.len()],
    refusal: Option<u32>,
    /// The hop that it had not passed when the hop's process was seen to be replaced, as in [`HOPS`].
    pub restarted_at: Option<usize>,
}

impl Journey {
    /// Whether a command was issued for it; "hold" is one too.
    fn is_acted_on(&self) -> bool {
        self.refusal.is_some_and(|refusal| refusal == 0 || refusal == Refusal::Hold as u32)
    }
}

/// The frames on their way, and the sums.
#[derive(Debug, Default)]
pub struct Ledger {
    /// Without gaps, oldest first, all of one epoch.
    open: VecDeque<Journey>,
    epoch: u64,
    /// Frames before this one are settled, or were there before the ledger was.
    next: Option<u64>,
    sums: Sums,
}

impl Ledger {
    /// Frames up to this one are none of the ledger's: they were on their way when it began.
    pub fn begin_after(&mut self, epoch: u64, frame: u64) {
        (self.epoch, self.next) = (epoch, Some(frame + 1));
    }

    /// Takes in that the hop `hop` sent a message of a frame; `refusal` is the arm driver's, 0 for none.
    /// Frames whose state became final go to `settled`.
    pub fn take(
        &mut self,
        hop: usize,
        stamp: &Stamp,
        refusal: u32,
        settled: &mut impl FnMut(&Journey, Fate),
    ) {
        if stamp.epoch < self.epoch || hop > LAST {
            return;
        }
        if stamp.epoch > self.epoch {
            self.close(settled);
            (self.epoch, self.next) = (stamp.epoch, None);
        }
        let next = *self.next.get_or_insert(stamp.frame);
        let first = next - self.open.len() as u64;
        if stamp.frame < first {
            return;
        }
        if stamp.frame - next.min(stamp.frame) > MAX_GAP {
            self.close(settled);
            self.next = Some(stamp.frame);
        }
        while self.next.is_some_and(|next| next <= stamp.frame) {
            self.begin(stamp);
            self.settle(SETTLED as usize, settled);
        }
        let end = self.next.unwrap_or_default();
        let Some(place) = self.open.len().checked_sub((end - stamp.frame) as usize) else { return };
        let journey = &mut self.open[place];
        if stamp.passed().len() > journey.stamp.passed().len() {
            journey.stamp = *stamp;
        }
        // Who has a message of the learner's knows that vision answered, whether it heard vision or not.
        for (number, service) in HOPS.iter().enumerate() {
            let passed = stamp.passed().iter().any(|stage| stage.service == *service as u16);
            journey.reached[number] |= number == hop || passed;
        }
        if hop == LAST {
            journey.refusal = Some(journey.refusal.map_or(refusal, |before| before.min(refusal)));
        }
        // What was acted on is final at once, in the order of the frames.
        let acted = self.open.iter().take_while(|journey| journey.is_acted_on()).count();
        self.settle(self.open.len() - acted, settled);
    }

    /// Takes in that a service runs in another process than before: what it had taken may be lost.
    pub fn restarted(&mut self, service: Service) {
        let Some(hop) = HOPS.iter().position(|of_hop| *of_hop == service) else { return };
        for journey in self.open.iter_mut().filter(|journey| !journey.reached[hop]) {
            journey.restarted_at = Some(hop);
        }
    }

    /// The sums so far.
    pub fn sums(&self) -> Sums {
        Sums { open: self.open.len() as u64, ..self.sums }
    }

    /// The open frame of that number.
    pub fn find(&self, frame: u64) -> Option<&Journey> {
        self.open.iter().find(|journey| journey.stamp.frame == frame)
    }

    /// Settles all frames that a newer one was acted on after; at the end of a measurement.
    pub fn finish(&mut self, settled: &mut impl FnMut(&Journey, Fate)) {
        let acted = self.open.iter().rposition(|journey| journey.reached[LAST]);
        let keep = acted.map_or(self.open.len(), |place| self.open.len() - 1 - place);
        self.settle(keep, settled);
    }

    fn begin(&mut self, stamp: &Stamp) {
        let Some(frame) = self.next else { return };
        let stamp = Stamp::new(
            self.epoch,
            frame,
            if frame == stamp.frame { stamp.exposure_ns } else { 0 },
            stamp.image,
        );
        self.open.push_back(Journey {
            stamp,
            reached: [false; HOPS.len()],
            refusal: None,
            restarted_at: None,
        });
        self.next = Some(frame + 1);
        self.sums.captured += 1;
    }

    fn close(&mut self, settled: &mut impl FnMut(&Journey, Fate)) {
        self.settle(0, settled);
    }

    fn settle(&mut self, keep: usize, settled: &mut impl FnMut(&Journey, Fate)) {
        while self.open.len() > keep {
            let Some(journey) = self.open.pop_front() else { return };
            let fate = self.fate(&journey);
            match fate {
                Fate::Acted => self.sums.acted += 1,
                Fate::Superseded { .. } => self.sums.superseded += 1,
                Fate::Dropped { .. } => self.sums.dropped += 1,
                Fate::Lost { .. } => self.sums.lost += 1,
            }
            settled(&journey, fate);
        }
    }

    fn fate(&self, journey: &Journey) -> Fate {
        match journey.refusal {
            _ if journey.is_acted_on() => return Fate::Acted,
            Some(reason) => return Fate::Dropped { hop: LAST, reason },
            None => {}
        }
        let hop = journey.reached.iter().position(|reached| !reached).unwrap_or(LAST);
        let by = self.open.iter().find(|newer| newer.reached[hop]).map(|newer| newer.stamp.frame);
        match by {
            _ if journey.restarted_at == Some(hop) => Fate::Lost { hop, restarted: true },
            Some(by) => Fate::Superseded { hop, by },
            None => Fate::Lost { hop, restarted: false },
        }
    }
}

#[cfg(test)]
#[path = "ledger_tests.rs"]
mod tests;
