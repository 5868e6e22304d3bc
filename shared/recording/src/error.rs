//! Why a recording cannot be read or written.

/// One line each, for the person who gave the file.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// The file system refused.
    #[error("{0}")]
    Io(#[from] std::io::Error),
    /// No byte in it.
    #[error("is empty")]
    Empty,
    /// Another kind of file.
    #[error("is not an MCAP recording")]
    Foreign,
    /// A record is broken.
    #[error("is damaged in the first {bytes} bytes: {cause}")]
    Damaged {
        /// Bytes read up to then.
        bytes: u64,
        /// What is wrong there.
        cause: String,
    },
    /// Something in it is larger than what is read.
    #[error("holds {what}, more than the limit of {limit}")]
    TooLarge {
        /// What, and how large.
        what: String,
        /// The limit.
        limit: String,
    },
    /// Compressed by another program.
    #[error("is compressed ({0}); only recordings without compression are read")]
    Compressed(String),
    /// Another version of `pursuit` wrote it.
    #[error("was recorded by another version of pursuit: it holds {found}, this one reads {wanted}")]
    Version {
        /// Schema in the file.
        found: String,
        /// Schema of this program.
        wanted: String,
    },
    /// Images of another kind.
    #[error("holds images in {0}; only 8-bit grey (mono8) is read")]
    Encoding(String),
    /// A record cannot be written.
    #[error("cannot be written: {0}")]
    Write(String),
}

impl RecordingError {
    /// Whether the disk is full (or the file as large as it may be).
    pub fn is_disk_full(&self) -> bool {
        use std::io::ErrorKind::{FileTooLarge, QuotaExceeded, StorageFull};
        matches!(self, RecordingError::Io(error) if matches!(error.kind(), StorageFull | QuotaExceeded | FileTooLarge))
    }

    pub(crate) fn writing(error: mcap::McapError) -> RecordingError {
        match error {
            mcap::McapError::Io(error) => RecordingError::Io(error),
            other => RecordingError::Write(other.to_string()),
        }
    }

    pub(crate) fn reading(error: mcap::McapError, bytes: u64) -> RecordingError {
        use mcap::McapError::{BadMagic, ChunkTooLarge, Io, RecordTooLarge, UnsupportedCompression};
        let limit = || format!("{} MB", crate::MAX_RECORD >> 20);
        match error {
            Io(error) => RecordingError::Io(error),
            BadMagic => RecordingError::Foreign,
            UnsupportedCompression(name) => RecordingError::Compressed(name),
            RecordTooLarge { len, .. } | ChunkTooLarge(len) => {
                RecordingError::TooLarge { what: format!("a record of {len} bytes"), limit: limit() }
            }
            other => RecordingError::Damaged { bytes, cause: other.to_string() },
        }
    }
}
