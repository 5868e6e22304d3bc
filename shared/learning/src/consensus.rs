//! Which sightings of one still thing agree with their neighbours in time.
//!
//! A wild detection poisons every pair it is part of, its input as well as its output, so that a robust
//! error alone does nothing: it has to go before views are paired (design notes on the learner, section
//! 4.3). This looks at a finished move from both sides, so that one wild sighting cannot pass the next
//! one off as wild.

use serde::{Deserialize, Serialize};

use crate::samples::View;

/// Neighbours on each side that have a say.
const REACH: usize = 2;
/// Pairs of neighbours that must foresee a sighting, where there are so many.
const SUPPORT: usize = 2;
/// How far a sighting may be from where two neighbours foresee it, in half widths of the image: what the
/// strongest acceleration of the default arm bends its way within two frames.
const TOLERANCE_HALF_WIDTHS: f64 = 0.05;
/// ...and beside that in ways from frame to frame.
const TOLERANCE_STEPS: f64 = 0.5;

/// A view and when it was.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Sighting {
    /// Exposure, ns.
    pub time_ns: u64,
    /// What was seen.
    pub view: View,
}

/// Keeps those sightings that are where pairs of their neighbours say they must be, on a straight way at
/// steady speed, and returns how many were dropped.
///
/// Twice: first one pair is enough, so that few good ones fall with the wild ones beside them; then, among
/// what is left, [`SUPPORT`] pairs, or as many as there are. With less than two neighbours nothing is
/// known and a sighting stays. `sightings` are in the order of time, all of one thing that does not move;
/// `half_width_px` is half of the image's width. No allocation.
pub fn keep_agreeing(sightings: &mut Vec<Sighting>, half_width_px: f64) -> usize {
    let all = sightings.len();
    for support in [1, SUPPORT] {
        // Neighbours that were looked at already count as they were: a small ring of them suffices.
        let mut before = [Sighting::default(); REACH];
        let (mut kept, count) = (0, sightings.len());
        for index in 0..count {
            let here = sightings[index];
            let last = (index + REACH).min(count - 1);
            let mut around = [Sighting::default(); 2 * REACH];
            let known = index.min(REACH);
            let after = last - index;
            around[..known].copy_from_slice(&before[REACH - known..]);
            around[known..known + after].copy_from_slice(&sightings[index + 1..=last]);
            before.rotate_left(1);
            before[REACH - 1] = here;
            if agrees(&around[..known + after], &here, support, half_width_px) {
                sightings[kept] = here;
                kept += 1;
            }
        }
        sightings.truncate(kept);
    }
    all - sightings.len()
}

fn agrees(around: &[Sighting], here: &Sighting, support: usize, half_width_px: f64) -> bool {
    let (mut pairs, mut foreseen) = (0, 0);
    for (index, a) in around.iter().enumerate() {
        for b in &around[index + 1..] {
            pairs += 1;
            foreseen += usize::from(foresee(a, b, here, half_width_px));
        }
    }
    foreseen >= support.min(pairs)
}

fn foresee(a: &Sighting, b: &Sighting, here: &Sighting, half_width_px: f64) -> bool {
    let span = b.time_ns.saturating_sub(a.time_ns) as f64;
    if span <= 0.0 {
        return false;
    }
    let share = (here.time_ns as f64 - a.time_ns as f64) / span;
    let steps = [here.time_ns.abs_diff(a.time_ns), here.time_ns.abs_diff(b.time_ns)];
    let nearest = steps[0].min(steps[1]) as f64 / span;
    let (from, to, seen) = (a.view.point_px, b.view.point_px, here.view.point_px);
    let off = [0, 1].map(|k| seen[k] - from[k] - share * (to[k] - from[k]));
    let way = (to[0] - from[0]).hypot(to[1] - from[1]);
    let tolerance = TOLERANCE_HALF_WIDTHS * half_width_px + TOLERANCE_STEPS * nearest * way;
    off[0].hypot(off[1]) <= tolerance
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    const HALF: f64 = 256.0;
    const FRAME_NS: u64 = 40_000_000;

    /// Rest, an accelerated move as the default arm makes it, rest.
    fn track() -> Vec<Sighting> {
        let way = |k: u64| match k {
            0..3 => 0.0,
            3..9 => 2.2 * ((k - 3) as f64).powi(2),
            9..15 => 79.2 + 22.0 * (k - 9) as f64,
            15..21 => 290.4 - 2.2 * ((21 - k) as f64).powi(2),
            _ => 290.4,
        };
        (0..25)
            .map(|k| Sighting {
                time_ns: 7 + k * FRAME_NS,
                view: View { point_px: [200.0 - way(k), 0.4 * way(k) - 60.0], ..View::default() },
            })
            .collect()
    }

    #[test]
    fn all_of_a_clean_move_agrees_also_where_frames_are_missing() {
        let mut clean = track();
        assert_eq!(keep_agreeing(&mut clean, HALF), 0);
        assert_eq!(clean, track());
        let mut thinned: Vec<Sighting> =
            clean.into_iter().enumerate().filter(|(k, _)| k % 5 != 2).map(|(_, s)| s).collect();
        assert_eq!(keep_agreeing(&mut thinned, HALF), 0);
    }

    #[test]
    fn wild_sightings_do_not_agree_and_hardly_spoil_the_others() {
        let mut rng = ChaCha8Rng::seed_from_u64(11);
        let (mut wild, mut wild_kept, mut good, mut good_kept) = (0.0, 0.0, 0.0, 0.0);
        let is_wild = |sighting: &Sighting| {
            let truth = track();
            let same = truth.iter().find(|t| t.time_ns == sighting.time_ns).unwrap().view.point_px;
            let seen = sighting.view.point_px;
            (seen[0] - same[0]).hypot(seen[1] - same[1]) > 0.2 * HALF
        };
        for _ in 0..400 {
            let mut seen = track();
            for sighting in &mut seen {
                if rng.random_range(0.0..1.0) < 0.15 {
                    sighting.view.point_px = [0, 1].map(|_| rng.random_range(-HALF..HALF));
                }
            }
            let count = |seen: &[Sighting]| seen.iter().filter(|s| is_wild(s)).count() as f64;
            (wild, good) = (wild + count(&seen), good + seen.len() as f64 - count(&seen));
            keep_agreeing(&mut seen, HALF);
            (wild_kept, good_kept) = (wild_kept + count(&seen), good_kept + seen.len() as f64 - count(&seen));
        }
        // A wild one that falls where its neighbours foresee a good one cannot be told: some 35 px around it
        // are 1.5 % of the image.
        assert!(wild_kept < 0.02 * wild, "{wild_kept} of {wild} wild ones kept");
        assert!(good_kept > 0.9 * good, "{good_kept} of {good} good ones kept");
    }

    #[test]
    fn a_lone_sighting_and_two_of_them_stay() {
        for count in [1, 2] {
            let mut few = track();
            few.truncate(count);
            assert_eq!(keep_agreeing(&mut few, HALF), 0);
        }
    }
}
