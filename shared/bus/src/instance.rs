//! Which system a process belongs to: the run-time directory and what follows from it.

use iceoryx2::prelude::{Config, FileName, Path as IoxPath, SemanticString};
use std::path::{Path, PathBuf};

/// A Unix socket's path must stay below 108 bytes; the transport adds up to 48 to root and prefix.
const MAX_ROOT_AND_PREFIX: usize = 60;
/// Where POSIX shared memory appears as files on Linux.
const SHARED_MEMORY: &str = "/dev/shm";

/// stat(2) counts in these, bytes.
const BLOCK: u64 = 512;

/// One running system. Two instances have different run-time directories, hence different roots and
/// prefixes of everything they share: they never see each other.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Instance {
    directory: PathBuf,
    prefix: String,
}

/// Why a run-time directory cannot be one.
#[derive(Debug, thiserror::Error)]
pub enum InstanceError {
    /// Too long for Unix sockets.
    #[error(
        "the run-time directory {directory} is {length} bytes long, {MAX_ROOT_AND_PREFIX} is the limit with its prefix (Unix sockets): choose a shorter one with --run-dir"
    )]
    TooLong {
        /// The directory.
        directory: String,
        /// Bytes of root and prefix together.
        length: usize,
    },
    /// Not a name that the transport takes.
    #[error(
        "the run-time directory {0} has characters that a shared-memory name cannot have; choose another with --run-dir"
    )]
    BadName(String),
    /// Others could put something into it, or take it away.
    #[error(
        "the run-time directory {directory} {what}: it must be yours alone (`chmod 700 {directory}`), or choose another with --run-dir"
    )]
    NotPrivate {
        /// The directory.
        directory: String,
        /// What is wrong with it.
        what: String,
    },
    /// The file system refused.
    #[error("the run-time directory {directory}: {cause}")]
    Io {
        /// The directory.
        directory: String,
        /// The file system's reason.
        #[source]
        cause: std::io::Error,
    },
}

impl Instance {
    /// The instance that lives in `directory`, which is created for its owner alone where it is missing.
    ///
    /// # Errors
    /// [`InstanceError`] where the path is too long, or the directory cannot be made, or is not private.
    pub fn at(directory: &Path) -> Result<Instance, InstanceError> {
        use std::os::unix::fs::DirBuilderExt;
        let io = |cause| InstanceError::Io { directory: directory.display().to_string(), cause };
        std::fs::DirBuilder::new().recursive(true).mode(0o700).create(directory).map_err(io)?;
        is_private(directory)?;
        let directory = directory.canonicalize().map_err(io)?;
        let prefix = format!("pur_{:08x}_", fnv1a(directory.as_os_str().as_encoded_bytes()));
        let root = directory.join("iox");
        let length = root.as_os_str().len() + prefix.len();
        if length > MAX_ROOT_AND_PREFIX {
            return Err(InstanceError::TooLong { directory: directory.display().to_string(), length });
        }
        if IoxPath::new(root.as_os_str().as_encoded_bytes()).is_err() {
            return Err(InstanceError::BadName(directory.display().to_string()));
        }
        Ok(Instance { directory, prefix })
    }

    /// The run-time directory.
    pub fn directory(&self) -> &Path {
        &self.directory
    }

    /// What the names of all its shared-memory objects begin with.
    pub fn prefix(&self) -> &str {
        &self.prefix
    }

    /// Removes everything that the transport left of this instance; how many shared-memory objects
    /// were there. Only for the one who holds the instance's lock while no service runs.
    pub fn wipe(&self) -> usize {
        let _ = std::fs::remove_dir_all(self.directory.join("iox"));
        let left = self.shared_memory_objects();
        for object in &left {
            let _ = std::fs::remove_file(object);
        }
        left.len()
    }

    /// The shared-memory objects of this instance that exist now.
    pub fn shared_memory_objects(&self) -> Vec<PathBuf> {
        let Ok(entries) = std::fs::read_dir(SHARED_MEMORY) else { return Vec::new() };
        entries
            .flatten()
            .filter(|entry| entry.file_name().to_string_lossy().starts_with(&self.prefix))
            .map(|entry| entry.path())
            .collect()
    }

    /// Has the kernel give the pages of the instance's shared memory now, of each piece the first `most` bytes: it
    /// gives each at its first use else, and ends who uses one when there is none left (SIGBUS).
    ///
    /// # Errors
    /// There is not that much memory.
    pub(crate) fn reserve(&self, most: u64) -> Result<(), rustix::io::Errno> {
        use rustix::fs::{FallocateFlags, Mode, OFlags, fallocate, fstat, open};
        for object in self.shared_memory_objects() {
            // What has gone meanwhile needs nothing.
            let Ok(file) = open(&object, OFlags::RDWR | OFlags::CLOEXEC, Mode::empty()) else { continue };
            let Ok(stat) = fstat(&file) else { continue };
            let size = u64::try_from(stat.st_size).unwrap_or(0).min(most);
            let has = u64::try_from(stat.st_blocks).unwrap_or(0) * BLOCK;
            if has < size {
                // A file system that cannot is used as it is.
                let taken = fallocate(&file, FallocateFlags::KEEP_SIZE, 0, size);
                if let Err(error @ rustix::io::Errno::NOSPC) = taken {
                    return Err(error);
                }
            }
        }
        Ok(())
    }

    pub(crate) fn transport_config(&self) -> Config {
        let mut config = Config::default();
        let root = self.directory.join("iox");
        // Both were checked in `at`; the defaults would only be a fallback that never meets another.
        if let Ok(path) = IoxPath::new(root.as_os_str().as_encoded_bytes()) {
            config.global.set_root_path(&path);
        }
        if let Ok(prefix) = FileName::new(self.prefix.as_bytes()) {
            config.global.prefix = prefix;
        }
        config
    }
}

/// What is free in shared memory, bytes, where somebody can tell.
pub(crate) fn free_memory() -> Option<u64> {
    rustix::fs::statvfs(SHARED_MEMORY).ok().map(|shm| shm.f_bavail * shm.f_frsize)
}

/// Whether the directory is its owner's alone, and that is us.
fn is_private(directory: &Path) -> Result<(), InstanceError> {
    use std::os::unix::fs::MetadataExt;
    let name = || directory.display().to_string();
    let metadata = std::fs::symlink_metadata(directory)
        .map_err(|cause| InstanceError::Io { directory: name(), cause })?;
    let what = if !metadata.is_dir() {
        "is a link".to_owned()
    } else if metadata.uid() != rustix::process::getuid().as_raw() {
        format!("belongs to user {}", metadata.uid())
    } else if metadata.mode() & 0o077 != 0 {
        format!("is open to others (mode {:o})", metadata.mode() & 0o777)
    } else {
        return Ok(());
    };
    Err(InstanceError::NotPrivate { directory: name(), what })
}

/// FNV-1a, 32 bits: names only, no secret.
fn fnv1a(bytes: &[u8]) -> u32 {
    bytes.iter().fold(0x811c_9dc5, |hash, byte| (hash ^ u32::from(*byte)).wrapping_mul(0x0100_0193))
}
