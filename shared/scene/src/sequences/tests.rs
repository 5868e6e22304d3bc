//! Claims of the generator, each measured in rendered frames where that is possible.

mod catalogue;
mod geometry;
mod light;
mod textures;
mod truth;

use super::*;

/// Noiseless, standing, without target.
fn still() -> Scenario {
    Scenario { pan: [0.0; 2], noise: 0.0, target: None, frames: 9, ..Scenario::default() }
}

fn frame(scenario: &Scenario, size: usize, seed: u64, t: usize) -> Vec<f64> {
    let mut sequence = Sequence::new(scenario, size, seed).unwrap();
    frame_of(&mut sequence, t)
}

fn frame_of(sequence: &mut Sequence, t: usize) -> Vec<f64> {
    let mut pixels = vec![0; sequence.size() * sequence.size()];
    sequence.render(t, &mut pixels);
    pixels.into_iter().map(f64::from).collect()
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

fn mean_and_deviation(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    (mean, (values.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / n).sqrt())
}

/// Area and centroid of the pixels in which two frames differ.
fn where_different(a: &[f64], b: &[f64], size: usize) -> (usize, [f64; 2]) {
    let different: Vec<usize> = (0..a.len()).filter(|&i| a[i] != b[i]).collect();
    let n = different.len() as f64;
    let sum = different.iter().fold([0.0; 2], |s, i| [s[0] + (i % size) as f64, s[1] + (i / size) as f64]);
    (different.len(), sum.map(|s| s / n))
}

/// Bilinear.
fn between(frame: &[f64], size: usize, [x, y]: [f64; 2]) -> f64 {
    let (i, j) = (x.floor(), y.floor());
    let (a, b) = (x - i, y - j);
    let at = |dx: usize, dy: usize| frame[(j as usize + dy) * size + i as usize + dx];
    (1.0 - b) * ((1.0 - a) * at(0, 0) + a * at(1, 0)) + b * ((1.0 - a) * at(0, 1) + a * at(1, 1))
}
