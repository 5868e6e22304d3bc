//! `pursuit experiment tracking`: how far the hand is from the vehicle while it follows.

use super::cells::{self, Condition, Followed};
use super::figures::{Spread, spread, spread_text};
use super::{publish, seeds_text, write_plot};
use crate::cli::Experiment;
use crate::plots;
use crate::report::{APPROACH_S, PAPER_TRACKING_CM};
use serde::Serialize;

/// What following came to under one condition, over all seeds.
#[derive(Clone, Debug, Serialize)]
struct Tracked {
    #[serde(flatten)]
    condition: Condition,
    seeds: u64,
    rms_cm: Spread,
    median_cm: Spread,
    max_cm: Spread,
    detected_share: Spread,
    lost_share: f64,
    lead_ms: Spread,
    corners: Option<Corners>,
    /// Of each seed: what was followed, as one number.
    trajectory_sha256: Vec<String>,
}

/// What happened at the corners of the square, over all corners of all seeds.
#[derive(Clone, Copy, Debug, Serialize)]
struct Corners {
    count: u64,
    /// Largest distance to the vehicle in the second after it was at the corner.
    distance_cm: Spread,
    /// How far the camera went from the vehicle's way in that second.
    overshoot_cm: Spread,
    overshoot_max_cm: f64,
}

/// Runs it.
///
/// # Errors
/// A run fails, or the figures cannot be written.
pub fn run(options: &Experiment) -> Result<u8, String> {
    #[derive(Serialize)]
    struct Figures {
        runs: Vec<Tracked>,
    }
    let conditions = cells::conditions(options, &["plain", "predictive"])?;
    println!(
        "following the camouflaged vehicle, seeds {}; trained once per seed, at 25 Hz",
        seeds_text(options)
    );
    println!("distance from the camera's axis to it, without the first {APPROACH_S} s; median / p90");
    println!("the paper (1994), at 0.1 m/s, 12.5 Hz, 80 ms: in the order of {PAPER_TRACKING_CM} cm\n");
    let followed = cells::follow_all(options, &conditions)?;
    println!(
        "  {:<13} {:>5} {:>6} {:>7} {:<11} {:>17} {:>17} {:>9} {:>7}",
        "path", "m/s", "Hz", "ms", "controller", "RMS", "worst frame", "> 20 cm", "lead ms"
    );
    let mut runs = Vec::new();
    for (index, condition) in conditions.iter().enumerate() {
        let of_all: Vec<&Followed> = followed.iter().map(|of_seed| &of_seed[index]).collect();
        let tracked = tracked(condition, &of_all);
        println!("{}", line(&tracked));
        runs.push(tracked);
    }
    let first: Vec<(&Condition, &Followed)> = conditions.iter().zip(&followed[0]).collect();
    let [figure6, figure7] = paper_figures(&first);
    write_plot(options, "experiment-tracking-figure6.svg", &figure6)?;
    publish(options, &Figures { runs }, "experiment-tracking-figure7.svg", &figure7)
}

fn line(run: &Tracked) -> String {
    let Condition { path, speed_m_per_s, rate_hz, latency_ms, controller } = &run.condition;
    let mut text = format!(
        "  {path:<13} {speed_m_per_s:>5} {rate_hz:>6} {latency_ms:>7} {controller:<11} {:>17} {:>17} {:>7.2} % {:>7.0}",
        spread_text(run.rms_cm, "cm"),
        spread_text(run.max_cm, "cm"),
        100.0 * run.lost_share,
        run.lead_ms.p50,
    );
    if let Some(corners) = run.corners {
        text += &format!(
            "\n      {} corners: {} off in the second after, from its way {}, at most {:.2} cm",
            corners.count,
            spread_text(corners.distance_cm, "cm"),
            spread_text(corners.overshoot_cm, "cm"),
            corners.overshoot_max_cm
        );
    }
    text
}

fn tracked(condition: &Condition, of_all: &[&Followed]) -> Tracked {
    let of = |value: fn(&Followed) -> f64| spread(of_all.iter().map(|followed| value(followed)));
    let detected = of(|followed| -followed.tracking.detected_share);
    let passed = || of_all.iter().flat_map(|followed| &followed.corners);
    Tracked {
        condition: condition.clone(),
        seeds: of_all.len() as u64,
        rms_cm: of(|followed| followed.tracking.rms_cm),
        median_cm: of(|followed| followed.tracking.median_cm),
        max_cm: of(|followed| followed.tracking.max_cm),
        detected_share: Spread { p50: -detected.p50, p90: -detected.p90 },
        lost_share: of_all.iter().map(|f| f.tracking.lost_share).sum::<f64>() / of_all.len() as f64,
        lead_ms: of(|followed| followed.lead_ms),
        corners: (passed().count() > 0).then(|| Corners {
            count: passed().count() as u64,
            distance_cm: spread(passed().map(|corner| corner.distance_cm)),
            overshoot_cm: spread(passed().map(|corner| corner.overshoot_cm)),
            overshoot_max_cm: passed().map(|corner| corner.overshoot_cm).fold(0.0, f64::max),
        }),
        trajectory_sha256: of_all.iter().map(|followed| followed.trajectory_sha256.clone()).collect(),
    }
}

/// The paper's figures 6 and 7: with the condition nearest to the paper's own, the first seed.
fn paper_figures(of_first_seed: &[(&Condition, &Followed)]) -> [String; 2] {
    let wanted = |controller: &str| {
        let of_it = of_first_seed.iter().filter(|(condition, _)| condition.controller == controller);
        of_it.max_by_key(|(condition, _)| condition.is_the_papers()).map(|(_, followed)| &followed.records)
    };
    let empty = Vec::new();
    let records = wanted("predictive").or(wanted("plain")).unwrap_or(&empty);
    plots::following(records)
}
