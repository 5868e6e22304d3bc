//! Writing a recording.

use crate::entry::{Entry, Sample, Topic};
use crate::{METADATA, RecordingError, proto, views, wire};
use mcap::records::{MessageHeader, Metadata};
use std::collections::BTreeMap;
use std::fs::File;
use std::path::Path;

/// Longest time that one chunk covers, ns.
pub const CHUNK_SPAN_NS: u64 = 400_000_000;
/// A chunk of more bytes than this is closed before its time.
const CHUNK_BYTES: u64 = 4 << 20;

/// A recording that is being written. [`Writer::finish`] closes it; one that is not closed is read up to its
/// last whole chunk.
pub struct Writer {
    file: mcap::Writer<File>,
    image: u16,
    poses: [u16; 2],
    views: [u16; views::NAMES.len()],
    exact: [u16; Topic::ALL.len()],
    chunk_began_ns: Option<u64>,
    bytes: Vec<u8>,
    text: String,
}

impl Writer {
    /// A new file; `config` is the text of the config of the run.
    ///
    /// # Errors
    /// The file cannot be made or written.
    pub fn create(path: &Path, config: &str) -> Result<Writer, RecordingError> {
        let options = mcap::WriteOptions::new()
            .compression(None)
            .profile("")
            .library(concat!("pursuit ", env!("CARGO_PKG_VERSION")))
            .chunk_size(Some(CHUNK_BYTES))
            // A chunk is put together in memory and written whole.
            .disable_seeking(true);
        let mut file = options.create(File::create(path)?).map_err(RecordingError::writing)?;
        let channels = open_channels(&mut file, config).map_err(RecordingError::writing)?;
        let (image, poses, views, exact) = channels;
        let (bytes, text) = (Vec::new(), String::new());
        Ok(Writer { file, image, poses, views, exact, chunk_began_ns: None, bytes, text })
    }

    /// Adds a message; closes the chunk when it is old enough.
    ///
    /// # Errors
    /// The disk is full, say. The recording ends with its last whole chunk then.
    pub fn write(&mut self, entry: &Entry) -> Result<(), RecordingError> {
        self.flush_at(entry.log_ns)?;
        self.chunk_began_ns.get_or_insert(entry.log_ns);
        let stamp = &entry.stamp;
        match &entry.sample {
            Sample::Frame(pixels) => {
                proto::image(stamp, pixels, &mut self.bytes);
                return self.put(self.image, entry);
            }
            Sample::World(world) => {
                let [x, y] = world.target_position;
                let (sin, cos) = (0.5 * world.target_heading).sin_cos();
                proto::pose(world.time_ns, world.camera_position, world.camera_rotation, &mut self.bytes);
                self.put(self.poses[0], entry)?;
                proto::pose(world.time_ns, [x, y, 0.0], [0.0, 0.0, sin, cos], &mut self.bytes);
                self.put(self.poses[1], entry)?;
            }
            sample => {
                if let Some(index) = views::numbers(sample, &mut self.text) {
                    self.bytes.clear();
                    self.bytes.extend_from_slice(self.text.as_bytes());
                    self.put(self.views[index], entry)?;
                }
            }
        }
        let Some(topic) = wire::encode(entry, &mut self.bytes) else { return Ok(()) };
        self.put(self.exact[topic as usize], entry)
    }

    /// Closes the chunk and hands it to the kernel where it is older than [`CHUNK_SPAN_NS`] at `now_ns`: for
    /// times in which nothing comes.
    ///
    /// # Errors
    /// As [`Writer::write`].
    pub fn flush_at(&mut self, now_ns: u64) -> Result<(), RecordingError> {
        if self.chunk_began_ns.is_some_and(|began| now_ns >= began + CHUNK_SPAN_NS) {
            self.chunk_began_ns = None;
            self.file.flush().map_err(RecordingError::writing)?;
        }
        Ok(())
    }

    /// Closes the recording.
    ///
    /// # Errors
    /// As [`Writer::write`].
    pub fn finish(mut self) -> Result<(), RecordingError> {
        self.file.finish().map(|_| ()).map_err(RecordingError::writing)
    }

    fn put(&mut self, channel_id: u16, entry: &Entry) -> Result<(), RecordingError> {
        let header = MessageHeader {
            channel_id,
            sequence: entry.stamp.frame as u32,
            log_time: entry.log_ns,
            publish_time: entry.stamp.exposure_ns,
        };
        self.file.write_to_known_channel(&header, &self.bytes).map_err(RecordingError::writing)
    }
}

type Channels = (u16, [u16; 2], [u16; views::NAMES.len()], [u16; Topic::ALL.len()]);

fn open_channels(file: &mut mcap::Writer<File>, config: &str) -> mcap::McapResult<Channels> {
    let none = BTreeMap::new();
    let metadata = BTreeMap::from([("config".to_owned(), config.to_owned())]);
    file.write_metadata(&Metadata { name: METADATA.to_owned(), metadata })?;
    let description = proto::description();
    let schema = file.add_schema("foxglove.RawImage", "protobuf", &description)?;
    let image = file.add_channel(schema, "/camera/image", "protobuf", &none)?;
    let schema = file.add_schema("foxglove.PoseInFrame", "protobuf", &description)?;
    let mut poses = [0; 2];
    for (id, name) in poses.iter_mut().zip(["/camera/pose", "/vehicle/pose"]) {
        *id = file.add_channel(schema, name, "protobuf", &none)?;
    }
    let mut views = [0; views::NAMES.len()];
    for (id, name) in views.iter_mut().zip(views::NAMES) {
        let schema = file.add_schema(&format!("pursuit.{name}"), "jsonschema", views::SCHEMA)?;
        *id = file.add_channel(schema, &format!("/{name}"), "json", &none)?;
    }
    let mut exact = [0; Topic::ALL.len()];
    for (id, topic) in exact.iter_mut().zip(Topic::ALL) {
        let words = b"stamp and payload, all fields in their order, little-endian, no padding";
        let schema = file.add_schema(&topic.schema(), "pursuit", words)?;
        *id = file.add_channel(schema, &topic.path(), "pursuit", &none)?;
    }
    Ok((image, poses, views, exact))
}
