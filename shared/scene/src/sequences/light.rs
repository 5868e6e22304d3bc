//! Light that changes from frame to frame: gain, shadow, uneven light. Noise and bytes are the sensor's.

use std::f64::consts::TAU;

use crate::photometry::Photometry;
use crate::random::Random;

use super::scenario::Scenario;

/// Frames in a period of the gain's drift.
const DRIFT_FRAMES: f64 = 20.0;
/// However the random numbers fall, so much of the light remains.
const LEAST_LIGHT: f64 = 0.1;
/// The shadow's band across its direction of motion, in widths of the frame: place at frame 0, width, softness.
const SHADOW_FROM: f64 = 0.2;
const SHADOW_WIDTH: f64 = 0.35;
const SHADOW_SOFTNESS: f64 = 0.02;
/// Direction in which the shadow moves.
const SHADOW_DIRECTION: [f64; 2] = [0.8, 0.6];
/// Nodes each way of uneven light.
const NODES: usize = 3;

/// Light and sensor of a sequence.
pub(super) struct Light {
    scenario: Scenario,
    size: usize,
    seed: u64,
    stream: u64,
    flicker: Vec<f64>,
    sensor: Photometry,
    /// Weights of the nodes of uneven light for each column; the same for rows.
    weights: Vec<[f32; NODES]>,
}

/// The light on one frame.
pub(super) struct FrameLight {
    t: usize,
    gain: f32,
    nodes: Option<[[f32; NODES]; NODES]>,
    /// Exponentials of the place across the shadow's first edge, for columns and rows.
    shadow: Option<[Vec<f64>; 2]>,
}

impl Light {
    /// For square frames of `size` pixels. Frames draw random numbers from the streams of `seed` after `stream`.
    pub(super) fn new(scenario: &Scenario, size: usize, seed: u64, stream: u64) -> Self {
        let mut random = Random::new(seed, stream);
        let flicker = (0..scenario.frames).map(|_| 1.0 + scenario.flicker * random.gaussian()).collect();
        Self {
            scenario: scenario.clone(),
            size,
            seed,
            stream,
            flicker,
            sensor: Photometry::new([size; 2], scenario.noise, seed, random),
            weights: (0..size).map(|x| node_weights(x, size)).collect(),
        }
    }

    /// The light on frame `t`.
    pub(super) fn on_frame(&self, t: usize) -> FrameLight {
        let Scenario { gain_drift, shadow, uneven_flicker, .. } = self.scenario;
        let phase = TAU * t as f64 / DRIFT_FRAMES;
        let drift = 1.0 + gain_drift * DRIFT_FRAMES / TAU * libm::sin(phase);
        let gain = (drift * self.flicker[t]).max(LEAST_LIGHT) as f32;
        let nodes = (uneven_flicker > 0.0).then(|| {
            let mut random = Random::new(self.seed, self.stream + 1 + t as u64);
            [[(); NODES]; NODES].map(|row| row.map(|()| (uneven_flicker * random.gaussian()) as f32))
        });
        let shadow = (shadow > 0.0).then(|| self.shadow_exponentials(t));
        FrameLight { t, gain, nodes, shadow }
    }

    /// Writes row `y` from the grey levels of its pixels, which it changes.
    pub(super) fn expose(&self, light: &FrameLight, y: usize, grey: &mut [f32], pixels: &mut [u8]) {
        if let Some([columns, rows]) = &light.shadow {
            let depth = self.scenario.shadow;
            let width = libm::exp(-SHADOW_WIDTH / SHADOW_SOFTNESS);
            for (g, column) in grey.iter_mut().zip(columns) {
                // e^(-s / softness), s from the band's first edge
                let e = column * rows[y];
                let inside = 1.0 / (1.0 + e) / (1.0 + width / e);
                *g *= (1.0 - depth * inside) as f32;
            }
        }
        if let Some(nodes) = &light.nodes {
            let down = self.weights[y];
            let row: [f32; NODES] = std::array::from_fn(|i| (0..NODES).map(|j| down[j] * nodes[j][i]).sum());
            for (g, across) in grey.iter_mut().zip(&self.weights) {
                let uneven: f32 = row.iter().zip(across).map(|(r, a)| r * a).sum();
                *g *= (1.0 + uneven).max(LEAST_LIGHT as f32);
            }
        }
        self.sensor.expose(grey, light.gain, (light.t as u64, y), pixels);
    }

    fn shadow_exponentials(&self, t: usize) -> [Vec<f64>; 2] {
        let width = self.size as f64;
        let edge = SHADOW_FROM * width + self.scenario.shadow_speed * t as f64;
        let along = |direction: f64, from: f64| {
            let value = |x: usize| {
                let exponent = -(direction * x as f64 - from) / (SHADOW_SOFTNESS * width);
                libm::exp(exponent.clamp(-300.0, 300.0))
            };
            (0..self.size).map(value).collect()
        };
        [along(SHADOW_DIRECTION[0], edge), along(SHADOW_DIRECTION[1], 0.0)]
    }
}

/// Weights of the nodes, which lie in the middles of thirds of the frame, for pixel `x`: smooth steps from one to
/// the next, level beyond the first and the last.
fn node_weights(x: usize, size: usize) -> [f32; NODES] {
    let place = ((x as f64 + 0.5) * NODES as f64 / size as f64 - 0.5).clamp(0.0, (NODES - 1) as f64);
    let before = (place as usize).min(NODES - 2);
    let share = place - before as f64;
    let step = share * share * (3.0 - 2.0 * share);
    let mut weights = [0.0; NODES];
    weights[before] = (1.0 - step) as f32;
    weights[before + 1] = step as f32;
    weights
}
