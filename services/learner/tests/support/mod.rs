//! A cell without any bus: exact arm, limited and lagging drives, a camera that sees a point with noise,
//! and the latency of the set-point.

#![allow(dead_code, clippy::unwrap_used)]

use std::collections::VecDeque;

use pursuit_kinematics::{Arm, Camera, Coupling, exact_move};
use pursuit_learner::config::Parameters;
use pursuit_learner::step::{Input, Learner, Output};
use pursuit_learning::{GridCase, GridError, Network, Normalisation, evaluate_grid, refit};
use pursuit_messages::{Detection, ImageShape, Phase, SetPoint, Target};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

pub const FRAME_NS: u64 = 40_000_000;
const DRIVE_S: f64 = 0.005;
const DRIVES_PER_FRAME: u64 = 8;
const LAG_S: f64 = 0.03;
const ACCELERATION: f64 = 8.0;
const CAMERA_HEIGHT_M: f64 = 0.5;

/// What can be different from the default cell.
#[derive(Clone, Copy, Debug)]
pub struct Conditions {
    pub noise_px: f64,
    pub latency_frames: usize,
    pub focal_px: f64,
    pub mount_rad: f64,
    /// Share of the detections that are anywhere.
    pub wild: f64,
    /// Noise of the background's displacement from frame to frame.
    pub flow_noise_px: f64,
}

impl Default for Conditions {
    fn default() -> Conditions {
        Conditions {
            noise_px: 0.5,
            latency_frames: 2,
            focal_px: 256.0,
            mount_rad: 0.0,
            wild: 0.0,
            flow_noise_px: 0.1,
        }
    }
}

pub struct Cell {
    pub coupling: Coupling,
    pub camera: Camera,
    conditions: Conditions,
    rng: ChaCha8Rng,
    pub frame: u64,
    pub joints: [f64; 2],
    velocities: [f64; 2],
    profile: [f64; 2],
    profile_speed: [f64; 2],
    goal: Option<[f64; 2]>,
    pending: VecDeque<SetPoint>,
    target_index: u32,
    pub target: [f64; 2],
    /// Velocity of the target, m/s, once it is a vehicle.
    pub target_velocity: [f64; 2],
    /// Joints and turn of the camera at the last exposure.
    before: Option<([f64; 2], f64)>,
}

impl Cell {
    pub fn new(seed: u64, conditions: Conditions) -> Cell {
        let camera = Camera {
            mount_rad: conditions.mount_rad,
            focal_px: conditions.focal_px,
            ..Camera::default_cell()
        };
        let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0xce11);
        let joints = [rng.random_range(-0.5..0.5), rng.random_range(0.35..0.85)];
        let mut cell = Cell {
            coupling: Coupling::new(&Arm::puma_like(), CAMERA_HEIGHT_M).unwrap(),
            camera,
            conditions,
            rng,
            frame: 0,
            joints,
            velocities: [0.0; 2],
            profile: joints,
            profile_speed: [0.0; 2],
            goal: None,
            pending: VecDeque::new(),
            target_index: 0,
            target: [0.0; 2],
            target_velocity: [0.0; 2],
            before: None,
        };
        cell.place_target();
        cell
    }

    /// Anywhere in view that the camera can be brought over, 10 cm or more away.
    fn place_target(&mut self) {
        let half = 0.9 * f64::from(self.camera.width) / 2.0;
        loop {
            let px = [self.rng.random_range(-half..half), self.rng.random_range(-half..half)];
            let Some([d1, d2]) = exact_move(&self.coupling, &self.camera, px, self.joints[1]) else {
                continue;
            };
            let goal = [self.joints[0] + d1, self.joints[1] + d2];
            self.target = self.coupling.camera_xy(goal[0], goal[1]);
            if self.coupling.envelope().contains(goal, 0.0) && self.error_m() > 0.10 {
                return;
            }
        }
    }

    /// Distance of the camera's axis from the target, m.
    pub fn error_m(&self) -> f64 {
        let [x, y] = self.coupling.camera_xy(self.joints[0], self.joints[1]);
        (x - self.target[0]).hypot(y - self.target[1])
    }

    /// Where a camera with that mounting angle sees a point of the table, px from the image's centre.
    fn project(&self, joints: [f64; 2], mount_rad: f64, point: [f64; 2]) -> [f64; 2] {
        let all = self.coupling.joints(joints[0], joints[1]).unwrap();
        let pose = self.coupling.arm().base_from_camera(&all, mount_rad);
        self.camera.project(&pose, [point[0], point[1], 0.0]).unwrap()
    }

    fn see(&mut self) -> Detection {
        let point = self.project(self.joints, self.camera.mount_rad, self.target);
        if !self.camera.sees(point) {
            return Detection::default();
        }
        let noise = gaussian_pair(&mut self.rng).map(|z| z * self.conditions.noise_px);
        let mut seen = [point[0] + noise[0], point[1] + noise[1]];
        if self.conditions.wild > 0.0 && self.rng.random_range(0.0..1.0) < self.conditions.wild {
            let half = f64::from(self.camera.width) / 2.0 - 1.0;
            seen = [0, 1].map(|_| self.rng.random_range(-half..half));
        }
        let [u, v] = self.camera.pixel_from_centred(seen);
        Detection { found: 1, u, v, confidence: 1.0, ..Detection::default() }
    }

    /// Exposes the next frame.
    pub fn expose(&mut self) -> Input {
        self.frame += 1;
        let detection = self.see();
        let mut target = Target { motion: detection, blob: detection, ..Target::default() };
        let now = (self.joints, self.camera.mount_rad);
        if let Some((joints, mount_rad)) = self.before.replace(now) {
            let middle = self.coupling.camera_xy(self.joints[0], self.joints[1]);
            let origin = self.project(joints, mount_rad, middle);
            let noise = gaussian_pair(&mut self.rng).map(|z| z * self.conditions.flow_noise_px);
            (target.background_u, target.background_v) = (noise[0] - origin[0], noise[1] - origin[1]);
            target.background_turn_rad = self.joints[0] - joints[0] + mount_rad - self.camera.mount_rad;
            target.background_frames = 1;
        }
        Input {
            frame: self.frame,
            exposure_ns: self.frame * FRAME_NS,
            image: ImageShape { width: 512, height: 512, stride: 512, format: 1 },
            target,
            joints: self.joints,
            velocities: self.velocities,
        }
    }

    /// Sends the set-point on its way and lets one frame's time pass.
    pub fn act(&mut self, set_point: SetPoint) {
        self.pending.push_back(set_point);
        if self.pending.len() > self.conditions.latency_frames {
            let due = self.pending.pop_front().unwrap();
            self.goal = (due.follow == 1).then_some(due.position);
            if due.target_index != self.target_index {
                self.target_index = due.target_index;
                self.place_target();
            }
        }
        for _ in 0..DRIVES_PER_FRAME {
            self.drive();
        }
        let seconds = FRAME_NS as f64 * 1e-9;
        self.target = [0, 1].map(|axis| self.target[axis] + seconds * self.target_velocity[axis]);
    }

    /// One frame of the closed loop: expose, answer, act.
    pub fn turn(&mut self, learner: &mut Learner) -> Output {
        let input = self.expose();
        let output = learner.step(&input);
        self.act(output.set_point);
        output
    }

    /// Trapezoid of speed and acceleration, then a first-order lag.
    fn drive(&mut self) {
        let limits = [1.43, self.coupling.joint2_speed_limit(self.profile[1])];
        for joint in 0..2 {
            let way = self.goal.map_or(0.0, |goal| goal[joint] - self.profile[joint]);
            let half_step = 0.5 * ACCELERATION * DRIVE_S;
            let stopping = (half_step * half_step + 2.0 * ACCELERATION * way.abs()).sqrt() - half_step;
            let wanted = way.signum() * stopping.min(limits[joint]).min(way.abs() / DRIVE_S);
            let change = ACCELERATION * DRIVE_S;
            self.profile_speed[joint] += (wanted - self.profile_speed[joint]).clamp(-change, change);
            self.profile[joint] += self.profile_speed[joint] * DRIVE_S;
            let before = self.joints[joint];
            self.joints[joint] += (self.profile[joint] - before) * (1.0 - (-DRIVE_S / LAG_S).exp());
            self.velocities[joint] = (self.joints[joint] - before) / DRIVE_S;
        }
    }
}

pub fn gaussian_pair(rng: &mut ChaCha8Rng) -> [f64; 2] {
    let radius = (-2.0 * (1.0 - rng.random_range(0.0..1.0f64)).ln()).sqrt();
    let (sin, cos) = rng.random_range(0.0..std::f64::consts::TAU).sin_cos();
    [radius * cos, radius * sin]
}

/// 300 fixed cases, evenly over the image and the working range, that are within reach.
pub fn grid_cases(coupling: &Coupling, camera: &Camera) -> Vec<GridCase> {
    let mut rng = ChaCha8Rng::seed_from_u64(12345);
    let half = f64::from(camera.width) / 2.0;
    let mut cases = Vec::new();
    while cases.len() < 300 {
        let [low, high] = coupling.envelope().theta2_rad;
        let theta2 = rng.random_range(low..high);
        let point_px = [rng.random_range(-half..half), rng.random_range(-half..half)];
        let reachable = exact_move(coupling, camera, point_px, theta2)
            .is_some_and(|[_, d2]| coupling.envelope().contains([0.0, theta2 + d2], 0.0));
        if reachable {
            cases.push(GridCase { point_px, theta2 });
        }
    }
    cases
}

/// Error of one single move over the grid, m.
pub fn one_shot_error(network: &Network, cell: &Cell, cases: &[GridCase]) -> GridError {
    let over = |theta2: f64, [d1, d2]: [f64; 2]| {
        // The model ends where the arm is stretched or folded; the learner's own clamp is narrower.
        cell.coupling.camera_xy(d1, (theta2 + d2).clamp(-0.3, 1.06))
    };
    let normalisation = Normalisation { half_width_px: f64::from(cell.camera.width) / 2.0 };
    evaluate_grid(network, &normalisation, cases, |case, command| {
        let exact = exact_move(&cell.coupling, &cell.camera, case.point_px, case.theta2).unwrap();
        let (a, b) = (over(case.theta2, command), over(case.theta2, exact));
        (a[0] - b[0]).hypot(a[1] - b[1])
    })
}

/// What a training run came to.
#[derive(Clone, Debug, Default)]
pub struct Run {
    /// One-shot error after each move, m.
    pub grid: Vec<GridError>,
    /// Distance from the first target after each move to it, m.
    pub first_target: Vec<f64>,
    pub targets: u32,
    pub frames: u64,
    pub rejected: u32,
}

impl Run {
    /// First move after which the grid's median is below on two moves running.
    pub fn moves_to(&self, limit_m: f64) -> Option<usize> {
        let below = |pair: &[GridError]| pair[0].median < limit_m && pair[1].median < limit_m;
        self.grid.windows(2).position(below).map(|index| index + 1)
    }

    /// First move that ends that close to the first target.
    pub fn moves_on_first_target(&self, limit_m: f64) -> Option<usize> {
        self.first_target.iter().position(|error| *error < limit_m).map(|index| index + 1)
    }
}

/// Trains in lock-step: the refit of one frame is merged before the next.
pub fn train(parameters: &Parameters, seed: u64, conditions: Conditions) -> (Run, Learner, Cell) {
    let mut learner = Learner::new(parameters, seed);
    let mut cell = Cell::new(seed, conditions);
    let cases = grid_cases(&cell.coupling, &cell.camera);
    let mut run = Run::default();
    let mut moves = 0;
    while learner.phase() == Phase::Training {
        let output = learner.step(&cell.expose());
        let error = cell.error_m();
        cell.act(output.set_point);
        finish_refit(&mut learner);
        if output.state.moves > moves {
            moves = output.state.moves;
            run.grid.push(one_shot_error(learner.network(), &cell, &cases));
            if output.state.target_index == 0 {
                run.first_target.push(error);
            }
        }
        run.targets = output.state.target_index;
        run.rejected = output.state.refits_rejected;
        assert!(cell.frame < 100_000, "training does not end");
    }
    run.frames = cell.frame;
    (run, learner, cell)
}

/// Runs and merges the refit that is due, if one is.
pub fn finish_refit(learner: &mut Learner) {
    if let Some(job) = learner.refit_job() {
        learner.merge(&refit(&job, || true));
    }
}

/// The value that the share of all is not above; `None` ("never") sorts last.
pub fn quantile<T: Copy + PartialOrd>(values: impl IntoIterator<Item = Option<T>>, share: f64) -> Option<T> {
    let mut values: Vec<Option<T>> = values.into_iter().collect();
    values.sort_by(|a, b| match (a, b) {
        (Some(a), Some(b)) => a.partial_cmp(b).unwrap(),
        (None, None) => std::cmp::Ordering::Equal,
        (None, _) => std::cmp::Ordering::Greater,
        (_, None) => std::cmp::Ordering::Less,
    });
    values[((values.len() - 1) as f64 * share).round() as usize]
}
