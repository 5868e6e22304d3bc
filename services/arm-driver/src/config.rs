//! Section `[arm]`.

use crate::safety::{Activation, Rules};
use crate::step::Parameters;
use pursuit_config::Checker;
use pursuit_kinematics::{Arm, Coupling};
use pursuit_messages::MAX_CYCLES;
use pursuit_runtime::settings;

/// Tool speed where none is configured, m/s: the reduced speed of robot makers.
const REDUCED_TOOL_SPEED_M_PER_S: f64 = 0.25;
/// Largest following error where none is configured, rad: ten times what the simulated drives show.
const FOLLOWING_ERROR_RAD: f64 = 0.05;

/// What the arm driver needs.
#[derive(Clone, Debug)]
pub struct Config {
    /// Section `[run]`.
    pub run: settings::Run,
    /// Limits and watchdog.
    pub parameters: Parameters,
    /// Who lets the arm move, and what stops it.
    pub rules: Rules,
    /// Keeps the camera vertical and at its height.
    pub coupling: Coupling,
    /// Drive cycles from one frame to the next, at most [`MAX_CYCLES`].
    pub cycles_per_frame: usize,
}

impl Config {
    /// Reads the sections; faults go to the checker. `None` only where there is a fault.
    pub fn read(checker: &Checker<'_>) -> Option<Config> {
        let run = settings::Run::read(checker);
        let camera = settings::Camera::read(checker);
        let section = checker.section("arm");
        let height_m = section.float_or("camera_height_m", 0.2..=0.8, 0.5);
        let coupling = match Coupling::new(&Arm::puma_like(), height_m) {
            Ok(coupling) => coupling,
            Err(error) => {
                section.fault("camera_height_m", error);
                return None;
            }
        };
        let mut parameters = Parameters::for_coupling(&coupling);
        let [speed, _] = [parameters.max_speed_rad_per_s[0], parameters.max_speed_rad_per_s[1]];
        let speeds =
            section.floats_or("max_speed_rad_per_s", 2, 0.01..=speed, &parameters.max_speed_rad_per_s);
        parameters.max_speed_rad_per_s = [speeds[0], speeds[1]];
        let accelerations = section.floats_or(
            "max_acceleration_rad_per_s2",
            2,
            0.1..=50.0,
            &parameters.max_acceleration_rad_per_s2,
        );
        parameters.max_acceleration_rad_per_s2 = [accelerations[0], accelerations[1]];
        let watchdog_ms = section.float_or("watchdog_ms", 10.0..=2000.0, parameters.watchdog_ns as f64 / 1e6);
        parameters.watchdog_ns = (watchdog_ms * 1e6).round() as u64;
        parameters.max_tool_speed_m_per_s =
            section.float_or("max_tool_speed_m_per_s", 0.01..=10.0, REDUCED_TOOL_SPEED_M_PER_S);
        let rules = Rules {
            activation: section.choice_or(
                "activate",
                &[("automatic", Activation::Automatic), ("operator", Activation::Operator)],
                Activation::Operator,
            ),
            following_error_rad: section.float_or("following_error_rad", 0.001..=1.0, FOLLOWING_ERROR_RAD),
        };
        let cycles_per_frame =
            (camera.period_ns() / parameters.cycle_ns).clamp(1, MAX_CYCLES as u64) as usize;
        Some(Config { run, parameters, rules, coupling, cycles_per_frame })
    }
}
