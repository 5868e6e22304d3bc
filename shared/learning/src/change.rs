//! Does what was learnt still hold? A knocked camera, another lens, a bent arm.
//!
//! A memory that keeps its coverage never forgets a world that is gone: it needs somebody who notices
//! (design notes on the learner, sections 4 and 4.3; not in the paper, whose memory forgets within seconds).

use serde::{Deserialize, Serialize};

use crate::network::Network;
use crate::samples::Sample;

/// A sample that moves the joints by less than this says too little, normalised units.
const MIN_MOTION: f64 = 0.06;
/// Fewer samples than this are no evidence.
const MIN_SAMPLES: usize = 6;
/// Samples of one move that are looked at.
pub const MOST_SAMPLES: usize = 256;
/// Motion beside which an error counts, so that tiny motions do not shout, normalised units.
const FLOOR: f64 = 0.05;
/// A move this surprising, and this many times as surprising as usual, is a change by itself...
const CLEAR: (f64, f64) = (0.25, 5.0);
/// ...one like this only with the next.
const SUSPICIOUS: (f64, f64) = (0.10, 2.2);
/// Share of the newest move in what is usual.
const GAIN: f64 = 0.3;
/// What is usual is not below this after a change that was made up for from a single move.
const AFTER_A_CHANGE: f64 = 0.08;
/// What is usual is never below this.
const LEAST_USUAL: f64 = 0.02;

/// What a move says about the world.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Verdict {
    /// It is as it was, or too little was seen.
    Same,
    /// It may have changed: the next move will tell.
    Suspicious,
    /// It has changed: what was learnt before holds no more.
    Changed,
}

/// Knows how well moves are usually foretold, and says when one is not.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ChangeDetector {
    usual: f64,
    suspicious: bool,
}

impl Default for ChangeDetector {
    /// Nothing was learnt: nothing is surprising.
    fn default() -> ChangeDetector {
        ChangeDetector { usual: 1.0, suspicious: false }
    }
}

impl ChangeDetector {
    /// Takes the [`surprise`] of a finished move.
    pub fn judge(&mut self, surprise: f64) -> Verdict {
        let beyond = |(least, times): (f64, f64)| surprise > f64::max(least, times * self.usual);
        if beyond(CLEAR) || (beyond(SUSPICIOUS) && self.suspicious) {
            *self = ChangeDetector::default();
            return Verdict::Changed;
        }
        self.suspicious = beyond(SUSPICIOUS);
        if self.suspicious {
            return Verdict::Suspicious;
        }
        self.usual = (1.0 - GAIN) * self.usual + GAIN * surprise.max(LEAST_USUAL);
        Verdict::Same
    }

    /// Whether the last move was in doubt.
    pub fn is_suspicious(&self) -> bool {
        self.suspicious
    }

    /// What was usual is so again, or nearly: a change was made up for.
    #[must_use]
    pub fn trusting(self) -> ChangeDetector {
        ChangeDetector { suspicious: false, usual: self.usual.max(AFTER_A_CHANGE) }
    }

    /// The surprise that is usual: 1 for who knows nothing, some hundredths for who has learnt.
    pub fn usual(&self) -> f64 {
        self.usual
    }
}

/// How badly `network` foretells the samples: the median over them of the error relative to the motion.
/// `None` where they are too few, or move the arm too little. Looks at [`MOST_SAMPLES`] at most.
pub fn surprise(network: &Network, samples: &[Sample]) -> Option<f64> {
    let mut errors = [0.0; MOST_SAMPLES];
    let telling = samples.iter().filter(|sample| length(sample.output) > MIN_MOTION);
    let mut count = 0;
    for (error, sample) in errors.iter_mut().zip(telling) {
        *error = relative_error(network, sample, FLOOR);
        count += 1;
    }
    if count < MIN_SAMPLES {
        return None;
    }
    let errors = &mut errors[..count];
    errors.sort_unstable_by(f64::total_cmp);
    Some(errors[count / 2])
}

/// |N(u) − o| / (|o| + floor).
pub(crate) fn relative_error(network: &Network, sample: &Sample, floor: f64) -> f64 {
    let said = network.predict(sample.input);
    let off = [said[0] - sample.output[0], said[1] - sample.output[1]];
    length(off) / (length(sample.output) + floor)
}

fn length([a, b]: [f64; 2]) -> f64 {
    a.hypot(b)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    fn learnt() -> ChangeDetector {
        let mut detector = ChangeDetector::default();
        for surprise in [0.9, 0.5, 0.2, 0.1, 0.05, 0.04, 0.03, 0.05, 0.03, 0.04, 0.03, 0.04] {
            assert_eq!(detector.judge(surprise), Verdict::Same);
        }
        detector
    }

    #[test]
    fn a_beginner_is_never_surprised() {
        assert_eq!(ChangeDetector::default().judge(2.0), Verdict::Same);
    }

    #[test]
    fn a_clear_change_is_seen_at_once_and_judging_begins_anew() {
        let mut detector = learnt();
        assert_eq!(detector.judge(0.5), Verdict::Changed);
        assert_eq!(detector, ChangeDetector::default());
    }

    #[test]
    fn a_doubtful_move_needs_a_second_in_a_row() {
        let mut detector = learnt();
        let usual = detector.usual();
        assert_eq!(detector.judge(0.2), Verdict::Suspicious);
        assert_eq!(detector.judge(0.04), Verdict::Same);
        assert_eq!(detector.judge(0.2), Verdict::Suspicious);
        assert!((detector.usual() - usual).abs() < 0.02, "what is doubtful does not become usual");
        assert_eq!(detector.judge(0.2), Verdict::Changed);
    }

    #[test]
    fn the_surprise_is_the_median_error_relative_to_the_motion() {
        let network = Network::random(&mut ChaCha8Rng::seed_from_u64(1), true);
        let sample = |k: u32, factor: f64| {
            let input = [0.1 * f64::from(k + 2), -0.4, 0.2];
            let said = network.predict(input);
            Sample { input, output: [said[0] / factor, said[1] / factor], ..Sample::default() }
        };
        // A network that says `factor` times what is true is wrong by |factor − 1| (and the floor).
        let mut samples: Vec<Sample> = (0..9).map(|k| sample(k, 1.5)).collect();
        samples[0].output = [9.0, 9.0];
        let found = surprise(&network, &samples).unwrap();
        let expected = 0.5 * length(samples[5].output) / (length(samples[5].output) + FLOOR);
        assert!((found - expected).abs() < 0.15 * expected, "{found} for about {expected}");
        assert_eq!(surprise(&network, &samples[..5]), None, "too few");
        samples.iter_mut().for_each(|sample| sample.output = [0.01, 0.0]);
        assert_eq!(surprise(&network, &samples), None, "too little motion");
    }
}
