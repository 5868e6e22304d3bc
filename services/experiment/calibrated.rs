//! `pursuit experiment calibrated`: what a perfectly calibrated robot reaches on the same runs, the ceiling.
//!
//! Two of them, with the exact hand-eye map that the learner never sees: the same predictive law, and a
//! classical image-based visual servo (Espiau, Chaumette and Rives 1992: velocity = gain x error in the
//! image through the exact inverse Jacobian) with the target's velocity fed forward from a
//! constant-velocity filter (Corke and Hager). The better of the two is the ceiling.

use super::cells::{self, Followed};
use super::figures::{Spread, spread, spread_text};
use super::{publish, seeds_text};
use crate::check::Checked;
use crate::cli::Experiment;
use crate::inprocess::Hand;
use crate::svg::{Mark, Plot, Series};
use pursuit_kinematics::{Camera, Coupling, exact_move};
use pursuit_learner::chart::Map;
use pursuit_learner::config::Parameters;
use pursuit_learner::moment::Moment;
use pursuit_learner::refusals::Refusals;
use pursuit_learner::step::{Command, Input, Learner, Output};
use pursuit_learner::tracking::{Reliance, Track};
use pursuit_messages::Phase;
use serde::Serialize;
use std::time::Duration;

/// The laws compared: the learnt map first.
const CONTROLLERS: [&str; 3] = ["predictive", "exact-map", "visual-servo"];
/// Gain of the servo on the error in the image, 1/s: with 80 ms from image to motion and 80 ms between
/// images, the highest that does not ring is about 1 / (e x 0.2 s).
const SERVO_GAIN_PER_S: f64 = 2.0;
/// Gains of the constant-velocity filter (alpha-beta, Benedict and Bordner 1962: beta = a^2 / (2 - a)).
const ALPHA: f64 = 0.5;

/// A calibrated robot: homing as the learner does it, then one of the laws.
pub struct Calibrated {
    learner: Learner,
    parameters: Parameters,
    map: Exact,
    law: Law,
    command: Command,
}

enum Law {
    Predictive(Box<Track>),
    Servo(Servo),
}

/// The exact map.
struct Exact {
    coupling: Coupling,
    camera: Camera,
}

/// The visual servo's memory.
#[derive(Default)]
struct Servo {
    /// Where the target is on the table and how fast, base frame, m and m/s, at a time, ns.
    target: Option<([f64; 2], [f64; 2], u64)>,
    /// Where the last set-point brings the camera, its velocity, and its time.
    told: Option<([f64; 2], [f64; 2], u64)>,
}

impl Calibrated {
    /// The law of that name; `None` where it is one of the learner's own.
    pub fn named(name: &str, checked: &Checked, learner: &Learner) -> Option<Calibrated> {
        let law = match name {
            "exact-map" => Law::Predictive(Box::default()),
            "visual-servo" => Law::Servo(Servo::default()),
            _ => return None,
        };
        let cell = &checked.simulator.cell;
        let map = Exact { coupling: checked.arm.coupling, camera: cell.camera };
        let parameters = checked.learner.parameters;
        Some(Calibrated { learner: learner.clone(), parameters, map, law, command: Command::Hold })
    }

    /// The delay that it predicts over.
    pub fn lead(&self) -> Duration {
        match &self.law {
            Law::Predictive(track) => track.lead(&self.parameters),
            Law::Servo(_) => Duration::ZERO,
        }
    }
}

impl Hand for Calibrated {
    fn answer(&mut self, input: &Input) -> Output {
        let mut output = self.learner.step(input);
        if self.learner.phase() != Phase::Tracking {
            return output;
        }
        // The clocks of these runs agree.
        let Ok(moment) = Moment::of(input, 0.0, &mut Refusals::default()) else { return output };
        let (command, used) = match &mut self.law {
            Law::Predictive(track) => track.step(&moment, &self.map, Reliance::FULL, &self.parameters),
            Law::Servo(servo) => servo.step(&moment, input, &self.map, &self.parameters),
        };
        self.command = command.unwrap_or(self.command);
        let told = self.command.set_point();
        output.set_point.follow = told.follow;
        (output.set_point.position, output.set_point.velocity) = (told.position, told.velocity);
        output.set_point.detected = u32::from(used);
        output
    }
}

impl Map for Exact {
    fn displacement(&self, point_px: [f64; 2], theta2: f64) -> [f64; 2] {
        // Out of reach: as far as the arm is stretched.
        let shorter = [1.0, 0.8, 0.6, 0.4, 0.2, 0.0].map(|share| point_px.map(|axis| share * axis));
        let reached = |point| exact_move(&self.coupling, &self.camera, point, theta2);
        shorter.into_iter().find_map(reached).unwrap_or_default()
    }

    fn rotation_sign(&self) -> f64 {
        -1.0
    }
}

impl Exact {
    fn joints_over(&self, from: [f64; 2], place_m: [f64; 2]) -> [f64; 2] {
        let camera_m = self.coupling.camera_xy(from[0], from[1]);
        let (sin, cos) = from[0].sin_cos();
        let off = [place_m[0] - camera_m[0], place_m[1] - camera_m[1]];
        let scale = self.camera.focal_px / self.coupling.camera_height_m();
        let unturned = [scale * (cos * off[0] + sin * off[1]), scale * (sin * off[0] - cos * off[1])];
        let (sin, cos) = self.camera.mount_rad.sin_cos();
        let seen = [cos * unturned[0] + sin * unturned[1], cos * unturned[1] - sin * unturned[0]];
        let [first, second] = self.displacement(seen, from[1]);
        [from[0] + first, from[1] + second]
    }

    fn place_m(&self, joints: [f64; 2], point_px: [f64; 2]) -> [f64; 2] {
        let [first, second] = self.displacement(point_px, joints[1]);
        self.coupling.camera_xy(joints[0] + first, joints[1] + second)
    }
}

impl Servo {
    fn step(
        &mut self,
        moment: &Moment,
        input: &Input,
        map: &Exact,
        parameters: &Parameters,
    ) -> (Option<Command>, bool) {
        let now_ns = input.exposure_ns;
        let seen = moment.motion_px().map(|point_px| map.place_m(input.joints, point_px));
        if let Some(place) = seen {
            self.filter(place, now_ns);
        }
        let Some((place, velocity, seen_ns)) = self.target else {
            return (Some(Command::GoTo(parameters.home_rad)), false);
        };
        let since = |then_ns: u64| now_ns.saturating_sub(then_ns) as f64 * 1e-9;
        let target = [0, 1].map(|k| place[k] + velocity[k] * since(seen_ns));
        let camera = map.coupling.camera_xy(input.joints[0], input.joints[1]);
        let speed = [0, 1].map(|k| SERVO_GAIN_PER_S * (target[k] - camera[k]) + velocity[k]);
        // A velocity servo: the set-point goes on from where it had come to.
        let at = self
            .told
            .map_or(camera, |(place, speed, then_ns)| [0, 1].map(|k| place[k] + speed[k] * since(then_ns)));
        self.told = Some((at, speed, now_ns));
        let ahead_s = 0.01;
        let over = |place| map.joints_over(input.joints, place);
        let (here, then) = (over(at), over([0, 1].map(|k| at[k] + speed[k] * ahead_s)));
        let position = parameters.into_envelope(here);
        let velocity = [0, 1].map(|k| (then[k] - here[k]) / ahead_s);
        (Some(Command::Follow { position, velocity }), seen.is_some())
    }

    fn filter(&mut self, place: [f64; 2], now_ns: u64) {
        let fresh = (place, [0.0; 2], now_ns);
        let Some((at, velocity, then_ns)) = self.target.replace(fresh) else { return };
        let passed_s = now_ns.saturating_sub(then_ns) as f64 * 1e-9;
        if passed_s <= 0.0 || passed_s > 1.0 {
            return;
        }
        // Faster images: the same time to settle as at 12.5 Hz.
        let alpha = 1.0 - (1.0 - ALPHA).powf(passed_s / 0.08);
        let beta = alpha * alpha / (2.0 - alpha);
        let expected = [0, 1].map(|k| at[k] + velocity[k] * passed_s);
        let off = [0, 1].map(|k| place[k] - expected[k]);
        self.target = Some((
            [0, 1].map(|k| expected[k] + alpha * off[k]),
            [0, 1].map(|k| velocity[k] + beta / passed_s * off[k]),
            now_ns,
        ));
    }
}

/// One condition, all laws, over all seeds.
#[derive(Clone, Debug, Serialize)]
struct Compared {
    path: String,
    speed_m_per_s: f64,
    rate_hz: f64,
    latency_ms: f64,
    seeds: u64,
    learnt_cm: Spread,
    exact_map_cm: Spread,
    visual_servo_cm: Spread,
    /// Learnt over the better of the other two, medians.
    ratio: f64,
}

/// Runs it.
///
/// # Errors
/// A run fails, or the figures cannot be written.
pub fn run(options: &Experiment) -> Result<u8, String> {
    #[derive(Serialize)]
    struct Figures {
        runs: Vec<Compared>,
    }
    let conditions =
        cells::conditions(&Experiment { controllers: Vec::new(), ..options.clone() }, &CONTROLLERS)?;
    println!("the learnt map against a perfectly calibrated robot, seeds {}", seeds_text(options));
    println!("RMS distance while following; median / p90\n");
    let followed = cells::follow_all(options, &conditions)?;
    println!(
        "  {:<13} {:>5} {:>6} {:>7} {:>17} {:>17} {:>17} {:>7}",
        "path", "m/s", "Hz", "ms", "learnt", "exact map", "visual servo", "ratio"
    );
    let mut runs = Vec::new();
    for first in (0..conditions.len()).step_by(CONTROLLERS.len()) {
        let rms = |index: usize| {
            spread(followed.iter().map(|of_seed: &Vec<Followed>| of_seed[first + index].tracking.rms_cm))
        };
        let (learnt_cm, exact_map_cm, visual_servo_cm) = (rms(0), rms(1), rms(2));
        let condition = conditions[first].clone();
        let compared = Compared {
            path: condition.path,
            speed_m_per_s: condition.speed_m_per_s,
            rate_hz: condition.rate_hz,
            latency_ms: condition.latency_ms,
            seeds: options.seeds(),
            learnt_cm,
            exact_map_cm,
            visual_servo_cm,
            ratio: learnt_cm.p50 / exact_map_cm.p50.min(visual_servo_cm.p50),
        };
        println!(
            "  {:<13} {:>5} {:>6} {:>7} {:>17} {:>17} {:>17} {:>7.2}",
            compared.path,
            compared.speed_m_per_s,
            compared.rate_hz,
            compared.latency_ms,
            spread_text(learnt_cm, "cm"),
            spread_text(exact_map_cm, "cm"),
            spread_text(visual_servo_cm, "cm"),
            compared.ratio
        );
        runs.push(compared);
    }
    let plot = plot(&runs).svg();
    publish(options, &Figures { runs }, "experiment-calibrated.svg", &plot)
}

fn plot(runs: &[Compared]) -> Plot {
    let series = |name: &str, colour, of: fn(&Compared) -> f64| Series {
        name: name.to_owned(),
        colour,
        points: runs.iter().enumerate().map(|(index, run)| [index as f64 + 1.0, of(run)]).collect(),
        mark: Mark::Dots,
    };
    Plot {
        title: "RMS distance while following, median over seeds".to_owned(),
        x_label: "condition, in the order of the table".to_owned(),
        y_label: "cm".to_owned(),
        equal_axes: false,
        log_y: true,
        series: vec![
            series("learnt map", "#0072b2", |run| run.learnt_cm.p50),
            series("exact map", "#009e73", |run| run.exact_map_cm.p50),
            series("calibrated visual servo", "#d55e00", |run| run.visual_servo_cm.p50),
        ],
    }
}
