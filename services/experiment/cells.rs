//! Conditions of following, and one run under each: trained once per seed, then followed in many cells.
//!
//! What is learnt on the static blob does not depend on where a vehicle drives later, nor how fast, nor on
//! the latency (the learner waits until the arm is at rest): one training per seed, at the paper's 25 Hz,
//! serves all cells. Each of them begins with the arm at its start pose, and with homing.

use super::calibrated::Calibrated;
use super::settled;
use crate::check::Checked;
use crate::cli::Experiment;
use crate::inprocess::{self, Outcome};
use crate::parallel;
use crate::report::{Report, Tracking};
use pursuit_learner::step::Learner;
use pursuit_messages::Phase;
use pursuit_simulator::journal::Record;
use serde::Serialize;

/// Time followed in each run, s.
const FOLLOWED_S: f64 = 30.0;
/// The same at 100 Hz, where a second takes eight times as long to compute.
const FOLLOWED_FAST_S: f64 = 15.0;
/// What training is made with: the paper's sample every 40 ms.
const TRAINING: [&str; 2] = ["camera.rate_hz=25.0", "simulator.frames=1"];
/// Half the side of the square and half the width of the figure-eight: all of them is within the arm's
/// reach, which they are not around the circle of 0.2 m. A steered vehicle goes round the corners as sharply
/// as it can, on a radius of 14 cm at the least; the figure-eight, which it would leave, is driven on rails.
const SQUARE_M: f64 = 0.15;
/// Middle of the square.
const SQUARE_CENTRE_M: [f64; 2] = [0.62, 0.0];
/// A corner counts from the frame in which the vehicle is nearest to it, this near, m.
const AT_CORNER_M: f64 = 0.12;
/// The vehicle's way that a position of the camera is compared with: so long before and after, s.
const NEAR_S: f64 = 1.0;
/// Time after a corner that counts, s.
const AFTER_CORNER_S: f64 = 1.0;

/// Where, how fast, and with what it is followed.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Condition {
    /// As `vehicle.path`.
    pub path: String,
    /// Of the vehicle.
    pub speed_m_per_s: f64,
    /// Images per second.
    pub rate_hz: f64,
    /// From a command to its first effect.
    pub latency_ms: f64,
    /// `plain` and `predictive` with the learnt map; others as [`Calibrated`] has them.
    pub controller: &'static str,
}

/// One run.
pub struct Followed {
    /// What following came to.
    pub tracking: Tracking,
    /// The delay that was measured at the end.
    pub lead_ms: f64,
    /// Each corner of the square.
    pub corners: Vec<Corner>,
    /// Tracking frames of the first seed; of the others none.
    pub records: Vec<Record>,
    /// The trajectory as one number.
    pub trajectory_sha256: String,
}

/// One corner of the square.
pub struct Corner {
    /// Largest distance from the camera's axis to the vehicle after it.
    pub distance_cm: f64,
    /// How far the camera's axis went from the vehicle's way after it.
    pub overshoot_cm: f64,
}

impl Condition {
    /// The circle at 0.1 m/s, 12.5 images per second, 80 ms.
    pub fn is_the_papers(&self) -> bool {
        (self.path.as_str(), self.speed_m_per_s, self.rate_hz, self.latency_ms) == ("circle", 0.1, 12.5, 80.0)
    }

    fn settings(&self) -> Vec<String> {
        let Condition { path, speed_m_per_s, rate_hz, latency_ms, controller } = self;
        let seconds = if *rate_hz > 50.0 { FOLLOWED_FAST_S } else { FOLLOWED_S };
        let law = if *controller == "plain" { "plain" } else { "predictive" };
        let mut settings = vec![
            format!("vehicle.path={path}"),
            format!("vehicle.speed_m_per_s={speed_m_per_s:?}"),
            format!("camera.rate_hz={rate_hz:?}"),
            format!("simulator.latency_ms={latency_ms:?}"),
            format!("learner.controller={law}"),
            format!("simulator.frames={}", (seconds * rate_hz).round()),
        ];
        let half = match path.as_str() {
            "figure-eight" => {
                settings.push("vehicle.motion=exact".to_owned());
                Some(SQUARE_M)
            }
            "square" | "random-walk" => Some(SQUARE_M),
            _ => None,
        };
        if let Some(half) = half {
            settings.push(format!("vehicle.radius_m={half:?}"));
            settings.push(format!("vehicle.centre_m={SQUARE_CENTRE_M:?}"));
        }
        settings
    }
}

/// The conditions that are asked for: with no filter a selection that has every path, speed, rate and
/// latency in it; with filters all of their combinations, what is not named as in the paper.
///
/// # Errors
/// A controller that is not known.
pub fn conditions(options: &Experiment, controllers: &[&'static str]) -> Result<Vec<Condition>, String> {
    let mut wanted: Vec<&'static str> = controllers.to_vec();
    if !options.controllers.is_empty() {
        wanted.retain(|name| options.controllers.iter().any(|asked| asked == name));
    }
    if wanted.is_empty() {
        return Err(format!("--controllers: there are {}", controllers.join(", ")));
    }
    let filtered = !(options.paths.is_empty()
        && options.speeds.is_empty()
        && options.rates.is_empty()
        && options.latencies.is_empty());
    let cells = if filtered { product(options) } else { selection() };
    let with_each = |(path, speed_m_per_s, rate_hz, latency_ms): (String, f64, f64, f64)| {
        wanted.clone().into_iter().map(move |controller| Condition {
            path: path.clone(),
            speed_m_per_s,
            rate_hz,
            latency_ms,
            controller,
        })
    };
    Ok(cells.into_iter().flat_map(with_each).collect())
}

fn product(options: &Experiment) -> Vec<(String, f64, f64, f64)> {
    let or = |values: &[f64], usual: f64| if values.is_empty() { vec![usual] } else { values.to_vec() };
    let paths = if options.paths.is_empty() { vec!["circle".to_owned()] } else { options.paths.clone() };
    let mut cells = Vec::new();
    for path in paths {
        for &speed in &or(&options.speeds, 0.1) {
            for &rate in &or(&options.rates, 12.5) {
                for &latency in &or(&options.latencies, 80.0) {
                    cells.push((path.clone(), speed, rate, latency));
                }
            }
        }
    }
    cells
}

fn selection() -> Vec<(String, f64, f64, f64)> {
    let mut cells = Vec::new();
    for rate in [12.5, 25.0, 100.0] {
        cells.extend([0.05, 0.1, 0.2].map(|speed| ("circle".to_owned(), speed, rate, 80.0)));
    }
    cells.extend([0.0, 160.0].map(|latency| ("circle".to_owned(), 0.1, 12.5, latency)));
    cells.push(("circle".to_owned(), 0.2, 25.0, 0.0));
    for path in ["figure-eight", "square", "random-walk", "stop-and-go"] {
        cells.extend([0.1, 0.2].map(|speed| (path.to_owned(), speed, 12.5, 80.0)));
    }
    cells
}

/// One run for each seed and condition, in that order.
///
/// # Errors
/// In words, with the seed.
pub fn follow_all(options: &Experiment, conditions: &[Condition]) -> Result<Vec<Vec<Followed>>, String> {
    let results = parallel::map(options.seeds() as usize, usize::MAX, |index| {
        let seed = options.first_seed + index as u64;
        let learner = inprocess::train(&settled(options, &TRAINING.map(str::to_owned), seed)?)?;
        let follow = |condition: &Condition| follow(options, condition, &learner, seed);
        conditions.iter().map(follow).collect::<Result<Vec<Followed>, String>>()
    })?;
    let seeds = options.first_seed..;
    seeds.zip(results).map(|(seed, result)| result.map_err(|why| format!("seed {seed}: {why}"))).collect()
}

fn follow(
    options: &Experiment,
    condition: &Condition,
    trained: &Learner,
    seed: u64,
) -> Result<Followed, String> {
    let checked = settled(options, &condition.settings(), seed)?;
    let mut learner = trained.clone();
    learner.start_epoch();
    learner.set_parameters(&checked.learner.parameters);
    let (outcome, lead) = match Calibrated::named(condition.controller, &checked, &learner) {
        Some(mut calibrated) => {
            let outcome = inprocess::follow(&checked, &mut calibrated)?;
            (outcome, calibrated.lead())
        }
        None => {
            let outcome = inprocess::follow(&checked, &mut learner)?;
            (outcome, learner.lead())
        }
    };
    let mut followed = followed(&checked, outcome, seed)?;
    followed.lead_ms = 1e3 * lead.as_secs_f64();
    if condition.path == "square" {
        followed.corners = corners(&followed.records);
    }
    if seed != options.first_seed {
        followed.records.clear();
    }
    Ok(followed)
}

fn followed(checked: &Checked, outcome: Outcome, seed: u64) -> Result<Followed, String> {
    let tracking = Report::of(seed, &outcome.records, &outcome.moves).tracking;
    let tracking = tracking.ok_or_else(|| "a run ended before it came to tracking".to_owned())?;
    let mut records = outcome.records;
    records.retain(|record| record.phase == Phase::Tracking as u32);
    debug_assert_eq!(records.len() as u64, checked.simulator.cell.frames);
    Ok(Followed {
        tracking,
        lead_ms: 0.0,
        corners: Vec::new(),
        records,
        trajectory_sha256: outcome.trajectory_sha256,
    })
}

/// The corners that the vehicle passed, without those of the approach.
fn corners(records: &[Record]) -> Vec<Corner> {
    let [x, y] = SQUARE_CENTRE_M;
    let off = |record: &Record| {
        // By symmetry: from the nearest corner.
        let [u, v] = [record.target_m[0] - x, record.target_m[1] - y].map(|axis| axis.abs() - SQUARE_M);
        u.hypot(v)
    };
    let from_way_cm = |record: &Record| {
        let near = records.windows(2).filter(|ends| (ends[0].time_s - record.time_s).abs() < NEAR_S);
        100.0
            * near
                .map(|ends| distance_m(record.camera_m, &ends[0].target_m, &ends[1].target_m))
                .fold(1.0, f64::min)
    };
    let begin_s = records.first().map_or(0.0, |record| record.time_s) + crate::report::APPROACH_S;
    let at_corner = |three: &[Record]| {
        let [before, here, after] = [0, 1, 2].map(|k| off(&three[k]));
        here < AT_CORNER_M && here < before && here <= after && three[1].time_s >= begin_s
    };
    let mut corners = Vec::new();
    for (index, _) in records.windows(3).enumerate().filter(|(_, three)| at_corner(three)) {
        let from_s = records[index + 1].time_s;
        let after = || records[index + 1..].iter().take_while(|r| r.time_s <= from_s + AFTER_CORNER_S);
        corners.push(Corner {
            distance_cm: after().map(Record::error_cm).fold(0.0, f64::max),
            overshoot_cm: after().map(from_way_cm).fold(0.0, f64::max),
        });
    }
    corners
}

/// Distance of a point from the straight way between two.
fn distance_m(point: [f64; 2], from: &[f64; 2], to: &[f64; 2]) -> f64 {
    let way = [to[0] - from[0], to[1] - from[1]];
    let off = [point[0] - from[0], point[1] - from[1]];
    let squared = (way[0] * way[0] + way[1] * way[1]).max(f64::MIN_POSITIVE);
    let share = ((off[0] * way[0] + off[1] * way[1]) / squared).clamp(0.0, 1.0);
    (off[0] - share * way[0]).hypot(off[1] - share * way[1])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Round the upper right corner, the camera 2 cm beyond it at most and 3 cm off at most.
    #[test]
    fn a_corner_is_what_happens_in_the_second_after_it() {
        let [x, y] = [SQUARE_CENTRE_M[0] + SQUARE_M, SQUARE_CENTRE_M[1] + SQUARE_M];
        let record = |k: i32| {
            let way = 0.1 * 0.08 * f64::from(k - 60);
            let target_m = if way < 0.0 { [x, y + way] } else { [x - way, y] };
            let camera_m = match k {
                64 => [target_m[0], y + 0.02],
                65 => [target_m[0], y - 0.03],
                75 => [target_m[0], y + 0.5],
                _ => target_m,
            };
            Record { time_s: 0.08 * f64::from(k), target_m, camera_m, ..Record::default() }
        };
        let corners = corners(&(0..90).map(record).collect::<Vec<_>>());
        assert_eq!(corners.len(), 1);
        assert!((corners[0].overshoot_cm - 3.0).abs() < 1e-9 && (corners[0].distance_cm - 3.0).abs() < 1e-9);
    }
}
