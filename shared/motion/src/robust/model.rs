//! The global motion: what a moving camera does to the image of a plane.

/// Coefficients of the model.
pub const COEFFICIENTS: usize = 8;

/// How the background moves from the older to the newer frame: the flow of a plane under a moving
/// camera (design notes on vision, section 6 R2), quadratic in the position with 8 coefficients,
///
/// ```text
/// u = a0 + a1 x + a2 y + a6 x^2 + a7 x y
/// v = a3 + a4 x + a5 y + a6 x y + a7 y^2
/// ```
///
/// where (x, y) is the position in the *newer* frame from the middle of the image, in half lengths of its
/// longer side, and (u, v) the displacement that ends there, full-resolution px per pair, v downward.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GlobalMotion {
    /// a0..a7, px.
    pub coefficients: [f64; COEFFICIENTS],
    centre: [f64; 2],
    half_length: f64,
}

impl GlobalMotion {
    /// No motion, in an image of `width` x `height` px.
    pub fn still(width: usize, height: usize) -> GlobalMotion {
        let middle = |side: usize| (side as f64 - 1.0) / 2.0;
        GlobalMotion {
            coefficients: [0.0; COEFFICIENTS],
            centre: [middle(width), middle(height)],
            half_length: width.max(height) as f64 / 2.0,
        }
    }

    /// The same image moved by (u, v) px as a whole.
    pub fn translated(mut self, u: f64, v: f64) -> GlobalMotion {
        self.coefficients = [u, 0.0, 0.0, v, 0.0, 0.0, 0.0, 0.0];
        self
    }

    /// The displacement (right, down) that ends at (u, v), px per pair.
    pub fn at(&self, u: f64, v: f64) -> (f64, f64) {
        let [x, y] = self.normalised(u, v);
        let [a0, a1, a2, a3, a4, a5, a6, a7] = self.coefficients;
        let bend = a6 * x + a7 * y;
        (a0 + a1 * x + a2 * y + bend * x, a3 + a4 * x + a5 * y + bend * y)
    }

    /// The displacement (right, down) in the middle of the image, px per pair.
    pub fn in_the_middle(&self) -> (f64, f64) {
        let [u, _, _, v, ..] = self.coefficients;
        (u, v)
    }

    /// How far the image turns over the pair, rad, from right to down, for small angles.
    pub fn turn_rad(&self) -> f64 {
        let [_, _, a2, _, a4, ..] = self.coefficients;
        (a4 - a2) / (2.0 * self.half_length)
    }

    /// Where the background point at (u, v) of the older frame is in the newer one, px.
    pub fn forward(&self, u: f64, v: f64) -> (f64, f64) {
        // The displacement is given at its end: two steps of a fixed point are exact to 1e-3 px at 10 %
        // of divergence.
        let (mut x, mut y) = (u, v);
        for _ in 0..3 {
            let (du, dv) = self.at(x, y);
            (x, y) = (u + du, v + dv);
        }
        (x, y)
    }

    /// How large the coefficients may be expected to be, px: any translation; turns and zooms of some
    /// per cent; little bending.
    pub(crate) fn prior(&self) -> [f64; COEFFICIENTS] {
        const LINEAR: f64 = 0.15;
        const QUADRATIC: f64 = 0.01;
        let (shift, linear, bend) =
            (self.half_length, LINEAR * self.half_length, QUADRATIC * self.half_length);
        [shift, linear, linear, shift, linear, linear, bend, bend]
    }

    /// Whether all coefficients are numbers.
    pub fn is_finite(&self) -> bool {
        self.coefficients.iter().all(|a| a.is_finite())
    }

    /// Full-resolution px as model coordinates.
    pub(crate) fn normalised(&self, u: f64, v: f64) -> [f64; 2] {
        [(u - self.centre[0]) / self.half_length, (v - self.centre[1]) / self.half_length]
    }

    /// The displacements along row `y` of pyramid level `k` (from 0), as polynomials of the model's x; in
    /// px of that level.
    #[inline(always)]
    pub(crate) fn row(&self, k: usize, y: usize) -> Row {
        let pixel = f64::from(2u32 << k);
        let [_, y] = self.normalised(0.0, y as f64 * pixel);
        let [a0, a1, a2, a3, a4, a5, a6, a7] = self.coefficients.map(|a| a / pixel);
        Row {
            u: [(a0 + a2 * y) as f32, (a1 + a7 * y) as f32, a6 as f32],
            v: [(a3 + a5 * y + a7 * y * y) as f32, (a4 + a6 * y) as f32],
            first: (-self.centre[0] / self.half_length) as f32,
            step: (pixel / self.half_length) as f32,
        }
    }
}

/// Displacements along one row of a level.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Row {
    u: [f32; 3],
    v: [f32; 2],
    first: f32,
    step: f32,
}

impl Row {
    /// Displacement (right, down) at column `x`, level px.
    #[inline(always)]
    pub(crate) fn at(&self, x: f32) -> (f32, f32) {
        let x = self.first + self.step * x;
        (self.u[0] + x * (self.u[1] + x * self.u[2]), self.v[0] + x * self.v[1])
    }
}

/// Which motions the fit may find; each contains the one before.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum MotionModel {
    /// 2 coefficients: the whole image moves alike (the paper's scheme, with fractions of a pixel).
    Translation,
    /// 4: also turns and zooms.
    Similarity,
    /// 6: also shears.
    Affine,
    /// 8: the flow of a plane under any motion of the camera.
    #[default]
    Planar,
}
