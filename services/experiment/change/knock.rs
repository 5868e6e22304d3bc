//! The camera is knocked while the hand follows the vehicle.

use super::cases::{COLOURS, Case, KNOCKS};
use crate::cli::Experiment;
use crate::experiment::figures::{Spread, spread};
use crate::experiment::over_seeds;
use crate::svg::{Mark, Plot, Series};
use pursuit_messages::Phase;
use pursuit_simulator::journal::Record;
use serde::Serialize;

/// Tracking before the knock, s.
const BEFORE_S: f64 = 10.0;
/// Windows after it, s.
const WINDOWS_S: [[f64; 2]; 5] = [[0.0, 2.0], [2.0, 5.0], [5.0, 10.0], [10.0, 20.0], [20.0, 30.0]];
/// The paper's rate.
const RATE_HZ: f64 = 12.5;
/// A hand that is nearer than this in the last window has recovered, cm: the paper's accuracy.
const RECOVERED_CM: f64 = 2.0;

/// How following goes on after one knock.
#[derive(Clone, Debug, Serialize)]
pub struct Knocked {
    change: &'static str,
    seeds: u64,
    /// RMS distance in the 5 s before it.
    before_cm: Spread,
    windows_s: [[f64; 2]; 5],
    /// RMS distance in the windows after it.
    rms_cm: [Spread; 5],
    /// Share of the frames after it, of all seeds, in which the target was not in the image.
    out_of_view_share: f64,
    /// Share of the seeds with an RMS below 2 cm in the last window.
    recovered_share: f64,
}

/// One run as times since the knock, s, and distances, cm.
struct Run {
    frames: Vec<Frame>,
}

struct Frame {
    since_s: f64,
    error_cm: f64,
    in_view: bool,
}

/// All knocks; the figures and the plot.
///
/// # Errors
/// A run fails.
pub fn run(options: &Experiment) -> Result<(Vec<Knocked>, String), String> {
    println!("  knocked {BEFORE_S} s after the begin of tracking; circle, 0.15 m/s, 12.5 Hz, 80 ms");
    println!(
        "  {:<14} {:>13}   {:<66} {:>11} {:>10}   prototype",
        "", "before", "RMS cm in 0-2, 2-5, 5-10, 10-20, 20-30 s after it", "out of view", "under 2 cm"
    );
    let last_s = WINDOWS_S[WINDOWS_S.len() - 1][1];
    let frames = ((BEFORE_S + last_s) * RATE_HZ).ceil() as u64 + 1;
    let (mut figures, mut series) = (Vec::new(), Vec::new());
    for (case, colour) in KNOCKS.iter().zip(COLOURS).filter(|(case, _)| case.is_wanted(&options.scenes)) {
        let mut set = case.settings("tracking", BEFORE_S);
        set.push(format!("camera.rate_hz={RATE_HZ:?}"));
        set.push(format!("simulator.frames={frames}"));
        set.extend(["vehicle.path=circle", "vehicle.speed_m_per_s=0.15"].map(str::to_owned));
        let runs: Result<Vec<Run>, String> = over_seeds(options, &set)?
            .iter()
            .map(|(seed, run)| Run::of(&run.records).ok_or_else(|| format!("seed {seed}: never knocked")))
            .collect();
        let runs = runs?;
        let knocked = Knocked::of(case, &runs);
        print_row(&knocked, case);
        figures.push(knocked);
        series.push(curve(case.name, colour, &runs));
    }
    Ok((figures, plot(series).svg()))
}

impl Run {
    /// `None` where there was no change.
    fn of(records: &[Record]) -> Option<Run> {
        let knock_s = records.iter().find(|record| record.changed == 1)?.time_s;
        let tracking = records.iter().filter(|record| record.phase == Phase::Tracking as u32);
        let frame = |record: &Record| Frame {
            since_s: record.time_s - knock_s,
            error_cm: record.error_cm(),
            in_view: record.in_view == 1,
        };
        Some(Run { frames: tracking.map(frame).collect() })
    }

    fn within(&self, [from_s, to_s]: [f64; 2]) -> impl Iterator<Item = &Frame> {
        self.frames.iter().filter(move |frame| from_s <= frame.since_s && frame.since_s < to_s)
    }

    fn rms_cm(&self, window_s: [f64; 2]) -> f64 {
        let count = self.within(window_s).count() as f64;
        (self.within(window_s).map(|frame| frame.error_cm * frame.error_cm).sum::<f64>() / count).sqrt()
    }
}

impl Knocked {
    fn of(case: &Case, runs: &[Run]) -> Knocked {
        let rms = |window: [f64; 2]| spread(runs.iter().map(|run| run.rms_cm(window)));
        let last = WINDOWS_S[WINDOWS_S.len() - 1];
        let after = || runs.iter().flat_map(|run| run.within([0.0, last[1]]));
        let recovered = runs.iter().filter(|run| run.rms_cm(last) < RECOVERED_CM).count();
        Knocked {
            change: case.name,
            seeds: runs.len() as u64,
            before_cm: rms([-5.0, 0.0]),
            windows_s: WINDOWS_S,
            rms_cm: WINDOWS_S.map(rms),
            out_of_view_share: after().filter(|frame| !frame.in_view).count() as f64 / after().count() as f64,
            recovered_share: recovered as f64 / runs.len() as f64,
        }
    }
}

fn print_row(knocked: &Knocked, case: &Case) {
    let windows: Vec<String> =
        knocked.rms_cm.iter().map(|spread| format!("{:>5.2} /{:>5.1}", spread.p50, spread.p90)).collect();
    println!(
        "  {:<14} {:>5.2} / {:>5.2}   {:<66} {:>9.1} % {:>8.0} %   {}",
        knocked.change,
        knocked.before_cm.p50,
        knocked.before_cm.p90,
        windows.join("  "),
        100.0 * knocked.out_of_view_share,
        100.0 * knocked.recovered_share,
        case.prototype_in_the_middle
    );
}

/// Median distance over the seeds, frame by frame.
fn curve(name: &str, colour: &'static str, runs: &[Run]) -> Series {
    let shortest = runs.iter().map(|run| run.frames.len()).min().unwrap_or(0);
    let first = runs.first().map_or(&[][..], |run| &run.frames);
    let median = |k: usize| spread(runs.iter().map(|run| run.frames[k].error_cm)).p50;
    let points = first[..shortest].iter().enumerate().map(|(k, frame)| [frame.since_s, median(k)]);
    let seen = points.filter(|point| point[0] >= -5.0).collect();
    Series { name: name.to_owned(), colour, points: seen, mark: Mark::Line }
}

fn plot(series: Vec<Series>) -> Plot {
    Plot {
        title: "Following after a knock: distance, median over seeds".to_owned(),
        x_label: "s since the knock".to_owned(),
        y_label: "cm".to_owned(),
        equal_axes: false,
        log_y: true,
        series,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(frame: u64, error_m: f64) -> Record {
        Record {
            frame,
            time_s: 100.0 + 0.08 * frame as f64,
            phase: Phase::Tracking as u32,
            camera_m: [0.5, 0.0],
            target_m: [0.5, error_m],
            in_view: u32::from(error_m < 0.5),
            changed: u32::from(frame >= 125),
            ..Record::default()
        }
    }

    /// 10 s at 1 cm; after the knock 2 s at 60 cm (out of view), then 3 cm, from 20 s on 1.5 cm.
    fn records() -> Vec<Record> {
        let error_m = |frame: u64| match frame {
            0..125 => 0.01,
            125..150 => 0.6,
            150..375 => 0.03,
            _ => 0.015,
        };
        (0..501).map(|frame| record(frame, error_m(frame))).collect()
    }

    #[test]
    fn windows_count_from_the_first_frame_after_the_knock() {
        let run = Run::of(&records()).unwrap();
        let rms = WINDOWS_S.map(|window| run.rms_cm(window));
        for (is, wanted) in rms.into_iter().zip([60.0, 3.0, 3.0, 3.0, 1.5]) {
            assert!((is - wanted).abs() < 1e-9, "{rms:?}");
        }
        let knocked = Knocked::of(&KNOCKS[1], &[run]);
        assert!((knocked.before_cm.p50 - 1.0).abs() < 1e-9);
        assert!((knocked.out_of_view_share - 25.0 / 375.0).abs() < 1e-9);
        assert_eq!(knocked.recovered_share, 1.0);
    }

    #[test]
    fn a_run_without_a_knock_is_none() {
        let calm: Vec<Record> = records().into_iter().take(100).collect();
        assert!(Run::of(&calm).is_none());
    }
}
