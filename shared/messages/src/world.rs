//! What the simulated world, its camera and its drives say to one another.

use crate::payload::{JOINTS, SetPoint};
use iceoryx2::prelude::ZeroCopySend;

/// Most drive cycles one command can cover.
pub const MAX_CYCLES: usize = 32;

/// What lies or drives on the table.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u32)]
pub enum SceneKind {
    /// A white disc on a dark cloth (paper, section 4: training).
    #[default]
    Blob = 0,
    /// The camouflaged vehicle on the cluttered table.
    Vehicle = 1,
}

/// The simulated world at one tick (topic WORLD_STATE): truth for the camera and the evaluation, joint
/// readings for the arm driver's simulated drives. Nothing else may read it.
#[derive(Clone, Copy, Debug, Default, PartialEq, ZeroCopySend)]
#[repr(C)]
#[type_name("pursuit/WorldState/3")]
pub struct WorldState {
    /// Simulated time, ns (lock-step), or CLOCK_MONOTONIC of the tick (wall clock).
    pub time_ns: u64,
    /// 1 where the camera exposes at this tick.
    pub exposes: u32,
    /// 1 where there is a glare on the lens.
    pub glares: u32,
    /// [`SceneKind`] as a number.
    pub scene: u32,
    /// 1 when the run is over.
    pub finished: u32,
    /// Measured joint positions, rad.
    pub position: [f64; JOINTS],
    /// Measured joint velocities, rad/s.
    pub velocity: [f64; JOINTS],
    /// Position of the last command that the drives accepted, rad.
    pub issued_position: [f64; JOINTS],
    /// Velocity of the last command that the drives accepted, rad/s.
    pub issued_velocity: [f64; JOINTS],
    /// Where the drives were told to be when the joints were read, rad.
    pub demanded_position: [f64; JOINTS],
    /// Base from camera, translation, m.
    pub camera_position: [f64; 3],
    /// Base from camera, unit quaternion (x, y, z, w); the camera looks along its +z.
    pub camera_rotation: [f64; 4],
    /// Focal length of the camera, px.
    pub focal_px: f64,
    /// Middle of the glare, pixels (right, down).
    pub glare_px: [f64; 2],
    /// Its radius, px.
    pub glare_radius_px: f64,
    /// Target's position on the table, m.
    pub target_position: [f64; 2],
    /// Target's heading, rad.
    pub target_heading: f64,
    /// Target's velocity, m/s.
    pub target_velocity: [f64; 2],
}

/// One drive cycle of a command: where all joints shall be at its end.
#[derive(Clone, Copy, Debug, Default, PartialEq, ZeroCopySend)]
#[repr(C)]
#[type_name("pursuit/DriveCycle/1")]
pub struct DriveCycle {
    /// Joint positions, rad.
    pub position: [f64; JOINTS],
    /// Joint velocities, rad/s.
    pub velocity: [f64; JOINTS],
}

/// The arm driver's command to the simulated drives (topic WORLD_COMMAND).
#[derive(Clone, Copy, Debug, PartialEq, ZeroCopySend)]
#[repr(C)]
#[type_name("pursuit/WorldCommand/1")]
pub struct WorldCommand {
    /// Cycles used.
    pub cycle_count: u32,
    /// [`Refusal`] as a number, 0 where the set-point is followed.
    pub refusal: u32,
    /// Length of one drive cycle, ns.
    pub cycle_ns: u64,
    /// The set-point behind the command.
    pub set_point: SetPoint,
    /// The cycles, in time order.
    pub cycles: [DriveCycle; MAX_CYCLES],
}

impl Default for WorldCommand {
    fn default() -> WorldCommand {
        WorldCommand {
            cycle_count: 0,
            refusal: 0,
            cycle_ns: 0,
            set_point: SetPoint::default(),
            cycles: [DriveCycle::default(); MAX_CYCLES],
        }
    }
}
