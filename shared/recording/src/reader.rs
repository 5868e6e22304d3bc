//! Reading a recording, from its beginning to its end, in bounded memory.

use crate::entry::{Entry, Topic};
use crate::{MAX_RECORD, METADATA, RecordingError, proto, wire};
use mcap::records::Record;
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// Bytes read at once at most: a record that says that it is long takes memory as it comes.
const READ: usize = 1 << 20;
/// Schemas and channels of a file at most.
const MAX_CHANNELS: usize = 4096;

/// What a channel of the file is to us.
#[derive(Clone, Copy)]
enum Role {
    Image,
    Exact(Topic),
    Other,
}

/// A recording that is being read. Messages come in the order in which they were written.
pub struct Reader {
    file: File,
    linear: LinearReader,
    bytes: u64,
    schemas: BTreeMap<u16, String>,
    channels: BTreeMap<u16, Role>,
    images: u64,
    config: Option<String>,
    has_footer: bool,
    closed: bool,
    first: Option<Entry>,
}

impl Reader {
    /// Opens the file and reads up to its first message.
    ///
    /// # Errors
    /// It is missing, empty, no recording, or of another version.
    pub fn open(path: &Path) -> Result<Reader, RecordingError> {
        let file = File::open(path)?;
        if file.metadata()?.len() == 0 {
            return Err(RecordingError::Empty);
        }
        let options = LinearReaderOptions::default()
            .with_prevalidate_chunk_crcs(true)
            .with_record_length_limit(MAX_RECORD);
        let mut reader = Reader {
            file,
            linear: LinearReader::new_with_options(options),
            bytes: 0,
            schemas: BTreeMap::new(),
            channels: BTreeMap::new(),
            images: 0,
            config: None,
            has_footer: false,
            closed: false,
            first: None,
        };
        reader.first = reader.read_on()?;
        Ok(reader)
    }

    /// The config of the run, where the recorder knew it.
    pub fn config(&self) -> Option<&str> {
        self.config.as_deref()
    }

    /// After the last message: whether the recorder closed the file. It did not where it was killed or the
    /// disk was full; what was read is whole all the same.
    pub fn is_closed(&self) -> bool {
        self.closed
    }

    /// The next message; `None` after the last one.
    ///
    /// # Errors
    /// The file is damaged there. What came before is whole.
    pub fn next_entry(&mut self) -> Result<Option<Entry>, RecordingError> {
        match self.first.take() {
            Some(entry) => Ok(Some(entry)),
            None => self.read_on(),
        }
    }

    fn read_on(&mut self) -> Result<Option<Entry>, RecordingError> {
        loop {
            let wanted = match self.linear.next_event() {
                // Whole to the mark at its end.
                None => {
                    self.closed = self.has_footer;
                    return Ok(None);
                }
                Some(Err(mcap::McapError::UnexpectedEof)) if self.bytes >= MAGIC => return Ok(None),
                Some(Err(error)) => return Err(RecordingError::reading(error, self.bytes)),
                Some(Ok(LinearReadEvent::ReadRequest(wanted))) => wanted,
                Some(Ok(LinearReadEvent::Record { data, opcode })) => {
                    let record = mcap::parse_record(opcode, data)
                        .map_err(|error| RecordingError::reading(error, self.bytes))?;
                    let entry = match record {
                        Record::Schema { header, .. } => {
                            check_version(&header.name)?;
                            self.schemas.insert(header.id, header.name);
                            None
                        }
                        Record::Channel(channel) => {
                            let schema = self.schemas.get(&channel.schema_id).map_or("", String::as_str);
                            self.channels.insert(channel.id, role(schema, &channel.message_encoding));
                            None
                        }
                        Record::Metadata(metadata) if metadata.name == METADATA => {
                            self.config = metadata.metadata.get("config").cloned();
                            None
                        }
                        Record::Footer(_) => {
                            self.has_footer = true;
                            None
                        }
                        Record::Message { header, data } => match self.channels.get(&header.channel_id) {
                            Some(Role::Image) => {
                                self.images += 1;
                                Some(proto::read_image(&data, header.log_time, self.images - 1)?)
                            }
                            Some(Role::Exact(topic)) => {
                                let entry = wire::decode(*topic, header.log_time, &data);
                                Some(entry.ok_or_else(|| RecordingError::Damaged {
                                    bytes: self.bytes,
                                    cause: format!("a message of {} is broken", topic.bus_name()),
                                })?)
                            }
                            _ => None,
                        },
                        _ => None,
                    };
                    if self.schemas.len() > MAX_CHANNELS || self.channels.len() > MAX_CHANNELS {
                        let limit = MAX_CHANNELS.to_string();
                        return Err(RecordingError::TooLarge { what: "too many channels".to_owned(), limit });
                    }
                    if entry.is_some() {
                        return Ok(entry);
                    }
                    continue;
                }
            };
            let read = loop {
                match self.file.read(self.linear.insert(wanted.clamp(1, READ))) {
                    Err(error) if error.kind() == std::io::ErrorKind::Interrupted => {}
                    other => break other?,
                }
            };
            self.bytes += read as u64;
            self.linear.notify_read(read);
        }
    }
}

/// Bytes at the beginning of every MCAP file.
const MAGIC: u64 = 8;

/// A topic of ours in another version is refused by name.
fn check_version(schema: &str) -> Result<(), RecordingError> {
    let stem = |name: &str| name.rsplit_once('/').map(|(stem, _)| stem.to_owned());
    let same = Topic::ALL.into_iter().map(Topic::schema).find(|wanted| stem(wanted) == stem(schema));
    match same {
        Some(wanted) if wanted != schema && stem(schema).is_some() => {
            Err(RecordingError::Version { found: schema.chars().take(64).collect(), wanted })
        }
        _ => Ok(()),
    }
}

fn role(schema: &str, encoding: &str) -> Role {
    if schema == "foxglove.RawImage" && encoding == "protobuf" {
        return Role::Image;
    }
    let exact = Topic::ALL.into_iter().find(|topic| topic.schema() == schema && encoding == "pursuit");
    exact.map_or(Role::Other, Role::Exact)
}
