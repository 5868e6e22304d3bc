//! What a run with faults came to.

use super::checker::Checker;
use super::plan::Fault;
use crate::cli::Chaos as Options;
use serde::Serialize;
use std::time::Duration;

/// A frame that was on its way when something happened was exposed up to so long before, ns.
const ON_ITS_WAY_NS: u64 = 60_000_000;
/// The first frame that a new process can answer is exposed up to so long after its first beat, ns.
const FIRST_NS: u64 = 60_000_000;
/// After so long a frame is answered or never will be, ns.
const SETTLED_NS: u64 = 1_000_000_000;
/// Answered in time, ns.
const IN_TIME_NS: u64 = 150_000_000;
/// Longest time from a fault to a new process that is looked for, ns.
const LONGEST_NS: u64 = 30_000_000_000;

/// A fault, and when.
pub struct Injected {
    /// Which.
    pub fault: Fault,
    /// When, CLOCK_MONOTONIC, ns.
    pub time_ns: u64,
    /// When a planned restart was answered, ns.
    pub answered_ns: Option<u64>,
    /// Why a planned restart was refused.
    pub refused: Option<String>,
}

impl Injected {
    /// One that has just been done.
    pub fn new(fault: Fault, time_ns: u64) -> Injected {
        Injected { fault, time_ns, answered_ns: None, refused: None }
    }
}

/// Of some numbers: median, 95 of 100, and the largest.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Spread {
    /// How many.
    pub count: usize,
    /// Half are not larger.
    pub p50: f64,
    /// 95 of 100 are not larger.
    pub p95: f64,
    /// The largest.
    pub max: f64,
}

impl Spread {
    fn of(mut numbers: Vec<f64>) -> Spread {
        numbers.sort_by(f64::total_cmp);
        let rank = |share: f64| {
            let at = (share * numbers.len() as f64).ceil() as usize;
            numbers.get(at.saturating_sub(1)).copied().unwrap_or_default()
        };
        Spread { count: numbers.len(), p50: rank(0.5), p95: rank(0.95), max: rank(1.0) }
    }
}

/// One fault, and what it cost.
#[derive(Clone, Debug, Serialize)]
pub struct Cost {
    /// Which.
    pub fault: String,
    /// After the first one, s.
    pub at_s: f64,
    /// Frames without an answer around it; `null` where others happened at the same time.
    pub unanswered: Option<usize>,
    /// From it to the first beat of the next process, ms.
    pub reborn_ms: Option<f64>,
}

/// All figures of a run.
#[derive(Clone, Debug, Serialize)]
pub struct Figures {
    /// Seed of the faults.
    pub seed: u64,
    /// How long it took, s.
    pub seconds: f64,
    /// Faults that were done.
    pub faults: usize,
    /// Things that must not have happened.
    pub violations: usize,
    /// What they were.
    pub what: Vec<String>,
    /// Learning samples that a restart lost.
    pub lost_samples: u64,
    /// Frames exposed.
    pub frames: usize,
    /// Share of them that was answered within 150 ms.
    pub availability: f64,
    /// Frames without an answer around each SIGKILL of a service but the simulator.
    pub unanswered_per_crash: Spread,
    /// Frames without an answer around each planned restart of vision, segmentation and learner.
    pub unanswered_per_restart: Spread,
    /// Frames without an answer around each SIGKILL of the supervisor.
    pub unanswered_per_adoption: Spread,
    /// From SIGKILL to the first beat of the next process, ms.
    pub restart_ms: Spread,
    /// From SIGSTOP to the first beat of the next process, ms.
    pub hang_ms: Spread,
    /// Shared memory and files that are left at the end.
    pub leftover_files: usize,
    /// Services killed that did not hang.
    pub false_kills: usize,
    /// All faults in their order.
    pub costs: Vec<Cost>,
    /// The command that does it again.
    pub again: String,
}

impl Figures {
    /// Of a run that ended at `ended_ns`.
    pub fn of(
        options: &Options,
        checker: &Checker,
        injected: &[Injected],
        log: &str,
        (took, ended_ns): (Duration, u64),
        leftover_files: usize,
    ) -> Figures {
        use pursuit_messages::Service;
        let settled_ns = ended_ns.saturating_sub(SETTLED_NS);
        let alone = |from: u64, to: u64, this: &Injected| {
            injected.iter().all(|other| {
                std::ptr::eq(other, this) || other.time_ns > to || end_of(checker, other) + FIRST_NS < from
            })
        };
        let begin_ns = injected.first().map_or(0, |first| first.time_ns);
        let costs: Vec<Cost> = injected
            .iter()
            .map(|one| {
                // Where two things happened at once nobody can tell whose frames are missing.
                let (from, to) = (one.time_ns - ON_ITS_WAY_NS, end_of(checker, one) + FIRST_NS);
                let counts = to < settled_ns && alone(from, to, one);
                let reborn = one.fault.service().and_then(|service| checker.reborn(service, one.time_ns));
                Cost {
                    fault: one.fault.to_string(),
                    at_s: (one.time_ns - begin_ns) as f64 * 1e-9,
                    unanswered: counts.then(|| checker.frames.unanswered(from, to)),
                    reborn_ms: reborn.map(|at| (at - one.time_ns) as f64 * 1e-6),
                }
            })
            .collect();
        let around = |which: &dyn Fn(Fault) -> bool| {
            let those = injected.iter().zip(&costs).filter(|(one, _)| which(one.fault));
            Spread::of(those.filter_map(|(_, cost)| cost.unanswered.map(|count| count as f64)).collect())
        };
        let reborn_ms = |which: &dyn Fn(Fault) -> bool| {
            let those = injected.iter().zip(&costs).filter(|(one, _)| which(one.fault));
            Spread::of(those.filter_map(|(_, cost)| cost.reborn_ms).collect())
        };
        let stops = injected.iter().filter(|one| matches!(one.fault, Fault::Stop(_))).count();
        let hangs = log.lines().filter(|line| line.contains("hangs: ")).count();
        let mut what: Vec<String> = checker
            .violations
            .iter()
            .map(|violation| {
                let before = injected.iter().rev().find(|one| one.time_ns <= violation.time_ns);
                let (fault, ms) = before.map_or(("nothing".to_owned(), 0), |one| {
                    (one.fault.to_string(), (violation.time_ns - one.time_ns) / 1_000_000)
                });
                format!("{}: {}, {ms} ms after {fault}", violation.invariant, violation.what)
            })
            .collect();
        what.extend(injected.iter().filter_map(|one| {
            let gone = one.fault.service().filter(|_| one.fault.is_a_death())?;
            let back = checker.reborn(gone, one.time_ns);
            back.is_none().then(|| format!("recovery: nobody came after the {}", one.fault))
        }));
        Figures {
            seed: options.seed,
            seconds: took.as_secs_f64(),
            faults: injected.len(),
            violations: what.len(),
            what,
            lost_samples: checker.lost_samples,
            frames: checker.frames.count(0, settled_ns),
            availability: checker.frames.availability(settled_ns, IN_TIME_NS),
            unanswered_per_crash: around(
                &|fault| matches!(fault, Fault::Kill(service) if service != Service::Simulator),
            ),
            unanswered_per_restart: around(&|fault| {
                use Service::{Learner, Segmentation, Vision};
                matches!(fault, Fault::Restart(Vision | Segmentation | Learner))
            }),
            unanswered_per_adoption: around(&|fault| fault == Fault::KillSupervisor),
            restart_ms: reborn_ms(&|fault| matches!(fault, Fault::Kill(_))),
            hang_ms: reborn_ms(&|fault| matches!(fault, Fault::Stop(_))),
            leftover_files,
            false_kills: hangs.saturating_sub(stops),
            costs,
            again: again(options),
        }
    }

    /// For people.
    pub fn text(&self) -> String {
        let spread = |spread: &Spread, unit: &str| {
            let Spread { count, p50, p95, max } = spread;
            format!("p50 {p50:.0}, p95 {p95:.0}, max {max:.0}{unit} ({count})")
        };
        let mut text = format!(
            "seed {}, {:.0} s, {} faults, {} frames\n\
             violations            {}\n\
             lost samples          {}\n\
             answered in 150 ms    {:.1} %\n\
             unanswered, crash     {}\n\
             unanswered, restart   {}\n\
             unanswered, adoption  {}\n\
             crash to next beat    {}\n\
             hang to next beat     {}\n\
             files left            {}\n\
             false kills           {}\n",
            self.seed,
            self.seconds,
            self.faults,
            self.frames,
            self.violations,
            self.lost_samples,
            100.0 * self.availability,
            spread(&self.unanswered_per_crash, ""),
            spread(&self.unanswered_per_restart, ""),
            spread(&self.unanswered_per_adoption, ""),
            spread(&self.restart_ms, " ms"),
            spread(&self.hang_ms, " ms"),
            self.leftover_files,
            self.false_kills,
        );
        for what in &self.what {
            text.push_str(&format!("VIOLATED {what}\n"));
        }
        if self.violations > 0 {
            text.push_str(&format!("again: {}\n", self.again));
        }
        text
    }
}

fn again(options: &Options) -> String {
    use clap::ValueEnum;
    let mut text = format!("pursuit chaos --seconds {} --seed {}", options.seconds, options.seed);
    let kinds: Vec<String> = options
        .faults
        .iter()
        .filter_map(|kind| kind.to_possible_value().map(|value| value.get_name().to_owned()))
        .collect();
    if !kinds.is_empty() {
        text.push_str(&format!(" --faults {}", kinds.join(",")));
    }
    options.set.iter().for_each(|set| text.push_str(&format!(" --set {set}")));
    text
}

/// When what a fault did was over, ns.
fn end_of(checker: &Checker, injected: &Injected) -> u64 {
    let reborn = injected.fault.service().and_then(|service| checker.reborn(service, injected.time_ns));
    let end = match injected.fault {
        Fault::Restart(_) => injected.answered_ns.or(reborn),
        Fault::Kill(_) | Fault::Stop(_) => reborn,
        Fault::KillSupervisor => Some(injected.time_ns + 1_000_000_000),
        Fault::EmergencyStop => Some(injected.time_ns + 2_000_000_000),
        Fault::Camera(_) => Some(injected.time_ns + 2_000_000_000),
        Fault::Lie(_) => Some(injected.time_ns + 500_000_000),
    };
    end.unwrap_or(injected.time_ns + LONGEST_NS)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_spread_is_of_ranks() {
        let spread = Spread::of((1..=20).map(f64::from).collect());
        assert_eq!((spread.p50, spread.p95, spread.max, spread.count), (10.0, 19.0, 20.0, 20));
        assert_eq!(Spread::of(Vec::new()), Spread::default());
    }
}
