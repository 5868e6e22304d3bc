//! Random moves of an exact arm, without any noise.

#![allow(dead_code, clippy::unwrap_used)]

use pursuit_kinematics::{Arm, Camera, Coupling};
use pursuit_learning::{Normalisation, RefitJob, Settings, Trainer, View, refit};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Views of one move.
pub const VIEWS_PER_MOVE: u32 = 10;

/// An arm, and random moves of it.
pub struct Bench {
    pub coupling: Coupling,
    pub camera: Camera,
    pub rng: ChaCha8Rng,
}

impl Bench {
    pub fn new(seed: u64) -> Bench {
        Bench {
            coupling: Coupling::new(&Arm::puma_like(), 0.5).unwrap(),
            camera: Camera::default_cell(),
            rng: ChaCha8Rng::seed_from_u64(seed),
        }
    }

    pub fn normalisation(&self) -> Normalisation {
        Normalisation { half_width_px: f64::from(self.camera.width) / 2.0 }
    }

    pub fn pose(&mut self) -> [f64; 2] {
        let [low, high] = self.coupling.envelope().theta2_rad;
        [self.rng.random_range(-0.4..0.4), self.rng.random_range(low..high)]
    }

    pub fn view(&self, target: [f64; 2], joints: [f64; 2]) -> View {
        let all = self.coupling.joints(joints[0], joints[1]).unwrap();
        let pose = self.coupling.arm().base_from_camera(&all, self.camera.mount_rad);
        View {
            point_px: self.camera.project(&pose, [target[0], target[1], 0.0]).unwrap(),
            joints,
            ..View::default()
        }
    }

    /// One move to a target of its own. `late` is the share of the move by which joints are read too late.
    pub fn make_move(&mut self, trainer: &mut Trainer, late: f64) {
        let normalisation = self.normalisation();
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
    }
}

/// The refit that is due after so many moves, those before done.
pub fn job_after(moves: u32, seed: u64, settings: &Settings) -> RefitJob {
    let mut bench = Bench::new(seed);
    let mut trainer = Trainer::new(settings, seed);
    for _ in 1..moves {
        bench.make_move(&mut trainer, 0.0);
        trainer.merge(&refit(&trainer.refit_job().unwrap(), || true));
    }
    bench.make_move(&mut trainer, 0.0);
    trainer.refit_job().unwrap()
}
