//! The arm's state, and what brought it there.

use super::table;
use pursuit_messages::{ArmEvent, ArmState};

/// The state machine. It starts unconfigured, whatever was before: a restarted driver moves nothing until it
/// has been activated anew.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Machine {
    state: ArmState,
    cause: ArmEvent,
}

impl Default for Machine {
    fn default() -> Machine {
        Machine { state: ArmState::Unconfigured, cause: ArmEvent::Started }
    }
}

impl Machine {
    /// The state.
    pub fn state(&self) -> ArmState {
        self.state
    }

    /// What brought it there.
    pub fn cause(&self) -> ArmEvent {
        self.cause
    }

    /// Takes in what happened; whether the state changed.
    pub fn take(&mut self, event: ArmEvent) -> bool {
        let Some(state) = table::next(self.state, event) else { return false };
        *self = Machine { state, cause: event };
        true
    }

    /// Whether a set-point may move the arm. In `holding` it may because the first good one ends that state.
    pub fn allows_motion(&self) -> bool {
        matches!(self.state, ArmState::Active | ArmState::Holding)
    }
}
