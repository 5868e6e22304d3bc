//! Readers of topics, and what they get: messages in shared memory, read in place.

use crate::{Bus, BusError, Ipc, Payload, retry};
use core::cell::Cell;
use core::fmt::Debug;
use iceoryx2::sample::Sample;
use pursuit_messages::Stamp;
use pursuit_messages::stamp::LAYOUT;
use pursuit_messages::topics::{Frames, Topic};

/// A reader of topic `T` that nothing wakes: it looks when it wants to. Its writers pay nothing for waking it.
pub struct Reader<T: Topic>
where
    T::Payload: Payload,
{
    subscriber: iceoryx2::port::subscriber::Subscriber<Ipc, T::Payload, Stamp>,
    refused: Cell<u64>,
}

impl<T: Topic> Reader<T>
where
    T::Payload: Payload,
{
    pub(crate) fn open(bus: &Bus) -> Result<Reader<T>, BusError> {
        let service = bus.data_service::<T>()?;
        let subscriber = retry(bus.node(), T::NAME, || service.subscriber_builder().create())?;
        Ok(Reader { subscriber, refused: Cell::new(0) })
    }

    /// The next message, oldest first; `None` when there is none. Messages of another layout are
    /// refused and counted.
    ///
    /// # Errors
    /// [`BusError::Receive`]: count it and go on.
    pub fn receive(&self) -> Result<Option<Message<T>>, BusError> {
        loop {
            match self.subscriber.receive() {
                Ok(Some(sample)) if sample.user_header().layout == LAYOUT => {
                    return Ok(Some(Message { sample }));
                }
                Ok(Some(_)) => self.refused.set(self.refused.get() + 1),
                Ok(None) => return Ok(None),
                Err(error) => return Err(receive_error(T::NAME, &error)),
            }
        }
    }

    /// The newest message, and how many older ones were passed over.
    ///
    /// # Errors
    /// [`BusError::Receive`]: count it and go on.
    pub fn newest(&self) -> Result<Option<(Message<T>, u64)>, BusError> {
        let mut newest = None;
        let mut passed = 0;
        while let Some(message) = self.receive()? {
            passed += u64::from(newest.replace(message).is_some());
        }
        Ok(newest.map(|message| (message, passed)))
    }

    /// Messages refused so far.
    pub fn refused(&self) -> u64 {
        self.refused.get()
    }
}

/// A message in shared memory, read in place; its memory returns to the writer when it is dropped.
pub struct Message<T: Topic>
where
    T::Payload: Payload,
{
    sample: Sample<Ipc, T::Payload, Stamp>,
}

impl<T: Topic> Message<T>
where
    T::Payload: Payload,
{
    /// The frame that caused it.
    pub fn stamp(&self) -> &Stamp {
        self.sample.user_header()
    }

    /// The payload, in place.
    pub fn payload(&self) -> &T::Payload {
        self.sample.payload()
    }
}

/// A reader of FRAMES that nothing wakes.
pub struct FrameReader {
    subscriber: iceoryx2::port::subscriber::Subscriber<Ipc, [u8], Stamp>,
    refused: Cell<u64>,
}

impl FrameReader {
    pub(crate) fn open(bus: &Bus) -> Result<FrameReader, BusError> {
        let service = bus.frames_service()?;
        let subscriber = retry(bus.node(), Frames::NAME, || service.subscriber_builder().create())?;
        Ok(FrameReader { subscriber, refused: Cell::new(0) })
    }

    /// The next frame, oldest first; `None` when there is none. A frame whose header does not fit its
    /// bytes is refused and counted.
    ///
    /// # Errors
    /// [`BusError::Receive`]: count it and go on.
    pub fn receive(&self) -> Result<Option<FrameMessage>, BusError> {
        loop {
            match self.subscriber.receive() {
                Ok(Some(sample)) => match FrameMessage::checked(sample) {
                    Some(frame) => return Ok(Some(frame)),
                    None => self.refused.set(self.refused.get() + 1),
                },
                Ok(None) => return Ok(None),
                Err(error) => return Err(receive_error(Frames::NAME, &error)),
            }
        }
    }

    /// Frames refused so far.
    pub fn refused(&self) -> u64 {
        self.refused.get()
    }
}

/// A frame in shared memory, read in place.
pub struct FrameMessage {
    sample: Sample<Ipc, [u8], Stamp>,
}

impl FrameMessage {
    fn checked(sample: Sample<Ipc, [u8], Stamp>) -> Option<FrameMessage> {
        let stamp = sample.user_header();
        let shape = stamp.image;
        let fits = stamp.layout == LAYOUT
            && shape.format == pursuit_messages::stamp::FORMAT_GREY8
            && shape.width > 0
            && shape.height > 0
            && shape.stride >= shape.width
            && shape.bytes() == sample.payload().len();
        fits.then_some(FrameMessage { sample })
    }

    /// Number, exposure and shape of the frame.
    pub fn stamp(&self) -> &Stamp {
        self.sample.user_header()
    }

    /// The pixels, row by row (`stamp().image.stride` bytes each), in place.
    pub fn pixels(&self) -> &[u8] {
        self.sample.payload()
    }
}

fn receive_error(topic: &'static str, cause: &dyn Debug) -> BusError {
    BusError::Receive { topic, cause: format!("{cause:?}") }
}
