//! Where an instance lives: names of the files in its run-time directory.

use crate::process::Identity;
use std::fs::File;
use std::path::{Path, PathBuf};

/// Instance name of `config/sim.toml`, and of the command line where none is given.
pub const DEFAULT_INSTANCE: &str = "sim";

/// The run-time directory of the instance `name`: below `$PURSUIT_RUN_DIR`, else
/// `$XDG_RUNTIME_DIR/pursuit`, else `/dev/shm/pursuit-UID`: in memory, since state is written there with every sample.
pub fn directory(name: &str) -> PathBuf {
    let base = std::env::var_os("PURSUIT_RUN_DIR").map(PathBuf::from).or_else(|| {
        std::env::var_os("XDG_RUNTIME_DIR")
            .filter(|dir| !dir.is_empty())
            .map(|dir| Path::new(&dir).join("pursuit"))
    });
    base.unwrap_or_else(|| PathBuf::from(format!("/dev/shm/pursuit-{}", rustix::process::getuid().as_raw())))
        .join(name)
}

/// The checked config that all services of a run read.
pub const CONFIG: &str = "config.toml";
/// Locked by the supervisor for as long as it lives; says which process that is.
pub const LOCK: &str = "lock";
/// The supervisor's control socket.
pub const CONTROL: &str = "control";
/// What shows that somebody may do more from the live page than look and stop.
pub const TOKEN: &str = "page.token";
/// The address at which the observer answers over HTTP.
pub const OBSERVER: &str = "observer.address";
/// What the camera shall have, for tests (`acquisition.faults`).
pub const CAMERA_FAULT: &str = "camera.fault";
/// What the simulated scene is painted with, for the camera's next process.
pub const TEXTURES: &str = "textures";
/// One line per frame of the simulated run.
pub const JOURNAL: &str = "journal.csv";
/// One line per training move: what the network was after it.
pub const MOVES: &str = "moves.csv";
/// The checkpoint of a service that has state.
pub fn checkpoint(service: &str) -> String {
    format!("{service}.checkpoint")
}

/// Hash of the whole trajectory, written when a run is finished: without it, it was not.
pub const TRAJECTORY: &str = "trajectory.sha256";
/// Held (shared) by every service as long as it lives: who can lock it alone knows that none is left.
pub const SERVICES_LOCK: &str = "services.lock";

/// Locked by the process that is the service now; says which one that is.
pub fn service_lock(service: &str) -> String {
    format!("{service}.lock")
}

/// Opens a lock file of the run-time directory, which is made where it is missing.
///
/// # Errors
/// The file system's reason.
pub fn open_lock(path: &Path) -> std::io::Result<File> {
    File::options().read(true).write(true).create(true).truncate(false).open(path)
}

/// The process that a lock file names, if it lives. Nothing is locked to find out.
pub fn holder(lock: &Path) -> Option<Identity> {
    let identity: Identity = std::fs::read_to_string(lock).ok()?.parse().ok()?;
    identity.lives().then_some(identity)
}

/// The supervisor of the instance in `directory`, if it lives.
pub fn supervisor(directory: &Path) -> Option<Identity> {
    holder(&directory.join(LOCK))
}
