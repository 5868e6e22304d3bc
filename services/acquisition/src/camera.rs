//! What a camera is to the rest of the system.

use std::time::Duration;

/// One exposure that is due.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Exposure {
    /// Start of the camera's life; another value means that frame numbers began again.
    pub epoch: u64,
    /// Number of the frame within the epoch.
    pub frame: u64,
    /// Middle of the exposure on the loop's clock, ns.
    pub time_ns: u64,
    /// Exposures passed over before this one.
    pub skipped: u64,
}

/// Why a camera gives no frame.
#[derive(Debug, thiserror::Error)]
pub enum CameraError {
    /// The bus failed.
    #[error(transparent)]
    Bus(#[from] pursuit_bus::BusError),
    /// Files cannot be read.
    #[error(transparent)]
    Images(#[from] pursuit_images::ImagesError),
    /// The view cannot be rendered.
    #[error("cannot render: {0}")]
    View(String),
    /// There is nothing to show.
    #[error("{0}")]
    Empty(String),
}

/// A camera. To make one opens nothing: the first `wait` does, when the process before this one has left. `expose` is
/// called at most once for what `wait` gave, with a buffer of exactly the
/// configured frame's size: a camera writes each pixel once, into memory that the readers will read.
pub trait Camera {
    /// The next exposure, waiting for it no longer than `limit`.
    ///
    /// # Errors
    /// [`CameraError`]; the caller reports it and asks again.
    fn wait(&mut self, limit: Duration) -> Result<Option<Exposure>, CameraError>;

    /// Writes the pixels of that exposure, row by row.
    ///
    /// # Errors
    /// [`CameraError`]; the frame is not published.
    fn expose(&mut self, exposure: &Exposure, pixels: &mut [u8]) -> Result<(), CameraError>;
}
