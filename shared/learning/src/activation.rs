//! tanh: what a hidden unit says.
//!
//! Written out instead of taken from the system's library: a batch of them is computed in the processor's
//! vector registers, several times faster, and the bits are the same on every machine.

/// exp(−2 |x|) is computed no further than to exp of this: there tanh is 1 to the last bit.
const LOWEST: f64 = -40.0;
/// Adding this to a number rounds it to an integer, which is then in the lowest bits: 1.5 · 2⁵².
const ROUNDING: f64 = 6_755_399_441_055_744.0;
/// ln 2 in two parts; the first has so few digits that its product with a small integer is exact.
const LN_2: [f64; 2] = [6.931_471_803_691_238e-1, 1.908_214_929_270_587_7e-10];
/// Exponent of 1.0 as a double stores it, and where it is stored.
const EXPONENT: (u64, u32) = (1023, 52);

/// Hyperbolic tangent: odd to the bit, within 1e-15 of the true value, NaN for NaN. No branch.
#[inline(always)]
pub fn tanh(x: f64) -> f64 {
    let decayed = exp_of_negative(-2.0 * x.abs());
    ((1.0 - decayed) / (1.0 + decayed)).copysign(x)
}

/// e^y for y ≤ 0; e^[`LOWEST`] below that.
#[inline(always)]
fn exp_of_negative(y: f64) -> f64 {
    // Not `max`: that would turn NaN into a number.
    let y = if y < LOWEST { LOWEST } else { y };
    let shifted = y * std::f64::consts::LOG2_E + ROUNDING;
    let power = shifted - ROUNDING;
    let r = (y - power * LN_2[0]) - power * LN_2[1];
    let two_to_power = f64::from_bits(shifted.to_bits().wrapping_add(EXPONENT.0) << EXPONENT.1);
    two_to_power * exp_near_zero(r)
}

/// e^r for |r| ≤ ½ ln 2: its Taylor series to r¹³, of which the rest is below 1e-17.
#[inline(always)]
fn exp_near_zero(r: f64) -> f64 {
    const C: [f64; 14] = inverse_factorials();
    let r2 = r * r;
    let r4 = r2 * r2;
    let pair = |i: usize| C[i] + C[i + 1] * r;
    let four = |i: usize| pair(i) + pair(i + 2) * r2;
    (four(0) + four(4) * r4) + (four(8) + pair(12) * r4) * (r4 * r4)
}

const fn inverse_factorials() -> [f64; 14] {
    let mut inverse = [1.0; 14];
    let mut factorial = 1.0;
    let mut i = 1;
    while i < inverse.len() {
        factorial *= i as f64;
        inverse[i] = 1.0 / factorial;
        i += 1;
    }
    inverse
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A few of the last places of numbers below 1.
    const TOLERANCE: f64 = 1e-15;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(20_000))]
        #[test]
        fn it_is_the_librarys_to_the_last_places(x in -25.0..25.0f64, scale in 1e-12..1.0f64) {
            for x in [x, x * scale] {
                prop_assert!((tanh(x) - x.tanh()).abs() <= TOLERANCE, "{} {}", tanh(x), x.tanh());
                prop_assert_eq!(tanh(-x).to_bits(), (-tanh(x)).to_bits());
            }
        }
    }

    #[test]
    fn far_out_it_is_one_and_not_a_number_stays_that() {
        for x in [20.0, 50.0, 1e300, f64::INFINITY] {
            assert_eq!((tanh(x), tanh(-x)), (1.0, -1.0));
        }
        assert_eq!(tanh(0.0), 0.0);
        assert!(tanh(f64::NAN).is_nan());
    }
}
