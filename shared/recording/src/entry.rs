//! One message of a recording.

use pursuit_messages::topics::{self, Topic as _};
use pursuit_messages::{
    DriverState, Health, Joints, LearnerState, SetPoint, Stamp, Target, Votes, WorldCommand, WorldState,
};

/// A message as it was on the bus, and when it was taken from it.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    /// When the recorder took it, CLOCK_MONOTONIC, ns.
    pub log_ns: u64,
    /// The frame that caused it.
    pub stamp: Stamp,
    /// What it says.
    pub sample: Sample,
}

/// The payload of a message.
#[derive(Clone, Debug, PartialEq)]
pub enum Sample {
    /// Pixels of a frame, row by row, `stamp.image.stride` bytes each.
    Frame(Vec<u8>),
    /// Topic VOTES.
    Votes(Box<Votes>),
    /// Topic TARGET.
    Target(Box<Target>),
    /// Topic JOINTS.
    Joints(Joints),
    /// Topic SETPOINT.
    SetPoint(SetPoint),
    /// Topic LEARNER_STATE.
    Learner(Box<LearnerState>),
    /// Topic WORLD_STATE.
    World(Box<WorldState>),
    /// Topic WORLD_COMMAND.
    Command(Box<WorldCommand>),
    /// Topic DRIVER_STATE.
    Driver(DriverState),
    /// Topic HEALTH.
    Health(Health),
}

/// The topics of a recording that hold exact payloads; frames are an image topic.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Topic {
    /// VOTES.
    Votes,
    /// TARGET.
    Target,
    /// JOINTS.
    Joints,
    /// SETPOINT.
    SetPoint,
    /// LEARNER_STATE.
    Learner,
    /// WORLD_STATE.
    World,
    /// WORLD_COMMAND.
    Command,
    /// DRIVER_STATE.
    Driver,
    /// HEALTH.
    Health,
}

impl Topic {
    /// All of them.
    pub const ALL: [Topic; 9] = [
        Topic::Votes,
        Topic::Target,
        Topic::Joints,
        Topic::SetPoint,
        Topic::Learner,
        Topic::World,
        Topic::Command,
        Topic::Driver,
        Topic::Health,
    ];

    /// Name on the bus, with its version.
    pub const fn bus_name(self) -> &'static str {
        match self {
            Topic::Votes => topics::VoteFields::NAME,
            Topic::Target => topics::Targets::NAME,
            Topic::Joints => topics::JointStates::NAME,
            Topic::SetPoint => topics::SetPoints::NAME,
            Topic::Learner => topics::LearnerStates::NAME,
            Topic::World => topics::WorldStates::NAME,
            Topic::Command => topics::WorldCommands::NAME,
            Topic::Driver => topics::DriverStates::NAME,
            Topic::Health => topics::Healths::NAME,
        }
    }

    /// Name of its schema in a recording.
    pub fn schema(self) -> String {
        format!("pursuit/{}", self.bus_name())
    }

    /// Its name in a recording, without version.
    pub fn path(self) -> String {
        format!("/pursuit/{}", self.bus_name().split('/').next().unwrap_or_default())
    }
}
