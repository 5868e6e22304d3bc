//! How often which duration came: log-linear buckets, a fixed 16 kB, no value further off than 1.6 %.

/// Buckets of each power of two.
const PER_OCTAVE: u64 = 64;
const OCTAVE_BITS: u32 = PER_OCTAVE.trailing_zeros();
/// Powers of two above the exact range: up to 2^37 ns, 137 s; what is longer is in the last bucket.
const OCTAVES: u64 = 32;
const BUCKETS: usize = (PER_OCTAVE * OCTAVES) as usize;

/// Durations in ns.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Histogram {
    counts: Vec<u64>,
    total: u64,
    sum_ns: u64,
    max_ns: u64,
}

impl Default for Histogram {
    fn default() -> Histogram {
        Histogram { counts: vec![0; BUCKETS], total: 0, sum_ns: 0, max_ns: 0 }
    }
}

impl Histogram {
    /// Counts a duration.
    pub fn take(&mut self, ns: u64) {
        self.counts[bucket(ns)] += 1;
        self.total += 1;
        self.sum_ns = self.sum_ns.saturating_add(ns);
        self.max_ns = self.max_ns.max(ns);
    }

    /// How many were counted.
    pub fn total(&self) -> u64 {
        self.total
    }

    /// Sum of all, ns.
    pub fn sum_ns(&self) -> u64 {
        self.sum_ns
    }

    /// The longest, ns; exact.
    pub fn max_ns(&self) -> u64 {
        self.max_ns
    }

    /// The duration that the share `share` (0..1) does not exceed, ns; 0 where nothing was counted.
    pub fn quantile_ns(&self, share: f64) -> u64 {
        let wanted = ((share * self.total as f64).ceil() as u64).clamp(1, self.total.max(1));
        let mut seen = 0;
        for (number, count) in self.counts.iter().enumerate() {
            seen += count;
            if seen >= wanted {
                return upper_end(number).min(self.max_ns);
            }
        }
        self.max_ns
    }
}

fn bucket(ns: u64) -> usize {
    if ns < PER_OCTAVE {
        return ns as usize;
    }
    let octave = ns.ilog2() - OCTAVE_BITS;
    let number = u64::from(octave + 1) * PER_OCTAVE + ((ns >> octave) - PER_OCTAVE);
    (number as usize).min(BUCKETS - 1)
}

/// The largest duration of a bucket, ns.
fn upper_end(number: usize) -> u64 {
    let (octave, place) = (number as u64 / PER_OCTAVE, number as u64 % PER_OCTAVE);
    if octave == 0 { place } else { ((PER_OCTAVE + place + 1) << (octave - 1)) - 1 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_those_of_the_sorted_durations_within_their_error() {
        let durations: Vec<u64> = (1..=10_000_u64).map(|k| k * k * 37).collect();
        let mut histogram = Histogram::default();
        durations.iter().rev().for_each(|ns| histogram.take(*ns));
        for share in [0.01, 0.5, 0.9, 0.99, 0.999, 1.0] {
            let exact = durations[(share * 10_000.0_f64).ceil() as usize - 1] as f64;
            let said = histogram.quantile_ns(share) as f64;
            assert!((exact..exact * 1.016).contains(&said), "{share}: {said} for {exact}");
        }
        assert_eq!(histogram.max_ns(), 37 * 100_000_000);
        assert_eq!(Histogram::default().quantile_ns(0.5), 0);
    }

    #[test]
    fn absurd_durations_are_counted_too() {
        let mut histogram = Histogram::default();
        [0, 63, 64, u64::MAX].iter().for_each(|ns| histogram.take(*ns));
        assert_eq!((histogram.total(), histogram.quantile_ns(0.25)), (4, 0));
        assert_eq!(histogram.max_ns(), u64::MAX);
    }
}
