//! [`Image`]: a checked view of one grey frame.

use std::fmt;

/// Shortest side of a frame, px: level 3 of the pyramid is then 8 px wide, enough for the border margins.
pub const MIN_SIDE: usize = 64;
/// Longest side of a frame, px.
pub const MAX_SIDE: usize = 4096;

/// A grey frame, 8 bits per pixel, row by row.
#[derive(Clone, Copy, Debug)]
pub struct Image<'a> {
    pixels: &'a [u8],
    width: usize,
    height: usize,
    stride: usize,
}

impl<'a> Image<'a> {
    /// A view of `height` rows of `width` px; row `y` starts at `pixels[y * stride]`.
    ///
    /// # Errors
    /// A side outside [`MIN_SIDE`]`..=`[`MAX_SIDE`], a stride below the width, or too few bytes. The last
    /// row may end at its last pixel.
    pub fn new(
        pixels: &'a [u8],
        width: usize,
        height: usize,
        stride: usize,
    ) -> Result<Image<'a>, ImageError> {
        let sides = MIN_SIDE..=MAX_SIDE;
        if !sides.contains(&width) || !sides.contains(&height) {
            return Err(ImageError::Size { width, height });
        }
        if stride < width {
            return Err(ImageError::Stride { stride, width });
        }
        let needed = stride
            .checked_mul(height - 1)
            .and_then(|bytes| bytes.checked_add(width))
            .ok_or(ImageError::Stride { stride, width })?;
        if pixels.len() < needed {
            return Err(ImageError::TooShort { bytes: pixels.len(), needed });
        }
        Ok(Image { pixels, width, height, stride })
    }

    /// Columns, px.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows, px.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Row `y` from above, `width` px.
    ///
    /// # Panics
    /// If there is no such row.
    #[inline(always)]
    pub fn row(&self, y: usize) -> &'a [u8] {
        assert!(y < self.height, "row {y} of an image of {} rows", self.height);
        &self.pixels[y * self.stride..][..self.width]
    }
}

/// Why bytes are not an [`Image`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ImageError {
    /// A side is outside the range.
    Size {
        /// Columns, px.
        width: usize,
        /// Rows, px.
        height: usize,
    },
    /// Rows would overlap, or the end of the image is beyond all memory.
    Stride {
        /// Bytes from row to row.
        stride: usize,
        /// Columns, px.
        width: usize,
    },
    /// Fewer bytes than the shape needs.
    TooShort {
        /// Bytes given.
        bytes: usize,
        /// Bytes needed.
        needed: usize,
    },
}

impl fmt::Display for ImageError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            ImageError::Size { width, height } => {
                write!(f, "the image is {width}x{height} px; each side must be {MIN_SIDE} to {MAX_SIDE} px")
            }
            ImageError::Stride { stride, width } => {
                write!(f, "the image's rows are {stride} bytes apart but {width} px wide")
            }
            ImageError::TooShort { bytes, needed } => {
                write!(f, "the image has {bytes} bytes, its shape needs {needed}")
            }
        }
    }
}

impl std::error::Error for ImageError {}
