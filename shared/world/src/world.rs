//! The world: parameters, stepping, readings.

use crate::body::{Bodies, Build, VehiclePose};
use crate::cycles::{Cycles, CyclesError, TimedCycle};
use crate::drives::{Drive, LinkMass, PUMA_DRIVES, PUMA_MASSES, gravity_torque_nm};
use pursuit_kinematics::{Arm, Coupling, CouplingError, JOINTS};
use serde::{Deserialize, Serialize};

/// Length of a step, ns: at 1 ms the arm is within 0.1 mm rms of a reference at 0.1 ms.
pub const STEP_NS: u64 = 1_000_000;
/// Substeps of the fast profile, for lock-step and tests.
pub const FAST_SUBSTEPS: usize = 1;
/// Substeps that come closest to hardware; more bring nothing.
pub const HARDWARE_SUBSTEPS: usize = 4;

/// What the world is made of.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct WorldParameters {
    /// The arm as it really is: it may differ from the nominal one of the arm driver.
    pub arm: Arm,
    /// Masses of its links.
    pub masses: [LinkMass; JOINTS],
    /// Its drives.
    pub drives: [Drive; JOINTS],
    /// Where its joints stand at the start, rad.
    pub start_rad: [f64; JOINTS],
    /// Length of a step, ns.
    pub step_ns: u64,
    /// Substeps of a step: [`FAST_SUBSTEPS`] or [`HARDWARE_SUBSTEPS`].
    pub substeps: usize,
}

/// Why the world does not go on.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum WorldError {
    /// The parameters make no world.
    #[error("world parameters: {0}")]
    Parameters(&'static str),
    /// The start pose does not exist.
    #[error("no start pose at theta {theta_rad:?} rad")]
    Start {
        /// Wanted joints 1 and 2, rad.
        theta_rad: [f64; 2],
    },
    /// The arm cannot be coupled.
    #[error("the arm cannot keep its camera vertical")]
    Coupling(#[from] CouplingError),
    /// The drives refuse a command.
    #[error("the drives refuse the command")]
    Refused(#[from] CyclesError),
    /// The physics has left the finite numbers; the world is of no use any more.
    #[error("the simulated arm is not finite at {time_ns} ns")]
    Diverged {
        /// Simulated time, ns.
        time_ns: u64,
    },
    /// The vehicle's pose is not finite.
    #[error("the vehicle's pose is not finite at {time_ns} ns")]
    Vehicle {
        /// Simulated time, ns.
        time_ns: u64,
    },
}

/// The simulated cell. Serialise it whole to save it.
#[derive(Serialize, Deserialize)]
pub struct World {
    parameters: WorldParameters,
    bodies: Bodies,
    cycles: Cycles,
    time_ns: u64,
}

impl WorldParameters {
    /// The default arm with its camera `camera_height_m` above the table and joints 1 and 2 at
    /// `theta_rad`, the others coupled; the fast profile.
    ///
    /// # Errors
    /// [`WorldError::Coupling`], [`WorldError::Start`] where there is no such pose.
    pub fn starting_at(theta_rad: [f64; 2], camera_height_m: f64) -> Result<WorldParameters, WorldError> {
        let arm = Arm::puma_like();
        let coupling = Coupling::new(&arm, camera_height_m)?;
        let start_rad = coupling.joints(theta_rad[0], theta_rad[1]).ok_or(WorldError::Start { theta_rad })?;
        Ok(WorldParameters {
            arm,
            masses: PUMA_MASSES,
            drives: PUMA_DRIVES,
            start_rad,
            step_ns: STEP_NS,
            substeps: FAST_SUBSTEPS,
        })
    }

    fn check(&self) -> Result<(), WorldError> {
        let refused = |why| Err(WorldError::Parameters(why));
        if self.step_ns == 0 || self.substeps == 0 {
            return refused("step and substeps must be positive");
        }
        if !self.arm.within_limits(&self.start_rad) {
            return refused("the start pose is outside the joints' position limits");
        }
        let driven = self.drives.iter().all(|drive| {
            let positive = [
                drive.armature_kg_m2,
                drive.max_torque_nm,
                drive.stiffness_nm_per_rad,
                drive.damping_nm_s_per_rad,
                drive.stop_rad_per_s2,
            ];
            let friction = [drive.viscous_nm_s_per_rad, drive.coulomb_nm];
            positive.iter().all(|value| *value > 0.0 && value.is_finite())
                && friction.iter().all(|value| *value >= 0.0 && value.is_finite())
        });
        let heavy = self.masses.iter().all(|mass| {
            let positive = [mass.mass_kg].into_iter().chain(mass.inertia_kg_m2);
            positive.into_iter().all(|value| value > 0.0 && value.is_finite())
                && mass.centre_m.iter().all(|value| value.is_finite())
        });
        if driven && heavy { Ok(()) } else { refused("masses and drives must be finite and positive") }
    }
}

impl World {
    /// The world at time 0, everything at rest.
    ///
    /// # Errors
    /// [`WorldError::Parameters`].
    pub fn new(parameters: &WorldParameters) -> Result<World, WorldError> {
        parameters.check()?;
        let bodies = Bodies::new(&Build {
            arm: &parameters.arm,
            masses: &parameters.masses,
            drives: &parameters.drives,
            start_rad: &parameters.start_rad,
            step_s: parameters.step_ns as f64 * 1e-9,
            substeps: parameters.substeps,
        });
        let stops = parameters.drives.map(|drive| drive.stop_rad_per_s2);
        let cycles = Cycles::at_rest(parameters.start_rad, stops);
        Ok(World { parameters: parameters.clone(), bodies, cycles, time_ns: 0 })
    }

    /// Gives the drives more cycles, after those that they have. Due times count in simulated time.
    ///
    /// # Errors
    /// [`WorldError::Refused`]; nothing of the command is taken then.
    pub fn accept(&mut self, commands: &[TimedCycle]) -> Result<(), WorldError> {
        Ok(self.cycles.accept(self.time_ns, commands)?)
    }

    /// Steps on as long as a whole step ends at or before `time_ns`. `vehicle` says where the vehicle is
    /// at the time it is asked for, the end of each step, ns.
    ///
    /// # Errors
    /// [`WorldError::Diverged`], [`WorldError::Vehicle`]; the world must not be used any more.
    pub fn step_until(
        &mut self,
        time_ns: u64,
        mut vehicle: impl FnMut(u64) -> VehiclePose,
    ) -> Result<(), WorldError> {
        while self.time_ns + self.parameters.step_ns <= time_ns {
            self.step(vehicle(self.time_ns + self.parameters.step_ns))?;
        }
        Ok(())
    }

    fn step(&mut self, vehicle: VehiclePose) -> Result<(), WorldError> {
        if ![vehicle.x_m, vehicle.y_m, vehicle.heading_rad].iter().all(|value| value.is_finite()) {
            return Err(WorldError::Vehicle { time_ns: self.time_ns });
        }
        let WorldParameters { arm, masses, drives, step_ns, substeps, .. } = &self.parameters;
        self.cycles.begin_step(self.time_ns);
        // rapier takes the target as that of the start of each substep and moves it with its velocity;
        // it is set once, so its mean over the substeps is given.
        let lead_ns = step_ns * (*substeps as u64 - 1) / (2 * *substeps as u64);
        let (position, velocity) = self.cycles.at(self.time_ns + lead_ns);
        let feed_forward = gravity_torque_nm(arm, masses, &self.bodies.joint_state().0);
        self.bodies.drive(drives, &position, &velocity, &feed_forward);
        self.bodies.place_vehicle(&vehicle);
        let sound = self.bodies.step();
        self.time_ns += step_ns;
        self.cycles.end_step(self.time_ns);
        let (position, velocity) = self.bodies.joint_state();
        if sound && position.iter().chain(&velocity).all(|value| value.is_finite()) {
            Ok(())
        } else {
            Err(WorldError::Diverged { time_ns: self.time_ns })
        }
    }

    /// What the world is made of.
    pub fn parameters(&self) -> &WorldParameters {
        &self.parameters
    }

    /// Simulated time, ns.
    pub fn time_ns(&self) -> u64 {
        self.time_ns
    }

    /// Measured joint positions, rad.
    pub fn positions(&self) -> [f64; JOINTS] {
        self.bodies.joint_state().0
    }

    /// Measured joint velocities, rad/s.
    pub fn velocities(&self) -> [f64; JOINTS] {
        self.bodies.joint_state().1
    }

    /// The last cycle that the drives accepted, due or not, or their own stop if they made one since:
    /// a driver without memory continues from here.
    pub fn issued(&self) -> &TimedCycle {
        self.cycles.last()
    }

    /// Set-point of the drives now: joint positions, rad, and velocities, rad/s.
    pub fn set_point(&self) -> ([f64; JOINTS], [f64; JOINTS]) {
        self.cycles.at(self.time_ns)
    }

    /// How many cycles are not due yet.
    pub fn waiting(&self) -> usize {
        self.cycles.waiting()
    }

    /// Whether the arm touches the table or the vehicle.
    pub fn touching(&self) -> bool {
        self.bodies.touching()
    }

    /// Hash (FNV-1a) over time, joint state and body poses: equal worlds, equal hashes.
    pub fn state_hash(&self) -> u64 {
        let (position, velocity) = self.bodies.joint_state();
        let joints = position.iter().chain(&velocity).map(|value| value.to_bits());
        let poses = self.bodies.pose_bits().map(u64::from);
        let words = [self.time_ns].into_iter().chain(joints).chain(poses);
        words.flat_map(u64::to_le_bytes).fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
            (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3)
        })
    }
}
