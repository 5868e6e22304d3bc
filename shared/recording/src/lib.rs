//! Recordings of a run as MCAP files: what travelled on the bus, to the bit, and beside it the same things
//! in schemas that Foxglove and its relatives show without us.
//!
//! | topic in the file | schema | what for |
//! |---|---|---|
//! | /camera/image | foxglove.RawImage | every frame, lossless; its [`Stamp`](pursuit_messages::Stamp) is in a field that viewers pass over |
//! | /camera/pose, /vehicle/pose | foxglove.PoseInFrame | simulated runs: where the camera and the vehicle are |
//! | /target, /joints, /setpoint, /learner | JSON | numbers for plots |
//! | /pursuit/… | pursuit/TOPIC/vN | stamp and payload of each topic, for replays |
//!
//! `log_time` is when the recorder took a message (CLOCK_MONOTONIC), `publish_time` the exposure of the frame
//! behind it. Chunks are closed and handed to the kernel at least twice a second, so a recorder that is
//! killed loses no more than that; such a file has no end and is read up to its last whole chunk.

mod entry;
mod error;
mod proto;
mod reader;
mod views;
mod wire;
mod writer;

pub use entry::{Entry, Sample, Topic};
pub use error::RecordingError;
pub use reader::Reader;
pub use writer::{CHUNK_SPAN_NS, Writer};

/// Longest record that is read or written, bytes.
pub const MAX_RECORD: usize = 64 << 20;
/// Longest side of an image that is read, px.
pub const MAX_SIDE: u32 = 8192;
/// Name of the metadata record that holds the config of the run.
pub(crate) const METADATA: &str = "pursuit";

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
