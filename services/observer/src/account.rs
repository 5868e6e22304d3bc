//! Ledger and latency of a running system, from what is heard.

use crate::ears::{Ears, Heard};
use crate::latency::Latency;
use crate::ledger::{Ledger, Sums};
use pursuit_messages::{Health, LearnerState, Service, Stamp, Target};

/// Services there can be, by number.
const SERVICES: usize = 16;

/// The account that is kept of all frames.
#[derive(Debug, Default)]
pub struct Account {
    /// What became of each frame.
    pub ledger: Ledger,
    /// Where their time went.
    pub latency: Latency,
    /// The last sign of life of each service, by number.
    pub healths: [Option<Health>; SERVICES],
    /// Services that were seen to run in another process than before.
    pub restarts: u64,
    /// How often the sums did not agree.
    pub mismatches: u64,
    /// The last answer of segmentation and its frame.
    pub target: Option<(u64, Target)>,
    /// The last state of the learner.
    pub learner: Option<Box<LearnerState>>,
    newest: Option<(u64, u64)>,
    begun: bool,
}

impl Account {
    /// An empty account; for `exposure` see [`crate::latency::Times::of`].
    pub fn new(exposure: bool) -> Account {
        Account { latency: Latency::new(exposure), ..Account::default() }
    }

    /// Listens once; how often a topic could not be read. The first time only says where to begin: what the
    /// topics still keep of the time before is incomplete.
    pub fn listen(&mut self, ears: &Ears) -> u64 {
        self.listen_with(ears, |_| {})
    }

    /// As [`Account::listen`]; `also` hears everything too.
    pub fn listen_with(&mut self, ears: &Ears, mut also: impl FnMut(&Heard<'_>)) -> u64 {
        let failures = ears.listen(|heard| {
            self.take(&heard);
            also(&heard);
        });
        if let Some((epoch, frame)) = self.newest.filter(|_| !self.begun) {
            self.ledger.begin_after(epoch, frame);
            self.begun = true;
        }
        self.mismatches += u64::from(!self.ledger.sums().agree());
        failures
    }

    /// The newest frame heard of: epoch and number.
    pub fn newest(&self) -> Option<(u64, u64)> {
        self.newest
    }

    /// The sums so far.
    pub fn sums(&self) -> Sums {
        self.ledger.sums()
    }

    /// Settles what can be settled, at the end of a measurement.
    pub fn finish(&mut self) {
        let latency = &mut self.latency;
        self.ledger.finish(&mut |journey, fate| latency.take(journey, fate));
    }

    /// Takes in a message.
    pub fn take(&mut self, heard: &Heard<'_>) {
        match heard {
            Heard::Frame(frame) => self.passed(0, frame.stamp(), 0),
            Heard::Votes(stamp, _) => self.passed(1, stamp, 0),
            Heard::Target(stamp, target) => {
                self.target = Some((stamp.frame, **target));
                self.passed(2, stamp, 0);
            }
            Heard::Learner(_, state) => match &mut self.learner {
                Some(kept) => **kept = **state,
                None => self.learner = Some(Box::new(**state)),
            },
            Heard::SetPoint(stamp, _) => self.passed(3, stamp, 0),
            // A command without a set-point behind it answers no frame.
            Heard::Command(stamp, command) if is_answer(stamp) => self.passed(4, stamp, command.refusal),
            Heard::Health(_, health) => self.beat(health),
            _ => {}
        }
    }

    fn passed(&mut self, hop: usize, stamp: &Stamp, refusal: u32) {
        self.newest = self.newest.max(Some((stamp.epoch, stamp.frame)));
        if self.begun {
            let latency = &mut self.latency;
            self.ledger.take(hop, stamp, refusal, &mut |journey, fate| latency.take(journey, fate));
        }
    }

    fn beat(&mut self, health: &Health) {
        let Some(last) = self.healths.get_mut(health.service as usize) else { return };
        let replaced = last.replace(*health).is_some_and(|before| before.pid != health.pid);
        if let Some(service) = Service::from_number(health.service as u16).filter(|_| replaced) {
            self.restarts += 1;
            self.ledger.restarted(service);
        }
    }
}

pub(crate) fn is_answer(stamp: &Stamp) -> bool {
    stamp.passed().iter().any(|stage| stage.service == Service::Learner as u16)
}
