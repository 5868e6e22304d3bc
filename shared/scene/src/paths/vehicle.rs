//! The vehicle on its path.

use serde::{Deserialize, Serialize};

use super::bicycle::{Bicycle, Disturbance, LOOK_AHEAD_M};
use super::curve::{Arena, CurvePoint, Path, wrapped};
use super::profile::SpeedProfile;
use super::walk::Walk;
use crate::random::Random;

/// Steps that a random walk may take at once to stay ahead of the vehicle.
const MAX_STEPS_AHEAD: usize = 200;
/// Stream of the seed for the vehicle's motion.
const STREAM: u64 = 16;

/// How the vehicle keeps to its path.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Mode {
    /// Always on it, with the exact speed.
    Exact,
    /// As a steered vehicle with lags, optionally disturbed.
    Bicycle(Option<Disturbance>),
}

/// Where the vehicle is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Pose2 {
    /// Middle of the body, base frame, metres.
    pub position: [f64; 2],
    /// Direction of the body from the x axis, -π to π radians.
    pub heading: f64,
    /// Velocity of the middle, base frame, metres per second.
    pub velocity: [f64; 2],
}

/// A vehicle in motion: all state of it, to be stored and continued.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Vehicle {
    path: Path,
    mode: Mode,
    profile: Option<SpeedProfile>,
    motion: Motion,
    random: Random,
    elapsed_s: f64,
    stopped: bool,
}

/// What moves, besides the time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
enum Motion {
    /// The time alone says where the vehicle is.
    OnCurve,
    /// The vehicle is the walk.
    Walking(Walk),
    /// A bicycle that follows a curve; `arc_m` is the way of the curve's nearest point.
    FollowingCurve { bicycle: Bicycle, arc_m: f64 },
    /// A bicycle that follows a walk ahead of it.
    FollowingWalk { bicycle: Bicycle, walk: Walk },
}

impl Vehicle {
    /// A vehicle at the start of `path`, already in motion; `seed` decides random walks and disturbances.
    ///
    /// # Panics
    /// If the path does not pass [`Path::check`].
    pub fn new(path: Path, mode: Mode, seed: u64) -> Self {
        if let Err(error) = path.check() {
            panic!("a path must be checked before use: {error}");
        }
        let mut random = Random::new(seed, STREAM);
        let motion = start(&path, mode, path.speed_m_per_s(), &mut random);
        Self { path, mode, profile: None, motion, random, elapsed_s: 0.0, stopped: false }
    }

    /// The same vehicle, at its start, with the speeds of `profile` in place of the path's.
    pub fn with_profile(mut self, profile: SpeedProfile) -> Self {
        let first = profile.speed_at(0.0);
        if let Motion::FollowingCurve { bicycle, .. } | Motion::FollowingWalk { bicycle, .. } =
            &mut self.motion
        {
            bicycle.speed = first;
        }
        self.profile = Some(profile);
        self
    }

    /// Moves on by `dt_s` seconds; a bicycle wants steps of some milliseconds.
    ///
    /// # Panics
    /// If the step is negative or not finite.
    pub fn advance(&mut self, dt_s: f64) {
        assert!(dt_s >= 0.0 && dt_s.is_finite(), "a step of {dt_s} s is none");
        if self.stopped {
            return;
        }
        self.elapsed_s += dt_s;
        let speed = self.wanted_speed();
        let disturbance = match &self.mode {
            Mode::Exact => None,
            Mode::Bicycle(disturbance) => disturbance.as_ref(),
        };
        match &mut self.motion {
            Motion::OnCurve => {}
            Motion::Walking(walk) => walk.advance(arena_of(&self.path), speed, dt_s, &mut self.random),
            Motion::FollowingCurve { bicycle, arc_m } => {
                *arc_m = nearest_arc(&self.path, *arc_m, bicycle.position);
                let goal = curve_point(&self.path, *arc_m + LOOK_AHEAD_M).position;
                bicycle.advance(goal, speed, dt_s, disturbance, &mut self.random);
            }
            Motion::FollowingWalk { bicycle, walk } => {
                keep_ahead(walk, bicycle, arena_of(&self.path), (speed, dt_s), &mut self.random);
                bicycle.advance(walk.position, speed, dt_s, disturbance, &mut self.random);
            }
        }
    }

    /// Where the vehicle is now.
    pub fn pose(&self) -> Pose2 {
        let speed = if self.stopped { 0.0 } else { self.wanted_speed() };
        match &self.motion {
            Motion::OnCurve => {
                let arc_m = match &self.profile {
                    Some(profile) => profile.distance_at(self.elapsed_s),
                    None => self.path.speed_m_per_s() * self.elapsed_s,
                };
                let point = curve_point(&self.path, arc_m);
                pose(point.position, point.heading, point.heading, speed)
            }
            Motion::Walking(walk) => pose(walk.position, walk.heading, walk.heading, speed),
            Motion::FollowingCurve { bicycle, .. } | Motion::FollowingWalk { bicycle, .. } => {
                let speed = if self.stopped { 0.0 } else { bicycle.speed };
                pose(bicycle.position, bicycle.heading, bicycle.course(), speed)
            }
        }
    }

    /// Stands still from now on (after a collision), or drives on.
    pub fn set_stopped(&mut self, stopped: bool) {
        self.stopped = stopped;
    }

    /// Time in motion since the start, seconds.
    pub fn elapsed_s(&self) -> f64 {
        self.elapsed_s
    }

    /// The path.
    pub fn path(&self) -> &Path {
        &self.path
    }

    fn wanted_speed(&self) -> f64 {
        match &self.profile {
            Some(profile) => profile.speed_at(self.elapsed_s),
            None => self.path.speed_m_per_s(),
        }
    }
}

fn start(path: &Path, mode: Mode, speed: f64, random: &mut Random) -> Motion {
    match (path, mode) {
        (Path::RandomWalk { arena, .. }, Mode::Exact) => Motion::Walking(Walk::new(arena, random)),
        (Path::RandomWalk { arena, .. }, Mode::Bicycle(_)) => {
            let walk = Walk::new(arena, random);
            let point = CurvePoint { position: walk.position, heading: walk.heading, curvature: 0.0 };
            Motion::FollowingWalk { bicycle: Bicycle::new(&point, speed), walk }
        }
        (_, Mode::Exact) => Motion::OnCurve,
        (_, Mode::Bicycle(_)) => {
            Motion::FollowingCurve { bicycle: Bicycle::new(&curve_point(path, 0.0), speed), arc_m: 0.0 }
        }
    }
}

/// One step of Newton's method for the point of the curve whose tangent is perpendicular to the way to `position`.
/// Called each step, it stays on its branch where the curve crosses itself.
fn nearest_arc(path: &Path, arc_m: f64, position: [f64; 2]) -> f64 {
    let point = curve_point(path, arc_m);
    let offset = [position[0] - point.position[0], position[1] - point.position[1]];
    let (c, s) = (libm::cos(point.heading), libm::sin(point.heading));
    arc_m + (offset[0] * c + offset[1] * s).clamp(-LOOK_AHEAD_M, LOOK_AHEAD_M)
}

/// Lets the walk go on until it is the look-ahead distance away.
fn keep_ahead(
    walk: &mut Walk,
    bicycle: &Bicycle,
    arena: &Arena,
    (speed, dt_s): (f64, f64),
    random: &mut Random,
) {
    for _ in 0..MAX_STEPS_AHEAD {
        let offset = [walk.position[0] - bicycle.position[0], walk.position[1] - bicycle.position[1]];
        if libm::hypot(offset[0], offset[1]) >= LOOK_AHEAD_M {
            break;
        }
        walk.advance(arena, speed, dt_s, random);
    }
}

fn curve_point(path: &Path, arc_m: f64) -> CurvePoint {
    path.point(arc_m).expect("every path but the random walk is a curve")
}

fn arena_of(path: &Path) -> &Arena {
    match path {
        Path::RandomWalk { arena, .. } => arena,
        _ => unreachable!("only a random walk walks"),
    }
}

fn pose(position: [f64; 2], heading: f64, course: f64, speed: f64) -> Pose2 {
    let velocity = [speed * libm::cos(course), speed * libm::sin(course)];
    Pose2 { position, heading: wrapped(heading), velocity }
}
