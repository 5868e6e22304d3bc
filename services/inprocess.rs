//! The whole loop in one process and one thread, for experiments over many seeds: the same pure steps in
//! the same order as in lock-step with processes, hence the same bits (a test holds the two together).

use crate::check::Checked;
use pursuit_acquisition::config::Source;
use pursuit_acquisition::view_of;
use pursuit_arm_driver::step::{Driver, Drives};
use pursuit_learner::step::{Input, Learner, Output};
use pursuit_learning::refit;
use pursuit_messages::payload::Votes;
use pursuit_messages::{Phase, Stamp, WorldState};
use pursuit_motion::{Image, NoProbe, Older};
use pursuit_scene::Scene;
use pursuit_segmentation::step::Segmenter;
use pursuit_simulator::cell::{Cell, Fixed};
use pursuit_simulator::journal::{MoveRecord, Record};
use pursuit_vision::eye::Eye;
use std::collections::VecDeque;

/// Lock-step has one epoch; the simulator's is the same.
const EPOCH: u64 = 1;

/// What a run came to.
pub struct Outcome {
    /// One record per frame.
    pub records: Vec<Record>,
    /// One record per training move.
    pub moves: Vec<MoveRecord>,
    /// The whole trajectory as one number.
    pub trajectory_sha256: String,
}

/// What answers a frame.
pub trait Hand {
    /// The answer to a frame.
    fn answer(&mut self, input: &Input) -> Output;
}

/// The learner with its refits done at once: the result of one is there before the next frame, as in
/// lock-step.
impl Hand for Learner {
    fn answer(&mut self, input: &Input) -> Output {
        if let Some(job) = self.refit_job() {
            self.merge(&refit(&job, || true));
        }
        self.step(input)
    }
}

/// Runs a config to its configured number of tracking frames.
///
/// # Errors
/// A sentence that says what cannot be.
pub fn run(checked: &Checked) -> Result<Outcome, String> {
    let mut learner = Learner::new(&checked.learner.parameters, checked.learner.run.seed);
    run_with(checked, &mut learner, |_| false)
}

/// Runs a config up to the end of training: what was learnt.
///
/// # Errors
/// A sentence that says what cannot be.
pub fn train(checked: &Checked) -> Result<Learner, String> {
    let mut learner = Learner::new(&checked.learner.parameters, checked.learner.run.seed);
    run_with(checked, &mut learner, |learner| learner.phase() != Phase::Training)?;
    Ok(learner)
}

/// Follows with what was learnt in another run, from homing on and to the configured number of tracking
/// frames. The hand is in a cell of its own, at its start pose; [`Learner::start_epoch`] comes first.
///
/// # Errors
/// A sentence that says what cannot be.
pub fn follow<H: Hand>(checked: &Checked, hand: &mut H) -> Result<Outcome, String> {
    run_with(checked, hand, |_| false)
}

fn run_with<H: Hand>(
    checked: &Checked,
    hand: &mut H,
    is_enough: impl Fn(&H) -> bool,
) -> Result<Outcome, String> {
    let text = |error: &dyn std::fmt::Display| error.to_string();
    let Source::Simulated(scene) = &checked.acquisition.source else {
        return Err("an experiment needs acquisition.source = \"simulated\"".to_owned());
    };
    let fixed = Fixed::new(&checked.simulator.cell).map_err(|e| text(&e))?;
    let mut cell = Cell::new(&fixed).map_err(|e| text(&e))?;
    let mut eyes = Eyes::new(checked, Scene::new(scene))?;
    let driver = Driver::new(checked.arm.parameters, checked.arm.coupling).map_err(|e| text(&e))?;
    let mut outcome = Outcome { records: Vec::new(), moves: Vec::new(), trajectory_sha256: String::new() };
    while !cell.is_finished(&fixed) && !is_enough(hand) {
        let world = cell.state(&fixed);
        let stamp = Stamp::new(EPOCH, cell.frame, world.time_ns, checked.acquisition.camera.shape());
        let target = eyes.see(&world, cell.frame)?;
        let output = hand.answer(&Input {
            frame: cell.frame,
            exposure_ns: stamp.exposure_ns,
            image: stamp.image,
            target,
            joints: [world.position[0], world.position[1]],
            velocities: [world.velocity[0], world.velocity[1]],
        });
        let drives = Drives {
            position: world.position,
            velocity: world.velocity,
            issued_position: world.issued_position,
            issued_velocity: world.issued_velocity,
        };
        let set_point = Some((&output.set_point, &stamp));
        let command = driver.step(world.time_ns, EPOCH, &drives, set_point, checked.arm.cycles_per_frame);
        let message = command.message(checked.arm.parameters.cycle_ns, output.set_point);
        let frame = cell.frame;
        let (record, moved) =
            cell.take(&fixed, frame, &message, Some(&output.state)).map_err(|e| text(&e))?;
        outcome.records.push(record);
        outcome.moves.extend(moved);
        let next_ns = cell.time_ns + checked.simulator.cell.frame_period_ns;
        cell.advance(&fixed, next_ns).map_err(|e| text(&e))?;
        cell.frame += 1;
    }
    outcome.trajectory_sha256 = cell.trajectory_sha256();
    Ok(outcome)
}

/// Camera, vision and segmentation in one.
struct Eyes {
    scene: Scene,
    eye: Eye,
    segmenter: Segmenter,
    votes: Box<Votes>,
    newer: Vec<u8>,
    /// The frames before, the newest at the back, at most as many as the baseline.
    older: VecDeque<Vec<u8>>,
    baseline: usize,
    size: (usize, usize),
}

impl Eyes {
    fn new(checked: &Checked, scene: Scene) -> Result<Eyes, String> {
        let shape = checked.vision.camera.shape();
        let size = (shape.width as usize, shape.height as usize);
        Ok(Eyes {
            scene,
            eye: Eye::new(size.0, size.1, &checked.vision.detector).map_err(|e| e.to_string())?,
            segmenter: Segmenter::new(&checked.segmentation),
            votes: Box::default(),
            newer: vec![0; size.0 * size.1],
            older: VecDeque::new(),
            baseline: checked.vision.baseline() as usize,
            size,
        })
    }

    fn see(&mut self, world: &WorldState, frame: u64) -> Result<pursuit_messages::Target, String> {
        let (width, height) = self.size;
        self.scene.render(&view_of(world, frame), &mut self.newer, width).map_err(|e| e.to_string())?;
        let newer = Image::new(&self.newer, width, height, width).map_err(|e| e.to_string())?;
        let older = match self.older.front() {
            None => Older::Missing,
            Some(pixels) => {
                let image = Image::new(pixels, width, height, width).map_err(|e| e.to_string())?;
                // With a baseline of one frame it is what the engine saw last.
                if self.baseline == 1 { Older::LastNewer(image) } else { Older::Frame(image) }
            }
        };
        self.eye.look(older, newer, self.older.len() as u32, &mut self.votes, &mut NoProbe);
        let target = self.segmenter.answer((EPOCH, frame), &self.votes, Some(newer));
        let full = self.older.len() == self.baseline;
        let free = if full { self.older.pop_front() } else { None };
        let free = free.unwrap_or_else(|| vec![0; width * height]);
        self.older.push_back(std::mem::replace(&mut self.newer, free));
        Ok(target)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::check;

    /// How far the blob was seen from where it is, px, in the first frames of a run at rest; infinite where
    /// it was not seen.
    fn errors_px(set: &[&str]) -> Vec<f64> {
        let set: Vec<String> = set.iter().map(|set| (*set).to_owned()).collect();
        let checked = check::all(&check::document(None, &set).unwrap()).unwrap();
        let Source::Simulated(scene) = &checked.acquisition.source else { unreachable!() };
        let fixed = Fixed::new(&checked.simulator.cell).unwrap();
        let mut cell = Cell::new(&fixed).unwrap();
        let mut eyes = Eyes::new(&checked, Scene::new(scene)).unwrap();
        let error = |frame: u64| {
            cell.frame = frame;
            let world = cell.state(&fixed);
            let blob = eyes.see(&world, frame).unwrap().blob;
            let [u, v] = truth_px(&world);
            if blob.found == 1 { (blob.u - u).hypot(blob.v - v) } else { f64::INFINITY }
        };
        (0..60).map(error).collect()
    }

    /// The pinhole equation for a camera that looks straight down.
    fn truth_px(world: &WorldState) -> [f64; 2] {
        let [x, y, _, _] = world.camera_rotation;
        let yaw = 2.0 * y.atan2(x);
        let offset = [0, 1].map(|k| world.target_position[k] - world.camera_position[k]);
        let scale = world.focal_px / world.camera_position[2];
        let (sin, cos) = yaw.sin_cos();
        [
            255.5 + scale * (cos * offset[0] + sin * offset[1]),
            255.5 + scale * (sin * offset[0] - cos * offset[1]),
        ]
    }

    #[test]
    fn a_glare_on_every_frame_misleads_and_none_does_not() {
        let clear = errors_px(&["run.seed=4"]);
        assert!(clear.iter().all(|error| *error < 1.0), "{clear:?}");
        let glaring = errors_px(&["run.seed=4", "simulator.glare_share=1.0"]);
        let wrong = glaring.iter().filter(|error| **error > 10.0 && error.is_finite()).count();
        assert!(wrong >= 57, "{wrong} of 60 are wrong: {glaring:?}");
        let some = errors_px(&["run.seed=4", "simulator.glare_share=0.2"]);
        let wrong = some.iter().filter(|error| **error > 10.0).count();
        assert!((4..=22).contains(&wrong), "{wrong} of 60");
    }

    #[test]
    fn a_changed_lens_and_a_turned_camera_are_what_is_rendered() {
        let set = [
            "run.seed=4",
            "change.when=start",
            "change.mount_deg=90",
            "change.focal_factor=0.7",
            "change.forearm_factor=1.1",
        ];
        let errors = errors_px(&set);
        assert!(errors.iter().all(|error| *error < 1.0), "{errors:?}");
    }
}
