//! State that survives SIGKILL at any instant: a file of two slots, each with a checksum.
//!
//! A save writes the slot that is not the newest one; a kill in the middle leaves the other whole. What
//! is lost is at most the save in flight. The kernel's page cache outlives the process, so nothing is
//! flushed here: this guards against dying processes, not against dying machines.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::Path;

const MAGIC: u32 = 0x5055_5231;
/// magic, schema, length, checksum, sequence.
const HEADER: usize = 4 + 4 + 8 + 4 + 4 + 8;

/// A file of two slots.
#[derive(Debug)]
pub struct Checkpoint {
    file: File,
    schema: u32,
    slot_bytes: usize,
    sequence: u64,
    buffer: Vec<u8>,
}

/// Why a checkpoint cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum CheckpointError {
    /// The file system refused.
    #[error("checkpoint {path}: {cause}")]
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

impl Checkpoint {
    /// Opens or creates the file at `path` for states of at most `capacity` bytes, and reads back the
    /// newest whole state of this `schema`. A torn or foreign slot is passed over; where no slot is
    /// whole the state is `None`.
    ///
    /// # Errors
    /// [`CheckpointError::Io`].
    pub fn open(
        path: &Path,
        schema: u32,
        capacity: usize,
    ) -> Result<(Checkpoint, Option<Vec<u8>>), CheckpointError> {
        let io = |cause| CheckpointError::Io { path: path.display().to_string(), cause };
        let mut file =
            File::options().read(true).write(true).create(true).truncate(false).open(path).map_err(io)?;
        let slot_bytes = capacity + HEADER;
        let mut whole = Vec::new();
        file.read_to_end(&mut whole).map_err(io)?;
        let newest = [0, 1]
            .into_iter()
            .filter_map(|slot| read_slot(whole.get(slot * slot_bytes..)?, schema, capacity))
            .max_by_key(|(sequence, _)| *sequence);
        let (sequence, state) = match newest {
            Some((sequence, state)) => (sequence, Some(state.to_vec())),
            None => (0, None),
        };
        let buffer = Vec::with_capacity(slot_bytes);
        Ok((Checkpoint { file, schema, slot_bytes, sequence, buffer }, state))
    }

    /// Saves a value, in postcard's encoding.
    ///
    /// # Errors
    /// As [`Checkpoint::save`]; [`CheckpointError::Encoding`].
    pub fn save_value(&mut self, value: &impl serde::Serialize) -> Result<(), CheckpointError> {
        let mut buffer = std::mem::take(&mut self.buffer);
        buffer.clear();
        buffer.resize(HEADER, 0);
        self.buffer = postcard::to_extend(value, buffer)?;
        self.write_slot()
    }

    /// Saves what `write` puts into the buffer; nothing is allocated once the buffer has grown.
    ///
    /// # Errors
    /// [`CheckpointError::TooLarge`], [`CheckpointError::Io`].
    pub fn save(&mut self, write: impl FnOnce(&mut Vec<u8>)) -> Result<(), CheckpointError> {
        self.buffer.clear();
        self.buffer.resize(HEADER, 0);
        write(&mut self.buffer);
        self.write_slot()
    }

    /// Writes the buffer, whose first bytes are room for the header, into the older slot.
    fn write_slot(&mut self) -> Result<(), CheckpointError> {
        let bytes = self.buffer.len() - HEADER;
        if self.buffer.len() > self.slot_bytes {
            return Err(CheckpointError::TooLarge { bytes, slot: self.slot_bytes - HEADER });
        }
        let sequence = self.sequence + 1;
        let checksum = crc32fast::hash(&self.buffer[HEADER..]);
        let header = header(self.schema, bytes, checksum, sequence);
        self.buffer[..HEADER].copy_from_slice(&header);
        let offset = (sequence % 2) * self.slot_bytes as u64;
        let io = |cause| CheckpointError::Io { path: "(open file)".to_owned(), cause };
        self.file.seek(SeekFrom::Start(offset)).map_err(io)?;
        self.file.write_all(&self.buffer).map_err(io)?;
        self.sequence = sequence;
        Ok(())
    }
}

fn header(schema: u32, bytes: usize, checksum: u32, sequence: u64) -> [u8; HEADER] {
    let mut header = [0; HEADER];
    header[..4].copy_from_slice(&MAGIC.to_le_bytes());
    header[4..8].copy_from_slice(&schema.to_le_bytes());
    header[8..16].copy_from_slice(&(bytes as u64).to_le_bytes());
    header[16..20].copy_from_slice(&checksum.to_le_bytes());
    // 20..24 guards the header itself, so that a torn header is never believed.
    header[24..32].copy_from_slice(&sequence.to_le_bytes());
    let mut guard = crc32fast::Hasher::new();
    guard.update(&header[..20]);
    guard.update(&header[24..32]);
    let guard = guard.finalize();
    header[20..24].copy_from_slice(&guard.to_le_bytes());
    header
}

fn read_slot(slot: &[u8], schema: u32, capacity: usize) -> Option<(u64, &[u8])> {
    let head = slot.get(..HEADER)?;
    let word = |at: usize| Some(u32::from_le_bytes(head.get(at..at + 4)?.try_into().ok()?));
    let long = |at: usize| Some(u64::from_le_bytes(head.get(at..at + 8)?.try_into().ok()?));
    let bytes = usize::try_from(long(8)?).ok()?;
    let (checksum, sequence) = (word(16)?, long(24)?);
    if bytes > capacity || head != header(schema, bytes, checksum, sequence) {
        return None;
    }
    let state = slot.get(HEADER..HEADER + bytes)?;
    (crc32fast::hash(state) == checksum).then_some((sequence, state))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use std::path::PathBuf;

    struct Scratch(PathBuf);
    impl Scratch {
        fn new(name: &str) -> Scratch {
            Scratch(std::env::temp_dir().join(format!("pursuit-checkpoint-{name}-{}", std::process::id())))
        }
    }
    impl Drop for Scratch {
        fn drop(&mut self) {
            let _ = std::fs::remove_file(&self.0);
        }
    }

    fn save(checkpoint: &mut Checkpoint, state: &[u8]) {
        checkpoint.save(|buffer| buffer.extend_from_slice(state)).unwrap();
    }

    #[test]
    fn the_last_saved_state_comes_back() {
        let file = Scratch::new("last");
        let (mut checkpoint, before) = Checkpoint::open(&file.0, 1, 100).unwrap();
        assert!(before.is_none());
        for n in 0..5u8 {
            save(&mut checkpoint, &[n; 20]);
        }
        let (_, state) = Checkpoint::open(&file.0, 1, 100).unwrap();
        assert_eq!(state.unwrap(), [4; 20]);
    }

    #[test]
    fn a_file_cut_or_flipped_anywhere_gives_the_last_or_the_one_before_never_half() {
        let file = Scratch::new("torn");
        let (mut checkpoint, _) = Checkpoint::open(&file.0, 1, 40).unwrap();
        for n in 1..=4u8 {
            save(&mut checkpoint, &[n; 30]);
        }
        let whole = std::fs::read(&file.0).unwrap();
        for at in 0..whole.len() {
            for damage in [true, false] {
                let mut bytes = whole.clone();
                if damage {
                    bytes[at] ^= 0x41;
                } else {
                    bytes.truncate(at);
                }
                std::fs::write(&file.0, &bytes).unwrap();
                let (_, state) = Checkpoint::open(&file.0, 1, 40).unwrap();
                if let Some(state) = state {
                    assert!(state == [4; 30] || state == [3; 30], "half a state at byte {at}: {state:?}");
                } else {
                    assert!(!damage, "one flipped byte must not cost both slots (byte {at})");
                }
            }
        }
    }

    #[test]
    fn another_schema_is_not_believed() {
        let file = Scratch::new("schema");
        let (mut checkpoint, _) = Checkpoint::open(&file.0, 1, 100).unwrap();
        save(&mut checkpoint, b"old");
        assert!(Checkpoint::open(&file.0, 2, 100).unwrap().1.is_none());
    }

    #[test]
    fn a_state_too_large_is_refused_and_the_old_one_kept() {
        let file = Scratch::new("large");
        let (mut checkpoint, _) = Checkpoint::open(&file.0, 1, 10).unwrap();
        save(&mut checkpoint, b"small");
        assert!(checkpoint.save(|buffer| buffer.extend_from_slice(&[0; 11])).is_err());
        assert_eq!(Checkpoint::open(&file.0, 1, 10).unwrap().1.unwrap(), b"small");
    }
}
