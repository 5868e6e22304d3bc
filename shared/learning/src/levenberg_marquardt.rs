//! Minimisation of a sum of squares by Levenberg and Marquardt: Gauss-Newton, damped until it leads down.
//!
//! Each step solves (JᵀJ + λ diag(JᵀJ) + ρ 1) δ = −gradient by Cholesky's decomposition. ρ keeps directions
//! that the samples say nothing about where they are.

use crate::conjugate_gradient::{Limits, Stop};
use crate::line_search::dot;

/// λ at the start, and how it falls where a step leads down and rises where it does not.
const DAMPING: (f64, f64, f64) = (0.1, 0.2, 4.0);
/// λ never falls below and never rises above this.
const DAMPING_RANGE: (f64, f64) = (1e-9, 1e12);

/// A sum of squares, or of what weighs residuals like one (Huber's error with weights), of N variables.
pub trait Squares<const N: usize> {
    /// The value at a point.
    fn value(&mut self, point: &[f64; N]) -> f64;

    /// Writes gradient and JᵀJ (the lower triangle) at a point; returns the value there.
    fn normal_equations(&mut self, point: &[f64; N], equations: &mut NormalEquations<N>) -> f64;
}

/// Gradient and JᵀJ; of the matrix the lower triangle.
#[derive(Clone, Debug)]
pub struct NormalEquations<const N: usize> {
    /// Derivative of the value.
    pub gradient: [f64; N],
    /// JᵀJ: rows, of which the columns up to the diagonal count.
    pub matrix: Vec<[f64; N]>,
}

impl<const N: usize> NormalEquations<N> {
    fn zero() -> NormalEquations<N> {
        NormalEquations { gradient: [0.0; N], matrix: vec![[0.0; N]; N] }
    }

    /// Sets all to 0.
    pub fn clear(&mut self) {
        self.gradient = [0.0; N];
        self.matrix.fill([0.0; N]);
    }
}

/// A descent under way. All memory is allocated when it is made.
#[derive(Clone, Debug)]
pub struct Damped<const N: usize> {
    point: [f64; N],
    value: f64,
    equations: NormalEquations<N>,
    factor: Vec<[f64; N]>,
    damping: f64,
    ridge: f64,
    evaluations: u32,
}

impl<const N: usize> Damped<N> {
    /// A descent from `start`; `ridge` is ρ, > 0.
    pub fn new(squares: &mut impl Squares<N>, start: [f64; N], ridge: f64) -> Damped<N> {
        let mut equations = NormalEquations::zero();
        let value = squares.normal_equations(&start, &mut equations);
        let factor = vec![[0.0; N]; N];
        Damped { point: start, value, equations, factor, damping: DAMPING.0, ridge, evaluations: 1 }
    }

    /// The lowest point so far.
    pub fn point(&self) -> &[f64; N] {
        &self.point
    }

    /// The value at [`Damped::point`].
    pub fn value(&self) -> f64 {
        self.value
    }

    /// How often value or normal equations were evaluated.
    pub fn evaluations(&self) -> u32 {
        self.evaluations
    }

    /// One iteration: a step, damped until it leads down. The value never rises. `false`: there is no lower
    /// point to be found from here.
    pub fn iterate(&mut self, squares: &mut impl Squares<N>) -> bool {
        if !self.value.is_finite() {
            return false;
        }
        while self.damping < DAMPING_RANGE.1 {
            if let Some(step) = self.solve() {
                let trial = std::array::from_fn(|i| self.point[i] + step[i]);
                let value = squares.value(&trial);
                self.evaluations += 1;
                if value < self.value {
                    self.damping = (self.damping * DAMPING.1).max(DAMPING_RANGE.0);
                    self.point = trial;
                    self.value = squares.normal_equations(&trial, &mut self.equations);
                    self.evaluations += 1;
                    return true;
                }
            }
            self.damping *= DAMPING.2;
        }
        false
    }

    /// Iterates until one of the reasons to stop, with the number of iterations. `keep_going` is asked
    /// before each.
    pub fn run(
        &mut self,
        squares: &mut impl Squares<N>,
        max_iterations: u32,
        keep_going: impl Fn() -> bool,
    ) -> (Stop, u32) {
        let mut limits = Limits::default();
        for iteration in 0..max_iterations {
            if let Some(stop) = limits.before(&self.equations.gradient, self.evaluations, &keep_going) {
                return (stop, iteration);
            }
            let before = self.value;
            if !self.iterate(squares) {
                return (Stop::Stuck, iteration);
            }
            if limits.stalled(before, self.value) {
                return (Stop::Stalled, iteration + 1);
            }
        }
        (Stop::Iterations, max_iterations)
    }

    /// δ; `None` where the matrix is not positive definite.
    fn solve(&mut self) -> Option<[f64; N]> {
        for row in 0..N {
            for column in 0..=row {
                let (upper, lower) = self.factor.split_at_mut(row);
                let here = &mut lower[0];
                let mut rest = self.equations.matrix[row][column];
                if column == row {
                    rest += self.damping * rest + self.ridge - dot_to(here, here, row);
                    if rest <= 0.0 || !rest.is_finite() {
                        return None;
                    }
                    here[row] = rest.sqrt();
                } else {
                    let other = &upper[column];
                    rest -= dot_to(here, other, column);
                    here[column] = rest / other[column];
                }
            }
        }
        let mut step = self.equations.gradient.map(|slope| -slope);
        for row in 0..N {
            step[row] = (step[row] - dot_to(&self.factor[row], &step, row)) / self.factor[row][row];
        }
        for row in (0..N).rev() {
            step[row] /= self.factor[row][row];
            let solved = step[row];
            for (rest, factor) in step[..row].iter_mut().zip(&self.factor[row]) {
                *rest -= factor * solved;
            }
        }
        dot(&step, &step).is_finite().then_some(step)
    }
}

/// Product of the first `count` components, in four sums side by side.
fn dot_to<const N: usize>(a: &[f64; N], b: &[f64; N], count: usize) -> f64 {
    let (a, b) = (a[..count].as_chunks::<4>(), b[..count].as_chunks::<4>());
    let mut sums = [0.0; 4];
    for (a, b) in a.0.iter().zip(b.0) {
        for lane in 0..4 {
            sums[lane] += a[lane] * b[lane];
        }
    }
    let rest: f64 = a.1.iter().zip(b.1).map(|(a, b)| a * b).sum();
    (sums[0] + sums[1]) + (sums[2] + sums[3]) + rest
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Rosenbrock's valley as the squares of 10 (y − x²) and 1 − x.
    struct Rosenbrock;

    impl Squares<2> for Rosenbrock {
        fn value(&mut self, [x, y]: &[f64; 2]) -> f64 {
            let residuals = [10.0 * (y - x * x), 1.0 - x];
            0.5 * dot(&residuals, &residuals)
        }

        fn normal_equations(&mut self, point: &[f64; 2], equations: &mut NormalEquations<2>) -> f64 {
            let [x, y] = *point;
            let (a, b) = (10.0 * (y - x * x), 1.0 - x);
            equations.gradient = [-20.0 * x * a - b, 10.0 * a];
            equations.matrix[0][0] = 400.0 * x * x + 1.0;
            equations.matrix[1] = [-200.0 * x, 100.0];
            self.value(point)
        }
    }

    /// A linear fit through five points, y = a + b x: its solution is known from the sums.
    struct Fit;
    const POINTS: [[f64; 2]; 5] = [[0.0, 1.1], [1.0, 2.9], [2.0, 5.2], [3.0, 6.8], [4.0, 9.1]];

    impl Squares<2> for Fit {
        fn value(&mut self, [a, b]: &[f64; 2]) -> f64 {
            POINTS.iter().map(|[x, y]| 0.5 * (a + b * x - y).powi(2)).sum()
        }

        fn normal_equations(&mut self, point: &[f64; 2], equations: &mut NormalEquations<2>) -> f64 {
            equations.clear();
            for [x, y] in POINTS {
                let residual = point[0] + point[1] * x - y;
                equations.gradient[0] += residual;
                equations.gradient[1] += residual * x;
                equations.matrix[0][0] += 1.0;
                equations.matrix[1][0] += x;
                equations.matrix[1][1] += x * x;
            }
            self.value(point)
        }
    }

    #[test]
    fn a_linear_fit_is_the_one_that_the_sums_give() {
        let mut descent = Damped::new(&mut Fit, [50.0, -30.0], 1e-12);
        for _ in 0..20 {
            descent.iterate(&mut Fit);
        }
        // n = 5, Σx = 10, Σx² = 30, Σy = 25.1, Σxy = 70.1.
        let b = (5.0 * 70.1 - 10.0 * 25.1) / (5.0 * 30.0 - 100.0);
        let a = (25.1 - b * 10.0) / 5.0;
        assert!((descent.point()[0] - a).abs() < 1e-6 && (descent.point()[1] - b).abs() < 1e-6);
    }

    #[test]
    fn rosenbrocks_valley_is_followed_to_its_end() {
        let mut descent = Damped::new(&mut Rosenbrock, [-1.2, 1.0], 1e-9);
        for _ in 0..60 {
            descent.iterate(&mut Rosenbrock);
        }
        assert!((descent.point()[0] - 1.0).abs() < 1e-6, "{:?}", descent.point());
    }

    proptest! {
        #[test]
        fn the_value_never_rises(x in -3.0..3.0f64, y in -3.0..3.0f64) {
            let mut descent = Damped::new(&mut Rosenbrock, [x, y], 1e-9);
            for _ in 0..40 {
                let before = descent.value();
                descent.iterate(&mut Rosenbrock);
                prop_assert!(descent.value() <= before);
            }
        }
    }

    struct NotANumber;

    impl Squares<2> for NotANumber {
        fn value(&mut self, _: &[f64; 2]) -> f64 {
            f64::NAN
        }

        fn normal_equations(&mut self, _: &[f64; 2], _: &mut NormalEquations<2>) -> f64 {
            f64::NAN
        }
    }

    #[test]
    fn a_start_that_is_not_finite_stays_where_it_is_and_it_can_be_called_off() {
        let mut descent = Damped::new(&mut NotANumber, [1.0, 2.0], 1e-9);
        assert_eq!(descent.run(&mut NotANumber, 60, || true).1, 0);
        assert_eq!(descent.point(), &[1.0, 2.0]);
        let mut descent = Damped::new(&mut Rosenbrock, [-1.2, 1.0], 1e-9);
        assert_eq!(descent.run(&mut Rosenbrock, 60, || false), (Stop::Cancelled, 0));
    }
}
