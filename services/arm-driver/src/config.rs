//! Section `[arm]`.

use crate::step::Parameters;
use pursuit_config::Checker;
use pursuit_kinematics::{Arm, Coupling};
use pursuit_messages::MAX_CYCLES;
use pursuit_runtime::settings;

/// What the arm driver needs.
#[derive(Clone, Debug)]
pub struct Config {
    /// Section `[run]`.
    pub run: settings::Run,
    /// Limits and watchdog.
    pub parameters: Parameters,
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
        let cycles_per_frame =
            (camera.period_ns() / parameters.cycle_ns).clamp(1, MAX_CYCLES as u64) as usize;
        Some(Config { run, parameters, coupling, cycles_per_frame })
    }
}
