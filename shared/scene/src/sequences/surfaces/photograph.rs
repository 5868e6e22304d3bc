//! A photograph made periodic.

use super::super::plane::Plane;
use super::super::scenario::Photograph;

/// Of a larger photograph only the middle is used, pixels.
const MOST_PX: usize = 1024;
/// Takes away what an 8-bit camera aliases, pixels.
const SOFTENING_SIGMA: f64 = 0.7;
/// Half of the boxes whose three-fold mean is all but a Gaussian of 80 pixels.
const SHADING_HALF_PX: usize = 80;

/// Mirrored at its right and lower border, then periodic, without its coarse shading.
pub(super) fn tiled(photograph: &Photograph) -> Plane {
    let (width, height) = (photograph.width().min(MOST_PX), photograph.height().min(MOST_PX));
    let from = [(photograph.width() - width) / 2, (photograph.height() - height) / 2];
    let mirrored = |i: usize, side: usize| if i < side { i } else { 2 * side - 1 - i };
    let plane = Plane::from_fn(2 * width, 2 * height, |x, y| {
        f32::from(photograph.pixel(from[0] + mirrored(x, width), from[1] + mirrored(y, height)))
    });
    let mut plane = plane.blurred(SOFTENING_SIGMA);
    let mut shading = plane.clone();
    for _ in 0..3 {
        shading = box_mean(&shading, SHADING_HALF_PX);
    }
    plane.add(&shading, -1.0);
    plane
}

/// Mean over boxes that reach `half` texels from their middle, by running sums.
fn box_mean(plane: &Plane, half: usize) -> Plane {
    let (width, height) = (plane.width, plane.height);
    let share = 1.0 / (2 * half + 1) as f64;
    let mut across = plane.clone();
    for (source, target) in plane.grey.chunks_exact(width).zip(across.grey.chunks_exact_mut(width)) {
        let at = |x: usize| f64::from(source[x % width]);
        let far = width * (half / width + 1) - half;
        let mut sum: f64 = (0..=2 * half).map(|i| at(far + i)).sum();
        for (x, t) in target.iter_mut().enumerate() {
            *t = (sum * share) as f32;
            sum += at(x + half + 1) - at(x + far);
        }
    }
    let mut result = plane.clone();
    let row = |y: usize| &across.grey[y % height * width..][..width];
    let far = height * (half / height + 1) - half;
    let mut sums = vec![0.0f64; width];
    for i in 0..=2 * half {
        sums.iter_mut().zip(row(far + i)).for_each(|(s, &g)| *s += f64::from(g));
    }
    for (y, target) in result.grey.chunks_exact_mut(width).enumerate() {
        let change = row(y + half + 1).iter().zip(row(y + far));
        for ((t, s), (&enters, &leaves)) in target.iter_mut().zip(&mut sums).zip(change) {
            *t = (*s * share) as f32;
            *s += f64::from(enters) - f64::from(leaves);
        }
    }
    result
}
