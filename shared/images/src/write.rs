//! PNG files.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};

use crate::ImagesError;

/// Writes `width * height` pixels of red, green, blue as a PNG file.
///
/// # Errors
/// The file cannot be written.
///
/// # Panics
/// When `pixels` has not `3 * width * height` bytes, or the image has no pixels.
pub fn write_png_rgb(path: &Path, width: u32, height: u32, pixels: &[u8]) -> Result<(), ImagesError> {
    write(path, width, height, pixels, ExtendedColorType::Rgb8)
}

/// Writes `width * height` grey pixels as a PNG file.
///
/// # Errors
/// The file cannot be written.
///
/// # Panics
/// When `pixels` has not `width * height` bytes, or the image has no pixels.
pub fn write_png_grey(path: &Path, width: u32, height: u32, pixels: &[u8]) -> Result<(), ImagesError> {
    write(path, width, height, pixels, ExtendedColorType::L8)
}

fn write(
    path: &Path,
    width: u32,
    height: u32,
    pixels: &[u8],
    colour: ExtendedColorType,
) -> Result<(), ImagesError> {
    let bytes_per_pixel = u64::from(colour.bits_per_pixel() / 8);
    let bytes = u64::from(width) * u64::from(height) * bytes_per_pixel;
    assert!(
        bytes > 0 && pixels.len() as u64 == bytes,
        "{width}x{height} pixels do not take {}",
        pixels.len()
    );
    let unwritable = |reason: String| ImagesError::Io { path: path.to_owned(), action: "written", reason };
    let file = File::create(path).map_err(|error| unwritable(error.to_string()))?;
    let mut writer = BufWriter::new(file);
    encode(&mut writer, width, height, pixels, colour).map_err(unwritable)?;
    writer.flush().map_err(|error| unwritable(error.to_string()))
}

/// `width * height` pixels of red, green, blue as the bytes of a PNG file.
pub(crate) fn png_rgb(width: u32, height: u32, pixels: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    // Into memory it cannot fail, and the canvas has as many pixels as it says.
    let _ = encode(&mut bytes, width, height, pixels, ExtendedColorType::Rgb8);
    bytes
}

fn encode(
    writer: impl Write,
    width: u32,
    height: u32,
    pixels: &[u8],
    colour: ExtendedColorType,
) -> Result<(), String> {
    PngEncoder::new_with_quality(writer, CompressionType::Fast, FilterType::Adaptive)
        .write_image(pixels, width, height, colour)
        .map_err(|error| error.to_string())
}
