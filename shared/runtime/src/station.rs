//! A service's place in the system: its bus, its config, its heartbeat, its end.

use crate::clock::monotonic_ns;
use crate::{logging, place};
use pursuit_bus::{Bus, BusError, Instance, InstanceError, Publisher};
use pursuit_config::{Checker, Document, Faults, Scope};
use pursuit_messages::topics::Healths;
use pursuit_messages::{Health, ImageShape, Service, Stamp};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Longest wait of a service's loop: bounds what a lost wake-up costs, and how late a stop is seen.
pub const TICK: Duration = Duration::from_millis(10);
/// Period of the heartbeat.
const BEAT_NS: u64 = 100_000_000;
/// Set by the supervisor for its children: a service whose parent is another process ends by itself.
pub const SUPERVISOR_PID: &str = "PURSUIT_SUPERVISOR_PID";

/// Why a service ended.
#[derive(Debug, thiserror::Error)]
pub enum ServiceError {
    /// Wrong config.
    #[error("{0}")]
    Config(#[from] Faults),
    /// The run-time directory is unusable.
    #[error(transparent)]
    Instance(#[from] InstanceError),
    /// The bus failed.
    #[error(transparent)]
    Bus(#[from] BusError),
    /// A checkpoint failed.
    #[error(transparent)]
    Checkpoint(#[from] crate::checkpoint::CheckpointError),
    /// Something else, with a sentence that says what to do.
    #[error("{0}")]
    Other(String),
}

impl ServiceError {
    /// The exit code for it (see [`crate::exit`]).
    pub fn exit_code(&self) -> u8 {
        match self {
            ServiceError::Config(_) | ServiceError::Instance(_) => crate::exit::DO_NOT_RESTART,
            ServiceError::Bus(error) if error.is_version() => crate::exit::DO_NOT_RESTART,
            _ => crate::exit::FAILED,
        }
    }
}

/// Everything a service needs besides its own step.
pub struct Station {
    /// The bus of the instance.
    pub bus: Bus,
    /// The checked config of the run.
    document: Document,
    /// What the heartbeat says; the loop counts in it.
    pub health: Health,
    directory: PathBuf,
    service: Service,
    pulse: Publisher<Healths>,
    stop: Arc<AtomicBool>,
    parent: Option<u32>,
    next_beat_ns: u64,
    /// Says that a service of this instance lives; the kernel gives it back with the process.
    _alive: std::fs::File,
}

impl Station {
    /// Starts logging, reads the config of the run in `directory`, joins the bus and takes over the
    /// stop signals (SIGTERM, SIGINT).
    ///
    /// # Errors
    /// [`ServiceError`].
    pub fn start(service: Service, directory: &Path) -> Result<Station, ServiceError> {
        logging::start();
        let document = Document::load(&directory.join(place::CONFIG))?;
        let instance = Instance::at(directory)?;
        let alive = share_services_lock(directory)?;
        let parent = std::env::var(SUPERVISOR_PID).ok().and_then(|text| text.parse().ok());
        // The supervisor may have died while this process waited: its run is over, touch nothing.
        if parent.is_some_and(|pid: u32| std::os::unix::process::parent_id() != pid) {
            return Err(ServiceError::Other("the supervisor that started this service is gone".to_owned()));
        }
        let bus = Bus::join(&instance, service.name())?;
        let pulse = bus.publisher(Healths)?;
        let stop = Arc::new(AtomicBool::new(false));
        for signal in [signal_hook::consts::SIGTERM, signal_hook::consts::SIGINT] {
            signal_hook::flag::register(signal, Arc::clone(&stop))
                .map_err(|e| ServiceError::Other(format!("cannot take over signal {signal}: {e}")))?;
        }
        let health = Health { service: service as u32, pid: std::process::id(), ..Health::default() };
        let directory = directory.to_path_buf();
        Ok(Station {
            bus,
            document,
            health,
            directory,
            service,
            pulse,
            stop,
            parent,
            next_beat_ns: 0,
            _alive: alive,
        })
    }

    /// A service's own part of the config, by its reader.
    ///
    /// # Errors
    /// All faults of the keys that were read, at once.
    pub fn config<T>(&self, read: impl FnOnce(&Checker<'_>) -> T) -> Result<T, ServiceError> {
        let checker = Checker::new(&self.document);
        let config = read(&checker);
        checker.finish(Scope::ReadKeys)?;
        Ok(config)
    }

    /// The run-time directory.
    pub fn directory(&self) -> &Path {
        &self.directory
    }

    /// Where its state is saved, if it has any.
    pub fn checkpoint_file(&self) -> PathBuf {
        self.directory.join(place::checkpoint(self.service.name()))
    }

    /// Which service this is.
    pub fn service(&self) -> Service {
        self.service
    }

    /// One turn of the loop: beats when it is time. `false` means: end now.
    pub fn turn(&mut self) -> bool {
        let now = monotonic_ns();
        if now >= self.next_beat_ns {
            self.next_beat_ns = now + BEAT_NS;
            self.beat(now);
            if self.parent.is_some_and(|pid| std::os::unix::process::parent_id() != pid) {
                tracing::warn!(service = self.service.name(), "the supervisor is gone: ending");
                return false;
            }
        }
        !self.stop.load(Ordering::Relaxed)
    }

    /// Counts a frame as answered.
    pub fn answered(&mut self, frame: u64) {
        self.health.frame = frame;
        self.health.answered += 1;
    }

    fn beat(&mut self, now: u64) {
        self.health.time_ns = now;
        let stamp = Stamp::new(0, self.health.frame, now, ImageShape::default());
        // A heartbeat that cannot be sent is seen as missing by the supervisor; the loop goes on.
        let _ = self.pulse.publish(&stamp, &self.health);
    }
}

/// Shares the lock of all services; waits while a supervisor sweeps the directory.
fn share_services_lock(directory: &Path) -> Result<std::fs::File, ServiceError> {
    let path = directory.join(place::SERVICES_LOCK);
    let cannot =
        |cause: std::io::Error| ServiceError::Other(format!("cannot lock {}: {cause}", path.display()));
    let file = std::fs::File::options()
        .read(true)
        .write(true)
        .create(true)
        .truncate(false)
        .open(&path)
        .map_err(cannot)?;
    rustix::fs::flock(&file, rustix::fs::FlockOperation::LockShared).map_err(|e| cannot(e.into()))?;
    Ok(file)
}
