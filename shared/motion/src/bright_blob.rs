//! A static bright object on a darker ground: what the arm trains on (paper, section 4: "a static white
//! blob on a black background"). How it was found is not in the paper.
//!
//! Coarse to fine: cells of about 1/128 of the shorter side are averaged, the ground is their median and
//! the blob the one large component above half of the peak; its centroid is then taken at full
//! resolution, weighted with the grey levels above a soft threshold, which is what makes it sub-pixel.

use multiversion::multiversion;

use crate::blobs::Flood;
use crate::image::Image;
use crate::segment::Detection;

/// Cells along the shorter side, at least (frames from 256 px).
const CELLS: usize = 128;
/// Narrowest cell, px: averages the noise of 4 px.
const MIN_CELL_PX: usize = 2;
/// Least height of the blob above the ground, grey levels: ten times the noise of a decent camera.
pub const MIN_HEIGHT_GREY: f64 = 20.0;
/// Least height in spreads of the ground. The highest of 16 000 cells of pure Gaussian noise reaches 4,
/// of a natural texture 3 to 4.
pub const MIN_CONTRAST: f64 = 6.0;
/// Area of the second largest bright component, as a share of the largest, from which on no component is
/// the one meant.
pub const MAX_RIVAL_SHARE: f64 = 0.5;
/// Largest blob, share of the frame: beyond it the median is no longer surely the ground.
pub const MAX_AREA_SHARE: f64 = 0.25;
/// Least share of its bounding box that the blob fills: a disc fills 0.79, a square on its tip 0.5, what
/// meanders less.
pub const MIN_FILL: f64 = 0.45;
/// Smallest spread of the ground, grey levels: cells are rounded to whole grey levels.
const MIN_SPREAD_GREY: f64 = 1.0;
/// Standard deviation of a normal distribution over its median absolute deviation.
const SIGMA_PER_MAD: f64 = 1.4826;
/// Pixels count with what they exceed this share of the blob's height by: noise of the ground stays out,
/// and since nothing jumps at the threshold, the anti-aliased rim counts on all sides alike.
const SOFT_THRESHOLD: f64 = 0.3;

/// What counts as a blob.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BlobParameters {
    /// Least height above the ground, grey levels. Default [`MIN_HEIGHT_GREY`].
    pub min_height_grey: f64,
    /// Least height in spreads (standard deviations) of the ground. Default [`MIN_CONTRAST`].
    pub min_contrast: f64,
    /// Largest second component, share of the first one's area. Default [`MAX_RIVAL_SHARE`].
    pub max_rival_share: f64,
    /// Largest blob, share of the frame. Default [`MAX_AREA_SHARE`].
    pub max_area_share: f64,
    /// Least share of its bounding box that it fills. Default [`MIN_FILL`].
    pub min_fill: f64,
}

impl Default for BlobParameters {
    fn default() -> BlobParameters {
        BlobParameters {
            min_height_grey: MIN_HEIGHT_GREY,
            min_contrast: MIN_CONTRAST,
            max_rival_share: MAX_RIVAL_SHARE,
            max_area_share: MAX_AREA_SHARE,
            min_fill: MIN_FILL,
        }
    }
}

/// Working memory of [`detect_blob`] for frames of one shape.
#[derive(Clone, Debug)]
pub struct BlobScratch {
    size: (usize, usize),
    cell_px: usize,
    columns: usize,
    rows: usize,
    column_sums: Vec<u16>,
    cells: Vec<u8>,
    flood: Flood,
    blob: Vec<usize>,
    /// Whether the cell belongs to the blob or touches it.
    near: Vec<bool>,
}

impl BlobScratch {
    /// For frames of `width` x `height` px.
    pub fn new(width: usize, height: usize) -> BlobScratch {
        let cell_px = (width.min(height) / CELLS).max(MIN_CELL_PX);
        let (columns, rows) = (width / cell_px, height / cell_px);
        let cells = columns * rows;
        BlobScratch {
            size: (width, height),
            cell_px,
            columns,
            rows,
            column_sums: vec![0; width],
            cells: vec![0; cells],
            flood: Flood::new(cells),
            blob: Vec::with_capacity(cells),
            near: vec![false; cells],
        }
    }

    /// The frame's columns or rows that belong to cells `from..to` of `count`; the last cell takes what
    /// does not fill one.
    fn pixels(&self, from: usize, to: usize, count: usize, side: usize) -> (usize, usize) {
        (from * self.cell_px, if to == count { side } else { to * self.cell_px })
    }
}

/// Bounds in cells, both included.
#[derive(Clone, Copy, Debug)]
struct Bounds {
    left: usize,
    right: usize,
    top: usize,
    bottom: usize,
}

/// Position, area and contrast of the one bright object in `image`; its velocity is 0.
///
/// None where nothing rises above the ground by [`BlobParameters::min_height_grey`] and
/// [`BlobParameters::min_contrast`] spreads, where it touches the frame's border (its centroid would be
/// that of the visible part), is too large, meanders, or has a rival of like size.
///
/// # Panics
/// If the image is not of the scratch's shape.
pub fn detect_blob(
    image: &Image<'_>,
    parameters: &BlobParameters,
    scratch: &mut BlobScratch,
) -> Option<Detection> {
    let size = (image.width(), image.height());
    assert!(size == scratch.size, "a frame of {size:?} px was given to a scratch for {:?} px", scratch.size);
    average_cells(image, scratch.cell_px, &mut scratch.column_sums, &mut scratch.cells);
    let histogram = histogram(scratch.cells.iter().copied());
    let ground = median(&histogram);
    let peak = histogram.iter().rposition(|&count| count > 0)?;
    let spread = (SIGMA_PER_MAD * deviation(&histogram, ground) as f64).max(MIN_SPREAD_GREY);
    let height = (peak - ground) as f64;
    let contrast = height / spread;
    if height < parameters.min_height_grey || contrast < parameters.min_contrast {
        return None;
    }
    let bounds = find_component((ground + peak) / 2, parameters, scratch)?;
    mark_near(scratch);
    let local_ground = median_around(bounds, scratch);
    if peak as f64 - local_ground < parameters.min_height_grey {
        return None;
    }
    let (u, v, area_px) = centroid(image, bounds, (local_ground, peak as f64), scratch)?;
    let confidence = 1.0 - parameters.min_contrast / contrast;
    Some(Detection { u, v, vu: 0.0, vv: 0.0, confidence, area_px, contrast })
}

/// Mean of each cell, rounded; what does not fill a cell at the right and lower border is left out.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn average_cells(image: &Image<'_>, cell_px: usize, column_sums: &mut [u16], cells: &mut [u8]) {
    let columns = image.width() / cell_px;
    let area = (cell_px * cell_px) as u32;
    for (y, line) in cells.chunks_exact_mut(columns).enumerate() {
        // At most 32 rows of 255: 16 bits do.
        column_sums.fill(0);
        for row in 0..cell_px {
            for (sum, &pixel) in column_sums.iter_mut().zip(image.row(y * cell_px + row)) {
                *sum += u16::from(pixel);
            }
        }
        if cell_px == 4 {
            for (cell, s) in line.iter_mut().zip(column_sums.chunks_exact(4)) {
                *cell = ((s[0] + s[1] + s[2] + s[3] + 8) >> 4) as u8;
            }
        } else {
            for (cell, sums) in line.iter_mut().zip(column_sums.chunks_exact(cell_px)) {
                let sum: u32 = sums.iter().map(|&sum| u32::from(sum)).sum();
                *cell = ((sum + area / 2) / area) as u8;
            }
        }
    }
}

fn histogram(values: impl Iterator<Item = u8>) -> [u32; 256] {
    let mut counts = [0; 256];
    for value in values {
        counts[usize::from(value)] += 1;
    }
    counts
}

/// The (lower) median of a histogram.
fn median(histogram: &[u32; 256]) -> usize {
    let half = histogram.iter().sum::<u32>().div_ceil(2);
    let mut below = 0;
    for (value, count) in histogram.iter().enumerate() {
        below += count;
        if below >= half {
            return value;
        }
    }
    0
}

/// Median absolute deviation from `centre`.
fn deviation(values: &[u32; 256], centre: usize) -> usize {
    let mut deviations = [0; 256];
    for (value, &count) in values.iter().enumerate() {
        deviations[value.abs_diff(centre)] += count;
    }
    median(&deviations)
}

/// Puts the largest component above `level` into `scratch.blob`; its bounds, if it is a blob.
fn find_component(level: usize, parameters: &BlobParameters, scratch: &mut BlobScratch) -> Option<Bounds> {
    let BlobScratch { columns, rows, cells, flood, blob, .. } = scratch;
    let (columns, rows) = (*columns, *rows);
    let mut rival = 0;
    blob.clear();
    flood.start(columns, rows);
    for seed in 0..cells.len() {
        if usize::from(cells[seed]) <= level {
            continue;
        }
        let component = flood.component(seed, |cell| usize::from(cells[cell]) > level);
        if component.len() > blob.len() {
            rival = blob.len();
            blob.clear();
            blob.extend_from_slice(component);
        } else {
            rival = rival.max(component.len());
        }
    }
    let (&first, area) = (blob.first()?, blob.len() as f64);
    let start = Bounds { left: first % columns, right: 0, top: first / columns, bottom: 0 };
    let bounds = blob.iter().fold(start, |bounds, &cell| Bounds {
        left: bounds.left.min(cell % columns),
        right: bounds.right.max(cell % columns),
        top: bounds.top.min(cell / columns),
        bottom: bounds.bottom.max(cell / columns),
    });
    let at_border =
        bounds.left == 0 || bounds.top == 0 || bounds.right + 1 == columns || bounds.bottom + 1 == rows;
    let too_large = area > parameters.max_area_share * cells.len() as f64;
    let not_alone = rival as f64 > parameters.max_rival_share * area;
    let box_area = (bounds.right - bounds.left + 1) * (bounds.bottom - bounds.top + 1);
    let meanders = area < parameters.min_fill * box_area as f64;
    if at_border || too_large || not_alone || meanders { None } else { Some(bounds) }
}

/// Marks the cells of the blob, which is not at the border, and their neighbours.
fn mark_near(scratch: &mut BlobScratch) {
    scratch.near.fill(false);
    for &cell in &scratch.blob {
        for row in [cell - scratch.columns, cell, cell + scratch.columns] {
            scratch.near[row - 1..=row + 1].fill(true);
        }
    }
}

/// The ground around the blob: median of the cells two cells outside its bounds.
fn median_around(bounds: Bounds, scratch: &BlobScratch) -> f64 {
    let (left, top) = (bounds.left.saturating_sub(2), bounds.top.saturating_sub(2));
    let right = (bounds.right + 2).min(scratch.columns - 1);
    let bottom = (bounds.bottom + 2).min(scratch.rows - 1);
    let across = (left..=right).flat_map(|x| [(x, top), (x, bottom)]);
    let down = (top..=bottom).flat_map(|y| [(left, y), (right, y)]);
    let ring = across.chain(down).map(|(x, y)| y * scratch.columns + x).filter(|&cell| !scratch.near[cell]);
    median(&histogram(ring.map(|cell| scratch.cells[cell]))) as f64
}

/// Centroid (right, down) and area of what exceeds the ground in and next to the blob's cells; none if
/// it reaches the frame's border.
fn centroid(
    image: &Image<'_>,
    bounds: Bounds,
    (ground, peak): (f64, f64),
    scratch: &BlobScratch,
) -> Option<(f64, f64, f64)> {
    let threshold = (ground + SOFT_THRESHOLD * (peak - ground)).round() as i32;
    let (mut weight, mut along_u, mut along_v, mut light) = (0u64, 0u64, 0u64, 0.0);
    for cy in bounds.top - 1..=bounds.bottom + 1 {
        for cx in bounds.left - 1..=bounds.right + 1 {
            if !scratch.near[cy * scratch.columns + cx] {
                continue;
            }
            let (left, right) = scratch.pixels(cx, cx + 1, scratch.columns, image.width());
            let (top, bottom) = scratch.pixels(cy, cy + 1, scratch.rows, image.height());
            for y in top..bottom {
                let (mut row_weight, mut row_u, mut row_light) = (0u32, 0u32, 0i32);
                for (x, &pixel) in image.row(y)[left..right].iter().enumerate() {
                    let above = (i32::from(pixel) - threshold).max(0) as u32;
                    row_weight += above;
                    row_u += above * x as u32;
                    row_light += i32::from(pixel);
                }
                let at_side = left == 0 && i32::from(image.row(y)[0]) > threshold
                    || right == image.width() && i32::from(image.row(y)[right - 1]) > threshold;
                let at_end = row_weight > 0 && (y == 0 || y + 1 == image.height());
                if at_side || at_end {
                    return None;
                }
                weight += u64::from(row_weight);
                along_u += u64::from(row_u) + u64::from(row_weight) * left as u64;
                along_v += u64::from(row_weight) * y as u64;
                light += f64::from(row_light) - ground * (right - left) as f64;
            }
        }
    }
    if weight == 0 {
        return None;
    }
    let weight = weight as f64;
    Some((along_u as f64 / weight, along_v as f64 / weight, light / (peak - ground)))
}
