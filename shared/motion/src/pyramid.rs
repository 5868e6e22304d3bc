//! The multi-resolution representation (paper, section 2.2): three times blurred and subsampled.
//!
//! Level `k` (1, 2, 3) has every `2^k`-th row and column; its pixel `i` lies at `2^k i` of the frame.
//! Values are grey levels times 16, 0..=4080, so that all derivatives of a pair fit 16 bits. Outside the
//! frame its border pixels are repeated. All arithmetic is whole-numbered: every processor gives the
//! same bits.

use multiversion::multiversion;

use crate::image::Image;
use crate::parameters::Smoothing;

/// Levels of the pyramid: "three stages of Gaussian blurring and subsampling by factors of 2".
pub(crate) const LEVELS: usize = 3;
/// Columns that the vote kernel takes at once; rows are padded to a multiple of it.
pub(crate) const LANES: usize = 32;
/// Taps on each side of the widest kernel.
const RADIUS: usize = 6;
/// Gaussian of sigma 2 px, radius 6, times 1024: the sums of both directions just fit 32 bits.
const GAUSSIAN: [u32; 2 * RADIUS + 1] = [2, 9, 28, 66, 124, 181, 204, 181, 124, 66, 28, 9, 2];

/// One level: `height` rows of `width` values, `stride` apart; what pads a row is 0.
#[derive(Clone, Debug)]
pub(crate) struct Level {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) stride: usize,
    pub(crate) values: Vec<i16>,
}

impl Level {
    pub(crate) fn new(width: usize, height: usize) -> Level {
        let stride = width.next_multiple_of(LANES) + LANES;
        Level { width, height, stride, values: vec![0; stride * height] }
    }

    #[inline(always)]
    fn row(&self, y: usize) -> &[i16] {
        &self.values[y * self.stride..][..self.width]
    }
}

/// The three levels of one frame.
#[derive(Clone, Debug)]
pub(crate) struct Pyramid {
    pub(crate) levels: [Level; LEVELS],
    /// The last level halved further, where somebody asked for it; mostly none.
    pub(crate) thumbnails: Vec<Level>,
    smoothing: Smoothing,
    /// Column sums of the row in work, with a kernel's radius of repeated border on both sides.
    narrow: Vec<u16>,
    wide: Vec<u32>,
}

impl Pyramid {
    /// An empty pyramid for frames of `width` x `height` px.
    pub(crate) fn new(width: usize, height: usize, smoothing: Smoothing) -> Pyramid {
        let side = |full: usize, k: usize| full.div_ceil(2 << k);
        let levels = std::array::from_fn(|k| Level::new(side(width, k), side(height, k)));
        let sums = width.next_multiple_of(2) + 2 * RADIUS;
        Pyramid { levels, thumbnails: Vec::new(), smoothing, narrow: vec![0; sums], wide: vec![0; sums] }
    }

    /// The same, and the last level halved until its shorter side is at most `most` px.
    pub(crate) fn with_thumbnails(mut self, most: usize) -> Pyramid {
        let (mut width, mut height) = (self.levels[LEVELS - 1].width, self.levels[LEVELS - 1].height);
        while width.min(height) > most {
            (width, height) = (width.div_ceil(2), height.div_ceil(2));
            self.thumbnails.push(Level::new(width, height));
        }
        self
    }

    /// Fills the levels from `image` moved by `shift` whole px (right, down): the pixel at (x, y) is the
    /// image's at (x, y) - shift. A shift, shorter than the side, costs nothing more.
    pub(crate) fn build(&mut self, image: &Image<'_>, shift: (i32, i32)) {
        let [first, second, third] = &mut self.levels;
        match self.smoothing {
            Smoothing::Binomial => {
                halve_frame(image, shift, first, &mut self.narrow);
                halve_level(first, second, &mut self.narrow);
                halve_level(second, third, &mut self.narrow);
            }
            Smoothing::Gaussian => {
                let frame = Source { width: image.width(), height: image.height(), shift };
                halve_wide(frame, |y| image.row(y), 16, first, &mut self.wide);
                halve_wide(Source::of(first), |y| first.row(y), 20, second, &mut self.wide);
                halve_wide(Source::of(second), |y| second.row(y), 20, third, &mut self.wide);
            }
        }
        let mut last = &*third;
        for thumbnail in &mut self.thumbnails {
            halve_level(last, thumbnail, &mut self.narrow);
            last = thumbnail;
        }
    }
}

/// Row `y` of the moved frame, its border repeated, in the frame as it was.
#[inline(always)]
fn source_row(y: i32, shift: i32, height: usize) -> usize {
    let last = height as i32 - 1;
    (y.clamp(0, last) - shift).clamp(0, last) as usize
}

/// The five source rows around row `2 y` of the moved frame.
#[inline(always)]
fn five_rows(y: usize, shift: i32, height: usize) -> [usize; 5] {
    std::array::from_fn(|tap| source_row(2 * y as i32 + tap as i32 - 2, shift, height))
}

/// `[1 4 6 4 1]` (no division).
#[inline(always)]
fn binomial(far: (u16, u16), near: (u16, u16), middle: u16) -> u16 {
    far.0 + far.1 + 4 * (near.0 + near.1) + 6 * middle
}

/// The source columns that are still inside after the move (first, end), and where the first of them
/// lies in the sums of a row.
#[inline(always)]
fn place(width: usize, shift: i32, radius: usize) -> (usize, usize, usize) {
    let (left, right) = (shift.max(0) as usize, (-shift).max(0) as usize);
    (right, width - left, radius + left)
}

/// Repeats the border's sums to both ends.
#[inline(always)]
fn repeat_border<T: Copy>(sums: &mut [T], from: usize, to: usize) {
    let (left, right) = (sums[from], sums[to - 1]);
    sums[..from].fill(left);
    sums[to..].fill(right);
}

/// Level 1 from the frame. Vertical sums are below 16 x 255, horizontal below 256 x 255: 16 bits do.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn halve_frame(image: &Image<'_>, shift: (i32, i32), out: &mut Level, sums: &mut [u16]) {
    let sums = &mut sums[..2 * out.width + 4];
    let (first, last, at) = place(image.width(), shift.0, 2);
    let n = last - first;
    for y in 0..out.height {
        let [y0, y1, y2, y3, y4] = five_rows(y, shift.1, image.height());
        let (r0, r1) = (&image.row(y0)[first..last], &image.row(y1)[first..last]);
        let (r3, r4) = (&image.row(y3)[first..last], &image.row(y4)[first..last]);
        let r2 = &image.row(y2)[first..last];
        let middle = &mut sums[at..][..n];
        for x in 0..n {
            let wide = |row: &[u8]| u16::from(row[x]);
            middle[x] = binomial((wide(r0), wide(r4)), (wide(r1), wide(r3)), wide(r2));
        }
        repeat_border(sums, at, at + n);
        let row = &mut out.values[y * out.stride..][..out.width];
        drop_columns(sums, row);
    }
}

/// A level from the one below it. Sums are below 16 x 4080: 16 bits do; rounded in each direction.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn halve_level(source: &Level, out: &mut Level, sums: &mut [u16]) {
    let sums = &mut sums[..2 * out.width + 4];
    let n = source.width;
    for y in 0..out.height {
        let [y0, y1, y2, y3, y4] = five_rows(y, 0, source.height);
        let (r0, r1) = (&source.row(y0)[..n], &source.row(y1)[..n]);
        let (r3, r4) = (&source.row(y3)[..n], &source.row(y4)[..n]);
        let r2 = &source.row(y2)[..n];
        let middle = &mut sums[2..][..n];
        for x in 0..n {
            let wide = |row: &[i16]| row[x] as u16;
            middle[x] = (binomial((wide(r0), wide(r4)), (wide(r1), wide(r3)), wide(r2)) + 8) >> 4;
        }
        repeat_border(sums, 2, 2 + n);
        let row = &mut out.values[y * out.stride..][..out.width];
        drop_columns(sums, row);
    }
}

/// Horizontal `[1 4 6 4 1] / 16` at every second column. `sums` has `2 * row.len() + 4` values.
#[inline(always)]
fn drop_columns(sums: &[u16], row: &mut [i16]) {
    let sums = &sums[..2 * row.len() + 4];
    for (x, value) in row.iter_mut().enumerate() {
        let at = 2 * x;
        let (far, near) = ((sums[at], sums[at + 4]), (sums[at + 1], sums[at + 3]));
        *value = ((binomial(far, near, sums[at + 2]) + 8) >> 4) as i16;
    }
}

/// Shape and shift of what [`halve_wide`] reads.
#[derive(Clone, Copy)]
struct Source {
    width: usize,
    height: usize,
    shift: (i32, i32),
}

impl Source {
    fn of(level: &Level) -> Source {
        Source { width: level.width, height: level.height, shift: (0, 0) }
    }
}

/// The wide kernel, for frames and levels alike; `bits` brings the sums back to 16 steps per grey level.
fn halve_wide<'a, T: Copy + Into<i32> + 'a>(
    source: Source,
    row_of: impl Fn(usize) -> &'a [T],
    bits: u32,
    out: &mut Level,
    sums: &mut [u32],
) {
    let sums = &mut sums[..2 * out.width + 2 * RADIUS];
    let (first, last, at) = place(source.width, source.shift.0, RADIUS);
    let n = last - first;
    for y in 0..out.height {
        let middle = &mut sums[at..][..n];
        middle.fill(0);
        for (tap, weight) in GAUSSIAN.into_iter().enumerate() {
            let from = 2 * y as i32 + tap as i32 - RADIUS as i32;
            let row = row_of(source_row(from, source.shift.1, source.height));
            for (sum, &value) in middle.iter_mut().zip(&row[first..last]) {
                *sum += weight * value.into() as u32;
            }
        }
        repeat_border(sums, at, at + n);
        let row = &mut out.values[y * out.stride..][..out.width];
        for (x, value) in row.iter_mut().enumerate() {
            let taps = &sums[2 * x..][..GAUSSIAN.len()];
            let sum: u32 = taps.iter().zip(GAUSSIAN).map(|(s, w)| s * w).sum();
            *value = ((sum + (1 << (bits - 1))) >> bits) as i16;
        }
    }
}
