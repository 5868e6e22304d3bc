//! Bernoulli's lemniscate by arc length, in closed form.
//!
//! x = a cos φ / (1 + sin²φ), y = a sin φ cos φ / (1 + sin²φ) has ds/dφ = a / sqrt(1 + sin²φ), so that
//! s = a F(φ | m = -1): sin φ and cos φ are the Jacobi functions sn and cn of s/a with parameter -1 (the
//! lemniscate sine). The imaginary-modulus transformation takes them to parameter 1/2 (Abramowitz and Stegun
//! 16.10), where the arithmetic-geometric mean gives them (16.4).

use super::curve::CurvePoint;

/// Complete elliptic integral of the first kind for parameter 1/2.
const QUARTER_PERIOD: f64 = 1.854_074_677_301_372;
/// Steps of the arithmetic-geometric mean: it converges quadratically, to the last bit in five.
const MEANS: usize = 5;

/// The point `arc_m` metres after the crossing at `centre`; `a` is the half width, metres.
pub(super) fn point(centre: [f64; 2], a: f64, arc_m: f64) -> CurvePoint {
    // the crossing is at φ = π/2, a quarter period of sn( | -1), which is QUARTER_PERIOD / √2
    let root = std::f64::consts::SQRT_2;
    let (sn, cn, dn) = jacobi_half(arc_m / a * root + QUARTER_PERIOD);
    let (sin, cos) = (sn / (root * dn), cn / dn);
    let below = 1.0 + sin * sin;
    let position = [centre[0] + a * cos / below, centre[1] + a * sin * cos / below];
    // derivatives by φ, each over the same positive factor a / below²
    let dx = -sin * (below + 2.0 * cos * cos);
    let dy = (cos * cos - sin * sin) * below - 2.0 * sin * sin * cos * cos;
    // curvature is 3 r / a² with the sign of the lobe's sense of rotation
    let curvature = 3.0 * cos / (a * below.sqrt());
    CurvePoint { position, heading: libm::atan2(dy, dx), curvature }
}

/// sn, cn, dn of `u` for parameter 1/2.
fn jacobi_half(u: f64) -> (f64, f64, f64) {
    let half_root = std::f64::consts::FRAC_1_SQRT_2;
    let (mut a, mut b) = (1.0, half_root);
    let mut ratios = [0.0; MEANS]; // c_n / a_n
    for ratio in &mut ratios {
        let (next_a, next_b, c) = (0.5 * (a + b), (a * b).sqrt(), 0.5 * (a - b));
        (a, b) = (next_a, next_b);
        *ratio = c / a;
    }
    let reduced = libm::remainder(u, 4.0 * QUARTER_PERIOD);
    let mut phi = f64::from(1u32 << MEANS) * a * reduced;
    for ratio in ratios.iter().rev() {
        phi = 0.5 * (phi + libm::asin(ratio * libm::sin(phi)));
    }
    let (sn, cn) = (libm::sin(phi), libm::cos(phi));
    (sn, cn, (1.0 - 0.5 * sn * sn).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_satisfy_the_cartesian_equation_and_start_at_the_crossing() {
        let a = 0.2;
        for i in 0..500 {
            let [x, y] = point([0.0; 2], a, f64::from(i) * 0.01).position;
            let r2 = x * x + y * y;
            assert!((r2 * r2 - a * a * (x * x - y * y)).abs() < 1e-15, "point {i}: {x}, {y}");
        }
        let start = point([0.5, 0.1], a, 0.0).position;
        assert!((start[0] - 0.5).abs() < 1e-12 && (start[1] - 0.1).abs() < 1e-12);
    }

    #[test]
    fn length_of_the_curve_is_the_lemniscate_constant() {
        // 2 ϖ a with ϖ = 2.622057554292119
        let length = 2.0 * 2.622_057_554_292_119 * 0.2;
        let (a, b) = (point([0.0; 2], 0.2, 0.07), point([0.0; 2], 0.2, 0.07 + length));
        for i in 0..2 {
            assert!((a.position[i] - b.position[i]).abs() < 1e-12);
        }
    }

    #[test]
    fn heading_and_curvature_are_those_of_finite_differences() {
        let h = 1e-5;
        for i in 0..300 {
            let s = 0.0037 + f64::from(i) * 0.007;
            let at = |s: f64| point([0.0; 2], 0.2, s);
            let (before, here, after) = (at(s - h), at(s), at(s + h));
            let tangent = [0, 1].map(|k| (after.position[k] - before.position[k]) / (2.0 * h));
            assert!((tangent[0] - here.heading.cos()).abs() < 1e-6, "at {s}");
            assert!((tangent[1] - here.heading.sin()).abs() < 1e-6, "at {s}");
            let turn = super::super::curve::wrapped(after.heading - before.heading) / (2.0 * h);
            assert!((turn - here.curvature).abs() < 1e-4, "at {s}: {turn}, {}", here.curvature);
        }
    }
}
