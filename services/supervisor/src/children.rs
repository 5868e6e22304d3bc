//! The services' processes.

use crate::control::Answer;
use crate::process::{Process, last_line};
use crate::slot::{Reply, Slot, left_behind};
use crate::status::ServiceStatus;
use pursuit_messages::{Health, Service};
use pursuit_runtime::clock::monotonic_ns;
use std::path::{Path, PathBuf};

/// An exit that concerns the whole run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Exit {
    /// The simulator has done its frames.
    RunComplete,
    /// A service cannot run and starting it again does not help; why.
    Hopeless(String),
    /// A service found memory torn that it shares with the others (SIGBUS, SIGSEGV): all of that is thrown away.
    Torn(Service),
}

/// All children.
pub struct Children {
    directory: PathBuf,
    bounded: bool,
    all: Vec<Slot>,
}

impl Children {
    /// `services` from the program at `path`, due to start. In a `bounded` run one that is given up ends the
    /// run, if the loop needs it.
    pub fn new(path: &Path, directory: &Path, services: &[Service], bounded: bool) -> Children {
        let now = monotonic_ns();
        let all = services.iter().map(|&service| Slot::new(service, directory, path, now)).collect();
        Children { directory: directory.to_owned(), bounded, all }
    }

    /// Takes what a former supervisor has left running; how many.
    pub fn adopt(&mut self) -> usize {
        let mut adopted = 0;
        for slot in &mut self.all {
            let left = left_behind(&self.directory, slot.service);
            if let Some(process) = left.and_then(|identity| Process::adopt(identity).ok()) {
                slot.adopt(process);
                adopted += 1;
            }
        }
        adopted
    }

    /// Takes in a heartbeat.
    pub fn hear(&mut self, health: &Health, now_ns: u64) {
        if let Some(slot) = self.all.iter_mut().find(|slot| slot.service as u32 == health.service) {
            slot.hear(health, now_ns);
        }
    }

    /// Looks after all children: who ended, who hangs, who is due to start.
    pub fn look(&mut self, now_ns: u64) -> Option<Exit> {
        if let Some(exit) = self.all.iter_mut().find_map(|slot| slot.look(now_ns)) {
            return Some(exit);
        }
        let ends_the_run = |slot: &&Slot| slot.is_given_up() && slot.service.is_in_the_loop();
        let given_up = self.all.iter().find(ends_the_run).filter(|_| self.bounded)?.service;
        let last = last_line(&self.directory, given_up);
        Some(Exit::Hopeless(format!("{} dies again and again: {last}", given_up.name())))
    }

    /// What is told about all services at `now_ns`.
    pub fn status(&self, now_ns: u64) -> Vec<ServiceStatus> {
        self.all.iter().map(|slot| slot.status(now_ns)).collect()
    }

    /// See [`Slot::restart`].
    pub fn restart(&mut self, service: &str, program: Option<&Path>, reply: Reply) {
        match self.all.iter_mut().find(|slot| slot.service.name() == service) {
            Some(slot) => slot.restart(program, monotonic_ns(), reply),
            None => {
                let known: Vec<&str> = self.all.iter().map(|slot| slot.service.name()).collect();
                let why = format!("{service:?} is not a service of this run; there are {}", known.join(", "));
                let _ = reply.send(Answer::Refused { why });
            }
        }
    }

    /// Asks all to end that `which` holds for.
    pub fn stop(&mut self, which: impl Fn(Service) -> bool) {
        let now = monotonic_ns();
        self.all.iter_mut().filter(|slot| which(slot.service)).for_each(|slot| slot.stop(now));
    }

    /// Whether no process is left of those that `which` holds for.
    pub fn have_ended(&mut self, which: impl Fn(Service) -> bool) -> bool {
        let now = monotonic_ns();
        self.all.iter_mut().filter(|slot| which(slot.service)).fold(true, |all, slot| {
            // How a run ends is decided already.
            let _ = slot.look(now);
            all && slot.is_without_process()
        })
    }

    /// SIGKILL to who is still there, and waits for the kernel to be done with them.
    pub fn kill_all(&mut self) {
        self.all.iter_mut().for_each(Slot::kill);
    }

    /// Starts all again but those that were given up.
    pub fn begin_again(&mut self) {
        let now = monotonic_ns();
        self.all.iter_mut().for_each(|slot| slot.begin_again(now));
    }
}
