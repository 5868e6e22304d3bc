//! Supervisor: starts all services as processes of their own, watches them, restarts one that dies, ends
//! them all, and leaves nothing behind.
//!
//! [`policy`] decides (pure), [`children`] acts, [`control`] lets other terminals ask. Nothing here is on
//! the way of a frame.

pub mod children;
pub mod control;
pub mod instance;
pub mod policy;
pub mod status;

use children::{Children, Exit};
use control::{Answer, Control, Request};
use instance::{Held, HeldError};
use pursuit_bus::{Bus, BusError, Instance, Subscriber};
use pursuit_config::Document;
use pursuit_messages::Service;
use pursuit_messages::topics::Healths;
use pursuit_runtime::clock::monotonic_ns;
use pursuit_runtime::place;
use status::ServiceStatus;
use std::path::{Path, PathBuf};
use std::time::Duration;
use tokio::signal::unix::{Signal, SignalKind, signal};

/// How often children and heartbeats are looked at.
const WATCH: Duration = Duration::from_millis(20);
/// How often what dead processes left on the bus is given back.
const CLEAN_NS: u64 = 1_000_000_000;
/// After SIGTERM a child has this long to end by itself.
const STOP_LIMIT_NS: u64 = 3_000_000_000;
/// The kernel must have this many times the bus's budget free.
const MEMORY_FACTOR: u64 = 2;

/// What to run.
pub struct Plan {
    /// The run-time directory of the instance.
    pub directory: PathBuf,
    /// The config, already checked.
    pub document: Document,
    /// The program that knows `run SERVICE`.
    pub program: PathBuf,
    /// Which services, in the order in which they are started and shown.
    pub services: Vec<Service>,
    /// Bytes of a camera frame, for the memory budget.
    pub frame_bytes: usize,
    /// Whether the run has an end: then a service that is given up ends it.
    pub bounded: bool,
}

/// How a run ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Ended {
    /// The simulator has done the configured number of frames.
    Finished,
    /// Somebody asked for it: a signal or `pursuit down`.
    Stopped,
    /// A service cannot run; a sentence that says why.
    Failed(String),
}

/// Why a run cannot begin or go on.
#[derive(Debug, thiserror::Error)]
pub enum SupervisorError {
    /// The instance belongs to another supervisor, or its directory is unusable.
    #[error(transparent)]
    Held(#[from] HeldError),
    /// The bus failed.
    #[error(transparent)]
    Bus(#[from] BusError),
    /// The run-time directory is unusable.
    #[error(transparent)]
    Instance(#[from] pursuit_bus::InstanceError),
    /// Too little shared memory.
    #[error(
        "the bus needs {needed_mb} MB of shared memory, /dev/shm has {free_mb} MB free: make room, or choose a smaller camera frame"
    )]
    Memory {
        /// What must be free, MB.
        needed_mb: u64,
        /// What is, MB.
        free_mb: u64,
    },
    /// Something with the operating system.
    #[error("{what}: {cause}")]
    System {
        /// What was tried.
        what: &'static str,
        /// Its reason.
        #[source]
        cause: std::io::Error,
    },
}

/// What a watcher sees of a run, some times a second.
pub struct Glance<'a> {
    /// All services.
    pub services: &'a [ServiceStatus],
    /// The run-time directory, with the journal of the run.
    pub directory: &'a std::path::Path,
}

/// How often the watcher is called.
const GLANCE_NS: u64 = 100_000_000;

/// Runs the system until it is finished or stopped; `watch` is called ten times a second. When this
/// returns, no process and no shared memory of the instance is left.
///
/// # Errors
/// [`SupervisorError`]; nothing was started then, or everything has been ended.
pub async fn run(plan: Plan, mut watch: impl FnMut(&Glance<'_>)) -> Result<Ended, SupervisorError> {
    let mut stops = Stops::take_over()?;
    let instance = Instance::at(&plan.directory)?;
    let mut held = Held::take(&plan.directory)?;
    prepare(&plan, &instance)?;
    held.swept();
    let outcome = supervise(&plan, &instance, &mut stops, &mut watch).await;
    instance.wipe();
    held.release();
    outcome
}

/// Cold start: whatever an earlier run left goes, the config for this run is written.
fn prepare(plan: &Plan, instance: &Instance) -> Result<(), SupervisorError> {
    instance.wipe();
    sweep(&plan.directory);
    let needed = pursuit_bus::memory_budget(plan.frame_bytes) as u64 * MEMORY_FACTOR;
    let free = rustix::fs::statvfs("/dev/shm").map_or(u64::MAX, |shm| shm.f_bavail * shm.f_frsize);
    if free < needed {
        return Err(SupervisorError::Memory { needed_mb: needed >> 20, free_mb: free >> 20 });
    }
    std::fs::write(plan.directory.join(place::CONFIG), plan.document.to_toml())
        .map_err(|cause| SupervisorError::System { what: "cannot write the run's config", cause })
}

/// Removes the files of an earlier run, by name: whatever else is in the directory is not ours.
fn sweep(directory: &Path) {
    let of_services = Service::ALL.into_iter().flat_map(|service| {
        let checkpoint = directory.join(place::checkpoint(service.name()));
        let refused = pursuit_runtime::checkpoint::refused_name(&checkpoint);
        [children::log_file(directory, service), checkpoint, refused]
    });
    let of_the_run =
        [place::CONFIG, place::CONTROL, place::OBSERVER, place::JOURNAL, place::MOVES, place::TRAJECTORY];
    for file in of_the_run.map(|name| directory.join(name)).into_iter().chain(of_services) {
        let _ = std::fs::remove_file(file);
    }
}

async fn supervise(
    plan: &Plan,
    instance: &Instance,
    stops: &mut Stops,
    watch: &mut impl FnMut(&Glance<'_>),
) -> Result<Ended, SupervisorError> {
    let mut control = Control::listen(&plan.directory.join(place::CONTROL))
        .map_err(|cause| SupervisorError::System { what: "cannot open the control socket", cause })?;
    let bus = Bus::join(instance, Service::Supervisor.name())?;
    let _topics = bus.hold_all_topics()?;
    let healths = bus.subscriber(Healths)?;
    let mut children = Children::start(&plan.program, &plan.directory, &plan.services, plan.bounded);
    let mut watch_timer = tokio::time::interval(WATCH);
    watch_timer.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
    let (mut next_glance_ns, mut next_clean_ns) = (0, monotonic_ns() + CLEAN_NS);
    let ended = loop {
        tokio::select! {
            () = stops.asked() => break Ok(Ended::Stopped),
            Some((request, reply)) = control.next() => {
                let down = request == Request::Down;
                let _ = reply.send(answer(&request, &mut children));
                if down { break Ok(Ended::Stopped) }
            }
            _ = watch_timer.tick() => {
                let now = monotonic_ns();
                if let Err(error) = hear(&healths, &mut children) {
                    break Err(error.into());
                }
                if let Some(exit) = children.look(now) {
                    match exit {
                        Exit::RunComplete => break Ok(Ended::Finished),
                        Exit::Hopeless(why) => break Ok(Ended::Failed(why)),
                    }
                }
                if now >= next_clean_ns {
                    next_clean_ns = now + CLEAN_NS;
                    bus.clean_dead();
                }
                if now >= next_glance_ns {
                    next_glance_ns = now + GLANCE_NS;
                    watch(&Glance { services: &children.status(now), directory: &plan.directory });
                }
            }
        }
    };
    stop_all(&mut children, stops).await;
    watch(&Glance { services: &children.status(monotonic_ns()), directory: &plan.directory });
    ended
}

/// The signals that end a run.
struct Stops {
    all: [Signal; 3],
}

impl Stops {
    /// Takes them over; before this they kill the process, after it they are asked for.
    fn take_over() -> Result<Stops, SupervisorError> {
        let take = |kind| {
            signal(kind)
                .map_err(|cause| SupervisorError::System { what: "cannot take over the stop signals", cause })
        };
        let all =
            [take(SignalKind::interrupt())?, take(SignalKind::terminate())?, take(SignalKind::hangup())?];
        Ok(Stops { all })
    }

    /// Returns when one of them has come.
    async fn asked(&mut self) {
        let [interrupt, terminate, hang_up] = &mut self.all;
        tokio::select! {
            _ = interrupt.recv() => {}
            _ = terminate.recv() => {}
            _ = hang_up.recv() => {}
        }
    }
}

/// SIGTERM to all, then SIGKILL to who is still there; a second signal kills at once.
async fn stop_all(children: &mut Children, stops: &mut Stops) {
    children.ask_all_to_end();
    let limit = monotonic_ns() + STOP_LIMIT_NS;
    let mut timer = tokio::time::interval(WATCH);
    while !children.all_ended() && monotonic_ns() < limit {
        tokio::select! {
            () = stops.asked() => break,
            _ = timer.tick() => {}
        }
    }
    children.kill_all();
}

fn hear(healths: &Subscriber<Healths>, children: &mut Children) -> Result<(), BusError> {
    while let Some(message) = healths.receive()? {
        children.hear(message.payload());
    }
    Ok(())
}

fn answer(request: &Request, children: &mut Children) -> Answer {
    match request {
        Request::Status => Answer::Status { services: children.status(monotonic_ns()) },
        Request::Restart { service } => match Service::from_name(service) {
            Some(service) if children.restart(service) => Answer::Done,
            _ => {
                let known = Service::ALL.map(Service::name).join(", ");
                Answer::Refused { why: format!("{service:?} is not a running service; there are {known}") }
            }
        },
        Request::Down => Answer::Done,
    }
}
