//! [`Parameters`] of the paper's method, each default with its reason.

use std::fmt;

use crate::MAX_CELLS;

/// Passes of compensation: the first estimate is shrunk (6.5 for 11 px/frame); two or three converge and
/// double the range of background speeds that is captured. The paper runs 1.
pub const PASSES: u32 = 3;
/// Smallest total coherence that may be normalised away. The total is 1.1..2.2 for any background speed
/// in range and below 0.2 for a still background; without the floor a still background hands the
/// estimate to the *target*. 0 is the paper, to the letter.
pub const FLOOR: f64 = 1.0;
/// Blob level, in global mean votes of the field. 1.5 to 4 find the same targets.
pub const BLOB_THRESHOLD: f32 = 2.0;
/// Smallest blob, cells: "so as to reduce the smallest acceptable target size to 1 pixel".
pub const MIN_BLOB_CELLS: usize = 1;
/// Largest blob, cells. 1/16 of the image is 16 cells of 256; a disc of that area touches up to 24.
pub const MAX_BLOB_CELLS: usize = 24;
/// Blobs that are added: "the three highest-rank blobs".
pub const BLOBS_ADDED: usize = 3;
/// Threshold on the sum of the blobs, as a share of its maximum. 0.15 to 0.5 find the same targets.
pub const SUM_THRESHOLD: f32 = 0.3;
/// Contrast of the best blob below which there is no target: the paper's "(if any)". The contrast is a
/// ratio of votes, not a probability: empty scenes pass it too (design notes on vision, section 0).
pub const CONTRAST_CUT: f32 = 3.0;
/// Field of search: the whole image.
pub const SEARCH_RADIUS: f32 = 1.0;
/// More passes than this cannot help: the capture range does not grow any more.
const MAX_PASSES: u32 = 10;

/// How each level is smoothed before every second row and column is dropped.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Smoothing {
    /// `[1 4 6 4 1] / 16` (sigma 1 px of the finer grid): as good as sigma 2 and half its price.
    #[default]
    Binomial,
    /// Gaussian of sigma 2 px of the finer grid, radius 6: "the pixel scale is 1/2 of each blur-scale".
    Gaussian,
}

/// What can be set. `Default` is the paper's method with two repairs; [`Parameters::literal`] is without.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameters {
    /// Kernel of the pyramid.
    pub smoothing: Smoothing,
    /// Most passes of compensation, 0 (none) to 10. Default [`PASSES`].
    pub passes: u32,
    /// Smallest total coherence that may be normalised away, 0..=12. Default [`FLOOR`].
    pub floor: f64,
    /// Blob level in mean votes of the field, above 0. Default [`BLOB_THRESHOLD`].
    pub blob_threshold: f32,
    /// Smallest blob, cells, from 1. Default [`MIN_BLOB_CELLS`].
    pub min_blob_cells: usize,
    /// Largest blob, cells, up to [`MAX_CELLS`]. Default [`MAX_BLOB_CELLS`].
    pub max_blob_cells: usize,
    /// Threshold on the sum of the best blobs, share of its maximum, 0..1. Default [`SUM_THRESHOLD`].
    pub sum_threshold: f32,
    /// Contrast of the best blob below which there is no target, from 0. Default [`CONTRAST_CUT`].
    pub contrast_cut: f32,
    /// Radius of the disc around the image's centre in which the target is searched for, half diagonals,
    /// 0.05..=1; 1 is the whole image. Not in the paper's method, but in its words: after compensation
    /// "the residual background clutter [...] is thus generally small in the center of the image, but can
    /// still be substantial near the corners" (section 2.3.2), and a hand that follows has its target
    /// near the centre. Default [`SEARCH_RADIUS`].
    pub search_radius: f32,
}

impl Default for Parameters {
    fn default() -> Parameters {
        Parameters {
            smoothing: Smoothing::default(),
            passes: PASSES,
            floor: FLOOR,
            blob_threshold: BLOB_THRESHOLD,
            min_blob_cells: MIN_BLOB_CELLS,
            max_blob_cells: MAX_BLOB_CELLS,
            sum_threshold: SUM_THRESHOLD,
            contrast_cut: CONTRAST_CUT,
            search_radius: SEARCH_RADIUS,
        }
    }
}

impl Parameters {
    /// The paper to the letter: one pass of compensation, its estimate always fully normalised.
    pub fn literal() -> Parameters {
        Parameters { passes: 1, floor: 0.0, ..Parameters::default() }
    }

    /// Nothing, where every value is in its range.
    ///
    /// # Errors
    /// The first value that is not; NaN never is.
    pub fn check(&self) -> Result<(), ParameterError> {
        let in_range = |name, value: f64, least: f64, most: f64| {
            if (least..=most).contains(&value) {
                Ok(())
            } else {
                Err(ParameterError { name, value, least, most })
            }
        };
        let cells = MAX_CELLS as f64;
        let tiny = f64::from(f32::MIN_POSITIVE);
        let huge = f64::from(f32::MAX);
        in_range("passes", f64::from(self.passes), 0.0, f64::from(MAX_PASSES))?;
        in_range("floor", self.floor, 0.0, 12.0)?;
        in_range("blob_threshold", f64::from(self.blob_threshold), tiny, huge)?;
        in_range("min_blob_cells", self.min_blob_cells as f64, 1.0, cells)?;
        in_range("max_blob_cells", self.max_blob_cells as f64, self.min_blob_cells as f64, cells)?;
        in_range("sum_threshold", f64::from(self.sum_threshold), 0.0, 0.999)?;
        in_range("search_radius", f64::from(self.search_radius), 0.05, 1.0)?;
        in_range("contrast_cut", f64::from(self.contrast_cut), 0.0, huge)
    }
}

/// A parameter outside its range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ParameterError {
    /// Which one.
    pub name: &'static str,
    /// What it is.
    pub value: f64,
    /// The least it may be.
    pub least: f64,
    /// The most it may be.
    pub most: f64,
}

impl fmt::Display for ParameterError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} is {}, it must be {} to {}", self.name, self.value, self.least, self.most)
    }
}

impl std::error::Error for ParameterError {}
