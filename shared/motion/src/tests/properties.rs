//! Exact symmetries of the votes (G4, G5, G8 of design notes on vision, section 3) on random levels.

use proptest::prelude::*;

use super::*;
use crate::cells::{Grid, LevelPlan};
use crate::pyramid::{LEVELS, Level};
use crate::votes::{DIRECTIONS, LevelSums, Region, SweepScratch, sweep};

/// Sums of votes of a whole pair of levels, and its fields of cells.
fn vote_levels(older: &Level, newer: &Level) -> (LevelSums, Vec<[f32; MAX_CELLS]>) {
    let (width, height) = (newer.width, newer.height);
    let grid = Grid::new(2 * width, 2 * height);
    let plan = &LevelPlan::all(&grid, [(width, height); LEVELS])[0];
    let mut scratch = SweepScratch::new(width, grid.rows);
    let mut fields = vec![[0.0; MAX_CELLS]; DIRECTIONS];
    let region = Region { columns: (0, width - 1), rows: (0, height - 1) };
    (sweep((older, newer), region, plan, &mut scratch, &mut fields), fields)
}

fn map(level: &Level, width: usize, height: usize, from: impl Fn(usize, usize) -> (usize, usize)) -> Level {
    let mut out = Level::new(width, height);
    for y in 0..height {
        for x in 0..width {
            let (fx, fy) = from(x, y);
            out.values[y * out.stride + x] = level.values[fy * level.stride + fx];
        }
    }
    out
}

/// A pair of levels with values 0..=`most`; the newer is the older moved, with some noise.
fn pair(most: i16) -> impl Strategy<Value = (Level, Level)> {
    (32..70usize, 32..70usize, any::<u64>(), 0..4usize, 0..4usize).prop_map(
        move |(width, height, seed, u, v)| {
            let mut random = Random(seed);
            let texture = Texture::new(64, 1.5, 1.0, seed);
            let mut value = |x: usize, y: usize| {
                let grey = (texture.at(x as i64, y as i64) - 128.0) / 4.0 + 0.5;
                let grey = (grey + 0.02 * random.normal()).clamp(0.0, 1.0);
                (grey * f64::from(most)).round() as i16
            };
            let (mut older, mut newer) = (Level::new(width, height), Level::new(width, height));
            for y in 0..height {
                for x in 0..width {
                    older.values[y * older.stride + x] = value(x + u, y + v);
                    newer.values[y * newer.stride + x] = value(x, y);
                }
            }
            (older, newer)
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    #[test]
    fn identical_levels_vote_exactly_nothing((level, _) in pair(4080)) {
        let (sums, fields) = vote_levels(&level, &level);
        prop_assert_eq!(sums.votes, [0; DIRECTIONS]);
        prop_assert!(fields.iter().flatten().all(|&vote| vote == 0.0));
    }

    #[test]
    fn swapped_frames_swap_every_sign((older, newer) in pair(4080)) {
        let (forward, there) = vote_levels(&older, &newer);
        let (backward, back) = vote_levels(&newer, &older);
        prop_assert_eq!(forward.norms, backward.norms);
        prop_assert_eq!(forward.votes, backward.votes.map(|votes| -votes));
        prop_assert!(there.iter().flatten().zip(back.iter().flatten()).all(|(a, b)| *a == -b));
        prop_assert!(forward.votes.iter().any(|&votes| votes != 0));
    }

    #[test]
    fn a_mirror_swaps_the_diagonals_and_turns_x((older, newer) in pair(4080)) {
        let mirror = |level: &Level| {
            let (width, height) = (level.width, level.height);
            map(level, width, height, |x, y| (width - 1 - x, y))
        };
        let (plain, _) = vote_levels(&older, &newer);
        let (mirrored, _) = vote_levels(&mirror(&older), &mirror(&newer));
        let [first, second, x, y] = plain.votes;
        prop_assert_eq!(mirrored.votes, [-second, -first, -x, y]);
    }

    #[test]
    fn a_transpose_swaps_x_and_y((older, newer) in pair(4080)) {
        let transpose = |level: &Level| map(level, level.height, level.width, |x, y| (y, x));
        let (plain, _) = vote_levels(&older, &newer);
        let (transposed, _) = vote_levels(&transpose(&older), &transpose(&newer));
        let [first, second, x, y] = plain.votes;
        prop_assert_eq!(transposed.votes, [-first, second, y, x]);
    }

    /// Up to derivatives of 1392/64 grey levels the 16-bit comparison is exact; the diagonals' weights
    /// are rounded, so theirs double only nearly.
    #[test]
    fn twice_the_contrast_is_twice_the_vote((older, newer) in pair(170)) {
        let twice = |level: &Level| {
            let mut level = level.clone();
            level.values.iter_mut().for_each(|value| *value *= 2);
            level
        };
        let (plain, _) = vote_levels(&older, &newer);
        let (doubled, _) = vote_levels(&twice(&older), &twice(&newer));
        prop_assert_eq!(doubled.norms, plain.norms.map(|norm| 2 * norm));
        prop_assert_eq!(&doubled.votes[2..], &[2 * plain.votes[2], 2 * plain.votes[3]][..]);
        for d in 0..2 {
            let rounding = (older.width * older.height) as i64;
            prop_assert!((doubled.votes[d] - 2 * plain.votes[d]).abs() <= rounding);
        }
    }

    /// The widest values there can be must not overflow 16 bits: the sums are those of plain integers.
    #[test]
    fn extreme_contrast_does_not_overflow(seed in any::<u64>()) {
        let mut random = Random(seed);
        let side = 33;
        let (mut older, mut newer) = (Level::new(side, side), Level::new(side, side));
        // Runs of black and white, moved by whole pixels: strong votes in every column.
        let stripe = 1 + random.next() % 6;
        for y in 0..side {
            for x in 0..side {
                let on = |i: u64| (i / stripe).is_multiple_of(2);
                let (a, b) = (on(x as u64 + y as u64 * (seed % 3)), on(x as u64 + 1 + y as u64 * (seed % 3)));
                older.values[y * older.stride + x] = if a { 4080 } else { 0 };
                newer.values[y * newer.stride + x] = if b { 4080 } else { 0 };
            }
        }
        let (fast, _) = vote_levels(&older, &newer);
        prop_assert_eq!(fast.votes, oracle::whole_sums(&older, &newer));
    }
}
