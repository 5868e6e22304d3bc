//! `pursuit chaos`: random faults in a running system, and a check of what must hold all the same.
//!
//! The shape is Jepsen's: a generator ([`plan`]), a nemesis that does it to real processes ([`system`]), a
//! history, which is what is said on the bus, and a [`checker`].

pub mod checker;
mod figures;
mod frames;
pub mod plan;
mod system;

use crate::audit::audit;
use crate::check;
use crate::cli::Chaos as Options;
use checker::{Bounds, Checker};
use figures::{Figures, Injected};
use plan::{Fault, Nemesis};
use pursuit_arm_driver::step::Driver;
use pursuit_bus::{Bus, Instance};
use pursuit_messages::{ArmState, Service, Stamp};
use pursuit_observer::ears::{Ears, Heard};
use pursuit_runtime::clock::monotonic_ns;
use pursuit_runtime::{exit, place};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use system::{Liar, System};

/// Between two looks at the bus.
const LOOK: Duration = Duration::from_millis(2);
/// All services must be there so long after a start, or after the last fault: patience with a loaded machine.
const PATIENCE: Duration = Duration::from_secs(60);
/// A stop of the arm is reset after so long, ns.
const STOPPED_NS: u64 = 1_500_000_000;
/// A supervisor has opened all that it needs so long after its start.
const SETTLED: Duration = Duration::from_secs(3);
/// Open files may be more than then by so many: services that are being restarted.
const MORE_FILES: usize = 16;
/// A camera is ill for so long, ns.
const ILL_NS: u64 = 1_200_000_000;
/// Deaths of one service in ten seconds that the nemesis does not go beyond: at one more the supervisor gives
/// it up, as it should.
const DEATHS: usize = 3;

/// Runs the verb.
pub fn run(options: &Options) -> u8 {
    let directory = options.run_dir.clone().unwrap_or_else(|| place::directory("chaos"));
    match chaos(options, &directory) {
        Ok(figures) => {
            let mut code = if figures.violations == 0 { exit::OK } else { exit::FAILED };
            if let Some(file) = &options.json {
                code = code.max(crate::up::write_json(file, &figures));
            }
            if options.json.as_deref() != Some(Path::new("-")) {
                print!("{}", figures.text());
            }
            code
        }
        Err(why) => {
            eprintln!("pursuit chaos: {why}");
            exit::FAILED
        }
    }
}

/// What a run works with.
struct Run {
    system: System,
    checker: Checker,
    ears: Ears,
    bus: Bus,
    injected: Vec<Injected>,
    newest: Option<Stamp>,
    stopped_ns: Option<u64>,
    files: Files,
}

/// Files that a supervisor had open soon after its start.
#[derive(Default)]
struct Files {
    pid: u32,
    since: Option<Instant>,
    open: Option<usize>,
}

impl Files {
    /// Looks from time to time.
    fn look(&mut self, pid: u32) {
        if self.pid != pid {
            *self = Files { pid, since: Some(Instant::now()), open: None };
        }
        if self.open.is_none() && self.since.is_some_and(|since| since.elapsed() > SETTLED) {
            self.open = Some(descriptors(pid));
        }
    }

    /// How many more there are now.
    fn more(&self, pid: u32) -> usize {
        let before = self.open.filter(|_| self.pid == pid);
        before.map_or(0, |before| descriptors(pid).saturating_sub(before))
    }
}

fn chaos(options: &Options, directory: &Path) -> Result<Figures, String> {
    let told = |error: &dyn std::fmt::Display| error.to_string();
    let document = check::document(None, &options.set).map_err(|e| told(&e))?;
    let checked = check::all(&document).map_err(|e| told(&e))?;
    let driver = Driver::new(checked.arm.parameters, checked.arm.coupling).map_err(|e| told(&e))?;
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        signal_hook::flag::register(signal, Arc::clone(&stop)).map_err(|e| told(&e))?;
    }
    let instance = Instance::at(directory).map_err(|e| told(&e))?;
    let system = System::start(directory, &options.set).map_err(|e| told(&e))?;
    eprintln!("starting a system in {}", directory.display());
    if !wait_until_well(&system, &stop) {
        let log = system.log();
        system.end();
        return Err(format!("the system does not come up:\n{log}"));
    }
    let bus = Bus::join(&instance, "chaos").map_err(|e| told(&e))?;
    let ears = Ears::open(&bus).map_err(|e| told(&e))?;
    let recorder = options.record.as_deref().map(|file| record(directory, file)).transpose();
    let recorder = recorder.map_err(|e| told(&e))?;
    let bounds = Bounds::new(driver, checked.simulator.cell.latency_ns);
    let mut run = Run {
        system,
        checker: Checker::new(bounds),
        ears,
        bus,
        injected: Vec::new(),
        newest: None,
        stopped_ns: None,
        files: Files::default(),
    };
    let begin = Instant::now();
    run.torment(options, &stop);
    run.recover(&stop);
    run.checker.settle();
    let ended_ns = monotonic_ns();
    if let Some(recorder) = recorder {
        run.check_recording(recorder, options.record.as_deref().unwrap_or(Path::new("")));
    }
    let more = run.files.more(run.system.supervisor());
    if more > MORE_FILES {
        let what = format!("the supervisor has {more} more open files than soon after its start");
        run.checker.violated(ended_ns, "I9", what);
    }
    let log = run.system.log();
    let Run { system, checker, injected, ears, bus, .. } = run;
    drop((ears, bus));
    system.end();
    let leftover_files = system::leftovers(directory);
    let figures =
        Figures::of(options, &checker, &injected, &log, (begin.elapsed(), ended_ns), leftover_files);
    Ok(figures)
}

impl Run {
    /// One fault after the other, for the time that was asked for.
    fn torment(&mut self, options: &Options, stop: &AtomicBool) {
        let mut nemesis = Nemesis::new(options.seed, &options.faults);
        let end = Instant::now() + Duration::from_secs_f64(options.seconds.max(0.0));
        let (mut pause, mut fault) = nemesis.next();
        let mut next = Instant::now() + pause;
        while Instant::now() < end && !stop.load(Ordering::Relaxed) {
            if Instant::now() >= next {
                self.inflict(fault);
                (pause, fault) = nemesis.next();
                next = Instant::now() + pause;
            }
            self.turn();
        }
    }

    fn inflict(&mut self, fault: Fault) {
        let now = monotonic_ns();
        if fault.is_a_death() {
            let same = |injected: &&Injected| {
                injected.fault.is_a_death() && injected.fault.service() == fault.service()
            };
            let recent =
                |injected: &&Injected| now - injected.time_ns < pursuit_supervisor::policy::WINDOW_NS;
            if self.injected.iter().filter(same).filter(recent).count() >= DEATHS {
                return;
            }
        }
        if let (Fault::Lie(lie), Some(newest)) = (fault, &self.newest)
            && let Some(liar) = Liar::join(&self.bus)
        {
            liar.tell(lie, newest);
        }
        match self.system.inflict(fault) {
            Ok(true) => {
                eprintln!("{fault}");
                self.injected.push(Injected::new(fault, now));
            }
            Ok(false) => {}
            Err(error) => self.checker.violated(now, "start", format!("after a {fault}: {error}")),
        }
    }

    /// Listens, and does what an operator would.
    fn turn(&mut self) {
        let (checker, newest) = (&mut self.checker, &mut self.newest);
        self.ears.listen(|heard| match heard {
            Heard::Health(_, health) => checker.health(health),
            Heard::World(stamp, world) => {
                *newest = Some(*stamp);
                checker.hear_world(stamp, world);
            }
            Heard::Command(stamp, command) => checker.hear_command(stamp, command),
            Heard::Driver(_, state) => checker.driver_state(state),
            Heard::Learner(_, state) => checker.learner(state),
            _ => {}
        });
        self.files.look(self.system.supervisor());
        let now = monotonic_ns();
        let stops = [ArmState::EmergencyStop, ArmState::ProtectiveStop];
        let state = self.checker.driver().and_then(|driver| driver.state());
        if state.is_some_and(|state| stops.contains(&state)) {
            let since = *self.stopped_ns.get_or_insert(now);
            if now >= since + STOPPED_NS {
                self.stopped_ns = None;
                self.checker.reset_asked();
                self.system.reset();
            }
        } else {
            self.stopped_ns = None;
        }
        let ill = |injected: &&Injected| matches!(injected.fault, Fault::Camera(_));
        if self.injected.iter().rev().find(ill).is_some_and(|last| now > last.time_ns + ILL_NS) {
            self.system.heal();
        }
        while let Some(outcome) = self.system.outcome() {
            let asked = outcome.times_ns.0;
            let of = |injected: &&mut Injected| {
                injected.fault == Fault::Restart(outcome.service) && injected.time_ns <= asked
            };
            if let Some(injected) = self.injected.iter_mut().rev().find(of) {
                injected.refused = outcome.refused;
                injected.answered_ns = Some(outcome.times_ns.1);
            }
        }
        std::thread::sleep(LOOK);
    }

    /// After the last fault all must be well again.
    fn recover(&mut self, stop: &AtomicBool) {
        let limit = Instant::now() + PATIENCE;
        let settle = Instant::now() + Duration::from_secs(3);
        let mut look = Instant::now();
        let mut is_well = false;
        while !is_well || Instant::now() < settle {
            if Instant::now() > limit || stop.load(Ordering::Relaxed) && Instant::now() > settle {
                break;
            }
            self.turn();
            if Instant::now() >= look {
                look = Instant::now() + Duration::from_millis(200);
                is_well = self.system.is_well();
            }
        }
        if self.system.has_ended() || !is_well {
            self.checker.violated(monotonic_ns(), "recovery", "not all services came back".to_owned());
        }
    }

    fn check_recording(&mut self, mut recorder: Child, file: &Path) {
        let pid = i32::try_from(recorder.id()).ok().and_then(rustix::process::Pid::from_raw);
        if let Some(pid) = pid {
            let _ = rustix::process::kill_process(pid, rustix::process::Signal::TERM);
        }
        let ended = recorder.wait();
        let why = match (ended, audit(file)) {
            (Ok(status), Ok(findings)) if status.success() => {
                let found = findings.violations.iter();
                found.for_each(|(at_s, invariant, what)| {
                    let what = format!("{what}, {at_s:.3} s after the recording's beginning");
                    self.checker.violated(monotonic_ns(), invariant, what);
                });
                return;
            }
            (Ok(status), Ok(findings)) => {
                format!("the recorder ended with {status}, {} messages", findings.messages)
            }
            (_, Err(why)) => format!("the recording cannot be read: {why}"),
            (Err(error), _) => error.to_string(),
        };
        self.checker.violated(monotonic_ns(), "I10", why);
    }
}

fn wait_until_well(system: &System, stop: &AtomicBool) -> bool {
    let limit = Instant::now() + PATIENCE;
    while Instant::now() < limit && !stop.load(Ordering::Relaxed) {
        if system.is_well()
            && Service::ALL.into_iter().filter(|s| s.is_in_the_loop()).all(|s| system.process(s).is_some())
        {
            return true;
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    false
}

fn record(directory: &Path, file: &Path) -> std::io::Result<Child> {
    Command::new(std::env::current_exe()?)
        .args(["record", "--out"])
        .arg(file)
        .arg("--run-dir")
        .arg(directory)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .spawn()
}

/// Open files of a process.
fn descriptors(pid: u32) -> usize {
    std::fs::read_dir(PathBuf::from(format!("/proc/{pid}/fd"))).map_or(0, Iterator::count)
}
