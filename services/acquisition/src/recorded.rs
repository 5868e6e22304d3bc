//! The frames of a recording as a camera, at their old pace or another.

use crate::camera::{Camera, CameraError, Exposure};
use crate::config::Recorded;
use pursuit_messages::ImageShape;
use pursuit_recording::{Reader, Sample};
use pursuit_runtime::clock::{monotonic_ns, sleep_until_ns};
use std::time::Duration;

/// After a recording that cannot be read it is tried again, ns.
const RETRY_NS: u64 = 1_000_000_000;

/// Before the first frame its readers have so long to come, ns: who comes late passes frames over.
const GATHER_NS: u64 = 1_000_000_000;

/// A frame that waits for its time.
struct Next {
    frame: u64,
    due_ns: u64,
    pixels: Vec<u8>,
}

/// A recording that is played. No frame is left out: one that is late is sent late.
pub struct RecordedCamera {
    settings: Recorded,
    shape: ImageShape,
    reader: Option<Reader>,
    next: Option<Next>,
    epoch: u64,
    /// Exposure of the first frame that is played, in the recording, ns.
    first_ns: Option<u64>,
    over: bool,
    retry_ns: u64,
}

impl RecordedCamera {
    /// The recording of `settings` as a camera of that shape. Opens nothing yet.
    pub fn new(settings: &Recorded, shape: ImageShape) -> RecordedCamera {
        RecordedCamera {
            settings: settings.clone(),
            shape,
            reader: None,
            next: None,
            epoch: 0,
            first_ns: None,
            over: false,
            retry_ns: 0,
        }
    }

    fn read_on(&mut self) -> Result<(), CameraError> {
        let broken = |error: pursuit_recording::RecordingError| CameraError::Empty(error.to_string());
        let reader = match &mut self.reader {
            Some(reader) => reader,
            None => {
                (self.epoch, self.first_ns) = (monotonic_ns() + GATHER_NS, None);
                self.reader.insert(Reader::open(&self.settings.file).map_err(broken)?)
            }
        };
        let mut begins_ns = None;
        while let Some(entry) = reader.next_entry().map_err(broken)? {
            let Sample::Frame(pixels) = entry.sample else { continue };
            let exposure_ns = entry.stamp.exposure_ns;
            let begin_ns = *begins_ns.get_or_insert(exposure_ns);
            if self.first_ns.is_none() && exposure_ns < begin_ns + self.settings.from_ns {
                continue;
            }
            if entry.stamp.image != self.shape || pixels.len() != self.shape.bytes() {
                let (is, wanted) = (entry.stamp.image, self.shape);
                return Err(CameraError::Empty(format!(
                    "frame {} of the recording is {}x{}, the config's camera {}x{}",
                    entry.stamp.frame, is.width, is.height, wanted.width, wanted.height
                )));
            }
            let since_ns = exposure_ns.saturating_sub(*self.first_ns.get_or_insert(exposure_ns));
            let due_ns = self.epoch + (since_ns as f64 / self.settings.speed) as u64;
            self.next = Some(Next { frame: entry.stamp.frame, due_ns, pixels });
            return Ok(());
        }
        if self.first_ns.is_none() {
            return Err(CameraError::Empty("the recording holds no frame from there on".to_owned()));
        }
        self.reader = None;
        self.over = !self.settings.repeats;
        Ok(())
    }
}

impl Camera for RecordedCamera {
    fn wait(&mut self, limit: Duration) -> Result<Option<Exposure>, CameraError> {
        let latest = monotonic_ns() + limit.as_nanos() as u64;
        let reads_on = self.next.is_none() && !self.over && monotonic_ns() >= self.retry_ns;
        if reads_on && let Err(error) = self.read_on() {
            self.reader = None;
            self.retry_ns = monotonic_ns() + RETRY_NS;
            return Err(error);
        }
        let Some(next) = &self.next else {
            sleep_until_ns(latest);
            return if self.over {
                Err(CameraError::Empty("the recording is over".to_owned()))
            } else {
                Ok(None)
            };
        };
        sleep_until_ns(next.due_ns.min(latest));
        let is_due = monotonic_ns() >= next.due_ns;
        let exposure = Exposure { epoch: self.epoch, frame: next.frame, time_ns: next.due_ns, skipped: 0 };
        Ok(is_due.then_some(exposure))
    }

    fn expose(&mut self, _exposure: &Exposure, pixels: &mut [u8]) -> Result<(), CameraError> {
        let next = self.next.take().ok_or_else(|| CameraError::Empty("no frame is due".to_owned()))?;
        pixels.copy_from_slice(&next.pixels);
        Ok(())
    }
}
