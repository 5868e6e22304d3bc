//! Tells of the arm: DRIVER_STATE, the log, and what JOINTS says of the last set-point.

use crate::arm::Reading;
use crate::safety::{Chain, Verdict};
use pursuit_bus::{BusError, Publisher};
use pursuit_messages::topics::DriverStates;
use pursuit_messages::{DriverState, Joints, Refusal, Stamp};
use pursuit_runtime::clock::monotonic_ns;

/// Without readings the state is told this often, ns.
const PERIOD_NS: u64 = 100_000_000;

/// What is told, and the last of it.
pub struct Reporter {
    states: Publisher<DriverStates>,
    told: DriverState,
    /// Why the last set-point was not followed.
    pub refusal: Option<Refusal>,
}

impl Reporter {
    /// A reporter on that topic.
    pub fn new(states: Publisher<DriverStates>) -> Reporter {
        let told =
            DriverState { pid: std::process::id(), since_ns: monotonic_ns(), ..DriverState::default() };
        Reporter { states, told, refusal: None }
    }

    /// See [`Publisher::greet_new_readers`].
    pub fn greet_new_readers(&self) {
        self.states.greet_new_readers();
    }

    /// What JOINTS says of a reading.
    pub fn joints(&self, reading: &Reading) -> Joints {
        Joints {
            time_ns: reading.time_ns,
            position: reading.drives.position,
            velocity: reading.drives.velocity,
            following: u32::from(self.refusal.is_none()),
            refusal: self.refusal.map_or(0, |refusal| refusal as u32),
        }
    }

    /// Takes in what a look came to, and tells of it where it is new or time.
    ///
    /// # Errors
    /// [`BusError`].
    pub fn take(
        &mut self,
        chain: &Chain,
        verdict: &Verdict,
        fresh: bool,
        world: &Stamp,
    ) -> Result<(), BusError> {
        let now = monotonic_ns();
        let machine = chain.machine();
        if verdict.changed {
            self.told.since_ns = now;
            let (state, cause) = (machine.state(), machine.cause());
            if state.is_latched() {
                tracing::warn!(state = state.word(), cause = cause.text(), "the arm stops");
            } else {
                tracing::info!(state = state.word(), cause = cause.text(), "the arm's state");
            }
        }
        if let Some(answer) = verdict.answer {
            self.told.answered += 1;
            self.told.answer = answer as u32;
            tracing::info!(answer = answer.text(), "an operator's wish");
        }
        let news = verdict.changed || verdict.answer.is_some();
        if news || fresh || now >= self.told.time_ns + PERIOD_NS {
            self.told.at_rest = u32::from(verdict.at_rest);
            self.tell(chain, now, world)?;
        }
        Ok(())
    }

    /// The last word.
    ///
    /// # Errors
    /// [`BusError`].
    pub fn end(&mut self, chain: &Chain) -> Result<(), BusError> {
        self.tell(chain, monotonic_ns(), &Stamp::default())
    }

    fn tell(&mut self, chain: &Chain, now: u64, world: &Stamp) -> Result<(), BusError> {
        self.told.time_ns = now;
        self.told.state = chain.machine().state() as u32;
        self.told.cause = chain.machine().cause() as u32;
        self.told.refusal = self.refusal.map_or(0, |refusal| refusal as u32);
        self.states.publish(world, &self.told)
    }
}
