//! What can go wrong on the bus.

/// An error of the bus.
#[derive(Debug, thiserror::Error)]
pub enum BusError {
    /// The process could not join.
    #[error(
        "cannot join the bus as {name}: {cause}; is the run-time directory another user's, or on a full disk?"
    )]
    Join {
        /// Name under which it tried.
        name: String,
        /// The transport's reason.
        cause: String,
    },
    /// There is too little shared memory: using it would end this process (SIGBUS).
    #[error(
        "shared memory is full: {free_mb} MB free in /dev/shm, at least {needed_mb} MB are needed; make room there"
    )]
    Full {
        /// What is free, MB.
        free_mb: u64,
        /// What is needed, MB.
        needed_mb: u64,
    },
    /// A running peer has another version of this topic's payload, or other depths.
    #[error(
        "topic {topic}: a running process speaks another version of it ({cause}); stop it, or start programs of one build"
    )]
    Version {
        /// Name of the topic.
        topic: String,
        /// The transport's reason.
        cause: String,
    },
    /// The topic could not be opened.
    #[error("cannot open topic {topic}: {cause}")]
    Open {
        /// Name of the topic.
        topic: String,
        /// The transport's reason.
        cause: String,
    },
    /// A message could not be sent.
    #[error("cannot send on topic {topic}: {cause}")]
    Send {
        /// Name of the topic.
        topic: &'static str,
        /// The transport's reason.
        cause: String,
    },
    /// A message could not be received.
    #[error("cannot receive on topic {topic}: {cause}")]
    Receive {
        /// Name of the topic.
        topic: &'static str,
        /// The transport's reason.
        cause: String,
    },
    /// Waiting failed.
    #[error("cannot wait for messages: {0}")]
    Wait(String),
}

impl BusError {
    pub(crate) fn join(name: &str, cause: &dyn core::fmt::Debug) -> BusError {
        BusError::Join { name: name.to_owned(), cause: format!("{cause:?}") }
    }

    pub(crate) fn full(needed: u64) -> BusError {
        let free = crate::instance::free_memory().unwrap_or(0);
        BusError::Full { free_mb: free >> 20, needed_mb: needed.div_ceil(1 << 20) }
    }

    /// Whether this error says that two builds met: starting again does not help.
    pub fn is_version(&self) -> bool {
        matches!(self, BusError::Version { .. })
    }

    pub(crate) fn is_version_conflict(cause: &str) -> bool {
        ["Incompatible", "DoesNotSupportRequested", "VersionMismatch"].iter().any(|word| cause.contains(word))
    }
}
