//! Grey images from files, frames from videos, PNG files from pixels, lines and letters drawn over a frame.
//!
//! Pixels are rows from the top, each from the left, without gaps between rows. This is the only crate that
//! names the `image` crate.
#![cfg_attr(test, allow(clippy::unwrap_used))]

mod canvas;
mod error;
mod folder;
mod letters;
mod load;
#[cfg(test)]
mod tests;
mod video;
mod write;

pub use canvas::{Canvas, Colour};
pub use error::ImagesError;
pub use folder::{is_image_name, list};
pub use load::{GreyImage, Limits, load_grey, load_grey_into};
pub use video::Video;
pub use write::{write_png_grey, write_png_rgb};
