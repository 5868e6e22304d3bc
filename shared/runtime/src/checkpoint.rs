//! State that survives SIGKILL at any instant: a mapped file of two slots, each with a checksum.
//!
//! A save copies the state into the slot that is not the newest one and writes that slot's header last; a
//! kill in the middle leaves the other slot whole. What is lost is at most the save in flight. A save is a
//! copy of memory: no system call. The kernel's page cache outlives the process, so nothing is flushed
//! here; [`keeper`] writes what must also outlive the machine.
//!
//! A slot that is not believed is refused by name ([`Refusal`]); where no slot is believed the file is set
//! aside as `NAME.refused` and a new one begun.

pub mod keeper;
mod slot;

use memmap2::MmapMut;
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering, fence};

use slot::HEADER;
pub use slot::Refusal;

/// A mapped file of two slots.
#[derive(Debug)]
pub struct Checkpoint {
    map: MmapMut,
    file: Arc<File>,
    schema: u32,
    slot_bytes: usize,
    /// Number of the newest save; who keeps it safe watches it.
    sequence: Arc<AtomicU64>,
    next_slot: usize,
    buffer: Vec<u8>,
}

/// What a checkpoint file held.
#[derive(Debug, Default)]
pub struct Restored {
    /// The newest whole state.
    pub state: Option<Vec<u8>>,
    /// Number of the save that it is of; 0 without one.
    pub sequence: u64,
    /// Slots that were not believed, and why.
    pub refused: Vec<(usize, Refusal)>,
}

/// Why a checkpoint cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum CheckpointError {
    /// The file system refused.
    #[error("checkpoint {path}: {cause}; is its folder writable and its disk not full?")]
    Io {
        /// The file.
        path: String,
        /// The file system's reason.
        #[source]
        cause: io::Error,
    },
    /// The state cannot be encoded.
    #[error("the state cannot be encoded: {0}")]
    Encoding(#[from] postcard::Error),
    /// The state is larger than a slot.
    #[error("a state of {bytes} bytes does not fit a checkpoint of {slot} bytes")]
    TooLarge {
        /// Bytes to save.
        bytes: usize,
        /// Bytes of a slot.
        slot: usize,
    },
}

impl CheckpointError {
    fn io(path: &Path) -> impl Fn(io::Error) -> CheckpointError + '_ {
        |cause| CheckpointError::Io { path: path.display().to_string(), cause }
    }
}

impl Checkpoint {
    /// Opens or creates the file at `path` for states of at most `capacity` bytes, and reads back the newest
    /// whole state of this `schema`. Refused slots are logged.
    ///
    /// # Errors
    /// [`CheckpointError::Io`], also where the disk has no room for both slots.
    pub fn open(
        path: &Path,
        schema: u32,
        capacity: usize,
    ) -> Result<(Checkpoint, Option<Vec<u8>>), CheckpointError> {
        let (checkpoint, restored) = Checkpoint::restore(path, schema, capacity)?;
        Ok((checkpoint, restored.state))
    }

    /// As [`Checkpoint::open`], with what was refused.
    ///
    /// # Errors
    /// [`CheckpointError::Io`].
    pub fn restore(
        path: &Path,
        schema: u32,
        capacity: usize,
    ) -> Result<(Checkpoint, Restored), CheckpointError> {
        let (file, restored, next_slot) = open_slots(path, schema, capacity)?;
        let slot_bytes = slot::bytes_for(capacity);
        // SAFETY: the file is this instance's own, in a directory of its owner, and has its full length on
        // the disk (`open_slots` reserves it); nobody truncates it while it is mapped. The keeper's thread
        // reads it through system calls, not through this map.
        #[allow(unsafe_code)]
        let map = unsafe { MmapMut::map_mut(&file) }.map_err(CheckpointError::io(path))?;
        let sequence = Arc::new(AtomicU64::new(restored.sequence));
        let buffer = Vec::with_capacity(capacity);
        Ok((
            Checkpoint { map, file: Arc::new(file), schema, slot_bytes, sequence, next_slot, buffer },
            restored,
        ))
    }

    /// Saves a value, in postcard's encoding.
    ///
    /// # Errors
    /// As [`Checkpoint::save`]; [`CheckpointError::Encoding`].
    pub fn save_value(&mut self, value: &impl serde::Serialize) -> Result<(), CheckpointError> {
        let mut buffer = std::mem::take(&mut self.buffer);
        buffer.clear();
        self.buffer = postcard::to_extend(value, buffer)?;
        self.write_slot()
    }

    /// Saves what `write` puts into the buffer; nothing is allocated once the buffer has grown.
    ///
    /// # Errors
    /// [`CheckpointError::TooLarge`].
    pub fn save(&mut self, write: impl FnOnce(&mut Vec<u8>)) -> Result<(), CheckpointError> {
        self.buffer.clear();
        write(&mut self.buffer);
        self.write_slot()
    }

    /// Saves are numbered on from here: what was restored elsewhere is older than the next save.
    pub fn number_from(&mut self, sequence: u64) {
        self.sequence.fetch_max(sequence, Ordering::Relaxed);
    }

    /// Copies the buffer into the older slot: the state first, its header last.
    fn write_slot(&mut self) -> Result<(), CheckpointError> {
        let state = &self.buffer;
        let room = self.slot_bytes - HEADER;
        if state.len() > room {
            return Err(CheckpointError::TooLarge { bytes: state.len(), slot: room });
        }
        let sequence = self.sequence.load(Ordering::Relaxed) + 1;
        let header = slot::header(self.schema, state, sequence);
        let begin = self.next_slot * self.slot_bytes;
        let slot = &mut self.map[begin..begin + self.slot_bytes];
        slot[HEADER..HEADER + state.len()].copy_from_slice(state);
        // Not that it would be believed half: the checksum is over the whole state.
        fence(Ordering::Release);
        slot[..HEADER].copy_from_slice(&header);
        self.next_slot = 1 - self.next_slot;
        self.sequence.store(sequence, Ordering::Release);
        Ok(())
    }
}

/// What the file at `path` holds, without touching it.
///
/// # Errors
/// [`CheckpointError::Io`].
pub fn read(path: &Path, schema: u32, capacity: usize) -> Result<Restored, CheckpointError> {
    let io = CheckpointError::io(path);
    let mut whole = Vec::new();
    File::open(path)
        .and_then(|file| file.take(2 * slot::bytes_for(capacity) as u64).read_to_end(&mut whole))
        .map_err(io)?;
    Ok(newest(&whole, schema, capacity).0)
}

/// Where a file goes that holds nothing to go on from.
pub fn refused_name(path: &Path) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(".refused");
    PathBuf::from(name)
}

/// Sets a file aside that cannot be gone on from, so that nothing that a person might want is overwritten.
///
/// # Errors
/// [`CheckpointError::Io`].
pub fn set_aside(path: &Path) -> Result<(), CheckpointError> {
    std::fs::rename(path, refused_name(path)).map_err(CheckpointError::io(path))
}

/// The newest whole state of both slots, and the slot to write next.
fn newest(whole: &[u8], schema: u32, capacity: usize) -> (Restored, usize) {
    let (mut restored, mut next_slot) = (Restored::default(), 0);
    let slot_bytes = slot::bytes_for(capacity);
    for number in 0..2 {
        let bytes = whole.get(number * slot_bytes..).unwrap_or_default();
        let bytes = &bytes[..bytes.len().min(slot_bytes)];
        match slot::read(bytes, schema, slot_bytes - HEADER) {
            Ok(Some((sequence, state))) if sequence > restored.sequence => {
                (restored.sequence, next_slot) = (sequence, 1 - number);
                restored.state = Some(state.to_vec());
            }
            Ok(_) => {}
            Err(refusal) => restored.refused.push((number, refusal)),
        }
    }
    (restored, next_slot)
}

/// Opens or creates a file of two slots with all its bytes on the disk; what it held, and the slot to write
/// next.
fn open_slots(path: &Path, schema: u32, capacity: usize) -> Result<(File, Restored, usize), CheckpointError> {
    let io = CheckpointError::io(path);
    let open = || File::options().read(true).write(true).create(true).truncate(false).open(path);
    let mut file = open().map_err(&io)?;
    let mut whole = Vec::new();
    let size = 2 * slot::bytes_for(capacity) as u64;
    (&mut file).take(size).read_to_end(&mut whole).map_err(&io)?;
    let (restored, next_slot) = newest(&whole, schema, capacity);
    for (number, refusal) in &restored.refused {
        tracing::warn!(file = %path.display(), slot = number, %refusal, "a saved state was refused");
    }
    if restored.state.is_none() && !restored.refused.is_empty() {
        set_aside(path)?;
        file = open().map_err(&io)?;
    }
    // Reserved, not only made long: a full disk must be an error now, not a SIGBUS at a save.
    rustix::fs::fallocate(&file, rustix::fs::FallocateFlags::empty(), 0, size)
        .or_else(|_| file.set_len(size).map_err(|_| rustix::io::Errno::NOSPC))
        .map_err(|errno| io(errno.into()))?;
    Ok((file, restored, next_slot))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
