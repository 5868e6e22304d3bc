//! The report of a run: pure, from the journal's records to figures, JSON and text.

use pursuit_learner::refusals::Refused;
use pursuit_messages::HOPS;
use pursuit_messages::{LearnerState, Phase};
use pursuit_simulator::journal::{MoveRecord, Record};
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt::Write as _;

/// Tracking begins with the vehicle somewhere in view: the first seconds are the approach and do not
/// count as following (section 6 of the design notes on the learner leaves out the same time).
pub const APPROACH_S: f64 = 3.0;
/// The paper, section 3: "in about 5 moves [...] a precision of approximately 3 cm".
pub const PAPER_MOVES_TO_3_CM: u32 = 5;
/// The paper, section 4: "the accuracy of the total system [...] is in the order of 2 cm".
pub const PAPER_TRACKING_CM: f64 = 2.0;

/// What a run came to.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Report {
    /// Seed of the run.
    pub seed: u64,
    /// Frames answered, all phases.
    pub frames: u64,
    /// How it learnt.
    pub learning: Learning,
    /// How it followed; `None` where it did not come to it.
    pub tracking: Option<Tracking>,
    /// Frames answered per second of wall-clock time; `None` where no time was taken.
    pub rate_hz: Option<f64>,
    /// Simulated seconds per second of wall-clock time.
    pub times_real_time: Option<f64>,
    /// Computing time per hop and from exposure to command.
    pub latency_us: BTreeMap<String, Latency>,
    /// Restarts of services.
    pub restarts: u32,
    /// What the learner came to; `None` where its state was not kept.
    pub learner: Option<Learnt>,
    /// The whole trajectory as one number; lock-step only.
    pub trajectory_sha256: Option<String>,
}

/// The learner at the end of a run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Learnt {
    /// Samples learnt from.
    pub samples: u64,
    /// Samples kept.
    pub ring: u32,
    /// Refits taken over, and dropped because they were not better.
    pub refits: [u32; 2],
    /// Changes of the cell that were noticed.
    pub changes: u32,
    /// How far the joints' clock was found to be ahead of the camera's, ms.
    pub clock_offset_ms: f64,
    /// Delay that is predicted over, ms.
    pub lead_ms: f64,
    /// What was not used, by reason; only what there was.
    pub refused: BTreeMap<&'static str, u64>,
}

impl Learnt {
    /// Of what the learner says of itself.
    pub fn of(state: &LearnerState) -> Learnt {
        let refused = Refused::ALL.map(|(reason, words)| (words, state.refused[reason as usize]));
        Learnt {
            samples: state.samples,
            ring: state.ring,
            refits: [state.refits_merged, state.refits_rejected],
            changes: state.changes,
            clock_offset_ms: state.clock_offset_ns as f64 * 1e-6,
            lead_ms: state.lead_ns as f64 * 1e-6,
            refused: refused.into_iter().filter(|(_, count)| *count > 0).collect(),
        }
    }
}

/// How the network learnt.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Learning {
    /// Every move.
    pub moves: Vec<Move>,
    /// First move after which the one-shot error stays below 3 cm.
    pub moves_to_3cm: Option<u32>,
    /// First move after which the one-shot error stays below 1 cm.
    pub moves_to_1cm: Option<u32>,
    /// Moves until the camera was within 3 cm of the first target.
    pub first_target_moves_to_3cm: Option<u32>,
}

/// One move.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Move {
    /// Median one-shot error after it over the evaluation grid, cm: how far one single move would end
    /// from a target anywhere in view.
    pub error_cm: f64,
    /// 90th percentile over the grid, cm.
    pub error_p90_cm: f64,
    /// Where this move itself ended, cm from its target.
    pub arrived_cm: f64,
    /// The target it went to.
    pub target: u32,
}

/// Horizontal distance from the camera's axis to the vehicle after the approach.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Tracking {
    /// Half of the frames are better, cm.
    pub median_cm: f64,
    /// Root mean square, cm.
    pub rms_cm: f64,
    /// Worst frame, cm.
    pub max_cm: f64,
    /// Share of the frames in which the target was detected.
    pub detected_share: f64,
    /// Frames that count.
    pub frames: u64,
    /// Share of the frames in which the target is more than 20 cm away.
    pub lost_share: f64,
}

/// Percentiles of a time, µs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Latency {
    /// Median.
    pub p50: f64,
    /// 99th percentile.
    pub p99: f64,
    /// Median of the waiting time before it.
    pub wait_p50: f64,
    /// 99th percentile of the waiting time before it.
    pub wait_p99: f64,
}

/// A target this far away, m, is lost: half of what the camera sees to each side is 0.5 m.
const LOST_CM: f64 = 20.0;

impl Report {
    /// The report of a run's records; times that records do not know are filled in by the caller.
    pub fn of(seed: u64, records: &[Record], moves: &[MoveRecord]) -> Report {
        Report {
            seed,
            frames: records.len() as u64,
            learning: Learning::of(moves),
            tracking: Tracking::of(records),
            rate_hz: None,
            times_real_time: None,
            latency_us: latencies(records),
            restarts: 0,
            learner: None,
            trajectory_sha256: None,
        }
    }

    /// Notes how long the run took.
    pub fn took(&mut self, wall_s: f64, simulated_s: f64) {
        if wall_s > 0.0 {
            self.rate_hz = Some(self.frames as f64 / wall_s);
            self.times_real_time = Some(simulated_s / wall_s);
        }
    }

    /// The report for people, the paper's figure beside each of ours.
    pub fn text(&self) -> String {
        let mut text = String::new();
        let moves = |n: Option<u32>| n.map_or_else(|| "not reached".to_owned(), |n| format!("{n} moves"));
        let mut row = |what: &str, ours: String, paper: &str| {
            let _ = writeln!(text, "  {what:<46} {ours:>18}   {paper}");
        };
        row("", "here".to_owned(), "the paper (1994)");
        row("learning, anywhere in view, to 3 cm", moves(self.learning.moves_to_3cm), "about 5 moves");
        row("learning, anywhere in view, to 1 cm", moves(self.learning.moves_to_1cm), "-");
        if let Some(last) = self.learning.moves.last() {
            row("one-shot error after the last move", format!("{:.2} cm", last.error_cm), "-");
        }
        if let Some(tracking) = &self.tracking {
            row("following, distance to the vehicle, median", format!("{:.2} cm", tracking.median_cm), "-");
            row("following, RMS", format!("{:.2} cm", tracking.rms_cm), "in the order of 2 cm");
            row("following, worst frame", format!("{:.2} cm", tracking.max_cm), "-");
            row("vehicle detected in", format!("{:.1} % of frames", 100.0 * tracking.detected_share), "-");
        }
        if let Some(learner) = &self.learner {
            let Learnt { samples, ring, refits: [taken, dropped], .. } = learner;
            row("samples learnt from, and kept", format!("{samples}, {ring}"), "all, 100");
            row("refits taken, and dropped as no better", format!("{taken}, {dropped}"), "-");
            row(
                "clock offset found, delay predicted over",
                format!("{:.1}, {:.0} ms", learner.clock_offset_ms, learner.lead_ms),
                "-",
            );
            row("changes of the cell noticed", learner.changes.to_string(), "-");
            row("not learnt from", learner.refused.values().sum::<u64>().to_string(), "-");
            for (words, count) in &learner.refused {
                row(&format!("  {words}"), count.to_string(), "");
            }
        }
        if let Some(rate) = self.rate_hz {
            row("frames per second", format!("{rate:.0}"), "12.5");
        }
        if let Some(times) = self.times_real_time {
            row("times real time", format!("{times:.1}"), "1");
        }
        let _ = writeln!(
            text,
            "\n  {:<22} {:>11} {:>11} {:>11} {:>11}",
            "µs", "compute p50", "p99", "wait p50", "p99"
        );
        for (name, latency) in ordered(&self.latency_us) {
            let Latency { p50, p99, wait_p50, wait_p99 } = latency;
            let _ = writeln!(text, "  {name:<22} {p50:>11.0} {p99:>11.0} {wait_p50:>11.0} {wait_p99:>11.0}");
        }
        text
    }
}

const END_TO_END: &str = "end_to_end";

fn ordered(latencies: &BTreeMap<String, Latency>) -> impl Iterator<Item = (&str, &Latency)> {
    let names = HOPS.iter().map(|hop| hop.name()).chain([END_TO_END]);
    names.filter_map(|name| latencies.get(name).map(|latency| (name, latency)))
}

impl Learning {
    fn of(moves: &[MoveRecord]) -> Learning {
        let errors: Vec<f64> = moves.iter().map(|m| m.error_cm).collect();
        let first_target = moves.iter().take_while(|m| m.target_index == 0);
        Learning {
            moves_to_3cm: moves_to(&errors, 3.0),
            moves_to_1cm: moves_to(&errors, 1.0),
            first_target_moves_to_3cm: first_target.clone().find(|m| m.arrived_cm < 3.0).map(|m| m.number),
            moves: moves
                .iter()
                .map(|m| Move {
                    error_cm: m.error_cm,
                    error_p90_cm: m.error_p90_cm,
                    arrived_cm: m.arrived_cm,
                    target: m.target_index,
                })
                .collect(),
        }
    }
}

/// First move after which the error is below `limit` on two moves running.
pub fn moves_to(errors_cm: &[f64], limit: f64) -> Option<u32> {
    errors_cm
        .windows(2)
        .position(|pair| pair.iter().all(|error| *error < limit))
        .map(|index| index as u32 + 1)
}

impl Tracking {
    fn of(records: &[Record]) -> Option<Tracking> {
        let tracking: Vec<&Record> = records.iter().filter(|r| r.phase == Phase::Tracking as u32).collect();
        let start = tracking.first()?.time_s;
        let span = tracking.last()?.time_s - start;
        let approach = APPROACH_S.min(span / 2.0);
        let counted: Vec<&Record> = tracking.into_iter().filter(|r| r.time_s - start >= approach).collect();
        let mut errors: Vec<f64> = counted.iter().map(|r| r.error_cm()).collect();
        errors.sort_by(f64::total_cmp);
        let count = errors.len() as f64;
        let share = |hits: usize| hits as f64 / count;
        Some(Tracking {
            median_cm: percentile(&errors, 0.5),
            rms_cm: (errors.iter().map(|e| e * e).sum::<f64>() / count).sqrt(),
            max_cm: *errors.last()?,
            detected_share: share(counted.iter().filter(|r| r.detected == 1).count()),
            frames: counted.len() as u64,
            lost_share: share(errors.iter().filter(|e| **e > LOST_CM).count()),
        })
    }
}

fn latencies(records: &[Record]) -> BTreeMap<String, Latency> {
    let mut latencies = BTreeMap::new();
    for (index, hop) in HOPS.iter().enumerate() {
        let compute = sorted(records.iter().map(|r| r.compute_us[index]));
        let wait = sorted(records.iter().map(|r| r.wait_us[index]));
        latencies.insert(hop.name().to_owned(), Latency::of(&compute, &wait));
    }
    let whole = sorted(records.iter().map(|r| r.end_to_end_us));
    latencies.insert(END_TO_END.to_owned(), Latency::of(&whole, &[]));
    latencies
}

impl Latency {
    fn of(compute: &[f64], wait: &[f64]) -> Latency {
        Latency {
            p50: percentile(compute, 0.5),
            p99: percentile(compute, 0.99),
            wait_p50: percentile(wait, 0.5),
            wait_p99: percentile(wait, 0.99),
        }
    }
}

fn sorted(values: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values
}

/// The value that a `share` of the sorted values does not exceed; 0 where there is none.
pub fn percentile(sorted: &[f64], share: f64) -> f64 {
    let last = sorted.len().saturating_sub(1) as f64;
    sorted.get((last * share).round() as usize).copied().unwrap_or(0.0)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn record(frame: u64, phase: Phase, error_m: f64, detected: u32) -> Record {
        Record {
            frame,
            time_s: frame as f64 * 0.04,
            phase: phase as u32,
            detected,
            camera_m: [0.5, 0.1],
            target_m: [0.5 + error_m, 0.1],
            ..Record::default()
        }
    }

    #[test]
    fn two_moves_running_must_be_below() {
        assert_eq!(moves_to(&[9.0, 2.0, 4.0, 2.9, 2.8, 1.0], 3.0), Some(4));
        assert_eq!(moves_to(&[9.0, 2.0], 3.0), None);
        assert_eq!(moves_to(&[], 3.0), None);
    }

    #[test]
    fn the_approach_does_not_count() {
        let mut records: Vec<Record> = (0..75).map(|k| record(k, Phase::Tracking, 0.3, 0)).collect();
        records.extend((75..175).map(|k| record(k, Phase::Tracking, 0.02, 1)));
        let tracking = Tracking::of(&records).unwrap();
        assert!((tracking.rms_cm - 2.0).abs() < 1e-9 && (tracking.max_cm - 2.0).abs() < 1e-9);
        assert_eq!((tracking.frames, tracking.detected_share), (100, 1.0));
    }

    #[test]
    fn training_frames_are_not_tracking() {
        let records = [record(0, Phase::Training, 0.3, 1), record(1, Phase::Homing, 0.3, 0)];
        assert!(Tracking::of(&records).is_none());
    }

    #[test]
    fn percentiles_of_known_values() {
        let values: Vec<f64> = (1..=101).map(f64::from).collect();
        assert_eq!((percentile(&values, 0.5), percentile(&values, 0.99)), (51.0, 100.0));
        assert_eq!(percentile(&[], 0.5), 0.0);
    }
}
