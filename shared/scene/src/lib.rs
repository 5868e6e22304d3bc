//! What a simulated camera sees, and how the vehicle under it moves. Pure and seeded: no clock, no file,
//! no thread; the same parameters and the same [`View`] give the same bytes on every x86-64 machine, with
//! or without AVX2.
//!
//! A frame is made row by row: exact projective mapping of the row into the table's texture, bilinear
//! look-up in a level that is already blurred by lens and pixel ([`Scene`]), the faces of the vehicle (or the
//! disc) laid over it with their exact coverage, then light and sensor noise.
//!
//! [`sequences`] is a second, planar generator: sequences for judging detectors, with exact ground truth.
//!
//! Frames and units: the base frame has z up and the table at z = 0, metres; the camera has x to the right of
//! the image, y down, z along the viewing direction; the *centre* of pixel (0, 0) is image coordinate (0, 0).

#![cfg_attr(test, allow(clippy::unwrap_used))]

mod coverage;
mod levels;
mod mapping;
mod parameters;
pub mod paths;
mod photometry;
mod random;
mod scene;
pub mod sequences;
mod solid;
mod texture;
mod textures;
mod view;
mod warp;

pub use parameters::{
    BLOB_RADIUS_M, CONTRAST_SD, FOCAL_PX, FRAME_PX, Lighting, NOISE_SIGMA, ParameterError, Profile,
    REFERENCE_TEXEL_M, SceneParameters, TEXEL_M, TEXTURE_TEXELS, VEHICLE_SIZE_M,
};
pub use scene::Scene;
pub use textures::Textures;
pub use view::{Glare, Kind, View, ViewError};
