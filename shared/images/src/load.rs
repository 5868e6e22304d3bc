//! Image files of any kind as 8 bit grey.

use std::fs::File;
use std::io::{BufReader, Seek, SeekFrom};
use std::path::Path;

use image::{DynamicImage, GrayImage, ImageDecoder, ImageReader};

use crate::ImagesError;

/// An 8 bit grey image.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GreyImage {
    /// Pixels in a row, at least 1.
    pub width: u32,
    /// Rows, at least 1.
    pub height: u32,
    /// `width * height` grey values, rows from the top.
    pub pixels: Vec<u8>,
}

/// What is decoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Shortest width and height in pixels.
    pub min_side: u32,
    /// Longest width and height in pixels.
    pub max_side: u32,
    /// Most bytes that the decoded pixels may take, and again what the decoder may allocate beside them.
    pub max_bytes: u64,
}

impl Default for Limits {
    /// Up to 4096x4096 pixels, and memory for them in 32 bit colour with transparency (the widest there is).
    fn default() -> Limits {
        Limits { min_side: 1, max_side: 4096, max_bytes: 16 * 4096 * 4096 }
    }
}

impl Limits {
    /// Refuses what is smaller or larger.
    pub(crate) fn check_sides(&self, path: &Path, width: u32, height: u32) -> Result<(), ImagesError> {
        let Limits { min_side, max_side, .. } = *self;
        let sides = min_side..=max_side;
        if sides.contains(&width) && sides.contains(&height) {
            return Ok(());
        }
        Err(ImagesError::Sides { path: path.to_owned(), width, height, min_side, max_side })
    }
}

/// The image in the file at `path` as grey: colours by their luminance (Rec. 709 weights, as the `image` crate
/// has them), 16 bit and PNM of any largest value scaled to 8 bit and rounded, transparency ignored. What the
/// file contains counts, not its ending.
///
/// # Errors
/// The file cannot be read, is not a whole image, or is outside `limits`.
pub fn load_grey(path: &Path, limits: Limits) -> Result<GreyImage, ImagesError> {
    let grey = decode(path, limits, |width, height| limits.check_sides(path, width, height))?;
    Ok(GreyImage { width: grey.width(), height: grey.height(), pixels: grey.into_raw() })
}

/// Like [`load_grey`], into `pixels`, for an image that must be `width` x `height`. After an error `pixels` is
/// as it was.
///
/// # Errors
/// The file cannot be read, is not a whole image, or has another size.
///
/// # Panics
/// When `pixels` has not `width * height` bytes.
pub fn load_grey_into(path: &Path, pixels: &mut [u8], width: u32, height: u32) -> Result<(), ImagesError> {
    assert_eq!(
        pixels.len() as u64,
        u64::from(width) * u64::from(height),
        "the buffer is not of the image's size"
    );
    let (expected_width, expected_height) = (width, height);
    let grey = decode(path, Limits::default(), |width, height| {
        if (width, height) != (expected_width, expected_height) {
            let path = path.to_owned();
            return Err(ImagesError::Size { path, width, height, expected_width, expected_height });
        }
        Ok(())
    })?;
    pixels.copy_from_slice(grey.as_raw());
    Ok(())
}

/// Decodes the file after `check_size` has seen its width and height.
fn decode(
    path: &Path,
    limits: Limits,
    check_size: impl FnOnce(u32, u32) -> Result<(), ImagesError>,
) -> Result<GrayImage, ImagesError> {
    let unreadable = |error: std::io::Error| ImagesError::Io {
        path: path.to_owned(),
        action: "read",
        reason: error.to_string(),
    };
    let mut file = File::open(path).map_err(unreadable)?;
    if file.seek(SeekFrom::End(0)).map_err(unreadable)? == 0 {
        return Err(broken(path, &"the file is empty"));
    }
    file.rewind().map_err(unreadable)?;
    let reader = BufReader::new(file);
    let mut reader = ImageReader::new(reader).with_guessed_format().map_err(unreadable)?;
    if reader.format().is_none() {
        return Err(broken(path, &"it begins like no PNG, JPEG, PNM or TIFF"));
    }
    let mut memory = image::Limits::no_limits();
    memory.max_alloc = Some(limits.max_bytes);
    reader.limits(memory);
    let decoder = reader.into_decoder().map_err(|error| broken(path, &error))?;
    let (width, height) = decoder.dimensions();
    check_size(width, height)?;
    if width == 0 || height == 0 {
        return Err(broken(path, &format_args!("it is {width}x{height} pixels")));
    }
    let (bytes, max_bytes) = (decoder.total_bytes(), limits.max_bytes);
    if bytes > max_bytes {
        return Err(ImagesError::Memory { path: path.to_owned(), bytes, max_bytes });
    }
    let image = DynamicImage::from_decoder(decoder).map_err(|error| broken(path, &error))?;
    Ok(image.into_luma8())
}

fn broken(path: &Path, reason: &dyn std::fmt::Display) -> ImagesError {
    let reason = reason.to_string().lines().collect::<Vec<_>>().join(" ");
    ImagesError::Broken { path: path.to_owned(), reason }
}
