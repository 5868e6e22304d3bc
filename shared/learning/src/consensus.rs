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

/// Whether the sighting at `index` is where pairs of its neighbours say it must be, on a straight way at
/// steady speed: two pairs of them, or as many as there are. With less than two neighbours nothing is known
/// and it agrees.
///
/// `sightings` are in the order of time, all of one thing that does not move; `half_width_px` is half of
/// the image's width.
pub fn agrees(sightings: &[Sighting], index: usize, half_width_px: f64) -> bool {
    let here = &sightings[index];
    let first = index.saturating_sub(REACH);
    let last = (index + REACH).min(sightings.len() - 1);
    let (mut pairs, mut support) = (0, 0);
    for a in (first..=last).filter(|a| *a != index) {
        for b in (a + 1..=last).filter(|b| *b != index) {
            pairs += 1;
            support += usize::from(foresee(&sightings[a], &sightings[b], here, half_width_px));
        }
    }
    support >= SUPPORT.min(pairs)
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
                view: View { point_px: [200.0 - way(k), 0.4 * way(k) - 60.0], joints: [0.0; 2] },
            })
            .collect()
    }

    #[test]
    fn all_of_a_clean_move_agrees_also_where_frames_are_missing() {
        let clean = track();
        assert!((0..clean.len()).all(|k| agrees(&clean, k, HALF)));
        let thinned: Vec<Sighting> =
            clean.into_iter().enumerate().filter(|(k, _)| k % 5 != 2).map(|(_, s)| s).collect();
        assert!((0..thinned.len()).all(|k| agrees(&thinned, k, HALF)));
    }

    #[test]
    fn wild_sightings_do_not_agree_and_hardly_spoil_the_others() {
        let mut rng = ChaCha8Rng::seed_from_u64(11);
        let (mut wild, mut wild_kept, mut good, mut good_lost) = (0, 0, 0, 0);
        for _ in 0..400 {
            let truth = track();
            let mut seen = truth.clone();
            for sighting in &mut seen {
                if rng.random_range(0.0..1.0) < 0.15 {
                    sighting.view.point_px = [0, 1].map(|_| rng.random_range(-HALF..HALF));
                }
            }
            for (k, (is, was)) in seen.iter().zip(&truth).enumerate() {
                let off = [0, 1].map(|axis| is.view.point_px[axis] - was.view.point_px[axis]);
                let agreed = agrees(&seen, k, HALF);
                if off[0].hypot(off[1]) > 0.2 * HALF {
                    wild += 1;
                    wild_kept += u32::from(agreed);
                } else {
                    good += 1;
                    good_lost += u32::from(!agreed);
                }
            }
        }
        // A wild one that falls where its neighbours foresee a good one cannot be told: some 35 px around it
        // are 1.5 % of the image.
        assert!(f64::from(wild_kept) < 0.02 * f64::from(wild), "{wild_kept} of {wild} wild ones kept");
        assert!(f64::from(good_lost) < 0.15 * f64::from(good), "{good_lost} of {good} good ones lost");
    }

    #[test]
    fn a_lone_sighting_agrees_with_itself() {
        let one = [Sighting::default()];
        assert!(agrees(&one, 0, HALF) && agrees(&track()[..2], 1, HALF));
    }
}
