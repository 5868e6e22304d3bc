//! The states and what leads from one to another, as data. What is not in the table changes nothing.

use pursuit_messages::{ArmEvent, ArmState};

use ArmEvent as E;
use ArmState as S;

/// An event that moves the arm's state on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Transition {
    /// What happens.
    pub event: ArmEvent,
    /// In which states it counts.
    pub from: &'static [ArmState],
    /// Where it leads.
    pub to: ArmState,
}

const fn on(event: ArmEvent, from: &'static [ArmState], to: ArmState) -> Transition {
    Transition { event, from, to }
}

/// All transitions. A stronger stop wins over a weaker one and never the other way: fault, emergency stop,
/// protective stop, holding. The three latched states are left by a reset only, and none of them to motion.
pub const TABLE: &[Transition] = &[
    on(E::Configured, &[S::Unconfigured], S::Inactive),
    on(E::Outside, &[S::Inactive], S::Recovery),
    on(E::Inside, &[S::Recovery], S::Inactive),
    on(E::Activated, &[S::Inactive], S::Active),
    on(E::Deactivated, &[S::Active, S::Holding], S::Inactive),
    on(E::SetPointsLost, &[S::Active], S::Holding),
    on(E::HoldAsked, &[S::Active], S::Holding),
    on(E::SetPointsBack, &[S::Holding], S::Active),
    on(E::HoldExpired, &[S::Holding], S::Inactive),
    on(E::BadSetPoints, &[S::Active, S::Holding], S::ProtectiveStop),
    on(E::FollowingError, &[S::Active, S::Holding], S::ProtectiveStop),
    on(E::Outside, &[S::Active, S::Holding], S::ProtectiveStop),
    on(
        E::ProtectiveAsked,
        &[S::Unconfigured, S::Inactive, S::Active, S::Holding, S::Recovery],
        S::ProtectiveStop,
    ),
    on(
        E::EmergencyAsked,
        &[S::Unconfigured, S::Inactive, S::Active, S::Holding, S::Recovery, S::ProtectiveStop],
        S::EmergencyStop,
    ),
    on(
        E::EmergencyPressed,
        &[S::Unconfigured, S::Inactive, S::Active, S::Holding, S::Recovery, S::ProtectiveStop],
        S::EmergencyStop,
    ),
    on(
        E::DriveLost,
        &[S::Inactive, S::Active, S::Holding, S::Recovery, S::ProtectiveStop, S::EmergencyStop],
        S::Fault,
    ),
    on(E::Reset, &[S::ProtectiveStop, S::EmergencyStop], S::Inactive),
    on(E::Reset, &[S::Fault], S::Unconfigured),
];

/// Where `event` leads from `state`; `None` where it changes nothing.
pub fn next(state: ArmState, event: ArmEvent) -> Option<ArmState> {
    TABLE.iter().find(|row| row.event == event && row.from.contains(&state)).map(|row| row.to)
}

/// The table as text: one line for each event that leads somewhere, as ARCHITECTURE.md shows it.
pub fn diagram() -> String {
    let widest = TABLE.iter().map(|row| row.event.word().len()).max().unwrap_or(0);
    let mut text = String::new();
    for row in TABLE {
        let from: Vec<&str> = row.from.iter().map(|state| state.word()).collect();
        text.push_str(&format!("{:<widest$}  {} -> {}\n", row.event.word(), from.join(", "), row.to.word()));
    }
    text
}
