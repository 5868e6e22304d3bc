//! Supervisor: starts all services as processes of their own, watches them, restarts one that dies or hangs,
//! ends them all, and leaves nothing behind. Where a supervisor before it died, it adopts what that one started.
//!
//! [`policy`] and [`pulse`] decide (pure), a [`slot`] acts for one service, [`control`] lets other terminals ask.
//! Nothing here is on the way of a frame.

pub mod children;
pub mod control;
pub mod instance;
pub mod policy;
pub mod process;
pub mod pulse;
pub mod slot;
pub mod status;

use children::{Children, Exit};
use control::{Answer, Control, Request};
use instance::{Held, HeldError};
use pursuit_bus::{Bus, BusError, HeldTopics, Instance, Subscriber};
use pursuit_config::Document;
use pursuit_messages::Service;
use pursuit_messages::topics::Healths;
use pursuit_runtime::clock::monotonic_ns;
use pursuit_runtime::place;
use pursuit_runtime::systemd::{self, Systemd};
use slot::Reply;
use status::{ServiceStatus, State};
use std::io::{Read, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};
use std::time::Duration;
use tokio::signal::unix::{Signal, SignalKind, signal};

/// How often children and heartbeats are looked at.
const WATCH: Duration = Duration::from_millis(20);
/// How often is looked whether all have ended.
const END_LOOK: Duration = Duration::from_millis(5);
/// How often what dead processes left on the bus is given back.
const CLEAN_NS: u64 = 1_000_000_000;
/// The arm driver has so long to bring the arm to rest and end, before the others are asked to end, ns.
const REST_LIMIT_NS: u64 = 1_000_000_000;
/// Then all have so long, ns; who is still there is killed.
const END_LIMIT_NS: u64 = slot::STOP_LIMIT_NS;
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
    /// Services go on for so long without a supervisor.
    pub lease: Duration,
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
    let mut children = Children::new(&plan.program, &plan.directory, &plan.services, plan.bounded);
    if !adopt(&plan, &mut children, &mut stops).await {
        let _sweeping = held.sweep(plan.lease)?;
        prepare(&plan, &instance)?;
    }
    held.announce()?;
    let outcome = supervise(&plan, &instance, &mut children, &mut stops, &mut watch).await;
    instance.wipe();
    held.release();
    outcome
}

/// Adopts what a former supervisor has left, if it is of this run; whether there was any. What is of a run with
/// another config is ended.
async fn adopt(plan: &Plan, children: &mut Children, stops: &mut Stops) -> bool {
    let adopted = children.adopt();
    if adopted == 0 {
        return false;
    }
    let running = std::fs::read_to_string(plan.directory.join(place::CONFIG)).unwrap_or_default();
    if running == plan.document.to_toml() {
        tracing::warn!("the supervisor before this one died: {adopted} services adopted, none restarted");
        return true;
    }
    tracing::warn!(
        "the supervisor before this one died: ending its {adopted} services, their config is another"
    );
    stop_all(children, stops).await;
    *children = Children::new(&plan.program, &plan.directory, &plan.services, plan.bounded);
    false
}

/// Cold start: whatever an earlier run left goes, the config for this run is written.
fn prepare(plan: &Plan, instance: &Instance) -> Result<(), SupervisorError> {
    instance.wipe();
    sweep(&plan.directory);
    let budget = pursuit_bus::memory_budget(plan.frame_bytes) as u64;
    let needed = budget * MEMORY_FACTOR;
    let free = rustix::fs::statvfs("/dev/shm").map_or(u64::MAX, |shm| shm.f_bavail * shm.f_frsize);
    if free < needed {
        return Err(SupervisorError::Memory { needed_mb: needed >> 20, free_mb: free >> 20 });
    }
    tracing::info!("shared memory: at most {} MB of {} MB free", budget >> 20, free >> 20);
    write_token(&plan.directory.join(place::TOKEN))
        .map_err(|cause| SupervisorError::System { what: "cannot write the live page's token", cause })?;
    std::fs::write(plan.directory.join(place::CONFIG), plan.document.to_toml())
        .map_err(|cause| SupervisorError::System { what: "cannot write the run's config", cause })
}

/// 128 random bits that nobody else can read.
fn write_token(path: &Path) -> std::io::Result<()> {
    let mut random = [0u8; 16];
    std::fs::File::open("/dev/urandom")?.read_exact(&mut random)?;
    let token: String = random.iter().map(|byte| format!("{byte:02x}")).collect();
    let mut file = std::fs::File::options().write(true).create(true).truncate(true).mode(0o600).open(path)?;
    file.write_all(token.as_bytes())
}

/// Removes the files of an earlier run, by name: whatever else is in the directory is not ours.
fn sweep(directory: &Path) {
    let of_services = Service::ALL.into_iter().flat_map(|service| {
        let checkpoint = directory.join(place::checkpoint(service.name()));
        let refused = pursuit_runtime::checkpoint::refused_name(&checkpoint);
        let lock = directory.join(place::service_lock(service.name()));
        [process::log_file(directory, service), checkpoint, refused, lock]
    });
    let of_the_run = [
        place::CONFIG,
        place::CONTROL,
        place::OBSERVER,
        place::TOKEN,
        place::CAMERA_FAULT,
        place::JOURNAL,
        place::MOVES,
        place::TRAJECTORY,
    ];
    for file in of_the_run.map(|name| directory.join(name)).into_iter().chain(of_services) {
        let _ = std::fs::remove_file(file);
    }
}

/// The supervisor's own place on the bus.
struct Post {
    healths: Subscriber<Healths>,
    _topics: HeldTopics,
    bus: Bus,
}

impl Post {
    fn open(instance: &Instance) -> Result<Post, BusError> {
        let bus = Bus::join(instance, Service::Supervisor.name())?;
        Ok(Post { _topics: bus.hold_all_topics()?, healths: bus.subscriber(Healths)?, bus })
    }
}

/// Why a watch ended.
enum Watch {
    Ended(Ended),
    /// Shared memory is not to be trusted any more.
    Torn,
}

async fn supervise(
    plan: &Plan,
    instance: &Instance,
    children: &mut Children,
    stops: &mut Stops,
    watch: &mut impl FnMut(&Glance<'_>),
) -> Result<Ended, SupervisorError> {
    let mut control = Control::listen(&plan.directory.join(place::CONTROL))
        .map_err(|cause| SupervisorError::System { what: "cannot open the control socket", cause })?;
    let ended = loop {
        let post = match Post::open(instance) {
            Ok(post) => post,
            Err(error) => break Err(error.into()),
        };
        match keep_watch(plan, &post, &mut control, children, stops, watch).await {
            Ok(Watch::Ended(ended)) => break Ok(ended),
            Ok(Watch::Torn) => {
                let goes_on = stop_all(children, stops).await;
                drop(post);
                instance.wipe();
                if !goes_on {
                    break Ok(Ended::Stopped);
                }
                children.begin_again();
            }
            Err(error) => break Err(error),
        }
    };
    systemd::stopping();
    stop_all(children, stops).await;
    watch(&Glance { services: &children.status(monotonic_ns()), directory: &plan.directory });
    ended
}

async fn keep_watch(
    plan: &Plan,
    post: &Post,
    control: &mut Control,
    children: &mut Children,
    stops: &mut Stops,
    watch: &mut impl FnMut(&Glance<'_>),
) -> Result<Watch, SupervisorError> {
    let mut deaths = signal(SignalKind::child())
        .map_err(|cause| SupervisorError::System { what: "cannot be told of children that end", cause })?;
    let mut systemd = Systemd::default();
    let mut watch_timer = tokio::time::interval(WATCH);
    watch_timer.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
    let (mut next_glance_ns, mut next_clean_ns) = (0, monotonic_ns() + CLEAN_NS);
    loop {
        tokio::select! {
            () = stops.asked() => return Ok(Watch::Ended(Ended::Stopped)),
            Some((request, reply)) = control.next() => {
                if answer(&request, reply, children) {
                    return Ok(Watch::Ended(Ended::Stopped));
                }
                continue;
            }
            _ = deaths.recv() => {}
            _ = watch_timer.tick() => {}
        }
        let now = monotonic_ns();
        while let Some(message) = post.healths.receive()? {
            children.hear(message.payload(), now);
        }
        match children.look(now) {
            Some(Exit::RunComplete) => return Ok(Watch::Ended(Ended::Finished)),
            Some(Exit::Hopeless(why)) => return Ok(Watch::Ended(Ended::Failed(why))),
            Some(Exit::Torn(service)) => {
                tracing::error!(
                    service = service.name(),
                    "found its shared memory torn: all services begin anew"
                );
                return Ok(Watch::Torn);
            }
            None => {}
        }
        if now >= next_clean_ns {
            next_clean_ns = now + CLEAN_NS;
            post.bus.clean_dead();
        }
        if now >= next_glance_ns {
            next_glance_ns = now + GLANCE_NS;
            let services = children.status(now);
            systemd.tell(&summary(&services));
            if services.iter().all(|service| service.state == State::Running) {
                systemd.ready();
            }
            watch(&Glance { services: &services, directory: &plan.directory });
        }
        systemd.lives(now);
    }
}

/// One line on all services.
fn summary(services: &[ServiceStatus]) -> String {
    let others: Vec<String> = services
        .iter()
        .filter(|service| service.state != State::Running)
        .map(|service| format!("{} {}", service.service, service.state.word()))
        .collect();
    if others.is_empty() { format!("{} services run", services.len()) } else { others.join(", ") }
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

/// SIGTERM to the arm driver, and when the arm is at rest to all others; then SIGKILL to who is still there. A
/// signal meanwhile kills at once; whether none came.
async fn stop_all(children: &mut Children, stops: &mut Stops) -> bool {
    let moves_the_arm = |service| service == Service::ArmDriver;
    children.stop(moves_the_arm);
    let mut goes_on = ended_within(children, stops, REST_LIMIT_NS, moves_the_arm).await;
    if goes_on {
        children.stop(|_| true);
        goes_on = ended_within(children, stops, END_LIMIT_NS, |_| true).await;
    }
    children.kill_all();
    goes_on
}

/// Waits until those have ended that `which` holds for; `false` where a signal came.
async fn ended_within(
    children: &mut Children,
    stops: &mut Stops,
    limit_ns: u64,
    which: impl Fn(Service) -> bool,
) -> bool {
    let limit = monotonic_ns() + limit_ns;
    let mut timer = tokio::time::interval(END_LOOK);
    while !children.have_ended(&which) && monotonic_ns() < limit {
        tokio::select! {
            () = stops.asked() => return false,
            _ = timer.tick() => {}
        }
    }
    true
}

/// Answers a question, now or later; whether everything shall end.
fn answer(request: &Request, reply: Reply, children: &mut Children) -> bool {
    let now = match request {
        Request::Status => Answer::Status { services: children.status(monotonic_ns()) },
        Request::Restart { service, program } => {
            children.restart(service, program.as_deref(), reply);
            return false;
        }
        Request::Down => Answer::Done,
    };
    let _ = reply.send(now);
    *request == Request::Down
}
