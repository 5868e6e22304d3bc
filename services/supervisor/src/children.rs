//! The services' processes.

use crate::policy::{DO_NOT_RESTART, Decision, History};
use crate::status::{ServiceStatus, State};
use pursuit_messages::{Health, Service};
use pursuit_runtime::clock::monotonic_ns;
use pursuit_runtime::station::SUPERVISOR_PID;
use rustix::process::{Pid, Signal, kill_process};
use std::fs::File;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};

/// An exit that concerns the whole run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Exit {
    /// The simulator has done its frames.
    RunComplete,
    /// A service cannot run and starting it again does not help; why.
    Hopeless(String),
}

/// All children.
pub struct Children {
    program: PathBuf,
    directory: PathBuf,
    bounded: bool,
    all: Vec<OneChild>,
}

struct OneChild {
    service: Service,
    process: Option<Child>,
    state: State,
    restarts: u32,
    started_ns: u64,
    start_at_ns: Option<u64>,
    /// A child that was asked to end is killed at this time.
    kill_at_ns: Option<u64>,
    history: History,
    health: Option<Health>,
}

impl Children {
    /// Starts `services`. One that cannot be started counts as died. In a `bounded` run one that is given
    /// up ends the run, if the loop needs it.
    pub fn start(program: &Path, directory: &Path, services: &[Service], bounded: bool) -> Children {
        let now = monotonic_ns();
        let all = services
            .iter()
            .map(|&service| OneChild {
                service,
                process: None,
                state: State::Starting,
                restarts: 0,
                started_ns: now,
                start_at_ns: Some(now),
                kill_at_ns: None,
                history: History::default(),
                health: None,
            })
            .collect();
        let mut children =
            Children { program: program.to_owned(), directory: directory.to_owned(), bounded, all };
        children.start_due(now);
        children
    }

    /// Takes in a heartbeat.
    pub fn hear(&mut self, health: &Health) {
        let of_its_process = |child: &&mut OneChild| {
            child.service as u32 == health.service
                && child.process.as_ref().is_some_and(|process| process.id() == health.pid)
        };
        if let Some(child) = self.all.iter_mut().find(of_its_process) {
            child.health = Some(*health);
            if matches!(child.state, State::Starting | State::Running | State::NoInput) {
                child.state = if health.degraded == 1 { State::NoInput } else { State::Running };
            }
        }
    }

    /// Looks after all children: who ended, who is due to start again.
    pub fn look(&mut self, now_ns: u64) -> Option<Exit> {
        for child in &mut self.all {
            if child.kill_at_ns.is_some_and(|at| now_ns >= at) {
                child.kill_at_ns = None;
                child.signal(Signal::KILL);
            }
            let Some(status) = child.process.as_mut().and_then(|process| process.try_wait().ok().flatten())
            else {
                continue;
            };
            child.process = None;
            child.kill_at_ns = None;
            if let Some(exit) = child.ended(status, now_ns, &self.directory) {
                return Some(exit);
            }
        }
        self.start_due(now_ns);
        let ends_the_run =
            |child: &&OneChild| child.state == State::GivenUp && child.service.is_in_the_loop();
        let given_up = self.all.iter().find(ends_the_run).filter(|_| self.bounded)?;
        let last = last_line(&log_file(&self.directory, given_up.service));
        Some(Exit::Hopeless(format!("{} dies again and again: {last}", given_up.service.name())))
    }

    /// What is told about all services at `now_ns`.
    pub fn status(&self, now_ns: u64) -> Vec<ServiceStatus> {
        self.all
            .iter()
            .map(|child| ServiceStatus {
                service: child.service.name().to_owned(),
                pid: child.process.as_ref().map(Child::id),
                state: child.state,
                restarts: child.restarts,
                last_beat_ms: child.health.map(|health| now_ns.saturating_sub(health.time_ns) / 1_000_000),
                answered: child.health.map_or(0, |health| health.answered),
                skipped: child.health.map_or(0, |health| health.skipped),
            })
            .collect()
    }

    /// Asks a running service to end so that it is started again; whether there was one.
    pub fn restart(&mut self, service: Service) -> bool {
        let Some(child) = self.all.iter_mut().find(|child| child.service == service) else { return false };
        if child.state == State::GivenUp {
            child.history = History::default();
            child.start_at_ns = Some(monotonic_ns());
            child.state = State::Restarting;
            return true;
        }
        let asked = child.signal(Signal::TERM);
        if asked {
            child.state = State::Stopping;
            child.kill_at_ns = Some(monotonic_ns() + crate::STOP_LIMIT_NS);
        }
        asked
    }

    /// SIGTERM to all, and no more restarts.
    pub fn ask_all_to_end(&mut self) {
        for child in &mut self.all {
            child.start_at_ns = None;
            child.state = State::Stopping;
            child.signal(Signal::TERM);
        }
    }

    /// Whether no process is left.
    pub fn all_ended(&mut self) -> bool {
        for child in &mut self.all {
            if let Some(process) = &mut child.process
                && process.try_wait().ok().flatten().is_some()
            {
                child.process = None;
                child.state = State::Ended;
            }
        }
        self.all.iter().all(|child| child.process.is_none())
    }

    /// SIGKILL to who is still there, and waits for the kernel to be done with them.
    pub fn kill_all(&mut self) {
        for child in &mut self.all {
            if let Some(process) = &mut child.process {
                let _ = process.kill();
                let _ = process.wait();
            }
            child.process = None;
            child.state = State::Ended;
        }
    }

    fn start_due(&mut self, now_ns: u64) {
        for child in &mut self.all {
            if child.process.is_some() || child.start_at_ns.is_none_or(|at| at > now_ns) {
                continue;
            }
            child.start_at_ns = None;
            child.started_ns = now_ns;
            child.health = None;
            match spawn(&self.program, child.service, &self.directory) {
                Ok(process) => {
                    child.process = Some(process);
                    child.state = State::Starting;
                }
                Err(error) => {
                    tracing::error!(service = child.service.name(), %error, "cannot be started");
                    child.plan_restart(now_ns);
                }
            }
        }
    }
}

impl OneChild {
    fn ended(&mut self, status: ExitStatus, now_ns: u64, directory: &Path) -> Option<Exit> {
        let service = self.service.name();
        let asked = self.state == State::Stopping;
        self.state = State::Ended;
        // It ends well too when somebody asks it to: only the run's mark says that it is done.
        let complete = directory.join(pursuit_runtime::place::TRAJECTORY).exists();
        if self.service == Service::Simulator && status.success() && complete {
            return Some(Exit::RunComplete);
        }
        if status.code() == Some(i32::from(DO_NOT_RESTART)) {
            let last = last_line(&log_file(directory, self.service));
            if self.service.is_in_the_loop() {
                return Some(Exit::Hopeless(format!("{service} cannot run: {last}")));
            }
            self.state = State::GivenUp;
            tracing::error!(service, "cannot run, the others go on without it: {last}");
            return None;
        }
        if asked {
            self.restarts += 1;
            self.state = State::Restarting;
            self.start_at_ns = Some(now_ns);
            tracing::info!(service, "restarting as asked");
        } else {
            tracing::warn!(service, %status, "died");
            self.plan_restart(now_ns);
        }
        None
    }

    fn plan_restart(&mut self, now_ns: u64) {
        match self.history.died(self.started_ns, now_ns) {
            Decision::StartAt(at_ns) => {
                self.restarts += 1;
                self.state = State::Restarting;
                self.start_at_ns = Some(at_ns);
            }
            Decision::GiveUp => {
                self.state = State::GivenUp;
                tracing::error!(service = self.service.name(), "given up: it dies again and again");
            }
        }
    }

    fn signal(&self, signal: Signal) -> bool {
        let pid = self.process.as_ref().and_then(|process| Pid::from_raw(process.id() as i32));
        pid.is_some_and(|pid| kill_process(pid, signal).is_ok())
    }
}

/// A service's log in the run-time directory.
pub fn log_file(directory: &Path, service: Service) -> PathBuf {
    directory.join(format!("{}.log", service.name()))
}

fn spawn(program: &Path, service: Service, directory: &Path) -> std::io::Result<Child> {
    let log = File::options().create(true).append(true).open(log_file(directory, service))?;
    Command::new(program)
        .args(["run", service.name(), "--run-dir"])
        .arg(directory)
        .env(SUPERVISOR_PID, std::process::id().to_string())
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(log)
        .process_group(0)
        .spawn()
}

fn last_line(path: &Path) -> String {
    let text = std::fs::read_to_string(path).unwrap_or_default();
    text.lines().rev().find(|line| !line.trim().is_empty()).unwrap_or("it gave no reason").to_owned()
}
