//! Writers and readers of topics.

use crate::reader::{FrameMessage, FrameReader, Message, Reader};
use crate::{Bus, BusError, Ipc, Payload, retry};
use core::fmt::Debug;
use core::mem::MaybeUninit;
use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::prelude::*;
use iceoryx2::sample_mut::SampleMut;
use iceoryx2::sample_mut_uninit::SampleMutUninit;
use iceoryx2::service::port_factory::{event, publish_subscribe};
use pursuit_messages::Stamp;
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
    T::Payload: Payload,
{
    publisher: iceoryx2::port::publisher::Publisher<Ipc, T::Payload, Stamp>,
    notifier: Notifier<Ipc>,
}

impl<T: Topic> Publisher<T>
where
    T::Payload: Payload,
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
    T::Payload: Payload,
{
    sample: SampleMut<Ipc, T::Payload, Stamp>,
    publisher: &'a Publisher<T>,
}

impl<T: Topic> Loan<'_, T>
where
    T::Payload: Payload,
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

/// A reader of topic `T` that is woken by every message.
pub struct Subscriber<T: Topic>
where
    T::Payload: Payload,
{
    reader: Reader<T>,
    listener: Listener<Ipc>,
}

impl<T: Topic> Subscriber<T>
where
    T::Payload: Payload,
{
    pub(crate) fn open(bus: &Bus) -> Result<Subscriber<T>, BusError> {
        let event = bus.event_service::<T>()?;
        let reader = Reader::open(bus)?;
        let listener = retry(bus.node(), T::NAME, || event.listener_builder().create())?;
        Ok(Subscriber { reader, listener })
    }

    /// As [`Reader::receive`].
    ///
    /// # Errors
    /// [`BusError::Receive`]: count it and go on.
    pub fn receive(&self) -> Result<Option<Message<T>>, BusError> {
        self.reader.receive()
    }

    /// As [`Reader::newest`].
    ///
    /// # Errors
    /// [`BusError::Receive`]: count it and go on.
    pub fn newest(&self) -> Result<Option<(Message<T>, u64)>, BusError> {
        self.reader.newest()
    }

    /// Messages refused so far.
    pub fn refused(&self) -> u64 {
        self.reader.refused()
    }
}

/// A reader of FRAMES that is woken by every frame.
pub struct FrameSubscriber {
    reader: FrameReader,
    listener: Listener<Ipc>,
}

impl FrameSubscriber {
    pub(crate) fn open(bus: &Bus) -> Result<FrameSubscriber, BusError> {
        let event = bus.event_service::<Frames>()?;
        let reader = FrameReader::open(bus)?;
        let listener = retry(bus.node(), Frames::NAME, || event.listener_builder().create())?;
        Ok(FrameSubscriber { reader, listener })
    }

    /// As [`FrameReader::receive`].
    ///
    /// # Errors
    /// [`BusError::Receive`]: count it and go on.
    pub fn receive(&self) -> Result<Option<FrameMessage>, BusError> {
        self.reader.receive()
    }

    /// Frames refused so far.
    pub fn refused(&self) -> u64 {
        self.reader.refused()
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
    T::Payload: Payload,
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
