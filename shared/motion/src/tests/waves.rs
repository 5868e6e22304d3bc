//! Pictures whose grey level is known at every real coordinate, so that the oracle of a motion is not a warp
//! of ours; and what every answer of the robust detector must fulfil.

use super::*;
use crate::robust::model::COEFFICIENTS;

/// A sum of sinusoids of 6 to 100 px in random directions, as strong in each octave: a scene with structure
/// of all sizes, but with no pixels of its own.
pub(crate) struct Waves {
    /// Wave vector, phase.
    waves: Vec<([f64; 2], f64)>,
    amplitude: f64,
}

impl Waves {
    const COUNT: usize = 40;

    pub(crate) fn new(rms: f64, seed: u64) -> Waves {
        let mut random = Random(seed);
        let waves = (0..Waves::COUNT)
            .map(|i| {
                let wavelength = 6.0 * (100.0f64 / 6.0).powf((i as f64 + 0.5) / Waves::COUNT as f64);
                let (turn, phase) = (std::f64::consts::TAU * random.uniform(), 6.3 * random.uniform());
                let k = std::f64::consts::TAU / wavelength;
                ([k * turn.cos(), k * turn.sin()], phase)
            })
            .collect();
        Waves { waves, amplitude: rms * (2.0 / Waves::COUNT as f64).sqrt() }
    }

    /// Deviation from the mean at any place, grey levels.
    pub(crate) fn at(&self, x: f64, y: f64) -> f64 {
        let sum: f64 = self.waves.iter().map(|([kx, ky], phase)| (kx * x + ky * y + phase).sin()).sum();
        self.amplitude * sum
    }
}

/// A disc of its own texture.
#[derive(Clone, Copy)]
pub(crate) struct Spot {
    pub(crate) centre: [f64; 2],
    pub(crate) radius: f64,
    /// From x to y, rad.
    pub(crate) turn: f64,
}

/// What a frame is made of.
#[derive(Clone, Copy)]
pub(crate) struct Shot {
    pub(crate) size: (usize, usize),
    /// Background: u and v at the normalised place (x, y), as [`GlobalMotion`] documents it.
    pub(crate) flow: [f64; COEFFICIENTS],
    pub(crate) spot: Option<Spot>,
    /// Standard deviation of the noise, grey levels, and its seed.
    pub(crate) noise: (f64, u64),
}

impl Shot {
    /// The scene as it stands.
    pub(crate) fn still(width: usize, height: usize) -> Shot {
        Shot { size: (width, height), flow: [0.0; COEFFICIENTS], spot: None, noise: (0.0, 0) }
    }

    pub(crate) fn panned(self, u: f64, v: f64) -> Shot {
        let mut flow = self.flow;
        (flow[0], flow[3]) = (u, v);
        Shot { flow, ..self }
    }

    pub(crate) fn with_spot(self, u: f64, v: f64, radius: f64) -> Shot {
        Shot { spot: Some(Spot { centre: [u, v], radius, turn: 0.0 }), ..self }
    }

    /// Its spot turned by this, rad.
    pub(crate) fn turned(self, turn: f64) -> Shot {
        Shot { spot: self.spot.map(|spot| Spot { turn, ..spot }), ..self }
    }

    /// The background's displacement that ends at (u, v), from the documented formula.
    pub(crate) fn displacement(&self, u: f64, v: f64) -> (f64, f64) {
        let (width, height) = (self.size.0 as f64, self.size.1 as f64);
        let half = width.max(height) / 2.0;
        let (x, y) = ((u - (width - 1.0) / 2.0) / half, (v - (height - 1.0) / 2.0) / half);
        let a = &self.flow;
        let u = a[0] + a[1] * x + a[2] * y + a[6] * x * x + a[7] * x * y;
        let v = a[3] + a[4] * x + a[5] * y + a[6] * x * y + a[7] * y * y;
        (u, v)
    }

    /// The frame; `light` multiplies the grey at each place.
    pub(crate) fn lit(&self, waves: &Waves, light: impl Fn(f64, f64) -> f64) -> Picture {
        let mut random = Random(self.noise.1);
        Picture::new(self.size.0, self.size.1, |x, y| {
            let (x, y) = (x as f64, y as f64);
            let (u, v) = self.displacement(x, y);
            let mut grey = waves.at(x - u, y - v);
            if let Some(Spot { centre: [cu, cv], radius, turn }) = self.spot {
                let (dx, dy) = (x - cu, y - cv);
                // The edge pixels are shared.
                let cover = (radius - dx.hypot(dy) + 0.5).clamp(0.0, 1.0);
                if cover > 0.0 {
                    let (sin, cos) = turn.sin_cos();
                    let (dx, dy) = (cos * dx + sin * dy, cos * dy - sin * dx);
                    grey += cover * (waves.at(dx + 3333.3, dy - 777.7) - grey);
                }
            }
            let noise = if self.noise.0 > 0.0 { self.noise.0 * random.normal() } else { 0.0 };
            (110.0 + grey) * light(x, y) + noise
        })
    }

    pub(crate) fn taken(&self, waves: &Waves) -> Picture {
        self.lit(waves, |_, _| 1.0)
    }
}

/// The answer of a fresh robust engine.
pub(crate) fn find(older: &Picture, newer: &Picture) -> Findings {
    find_in(older.image(), newer.image())
}

pub(crate) fn find_in(older: Image<'_>, newer: Image<'_>) -> Findings {
    let parameters = RobustParameters::default();
    let mut engine = RobustEngine::new(newer.width(), newer.height(), &parameters).unwrap();
    engine.detect(Older::Frame(older), newer, &mut NoProbe)
}

/// How far outside of the frame a position may lie, px: the centroid is brought to the newer frame by half
/// of the motion.
const MARGIN: f64 = 16.0;

/// What is wrong with findings, if anything is.
pub(crate) fn fault(findings: &Findings, (width, height): (usize, usize)) -> Option<String> {
    if !findings.background.is_finite() || !findings.evidence.is_finite() || findings.evidence < 0.0 {
        return Some(format!("background or evidence {}", findings.evidence));
    }
    if findings.count > MAX_TARGETS {
        return Some(format!("{} candidates", findings.count));
    }
    if findings.outcome != Outcome::Answered && findings.count > 0 {
        return Some(format!("{:?} with {} candidates", findings.outcome, findings.count));
    }
    let candidates = &findings.candidates[..findings.count];
    for (i, c) in candidates.iter().enumerate() {
        let [uu, uv, vv] = c.position_covariance;
        let numbers = [
            c.u,
            c.v,
            c.vu,
            c.vv,
            c.relative[0],
            c.relative[1],
            c.area_px,
            c.confidence,
            uu,
            uv,
            vv,
            c.velocity_sd,
            c.evidence,
            c.votes_evidence,
            c.residual_evidence,
            c.rival,
            c.clutter,
            c.explained,
            c.spread[0],
            c.spread[1],
            c.spread[2],
        ];
        if let Some(place) = numbers.iter().position(|n| !n.is_finite()) {
            return Some(format!("number {place} of candidate {i} is {}", numbers[place]));
        }
        let inside = |x: f64, side: usize| (-MARGIN..side as f64 + MARGIN).contains(&x);
        if !inside(c.u, width) || !inside(c.v, height) {
            return Some(format!("candidate {i} at ({}, {})", c.u, c.v));
        }
        if !(0.0..=1.0).contains(&c.confidence) || !(0.0..=1.0).contains(&c.clutter) {
            return Some(format!("confidence {}, clutter {} of candidate {i}", c.confidence, c.clutter));
        }
        if uu <= 0.0 || vv <= 0.0 || uu * vv - uv * uv <= 0.0 || c.velocity_sd <= 0.0 {
            return Some(format!("covariance {:?} of candidate {i}", c.position_covariance));
        }
        if c.area_px <= 0.0 {
            return Some(format!("area {} of candidate {i}", c.area_px));
        }
        if candidates[..i].iter().any(|other| (other.u - c.u).hypot(other.v - c.v) < 1.0) {
            return Some(format!("candidate {i} once more at ({}, {})", c.u, c.v));
        }
    }
    None
}
