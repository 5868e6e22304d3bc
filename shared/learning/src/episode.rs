//! The views of one target: what a new view can be paired with.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use crate::samples::{Normalisation, Sample, View};
use crate::settings::{Pairing, Settings};

/// Most samples that one view yields: three pairs in both directions.
pub const MAX_SAMPLES_PER_VIEW: usize = 6;
/// The first of them are of two views of the same move.
pub const SAMPLES_WITHIN_MOVE: usize = 4;
/// Views of one move that are kept: 5 s at 25 Hz, longer than any move.
const MOVE_VIEWS: usize = 128;
/// Views of earlier moves to the same target that are kept.
const EARLIER_VIEWS: usize = 4 * MOVE_VIEWS;

/// All that was seen of one target since it appeared. A pair never spans two targets.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Episode {
    /// The arm at rest before the move; `None` where the target was not seen then.
    start: Option<View>,
    /// The move under way, oldest first.
    current: Vec<View>,
    /// The moves before.
    earlier: Vec<View>,
}

impl Default for Episode {
    fn default() -> Episode {
        Episode {
            start: None,
            current: Vec::with_capacity(MOVE_VIEWS),
            earlier: Vec::with_capacity(EARLIER_VIEWS),
        }
    }
}

impl Episode {
    /// Another target is there: forgets all views.
    pub fn start_target(&mut self) {
        self.start = None;
        self.current.clear();
        self.earlier.clear();
    }

    /// A move begins; `start` is what was seen at rest before it.
    pub fn start_move(&mut self, start: Option<View>) {
        self.end_move();
        self.start = start;
        self.current.extend(start);
    }

    /// The move is over: its views can be paired with those of the next.
    pub fn end_move(&mut self) {
        let room = EARLIER_VIEWS - self.earlier.len();
        self.earlier.extend(self.current.drain(..).take(room));
        self.start = None;
    }

    /// The move under way counts as never made.
    pub fn discard_move(&mut self) {
        self.current.clear();
        self.start = None;
    }

    /// Takes the joints of all views as they were `seconds` later.
    pub fn retime(&mut self, seconds: f64) {
        for view in self.start.iter_mut().chain(&mut self.current).chain(&mut self.earlier) {
            *view = view.later(seconds);
        }
    }

    /// Forgets the moves before the one under way.
    pub fn forget_earlier(&mut self) {
        self.earlier.clear();
    }

    /// Pairs the view with earlier ones and takes it in. No allocation.
    pub fn observe(
        &mut self,
        view: View,
        normalisation: &Normalisation,
        settings: &Settings,
        rng: &mut ChaCha8Rng,
    ) -> [Option<Sample>; MAX_SAMPLES_PER_VIEW] {
        let partners = match settings.pairing {
            Pairing::Consecutive => [self.current.last().copied(), None, None],
            // A sample of two frames in a row teaches only tiny displacements; long baselines teach
            // the moves that are asked for later.
            Pairing::LongBaseline => {
                let later = if self.current.len() > 2 { any_of(&self.current, rng) } else { None };
                [self.start, later, any_of(&self.earlier, rng)]
            }
        };
        let mut samples = [None; MAX_SAMPLES_PER_VIEW];
        for (pair, partner) in samples.as_chunks_mut::<2>().0.iter_mut().zip(partners) {
            let Some(partner) = partner else { continue };
            let teach = |first, second| {
                normalisation.sample(first, second, settings.rotation_sign, settings.min_motion_rad)
            };
            pair[0] = teach(&partner, &view);
            // The motion back is as true as the motion there (not in the paper).
            if settings.pairing == Pairing::LongBaseline {
                pair[1] = teach(&view, &partner);
            }
        }
        if self.current.len() < MOVE_VIEWS {
            self.current.push(view);
        }
        samples
    }
}

fn any_of(views: &[View], rng: &mut ChaCha8Rng) -> Option<View> {
    if views.is_empty() { None } else { Some(views[rng.random_range(0..views.len())]) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    const NORMALISATION: Normalisation = Normalisation { half_width_px: 256.0 };

    fn view(step: u32) -> View {
        let angle = 0.05 * f64::from(step);
        View { point_px: [100.0 * angle, 0.0], joints: [angle, 0.6], ..View::default() }
    }

    fn count(samples: [Option<Sample>; MAX_SAMPLES_PER_VIEW]) -> usize {
        samples.iter().flatten().count()
    }

    #[test]
    fn a_view_pairs_with_the_start_the_move_and_earlier_moves_in_both_directions() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut episode = Episode::default();
        let mut observe = |episode: &mut Episode, step| {
            count(episode.observe(view(step), &NORMALISATION, &Settings::recommended(), &mut rng))
        };
        episode.start_move(Some(view(0)));
        assert_eq!([1, 2, 3, 4].map(|step| observe(&mut episode, step)), [2, 2, 4, 4]);
        episode.start_move(Some(view(5)));
        assert_eq!([6, 7, 8].map(|step| observe(&mut episode, step)), [4, 4, 6]);
        episode.start_target();
        episode.start_move(None);
        assert_eq!(observe(&mut episode, 9), 0);
    }

    #[test]
    fn the_papers_samples_are_frames_in_a_row_forwards_only() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut episode = Episode::default();
        episode.start_move(Some(view(0)));
        episode.observe(view(1), &NORMALISATION, &Settings::paper(), &mut rng);
        let samples = episode.observe(view(3), &NORMALISATION, &Settings::paper(), &mut rng);
        assert_eq!(count(samples), 1);
        assert!((samples[0].unwrap().output[0] - 0.1 / 0.5).abs() < 1e-12);
    }

    #[test]
    fn endless_moves_do_not_grow_it() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut episode = Episode::default();
        for _ in 0..10 {
            episode.start_move(Some(view(0)));
            for step in 0..1000 {
                episode.observe(view(step % 7), &NORMALISATION, &Settings::recommended(), &mut rng);
            }
        }
        assert!(episode.current.len() <= MOVE_VIEWS && episode.earlier.len() <= EARLIER_VIEWS);
        assert!(episode.current.capacity() == MOVE_VIEWS && episode.earlier.capacity() == EARLIER_VIEWS);
    }
}
