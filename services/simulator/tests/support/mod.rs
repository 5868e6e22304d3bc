//! A simulated cell with somebody who answers its frames.
#![allow(dead_code)]

use pursuit_kinematics::{Arm, Camera, Coupling};
use pursuit_messages::{LearnerState, Phase, SetPoint, WorldCommand, WorldState};
use pursuit_scene::paths::{Mode, Path};
use pursuit_simulator::cell::{Cell, Fixed};
use pursuit_simulator::change::{Change, When};
use pursuit_simulator::config::CellConfig;
use pursuit_simulator::journal::Record;

/// From exposure to exposure, ns.
pub const PERIOD_NS: u64 = 40_000_000;

/// The usual cell.
pub fn cell_config() -> CellConfig {
    CellConfig {
        seed: 3,
        camera: Camera::default_cell(),
        camera_height_m: 0.5,
        frame_period_ns: PERIOD_NS,
        clock_offset_steps: 0,
        latency_ns: 80_000_000,
        substeps: 1,
        frames: 0,
        glare_share: 0.0,
        path: Path::Circle {
            centre: [0.63, 0.0],
            radius_m: 0.2,
            speed_m_per_s: 0.1,
            clockwise: false,
            start_phase_rad: 0.0,
        },
        profile: None,
        mode: Mode::Bicycle(None),
        change: Change { when: When::Never, mount_rad: 0.0, focal_factor: 1.0, forearm_factor: 1.0 },
    }
}

/// The coupling of the usual cell.
pub fn coupling() -> Coupling {
    Coupling::new(&Arm::puma_like(), 0.5).unwrap()
}

/// A command that moves nothing, in that phase.
pub fn in_phase(phase: Phase) -> WorldCommand {
    WorldCommand {
        set_point: SetPoint { phase: phase as u32, ..SetPoint::default() },
        ..WorldCommand::default()
    }
}

/// A command that moves nothing, after so many training moves.
pub fn training(moves: u32) -> WorldCommand {
    let mut command = in_phase(Phase::Training);
    command.set_point.moves = moves;
    command
}

/// A run of a cell.
pub struct Run {
    fixed: Fixed,
    pub cell: Cell,
    pub records: Vec<Record>,
}

impl Run {
    pub fn new(config: &CellConfig) -> Run {
        let fixed = Fixed::new(config).unwrap();
        let cell = Cell::new(&fixed).unwrap();
        Run { fixed, cell, records: Vec::new() }
    }

    /// What camera and drives see now.
    pub fn state(&self) -> WorldState {
        self.cell.state(&self.fixed)
    }

    /// Answers a frame.
    pub fn frame(&mut self, command: &WorldCommand) {
        let learner = LearnerState::default();
        let (record, _) = self.cell.take(&self.fixed, self.cell.frame, command, Some(&learner)).unwrap();
        self.records.push(record);
        self.cell.advance(&self.fixed, self.cell.time_ns + PERIOD_NS).unwrap();
        self.cell.frame += 1;
    }

    /// The cell dies and is restored from what it saved.
    pub fn restart(&mut self) {
        let saved = postcard::to_stdvec(&self.cell).unwrap();
        self.cell = postcard::from_bytes(&saved).unwrap();
    }
}
