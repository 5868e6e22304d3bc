//! What must be right for anything to be learnt, shown by getting it wrong: samples of random moves of an
//! exact arm, without any noise.

#![allow(clippy::unwrap_used)]

mod support;

use pursuit_kinematics::exact_move;
use pursuit_learning::{GridCase, Settings, Trainer, evaluate_grid, refit};
use rand::RngExt;
use support::Bench;

const MOVES: u32 = 20;
/// Without noise the recommended scheme is below this after [`MOVES`], median over seeds...
const LEARNT_M: f64 = 0.01;
/// ...and a wrong sample never gets below this.
const NOT_LEARNT_M: f64 = 0.02;

/// Median one-shot error after [`MOVES`] random moves, m.
fn learn(seed: u64, settings: &Settings, late: f64) -> f64 {
    let mut bench = Bench::new(seed);
    let mut trainer = Trainer::new(settings, bench.rng.random());
    for _ in 0..MOVES {
        bench.make_move(&mut trainer, late);
        trainer.merge(&refit(&trainer.refit_job().unwrap(), || true));
    }
    error(&mut bench, &trainer)
}

/// Median one-shot error over random cases, m.
fn error(bench: &mut Bench, trainer: &Trainer) -> f64 {
    let mut cases = Vec::new();
    while cases.len() < 200 {
        let theta2 = bench.pose()[1];
        let point_px = [bench.rng.random_range(-250.0..250.0), bench.rng.random_range(-250.0..250.0)];
        let to = exact_move(&bench.coupling, &bench.camera, point_px, theta2);
        if to.is_some_and(|[_, d2]| bench.coupling.envelope().contains([0.0, theta2 + d2], 0.0)) {
            cases.push(GridCase { point_px, theta2 });
        }
    }
    let error = evaluate_grid(trainer.network(), &bench.normalisation(), &cases, |case, command| {
        let exact = exact_move(&bench.coupling, &bench.camera, case.point_px, case.theta2).unwrap();
        let over = |[d1, d2]: [f64; 2]| bench.coupling.camera_xy(d1, (case.theta2 + d2).clamp(-0.3, 1.06));
        let (a, b) = (over(command), over(exact));
        (a[0] - b[0]).hypot(a[1] - b[1])
    });
    error.median
}

#[test]
fn right_samples_are_learnt() {
    let mut errors: Vec<f64> = (0..9).map(|seed| learn(seed, &Settings::recommended(), 0.0)).collect();
    errors.sort_by(f64::total_cmp);
    assert!(errors[4] < LEARNT_M, "{errors:?}");
}

#[test]
fn with_the_wrong_rotation_sign_nothing_is_learnt() {
    for seed in 0..2 {
        let mirrored = Settings { rotation_sign: 1.0, ..Settings::recommended() };
        let error = learn(seed, &mirrored, 0.0);
        assert!(error > NOT_LEARNT_M, "{error}");
    }
}

#[test]
fn without_the_rotation_of_the_image_nothing_is_learnt() {
    for seed in 0..2 {
        let unturned = Settings { rotation_sign: 0.0, ..Settings::recommended() };
        let error = learn(seed, &unturned, 0.0);
        assert!(error > NOT_LEARNT_M, "{error}");
    }
}

/// Two frames late of ten.
#[test]
fn with_joints_read_too_late_nothing_is_learnt() {
    for seed in 0..2 {
        let error = learn(seed, &Settings::recommended(), 0.2);
        assert!(error > NOT_LEARNT_M, "{error}");
    }
}
