//! Oracles: quadratics with a known minimum, Rosenbrock's valley, the definition of the restarts.

use super::*;
use crate::test_functions::{Quadratic, rosenbrock};
use proptest::prelude::*;

fn length<const N: usize>(v: &[f64; N]) -> f64 {
    dot(v, v).sqrt()
}

/// Iterations to |g| < 1e-10 |g0| with an all but exact line search.
fn iterations_on_quadratic<const N: usize>(seed: u64) -> u32 {
    let quadratic = Quadratic::<N>::random(seed, 50.0);
    let mut objective = |x: &[f64; N], g: &mut [f64; N]| quadratic.value(x, g);
    let mut descent = Descent::new(&mut objective, [0.0; N], 1e-9);
    let start = length(descent.gradient());
    let mut iterations = 0;
    while length(descent.gradient()) > 1e-10 * start {
        assert!(descent.iterate(&mut objective), "stuck after {iterations} iterations");
        iterations += 1;
        assert!(iterations <= 10 * N as u32);
    }
    iterations
}

#[test]
fn a_quadratic_of_n_variables_takes_n_iterations() {
    for seed in 0..8 {
        assert!(iterations_on_quadratic::<5>(seed) <= 5);
        assert!(iterations_on_quadratic::<20>(seed) <= 20);
    }
}

#[test]
fn rosenbrocks_valley_is_followed_to_its_end() {
    let mut objective = rosenbrock;
    let mut descent = Descent::new(&mut objective, [-1.2, 1.0], CURVATURE);
    let mut iterations = 0;
    while length(descent.gradient()) > 1e-8 {
        assert!(descent.iterate(&mut objective));
        iterations += 1;
        assert!(iterations <= 150);
    }
    assert!((descent.point()[0] - 1.0).abs() < 1e-7 && (descent.point()[1] - 1.0).abs() < 1e-7);
}

proptest! {
    #[test]
    fn the_value_never_rises(x in -3.0..3.0f64, y in -3.0..3.0f64) {
        let mut objective = rosenbrock;
        let mut descent = Descent::new(&mut objective, [x, y], CURVATURE);
        for _ in 0..60 {
            let before = descent.value();
            descent.iterate(&mut objective);
            prop_assert!(descent.value() <= before);
        }
    }
}

#[test]
fn the_first_step_goes_straight_down() {
    let mut objective = rosenbrock;
    let start = [-1.2, 1.0];
    let mut descent = Descent::new(&mut objective, start, CURVATURE);
    let gradient = *descent.gradient();
    descent.iterate(&mut objective);
    let moved = [descent.point()[0] - start[0], descent.point()[1] - start[1]];
    assert!(dot(&moved, &gradient) < 0.0);
    assert!(
        (moved[0] * gradient[1] - moved[1] * gradient[0]).abs() < 1e-12 * length(&moved) * length(&gradient)
    );
}

#[test]
fn gradients_that_are_not_orthogonal_restart() {
    assert_eq!(polak_ribiere_plus(&[1.0, 0.0], &[0.5, 1.0]), 0.0);
    assert_eq!(polak_ribiere_plus(&[1.0, 0.0], &[-0.5, 1.0]), 0.0);
    assert!((polak_ribiere_plus(&[1.0, 0.0], &[0.1, 1.0]) - 0.9 / 1.01).abs() < 1e-15);
}

#[test]
fn a_start_that_is_not_finite_stays_where_it_is() {
    let mut objective = |_: &[f64; 2], gradient: &mut [f64; 2]| {
        *gradient = [f64::NAN; 2];
        f64::NAN
    };
    let mut descent = Descent::new(&mut objective, [1.0, 2.0], CURVATURE);
    assert_eq!(descent.run(&mut objective, 60, || true), (Stop::Stuck, 0));
    assert_eq!(descent.point(), &[1.0, 2.0]);
}

#[test]
fn it_can_be_called_off() {
    let mut objective = rosenbrock;
    let mut descent = Descent::new(&mut objective, [-1.2, 1.0], CURVATURE);
    assert_eq!(descent.run(&mut objective, 60, || false), (Stop::Cancelled, 0));
}
