//! Functions with known minima, for the tests of all methods.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::line_search::dot;

/// ½ (x − m)ᵀ A (x − m) for A = R diag(spectrum) Rᵀ with a random product R of reflections.
pub(crate) struct Quadratic<const N: usize> {
    matrix: [[f64; N]; N],
    minimum: [f64; N],
}

impl<const N: usize> Quadratic<N> {
    pub(crate) fn random(seed: u64, largest: f64) -> Quadratic<N> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut matrix = [[0.0; N]; N];
        for (i, row) in matrix.iter_mut().enumerate() {
            row[i] = 1.0 + (largest - 1.0) * i as f64 / (N - 1) as f64;
        }
        for _ in 0..3 {
            let v: [f64; N] = std::array::from_fn(|_| rng.random_range(-1.0..1.0));
            matrix = reflected(&matrix, &v);
        }
        Quadratic { matrix, minimum: std::array::from_fn(|_| rng.random_range(-1.0..1.0)) }
    }

    pub(crate) fn value(&self, x: &[f64; N], gradient: &mut [f64; N]) -> f64 {
        let off: [f64; N] = std::array::from_fn(|i| x[i] - self.minimum[i]);
        *gradient = self.matrix.map(|row| dot(&row, &off));
        0.5 * dot(gradient, &off)
    }
}

/// H A H with the Householder reflection H across the plane orthogonal to v.
fn reflected<const N: usize>(a: &[[f64; N]; N], v: &[f64; N]) -> [[f64; N]; N] {
    let square = dot(v, v);
    let h: [[f64; N]; N] = std::array::from_fn(|i| {
        std::array::from_fn(|j| f64::from(u8::from(i == j)) - 2.0 * v[i] * v[j] / square)
    });
    let product = |a: &[[f64; N]; N], b: &[[f64; N]; N]| -> [[f64; N]; N] {
        std::array::from_fn(|i| std::array::from_fn(|j| (0..N).map(|k| a[i][k] * b[k][j]).sum()))
    };
    product(&product(&h, a), &h)
}

/// Its minimum, 0, is at (1, 1).
pub(crate) fn rosenbrock(x: &[f64; 2], gradient: &mut [f64; 2]) -> f64 {
    let (a, b) = (1.0 - x[0], x[1] - x[0] * x[0]);
    *gradient = [-2.0 * a - 400.0 * x[0] * b, 200.0 * b];
    a * a + 100.0 * b * b
}
