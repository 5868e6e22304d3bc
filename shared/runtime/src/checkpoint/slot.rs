//! One slot: a header that guards itself, then the state.
//!
//! | bytes | |
//! |---|---|
//! | 0..4 | `PURS` |
//! | 4..8 | version of this layout |
//! | 8..12 | schema of the state |
//! | 12..16 | CRC-32 of the state |
//! | 16..24 | bytes of the state |
//! | 24..32 | sequence: the number of the save, from 1 |
//! | 32..36 | CRC-32 of the bytes before |
//! | 36..40 | 0 |
//!
//! Numbers are little-endian.

/// Bytes before the state.
pub(super) const HEADER: usize = 40;
const MAGIC: [u8; 4] = *b"PURS";
const LAYOUT: u32 = 2;
const GUARDED: usize = 32;
/// Slots begin on pages, so that no page belongs to both.
const PAGE: usize = 4096;

/// Why a slot is not believed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Refusal {
    /// It ends in the middle.
    #[error("truncated: {found} of {expected} bytes")]
    Truncated {
        /// Bytes there.
        found: usize,
        /// Bytes that should be.
        expected: usize,
    },
    /// Something else lies there.
    #[error("not a state of pursuit's")]
    Foreign,
    /// Its header is torn or damaged.
    #[error("the header's checksum is wrong")]
    Header,
    /// Another version of the file's layout.
    #[error("the file has layout {found}, this program reads {LAYOUT}")]
    Layout {
        /// The file's.
        found: u32,
    },
    /// A state of another program version, or of another service.
    #[error("the state has schema {found}, this program reads {wanted}")]
    Schema {
        /// The file's.
        found: u32,
        /// The reader's.
        wanted: u32,
    },
    /// The state is torn or damaged.
    #[error("the state's checksum is wrong")]
    State,
}

/// Bytes of a slot with room for `capacity` bytes of state.
pub(super) fn bytes_for(capacity: usize) -> usize {
    (capacity + HEADER).next_multiple_of(PAGE)
}

pub(super) fn header(schema: u32, state: &[u8], sequence: u64) -> [u8; HEADER] {
    let mut header = [0; HEADER];
    header[..4].copy_from_slice(&MAGIC);
    header[4..8].copy_from_slice(&LAYOUT.to_le_bytes());
    header[8..12].copy_from_slice(&schema.to_le_bytes());
    header[12..16].copy_from_slice(&crc32fast::hash(state).to_le_bytes());
    header[16..24].copy_from_slice(&(state.len() as u64).to_le_bytes());
    header[24..32].copy_from_slice(&sequence.to_le_bytes());
    let guard = crc32fast::hash(&header[..GUARDED]);
    header[32..36].copy_from_slice(&guard.to_le_bytes());
    header
}

/// Sequence and state of a slot; `None` where nothing was ever saved.
pub(super) fn read(slot: &[u8], schema: u32, room: usize) -> Result<Option<(u64, &[u8])>, Refusal> {
    if slot.iter().take(HEADER).all(|byte| *byte == 0) {
        return Ok(None);
    }
    let Some(head) = slot.get(..HEADER) else {
        return Err(Refusal::Truncated { found: slot.len(), expected: HEADER });
    };
    let word = |at: usize| u32::from_le_bytes([head[at], head[at + 1], head[at + 2], head[at + 3]]);
    let long = |at: usize| u64::from(word(at)) | u64::from(word(at + 4)) << 32;
    if head[..4] != MAGIC {
        return Err(Refusal::Foreign);
    }
    if word(32) != crc32fast::hash(&head[..GUARDED]) || word(36) != 0 {
        return Err(Refusal::Header);
    }
    if word(4) != LAYOUT {
        return Err(Refusal::Layout { found: word(4) });
    }
    if word(8) != schema {
        return Err(Refusal::Schema { found: word(8), wanted: schema });
    }
    let bytes = usize::try_from(long(16)).ok().filter(|bytes| *bytes <= room).ok_or(Refusal::Header)?;
    let Some(state) = slot.get(HEADER..HEADER + bytes) else {
        return Err(Refusal::Truncated { found: slot.len(), expected: HEADER + bytes });
    };
    if crc32fast::hash(state) != word(12) {
        return Err(Refusal::State);
    }
    Ok(Some((long(24), state)))
}
