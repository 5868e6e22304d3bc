//! Readers of topics, and what they get: messages in shared memory, read in place.

use crate::{Bus, BusError, Ipc, Payload, retry};
use core::cell::Cell;
use core::fmt::Debug;
use iceoryx2::sample::Sample;
use pursuit_messages::Stamp;
use pursuit_messages::stamp::LAYOUT;
use pursuit_messages::topics::{Frames, Topic};

/// What a reader lets pass, and how much it did not.
struct Gate {
    /// The newest epoch so far, where all messages are of one camera: epochs are start times, and what is of an
    /// older one is of a camera that is gone.
    epoch: Option<Cell<u64>>,
    refused: Cell<u64>,
}

impl Gate {
    fn of<T: Topic>() -> Gate {
        Gate { epoch: T::OF_ONE_CAMERA.then(Cell::default), refused: Cell::new(0) }
    }

    fn passes(&self, stamp: &Stamp) -> bool {
        let is_old = self
            .epoch
            .as_ref()
            .is_some_and(|epoch| stamp.epoch < epoch.replace(epoch.get().max(stamp.epoch)));
        if is_old || stamp.layout != LAYOUT {
            self.refuse();
            return false;
        }
        true
    }

    fn refuse(&self) {
        self.refused.set(self.refused.get() + 1);
    }
}

/// A reader of topic `T` that nothing wakes: it looks when it wants to. Its writers pay nothing for waking it.
pub struct Reader<T: Topic>
where
    T::Payload: Payload,
{
    subscriber: iceoryx2::port::subscriber::Subscriber<Ipc, T::Payload, Stamp>,
    gate: Gate,
}

impl<T: Topic> Reader<T>
where
    T::Payload: Payload,
{
    pub(crate) fn open(bus: &Bus) -> Result<Reader<T>, BusError> {
        let service = bus.data_service::<T>()?;
        let subscriber = retry(bus.node(), T::NAME, || service.subscriber_builder().create())?;
        Ok(Reader { subscriber, gate: Gate::of::<T>() })
    }

    /// The next message, oldest first; `None` when there is none. Messages of another layout or of an old epoch
    /// are refused and counted.
    ///
    /// # Errors
    /// [`BusError::Receive`]: count it and go on.
    pub fn receive(&self) -> Result<Option<Message<T>>, BusError> {
        loop {
            match self.subscriber.receive() {
                Ok(Some(sample)) if self.gate.passes(sample.user_header()) => {
                    return Ok(Some(Message { sample }));
                }
                Ok(Some(_)) => {}
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
        self.gate.refused.get()
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
    gate: Gate,
}

impl FrameReader {
    pub(crate) fn open(bus: &Bus) -> Result<FrameReader, BusError> {
        let service = bus.frames_service()?;
        let subscriber = retry(bus.node(), Frames::NAME, || service.subscriber_builder().create())?;
        Ok(FrameReader { subscriber, gate: Gate::of::<Frames>() })
    }

    /// The next frame, oldest first; `None` when there is none. A frame of an old epoch, or whose header does
    /// not fit its bytes, is refused and counted.
    ///
    /// # Errors
    /// [`BusError::Receive`]: count it and go on.
    pub fn receive(&self) -> Result<Option<FrameMessage>, BusError> {
        loop {
            match self.subscriber.receive() {
                Ok(Some(sample)) if self.gate.passes(sample.user_header()) => {
                    match FrameMessage::checked(sample) {
                        Some(frame) => return Ok(Some(frame)),
                        None => self.gate.refuse(),
                    }
                }
                Ok(Some(_)) => {}
                Ok(None) => return Ok(None),
                Err(error) => return Err(receive_error(Frames::NAME, &error)),
            }
        }
    }

    /// Frames refused so far.
    pub fn refused(&self) -> u64 {
        self.gate.refused.get()
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
        let fits = shape.format == pursuit_messages::stamp::FORMAT_GREY8
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
