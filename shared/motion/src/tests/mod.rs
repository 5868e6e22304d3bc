//! Tests of the detector: the golden cases G1..G10 of design notes on vision, section 3; a scalar oracle;
//! properties; robust mode against analytic scenes, and its parts one by one; the life of tracks.

mod bright_blob;
mod golden;
mod oracle;
mod properties;
mod robust;
mod robust_evidence;
mod robust_parts;
mod robust_properties;
mod robustness;
mod segmentation;
mod tracker;
mod waves;

use crate::*;

/// A seeded source of random numbers (SplitMix64).
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// 0..1
    pub(crate) fn uniform(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Mean 0, variance 1 (Irwin-Hall).
    pub(crate) fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }
}

/// An image that owns its pixels, rows without gaps.
#[derive(Clone)]
pub(crate) struct Picture {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) pixels: Vec<u8>,
}

impl Picture {
    pub(crate) fn new(width: usize, height: usize, grey: impl FnMut(usize, usize) -> f64) -> Picture {
        let mut grey = grey;
        let pixels =
            (0..width * height).map(|i| grey(i % width, i / width).round().clamp(0.0, 255.0) as u8).collect();
        Picture { width, height, pixels }
    }

    pub(crate) fn image(&self) -> Image<'_> {
        Image::new(&self.pixels, self.width, self.height, self.width).unwrap()
    }
}

/// A plane of Gaussian-blurred noise (sigma px), mean 128, standard deviation `rms`; it repeats itself.
pub(crate) struct Texture {
    side: usize,
    grey: Vec<f64>,
}

impl Texture {
    pub(crate) fn new(side: usize, sigma: f64, rms: f64, seed: u64) -> Texture {
        let mut random = Random(seed);
        let mut grey: Vec<f64> = (0..side * side).map(|_| random.normal()).collect();
        let radius = (4.0 * sigma) as i64;
        let kernel: Vec<f64> =
            (-radius..=radius).map(|x| (-(x * x) as f64 / (2.0 * sigma * sigma)).exp()).collect();
        for step in [1, side] {
            grey = (0..side * side)
                .map(|i| {
                    let at = |tap: usize| {
                        let along = (i / step % side + side + tap - radius as usize) % side;
                        i - i / step % side * step + along * step
                    };
                    kernel.iter().enumerate().map(|(tap, weight)| weight * grey[at(tap)]).sum()
                })
                .collect();
        }
        let n = grey.len() as f64;
        let mean = grey.iter().sum::<f64>() / n;
        let spread = (grey.iter().map(|g| (g - mean).powi(2)).sum::<f64>() / n).sqrt();
        for g in &mut grey {
            *g = 128.0 + rms * (*g - mean) / spread;
        }
        Texture { side, grey }
    }

    /// A sum of blurred noises whose amplitude grows with their scale: like a natural scene.
    pub(crate) fn natural(side: usize, rms: f64, seed: u64) -> Texture {
        let mut sum = Texture { side, grey: vec![128.0; side * side] };
        for (octave, sigma) in [1.0, 2.0, 4.0, 8.0].into_iter().enumerate() {
            let part = Texture::new(side, sigma, rms / 2.0, seed + octave as u64);
            sum.grey.iter_mut().zip(part.grey).for_each(|(sum, grey)| *sum += grey - 128.0);
        }
        sum
    }

    pub(crate) fn at(&self, x: i64, y: i64) -> f64 {
        let side = self.side as i64;
        self.grey[(y.rem_euclid(side) * side + x.rem_euclid(side)) as usize]
    }

    /// A window of the plane whose content is moved by (u, v).
    pub(crate) fn moved(&self, width: usize, height: usize, (u, v): (i64, i64)) -> Picture {
        Picture::new(width, height, |x, y| self.at(x as i64 - u, y as i64 - v))
    }

    /// As [`Texture::moved`], with a disc cut from another place of the same texture, whose centre is at
    /// `centre` and which moves by `target` px per step.
    pub(crate) fn with_disc(&self, size: (usize, usize), background: (i64, i64), disc: Disc) -> Picture {
        Picture::new(size.0, size.1, |x, y| {
            let (x, y) = (x as i64, y as i64);
            let (dx, dy) = (x - disc.centre.0, y - disc.centre.1);
            if 4 * (dx * dx + dy * dy) < disc.side * disc.side * 4 / 3 {
                self.at(dx + 333, dy + 111)
            } else {
                self.at(x - background.0, y - background.1)
            }
        })
    }
}

/// A disc of about the area of a square of `side` px.
#[derive(Clone, Copy)]
pub(crate) struct Disc {
    pub(crate) centre: (i64, i64),
    pub(crate) side: i64,
}

pub(crate) fn no_fields() -> Box<Fields> {
    vec![[0.0; MAX_CELLS]; FIELDS].try_into().unwrap()
}

/// Vote fields of a pair, from a fresh engine.
pub(crate) fn vote(older: &Picture, newer: &Picture, parameters: &Parameters) -> (Box<Fields>, VoteSummary) {
    let mut fields = no_fields();
    let mut engine = VoteEngine::new(newer.width, newer.height, parameters).unwrap();
    let summary = engine.vote(Older::Frame(older.image()), newer.image(), &mut fields, &mut NoProbe);
    (fields, summary)
}

pub(crate) fn detect(older: &Picture, newer: &Picture, parameters: &Parameters) -> Segmentation {
    let (fields, summary) = vote(older, newer, parameters);
    segment(&fields, &summary, parameters, &mut SegmentScratch::new())
}

/// Every used value of all fields.
pub(crate) fn used<'a>(fields: &'a Fields, summary: &VoteSummary) -> impl Iterator<Item = f32> + 'a {
    let cells = summary.columns * summary.rows;
    fields.iter().flat_map(move |field| field[..cells].iter().copied())
}
