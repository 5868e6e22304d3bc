//! Sections `[simulator]` and `[vehicle]`, and the simulated part of `[camera]`.

use crate::change::Change;
use pursuit_config::{Checker, Section};
use pursuit_kinematics::Camera;
use pursuit_runtime::settings;
use pursuit_scene::paths::{Arena, Disturbance, Mode, Path, SpeedProfile};
use pursuit_world::STEP_NS;

/// Drive cycle of the simulated arm, ns.
pub const CYCLE_NS: u64 = 10_000_000;
/// Largest offset of the camera's clock, ms.
const MAX_CLOCK_OFFSET_MS: f64 = 40.0;
/// How long a vehicle that stops and goes drives at its speed, and stands, s, where it is not configured.
const GO_S: f64 = 4.0;
const STOP_S: f64 = 3.0;
/// It takes this long to stop and to set off, s.
const RAMP_S: f64 = 0.5;
/// Simulated time from a command to its first effect where none is configured, ms: the paper's delay.
pub const LATENCY_MS: f64 = 80.0;

/// What the simulator needs.
#[derive(Clone, Debug)]
pub struct Config {
    /// Section `[run]`.
    pub run: settings::Run,
    /// Section `[camera]`.
    pub camera: settings::Camera,
    /// What the simulated cell is made of.
    pub cell: CellConfig,
}

/// What the simulated cell is made of.
#[derive(Clone, Debug)]
pub struct CellConfig {
    /// Seed of start pose, blob places and the vehicle.
    pub seed: u64,
    /// Camera geometry; nothing but the simulator knows it.
    pub camera: Camera,
    /// Height of the camera above the table, m.
    pub camera_height_m: f64,
    /// Time from one exposure to the next, ns.
    pub frame_period_ns: u64,
    /// How much later than its stamp says an image is taken, on the joints' clock, in steps of the physics;
    /// negative for earlier.
    pub clock_offset_steps: i64,
    /// Time from a command to its first effect, ns.
    pub latency_ns: u64,
    /// Physics substeps per millisecond.
    pub substeps: usize,
    /// Tracking frames after which the run is over, 0 for never.
    pub frames: u64,
    /// Share of the frames with a glare on the lens.
    pub glare_share: f64,
    /// Where the vehicle goes.
    pub path: Path,
    /// Speeds in place of the path's, where it stops and goes.
    pub profile: Option<SpeedProfile>,
    /// How it keeps to it.
    pub mode: Mode,
    /// What happens to the cell in the run.
    pub change: Change,
}

impl Config {
    /// Reads the sections; faults go to the checker.
    pub fn read(checker: &Checker<'_>) -> Config {
        let run = settings::Run::read(checker);
        let camera = settings::Camera::read(checker);
        let lens = checker.section("camera");
        let geometry = Camera {
            width: camera.width,
            height: camera.height,
            focal_px: lens.float_or("focal_px", 8.0..=1e5, pursuit_scene::FOCAL_PX),
            mount_rad: lens.float_or("mount_deg", -180.0..=180.0, 0.0).to_radians(),
        };
        let renders = checker.section("acquisition").text_or("source", "simulated") == "simulated";
        if renders && !camera.period_ns().is_multiple_of(CYCLE_NS) {
            lens.fault(
                "rate_hz",
                "the simulator exposes every whole drive cycle of 10 ms: 100, 50, 25, 20, 12.5, 10, …",
            );
        }
        let section = checker.section("simulator");
        let (path, profile, mode) = vehicle(checker);
        let cell = CellConfig {
            seed: run.seed,
            camera: geometry,
            camera_height_m: checker.section("arm").float_or("camera_height_m", 0.2..=0.8, 0.5),
            frame_period_ns: camera.period_ns(),
            clock_offset_steps: clock_offset_steps(&lens),
            latency_ns: (section.float_or("latency_ms", 0.0..=1000.0, LATENCY_MS) * 1e6).round() as u64,
            substeps: section.integer_or("substeps", 1..=16, 1),
            frames: section.integer_or("frames", 0..=u64::from(u32::MAX), 0),
            glare_share: section.float_or("glare_share", 0.0..=1.0, 0.0),
            path,
            profile,
            mode,
            change: Change::read(checker),
        };
        Config { run, camera, cell }
    }
}

fn clock_offset_steps(lens: &Section<'_>) -> i64 {
    let offset_ms = lens.float_or("clock_offset_ms", -MAX_CLOCK_OFFSET_MS..=MAX_CLOCK_OFFSET_MS, 0.0);
    let steps = offset_ms * 1e6 / STEP_NS as f64;
    if steps.fract() != 0.0 {
        lens.fault("clock_offset_ms", "must be whole milliseconds, the steps of the physics");
    }
    steps as i64
}

#[derive(Clone, Copy)]
enum PathKind {
    Circle,
    FigureEight,
    Square,
    RandomWalk,
    StopAndGo,
}

fn vehicle(checker: &Checker<'_>) -> (Path, Option<SpeedProfile>, Mode) {
    let section = checker.section("vehicle");
    let kinds = [
        ("circle", PathKind::Circle),
        ("figure-eight", PathKind::FigureEight),
        ("square", PathKind::Square),
        ("random-walk", PathKind::RandomWalk),
        ("stop-and-go", PathKind::StopAndGo),
    ];
    let kind = section.choice_or("path", &kinds, PathKind::Circle);
    let centre = section.floats_or("centre_m", 2, -2.0..=2.0, &[0.63, 0.0]);
    let centre = [centre[0], centre[1]];
    let size = section.float_or("radius_m", 0.02..=1.0, 0.20);
    let speed = section.float_or("speed_m_per_s", 0.0..=1.0, 0.1);
    let phase = section.float_or("start_phase_deg", -360.0..=360.0, 0.0).to_radians();
    let path = path(kind, centre, size, speed, phase);
    let go_s = section.float_or("go_s", 0.5..=60.0, GO_S);
    let stop_s = section.float_or("stop_s", 0.5..=60.0, STOP_S);
    let steered = section.choice_or("motion", &[("bicycle", true), ("exact", false)], true);
    let disturbed = section.flag_or("disturbed", false);
    check(&section, &path);
    let mode = match (steered, disturbed) {
        (false, _) => Mode::Exact,
        (true, false) => Mode::Bicycle(None),
        (true, true) => Mode::Bicycle(Some(Disturbance::default())),
    };
    let stops = matches!(kind, PathKind::StopAndGo);
    let profile = stops.then(|| SpeedProfile::stop_and_go(speed, go_s, stop_s, RAMP_S)).flatten();
    (path, profile, mode)
}

fn path(kind: PathKind, centre: [f64; 2], size: f64, speed_m_per_s: f64, start_phase_rad: f64) -> Path {
    match kind {
        PathKind::Circle | PathKind::StopAndGo => {
            Path::Circle { centre, radius_m: size, speed_m_per_s, clockwise: false, start_phase_rad }
        }
        PathKind::FigureEight => Path::FigureEight { centre, half_width_m: size, speed_m_per_s },
        PathKind::Square => Path::Waypoints {
            corners: [[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]]
                .map(|[x, y]| [centre[0] + x * size, centre[1] + y * size])
                .to_vec(),
            corner_radius_m: 0.15 * size,
            speed_m_per_s,
        },
        PathKind::RandomWalk => Path::RandomWalk {
            arena: Arena {
                least: [centre[0] - size, centre[1] - size],
                most: [centre[0] + size, centre[1] + size],
            },
            speed_m_per_s,
        },
    }
}

fn check(section: &Section<'_>, path: &Path) {
    if let Err(error) = path.check() {
        section.fault("path", error);
    }
}
