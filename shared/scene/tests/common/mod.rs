//! What the scene's tests share: a scene, a frame as numbers, and the pinhole equation written out once more.
#![allow(dead_code, missing_docs)]

use pursuit_scene::{Scene, SceneParameters, View};

/// A grey image.
pub struct Image {
    pub width: usize,
    pub height: usize,
    pub grey: Vec<f64>,
}

impl Image {
    pub fn at(&self, x: usize, y: usize) -> f64 {
        self.grey[y * self.width + x]
    }

    /// Bilinear; `None` outside.
    pub fn between(&self, x: f64, y: f64) -> Option<f64> {
        let (i, j) = (x.floor(), y.floor());
        if i < 0.0 || j < 0.0 || i + 1.0 >= self.width as f64 || j + 1.0 >= self.height as f64 {
            return None;
        }
        let (a, b) = (x - i, y - j);
        let (i, j) = (i as usize, j as usize);
        let upper = (1.0 - a) * self.at(i, j) + a * self.at(i + 1, j);
        let lower = (1.0 - a) * self.at(i, j + 1) + a * self.at(i + 1, j + 1);
        Some((1.0 - b) * upper + b * lower)
    }
}

/// A frame as numbers.
pub fn render(scene: &mut Scene, view: &View) -> Image {
    let (width, height) = (scene.parameters().width, scene.parameters().height);
    let mut pixels = vec![0; width * height];
    scene.render(view, &mut pixels, width).expect("the view is one");
    Image { width, height, grey: pixels.iter().map(|&p| f64::from(p)).collect() }
}

/// Parameters without noise.
pub fn noiseless() -> SceneParameters {
    SceneParameters { noise_sigma: 0.0, ..Default::default() }
}

/// Product of quaternions (x, y, z, w).
pub fn product(a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
    [
        a[3] * b[0] + a[0] * b[3] + a[1] * b[2] - a[2] * b[1],
        a[3] * b[1] - a[0] * b[2] + a[1] * b[3] + a[2] * b[0],
        a[3] * b[2] + a[0] * b[1] - a[1] * b[0] + a[2] * b[3],
        a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2],
    ]
}

/// Rotation by `angle` about a coordinate axis.
pub fn about(axis: usize, angle: f64) -> [f64; 4] {
    let mut q = [0.0, 0.0, 0.0, (0.5 * angle).cos()];
    q[axis] = (0.5 * angle).sin();
    q
}

/// The pinhole equation for f = 256 pixels and 512 x 512 pixels, by rotating with q* v q.
pub fn project(view: &View, point: [f64; 3]) -> [f64; 2] {
    let q = view.camera_rotation;
    let offset = [0, 1, 2].map(|i| point[i] - view.camera_position[i]);
    let conjugate = [-q[0], -q[1], -q[2], q[3]];
    let [x, y, z, _] = product(product(conjugate, [offset[0], offset[1], offset[2], 0.0]), q);
    [256.0 * x / z + 255.5, 256.0 * y / z + 255.5]
}

/// Gaussian blur after which the discretisation of derivatives is negligible, pixels.
pub const SMOOTH_PX: f64 = 2.5;
/// Half length of the blur's kernel.
const REACH: usize = 10;

/// Separable Gaussian; pixels nearer than ten to the border are not to be used.
pub fn blurred(image: &Image, sigma_px: f64) -> Image {
    let kernel: Vec<f64> =
        (0..=2 * REACH).map(|i| (-0.5 * ((i as f64 - REACH as f64) / sigma_px).powi(2)).exp()).collect();
    let sum: f64 = kernel.iter().sum();
    let along = |grey: &[f64], step: usize| {
        let mut out = vec![0.0; grey.len()];
        for (k, weight) in kernel.iter().enumerate() {
            for i in REACH * step..grey.len() - REACH * step {
                out[i] += weight / sum * grey[i + k * step - REACH * step];
            }
        }
        out
    };
    let grey = along(&along(&image.grey, 1), image.width);
    Image { width: image.width, height: image.height, grey }
}
