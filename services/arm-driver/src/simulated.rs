//! The simulated arm: its drives are in the simulator, its cable is the bus.

use crate::arm::{Arm, ArmError, ArmInfo, Reading};
use crate::step::{Command, Drives};
use pursuit_bus::{Bus, BusError, Publisher, Subscriber, Wakes};
use pursuit_kinematics as kinematics;
use pursuit_messages::topics::{WorldCommands, WorldStates};
use pursuit_messages::{SetPoint, Stamp, WorldState};

/// The drives stop by themselves when no cycle follows the last one.
const STOP_DELAY_NS: u64 = 0;

/// A connection to the simulated drives.
pub struct SimulatedArm {
    info: ArmInfo,
    worlds: Subscriber<WorldStates>,
    commands: Publisher<WorldCommands>,
    newest: Option<(Stamp, WorldState)>,
    /// What the next command answers.
    cause: (Stamp, SetPoint),
    awaits: bool,
}

impl SimulatedArm {
    /// Connects over the bus.
    ///
    /// # Errors
    /// [`BusError`].
    pub fn connect(bus: &Bus, arm: &kinematics::Arm) -> Result<SimulatedArm, BusError> {
        Ok(SimulatedArm {
            info: ArmInfo {
                name: "simulated PUMA-class arm".to_owned(),
                arm: *arm,
                stop_delay_ns: STOP_DELAY_NS,
                latency_ns: 0,
            },
            worlds: bus.subscriber(WorldStates)?,
            commands: bus.publisher(WorldCommands)?,
            newest: None,
            cause: (Stamp::default(), SetPoint::default()),
            awaits: false,
        })
    }

    /// What wakes the driver when there is a new reading.
    pub fn wakes(&self) -> &dyn Wakes {
        &self.worlds
    }

    /// See [`Publisher::greet_new_readers`].
    pub fn greet_new_readers(&self) {
        self.commands.greet_new_readers();
    }

    /// Takes the newest reading in; whether there was one. A reading that comes again asks for its answer
    /// again.
    ///
    /// # Errors
    /// [`BusError`].
    pub fn refresh(&mut self) -> Result<bool, BusError> {
        let Some((message, _)) = self.worlds.newest()? else { return Ok(false) };
        self.newest = Some((*message.stamp(), *message.payload()));
        self.awaits = true;
        Ok(true)
    }

    /// The frame of the newest reading.
    pub fn stamp(&self) -> &Stamp {
        self.newest.as_ref().map_or(&self.cause.0, |(stamp, _)| stamp)
    }

    /// Whether the newest reading has not been answered yet.
    pub fn awaits_answer(&self) -> bool {
        self.awaits
    }

    /// Says what the next command answers.
    pub fn answering(&mut self, stamp: Stamp, set_point: SetPoint) {
        self.cause = (stamp, set_point);
    }
}

impl Arm for SimulatedArm {
    fn info(&self) -> &ArmInfo {
        &self.info
    }

    fn enable(&mut self) -> Result<(), ArmError> {
        Ok(())
    }

    fn stop(&mut self) -> Result<(), ArmError> {
        // No further cycle: the drives come to rest by themselves.
        Ok(())
    }

    fn state(&mut self) -> Result<Reading, ArmError> {
        let (_, world) =
            self.newest.as_ref().ok_or_else(|| ArmError::Lost { reason: "no reading yet".to_owned() })?;
        Ok(Reading {
            time_ns: world.time_ns,
            drives: Drives {
                position: world.position,
                velocity: world.velocity,
                issued_position: world.issued_position,
                issued_velocity: world.issued_velocity,
            },
            demanded: world.demanded_position,
            enabled: true,
            // The simulated cell has no button; `pursuit stop` is one.
            pressed: false,
        })
    }

    fn command(&mut self, command: &Command, cycle_ns: u64, _deadline_ns: u64) -> Result<(), ArmError> {
        let (stamp, set_point) = self.cause;
        self.awaits = false;
        self.commands
            .publish(&stamp, &command.message(cycle_ns, set_point))
            .map_err(|error| ArmError::Lost { reason: error.to_string() })
    }
}
