//! Writers and readers of topics.

use crate::{Bus, BusError, Ipc, retry};
use core::cell::Cell;
use core::fmt::Debug;
use core::mem::MaybeUninit;
use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::prelude::*;
use iceoryx2::sample::Sample;
use iceoryx2::sample_mut::SampleMut;
use iceoryx2::sample_mut_uninit::SampleMutUninit;
use iceoryx2::service::port_factory::{event, publish_subscribe};
use pursuit_messages::Stamp;
use pursuit_messages::stamp::LAYOUT;
use pursuit_messages::topics::{Frames, Topic};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use std::os::fd::BorrowedFd;
use std::time::Duration;

pub(crate) type DataService<P> = publish_subscribe::PortFactory<Ipc, P, Stamp>;
pub(crate) type FrameService = publish_subscribe::PortFactory<Ipc, [u8], Stamp>;
pub(crate) type EventService = event::PortFactory<Ipc>;

/// Samples that a writer holds at once: the one being written, and one to spare.
const MAX_LOANED: usize = 2;

/// A writer of topic `T`.
pub struct Publisher<T: Topic>
where
    T::Payload: ZeroCopySend + Copy + Default + Debug + 'static,
{
    publisher: iceoryx2::port::publisher::Publisher<Ipc, T::Payload, Stamp>,
    notifier: Notifier<Ipc>,
}

impl<T: Topic> Publisher<T>
where
    T::Payload: ZeroCopySend + Copy + Default + Debug + 'static,
{
    pub(crate) fn open(bus: &Bus) -> Result<Publisher<T>, BusError> {
        let service = bus.data_service::<T>()?;
        let event = bus.event_service::<T>()?;
        let publisher = retry(bus.node(), T::NAME, || {
            service.publisher_builder().max_loaned_samples(MAX_LOANED).create()
        })?;
        let notifier = retry(bus.node(), T::NAME, || event.notifier_builder().create())?;
        Ok(Publisher { publisher, notifier })
    }

    /// A message to fill in place, all fields at their defaults.
    ///
    /// # Errors
    /// [`BusError::Send`] where no sample is free.
    pub fn loan(&self) -> Result<Loan<'_, T>, BusError> {
        let sample = self.publisher.loan_uninit().map_err(|e| send_error(T::NAME, &e))?;
        Ok(Loan { sample: sample.write_payload(T::Payload::default()), publisher: self })
    }

    /// Sends a small message.
    ///
    /// # Errors
    /// [`BusError::Send`].
    pub fn publish(&self, stamp: &Stamp, payload: &T::Payload) -> Result<(), BusError> {
        let mut loan = self.loan()?;
        *loan.payload_mut() = *payload;
        loan.send(stamp)
    }

    /// Connects to readers that came since the last message and hands them the history; they find it when
    /// their bounded wait ends.
    pub fn greet_new_readers(&self) {
        use iceoryx2::port::update_connections::UpdateConnections;
        let _ = self.publisher.update_connections();
    }
}

/// A message being written in shared memory.
pub struct Loan<'a, T: Topic>
where
    T::Payload: ZeroCopySend + Copy + Default + Debug + 'static,
{
    sample: SampleMut<Ipc, T::Payload, Stamp>,
    publisher: &'a Publisher<T>,
}

impl<T: Topic> Loan<'_, T>
where
    T::Payload: ZeroCopySend + Copy + Default + Debug + 'static,
{
    /// The payload, in shared memory.
    pub fn payload_mut(&mut self) -> &mut T::Payload {
        self.sample.payload_mut()
    }

    /// Hands the message to all readers.
    ///
    /// # Errors
    /// [`BusError::Send`].
    pub fn send(mut self, stamp: &Stamp) -> Result<(), BusError> {
        *self.sample.user_header_mut() = *stamp;
        self.sample.send().map_err(|e| send_error(T::NAME, &e))?;
        let _ = self.publisher.notifier.notify();
        Ok(())
    }
}

/// The writer of FRAMES.
pub struct FramePublisher {
    publisher: iceoryx2::port::publisher::Publisher<Ipc, [u8], Stamp>,
    notifier: Notifier<Ipc>,
}

impl FramePublisher {
    pub(crate) fn open(bus: &Bus, max_bytes: usize) -> Result<FramePublisher, BusError> {
        let service = bus.frames_service()?;
        let event = bus.event_service::<Frames>()?;
        let publisher = retry(bus.node(), Frames::NAME, || {
            service
                .publisher_builder()
                .initial_max_slice_len(max_bytes)
                .allocation_strategy(AllocationStrategy::Static)
                .max_loaned_samples(MAX_LOANED)
                .create()
        })?;
        let notifier = retry(bus.node(), Frames::NAME, || event.notifier_builder().create())?;
        Ok(FramePublisher { publisher, notifier })
    }

    /// Room for a frame of `bytes` in shared memory, to render or read into. What it holds before is
    /// left over from an older frame.
    ///
    /// # Errors
    /// [`BusError::Send`] where no sample is free or `bytes` is more than the publisher was opened for.
    pub fn loan(&self, bytes: usize) -> Result<FrameLoan<'_>, BusError> {
        let sample = self.publisher.loan_slice_uninit(bytes).map_err(|e| send_error(Frames::NAME, &e))?;
        Ok(FrameLoan { sample, publisher: self })
    }

    /// Connects to readers that came since the last frame and hands them the history.
    pub fn greet_new_readers(&self) {
        use iceoryx2::port::update_connections::UpdateConnections;
        let _ = self.publisher.update_connections();
    }
}

/// A frame being written in shared memory.
pub struct FrameLoan<'a> {
    sample: SampleMutUninit<Ipc, [MaybeUninit<u8>], Stamp>,
    publisher: &'a FramePublisher,
}

impl FrameLoan<'_> {
    /// The pixels, row by row, in shared memory.
    #[allow(unsafe_code)]
    pub fn pixels_mut(&mut self) -> &mut [u8] {
        let pixels = self.sample.payload_mut();
        // SAFETY: the pool is a POSIX shared-memory segment: its pages are zeroed by the kernel and
        // hold whole bytes ever after, so every `u8` in it is initialised; same length, same lifetime.
        unsafe { core::slice::from_raw_parts_mut(pixels.as_mut_ptr().cast::<u8>(), pixels.len()) }
    }

    /// Hands the frame to all readers.
    ///
    /// # Errors
    /// [`BusError::Send`].
    #[allow(unsafe_code)]
    pub fn send(mut self, stamp: &Stamp) -> Result<(), BusError> {
        *self.sample.user_header_mut() = *stamp;
        // SAFETY: every byte is initialised, see `pixels_mut`.
        let sample = unsafe { self.sample.assume_init() };
        sample.send().map_err(|e| send_error(Frames::NAME, &e))?;
        let _ = self.publisher.notifier.notify();
        Ok(())
    }
}

/// A reader of topic `T`.
pub struct Subscriber<T: Topic>
where
    T::Payload: ZeroCopySend + Copy + Default + Debug + 'static,
{
    subscriber: iceoryx2::port::subscriber::Subscriber<Ipc, T::Payload, Stamp>,
    listener: Listener<Ipc>,
    refused: Cell<u64>,
}

impl<T: Topic> Subscriber<T>
where
    T::Payload: ZeroCopySend + Copy + Default + Debug + 'static,
{
    pub(crate) fn open(bus: &Bus) -> Result<Subscriber<T>, BusError> {
        let service = bus.data_service::<T>()?;
        let event = bus.event_service::<T>()?;
        let subscriber = retry(bus.node(), T::NAME, || service.subscriber_builder().create())?;
        let listener = retry(bus.node(), T::NAME, || event.listener_builder().create())?;
        Ok(Subscriber { subscriber, listener, refused: Cell::new(0) })
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
    T::Payload: ZeroCopySend + Copy + Default + Debug + 'static,
{
    sample: Sample<Ipc, T::Payload, Stamp>,
}

impl<T: Topic> Message<T>
where
    T::Payload: ZeroCopySend + Copy + Default + Debug + 'static,
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

/// A reader of FRAMES.
pub struct FrameSubscriber {
    subscriber: iceoryx2::port::subscriber::Subscriber<Ipc, [u8], Stamp>,
    listener: Listener<Ipc>,
    refused: Cell<u64>,
}

impl FrameSubscriber {
    pub(crate) fn open(bus: &Bus) -> Result<FrameSubscriber, BusError> {
        let service = bus.frames_service()?;
        let event = bus.event_service::<Frames>()?;
        let subscriber = retry(bus.node(), Frames::NAME, || service.subscriber_builder().create())?;
        let listener = retry(bus.node(), Frames::NAME, || event.listener_builder().create())?;
        Ok(FrameSubscriber { subscriber, listener, refused: Cell::new(0) })
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

/// Whatever can wake a service.
pub trait Wakes {
    /// The listener behind it.
    #[doc(hidden)]
    fn listener(&self) -> &Listener<Ipc>;
}

impl<T: Topic> Wakes for Subscriber<T>
where
    T::Payload: ZeroCopySend + Copy + Default + Debug + 'static,
{
    fn listener(&self) -> &Listener<Ipc> {
        &self.listener
    }
}

impl Wakes for FrameSubscriber {
    fn listener(&self) -> &Listener<Ipc> {
        &self.listener
    }
}

/// Most inputs one service waits for.
const MAX_INPUTS: usize = 8;

/// Waits until one of `inputs` has something, or `limit` has passed. The caller drains all its inputs
/// after every return: a wake-up can be lost in the transport, so the limit is part of the protocol and
/// not a mere time-out.
///
/// # Errors
/// [`BusError::Wait`] where the kernel refuses (never for a signal).
#[allow(unsafe_code)]
pub fn wait(inputs: &[&dyn Wakes], limit: Duration) -> Result<(), BusError> {
    assert!(inputs.len() <= MAX_INPUTS, "a service waits for at most {MAX_INPUTS} inputs");
    let raw: [i32; MAX_INPUTS] = core::array::from_fn(|k| {
        // SAFETY: the descriptor is used below only, while the listener behind it is borrowed.
        inputs.get(k).map_or(-1, |input| unsafe { input.listener().file_descriptor().native_handle() })
    });
    let mut descriptors: [PollFd<'_>; MAX_INPUTS] = core::array::from_fn(|k| {
        // SAFETY: open as long as `inputs` is borrowed; unused slots repeat the first one and are cut off.
        let fd = unsafe { BorrowedFd::borrow_raw(if raw[k] < 0 { raw[0] } else { raw[k] }) };
        PollFd::from_borrowed_fd(fd, PollFlags::IN)
    });
    let limit = Timespec { tv_sec: limit.as_secs() as i64, tv_nsec: i64::from(limit.subsec_nanos()) };
    match poll(&mut descriptors[..inputs.len()], Some(&limit)) {
        Ok(_) | Err(rustix::io::Errno::INTR) => {}
        Err(error) => return Err(BusError::Wait(error.to_string())),
    }
    for input in inputs {
        // Exactly one `try_wait` per return: looping here is what loses wake-ups.
        let _ = input.listener().try_wait(|_| {});
    }
    Ok(())
}

fn send_error(topic: &'static str, cause: &dyn Debug) -> BusError {
    BusError::Send { topic, cause: format!("{cause:?}") }
}

fn receive_error(topic: &'static str, cause: &dyn Debug) -> BusError {
    BusError::Receive { topic, cause: format!("{cause:?}") }
}
