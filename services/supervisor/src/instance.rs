//! Who holds the instance: one supervisor, and the services of its run.

use pursuit_runtime::place;
use rustix::fs::{FlockOperation, flock};
use std::fs::File;
use std::io::{Read, Seek, Write};
use std::path::Path;
use std::time::{Duration, Instant};

pub use pursuit_runtime::place::SERVICES_LOCK;

/// Services of a supervisor that was killed end within a heartbeat; on a loaded machine it takes longer.
const FORMER_RUN_LIMIT: Duration = Duration::from_secs(10);

/// The instance's lock, held as long as this lives. The kernel gives it back when the process dies.
pub struct Held {
    lock: File,
    /// Keeps services from starting while the directory is being swept.
    sweeping: Option<File>,
}

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
    /// Takes the instance in `directory`: one supervisor at a time. Waits until no service of a former run
    /// is left (they end by themselves when their supervisor is gone).
    ///
    /// # Errors
    /// [`HeldError`], at once where another supervisor has it.
    pub fn take(directory: &Path) -> Result<Held, HeldError> {
        let name = || directory.display().to_string();
        let io = |cause| HeldError::Io { directory: name(), cause };
        let mut lock = open(&directory.join(place::LOCK)).map_err(io)?;
        if flock(&lock, FlockOperation::NonBlockingLockExclusive).is_err() {
            let mut pid = String::new();
            let _ = lock.read_to_string(&mut pid);
            return Err(HeldError::Held { directory: name(), pid: pid.trim().to_owned() });
        }
        lock.set_len(0).map_err(io)?;
        lock.rewind().map_err(io)?;
        writeln!(lock, "{}", std::process::id()).map_err(io)?;
        let services = open(&directory.join(SERVICES_LOCK)).map_err(io)?;
        let limit = Instant::now() + FORMER_RUN_LIMIT;
        while flock(&services, FlockOperation::NonBlockingLockExclusive).is_err() {
            if Instant::now() > limit {
                return Err(HeldError::FormerRun { directory: name() });
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        Ok(Held { lock, sweeping: Some(services) })
    }

    /// The directory is swept: services may start.
    pub fn swept(&mut self) {
        self.sweeping = None;
    }

    /// Gives the instance back.
    pub fn release(self) {
        let _ = self.lock.set_len(0);
        let _ = flock(&self.lock, FlockOperation::Unlock);
    }
}

/// Whether a supervisor holds the instance in `directory`.
pub fn is_held(directory: &Path) -> bool {
    let Ok(lock) = File::open(directory.join(place::LOCK)) else { return false };
    flock(&lock, FlockOperation::NonBlockingLockShared).is_err()
}

fn open(path: &Path) -> std::io::Result<File> {
    File::options().read(true).write(true).create(true).truncate(false).open(path)
}
