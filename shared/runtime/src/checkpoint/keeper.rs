//! What must outlive the machine: a second file of two slots, written and flushed once a second by a thread
//! of its own, off the frame's way.
//!
//! It is a second file because a mapped page that the kernel is writing out can stall who writes into it;
//! and because both slots of the first are rewritten between two flushes, so that a loss of power could
//! tear both. Here one slot is always whole on the disk while the other is being written.

use super::{Checkpoint, CheckpointError, HEADER, Restored, newest, open_slots, slot};
use std::fs::{File, TryLockError};
use std::io;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::Duration;

/// How often the newest state is put on the disk: at most this, and the time to write, is lost with power.
pub const PERIOD: Duration = Duration::from_millis(500);
/// A read of a slot that is being written is tried again; each try meets another moment.
const TRIES: usize = 100;

/// A file on the disk, held by one process at a time.
#[derive(Debug)]
pub struct Vault {
    file: File,
    path: PathBuf,
    schema: u32,
    capacity: usize,
    next_slot: usize,
}

impl Vault {
    /// Opens or creates the file, and its folder, and reads back what it holds.
    ///
    /// # Errors
    /// [`CheckpointError::Io`], also where another process holds the file.
    pub fn open(path: &Path, schema: u32, capacity: usize) -> Result<(Vault, Restored), CheckpointError> {
        let io = CheckpointError::io(path);
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
        if let Some(folder) = folder {
            std::fs::create_dir_all(folder).map_err(&io)?;
        }
        let (file, restored, next_slot) = open_slots(path, schema, capacity)?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                return Err(io(io::Error::other("another process keeps its state there")));
            }
            Err(TryLockError::Error(cause)) => return Err(io(cause)),
        }
        // The name of a new file is only safe with its folder.
        file.sync_all()
            .and_then(|()| File::open(folder.unwrap_or(Path::new(".")))?.sync_all())
            .map_err(&io)?;
        Ok((Vault { file, path: path.to_path_buf(), schema, capacity, next_slot }, restored))
    }

    /// Puts a state on the disk; returns when the disk has it.
    fn store(&mut self, sequence: u64, state: &[u8]) -> io::Result<()> {
        let begin = (self.next_slot * slot::bytes_for(self.capacity)) as u64;
        self.file.write_all_at(state, begin + HEADER as u64)?;
        self.file.write_all_at(&slot::header(self.schema, state, sequence), begin)?;
        self.file.sync_data()?;
        self.next_slot = 1 - self.next_slot;
        Ok(())
    }
}

/// The thread that keeps a checkpoint safe in a vault. Dropping it stores what is newest, then ends it.
#[derive(Debug)]
pub struct Keeper {
    /// Dropped to end the thread.
    going: Option<Sender<()>>,
    thread: Option<JoinHandle<()>>,
    stored: Arc<AtomicU64>,
}

impl Keeper {
    /// Starts the thread; it looks for a new state every `period` ([`PERIOD`]). What it has put on the disk it
    /// gives to `told`, too: for a copy that people can read, say.
    ///
    /// # Errors
    /// Where the system has no thread to give.
    pub fn start(
        checkpoint: &Checkpoint,
        vault: Vault,
        period: Duration,
        told: impl Fn(&[u8]) + Send + 'static,
    ) -> io::Result<Keeper> {
        let (going, ended) = channel::<()>();
        let stored = Arc::new(AtomicU64::new(0));
        let mut copier = Copier {
            live: Arc::clone(&checkpoint.file),
            saved: Arc::clone(&checkpoint.sequence),
            stored: Arc::clone(&stored),
            bytes: vec![0; 2 * slot::bytes_for(vault.capacity)],
            vault,
            failing: false,
            told: Box::new(told),
        };
        let thread = std::thread::Builder::new().name("keeper".to_owned()).spawn(move || {
            while ended.recv_timeout(period) == Err(RecvTimeoutError::Timeout) {
                copier.copy();
            }
            copier.copy();
        })?;
        Ok(Keeper { going: Some(going), thread: Some(thread), stored })
    }

    /// Number of the newest save that the disk has.
    pub fn stored(&self) -> u64 {
        self.stored.load(Ordering::Acquire)
    }
}

impl Drop for Keeper {
    fn drop(&mut self) {
        self.going = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

struct Copier {
    live: Arc<File>,
    saved: Arc<AtomicU64>,
    stored: Arc<AtomicU64>,
    bytes: Vec<u8>,
    vault: Vault,
    failing: bool,
    told: Told,
}

/// Who is given what was put on the disk.
type Told = Box<dyn Fn(&[u8]) + Send>;

impl Copier {
    /// Stores the newest state, if there is one that is not stored. A disk that fails is reported once, and
    /// tried again: the frame's way does not notice.
    fn copy(&mut self) {
        if self.saved.load(Ordering::Acquire) == self.stored.load(Ordering::Relaxed) {
            return;
        }
        match self.store() {
            Ok(()) => {
                if std::mem::take(&mut self.failing) {
                    tracing::info!(file = %self.vault.path.display(), "the state is on the disk again");
                }
            }
            Err(cause) if !self.failing => {
                self.failing = true;
                let file = self.vault.path.display();
                tracing::error!(%file, %cause, "the state cannot be put on the disk: make room; trying on");
            }
            Err(_) => {}
        }
    }

    fn store(&mut self) -> io::Result<()> {
        for _ in 0..TRIES {
            self.live.read_exact_at(&mut self.bytes, 0)?;
            let (restored, _) = newest(&self.bytes, self.vault.schema, self.vault.capacity);
            if let Some(state) = restored.state {
                self.vault.store(restored.sequence, &state)?;
                self.stored.store(restored.sequence, Ordering::Release);
                (self.told)(&state);
                return Ok(());
            }
        }
        Err(io::Error::other("no whole state to be read"))
    }
}
