//! Typed publish/subscribe between the processes of one instance: the only crate that calls iceoryx2.
//!
//! Rule of thumb: publish-subscribe carries the data, an event service of the same name wakes the
//! readers, nothing else. Frames are written once, into the loaned sample, and read in place by every
//! reader. Three rules that cost others days are kept here once and for all:
//!
//! * every wait is bounded, and readers drain after each return, fired or not ([`wait`]): iceoryx2
//!   0.10.0 can lose a wake-up;
//! * every topic overflows, so a slow or dead reader never blocks a writer;
//! * two instances have different roots and different prefixes, so that they never meet
//!   ([`Instance`]).

mod error;
mod instance;
mod port;
mod reader;

pub use error::BusError;
pub use instance::{Instance, InstanceError};
pub use port::{FrameLoan, FramePublisher, FrameSubscriber, Loan, Publisher, Subscriber, Wakes, wait};
pub use reader::{FrameMessage, FrameReader, Message, Reader};

use iceoryx2::prelude::*;
use pursuit_messages::topics::{self, Quality, Topic};
use pursuit_messages::{StageStamp, Stamp};
use std::time::Duration;

/// What a message can hold: plain data without pointers, of the same bytes in every process.
pub trait Payload: ZeroCopySend + Copy + Default + core::fmt::Debug + 'static {}
impl<P: ZeroCopySend + Copy + Default + core::fmt::Debug + 'static> Payload for P {}

pub(crate) type Ipc = ipc::Service;

/// Most nodes (processes and tools) of one topic.
const MAX_NODES: usize = 32;

/// One process's place on the bus of an instance.
pub struct Bus {
    node: Node<Ipc>,
    instance: Instance,
}

impl Bus {
    /// Joins the bus of `instance` under the name `name` (a service's name, for listings).
    ///
    /// # Errors
    /// [`BusError::Join`] where the run-time directory cannot be used (another user's, say), [`BusError::Full`] where
    /// there was no room in shared memory for seconds.
    pub fn join(instance: &Instance, name: &str) -> Result<Bus, BusError> {
        check_room(ROOM)?;
        set_log_level(LogLevel::Fatal);
        let config = instance.transport_config();
        let node = NodeBuilder::new()
            .name(&NodeName::new(name).map_err(|e| BusError::join(name, &e))?)
            .config(&config)
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create::<Ipc>()
            .map_err(|e| BusError::join(name, &e))?;
        Ok(Bus { node, instance: instance.clone() })
    }

    /// A writer of topic `T`.
    ///
    /// # Errors
    /// [`BusError::Version`] where a running peer speaks another version of the topic, [`BusError::Full`] where the
    /// kernel has no memory for it.
    pub fn publisher<T>(&self, _topic: T) -> Result<Publisher<T>, BusError>
    where
        T: Topic,
        T::Payload: Payload,
    {
        self.reserved(Publisher::open(self)?)
    }

    /// A reader of topic `T`.
    ///
    /// # Errors
    /// As [`Bus::publisher`].
    pub fn subscriber<T>(&self, _topic: T) -> Result<Subscriber<T>, BusError>
    where
        T: Topic,
        T::Payload: Payload,
    {
        self.reserved(Subscriber::open(self)?)
    }

    /// The writer of FRAMES; every frame has at most `max_bytes`.
    ///
    /// # Errors
    /// As [`Bus::publisher`].
    pub fn frame_publisher(&self, max_bytes: usize) -> Result<FramePublisher, BusError> {
        self.reserved_to(FramePublisher::open(self, max_bytes)?, (FRAMES_IN_USE * max_bytes) as u64)
    }

    /// A reader of FRAMES.
    ///
    /// # Errors
    /// As [`Bus::publisher`].
    pub fn frame_subscriber(&self) -> Result<FrameSubscriber, BusError> {
        self.reserved(FrameSubscriber::open(self)?)
    }

    /// A reader of topic `T` that its writers do not wake.
    ///
    /// # Errors
    /// As [`Bus::subscriber`].
    pub fn reader<T>(&self, _topic: T) -> Result<Reader<T>, BusError>
    where
        T: Topic,
        T::Payload: Payload,
    {
        self.reserved(Reader::open(self)?)
    }

    /// A reader of FRAMES that acquisition does not wake.
    ///
    /// # Errors
    /// As [`Bus::subscriber`].
    pub fn frame_reader(&self) -> Result<FrameReader, BusError> {
        self.reserved(FrameReader::open(self)?)
    }

    /// The port, and memory for all that it will ever use.
    fn reserved<P>(&self, port: P) -> Result<P, BusError> {
        self.reserved_to(port, RESERVED)
    }

    fn reserved_to<P>(&self, port: P, most: u64) -> Result<P, BusError> {
        match self.instance.reserve(most) {
            Ok(()) => Ok(port),
            Err(_) => Err(BusError::full(ROOM)),
        }
    }

    /// Gives back what dead processes left on the bus; how many were cleaned up.
    pub fn clean_dead(&self) -> u64 {
        self.node.try_cleanup_dead_nodes().cleanups
    }

    /// Opens every topic and keeps it open as long as the answer lives: quality and types stay as one
    /// creator fixed them, and a process of another version is refused by name.
    ///
    /// # Errors
    /// As [`Bus::publisher`].
    pub fn hold_all_topics(&self) -> Result<HeldTopics, BusError> {
        let mut held = HeldTopics { keep: Vec::new() };
        held.keep.push(Box::new((self.frames_service()?, self.event_service::<topics::Frames>()?)));
        self.hold::<topics::VoteFields>(&mut held)?;
        self.hold::<topics::Targets>(&mut held)?;
        self.hold::<topics::JointStates>(&mut held)?;
        self.hold::<topics::DriverStates>(&mut held)?;
        self.hold::<topics::SetPoints>(&mut held)?;
        self.hold::<topics::LearnerStates>(&mut held)?;
        self.hold::<topics::WorldStates>(&mut held)?;
        self.hold::<topics::WorldCommands>(&mut held)?;
        self.hold::<topics::Healths>(&mut held)?;
        Ok(held)
    }

    fn hold<T>(&self, held: &mut HeldTopics) -> Result<(), BusError>
    where
        T: Topic,
        T::Payload: Payload,
    {
        held.keep.push(Box::new((self.data_service::<T>()?, self.event_service::<T>()?)));
        Ok(())
    }

    pub(crate) fn data_service<T>(&self) -> Result<port::DataService<T::Payload>, BusError>
    where
        T: Topic,
        T::Payload: ZeroCopySend + Copy + core::fmt::Debug + 'static,
    {
        let name = service_name(T::NAME)?;
        let Quality { publishers, subscribers, buffer, borrowed, history } = T::QUALITY;
        retry(&self.node, T::NAME, || {
            self.node
                .service_builder(&name)
                .publish_subscribe::<T::Payload>()
                .user_header::<Stamp>()
                .max_publishers(publishers)
                .max_subscribers(subscribers)
                .subscriber_max_buffer_size(buffer)
                .subscriber_max_borrowed_samples(borrowed)
                .history_size(history)
                .enable_safe_overflow(true)
                .max_nodes(MAX_NODES)
                .open_or_create()
        })
    }

    pub(crate) fn frames_service(&self) -> Result<port::FrameService, BusError> {
        let name = service_name(topics::Frames::NAME)?;
        let Quality { publishers, subscribers, buffer, borrowed, history } = topics::Frames::QUALITY;
        retry(&self.node, topics::Frames::NAME, || {
            self.node
                .service_builder(&name)
                .publish_subscribe::<[u8]>()
                .user_header::<Stamp>()
                // No alignment of the payload: iceoryx2 0.10 rounds each byte of the slice up to it, and a pool of
                // 49 MB has 3.1 GB, most of it never touched.
                .max_publishers(publishers)
                .max_subscribers(subscribers)
                .subscriber_max_buffer_size(buffer)
                .subscriber_max_borrowed_samples(borrowed)
                .history_size(history)
                .enable_safe_overflow(true)
                .max_nodes(MAX_NODES)
                .open_or_create()
        })
    }

    pub(crate) fn event_service<T: Topic>(&self) -> Result<port::EventService, BusError> {
        let name = service_name(T::NAME)?;
        retry(&self.node, T::NAME, || {
            self.node
                .service_builder(&name)
                .event()
                .max_notifiers(MAX_NODES)
                .max_listeners(MAX_NODES)
                .max_nodes(MAX_NODES)
                .open_or_create()
        })
    }

    pub(crate) fn node(&self) -> &Node<Ipc> {
        &self.node
    }
}

/// Shared memory that a process of the instance needs to join, bytes; for its ports it asks by itself.
const ROOM: u64 = 1 << 20;
/// Of each piece of shared memory so much at most is taken from the kernel at once, bytes; only the frames' is larger.
const RESERVED: u64 = 8 << 20;
/// Frames of a publisher that are in use at the same time, with room to spare: of those that a stopped reader of every
/// kind could hold back besides, the pages come at their first use.
const FRAMES_IN_USE: usize = 32;
/// How often is looked for room, [`OPEN_PAUSE`] apart: for 3 s.
const ROOM_LOOKS: u32 = 60;

/// Waits for room: who uses memory that is not there ends of SIGBUS.
///
/// # Errors
/// [`BusError::Full`] where that many bytes do not become free.
fn check_room(needed: u64) -> Result<(), BusError> {
    for look in 0..ROOM_LOOKS {
        if look > 0 {
            std::thread::sleep(OPEN_PAUSE);
        }
        // Where nobody can tell, nobody is refused.
        if instance::free_memory().is_none_or(|free| free >= needed) {
            return Ok(());
        }
    }
    Err(BusError::full(needed))
}

/// Keeps every topic open; see [`Bus::hold_all_topics`].
pub struct HeldTopics {
    keep: Vec<Box<dyn core::any::Any>>,
}

impl HeldTopics {
    /// How many topics are held.
    pub fn count(&self) -> usize {
        self.keep.len()
    }
}

/// The shared memory that all topics of one instance can take, bytes: what iceoryx2 0.10 reserves per
/// publisher is subscribers × (buffer + borrowed) + history + loaned samples.
pub fn memory_budget(frame_bytes: usize) -> usize {
    fn of<T: Topic>(payload: usize) -> usize {
        let q = T::QUALITY;
        let samples = q.subscribers * (q.buffer + q.borrowed) + q.history + 2;
        samples * (payload + size_of::<Stamp>() + size_of::<StageStamp>()) * q.publishers
    }
    of::<topics::Frames>(frame_bytes)
        + of::<topics::VoteFields>(size_of::<pursuit_messages::Votes>())
        + of::<topics::Targets>(size_of::<pursuit_messages::Target>())
        + of::<topics::JointStates>(size_of::<pursuit_messages::Joints>())
        + of::<topics::DriverStates>(size_of::<pursuit_messages::DriverState>())
        + of::<topics::SetPoints>(size_of::<pursuit_messages::SetPoint>())
        + of::<topics::LearnerStates>(size_of::<pursuit_messages::LearnerState>())
        + of::<topics::WorldStates>(size_of::<pursuit_messages::WorldState>())
        + of::<topics::WorldCommands>(size_of::<pursuit_messages::WorldCommand>())
        + of::<topics::Healths>(size_of::<pursuit_messages::Health>())
}

fn service_name(name: &str) -> Result<ServiceName, BusError> {
    ServiceName::new(name).map_err(|e| BusError::Open { topic: name.to_owned(), cause: format!("{e:?}") })
}

/// How often opening is tried again while a dead peer's remains are cleaned up.
const OPEN_ATTEMPTS: u32 = 100;
/// Pause between two attempts; together with [`OPEN_ATTEMPTS`] about 5 s.
const OPEN_PAUSE: Duration = Duration::from_millis(50);

/// Runs `open` until it works, cleaning up after dead peers in between; gives up at once where the
/// versions differ.
pub(crate) fn retry<R, E: core::fmt::Debug>(
    node: &Node<Ipc>,
    topic: &str,
    mut open: impl FnMut() -> Result<R, E>,
) -> Result<R, BusError> {
    let mut cause = String::new();
    for attempt in 0..OPEN_ATTEMPTS {
        match open() {
            Ok(opened) => return Ok(opened),
            Err(error) => cause = format!("{error:?}"),
        }
        if BusError::is_version_conflict(&cause) {
            return Err(BusError::Version { topic: topic.to_owned(), cause });
        }
        if attempt > 0 {
            std::thread::sleep(OPEN_PAUSE);
        }
        node.try_cleanup_dead_nodes();
    }
    Err(BusError::Open { topic: topic.to_owned(), cause })
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
