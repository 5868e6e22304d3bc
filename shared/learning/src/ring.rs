//! The paper's "short time memory" of 100 samples.

use serde::{Deserialize, Serialize};

use crate::reframe::Frame;
use crate::samples::Sample;
use crate::settings::Retention;

/// A bounded set of samples, oldest first.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Ring {
    samples: Vec<Sample>,
    capacity: u32,
    retention: Retention,
}

impl Ring {
    /// An empty ring.
    ///
    /// # Panics
    /// If `capacity` is 0.
    pub fn new(capacity: u32, retention: Retention) -> Ring {
        assert!(capacity > 0, "a ring of samples needs room for at least one");
        // One place more: a full ring chooses among all it has and the new one.
        Ring { samples: Vec::with_capacity(capacity as usize + 1), capacity, retention }
    }

    /// Takes the sample in; a full ring gives one up, which may not be the newest.
    pub fn admit(&mut self, sample: Sample) {
        self.samples.push(sample);
        if self.samples.len() > self.capacity as usize {
            // The paper forgets the oldest. With 10 samples a move that is a memory of a few seconds,
            // all in one corner of the workspace; giving up twins keeps the corners (design, section 4).
            let victim = match self.retention {
                Retention::Fifo => 0,
                Retention::Coverage => self.older_of_closest_pair(),
            };
            self.samples.remove(victim);
        }
    }

    /// Brings the samples up to the one numbered `last` into another frame of the image.
    pub fn reframe(&mut self, frame: Frame, last: u64) {
        for sample in self.samples.iter_mut().filter(|sample| sample.sequence <= last) {
            *sample = frame.of_sample(sample);
        }
    }

    /// Takes all samples as they were with joints of `seconds` later.
    pub fn retime(&mut self, seconds: f64) {
        for sample in &mut self.samples {
            *sample = sample.later(seconds);
        }
    }

    /// Forgets the samples after the one numbered `last`.
    pub fn forget_after(&mut self, last: u64) {
        self.samples.retain(|sample| sample.sequence <= last);
    }

    /// All samples, oldest first.
    pub fn samples(&self) -> &[Sample] {
        &self.samples
    }

    fn older_of_closest_pair(&self) -> usize {
        let mut older = 0;
        let mut closest = f64::INFINITY;
        for (index, sample) in self.samples.iter().enumerate() {
            for other in &self.samples[index + 1..] {
                let distance = squared_distance(&sample.input, &other.input);
                if distance < closest {
                    (closest, older) = (distance, index);
                }
            }
        }
        older
    }
}

fn squared_distance(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn sample(x: f64, sequence: u64) -> Sample {
        Sample { input: [x, 0.0, 0.0], sequence, ..Sample::default() }
    }

    proptest! {
        #[test]
        fn it_never_holds_more_than_its_capacity_and_stays_in_order(
            xs in prop::collection::vec(-1.0..1.0f64, 0..60), capacity in 1u32..20, fifo: bool,
        ) {
            let retention = if fifo { Retention::Fifo } else { Retention::Coverage };
            let mut ring = Ring::new(capacity, retention);
            for (index, x) in xs.iter().enumerate() {
                ring.admit(sample(*x, index as u64));
                prop_assert_eq!(ring.samples().len(), (index + 1).min(capacity as usize));
                prop_assert!(ring.samples().is_sorted_by_key(|s| s.sequence));
            }
            if fifo {
                let expected = xs.len().saturating_sub(capacity as usize);
                prop_assert_eq!(ring.samples().first().map_or(expected as u64, |s| s.sequence), expected as u64);
            }
        }
    }

    #[test]
    fn a_duplicate_evicts_its_older_twin() {
        let mut ring = Ring::new(3, Retention::Coverage);
        for (x, sequence) in [(0.0, 1), (0.5, 2), (1.0, 3), (0.5, 4)] {
            ring.admit(sample(x, sequence));
        }
        let left: Vec<u64> = ring.samples().iter().map(|s| s.sequence).collect();
        assert_eq!(left, [1, 3, 4]);
    }

    #[test]
    fn order_and_ages_survive_saving() {
        let mut ring = Ring::new(3, Retention::Coverage);
        for (x, sequence) in [(0.1, 1), (0.9, 2), (0.4, 3), (0.95, 4)] {
            ring.admit(sample(x, sequence));
        }
        let bytes = postcard::to_stdvec(&ring).unwrap();
        assert_eq!(postcard::from_bytes::<Ring>(&bytes).unwrap(), ring);
    }
}
