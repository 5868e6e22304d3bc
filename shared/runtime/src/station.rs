//! A service's place in the system: its bus, its config, its heartbeat, its end.

use crate::clock::{monotonic_ns, sleep_until_ns};
use crate::process::Identity;
use crate::settings::Run;
use crate::systemd::Systemd;
use crate::{logging, place};
use pursuit_bus::{Bus, BusError, Instance, InstanceError, Publisher};
use pursuit_config::{Checker, Document, Faults, Scope};
use pursuit_messages::topics::Healths;
use pursuit_messages::{Health, ImageShape, Service, Stamp};
use rustix::fs::{FlockOperation, flock};
use std::ffi::CString;
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Longest wait of a service's loop: bounds what a lost wake-up costs, and how late a stop is seen.
pub const TICK: Duration = Duration::from_millis(10);
/// Period of the heartbeat, ns.
pub const BEAT_NS: u64 = 50_000_000;
/// Set by the supervisor for its children: its [`Identity`]. A service that has none is on its own.
pub const SUPERVISOR: &str = "PURSUIT_SUPERVISOR";
/// Who stands by looks so often whether the process before it has left.
const STANDBY_LOOK: Duration = Duration::from_millis(1);
/// Who stands by says so after this time, ns: by then its inputs have what is kept for those who come late
/// (writers look for new readers each [`TICK`]).
const STANDBY_READY_NS: u64 = 50_000_000;

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
    leash: Option<Leash>,
    /// Who is on its own tells systemd.
    systemd: Option<Systemd>,
    next_beat_ns: u64,
    /// Says that this process is the service; the kernel gives it back with the process.
    turf: Option<File>,
    /// Says that a service of this instance lives.
    _alive: File,
}

/// How long a service goes on without a supervisor.
struct Leash {
    lease_ns: u64,
    /// When there was one last.
    seen_ns: u64,
}

impl Station {
    /// Starts logging, reads the config of the run in `directory`, joins the bus and takes over the
    /// stop signals (SIGTERM, SIGINT).
    ///
    /// # Errors
    /// [`ServiceError`].
    pub fn start(service: Service, directory: &Path) -> Result<Station, ServiceError> {
        logging::start();
        // What `ps` and `top` show.
        let name = CString::new(service.name()).unwrap_or_default();
        let _ = rustix::thread::set_name(&name);
        let document = Document::load(&directory.join(place::CONFIG))?;
        let instance = Instance::at(directory)?;
        let alive = share_services_lock(directory)?;
        let checker = Checker::new(&document);
        let lease_ns = Run::read(&checker).lease_ns;
        checker.finish(Scope::ReadKeys)?;
        let parent: Option<Identity> = std::env::var(SUPERVISOR).ok().and_then(|text| text.parse().ok());
        // The supervisor may have died while this process waited: its run may be over, touch nothing.
        if parent.is_some_and(|parent| !parent.lives()) {
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
        Ok(Station {
            bus,
            document,
            health,
            directory: directory.to_path_buf(),
            service,
            pulse,
            stop,
            systemd: parent.is_none().then(Systemd::default),
            leash: parent.map(|_| Leash { lease_ns, seen_ns: monotonic_ns() }),
            next_beat_ns: 0,
            turf: None,
            _alive: alive,
        })
    }

    /// Waits until this process is the service: at once, or when the one before it has left. What is attached
    /// to the bus before this call misses nothing meanwhile; what only one process may have (a saved state, a
    /// camera, the drives) is opened after it. `false` means: end now.
    ///
    /// # Errors
    /// [`ServiceError::Other`] where the lock file cannot be used.
    pub fn take_over(&mut self) -> Result<bool, ServiceError> {
        let path = self.directory.join(place::service_lock(self.service.name()));
        let cannot =
            |cause: std::io::Error| ServiceError::Other(format!("cannot lock {}: {cause}", path.display()));
        let mut file = place::open_lock(&path).map_err(cannot)?;
        let begin = monotonic_ns();
        while let Err(error) = flock(&file, FlockOperation::NonBlockingLockExclusive) {
            if error != rustix::io::Errno::WOULDBLOCK {
                return Err(cannot(error.into()));
            }
            let is_ready = monotonic_ns() >= begin + STANDBY_READY_NS;
            self.health.standing_by = u32::from(is_ready);
            // Its first beat says that it is ready.
            let goes_on = if is_ready { self.turn() } else { !self.stop.load(Ordering::Relaxed) };
            if !goes_on {
                return Ok(false);
            }
            std::thread::sleep(STANDBY_LOOK);
        }
        file.set_len(0).map_err(cannot)?;
        file.write_all(Identity::own().to_string().as_bytes()).map_err(cannot)?;
        self.health.standing_by = 0;
        self.next_beat_ns = 0;
        self.turf = Some(file);
        if let Some(systemd) = &mut self.systemd {
            systemd.ready();
        }
        Ok(true)
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
            if let Some(systemd) = &mut self.systemd {
                systemd.lives(now);
            }
            if !self.is_wanted(now) {
                tracing::warn!(service = self.service.name(), "no supervisor any more: ending");
                return false;
            }
        }
        !self.stop.load(Ordering::Relaxed)
    }

    /// Whether there is a supervisor, or was one a lease ago; who stands by has no lease.
    fn is_wanted(&mut self, now: u64) -> bool {
        let Some(leash) = &mut self.leash else { return true };
        if place::supervisor(&self.directory).is_some() {
            leash.seen_ns = now;
            return true;
        }
        self.turf.is_some() && now.saturating_sub(leash.seen_ns) < leash.lease_ns
    }

    /// Sleeps until `deadline_ns` on CLOCK_MONOTONIC, and beats meanwhile. `false` means: end now.
    pub fn sleep_until(&mut self, deadline_ns: u64) -> bool {
        while monotonic_ns() < deadline_ns {
            if !self.turn() {
                return false;
            }
            sleep_until_ns(deadline_ns.min(monotonic_ns() + TICK.as_nanos() as u64));
        }
        true
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
fn share_services_lock(directory: &Path) -> Result<File, ServiceError> {
    let path = directory.join(place::SERVICES_LOCK);
    let cannot =
        |cause: std::io::Error| ServiceError::Other(format!("cannot lock {}: {cause}", path.display()));
    let file = place::open_lock(&path).map_err(cannot)?;
    flock(&file, FlockOperation::LockShared).map_err(|e| cannot(e.into()))?;
    Ok(file)
}
