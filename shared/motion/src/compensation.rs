//! The simple compensation scheme (paper, section 2.3.2): "the translation term in the global optic flow
//! is estimated by a weighted sum of the 12 spatially integrated sets of votes. The corresponding
//! (rounded) displacement [...] is used for shifting one member of the pair".

use crate::FIELDS;
use crate::parameters::Smoothing;
use crate::votes::{DIRECTIONS, LevelSums, Region};

/// Nominal velocities of the labels 1..12 of the paper's figure 3, full-resolution px per frame, x to
/// the right, y down. A negative vote is for the opposite velocity. Each detector hears the octave from
/// 0.707 to 1.414 times its own speed.
#[rustfmt::skip]
pub const NOMINAL_VELOCITIES: [[f64; 2]; FIELDS] = [
    [2.0, -2.0], [2.0, 2.0], [2.0, 0.0], [0.0, 2.0],
    [4.0, -4.0], [4.0, 4.0], [4.0, 0.0], [0.0, 4.0],
    [8.0, -8.0], [8.0, 8.0], [8.0, 0.0], [0.0, 8.0],
];
/// Largest shift, as a share of the side: beyond it too little of the pair overlaps to vote on. No
/// estimate reaches it from 256 px up.
const MAX_SHIFT_SHARE: usize = 4;

/// Coherence of each field: its spatially integrated votes over those of the same gradients all moving at
/// the nominal velocity, so that this is 1, the opposite -1 (towards the upper end of the octave up to
/// 1.22). The paper leaves the weights open; these do not depend on contrast. A field with no gradient
/// is 0.
pub(crate) fn coherence(sums: &[LevelSums]) -> [f64; FIELDS] {
    std::array::from_fn(|i| {
        let (level, direction) = (&sums[i / DIRECTIONS], i % DIRECTIONS);
        // At the nominal velocity abs(It) = abs(d): half of their sum is abs(d), a quarter half of it.
        let votes = if direction < 2 { 2 * level.votes[direction] } else { level.votes[direction] };
        let norm = level.norms[direction];
        if norm == 0 { 0.0 } else { votes as f64 / norm as f64 }
    })
}

/// Sum of the absolute coherences: 1.1 to 2.2 for any speed in range, below 0.2 for less than 1 px/frame.
pub(crate) fn total(coherence: &[f64; FIELDS]) -> f64 {
    coherence.iter().map(|c| c.abs()).sum()
}

/// Estimate of the translation, px/frame: `sum(c_i v_i) / max(sum(abs(c_i)), floor)`.
///
/// The floor is not in the paper: without it (0) a silent background lets the *target* decide.
pub(crate) fn translation(coherence: &[f64; FIELDS], floor: f64) -> (f64, f64) {
    let weight = total(coherence).max(floor);
    if weight == 0.0 {
        return (0.0, 0.0);
    }
    let along = |axis: usize| {
        coherence.iter().zip(&NOMINAL_VELOCITIES).map(|(c, v)| c * v[axis]).sum::<f64>() / weight
    };
    (along(0), along(1))
}

/// The whole-pixel shift nearest to `shift + rest`, held to a quarter of the frame.
pub(crate) fn rounded_shift(
    shift: (i32, i32),
    rest: (f64, f64),
    (width, height): (usize, usize),
) -> (i32, i32) {
    let round = |whole: i32, rest: f64, side: usize| {
        let most = (side / MAX_SHIFT_SHARE) as i32;
        (whole + rest.round() as i32).clamp(-most, most)
    };
    (round(shift.0, rest.0, width), round(shift.1, rest.1, height))
}

/// What may vote for the cells on level `k` (from 0) of `width` x `height` pixels after the older frame was moved by
/// `shift` full-resolution px: not where its content came from outside or was blurred with it.
///
/// design notes on vision, section 2 item 6 takes a margin of 2 level px, which is exact for the binomial kernel; the
/// Gaussian of radius 6 needs 6.
pub(crate) fn voting_region(
    shift: (i32, i32),
    smoothing: Smoothing,
    k: usize,
    (width, height): (usize, usize),
) -> Region {
    let margin = match smoothing {
        Smoothing::Binomial => 2,
        Smoothing::Gaussian => 6,
    };
    let axis = |shift: i32, side: usize| {
        let lost = |px: i32| if px > 0 { (px as usize).div_ceil(2 << k) + margin } else { 0 };
        let end = (side - 1).min(side.saturating_sub(lost(-shift)));
        (lost(shift).min(end), end)
    };
    Region { columns: axis(shift.0, width), rows: axis(shift.1, height) }
}
