//! How far the tool can travel after set-points are lost, from the config alone.

use crate::step::Driver;

/// Poses over the range of theta2 at which the geometry is looked at; it is smooth, and the ends are in.
const POSES: u32 = 64;

/// The worst case after a loss: full speed in the worst direction until the watchdog brakes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Travel {
    /// Highest speed of the camera over the table, m/s.
    pub speed_m_per_s: f64,
    /// From the exposure behind the last set-point to the begin of braking at the joints, s.
    pub reaction_s: f64,
    /// Way of the camera while the joints brake, m.
    pub braking_m: f64,
    /// From full speed to rest, s.
    pub braking_s: f64,
}

impl Travel {
    /// The worst case for what `driver` enforces; `latency_s` is the time from a command to its effect.
    pub fn worst(driver: &Driver, latency_s: f64) -> Travel {
        let (coupling, limits) = (driver.coupling(), driver.limits());
        let most = limits.map(|limits| limits.max_speed_rad_per_s());
        let ways = [0, 1].map(|axis| limits[axis].braking_distance_rad(most[axis]));
        let [low, high] = limits[1].position_rad();
        let (mut speed, mut arms) = (0.0f64, [0.0f64; 2]);
        for pose in 0..=POSES {
            let theta = [0.0, low + (high - low) * f64::from(pose) / f64::from(POSES)];
            for rates in [most, [most[0], -most[1]]] {
                speed = speed.max(length(coupling.camera_velocity(theta, rates)));
            }
            for (axis, arm) in arms.iter_mut().enumerate() {
                let unit = [0, 1].map(|other| if other == axis { 1.0 } else { 0.0 });
                *arm = arm.max(length(coupling.camera_velocity(theta, unit)));
            }
        }
        let parameters = driver.parameters();
        let cycle_s = parameters.cycle_ns as f64 * 1e-9;
        let speed = speed.min(parameters.max_tool_speed_m_per_s);
        let braking_s = [0, 1]
            .map(|axis| {
                (most[axis] / (limits[axis].max_acceleration_rad_per_s2() * cycle_s)).ceil() * cycle_s
            })
            .into_iter()
            .fold(0.0, f64::max);
        Travel {
            speed_m_per_s: speed,
            reaction_s: parameters.watchdog_ns as f64 * 1e-9 + latency_s + cycle_s,
            braking_m: (arms[0] * ways[0] + arms[1] * ways[1]).min(speed * braking_s),
            braking_s,
        }
    }

    /// The whole way, m.
    pub fn distance_m(&self) -> f64 {
        self.speed_m_per_s * self.reaction_s + self.braking_m
    }

    /// One line for people.
    pub fn text(&self) -> String {
        format!(
            "worst travel of the camera after a loss of set-points: {:.0} mm ({:.2} m/s for {:.0} ms, then {:.0} mm \
             of braking)",
            1e3 * self.distance_m(),
            self.speed_m_per_s,
            1e3 * self.reaction_s,
            1e3 * self.braking_m
        )
    }
}

fn length([x, y]: [f64; 2]) -> f64 {
    x.hypot(y)
}
