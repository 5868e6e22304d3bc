//! `pursuit experiment stopping`: how long and how far the hand goes on after a fault, like a robot maker's
//! table (EN ISO 10218-1, annex B): speed by kind of fault, median and worst, beside the bound that `pursuit up`
//! prints.
//!
//! Guard, limits, drives and dynamics are the service's and the simulator's own; set-points come from a stream as a
//! learner sends it, at a pace that the experiment chooses. A tick is a drive cycle, as on the wall clock.

use super::settled;
use crate::check::Checked;
use crate::cli::Experiment;
use crate::parallel;
use crate::up::write_json;
use pursuit_arm_driver::arm::Reading;
use pursuit_arm_driver::guard::{Guard, Turn};
use pursuit_arm_driver::safety::{Chain, Latch, Travel};
use pursuit_arm_driver::step::{Driver, Drives};
use pursuit_messages::{SetPoint, Stamp, WorldState};
use pursuit_runtime::exit;
use pursuit_simulator::cell::{Cell, Fixed};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use serde::Serialize;

/// Images per second of the stream.
const RATE_HZ: f64 = 25.0;
/// From exposure to set-point, ns: what the services take, in whole cycles.
const PIPELINE_NS: u64 = 10_000_000;
/// By then the arm has its speed, ns.
const UP_TO_SPEED_NS: u64 = 600_000_000;
/// By then any arm is at rest, ns.
const LIMIT_NS: u64 = 2_500_000_000;
/// Slower than this is at rest, rad/s.
const REST_RAD_PER_S: f64 = 0.01;
/// Shares of the joints' highest speeds, %.
const SHARES: [u32; 3] = [33, 66, 100];

/// What happens.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Fault {
    /// The camera's process is killed: no exposure any more; what was seen before is still answered.
    Kill,
    /// The learner hangs: no set-point any more.
    Hang,
    /// The camera repeats itself: until that is found its images are followed.
    Frozen,
    /// An emergency stop.
    EmergencyStop,
    /// The drives hear no command any more.
    BusLoss,
}

const FAULTS: [(Fault, &str); 5] = [
    (Fault::Kill, "kill (acquisition)"),
    (Fault::Hang, "hang (learner)"),
    (Fault::Frozen, "frozen frames"),
    (Fault::EmergencyStop, "emergency stop"),
    (Fault::BusLoss, "bus loss"),
];

#[derive(Clone, Copy, Debug, Serialize)]
struct Typical {
    p50: f64,
    max: f64,
}

#[derive(Clone, Debug, Serialize)]
struct Row {
    fault: &'static str,
    share_percent: u32,
    /// Highest speed of the hand when it happened, m/s.
    speed_m_per_s: f64,
    /// From the fault to rest, ms.
    time_ms: Typical,
    /// Way of the hand from the fault to rest, mm.
    distance_mm: Typical,
    /// What the config bounds it by, mm.
    bound_mm: f64,
}

/// One stop.
#[derive(Clone, Copy, Debug)]
struct Stop {
    speed_m_per_s: f64,
    time_ms: f64,
    distance_mm: f64,
}

/// Runs it.
///
/// # Errors
/// A run fails, or the figures cannot be written.
pub fn run(options: &Experiment) -> Result<u8, String> {
    #[derive(Serialize)]
    struct Figures {
        runs: u64,
        rows: Vec<Row>,
    }
    let set = [format!("camera.rate_hz={RATE_HZ:?}"), "run.clock=wall".to_owned()];
    let runs = options.seeds();
    let checked = settled(options, &set, options.first_seed)?;
    let driver = driver(&checked)?;
    let travel = Travel::worst(&driver, checked.simulator.cell.latency_ns as f64 * 1e-9);
    println!(
        "{}\n{runs} runs each, from another pose and at another moment; median / worst\n",
        travel.text()
    );
    println!(
        "  {:<20} {:>7} {:>12} {:>18} {:>20} {:>10}",
        "fault", "speed", "hand", "time to rest", "way to rest", "bound"
    );
    let mut rows = Vec::new();
    for (fault, name) in FAULTS {
        for share_percent in SHARES {
            let stops = parallel::map(runs as usize, usize::MAX, |index| {
                let seed = options.first_seed + index as u64;
                settled(options, &set, seed).and_then(|checked| stop(&checked, fault, share_percent, seed))
            })?;
            let stops: Vec<Stop> = stops.into_iter().collect::<Result<_, _>>()?;
            let row = Row {
                fault: name,
                share_percent,
                speed_m_per_s: stops.iter().fold(0.0, |most, stop| stop.speed_m_per_s.max(most)),
                time_ms: typical(stops.iter().map(|stop| stop.time_ms)),
                distance_mm: typical(stops.iter().map(|stop| stop.distance_mm)),
                bound_mm: 1e3 * bound_m(fault, &travel, &checked),
            };
            println!(
                "  {:<20} {:>5} % {:>8.2} m/s {:>15} ms {:>17} mm {:>7.0} mm",
                row.fault,
                row.share_percent,
                row.speed_m_per_s,
                format!("{:.0} / {:.0}", row.time_ms.p50, row.time_ms.max),
                format!("{:.0} / {:.0}", row.distance_mm.p50, row.distance_mm.max),
                row.bound_mm
            );
            rows.push(row);
        }
    }
    let within = rows.iter().all(|row| row.distance_mm.max <= row.bound_mm);
    println!("\n  {}", if within { "all within the bound" } else { "BEYOND THE BOUND" });
    let code = if within { exit::OK } else { exit::FAILED };
    let figures = Figures { runs, rows };
    Ok(code.max(options.json.as_deref().map_or(exit::OK, |file| write_json(file, &figures))))
}

fn driver(checked: &Checked) -> Result<Driver, String> {
    Driver::new(checked.arm.parameters, checked.arm.coupling).map_err(|error| error.to_string())
}

/// What the config bounds the way by, m.
fn bound_m(fault: Fault, travel: &Travel, checked: &Checked) -> f64 {
    // A stuck camera is believed until it is found, and then for what is left of a period.
    let believed_ns = checked.acquisition.frozen_ns + checked.simulator.cell.frame_period_ns;
    let more_s = if fault == Fault::Frozen { believed_ns as f64 * 1e-9 } else { 0.0 };
    travel.distance_m() + travel.speed_m_per_s * more_s
}

fn typical(values: impl Iterator<Item = f64>) -> Typical {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    let at = |index: usize| values.get(index).copied().unwrap_or(f64::NAN);
    Typical { p50: at(values.len() / 2), max: at(values.len().saturating_sub(1)) }
}

/// One run: up to speed, the fault at a moment of its own, and then until the hand rests.
fn stop(checked: &Checked, fault: Fault, share_percent: u32, seed: u64) -> Result<Stop, String> {
    let text = |error: &dyn std::fmt::Display| error.to_string();
    let cycle_ns = checked.arm.parameters.cycle_ns;
    let fixed = Fixed::new(&checked.simulator.cell).map_err(|e| text(&e))?;
    let mut cell = Cell::new(&fixed).map_err(|e| text(&e))?;
    let driver = driver(checked)?;
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let fault_ns = UP_TO_SPEED_NS + random.random_range(0..2 * checked.simulator.cell.frame_period_ns);
    let rates = rates(&driver, &cell.state(&fixed), f64::from(share_percent) / 100.0, &mut random);
    let mut guard = Guard::new(driver, Chain::new(checked.arm.rules, checked.arm.coupling.arm()));
    let believed_ns = fault_ns + checked.acquisition.frozen_ns;
    let mut stream: Vec<(u64, Stamp, SetPoint)> = Vec::new();
    let mut before = cell.state(&fixed);
    let (mut way_m, mut speed, mut rests_ns) = (0.0, 0.0f64, fault_ns);
    while cell.time_ns < fault_ns + LIMIT_NS {
        let now = cell.time_ns;
        let world = cell.state(&fixed);
        let frame = now / checked.simulator.cell.frame_period_ns;
        let is_exposed = match fault {
            Fault::Kill => now < fault_ns,
            Fault::Frozen => now < believed_ns,
            _ => true,
        };
        if now.is_multiple_of(checked.simulator.cell.frame_period_ns) && is_exposed {
            let stamp = Stamp::new(1, frame, now, checked.acquisition.camera.shape());
            // As a learner that knows the delay leads its set-points.
            let lead_s = checked.simulator.cell.latency_ns as f64 * 1e-9;
            let position = [0, 1].map(|axis| world.position[axis] + rates[axis] * lead_s);
            let point = SetPoint { follow: 1, position, velocity: rates, ..SetPoint::default() };
            stream.push((now + PIPELINE_NS, stamp, point));
        }
        let is_sent = |at: u64| at <= now && (fault != Fault::Hang || at < fault_ns);
        let given =
            stream.iter().rev().find(|(at, _, _)| is_sent(*at)).map(|(_, stamp, point)| (point, stamp));
        let reading = reading(&world);
        let (_, command) = guard.turn(&Turn {
            now_ns: now,
            reading: Some(&reading),
            given,
            latch: (fault == Fault::EmergencyStop && now >= fault_ns).then_some(Latch::Emergency),
            wish: None,
            looks: true,
            cycles: Some(1),
        });
        if let Some(command) = command.filter(|_| fault != Fault::BusLoss || now < fault_ns) {
            let point = given.map(|(point, _)| *point).unwrap_or_default();
            cell.take(&fixed, frame, &command.message(cycle_ns, point), None).map_err(|e| text(&e))?;
        }
        cell.advance(&fixed, now + cycle_ns).map_err(|e| text(&e))?;
        let after = cell.state(&fixed);
        let [dx, dy] = [0, 1].map(|axis| after.camera_position[axis] - before.camera_position[axis]);
        // The fault comes in the middle of a cycle.
        let share = ((cell.time_ns.saturating_sub(fault_ns)) as f64 / cycle_ns as f64).clamp(0.0, 1.0);
        way_m += dx.hypot(dy) * share;
        if cell.time_ns <= fault_ns {
            speed = dx.hypot(dy) / (cycle_ns as f64 * 1e-9);
        }
        let moves = after.velocity.iter().any(|velocity| velocity.abs() > REST_RAD_PER_S);
        if moves && cell.time_ns > fault_ns {
            rests_ns = cell.time_ns;
        }
        before = after;
    }
    Ok(Stop { speed_m_per_s: speed, time_ms: (rests_ns - fault_ns) as f64 * 1e-6, distance_mm: 1e3 * way_m })
}

/// Speeds of joints 1 and 2 in a direction of its own, with room ahead, rad/s.
fn rates(driver: &Driver, world: &WorldState, share: f64, random: &mut ChaCha8Rng) -> [f64; 2] {
    let limits = driver.limits();
    let inwards = [0, 1].map(|axis| {
        let [low, high] = limits[axis].position_rad();
        if world.position[axis] < (low + high) / 2.0 { 1.0 } else { -1.0 }
    });
    // Joint 2 has little room: at its full speed it would be through it before the fault comes.
    let most = limits.map(|limits| limits.max_speed_rad_per_s());
    [share * most[0] * inwards[0], share * most[1] * inwards[1] * random.random_range(0.0..0.15)]
}

fn reading(world: &WorldState) -> Reading {
    Reading {
        time_ns: world.time_ns,
        drives: Drives {
            position: world.position,
            velocity: world.velocity,
            issued_position: world.issued_position,
            issued_velocity: world.issued_velocity,
        },
        demanded: world.demanded_position,
        enabled: true,
        pressed: false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A few of the table's runs: each stops, within its bound, and an emergency stop before a loss is found.
    #[test]
    fn every_fault_ends_in_rest_within_its_bound() {
        let checked =
            crate::check::document(None, &["camera.rate_hz=25".to_owned(), "run.clock=wall".to_owned()])
                .and_then(|document| crate::check::all(&document))
                .unwrap();
        let travel =
            Travel::worst(&driver(&checked).unwrap(), checked.simulator.cell.latency_ns as f64 * 1e-9);
        let mut times = Vec::new();
        for (fault, name) in FAULTS {
            let stop = stop(&checked, fault, 100, 2001).unwrap();
            assert!(stop.speed_m_per_s > 0.5, "{name}: {stop:?}");
            assert!(stop.distance_mm > 10.0 && stop.distance_mm <= 1e3 * bound_m(fault, &travel, &checked));
            assert!(stop.time_ms > 10.0 && stop.time_ms < 700.0, "{name}: {stop:?}");
            times.push(stop.time_ms);
        }
        let [kill, hang, frozen, emergency, bus] = times[..] else { panic!("{times:?}") };
        assert!(emergency < hang && bus < hang && kill < frozen, "{times:?}");
    }
}
