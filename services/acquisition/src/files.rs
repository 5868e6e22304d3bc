//! A folder of images as a camera, at the configured frame rate.

use crate::camera::{Camera, CameraError, Exposure};
use crate::config::Files;
use pursuit_images::{list, load_grey_into};
use pursuit_runtime::clock::{monotonic_ns, sleep_until_ns};
use pursuit_runtime::settings;
use std::path::PathBuf;
use std::time::Duration;

/// Pause before a folder that failed is looked at again, ns.
const RETRY_NS: u64 = 500_000_000;

/// Shows the images of a folder in natural order. The wall clock decides: an image whose time has passed
/// is skipped.
pub struct FileCamera {
    settings: Files,
    width: u32,
    height: u32,
    period_ns: u64,
    images: Vec<PathBuf>,
    epoch: u64,
    next: u64,
    retry_ns: u64,
}

impl FileCamera {
    /// A camera for frames of the configured size; the folder is read at the first `wait`.
    pub fn new(settings: &Files, camera: &settings::Camera) -> FileCamera {
        FileCamera {
            settings: settings.clone(),
            width: camera.width,
            height: camera.height,
            period_ns: camera.period_ns(),
            images: Vec::new(),
            epoch: 0,
            next: 0,
            retry_ns: 0,
        }
    }

    fn open(&mut self) -> Result<(), CameraError> {
        self.images = list(&self.settings.folder)?;
        if self.images.is_empty() {
            let folder = self.settings.folder.display();
            return Err(CameraError::Empty(format!("{folder} holds no image (png, jpg, pgm, tif)")));
        }
        self.epoch = monotonic_ns();
        self.next = 0;
        Ok(())
    }

    /// What went wrong takes the camera out of service until `RETRY_NS` from now.
    fn close(&mut self) {
        self.images.clear();
        self.retry_ns = monotonic_ns() + RETRY_NS;
    }

    fn path(&self, frame: u64) -> Option<&PathBuf> {
        let count = self.images.len() as u64;
        let index = if self.settings.repeats { frame.checked_rem(count)? } else { frame };
        self.images.get(index as usize)
    }
}

impl Camera for FileCamera {
    fn wait(&mut self, limit: Duration) -> Result<Option<Exposure>, CameraError> {
        let latest = monotonic_ns() + limit.as_nanos() as u64;
        if self.images.is_empty() {
            if monotonic_ns() < self.retry_ns {
                sleep_until_ns(latest);
                return Ok(None);
            }
            if let Err(error) = self.open() {
                self.close();
                return Err(error);
            }
        }
        let due = self.epoch + self.next * self.period_ns;
        sleep_until_ns(due.min(latest));
        let now = monotonic_ns();
        if now < due || self.path(self.next).is_none() {
            if now >= due {
                sleep_until_ns(latest);
            }
            return Ok(None);
        }
        let newest = ((now - self.epoch) / self.period_ns).max(self.next);
        let newest = if self.settings.repeats { newest } else { newest.min(self.images.len() as u64 - 1) };
        let skipped = newest - self.next;
        self.next = newest + 1;
        Ok(Some(Exposure {
            epoch: self.epoch,
            frame: newest,
            time_ns: self.epoch + newest * self.period_ns,
            skipped,
        }))
    }

    fn expose(&mut self, exposure: &Exposure, pixels: &mut [u8]) -> Result<(), CameraError> {
        let Some(path) = self.path(exposure.frame).cloned() else {
            return Err(CameraError::Empty("the folder has fewer images than before".to_owned()));
        };
        let read = load_grey_into(&path, pixels, self.width, self.height);
        if let Err(error) = read {
            self.close();
            return Err(error.into());
        }
        Ok(())
    }
}
