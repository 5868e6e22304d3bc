//! Motion-induced segmentation (paper, section 2.3.2): from vote fields to the target.

use std::fmt;

use crate::blobs::Flood;
use crate::cells::MAX_CELLS;
use crate::compensation::NOMINAL_VELOCITIES;
use crate::engine::{FIELDS, Fields, VoteSummary};
use crate::parameters::{BLOBS_ADDED, Parameters};

/// An object in one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Detection {
    /// Position in the newer frame, px from the centre of the top-left pixel to the right.
    pub u: f64,
    /// As `u`, downward.
    pub v: f64,
    /// Velocity in the image (not relative to the background), px/frame to the right. Rough: quantised
    /// by octaves, 25 to 30 % off.
    pub vu: f64,
    /// As `vu`, downward.
    pub vv: f64,
    /// `1 - cut / contrast`: 0 at the contrast cut, 1/2 at twice the cut, towards 1 above. It grows with
    /// the contrast; it is *not* the probability that there is a target.
    pub confidence: f64,
    /// Area, px².
    pub area_px: f64,
    /// How far it stands out. Of a moving target: mean vote of the best blob over the mean vote of its
    /// field. Of a bright blob: grey levels above the ground over the ground's spread.
    pub contrast: f64,
}

/// Why there is no target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum NoTarget {
    /// There was no pair of frames.
    NoPair,
    /// Nothing voted: after compensation, nothing moves.
    NoVotes,
    /// No blob of acceptable size.
    NoBlob,
    /// The best blob's contrast is below the cut.
    LowContrast(f64),
}

impl fmt::Display for NoTarget {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            NoTarget::NoPair => write!(f, "there is no frame before this one"),
            NoTarget::NoVotes => write!(f, "nothing moves but the camera"),
            NoTarget::NoBlob => write!(f, "no blob of votes has an acceptable size"),
            NoTarget::LowContrast(contrast) => {
                write!(f, "the best blob's contrast is {contrast:.2}, below the cut")
            }
        }
    }
}

/// The answer to one pair of frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Segmentation {
    /// The target, or why there is none.
    pub target: Result<Detection, NoTarget>,
    /// Background velocity (right, down), px/frame.
    pub background: (f64, f64),
}

/// Working memory of [`segment`].
#[derive(Clone, Debug)]
pub struct SegmentScratch {
    flood: Flood,
    searched: [bool; MAX_CELLS],
    sum: [f64; MAX_CELLS],
    target: Vec<usize>,
}

impl SegmentScratch {
    /// For any grid.
    pub fn new() -> SegmentScratch {
        SegmentScratch {
            flood: Flood::new(MAX_CELLS),
            searched: [false; MAX_CELLS],
            sum: [0.0; MAX_CELLS],
            target: Vec::with_capacity(MAX_CELLS),
        }
    }
}

impl Default for SegmentScratch {
    fn default() -> SegmentScratch {
        SegmentScratch::new()
    }
}

/// A blob, found again by flooding its half field from its first cell.
#[derive(Clone, Copy, Debug)]
struct Blob {
    contrast: f64,
    half: HalfField,
    seed: usize,
}

/// The votes of one sign in one field, where they exceed the blob level.
#[derive(Clone, Copy, Debug)]
struct HalfField {
    field: usize,
    sign: f64,
    level: f64,
}

impl HalfField {
    fn vote(&self, fields: &Fields, cell: usize) -> f64 {
        self.sign * f64::from(fields[self.field][cell])
    }

    fn inside(&self, fields: &Fields, cell: usize) -> bool {
        self.vote(fields, cell) > self.level
    }
}

/// Finds the target: the best blobs by contrast are added, thresholded, and the centre of gravity of the
/// largest remaining blob is the target.
///
/// "Separately for each signed field [...] the three highest-rank blobs" is read as the three best of
/// all 24 half fields together: three of each find far fewer targets (design notes on vision, section 1). To the
/// centre of gravity, which lies half way between the target's two positions, half of its displacement
/// is added: the position is the one in the newer frame.
///
/// # Panics
/// If the summary's grid has more than [`MAX_CELLS`] cells.
pub fn segment(
    fields: &Fields,
    summary: &VoteSummary,
    parameters: &Parameters,
    scratch: &mut SegmentScratch,
) -> Segmentation {
    let cells = summary.columns * summary.rows;
    assert!(cells <= MAX_CELLS, "a grid of {cells} cells, there is room for {MAX_CELLS}");
    scratch.target.clear();
    let target = find_target(fields, summary, parameters, scratch);
    let background = background_velocity(fields, summary, parameters, &scratch.target);
    Segmentation { target, background }
}

fn find_target(
    fields: &Fields,
    summary: &VoteSummary,
    parameters: &Parameters,
    scratch: &mut SegmentScratch,
) -> Result<Detection, NoTarget> {
    if !summary.valid {
        return Err(NoTarget::NoPair);
    }
    let cells = summary.columns * summary.rows;
    if fields.iter().all(|field| field[..cells].iter().all(|&vote| vote == 0.0)) {
        return Err(NoTarget::NoVotes);
    }
    mark_searched(summary, parameters, &mut scratch.searched[..cells]);
    let best = best_blobs(fields, summary, parameters, scratch);
    let contrast = best[0].ok_or(NoTarget::NoBlob)?.contrast;
    if contrast < f64::from(parameters.contrast_cut) {
        return Err(NoTarget::LowContrast(contrast));
    }
    add_blobs(fields, summary, &best, scratch);
    select_component(summary, parameters, scratch);
    Ok(measure(fields, summary, parameters, contrast, scratch))
}

/// Which cells have their centre in the disc that is searched.
fn mark_searched(summary: &VoteSummary, parameters: &Parameters, searched: &mut [bool]) {
    let half = [summary.columns as f64 / 2.0, summary.rows as f64 / 2.0];
    let radius = f64::from(parameters.search_radius) * half[0].hypot(half[1]);
    for (cell, inside) in searched.iter_mut().enumerate() {
        let x = (cell % summary.columns) as f64 + 0.5 - half[0];
        let y = (cell / summary.columns) as f64 + 0.5 - half[1];
        *inside = x.hypot(y) <= radius;
    }
}

/// The blobs of acceptable size with the highest contrast, best first; of equals the one with the lower
/// label, positive before negative.
fn best_blobs(
    fields: &Fields,
    summary: &VoteSummary,
    parameters: &Parameters,
    scratch: &mut SegmentScratch,
) -> [Option<Blob>; BLOBS_ADDED] {
    let cells = summary.columns * summary.rows;
    let SegmentScratch { flood, searched, .. } = scratch;
    let count = searched[..cells].iter().filter(|&&inside| inside).count().max(1);
    let sizes = parameters.min_blob_cells..=parameters.max_blob_cells;
    let mut best = [None; BLOBS_ADDED];
    for field in 0..FIELDS {
        let votes = fields[field][..cells].iter().zip(&searched[..cells]);
        let sum: f64 = votes.filter(|(_, inside)| **inside).map(|(vote, _)| f64::from(vote.abs())).sum();
        let mean = sum / count as f64;
        if mean == 0.0 {
            continue;
        }
        let level = f64::from(parameters.blob_threshold) * mean;
        for sign in [1.0, -1.0] {
            let half = HalfField { field, sign, level };
            flood.start(summary.columns, summary.rows);
            for seed in 0..cells {
                let blob = flood.component(seed, |cell| searched[cell] && half.inside(fields, cell));
                if sizes.contains(&blob.len()) {
                    let sum: f64 = blob.iter().map(|&cell| half.vote(fields, cell)).sum();
                    rank(&mut best, Blob { contrast: sum / blob.len() as f64 / mean, half, seed });
                }
            }
        }
    }
    best
}

/// Puts `blob` in its place among the best.
fn rank(best: &mut [Option<Blob>; BLOBS_ADDED], mut blob: Blob) {
    for place in best {
        match place {
            Some(held) if held.contrast >= blob.contrast => {}
            Some(held) => std::mem::swap(held, &mut blob),
            None => {
                *place = Some(blob);
                return;
            }
        }
    }
}

/// `scratch.sum`: the moduli of the votes in the blobs, added.
fn add_blobs(fields: &Fields, summary: &VoteSummary, blobs: &[Option<Blob>], scratch: &mut SegmentScratch) {
    scratch.sum[..summary.columns * summary.rows].fill(0.0);
    for blob in blobs.iter().flatten() {
        scratch.flood.start(summary.columns, summary.rows);
        let SegmentScratch { flood, searched, sum, .. } = scratch;
        let inside = |cell: usize| searched[cell] && blob.half.inside(fields, cell);
        for &cell in flood.component(blob.seed, inside) {
            sum[cell] += blob.half.vote(fields, cell);
        }
    }
}

/// `scratch.target`: the component of the thresholded sum with the most votes.
fn select_component(summary: &VoteSummary, parameters: &Parameters, scratch: &mut SegmentScratch) {
    let SegmentScratch { flood, sum, target, .. } = scratch;
    let cells = summary.columns * summary.rows;
    let largest = sum[..cells].iter().fold(0.0, |largest: f64, &votes| largest.max(votes));
    let level = f64::from(parameters.sum_threshold) * largest;
    let mut most = 0.0;
    flood.start(summary.columns, summary.rows);
    for seed in 0..cells {
        let component = flood.component(seed, |cell| sum[cell] > level);
        let votes: f64 = component.iter().map(|&cell| sum[cell]).sum();
        if votes > most {
            most = votes;
            target.clear();
            target.extend_from_slice(component);
        }
    }
}

/// Position, velocity and area of the component.
fn measure(
    fields: &Fields,
    summary: &VoteSummary,
    parameters: &Parameters,
    contrast: f64,
    scratch: &SegmentScratch,
) -> Detection {
    let cell_px = f64::from(summary.cell_px);
    let (mut weight, mut x, mut y) = (0.0, 0.0, 0.0);
    for &cell in &scratch.target {
        let votes = scratch.sum[cell];
        weight += votes;
        x += votes * ((cell % summary.columns) as f64 + 0.5);
        y += votes * ((cell / summary.columns) as f64 + 0.5);
    }
    let relative = mean_velocity(fields, scratch.target.iter().copied());
    Detection {
        u: x / weight * cell_px + relative.0 / 2.0,
        v: y / weight * cell_px + relative.1 / 2.0,
        vu: f64::from(summary.shift.0) + relative.0,
        vv: f64::from(summary.shift.1) + relative.1,
        confidence: 1.0 - f64::from(parameters.contrast_cut) / contrast,
        area_px: scratch.target.len() as f64 * cell_px * cell_px,
        contrast,
    }
}

/// Velocity of what voted in `cells`, px/frame: the nominal velocities weighted with the votes.
fn mean_velocity(fields: &Fields, cells: impl Iterator<Item = usize> + Clone) -> (f64, f64) {
    let (mut weight, mut x, mut y) = (0.0, 0.0, 0.0);
    for (field, [vx, vy]) in fields.iter().zip(NOMINAL_VELOCITIES) {
        for cell in cells.clone() {
            let vote = f64::from(field[cell]);
            weight += vote.abs();
            x += vote * vx;
            y += vote * vy;
        }
    }
    if weight == 0.0 { (0.0, 0.0) } else { (x / weight, y / weight) }
}

/// Background velocity: "averaging all the velocity fields excluding the target position".
///
/// The average is damped as the global estimate is, by `sum(abs(c)) / max(sum(abs(c)), floor)`: a
/// compensated background votes only with its errors, and the undamped average makes the shift worse
/// (design notes on vision, section 2 item 10). A floor of 0 is the paper, to the letter.
fn background_velocity(
    fields: &Fields,
    summary: &VoteSummary,
    parameters: &Parameters,
    target: &[usize],
) -> (f64, f64) {
    if !summary.valid {
        return (0.0, 0.0);
    }
    let mut is_target = [false; MAX_CELLS];
    for &cell in target {
        is_target[cell] = true;
    }
    let outside = (0..summary.columns * summary.rows).filter(|&cell| !is_target[cell]);
    let rest = mean_velocity(fields, outside);
    let share = match summary.coherence_sum.max(parameters.floor) {
        0.0 => 0.0,
        weight => summary.coherence_sum / weight,
    };
    (f64::from(summary.shift.0) + share * rest.0, f64::from(summary.shift.1) + share * rest.1)
}
