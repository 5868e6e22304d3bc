//! A target that turns while it moves: the rigid motion of a patch within the image, and its refinement.
//!
//! Departs from the paper and from the design notes, whose targets only translate: a vehicle on a circle of 0.2 m
//! turns by 4.6 degrees between two frames at 0.2 m/s and 12.5 Hz. Its ends then move 3 px across, more than a fine
//! texture bears, and a mask of the translation alone is short of one end: the centroid is off along the way.

use multiversion::multiversion;
use nalgebra::{Matrix3, Vector3};

use super::patch::{Lines, Place};
use crate::pyramid::Level;

/// Largest turn, rad: what turns faster between two frames is not the same texture any more.
const MOST_TURN: f32 = 0.5;
/// Largest correction in one step: px of the level, rad.
const MOST_STEP: [f64; 2] = [1.0, 0.06];

/// A motion from the older frame to the newer: turned about a centre, then displaced. Px of the level.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Rigid {
    /// Displacement of what comes to the centre.
    pub(crate) motion: [f32; 2],
    /// From x (right) to y (down), rad.
    pub(crate) turn: f32,
    /// Centre, in the newer frame.
    pub(crate) centre: [f32; 2],
}

impl Rigid {
    /// Without a turn.
    pub(crate) fn translation(motion: [f32; 2]) -> Rigid {
        Rigid { motion, turn: 0.0, centre: [0.0; 2] }
    }

    /// From the newer frame back to the older.
    pub(crate) fn inverse(&self) -> Rigid {
        let centre = [self.centre[0] - self.motion[0], self.centre[1] - self.motion[1]];
        Rigid { motion: self.motion.map(|u| -u), turn: -self.turn, centre }
    }

    /// Where that point of the newer frame was in the older.
    pub(crate) fn origin_of(&self, point: [f32; 2]) -> [f32; 2] {
        let (sin, cos) = self.turn.sin_cos();
        let [x, y] = [point[0] - self.centre[0], point[1] - self.centre[1]];
        [
            self.centre[0] - self.motion[0] + cos * x + sin * y,
            self.centre[1] - self.motion[1] - sin * x + cos * y,
        ]
    }

    /// The level's grey levels under the patch after this motion, bilinear, the border repeated.
    pub(crate) fn moved(&self, level: &Level, place: Place, out: &mut [f32], lines: &mut Lines) {
        if self.turn == 0.0 {
            super::patch::shifted(level, place, self.motion, out, lines);
            return;
        }
        let first = self.origin_of([place.x as f32, place.y as f32]);
        turned(level, place, (first, self.turn.sin_cos()), out);
    }

    /// One least-squares step: `a` is the older frame after this motion, `b` the newer; where `chosen` is
    /// positive, with residuals over `scale` weighed down. The step's length in px at `reach` px from the
    /// centre; `None` where nothing can be told.
    pub(crate) fn correct(
        &mut self,
        (a, b, chosen): (&[f32], &[f32], &[f32]),
        place: Place,
        scale: f32,
        reach: f32,
    ) -> Option<f32> {
        let (matrix, vector) = normal_equations((a, b, chosen), place, self.centre, scale);
        let step = -(matrix + Matrix3::from_diagonal(&Vector3::new(0.01, 0.01, 1.0))).try_inverse()? * vector;
        if !step.iter().all(|s| s.is_finite()) {
            return None;
        }
        let [most_px, most_rad] = MOST_STEP;
        let (x, y) = (step[0].clamp(-most_px, most_px) as f32, step[1].clamp(-most_px, most_px) as f32);
        let turn = step[2].clamp(-most_rad, most_rad) as f32;
        self.motion = [self.motion[0] + x, self.motion[1] + y];
        self.turn = (self.turn + turn).clamp(-MOST_TURN, MOST_TURN);
        Some(x.abs().max(y.abs()) + reach * turn.abs())
    }
}

/// Bilinear values of the level at `first` + x (cos, -sin) + y (sin, cos).
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn turned(level: &Level, place: Place, (first, (sin, cos)): ([f32; 2], (f32, f32)), out: &mut [f32]) {
    let (most_x, most_y) = (level.width as f32 - 1.0, level.height as f32 - 1.0);
    for (y, out) in out[..place.pixels()].chunks_exact_mut(place.width).enumerate() {
        let row = [first[0] + sin * y as f32, first[1] + cos * y as f32];
        for (x, out) in out.iter_mut().enumerate() {
            let u = (row[0] + cos * x as f32).clamp(0.0, most_x);
            let v = (row[1] - sin * x as f32).clamp(0.0, most_y);
            let (left, top) = (u as usize, v as usize);
            let (right, bottom) = ((left + 1).min(level.width - 1), (top + 1).min(level.height - 1));
            let grey = |x: usize, y: usize| f32::from(level.values[y * level.stride + x]) * (1.0 / 16.0);
            let (part_x, part_y) = (u - left as f32, v - top as f32);
            let above = grey(left, top) + part_x * (grey(right, top) - grey(left, top));
            let below = grey(left, bottom) + part_x * (grey(right, bottom) - grey(left, bottom));
            *out = above + part_y * (below - above);
        }
    }
}

/// Of the residual b - a against a displacement by (x, y) px and a turn about `centre`.
fn normal_equations(
    (a, b, chosen): (&[f32], &[f32], &[f32]),
    place: Place,
    centre: [f32; 2],
    scale: f32,
) -> (Matrix3<f64>, Vector3<f64>) {
    let w = place.width;
    let (mut matrix, mut vector) = (Matrix3::zeros(), Vector3::zeros());
    for y in 1..place.height - 1 {
        let from_centre_y = (place.y + y as i32) as f32 - centre[1];
        // Sums of a row: xx, xy, xt, yy, yt, tt, xr, yr, tr.
        let mut sums = [0f32; 9];
        for x in 1..w - 1 {
            let at = y * w + x;
            if chosen[at] <= 0.0 {
                continue;
            }
            let gx = ((a[at + 1] + b[at + 1]) - (a[at - 1] + b[at - 1])) * 0.25;
            let gy = ((a[at + w] + b[at + w]) - (a[at - w] + b[at - w])) * 0.25;
            let from_centre_x = (place.x + x as i32) as f32 - centre[0];
            let gt = gy * from_centre_x - gx * from_centre_y;
            let r = b[at] - a[at];
            let robust = 1.0 + (r / scale) * (r / scale);
            let weight = 1.0 / (robust * robust);
            let products = [gx * gx, gx * gy, gx * gt, gy * gy, gy * gt, gt * gt, gx * r, gy * r, gt * r];
            sums.iter_mut().zip(products).for_each(|(sum, product)| *sum += weight * product);
        }
        let [xx, xy, xt, yy, yt, tt, xr, yr, tr] = sums.map(f64::from);
        matrix += Matrix3::new(xx, xy, xt, xy, yy, yt, xt, yt, tt);
        vector += Vector3::new(xr, yr, tr);
    }
    (matrix, vector)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_and_back_is_where_it_was() {
        let rigid = Rigid { motion: [3.5, -1.25], turn: 0.3, centre: [40.0, 25.0] };
        for point in [[0.0, 0.0], [40.0, 25.0], [63.0, 7.5]] {
            let back = rigid.inverse().origin_of(rigid.origin_of(point));
            assert!((back[0] - point[0]).hypot(back[1] - point[1]) < 1e-4, "{back:?} for {point:?}");
        }
        assert_eq!(rigid.origin_of(rigid.centre), [36.5, 26.25]);
    }

    /// x turns to y: what came to the right of the centre was above it before a quarter of a turn.
    #[test]
    fn a_turn_goes_from_x_to_y() {
        let quarter = Rigid { motion: [0.0; 2], turn: std::f32::consts::FRAC_PI_2, centre: [10.0, 10.0] };
        let [x, y] = quarter.origin_of([15.0, 10.0]);
        assert!((x - 10.0).abs() < 1e-5 && (y - 5.0).abs() < 1e-5, "({x}, {y})");
    }
}
