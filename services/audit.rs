//! `pursuit audit`: what must hold whatever happens, checked on a recording.

use crate::chaos::checker::{Bounds, Checker, Violation};
use crate::check;
use crate::cli::Audit as Options;
use pursuit_arm_driver::step::Driver;
use pursuit_config::Document;
use pursuit_messages::ArmEvent;
use pursuit_recording::{Reader, Sample};
use pursuit_runtime::exit;
use pursuit_runtime::settings::Clock;
use serde::Serialize;
use std::path::Path;

/// A frame's answer may come so long after its exposure, ns.
const ON_THEIR_WAY_NS: u64 = 300_000_000;
/// Violations that are printed one by one.
const SHOWN: usize = 20;

/// What a recording came to.
#[derive(Debug, Default, Serialize)]
pub struct Findings {
    /// Messages read.
    pub messages: u64,
    /// Frames exposed while it was made, and how many of them no command answers.
    pub frames: usize,
    /// See `frames`.
    pub unanswered: usize,
    /// Learning samples that a restart lost.
    pub lost_samples: u64,
    /// Whether the recorder closed the file.
    pub closed: bool,
    /// What must not have happened: seconds after the first message, which invariant, what was seen.
    pub violations: Vec<(f64, &'static str, String)>,
}

/// Runs the verb: 0 where nothing is violated.
pub fn run(options: &Options) -> u8 {
    let findings = match audit(&options.file) {
        Ok(findings) => findings,
        Err(why) => {
            eprintln!("pursuit audit: {}: {why}", options.file.display());
            return exit::FAILED;
        }
    };
    if options.json {
        println!("{}", serde_json::to_string_pretty(&findings).unwrap_or_default());
    } else {
        print!("{}", text(&findings));
    }
    if findings.violations.is_empty() { exit::OK } else { exit::FAILED }
}

/// Reads a recording from its beginning to its end.
///
/// # Errors
/// It cannot be read, or has no config that says what the limits are.
pub fn audit(file: &Path) -> Result<Findings, String> {
    let told = |error: &dyn std::fmt::Display| error.to_string();
    let mut reader = Reader::open(file).map_err(|e| told(&e))?;
    let config = reader.config().unwrap_or_default().to_owned();
    let document = Document::parse("the recording's config", &config).map_err(|e| told(&e))?;
    let checked = check::all(&document).map_err(|e| told(&e))?;
    if checked.acquisition.run.clock == Clock::Lockstep {
        return Err(
            "it was made in lock-step, where no time is real: record a run with run.clock = \"wall\""
                .to_owned(),
        );
    }
    let driver = Driver::new(checked.arm.parameters, checked.arm.coupling).map_err(|e| told(&e))?;
    let mut checker = Checker::new(Bounds::new(driver, checked.simulator.cell.latency_ns));
    let mut findings = Findings::default();
    let mut times_ns = None;
    while let Some(entry) = reader.next_entry().map_err(|e| told(&e))? {
        findings.messages += 1;
        let log_ns = entry.log_ns;
        times_ns = Some(times_ns.map_or((log_ns, log_ns), |(first, _)| (first, log_ns)));
        match entry.sample {
            Sample::Health(health) => checker.health(&health),
            Sample::World(world) => checker.hear_world(&entry.stamp, &world),
            Sample::Command(command) => checker.hear_command(&entry.stamp, &command),
            Sample::Learner(state) => checker.learner(&state),
            Sample::Driver(state) => {
                // The operator is not in the recording, but what the driver made of his wish is.
                let was_stopped =
                    checker.driver().and_then(|state| state.state()).is_some_and(|s| s.is_latched());
                if was_stopped && state.cause() == Some(ArmEvent::Reset) {
                    checker.reset_asked();
                }
                checker.driver_state(&state);
            }
            _ => {}
        }
    }
    checker.settle();
    let (first_ns, last_ns) = times_ns.ok_or("it holds no message")?;
    findings.closed = reader.is_closed();
    findings.lost_samples = checker.lost_samples;
    // Not those from before the recording, which topics kept, and not those whose answer may be behind its end.
    let within = (first_ns, last_ns.saturating_sub(ON_THEIR_WAY_NS));
    findings.frames = checker.frames.count(within.0, within.1);
    findings.unanswered = checker.frames.unanswered(within.0, within.1);
    let since = |violation: &Violation| violation.time_ns.saturating_sub(first_ns) as f64 * 1e-9;
    findings.violations =
        checker.violations.iter().map(|one| (since(one), one.invariant, one.what.clone())).collect();
    Ok(findings)
}

fn text(findings: &Findings) -> String {
    let Findings { messages, frames, unanswered, lost_samples, closed, violations } = findings;
    let end = if *closed { "closed" } else { "cut short, whole up to there" };
    let mut text = format!(
        "{messages} messages, {end}\n\
         frames          {frames}, {unanswered} without an answer\n\
         lost samples    {lost_samples}\n\
         violations      {}\n",
        violations.len()
    );
    for (at_s, invariant, what) in violations.iter().take(SHOWN) {
        text.push_str(&format!("VIOLATED {invariant} at {at_s:.3} s: {what}\n"));
    }
    if violations.len() > SHOWN {
        text.push_str(&format!("... and {} more\n", violations.len() - SHOWN));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::check::SIM;
    use pursuit_messages::{
        ArmState, DriverState, ImageShape, LearnerState, Service, Stage, Stamp, WorldCommand, WorldState,
    };
    use pursuit_recording::{Entry, Writer};

    /// A recording of those messages, 10 ms apart, and what is found in it.
    fn found(name: &str, config: &str, samples: Vec<Sample>) -> Result<Findings, String> {
        let file = std::env::temp_dir().join(format!("pursuit-audit-{name}-{}.mcap", std::process::id()));
        let mut writer = Writer::create(&file, config).unwrap();
        for (k, sample) in samples.into_iter().enumerate() {
            let log_ns = 1_000_000_000 + k as u64 * 10_000_000;
            let stamp = Stamp::new(1, k as u64, log_ns, ImageShape::grey(64, 64));
            let stamp = stamp.extended(Service::ArmDriver, Stage::Drive, log_ns, log_ns);
            writer.write(&Entry { log_ns, stamp, sample }).unwrap();
        }
        writer.finish().unwrap();
        let found = audit(&file);
        std::fs::remove_file(&file).unwrap();
        found
    }

    fn on_the_wall_clock() -> String {
        SIM.replace("clock = \"lockstep\"", "clock = \"wall\"")
    }

    fn driver(state: ArmState, cause: ArmEvent) -> Sample {
        Sample::Driver(DriverState { state: state as u32, cause: cause as u32, ..DriverState::default() })
    }

    fn invariants(findings: &Findings) -> Vec<&'static str> {
        findings.violations.iter().map(|(_, invariant, _)| *invariant).collect()
    }

    #[test]
    fn a_joint_beyond_its_limit_and_lost_samples_are_found() {
        let world = |angle| {
            Sample::World(Box::new(WorldState { position: [angle; 6], exposes: 1, ..WorldState::default() }))
        };
        let learner =
            |samples| Sample::Learner(Box::new(LearnerState { samples, ..LearnerState::default() }));
        let findings =
            found("limit", &on_the_wall_clock(), vec![world(9.0), learner(40), learner(37)]).unwrap();
        assert_eq!(invariants(&findings), ["I1"; 6]);
        assert_eq!(findings.lost_samples, 3);
        assert!(text(&findings).contains("VIOLATED I1"));
    }

    #[test]
    fn a_stop_that_is_left_must_have_been_left_by_a_reset() {
        use {ArmEvent::*, ArmState::*};
        let stopped = || driver(EmergencyStop, EmergencyAsked);
        let config = on_the_wall_clock();
        let by_reset = found("reset", &config, vec![stopped(), driver(Inactive, Reset)]).unwrap();
        assert!(by_reset.violations.is_empty(), "{by_reset:?}");
        let by_itself = found("itself", &config, vec![stopped(), driver(Active, SetPointsBack)]).unwrap();
        assert_eq!(invariants(&by_itself), ["I5"]);
    }

    #[test]
    fn a_command_that_is_no_number_is_found() {
        let mut command = WorldCommand { cycle_count: 1, ..WorldCommand::default() };
        command.cycles[0].position[2] = f64::NAN;
        let findings = found("nan", &on_the_wall_clock(), vec![Sample::Command(Box::new(command))]).unwrap();
        assert!(invariants(&findings).contains(&"I1"), "{findings:?}");
    }

    #[test]
    fn what_cannot_be_checked_is_refused_with_a_reason() {
        let one = || vec![driver(ArmState::Active, ArmEvent::Activated)];
        let lockstep = found("lockstep", SIM, one()).unwrap_err();
        assert!(lockstep.contains("lock-step"), "{lockstep}");
        assert!(found("config", "", one()).is_err());
        let empty = found("empty", &on_the_wall_clock(), Vec::new()).unwrap_err();
        assert!(empty.contains("no message"), "{empty}");
    }
}
