//! What must be right for anything to be learnt, shown by getting it wrong: samples of random moves of an
//! exact arm, without any noise.

#![allow(clippy::unwrap_used)]

use pursuit_kinematics::{Arm, Camera, Coupling, exact_move};
use pursuit_learning::{GridCase, Normalisation, Settings, Trainer, View, evaluate_grid, refit};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const MOVES: u32 = 20;
const VIEWS_PER_MOVE: u32 = 10;
/// Without noise the recommended scheme is below this after [`MOVES`], median over seeds...
const LEARNT_M: f64 = 0.01;
/// ...and a wrong sample never gets below this.
const NOT_LEARNT_M: f64 = 0.02;

struct Bench {
    coupling: Coupling,
    camera: Camera,
    rng: ChaCha8Rng,
}

impl Bench {
    fn new(seed: u64) -> Bench {
        Bench {
            coupling: Coupling::new(&Arm::puma_like(), 0.5).unwrap(),
            camera: Camera::default_cell(),
            rng: ChaCha8Rng::seed_from_u64(seed),
        }
    }

    fn normalisation(&self) -> Normalisation {
        Normalisation { half_width_px: f64::from(self.camera.width) / 2.0 }
    }

    fn pose(&mut self) -> [f64; 2] {
        let [low, high] = self.coupling.envelope().theta2_rad;
        [self.rng.random_range(-0.4..0.4), self.rng.random_range(low..high)]
    }

    fn view(&self, target: [f64; 2], joints: [f64; 2]) -> View {
        let all = self.coupling.joints(joints[0], joints[1]).unwrap();
        let pose = self.coupling.arm().base_from_camera(&all, self.camera.mount_rad);
        View {
            point_px: self.camera.project(&pose, [target[0], target[1], 0.0]).unwrap(),
            joints,
            ..View::default()
        }
    }

    /// Median one-shot error after [`MOVES`] random moves, each to a target of its own, m. `late` is the
    /// share of a view's motion by which its joints are read too late.
    fn learn(&mut self, settings: &Settings, late: f64) -> f64 {
        let normalisation = self.normalisation();
        let mut trainer = Trainer::new(settings, self.rng.random());
        for _ in 0..MOVES {
            let (from, to, over) = (self.pose(), self.pose(), self.pose());
            let target = self.coupling.camera_xy(over[0], over[1]);
            let along = |share: f64| [0, 1].map(|joint| from[joint] + share * (to[joint] - from[joint]));
            trainer.start_target();
            trainer.start_move(Some(self.view(target, from)));
            for step in 1..=VIEWS_PER_MOVE {
                let share = f64::from(step) / f64::from(VIEWS_PER_MOVE);
                let mut view = self.view(target, along(share));
                view.joints = along(share + late);
                trainer.observe(view, &normalisation);
            }
            trainer.finish_move();
            trainer.merge(&refit(&trainer.refit_job().unwrap(), || true));
        }
        self.error(&trainer)
    }

    fn error(&mut self, trainer: &Trainer) -> f64 {
        let mut cases = Vec::new();
        while cases.len() < 200 {
            let theta2 = self.pose()[1];
            let point_px = [self.rng.random_range(-250.0..250.0), self.rng.random_range(-250.0..250.0)];
            let to = exact_move(&self.coupling, &self.camera, point_px, theta2);
            if to.is_some_and(|[_, d2]| self.coupling.envelope().contains([0.0, theta2 + d2], 0.0)) {
                cases.push(GridCase { point_px, theta2 });
            }
        }
        let error = evaluate_grid(trainer.network(), &self.normalisation(), &cases, |case, command| {
            let exact = exact_move(&self.coupling, &self.camera, case.point_px, case.theta2).unwrap();
            let over = |[d1, d2]: [f64; 2]| self.coupling.camera_xy(d1, (case.theta2 + d2).clamp(-0.3, 1.06));
            let (a, b) = (over(command), over(exact));
            (a[0] - b[0]).hypot(a[1] - b[1])
        });
        error.median
    }
}

#[test]
fn right_samples_are_learnt() {
    let mut errors: Vec<f64> =
        (0..9).map(|seed| Bench::new(seed).learn(&Settings::recommended(), 0.0)).collect();
    errors.sort_by(f64::total_cmp);
    assert!(errors[4] < LEARNT_M, "{errors:?}");
}

#[test]
fn with_the_wrong_rotation_sign_nothing_is_learnt() {
    for seed in 0..2 {
        let mirrored = Settings { rotation_sign: 1.0, ..Settings::recommended() };
        let error = Bench::new(seed).learn(&mirrored, 0.0);
        assert!(error > NOT_LEARNT_M, "{error}");
    }
}

#[test]
fn without_the_rotation_of_the_image_nothing_is_learnt() {
    for seed in 0..2 {
        let unturned = Settings { rotation_sign: 0.0, ..Settings::recommended() };
        let error = Bench::new(seed).learn(&unturned, 0.0);
        assert!(error > NOT_LEARNT_M, "{error}");
    }
}

/// Two frames late of ten.
#[test]
fn with_joints_read_too_late_nothing_is_learnt() {
    for seed in 0..2 {
        let error = Bench::new(seed).learn(&Settings::recommended(), 0.2);
        assert!(error > NOT_LEARNT_M, "{error}");
    }
}
