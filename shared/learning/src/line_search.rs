//! A step along a descent direction that meets the strong Wolfe conditions.

/// Least share of the decrease that the slope at the start promises (Wolfe's c1).
const SUFFICIENT_DECREASE: f64 = 1e-4;
/// Evaluations after which the best step so far is taken.
const MAX_EVALUATIONS: u32 = 20;
/// A step while no minimum is bracketed grows by at least and at most this.
const GROWTH: (f64, f64) = (1.5, 4.0);
/// An interpolated step keeps this share of the bracket away from both of its ends.
const SAFEGUARD: f64 = 0.1;
/// A bracket narrower than this cannot be divided any more.
const MIN_BRACKET: f64 = 1e-14;

/// The line that is searched.
pub(crate) struct Line<'a, const N: usize> {
    pub(crate) point: &'a [f64; N],
    pub(crate) direction: &'a [f64; N],
    /// Value at `point`.
    pub(crate) value: f64,
    /// Derivative along `direction` at `point`, < 0.
    pub(crate) slope: f64,
}

/// A point on the line with everything known about it.
#[derive(Clone)]
pub(crate) struct Trial<const N: usize> {
    pub(crate) step: f64,
    pub(crate) value: f64,
    pub(crate) slope: f64,
    pub(crate) point: [f64; N],
    pub(crate) gradient: [f64; N],
}

/// The line's cross-section at one step.
#[derive(Clone, Copy)]
struct Cut {
    step: f64,
    value: f64,
    slope: f64,
}

impl<const N: usize> Line<'_, N> {
    /// A step with |slope| ≤ `curvature` · |slope at the start| and a sufficient decrease, else the
    /// lowest step tried, else nothing where none was lower than the start; and the number of
    /// evaluations.
    ///
    /// Bracketing and zoom after Nocedal and Wright (algorithms 3.5 and 3.6) with cubic interpolation. A
    /// value that is not finite counts as too far.
    pub(crate) fn search(
        &self,
        objective: &mut impl FnMut(&[f64; N], &mut [f64; N]) -> f64,
        first_step: f64,
        curvature: f64,
    ) -> (Option<Trial<N>>, u32) {
        let mut best: Option<Trial<N>> = None;
        let mut previous = Cut { step: 0.0, value: self.value, slope: self.slope };
        let mut bracket: Option<(Cut, Cut)> = None;
        let mut step = first_step;
        for evaluation in 1..=MAX_EVALUATIONS {
            let trial = self.evaluate(objective, step);
            let here = Cut { step, value: trial.value, slope: trial.slope };
            let falls = here.value <= self.value + SUFFICIENT_DECREASE * step * self.slope;
            if falls && here.slope.abs() <= -curvature * self.slope {
                return (Some(trial), evaluation);
            }
            if here.value < best.as_ref().map_or(self.value, |best| best.value) {
                best = Some(trial);
            }
            let (low, high) = match bracket {
                None if !falls || (evaluation > 1 && here.value >= previous.value) => (previous, here),
                None if here.slope >= 0.0 => (here, previous),
                None => {
                    step = extrapolated(previous, here);
                    previous = here;
                    continue;
                }
                Some((low, _)) if !falls || here.value >= low.value => (low, here),
                Some((low, high)) if here.slope * (high.step - low.step) >= 0.0 => (here, low),
                Some((_, high)) => (here, high),
            };
            if (high.step - low.step).abs() < MIN_BRACKET {
                return (best, evaluation);
            }
            bracket = Some((low, high));
            step = interpolated(low, high);
        }
        (best, MAX_EVALUATIONS)
    }

    fn evaluate(&self, objective: &mut impl FnMut(&[f64; N], &mut [f64; N]) -> f64, step: f64) -> Trial<N> {
        let point = std::array::from_fn(|i| self.point[i] + step * self.direction[i]);
        let mut gradient = [0.0; N];
        let value = objective(&point, &mut gradient);
        let slope = dot(&gradient, self.direction);
        Trial { step, value, slope, point, gradient }
    }
}

/// Where the slope would vanish if it went on as between the two cuts.
fn extrapolated(previous: Cut, here: Cut) -> f64 {
    let bend = previous.slope - here.slope;
    let step = if bend < 0.0 {
        here.step + (here.step - previous.step) * here.slope / bend
    } else {
        3.0 * here.step
    };
    step.clamp(GROWTH.0 * here.step, GROWTH.1 * here.step)
}

/// The minimum of the cubic through both cuts, kept away from both; the middle where there is none.
fn interpolated(low: Cut, high: Cut) -> f64 {
    let width = high.step - low.step;
    let secant = low.slope + high.slope - 3.0 * (low.value - high.value) / (low.step - high.step);
    let root = (secant * secant - low.slope * high.slope).sqrt() * width.signum();
    let step = high.step - width * (high.slope + root - secant) / (high.slope - low.slope + 2.0 * root);
    let (left, right) = (low.step.min(high.step), low.step.max(high.step));
    let margin = SAFEGUARD * (right - left);
    if step.is_finite() { step.clamp(left + margin, right - margin) } else { 0.5 * (left + right) }
}

pub(crate) fn dot<const N: usize>(a: &[f64; N], b: &[f64; N]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn search(objective: impl Fn(f64) -> (f64, f64), first_step: f64) -> Option<Trial<1>> {
        let (value, slope) = objective(0.0);
        let line = Line { point: &[0.0], direction: &[1.0], value, slope };
        let mut along = |x: &[f64; 1], gradient: &mut [f64; 1]| {
            let (value, slope) = objective(x[0]);
            gradient[0] = slope;
            value
        };
        line.search(&mut along, first_step, 0.1).0
    }

    #[test]
    fn it_finds_the_valley_from_far_too_short_and_far_too_long_first_steps() {
        let valley = |x: f64| ((x - 3.0).powi(2), 2.0 * (x - 3.0));
        for first_step in [1e-4, 0.1, 1.0, 3.0, 5.9, 50.0, 1e4] {
            let trial = search(valley, first_step).unwrap();
            assert!(trial.slope.abs() <= 0.1 * 6.0, "from {first_step}: slope {}", trial.slope);
            assert!(trial.value < 9.0);
        }
    }

    #[test]
    fn not_a_number_counts_as_too_far() {
        let cliff =
            |x: f64| if x > 1.0 { (f64::NAN, f64::NAN) } else { ((x - 0.9).powi(2), 2.0 * (x - 0.9)) };
        let trial = search(cliff, 8.0).unwrap();
        assert!((trial.step - 0.9).abs() < 0.1);
    }

    #[test]
    fn a_line_that_only_rises_yields_nothing() {
        assert!(search(|x| (x, -1.0), 1.0).is_none());
    }
}
