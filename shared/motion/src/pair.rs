//! The two pyramids that both detectors work on, and how they are kept from pair to pair.

use crate::engine::{EngineError, Older};
use crate::image::{Image, MAX_SIDE, MIN_SIDE};
use crate::parameters::Smoothing;
use crate::pyramid::Pyramid;

/// The pyramids of an older and a newer frame of one shape.
#[derive(Clone, Debug)]
pub(crate) struct FramePair {
    /// Columns and rows of the frames, px.
    pub(crate) size: (usize, usize),
    pub(crate) older: Pyramid,
    pub(crate) newer: Pyramid,
    holds_newer: bool,
}

impl FramePair {
    /// Empty pyramids for frames of `width` x `height` px.
    ///
    /// # Errors
    /// A side outside [`MIN_SIDE`]`..=`[`MAX_SIDE`].
    pub(crate) fn new(width: usize, height: usize, smoothing: Smoothing) -> Result<FramePair, EngineError> {
        let sides = MIN_SIDE..=MAX_SIDE;
        if !sides.contains(&width) || !sides.contains(&height) {
            return Err(EngineError::Size { width, height });
        }
        let pyramid = Pyramid::new(width, height, smoothing);
        Ok(FramePair { size: (width, height), older: pyramid.clone(), newer: pyramid, holds_newer: false })
    }

    /// Brings both pyramids up to date; the older image, if there is one.
    ///
    /// # Panics
    /// If a frame is not of the pair's shape.
    pub(crate) fn take<'a>(&mut self, older: Older<'a>, newer: &Image<'_>) -> Option<Image<'a>> {
        self.assert_shape(newer);
        let image = match older {
            Older::Missing => None,
            Older::LastNewer(image) if self.holds_newer => {
                self.assert_shape(&image);
                std::mem::swap(&mut self.older, &mut self.newer);
                Some(image)
            }
            Older::LastNewer(image) | Older::Frame(image) => {
                self.assert_shape(&image);
                self.older.build(&image, (0, 0));
                Some(image)
            }
        };
        self.newer.build(newer, (0, 0));
        self.holds_newer = true;
        image
    }

    /// Level `k` (0, 1, 2) of the newer frame: columns, rows, values from row to row, and the values, in 1/16
    /// grey level.
    ///
    /// # Panics
    /// If there is no such level.
    pub(crate) fn level(&self, k: usize) -> (usize, usize, usize, &[i16]) {
        let level = &self.newer.levels[k];
        (level.width, level.height, level.stride, &level.values)
    }

    fn assert_shape(&self, image: &Image<'_>) {
        let size = (image.width(), image.height());
        assert!(size == self.size, "a frame of {size:?} px was given to an engine for {:?} px", self.size);
    }
}
