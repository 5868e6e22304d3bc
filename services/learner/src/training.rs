//! Training: look at rest, move once, learn from the move, until it has been done often enough.

use pursuit_learning::consensus::Sighting;
use pursuit_learning::samples::THETA2_MIDDLE_RAD;
use pursuit_learning::{Normalisation, Verdict, View};

use crate::moment::Moment;
use crate::refusals::Refused;
use crate::rest::{Motion, Observation, Sight, nanos};
use crate::step::{Activity, Command, Learner};

/// Fixed first moves (not in the paper): the network knows nothing yet, any motion teaches, and a long one
/// more. Joints that travel different ways arrive at different times, so that even one move bends, and its
/// views span a plane.
const BOOTSTRAP_MOVES: u32 = 2;
/// First move of joints 1 and 2, rad, each towards the middle of its range.
const FIRST_MOVE_RAD: [f64; 2] = [0.7, 0.15];
/// Second move, rad: joint 1 back, joint 2 towards the middle.
const SECOND_MOVE_RAD: [f64; 2] = [0.2, 0.5];
/// Another training target is one that is this far, in half image widths, from where the old one was.
const JUMP_HALF_WIDTHS: f64 = 0.08;

/// A move whose sightings are wild to a larger share than this is not learnt from.
const MOST_WILD: f64 = 0.5;
/// After a change that leaves the map so wrong, relative to the motion, the two fixed moves are made again.
const AT_A_LOSS: f64 = 0.6;

/// Up to this doubt (normalised units) the map is taken at its word...
const KNOWING: f64 = 0.12;
/// ...and from this one on it is ignorant: 0.2 rad, a quarter of the image.
const IGNORANT: f64 = 0.4;
/// Training moves go this share of the way where the map is ignorant: moving is how it learns.
const LEAST_TRUST: f64 = 0.5;
/// A map whose usual surprise is below this can tell the time.
const GOOD_ENOUGH: f64 = 0.3;

impl Learner {
    pub(crate) fn observe_at_rest(&mut self, mut observation: Observation, moment: &Moment) {
        observation.take(moment, &self.parameters);
        self.activity = Activity::Observing(observation);
        if observation.is_complete(&self.parameters) && !self.awaits_refit(moment) {
            self.refusals.add(Refused::Restless, u64::from(observation.is_restless()));
            self.decide(observation.sight(), moment);
        }
    }

    pub(crate) fn learn_from_move(&mut self, mut motion: Motion, moment: &Moment) {
        if let Some(blob) = &moment.blob
            && blob.whole
        {
            if self.parameters.reject_wild {
                self.sightings.push(moment.sighting(blob.view));
            } else {
                self.trainer.observe(blob.view, &moment.normalisation);
            }
        }
        if motion.loses_sight(moment) {
            // The move ends where the arm is: what is out of view teaches nothing.
            self.command = Command::GoTo(moment.joints);
            motion = Motion::to(moment.joints, moment.now_ns);
        }
        let over = motion.is_over_at(moment, &self.parameters);
        self.activity = Activity::Moving(motion);
        if over {
            self.end_move(moment);
        }
    }

    fn end_move(&mut self, moment: &Moment) {
        if self.parameters.reject_wild && !self.learn_what_agrees(&moment.normalisation) {
            self.trainer.discard_move();
        } else {
            let review = self.trainer.finish_move();
            let lost = review.surprise.is_some_and(|surprise| surprise > AT_A_LOSS);
            if review.verdict == Verdict::Changed && review.frame.is_none() && lost {
                self.progress.bootstrap_moves = 0;
            }
        }
        self.sightings.clear();
        self.refit_due_ns = moment.now_ns;
        self.progress.moves += 1;
        self.progress.moves_to_target += 1;
        self.activity = Activity::Observing(Observation::default());
    }

    /// Learns from those sightings of the move that agree with each other; `false` where too few do for any
    /// to be trusted.
    fn learn_what_agrees(&mut self, normalisation: &Normalisation) -> bool {
        let (seen, wild) = self.sightings.keep_agreeing(normalisation.half_width_px);
        self.refusals.add(Refused::Wild, wild as u64);
        if wild as f64 > MOST_WILD * seen as f64 {
            return false;
        }
        self.trainer.start_move(self.sightings.at_rest());
        for index in 0..self.sightings.while_moving().len() {
            let sighting = self.sightings.while_moving()[index];
            self.time(sighting, normalisation);
            self.trainer.observe(sighting.view, normalisation);
        }
        self.settle_clock();
        true
    }

    /// Compares the clocks of camera and joints, by a map that is good enough.
    pub(crate) fn time(&mut self, sighting: Sighting, normalisation: &Normalisation) {
        if self.parameters.find_clock_offset && self.trainer.usual_surprise() < GOOD_ENOUGH {
            let sign = self.parameters.learning.rotation_sign;
            self.clock_offset.observe(sighting, self.trainer.network(), normalisation, sign);
        }
    }

    /// Corrects the clock offset by what was seen since the last time, and what was learnt with a wrong one.
    pub(crate) fn settle_clock(&mut self) {
        let correction_s = self.clock_offset.settle();
        if correction_s != 0.0 {
            self.trainer.retime(correction_s);
        }
    }

    /// The next target is on its way: until it is seen, or time is up, frames may still show the old one.
    pub(crate) fn await_target(&mut self, since_ns: u64, old_px: Option<[f64; 2]>, moment: &Moment) {
        let jump = JUMP_HALF_WIDTHS * moment.normalisation.half_width_px;
        let is_new =
            |point: [f64; 2]| old_px.is_none_or(|old| (point[0] - old[0]).hypot(point[1] - old[1]) > jump);
        let appeared = moment.blob.is_some_and(|blob| is_new(blob.view.point_px));
        let waited = moment.now_ns.saturating_sub(since_ns) >= nanos(self.parameters.target_wait);
        if appeared || waited {
            self.activity = Activity::Observing(Observation::default());
        }
    }

    fn awaits_refit(&self, moment: &Moment) -> bool {
        let waited = moment.now_ns.saturating_sub(self.refit_due_ns);
        self.trainer.refit_number().is_some() && waited < nanos(self.parameters.refit_deadline)
    }

    /// The arm is at rest and has looked: what now?
    fn decide(&mut self, sight: Option<Sight>, moment: &Moment) {
        let parameters = &self.parameters;
        let progress = &self.progress;
        let reach = parameters.reached_half_widths * moment.normalisation.half_width_px;
        let reached = sight.is_some_and(|s| s.view.point_px[0].hypot(s.view.point_px[1]) < reach);
        // A target that was never seen teaches nothing: do not track with what was not learnt.
        let trained = progress.moves >= parameters.training_moves && !self.trainer.samples().is_empty();
        if trained {
            self.command = Command::GoTo(parameters.home_rad);
            self.activity = Activity::Homing(Motion::to(parameters.home_rad, moment.now_ns));
        } else if reached || progress.moves_to_target >= parameters.moves_per_target {
            self.ask_for_target(sight, moment);
        } else {
            self.start_move(sight, moment);
        }
    }

    fn ask_for_target(&mut self, sight: Option<Sight>, moment: &Moment) {
        self.progress.target_index += 1;
        self.progress.moves_to_target = 0;
        self.trainer.start_target();
        let old_px = sight.map(|sight| sight.view.point_px);
        self.activity = Activity::AwaitingTarget { since_ns: moment.now_ns, old_px };
    }

    fn start_move(&mut self, sight: Option<Sight>, moment: &Moment) {
        let mut is_fixed = false;
        let goal = match sight {
            Some(sight) => {
                let fixed = self.bootstrap_displacement(&sight.view);
                is_fixed = fixed.is_some();
                let [theta1, theta2] = sight.view.joints;
                let displacement = match fixed {
                    Some(displacement) => displacement,
                    None => self.displacement(sight.view.point_px, theta2, moment).trusted(LEAST_TRUST),
                };
                self.progress.last_seen_from = sight.view.joints;
                // Always from where the arm was when it looked, never from where it is now.
                [theta1 + displacement[0], theta2 + displacement[1]]
            }
            None => self.progress.last_seen_from,
        };
        let goal = self.parameters.into_envelope(goal);
        // A target that was cut off by the image's edge is good enough to go by, not to learn from.
        let start = sight.filter(|sight| sight.whole).map(|sight| sight.view);
        self.trainer.start_move(start);
        self.sightings.begin(start.map(|view| moment.sighting(view)));
        self.command = Command::GoTo(goal);
        let motion = Motion::to(goal, moment.now_ns);
        self.activity = Activity::Moving(if is_fixed { motion.watched() } else { motion });
    }

    /// The next fixed move, rad; `None` when they have been made.
    fn bootstrap_displacement(&mut self, view: &View) -> Option<[f64; 2]> {
        if !self.parameters.bootstrap || self.progress.bootstrap_moves >= BOOTSTRAP_MOVES {
            return None;
        }
        self.progress.bootstrap_moves += 1;
        let [theta1, theta2] = view.joints;
        let [low, high] = self.parameters.theta1_rad;
        let (towards1, way) = match self.progress.bootstrap_moves {
            1 => (0.5 * (low + high), FIRST_MOVE_RAD),
            _ => (self.progress.last_seen_from[0], SECOND_MOVE_RAD),
        };
        Some([way[0].copysign(towards1 - theta1), way[1].copysign(THETA2_MIDDLE_RAD - theta2)])
    }

    /// What the network says, rad, shortened to what one command may ask, and further where it hardly knows.
    pub(crate) fn displacement(&mut self, point_px: [f64; 2], theta2: f64, moment: &Moment) -> Said {
        let input = moment.normalisation.input(point_px, theta2);
        let output = self.trainer.network().predict(input);
        let doubt = self.trainer.doubt(input);
        let [unit1, unit2] = moment.normalisation.displacement([doubt; 2]);
        self.uncertainty_rad = unit1.max(unit2);
        Said {
            displacement: self.parameters.shortened(moment.normalisation.displacement(output)),
            trust: ((IGNORANT - doubt) / (IGNORANT - KNOWING)).clamp(0.0, 1.0),
        }
    }
}

/// What the map says of a place, and how far it is to be trusted.
pub(crate) struct Said {
    /// Of joints 1 and 2, rad.
    pub(crate) displacement: [f64; 2],
    /// Share of it that may be commanded: 1 where the map knows, 0 where it is ignorant.
    pub(crate) trust: f64,
}

impl Said {
    /// The displacement as far as it is trusted, but this share of it at least.
    pub(crate) fn trusted(&self, least: f64) -> [f64; 2] {
        self.displacement.map(|joint| joint * self.trust.max(least))
    }
}
