//! One service: the process that is it, and in a planned restart the one that takes over from it.

use crate::children::Exit;
use crate::control::Answer;
use crate::policy::{DO_NOT_RESTART, Decision, History};
use crate::process::{End, Process, Program, last_line};
use crate::pulse::{Pulse, Verdict};
use crate::status::{ServiceStatus, State};
use pursuit_messages::{Health, Lack, Service};
use pursuit_runtime::place;
use pursuit_runtime::process::Identity;
use rustix::process::Signal;
use std::path::{Path, PathBuf};
use tokio::sync::oneshot;

/// After SIGTERM a process has this long to end by itself, ns.
pub const STOP_LIMIT_NS: u64 = 3_000_000_000;
/// From its start to its first beat a process has this long, ns.
const START_LIMIT_NS: u64 = 60_000_000_000;
/// A process that shall take over has this long until it stands by, ns; then the one before it stays.
const STANDBY_LIMIT_NS: u64 = 15_000_000_000;

/// Where the outcome of a restart goes.
pub type Reply = oneshot::Sender<Answer>;

/// A process that will take over.
struct Successor {
    process: Process,
    started_ns: u64,
    ready: bool,
    reply: Option<Reply>,
}

/// One service.
pub struct Slot {
    /// Which.
    pub service: Service,
    directory: PathBuf,
    /// Where its program file is.
    path: PathBuf,
    /// What it is started from after a crash.
    program: Option<Program>,
    process: Option<Process>,
    successor: Option<Successor>,
    state: State,
    adopted: bool,
    restarts: u32,
    started_ns: u64,
    start_at_ns: Option<u64>,
    /// Asked to end; it is killed at this time.
    kill_at_ns: Option<u64>,
    /// One that nobody knew of is in its place; it is killed at this time.
    room_by_ns: Option<u64>,
    /// Why we killed it.
    killed_for: Option<&'static str>,
    last_end: Option<String>,
    history: History,
    health: Option<Health>,
    pulse: Pulse,
    /// Who asked for a restart, until the new process is the service.
    reply: Option<Reply>,
}

impl Slot {
    /// A service that is started at `now_ns` from the program at `path`.
    pub fn new(service: Service, directory: &Path, path: &Path, now_ns: u64) -> Slot {
        Slot {
            service,
            directory: directory.to_owned(),
            path: path.to_owned(),
            program: None,
            process: None,
            successor: None,
            state: State::Starting,
            adopted: false,
            restarts: 0,
            started_ns: now_ns,
            start_at_ns: Some(now_ns),
            kill_at_ns: None,
            room_by_ns: None,
            killed_for: None,
            last_end: None,
            history: History::default(),
            health: None,
            pulse: Pulse::beat(now_ns),
            reply: None,
        }
    }

    /// Takes a running process as the service.
    pub fn adopt(&mut self, process: Process) {
        self.path = process.program.path().to_owned();
        self.program = Some(process.program.clone());
        self.process = Some(process);
        self.adopted = true;
        self.start_at_ns = None;
    }

    /// Takes in a beat, if it is of one of its processes.
    pub fn hear(&mut self, health: &Health, now_ns: u64) {
        let is = |process: &Process| process.pid() == health.pid;
        if self.process.as_ref().is_some_and(is) {
            self.health = Some(*health);
            self.pulse = Pulse::beat(now_ns);
            if health.standing_by == 1 {
                self.make_room(now_ns);
                return;
            }
            if matches!(self.state, State::Starting | State::Running | State::NoInput | State::Late) {
                let has_input = !matches!(Lack::from_number(health.degraded), Lack::Input | Lack::Frozen);
                self.state = if has_input { State::Running } else { State::NoInput };
            }
            if self.kill_at_ns.is_none() {
                self.answer(Answer::Done);
            }
        }
        if let Some(successor) = self.successor.as_mut().filter(|next| is(&next.process))
            && health.standing_by == 1
            && !successor.ready
        {
            successor.ready = true;
            self.ask_to_end(now_ns);
        }
    }

    /// Our process stands by, so there is one that we do not know of: a former supervisor started it in its last
    /// moment. It goes.
    fn make_room(&mut self, now_ns: u64) {
        let lock = self.directory.join(place::service_lock(self.service.name()));
        let own = self.process.as_ref().map(|process| *process.identity());
        let Some(other) = place::holder(&lock).filter(|holder| Some(*holder) != own) else { return };
        let limit_ns = *self.room_by_ns.get_or_insert_with(|| {
            tracing::warn!(service = self.service.name(), pid = other.pid, "ending one that nobody knew of");
            now_ns + STOP_LIMIT_NS
        });
        if let Ok(process) = Process::adopt(other) {
            process.signal(if now_ns >= limit_ns { Signal::KILL } else { Signal::TERM });
        }
    }

    /// Looks after its processes: who ended, who hangs, who is due to start.
    pub fn look(&mut self, now_ns: u64) -> Option<Exit> {
        self.look_after_successor(now_ns);
        if let Some(process) = &self.process {
            if self.kill_at_ns.is_some_and(|at| now_ns >= at) && self.killed_for.is_none() {
                self.killed_for = Some("it did not end when it was asked to");
                process.signal(Signal::KILL);
            }
            self.feel_pulse(now_ns);
        }
        let exit = self.process.as_mut().and_then(Process::ended).and_then(|end| self.ended(end, now_ns));
        if self.process.is_none() && self.start_at_ns.is_some_and(|at| at <= now_ns) {
            self.start(now_ns);
        }
        exit
    }

    fn feel_pulse(&mut self, now_ns: u64) {
        let Some(process) = &self.process else { return };
        if self.killed_for.is_some() || !self.pulse.is_late(now_ns) {
            return;
        }
        if self.health.is_none() && !self.adopted {
            if now_ns.saturating_sub(self.started_ns) > START_LIMIT_NS {
                self.killed_for = Some("it did not come up");
                process.signal(Signal::KILL);
            }
            return;
        }
        let Some(activity) = process.identity().activity() else { return };
        match self.pulse.look(now_ns, &activity) {
            Verdict::Hangs(why) => {
                tracing::warn!(service = self.service.name(), "hangs: {}; killing it", why.text());
                self.killed_for = Some(why.text());
                process.signal(Signal::KILL);
            }
            Verdict::Late if self.state == State::Running => self.state = State::Late,
            Verdict::Late | Verdict::Beats => {}
        }
    }

    fn look_after_successor(&mut self, now_ns: u64) {
        let Some(next) = &mut self.successor else { return };
        let why = if next.process.ended().is_some() {
            Some(last_line(&self.directory, self.service))
        } else if !next.ready && now_ns.saturating_sub(next.started_ns) > STANDBY_LIMIT_NS {
            next.process.signal(Signal::KILL);
            Some("it was not ready in time".to_owned())
        } else {
            None
        };
        let Some(why) = why else { return };
        tracing::warn!(service = self.service.name(), "the new process does not take over: {why}");
        if let Some(reply) = self.successor.take().and_then(|next| next.reply) {
            let _ = reply.send(Answer::Refused {
                why: format!("the new {} does not take over, the old one stays: {why}", self.service.name()),
            });
        }
    }

    fn ended(&mut self, end: End, now_ns: u64) -> Option<Exit> {
        let service = self.service.name();
        self.process = None;
        let asked = self.kill_at_ns.take().is_some();
        let why = self.killed_for.take().map_or_else(|| end.text(), |why| format!("{why}, and was killed"));
        let code = end.code();
        // It ends well too when somebody asks it to: only the run's mark says that it is done.
        let is_complete = || self.directory.join(place::TRAJECTORY).exists();
        if self.service == Service::Simulator && code.is_none_or(|code| code == 0) && is_complete() {
            self.state = State::Ended;
            return Some(Exit::RunComplete);
        }
        if let Some(next) = self.successor.take() {
            if !asked {
                self.last_end = Some(why);
            }
            self.restarts += 1;
            self.install(next.process, next.started_ns);
            self.reply = next.reply;
            return None;
        }
        if self.state == State::Stopping {
            self.state = State::Ended;
            return None;
        }
        if code == Some(i32::from(DO_NOT_RESTART)) {
            let last = last_line(&self.directory, self.service);
            self.answer(Answer::Refused { why: format!("{service} cannot run: {last}") });
            self.state = State::GivenUp;
            if self.service.is_in_the_loop() {
                return Some(Exit::Hopeless(format!("{service} cannot run: {last}")));
            }
            tracing::error!(service, "cannot run, the others go on without it: {last}");
            return None;
        }
        tracing::warn!(service, "died: {why}");
        self.last_end = Some(why);
        self.plan_restart(now_ns);
        (end.is_of_torn_memory() && self.service.is_in_the_loop()).then_some(Exit::Torn(self.service))
    }

    fn plan_restart(&mut self, now_ns: u64) {
        // The clock's last digits: nobody's are the same.
        let jitter = (now_ns % 997) as f64 / 997.0;
        match self.history.died(self.started_ns, now_ns, jitter) {
            Decision::StartAt(at_ns) => {
                self.restarts += 1;
                self.state = State::Restarting;
                self.start_at_ns = Some(at_ns);
            }
            Decision::GiveUp => {
                self.state = State::GivenUp;
                self.start_at_ns = None;
                let last = last_line(&self.directory, self.service);
                tracing::error!(service = self.service.name(), "given up: it dies again and again: {last}");
                self.answer(Answer::Refused { why: format!("it dies again and again: {last}") });
            }
        }
    }

    fn start(&mut self, now_ns: u64) {
        self.start_at_ns = None;
        let program = match &self.program {
            Some(program) => Ok(program.clone()),
            None => Program::open(&self.path),
        };
        match program.and_then(|program| Process::spawn(&program, self.service, &self.directory)) {
            Ok(process) => self.install(process, now_ns),
            Err(error) => {
                let service = self.service.name();
                tracing::error!(service, %error, program = %self.path.display(), "cannot be started");
                self.started_ns = now_ns;
                self.plan_restart(now_ns);
            }
        }
    }

    /// From now on this process is the service.
    fn install(&mut self, process: Process, started_ns: u64) {
        self.path = process.program.path().to_owned();
        self.program = Some(process.program.clone());
        self.process = Some(process);
        self.started_ns = started_ns;
        self.state = State::Starting;
        self.adopted = false;
        self.room_by_ns = None;
        self.health = None;
        self.pulse = Pulse::beat(started_ns);
    }

    /// Starts the service anew, from the file at `path` or where its program is: the new process takes over from
    /// the old one. The answer comes when it has, or why it cannot.
    pub fn restart(&mut self, path: Option<&Path>, now_ns: u64, reply: Reply) {
        let refuse = |why: String, reply: Reply| {
            let _ = reply.send(Answer::Refused { why });
        };
        if self.successor.is_some() || self.reply.is_some() || self.state == State::Stopping {
            return refuse(format!("{} is being restarted or stopped already", self.service.name()), reply);
        }
        let path = path.unwrap_or(&self.path).to_owned();
        let program = match Program::open(&path) {
            Ok(program) => program,
            Err(error) => return refuse(format!("{}: {error}", path.display()), reply),
        };
        if self.process.is_none() {
            self.history = History::default();
            (self.path, self.program) = (path, Some(program));
            self.state = State::Restarting;
            self.start_at_ns = Some(now_ns);
            self.reply = Some(reply);
            return;
        }
        match Process::spawn(&program, self.service, &self.directory) {
            Ok(process) => {
                tracing::info!(service = self.service.name(), program = %path.display(), "restarting as asked");
                let reply = Some(reply);
                self.successor = Some(Successor { process, started_ns: now_ns, ready: false, reply });
            }
            Err(error) => refuse(format!("{} cannot be started: {error}", path.display()), reply),
        }
    }

    /// SIGTERM now, and no start any more.
    pub fn stop(&mut self, now_ns: u64) {
        self.start_at_ns = None;
        if matches!(self.state, State::Stopping | State::GivenUp) {
            return;
        }
        self.state = State::Stopping;
        if let Some(next) = self.successor.take() {
            next.process.kill();
        }
        self.ask_to_end(now_ns);
    }

    /// SIGKILL to what is left.
    pub fn kill(&mut self) {
        self.start_at_ns = None;
        self.successor.take().map(|next| next.process.kill()).unwrap_or_default();
        if let Some(process) = self.process.take() {
            process.kill();
        }
        if self.state != State::GivenUp {
            self.state = State::Ended;
        }
    }

    /// Begins again, with its history; after [`Slot::kill`].
    pub fn begin_again(&mut self, now_ns: u64) {
        if self.state == State::Ended {
            (self.state, self.kill_at_ns, self.killed_for) = (State::Restarting, None, None);
            self.start_at_ns = Some(now_ns);
            self.restarts += 1;
        }
    }

    /// Whether it has no process.
    pub fn is_without_process(&self) -> bool {
        self.process.is_none()
    }

    /// Whether it was given up.
    pub fn is_given_up(&self) -> bool {
        self.state == State::GivenUp
    }

    fn ask_to_end(&mut self, now_ns: u64) {
        if let Some(process) = &self.process {
            process.signal(Signal::TERM);
            self.kill_at_ns = Some(now_ns + STOP_LIMIT_NS);
        }
    }

    fn answer(&mut self, answer: Answer) {
        if let Some(reply) = self.reply.take() {
            let _ = reply.send(answer);
        }
    }

    /// What is told about it at `now_ns`.
    pub fn status(&self, now_ns: u64) -> ServiceStatus {
        ServiceStatus {
            service: self.service.name().to_owned(),
            pid: self.process.as_ref().map(Process::pid),
            state: self.state,
            restarts: self.restarts,
            last_beat_ms: self.health.map(|health| now_ns.saturating_sub(health.time_ns) / 1_000_000),
            answered: self.health.map_or(0, |health| health.answered),
            skipped: self.health.map_or(0, |health| health.skipped),
            adopted: self.adopted,
            last_end: self.last_end.clone(),
            refused: self.health.map_or(0, |health| health.refused),
            lack: self.health.map(|health| Lack::from_number(health.degraded).text().to_owned()),
        }
    }
}

/// The process that was `service` in the instance in `directory` when its supervisor died, if it lives.
pub fn left_behind(directory: &Path, service: Service) -> Option<Identity> {
    place::holder(&directory.join(place::service_lock(service.name())))
}
