//! All topics, read by looking at them from time to time: nobody wakes the observer, so nobody pays for it.
//!
//! Every topic overflows: an observer that is late, stopped or dead loses messages and delays nobody.

use pursuit_bus::{Bus, BusError, FrameMessage, FrameReader, Reader};
use pursuit_messages::topics::{
    DriverStates, Frames, Healths, JointStates, LearnerStates, SetPoints, Targets, Topic, VoteFields,
    WorldCommands, WorldStates,
};
use pursuit_messages::{
    DriverState, Health, Joints, LearnerState, SetPoint, Stamp, Target, Votes, WorldCommand, WorldState,
};

/// Readers of all topics.
pub struct Ears {
    frames: FrameReader,
    votes: Reader<VoteFields>,
    targets: Reader<Targets>,
    joints: Reader<JointStates>,
    set_points: Reader<SetPoints>,
    learner: Reader<LearnerStates>,
    worlds: Reader<WorldStates>,
    commands: Reader<WorldCommands>,
    driver: Reader<DriverStates>,
    healths: Reader<Healths>,
}

/// A message of any topic, in shared memory.
#[derive(Clone, Copy)]
pub enum Heard<'a> {
    /// FRAMES.
    Frame(&'a FrameMessage),
    /// VOTES.
    Votes(&'a Stamp, &'a Votes),
    /// TARGET.
    Target(&'a Stamp, &'a Target),
    /// JOINTS.
    Joints(&'a Stamp, &'a Joints),
    /// SETPOINT.
    SetPoint(&'a Stamp, &'a SetPoint),
    /// LEARNER_STATE.
    Learner(&'a Stamp, &'a LearnerState),
    /// WORLD_STATE.
    World(&'a Stamp, &'a WorldState),
    /// WORLD_COMMAND.
    Command(&'a Stamp, &'a WorldCommand),
    /// DRIVER_STATE; the stamp may be none of a frame.
    Driver(&'a Stamp, &'a DriverState),
    /// HEALTH; the stamp is none of a frame.
    Health(&'a Stamp, &'a Health),
}

impl Ears {
    /// Joins all topics.
    ///
    /// # Errors
    /// [`BusError::Version`] where a running peer speaks another version of a topic.
    pub fn open(bus: &Bus) -> Result<Ears, BusError> {
        Ok(Ears {
            frames: bus.frame_reader()?,
            votes: bus.reader(VoteFields)?,
            targets: bus.reader(Targets)?,
            joints: bus.reader(JointStates)?,
            set_points: bus.reader(SetPoints)?,
            learner: bus.reader(LearnerStates)?,
            worlds: bus.reader(WorldStates)?,
            commands: bus.reader(WorldCommands)?,
            driver: bus.reader(DriverStates)?,
            healths: bus.reader(Healths)?,
        })
    }

    /// Tells all that came since the last call, topic by topic in the order of a frame's way, each oldest
    /// first; how often a topic could not be read.
    pub fn listen(&self, mut tell: impl FnMut(Heard<'_>)) -> u64 {
        // First, so that a service that was restarted is known before its first answer.
        let mut failures = each(&self.healths, |stamp, health| tell(Heard::Health(stamp, health)));
        // At most what a topic keeps: a writer faster than this reader does not hold it up here.
        for _ in 0..Frames::QUALITY.buffer {
            match self.frames.receive() {
                Ok(Some(frame)) => tell(Heard::Frame(&frame)),
                Ok(None) => break,
                Err(_) => failures += 1,
            }
        }
        failures += each(&self.votes, |stamp, votes| tell(Heard::Votes(stamp, votes)));
        failures += each(&self.targets, |stamp, target| tell(Heard::Target(stamp, target)));
        failures += each(&self.learner, |stamp, state| tell(Heard::Learner(stamp, state)));
        failures += each(&self.set_points, |stamp, set_point| tell(Heard::SetPoint(stamp, set_point)));
        failures += each(&self.commands, |stamp, command| tell(Heard::Command(stamp, command)));
        failures += each(&self.driver, |stamp, state| tell(Heard::Driver(stamp, state)));
        failures += each(&self.joints, |stamp, joints| tell(Heard::Joints(stamp, joints)));
        failures += each(&self.worlds, |stamp, world| tell(Heard::World(stamp, world)));
        failures
    }

    /// Messages refused so far: of another layout, or frames whose header does not fit.
    pub fn refused(&self) -> u64 {
        self.frames.refused()
            + self.votes.refused()
            + self.targets.refused()
            + self.joints.refused()
            + self.set_points.refused()
            + self.learner.refused()
            + self.worlds.refused()
            + self.commands.refused()
            + self.driver.refused()
            + self.healths.refused()
    }
}

/// Tells what waits in one topic; how often it could not be read.
fn each<T: Topic>(reader: &Reader<T>, mut tell: impl FnMut(&Stamp, &T::Payload)) -> u64
where
    T::Payload: pursuit_bus::Payload,
{
    let mut failures = 0;
    for _ in 0..T::QUALITY.buffer {
        match reader.receive() {
            Ok(Some(message)) => tell(message.stamp(), message.payload()),
            Ok(None) => break,
            Err(_) => failures += 1,
        }
    }
    failures
}
