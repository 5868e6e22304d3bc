//! `pursuit experiment tracking`: how far the hand is from the vehicle while it follows.

use super::figures::{Spread, spread, spread_text};
use super::{over_seeds, publish, report, seeds_text, settled};
use crate::check;
use crate::cli::Experiment;
use crate::report::{APPROACH_S, PAPER_TRACKING_CM, Report};
use crate::svg::{Mark, Plot, Series};
use serde::Serialize;

/// Frames of tracking per run, at 12.5 Hz: 30 s, of which 3 s are the approach.
const TRACKING_FRAMES: u64 = 375;
/// The paper's rate for tracking.
const TRACKING_RATE_HZ: f64 = 12.5;

#[derive(Clone, Debug, Serialize)]
struct Tracked {
    path: String,
    speed_m_per_s: f64,
    rate_hz: f64,
    latency_ms: f64,
    controller: &'static str,
    seeds: u64,
    rms_cm: Spread,
    median_cm: Spread,
    max_cm: Spread,
    detected_share: Spread,
    lost_share: f64,
    trajectory_sha256: Vec<Option<String>>,
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
    println!("following the camouflaged vehicle, seeds {}", seeds_text(options));
    println!(
        "distance from the camera's axis to the vehicle, without the first {APPROACH_S} s; median / p90"
    );
    println!("the paper (1994): in the order of {PAPER_TRACKING_CM} cm\n");
    println!(
        "  {:<11} {:>18} {:>18} {:>20} {:>20} {:>12}",
        "controller", "RMS", "median", "worst frame", "detection used", "> 20 cm off"
    );
    let (mut figures, mut curves) = (Vec::new(), Vec::new());
    for (controller, colour) in [("plain", "#009e73"), ("predictive", "#0072b2")] {
        let set = [
            format!("simulator.frames={TRACKING_FRAMES}"),
            format!("camera.rate_hz={TRACKING_RATE_HZ:?}"),
            format!("learner.controller={controller}"),
        ];
        let runs = over_seeds(options, &set)?;
        let checked = settled(options, &set, options.first_seed)?;
        let reports: Vec<Report> = runs.iter().map(|(seed, run)| report(*seed, run)).collect();
        let tracked = tracked(&checked, controller, &reports)?;
        println!(
            "  {:<11} {:>18} {:>18} {:>20} {:>20} {:>10.2} %",
            controller,
            spread_text(tracked.rms_cm, "cm"),
            spread_text(tracked.median_cm, "cm"),
            spread_text(tracked.max_cm, "cm"),
            spread_text(
                Spread { p50: 100.0 * tracked.detected_share.p50, p90: 100.0 * tracked.detected_share.p90 },
                "%"
            ),
            100.0 * tracked.lost_share
        );
        curves.push((controller, colour, reports));
        figures.push(tracked);
    }
    if let Some(run) = figures.first() {
        println!(
            "\n  {} at {} m/s, {} images per second, {} ms from command to motion",
            run.path, run.speed_m_per_s, run.rate_hz, run.latency_ms
        );
    }
    let plot = tracking_plot(&curves).svg();
    publish(options, &Figures { runs: figures }, "experiment-tracking.svg", &plot)
}

fn tracked(
    checked: &check::Checked,
    controller: &'static str,
    reports: &[Report],
) -> Result<Tracked, String> {
    let tracking: Vec<_> = reports.iter().filter_map(|r| r.tracking).collect();
    if tracking.len() < reports.len() {
        return Err("a run ended before it came to tracking".to_owned());
    }
    let cell = &checked.simulator.cell;
    let shares = spread(tracking.iter().map(|t| -t.detected_share));
    Ok(Tracked {
        path: format!("{:?}", cell.path).split(' ').next().unwrap_or_default().to_lowercase(),
        speed_m_per_s: cell.path.speed_m_per_s(),
        rate_hz: checked.acquisition.camera.rate_hz,
        latency_ms: cell.latency_ns as f64 / 1e6,
        controller,
        seeds: reports.len() as u64,
        rms_cm: spread(tracking.iter().map(|t| t.rms_cm)),
        median_cm: spread(tracking.iter().map(|t| t.median_cm)),
        max_cm: spread(tracking.iter().map(|t| t.max_cm)),
        detected_share: Spread { p50: -shares.p50, p90: -shares.p90 },
        lost_share: tracking.iter().map(|t| t.lost_share).sum::<f64>() / tracking.len() as f64,
        trajectory_sha256: reports.iter().map(|r| r.trajectory_sha256.clone()).collect(),
    })
}

fn tracking_plot(curves: &[(&'static str, &'static str, Vec<Report>)]) -> Plot {
    let of = |reports: &[Report]| -> Vec<[f64; 2]> {
        reports.iter().filter_map(|r| Some([r.seed as f64, r.tracking?.rms_cm])).collect()
    };
    let mut series: Vec<Series> = curves
        .iter()
        .map(|(name, colour, reports)| Series {
            name: (*name).to_owned(),
            colour,
            points: of(reports),
            mark: Mark::Line,
        })
        .collect();
    let ends = series.first().map(|s| [s.points.first(), s.points.last()].map(|p| p.map_or(0.0, |p| p[0])));
    series.push(Series {
        name: "paper: in the order of 2 cm".to_owned(),
        colour: "#d55e00",
        points: ends.unwrap_or_default().map(|x| [x, PAPER_TRACKING_CM]).to_vec(),
        mark: Mark::Dashed,
    });
    Plot {
        title: "Following the vehicle: RMS distance per seed".to_owned(),
        x_label: "seed".to_owned(),
        y_label: "cm".to_owned(),
        equal_axes: false,
        log_y: true,
        series,
    }
}
