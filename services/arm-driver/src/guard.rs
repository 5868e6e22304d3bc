//! One turn of the driver's loop, without a clock, a bus or a file: gates, safety chain, limits.

use crate::arm::Reading;
use crate::safety::{Chain, Latch, Look, Verdict, Wish};
use crate::step::{Command, Driver};
use pursuit_messages::{Refusal, SetPoint, Stamp};

/// What stands between set-points and drives.
#[derive(Clone, Debug)]
pub struct Guard {
    driver: Driver,
    chain: Chain,
    /// Epochs are start times: an older one is of a camera that is gone.
    epoch: u64,
}

/// What is there in one turn.
#[derive(Clone, Copy, Debug)]
pub struct Turn<'a> {
    /// Time on the loop's clock, ns.
    pub now_ns: u64,
    /// The newest reading of the drives, where there is one that is not too old.
    pub reading: Option<&'a Reading>,
    /// The newest set-point.
    pub given: Option<(&'a SetPoint, &'a Stamp)>,
    /// The latched stop, if any.
    pub latch: Option<Latch>,
    /// What an operator wants, once for each time that it is wanted.
    pub wish: Option<Wish>,
    /// Whether the set-point may move the arm in this turn.
    pub looks: bool,
    /// Cycles to command in this turn, if any.
    pub cycles: Option<usize>,
}

impl Guard {
    /// One that has seen nothing yet.
    pub fn new(driver: Driver, chain: Chain) -> Guard {
        Guard { driver, chain, epoch: 0 }
    }

    /// The safety chain.
    pub fn chain(&self) -> &Chain {
        &self.chain
    }

    /// The driver ends: nothing is followed any more.
    pub fn end(&mut self) {
        self.chain.end();
    }

    /// The verdict on one turn, and what the drives shall do, if it is time to tell them.
    pub fn turn(&mut self, turn: &Turn<'_>) -> (Verdict, Option<Command>) {
        let Turn { now_ns, reading, given, .. } = *turn;
        self.epoch = self.epoch.max(given.map_or(0, |(_, stamp)| stamp.epoch));
        let judged = match given {
            _ if !turn.looks => None,
            Some((_, stamp)) if self.chain.is_backwards(stamp) => Some(Err(Refusal::Backwards)),
            _ => Some(self.driver.judge(now_ns, self.epoch, given)),
        };
        let verdict = self.chain.look(&Look {
            now_ns,
            reading,
            latch: turn.latch,
            wish: turn.wish,
            frame: given.map(|(_, stamp)| (stamp.epoch, stamp.frame)).filter(|_| turn.looks),
            judged: judged.map(|judged| judged.map(|_| ())),
        });
        let command = reading.zip(turn.cycles).map(|(reading, cycles)| {
            let goal = match (verdict.refusal, judged) {
                (None, Some(Ok(goal))) => Ok(goal),
                (refusal, _) => Err(refusal.unwrap_or(Refusal::Inactive)),
            };
            self.driver.go(now_ns, &reading.drives, goal, cycles)
        });
        (verdict, command)
    }
}
