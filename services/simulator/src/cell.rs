//! The simulated cell as one value: physics, vehicle, blob, and where the run stands. Pure: a frame's
//! command goes in, the next frame's world comes out. Serialisable as a whole, so that a simulator that
//! was killed goes on to the bit.

use crate::change::When;
use crate::config::CellConfig;
use crate::evaluation::Evaluation;
use crate::glare::glare;
use crate::journal::{MoveRecord, Record};
use crate::past::{Instant, Past};
use crate::placement::{place_blob, start_pose};
use pursuit_kinematics::{Arm, Coupling, Rig};
use pursuit_learning::Normalisation;
use pursuit_messages::payload::JOINTS;
use pursuit_messages::{LearnerState, MAX_CYCLES, Phase, SceneKind, WorldCommand, WorldState};
use pursuit_scene::paths::Vehicle;
use pursuit_world::{STEP_NS, TimedCycle, VehiclePose, World, WorldParameters};
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

/// Step of the vehicle's motion, s: that of the physics.
const VEHICLE_STEP_S: f64 = 0.001;

/// What stops a cell.
#[derive(Debug, thiserror::Error)]
pub enum CellError {
    /// The arm cannot keep the camera at that height.
    #[error("arm.camera_height_m: {0}")]
    Coupling(#[from] pursuit_kinematics::CouplingError),
    /// The physics cannot be set up or diverged.
    #[error("physics: {0}")]
    World(#[from] pursuit_world::WorldError),
}

/// What does not change in a run.
pub struct Fixed {
    config: CellConfig,
    coupling: Coupling,
    setups: [Setup; 2],
}

/// Arm and camera as they are, and what a perfect map of them would be.
struct Setup {
    rig: Rig,
    evaluation: Evaluation,
}

/// What changes in a run.
#[derive(Serialize, Deserialize)]
pub struct Cell {
    world: World,
    vehicle: Vehicle,
    /// What was, as long ago as the camera's clock is off.
    past: Past,
    scene: Scene,
    blob: [f64; 2],
    target_index: u32,
    moves: u32,
    ended_move: Option<EndedMove>,
    /// Number of the frame that is exposed now.
    pub frame: u64,
    /// Simulated time, ns.
    pub time_ns: u64,
    /// Tracking frames answered.
    pub tracked: u64,
    /// The frame answered last.
    answered: Option<u64>,
    /// Exposure of the first tracking frame, ns.
    tracking_since_ns: Option<u64>,
    /// Whether the scheduled change has come.
    changed: bool,
    /// Chain of SHA-256 over the trajectory so far.
    trajectory: [u8; 32],
}

#[derive(Clone, Copy, PartialEq, Serialize, Deserialize)]
enum Scene {
    Blob,
    Vehicle,
}

/// A training move that has ended and is not evaluated yet.
#[derive(Clone, Copy, Serialize, Deserialize)]
struct EndedMove {
    number: u32,
    target_index: u32,
    arrived_cm: f64,
}

impl Fixed {
    /// What the config makes of the cell.
    ///
    /// # Errors
    /// [`CellError::Coupling`].
    pub fn new(config: &CellConfig) -> Result<Fixed, CellError> {
        let coupling = Coupling::new(&Arm::puma_like(), config.camera_height_m)?;
        let half_width_px = f64::from(config.camera.width) / 2.0;
        let setup = |rig: Rig| {
            let evaluation = Evaluation::new(&rig, Normalisation { half_width_px });
            Setup { rig, evaluation }
        };
        let at_first = Rig::new(&coupling, coupling.arm(), &config.camera);
        let changed = config.change.rig(&coupling, &config.camera);
        Ok(Fixed { config: config.clone(), coupling, setups: [setup(at_first), setup(changed)] })
    }

    fn setup(&self, changed: bool) -> &Setup {
        &self.setups[usize::from(changed)]
    }
}

impl Cell {
    /// The cell at its first exposure.
    ///
    /// # Errors
    /// [`CellError::World`].
    pub fn new(fixed: &Fixed) -> Result<Cell, CellError> {
        let config = &fixed.config;
        let theta = start_pose(&fixed.coupling, config.seed);
        let world = World::new(&WorldParameters {
            substeps: config.substeps,
            ..WorldParameters::starting_at(theta, config.camera_height_m)?
        })?;
        let changed = config.change.when == When::Start;
        let blob = place_blob(&fixed.setup(changed).rig, theta, config.seed, 0);
        let mut vehicle = Vehicle::new(config.path.clone(), config.mode, config.seed);
        if let Some(profile) = &config.profile {
            vehicle = vehicle.with_profile(profile.clone());
        }
        let past = Past::at_rest(instant(&world, &vehicle), config.clock_offset_steps);
        Ok(Cell {
            world,
            vehicle,
            past,
            scene: Scene::Blob,
            blob,
            target_index: 0,
            moves: 0,
            ended_move: None,
            frame: 0,
            time_ns: 0,
            tracked: 0,
            answered: None,
            tracking_since_ns: None,
            changed,
            trajectory: [0; 32],
        })
    }

    /// The world now, as the camera and the drives see it.
    pub fn state(&self, fixed: &Fixed) -> WorldState {
        let rig = self.rig(fixed);
        // A changed forearm moves the camera only: the dynamics of the arm stay the nominal ones.
        let (seen, read) = (self.seen(fixed), self.read(fixed));
        let camera = rig.camera_pose(&seen.position);
        let issued = self.world.issued();
        let (scene, position, heading, velocity) = match self.scene {
            Scene::Blob => (SceneKind::Blob, self.blob, 0.0, [0.0; 2]),
            Scene::Vehicle => {
                let pose = seen.vehicle;
                (SceneKind::Vehicle, pose.position, pose.heading, pose.velocity)
            }
        };
        let config = &fixed.config;
        let height_m = camera.translation[2];
        let glare = glare(config.seed, self.frame, config.glare_share, rig.camera(), height_m);
        WorldState {
            time_ns: self.time_ns,
            exposes: 1,
            glares: u32::from(glare.is_some()),
            glare_px: glare.map_or([0.0; 2], |glare| glare.centre_px),
            glare_radius_px: glare.map_or(0.0, |glare| glare.radius_px),
            scene: scene as u32,
            position: read.position,
            velocity: read.velocity,
            issued_position: issued.position,
            demanded_position: read.demanded,
            issued_velocity: issued.velocity,
            camera_position: camera.translation,
            camera_rotation: camera.rotation,
            focal_px: rig.camera().focal_px,
            target_position: position,
            target_heading: heading,
            target_velocity: velocity,
            ..WorldState::default()
        }
    }

    /// Whether the configured number of tracking frames is done.
    pub fn is_finished(&self, fixed: &Fixed) -> bool {
        fixed.config.frames > 0 && self.tracked >= fixed.config.frames
    }

    /// The trajectory so far, as one number.
    pub fn trajectory_sha256(&self) -> String {
        self.trajectory.iter().map(|byte| format!("{byte:02x}")).collect()
    }

    /// Takes the answer to `frame` (in lock-step the present one): what it says of the frame, and of a move
    /// that ended with it.
    /// The drives accept the command; the world does not move yet.
    ///
    /// # Errors
    /// [`CellError::World`] where the drives refuse the command: the arm driver is at fault.
    pub fn take(
        &mut self,
        fixed: &Fixed,
        frame: u64,
        command: &WorldCommand,
        learner: Option<&LearnerState>,
    ) -> Result<(Record, Option<MoveRecord>), CellError> {
        let record = self.record(fixed, frame, command);
        let finished_move = self.finished_move(fixed, command, learner);
        self.chain(fixed);
        self.accept(fixed, command)?;
        self.follow_the_lesson(fixed, frame, command);
        Ok((record, finished_move))
    }

    /// Moves the world on to `time_ns`; what is scheduled until then happens.
    ///
    /// # Errors
    /// [`CellError::World`] where the physics diverged.
    pub fn advance(&mut self, fixed: &Fixed, time_ns: u64) -> Result<(), CellError> {
        if fixed.config.clock_offset_steps != 0 {
            for step_ns in (self.time_ns + STEP_NS..time_ns).step_by(STEP_NS as usize) {
                self.step_until(step_ns)?;
                self.past.take(instant(&self.world, &self.vehicle));
            }
        }
        self.step_until(time_ns)?;
        self.past.take(instant(&self.world, &self.vehicle));
        self.time_ns = time_ns;
        self.changed |= self.change_is_due(fixed);
        Ok(())
    }

    fn step_until(&mut self, time_ns: u64) -> Result<(), CellError> {
        let (vehicle, moving) = (&mut self.vehicle, self.scene == Scene::Vehicle);
        self.world.step_until(time_ns, |_| {
            if !moving {
                return VehiclePose::PARKED;
            }
            vehicle.advance(VEHICLE_STEP_S);
            let pose = vehicle.pose();
            VehiclePose { x_m: pose.position[0], y_m: pose.position[1], heading_rad: pose.heading }
        })?;
        Ok(())
    }

    /// What the camera sees: the truth at the exposure. An image that is taken later than its stamp says is
    /// taken now, and the joints are read as they were at the stamp; one that is taken earlier is of then,
    /// and the joints are read now.
    fn seen(&self, fixed: &Fixed) -> Instant {
        if fixed.config.clock_offset_steps < 0 { self.past.oldest() } else { self.now() }
    }

    /// What the drives report beside the image.
    fn read(&self, fixed: &Fixed) -> Instant {
        if fixed.config.clock_offset_steps > 0 { self.past.oldest() } else { self.now() }
    }

    fn now(&self) -> Instant {
        instant(&self.world, &self.vehicle)
    }

    /// Arm and camera as they are now.
    fn rig<'a>(&self, fixed: &'a Fixed) -> &'a Rig {
        &fixed.setup(self.changed).rig
    }

    fn change_is_due(&self, fixed: &Fixed) -> bool {
        match fixed.config.change.when {
            When::Never => false,
            When::Start => true,
            // The last move before the change counts with the cell that it was made in.
            When::Moves(moves) => self.moves >= moves && self.ended_move.is_none(),
            When::Tracking(after_ns) => {
                self.tracking_since_ns.is_some_and(|since_ns| self.time_ns - since_ns >= after_ns)
            }
        }
    }

    fn record(&self, fixed: &Fixed, frame: u64, command: &WorldCommand) -> Record {
        let state = self.state(fixed);
        let rig = self.rig(fixed);
        let [x, y] = state.target_position;
        let seen = rig.camera().project(&rig.base_from_camera(&self.seen(fixed).position), [x, y, 0.0]);
        Record {
            frame,
            time_s: self.time_ns as f64 / 1e9,
            phase: command.set_point.phase,
            moves: command.set_point.moves,
            detected: command.set_point.detected,
            refusal: command.refusal,
            camera_m: [state.camera_position[0], state.camera_position[1]],
            target_m: state.target_position,
            aimed_m: rig.camera_xy(command.set_point.position),
            in_view: u32::from(seen.is_some_and(|point| rig.camera().sees(point))),
            changed: u32::from(self.changed),
            glare: state.glares,
            ..Record::default()
        }
    }

    /// A move counts when it has ended; the network is evaluated one frame later, when the refit that
    /// its end set off has been merged.
    fn finished_move(
        &mut self,
        fixed: &Fixed,
        command: &WorldCommand,
        learner: Option<&LearnerState>,
    ) -> Option<MoveRecord> {
        let ended = self.ended_move.take();
        if command.set_point.moves > self.moves {
            self.moves = command.set_point.moves;
            let camera = self.rig(fixed).camera_pose(&self.world.positions()).translation;
            let arrived_cm = 100.0 * (camera[0] - self.blob[0]).hypot(camera[1] - self.blob[1]);
            self.ended_move =
                Some(EndedMove { number: self.moves, target_index: self.target_index, arrived_cm });
        }
        let (ended, learner) = (ended?, learner?);
        let weights = learner.weights.get(..learner.weight_count as usize)?;
        let error = fixed.setup(self.changed).evaluation.one_shot_cm(weights)?;
        Some(MoveRecord {
            number: ended.number,
            frame: self.frame,
            target_index: ended.target_index,
            error_cm: error.median,
            error_p90_cm: error.p90,
            arrived_cm: ended.arrived_cm,
            ring: learner.ring,
            loss: learner.loss,
            refit_us: learner.refit_ns as f64 / 1e3,
        })
    }

    fn accept(&mut self, fixed: &Fixed, command: &WorldCommand) -> Result<(), CellError> {
        let count = (command.cycle_count as usize).min(MAX_CYCLES);
        let first = self.time_ns + fixed.config.latency_ns;
        let mut cycles =
            [TimedCycle { due_ns: 0, duration_ns: 0, position: [0.0; JOINTS], velocity: [0.0; JOINTS] };
                MAX_CYCLES];
        for (index, (timed, cycle)) in cycles.iter_mut().zip(&command.cycles[..count]).enumerate() {
            *timed = TimedCycle {
                due_ns: first + (index as u64 + 1) * command.cycle_ns,
                duration_ns: command.cycle_ns,
                position: cycle.position,
                velocity: cycle.velocity,
            };
        }
        Ok(self.world.accept(&cycles[..count])?)
    }

    /// The helping person: puts the blob elsewhere when the learner is done with it, and the vehicle on
    /// the table when training is over.
    fn follow_the_lesson(&mut self, fixed: &Fixed, frame: u64, command: &WorldCommand) {
        let fresh = self.answered.replace(frame) != Some(frame);
        let set_point = &command.set_point;
        let phase = Phase::from_number(set_point.phase);
        self.tracked += u64::from(fresh && phase == Some(Phase::Tracking));
        if phase == Some(Phase::Tracking) {
            self.tracking_since_ns.get_or_insert(self.time_ns);
        }
        if matches!(phase, Some(Phase::Homing | Phase::Tracking)) {
            self.scene = Scene::Vehicle;
        } else if set_point.target_index > self.target_index {
            self.target_index = set_point.target_index;
            let joints = self.world.positions();
            let theta = [joints[0], joints[1]];
            self.blob = place_blob(self.rig(fixed), theta, fixed.config.seed, self.target_index);
        }
    }

    fn chain(&mut self, fixed: &Fixed) {
        let state = self.state(fixed);
        let mut hash = Sha256::new();
        hash.update(self.trajectory);
        hash.update(self.frame.to_le_bytes());
        let numbers = [state.position.as_slice(), &state.camera_position, &state.target_position];
        for number in numbers.into_iter().flatten() {
            hash.update(number.to_bits().to_le_bytes());
        }
        self.trajectory.copy_from_slice(&hash.finalize());
    }
}

fn instant(world: &World, vehicle: &Vehicle) -> Instant {
    let (demanded, _) = world.set_point();
    Instant { position: world.positions(), velocity: world.velocities(), demanded, vehicle: vehicle.pose() }
}
