//! Who holds the instance: one supervisor, and the services of its run.

use pursuit_messages::Service;
use pursuit_runtime::place;
use pursuit_runtime::process::Identity;
use rustix::fs::{FlockOperation, flock};
use std::fs::File;
use std::io::{Seek, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

pub use pursuit_runtime::place::SERVICES_LOCK;

/// Services that no supervisor has adopted end by themselves; this is patience with a loaded machine, beyond
/// their lease.
const FORMER_RUN_LIMIT: Duration = Duration::from_secs(10);

/// The instance's lock, held as long as this lives. The kernel gives it back when the process dies.
pub struct Held {
    lock: File,
    directory: PathBuf,
}

/// Keeps services from starting while the directory is being swept.
pub struct Sweeping(#[allow(dead_code)] File);

/// Why the instance cannot be had.
#[derive(Debug, thiserror::Error)]
pub enum HeldError {
    /// Another supervisor runs it.
    #[error(
        "the instance in {directory} is held by process {pid}: stop it with `pursuit down`, or choose another --instance"
    )]
    Held {
        /// The run-time directory.
        directory: String,
        /// Who holds it.
        pid: String,
    },
    /// Services of a former run are still there.
    #[error(
        "services of a former run in {directory} are still running and do not end: end them, then start again"
    )]
    FormerRun {
        /// The run-time directory.
        directory: String,
    },
    /// The lock files cannot be used.
    #[error("cannot lock {directory}: {cause}")]
    Io {
        /// The run-time directory.
        directory: String,
        /// The file system's reason.
        #[source]
        cause: std::io::Error,
    },
}

impl Held {
    /// Takes the instance in `directory`: one supervisor at a time. Nobody is told yet: see [`Held::announce`].
    ///
    /// # Errors
    /// [`HeldError`], at once where another supervisor has it.
    pub fn take(directory: &Path) -> Result<Held, HeldError> {
        let name = || directory.display().to_string();
        let path = directory.join(place::LOCK);
        let lock = place::open_lock(&path).map_err(|cause| HeldError::Io { directory: name(), cause })?;
        if flock(&lock, FlockOperation::NonBlockingLockExclusive).is_err() {
            let pid = place::holder(&path).map_or("unknown".to_owned(), |holder| holder.pid.to_string());
            return Err(HeldError::Held { directory: name(), pid });
        }
        Ok(Held { lock, directory: directory.to_owned() })
    }

    /// Waits up to `lease` and some patience until no service of a former run is left.
    ///
    /// # Errors
    /// [`HeldError::FormerRun`].
    pub fn sweep(&self, lease: Duration) -> Result<Sweeping, HeldError> {
        let services =
            place::open_lock(&self.directory.join(SERVICES_LOCK)).map_err(|cause| self.io(cause))?;
        let limit = Instant::now() + lease + FORMER_RUN_LIMIT;
        while flock(&services, FlockOperation::NonBlockingLockExclusive).is_err() {
            if Instant::now() > limit {
                return Err(HeldError::FormerRun { directory: self.directory.display().to_string() });
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        Ok(Sweeping(services))
    }

    /// Tells everybody which process the supervisor is. From now on services do not end for want of one.
    ///
    /// # Errors
    /// [`HeldError::Io`].
    pub fn announce(&mut self) -> Result<(), HeldError> {
        let mut write = || {
            self.lock.set_len(0)?;
            self.lock.rewind()?;
            self.lock.write_all(Identity::own().to_string().as_bytes())
        };
        write().map_err(|cause| self.io(cause))
    }

    /// Gives the instance back.
    pub fn release(self) {
        let _ = self.lock.set_len(0);
        let _ = flock(&self.lock, FlockOperation::Unlock);
    }

    fn io(&self, cause: std::io::Error) -> HeldError {
        HeldError::Io { directory: self.directory.display().to_string(), cause }
    }
}

/// Whether a supervisor holds the instance in `directory`.
pub fn is_held(directory: &Path) -> bool {
    place::supervisor(directory).is_some()
}

/// Whether anything of the instance in `directory` runs: a supervisor, or services that wait for a new one.
pub fn is_running(directory: &Path) -> bool {
    let lives = |service: Service| place::holder(&directory.join(place::service_lock(service.name())));
    is_held(directory) || Service::ALL.into_iter().any(|service| lives(service).is_some())
}
