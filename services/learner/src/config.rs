//! What can be set about the learner.

use std::f64::consts::PI;
use std::ops::RangeInclusive;
use std::time::Duration;

use pursuit_learning::Settings;
use serde::{Deserialize, Serialize};

/// Which scheme of learning.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Profile {
    /// What learns best: see [`Settings::recommended`].
    #[default]
    Recommended,
    /// Section 3 of the paper to the letter: see [`Settings::paper`].
    Paper,
}

/// How a target is followed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Controller {
    /// The paper's: the set-point is where the target was seen.
    Plain,
    /// The set-point is where the target will be: see [`Follower`](crate::follower::Follower).
    #[default]
    Predictive,
}

/// The time from a set-point to its effect, over which the predictive law predicts.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Lead {
    /// Measured while following: see [`delay`](crate::delay).
    Measured {
        /// What it is until it has been measured.
        prior: Duration,
    },
    /// This.
    Fixed(Duration),
}

impl Lead {
    /// What it is before anything is measured.
    pub fn prior(&self) -> Duration {
        match *self {
            Lead::Measured { prior } | Lead::Fixed(prior) => prior,
        }
    }
}

/// Permitted [`Parameters::training_moves`].
pub const TRAINING_MOVES: RangeInclusive<u32> = 1..=1000;
/// Permitted [`Parameters::moves_per_target`].
pub const MOVES_PER_TARGET: RangeInclusive<u32> = 1..=100;
/// Permitted [`Parameters::still_frames`].
pub const STILL_FRAMES: RangeInclusive<u32> = 1..=MAX_STILL_FRAMES as u32;
/// Permitted memory of samples, [`Settings::memory`].
pub const MEMORY: RangeInclusive<u32> = 4..=1000;
/// Permitted [`Settings::eta`].
pub const ETA: RangeInclusive<f64> = 0.0..=1.0;
/// Permitted [`Settings::iterations`]; 0 is online learning alone.
pub const ITERATIONS: RangeInclusive<u32> = 0..=1000;
/// Permitted [`Settings::rotation_sign`]: the sign alone counts.
pub const ROTATION_SIGNS: [f64; 2] = [-1.0, 1.0];

/// Room for the frames of one observation at rest.
pub const MAX_STILL_FRAMES: usize = 9;

/// All parameters of the learner. Every one has a default; [`Parameters::fault`] says what is out of
/// range.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Parameters {
    /// How samples are made, kept and learnt.
    pub learning: Settings,
    /// Moves after which tracking begins, [`TRAINING_MOVES`].
    pub training_moves: u32,
    /// Moves to one training target before another is asked for, [`MOVES_PER_TARGET`].
    pub moves_per_target: u32,
    /// Whether the first two moves are fixed ones.
    pub bootstrap: bool,
    /// Joints 1 and 2 where tracking begins, rad, inside the envelope.
    pub home_rad: [f64; 2],
    /// Lowest and highest angle of joint 1, rad.
    pub theta1_rad: [f64; 2],
    /// Lowest and highest angle of joint 2, rad.
    pub theta2_rad: [f64; 2],
    /// Longest displacement of joints 1 and 2 in one command, rad, > 0; longer ones are scaled down.
    pub max_displacement_rad: [f64; 2],
    /// A training target this close to the image's centre has been reached, in half image widths, > 0.
    pub reached_half_widths: f64,
    /// Joints slower than this are still, rad/s, > 0.
    pub still_rad_per_s: f64,
    /// A joint this close to its set-point has arrived, rad, > 0.
    pub arrived_rad: f64,
    /// Frames in a row that the arm must be still before it counts as at rest, ≥ 1.
    pub settle_frames: u32,
    /// Frames at rest whose median is looked at before a move, [`STILL_FRAMES`].
    pub still_frames: u32,
    /// An arm that is still for so long is at the end of its move, wherever it is.
    pub stall: Duration,
    /// Longest move.
    pub move_limit: Duration,
    /// How long the next training target is waited for at most.
    pub target_wait: Duration,
    /// How long the result of a refit is waited for before the next move.
    pub refit_deadline: Duration,
    /// Whether sightings of a training target that do not agree with their neighbours are left out.
    pub reject_wild: bool,
    /// Whether learning goes on while a target is followed, from the background.
    pub learn_while_following: bool,
    /// Whether the offset between the clocks of camera and joints is found out and made up for.
    pub find_clock_offset: bool,
    /// How the target is followed.
    pub controller: Controller,
    /// Time from a set-point to its effect, over which the predictive law predicts.
    pub lead: Lead,
    /// Standard deviation of a detection until it has been measured, px, > 0.
    pub measurement_px: f64,
    /// Without a detection for so long, the arm stops.
    pub lost_after: Duration,
    /// Without a detection for so long, it goes home.
    pub return_after: Duration,
}

impl Parameters {
    /// [`Parameters::training_moves`] unless set: the error has levelled off (design, section 4.1).
    pub const DEFAULT_TRAINING_MOVES: u32 = 30;
    /// [`Parameters::moves_per_target`] unless set: enough to come within 1 cm of the first one.
    pub const DEFAULT_MOVES_PER_TARGET: u32 = 6;
    /// [`Parameters::home_rad`] unless set: in the middle of the envelope.
    pub const DEFAULT_HOME_RAD: [f64; 2] = [0.0, 0.6];
    /// [`Parameters::theta1_rad`] unless set: ±150°.
    pub const DEFAULT_THETA1_RAD: [f64; 2] = [-150.0 * PI / 180.0, 150.0 * PI / 180.0];
    /// [`Parameters::theta2_rad`] unless set: 14° to 55°; below, the arm is stretched, above, joint 3 is
    /// at its limit.
    pub const DEFAULT_THETA2_RAD: [f64; 2] = [14.0 * PI / 180.0, 55.0 * PI / 180.0];
    /// [`Parameters::max_displacement_rad`] unless set: most targets that the default cell sees are one
    /// such move away.
    pub const DEFAULT_MAX_DISPLACEMENT_RAD: [f64; 2] = [0.8, 0.5];
    /// [`Parameters::reached_half_widths`] unless set: 1 cm of the table in the default cell.
    pub const DEFAULT_REACHED_HALF_WIDTHS: f64 = 0.02;
    /// [`Parameters::still_rad_per_s`] unless set: 0.2 px a frame in the default cell.
    pub const DEFAULT_STILL_RAD_PER_S: f64 = 0.01;
    /// [`Parameters::arrived_rad`] unless set.
    pub const DEFAULT_ARRIVED_RAD: f64 = 0.005;
    /// [`Parameters::settle_frames`] unless set.
    pub const DEFAULT_SETTLE_FRAMES: u32 = 2;
    /// [`Parameters::still_frames`] unless set: their median has half the noise of one.
    pub const DEFAULT_STILL_FRAMES: u32 = 5;
    /// [`Parameters::stall`] unless set: longer than any latency of the set-point.
    pub const DEFAULT_STALL: Duration = Duration::from_millis(500);
    /// [`Parameters::move_limit`] unless set.
    pub const DEFAULT_MOVE_LIMIT: Duration = Duration::from_secs(3);
    /// [`Parameters::target_wait`] unless set: longer than any latency of the set-point.
    pub const DEFAULT_TARGET_WAIT: Duration = Duration::from_millis(500);
    /// [`Parameters::refit_deadline`] unless set: 50 times what a refit takes.
    pub const DEFAULT_REFIT_DEADLINE: Duration = Duration::from_millis(200);
    /// [`Parameters::lead`] unless set: the simulated robot's 80 ms and the lag of its servos.
    pub const DEFAULT_LEAD: Lead = Lead::Measured { prior: Duration::from_millis(90) };
    /// [`Parameters::measurement_px`] unless set: what the detector says of itself.
    pub const DEFAULT_MEASUREMENT_PX: f64 = 1.5;
    /// [`Parameters::lost_after`] unless set.
    pub const DEFAULT_LOST_AFTER: Duration = Duration::from_millis(500);
    /// [`Parameters::return_after`] unless set.
    pub const DEFAULT_RETURN_AFTER: Duration = Duration::from_secs(5);

    /// The defaults of a profile.
    pub const fn of(profile: Profile) -> Parameters {
        let recommended = Parameters {
            learning: Settings::recommended(),
            training_moves: Parameters::DEFAULT_TRAINING_MOVES,
            moves_per_target: Parameters::DEFAULT_MOVES_PER_TARGET,
            bootstrap: true,
            home_rad: Parameters::DEFAULT_HOME_RAD,
            theta1_rad: Parameters::DEFAULT_THETA1_RAD,
            theta2_rad: Parameters::DEFAULT_THETA2_RAD,
            max_displacement_rad: Parameters::DEFAULT_MAX_DISPLACEMENT_RAD,
            reached_half_widths: Parameters::DEFAULT_REACHED_HALF_WIDTHS,
            still_rad_per_s: Parameters::DEFAULT_STILL_RAD_PER_S,
            arrived_rad: Parameters::DEFAULT_ARRIVED_RAD,
            settle_frames: Parameters::DEFAULT_SETTLE_FRAMES,
            still_frames: Parameters::DEFAULT_STILL_FRAMES,
            stall: Parameters::DEFAULT_STALL,
            move_limit: Parameters::DEFAULT_MOVE_LIMIT,
            target_wait: Parameters::DEFAULT_TARGET_WAIT,
            refit_deadline: Parameters::DEFAULT_REFIT_DEADLINE,
            reject_wild: true,
            learn_while_following: true,
            find_clock_offset: true,
            controller: Controller::Predictive,
            lead: Parameters::DEFAULT_LEAD,
            measurement_px: Parameters::DEFAULT_MEASUREMENT_PX,
            lost_after: Parameters::DEFAULT_LOST_AFTER,
            return_after: Parameters::DEFAULT_RETURN_AFTER,
        };
        match profile {
            Profile::Recommended => recommended,
            Profile::Paper => Parameters {
                learning: Settings::paper(),
                bootstrap: false,
                still_frames: 1,
                reject_wild: false,
                learn_while_following: false,
                find_clock_offset: false,
                controller: Controller::Plain,
                ..recommended
            },
        }
    }

    /// The first parameter that is out of its range, as a sentence that names it; `None` if all is well.
    pub fn fault(&self) -> Option<&'static str> {
        let learning = &self.learning;
        let ordered = |range: [f64; 2]| range[0] < range[1] && range.iter().all(|end| end.is_finite());
        let positive = |value: f64| value > 0.0 && value.is_finite();
        let [home1, home2] = self.home_rad;
        [
            (TRAINING_MOVES.contains(&self.training_moves), "training_moves must be 1 to 1000"),
            (MOVES_PER_TARGET.contains(&self.moves_per_target), "moves_per_target must be 1 to 100"),
            (STILL_FRAMES.contains(&self.still_frames), "still_frames must be 1 to 9"),
            (self.settle_frames >= 1, "settle_frames must be at least 1"),
            (MEMORY.contains(&learning.memory), "memory must be 4 to 1000 samples"),
            (learning.kept_per_move >= 1, "kept_per_move must be at least 1"),
            (positive(learning.min_motion_rad), "min_motion_rad must be positive"),
            (ROTATION_SIGNS.contains(&learning.rotation_sign), "rotation_sign must be -1 or 1"),
            (ETA.contains(&learning.eta), "eta must be 0 to 1"),
            (learning.huber.is_none_or(positive), "huber must be positive"),
            (ITERATIONS.contains(&learning.iterations), "iterations must be 0 to 1000"),
            (ordered(self.theta1_rad), "theta1_rad must be a lower and a higher angle"),
            (ordered(self.theta2_rad), "theta2_rad must be a lower and a higher angle"),
            (
                within(home1, self.theta1_rad) && within(home2, self.theta2_rad),
                "home_rad must be in the envelope",
            ),
            (self.max_displacement_rad.into_iter().all(positive), "max_displacement_rad must be positive"),
            (positive(self.reached_half_widths), "reached_half_widths must be positive"),
            (positive(self.still_rad_per_s), "still_rad_per_s must be positive"),
            (positive(self.arrived_rad), "arrived_rad must be positive"),
            (positive(self.measurement_px), "measurement_px must be positive"),
            (self.lost_after <= self.return_after, "lost_after must not be longer than return_after"),
        ]
        .into_iter()
        .find_map(|(holds, fault)| (!holds).then_some(fault))
    }

    /// The nearest set-point inside the envelope.
    pub fn into_envelope(&self, [theta1, theta2]: [f64; 2]) -> [f64; 2] {
        [
            theta1.clamp(self.theta1_rad[0], self.theta1_rad[1]),
            theta2.clamp(self.theta2_rad[0], self.theta2_rad[1]),
        ]
    }

    /// The displacement, rad, shortened (in its direction) to what one command may ask.
    pub fn shortened(&self, displacement: [f64; 2]) -> [f64; 2] {
        let [limit1, limit2] = self.max_displacement_rad;
        let excess = (displacement[0].abs() / limit1).max(displacement[1].abs() / limit2).max(1.0);
        displacement.map(|joint| joint / excess)
    }
}

impl Default for Parameters {
    fn default() -> Parameters {
        Parameters::of(Profile::default())
    }
}

fn within(value: f64, range: [f64; 2]) -> bool {
    range[0] <= value && value <= range[1]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_profiles_are_in_range() {
        assert_eq!(Parameters::of(Profile::Recommended).fault(), None);
        assert_eq!(Parameters::of(Profile::Paper).fault(), None);
    }

    #[test]
    fn what_is_out_of_range_is_named() {
        let fault = |parameters: Parameters| parameters.fault().unwrap().split(' ').next().unwrap();
        let good = Parameters::default();
        assert_eq!(fault(Parameters { home_rad: [0.0, 1.2], ..good }), "home_rad");
        assert_eq!(fault(Parameters { arrived_rad: f64::NAN, ..good }), "arrived_rad");
        assert_eq!(fault(Parameters { theta2_rad: [1.0, 0.2], ..good }), "theta2_rad");
        let learning = Settings { rotation_sign: 0.0, ..good.learning };
        assert_eq!(fault(Parameters { learning, ..good }), "rotation_sign");
    }

    #[test]
    fn a_displacement_keeps_its_direction_when_it_is_shortened() {
        let parameters = Parameters::default();
        let [d1, d2] = parameters.shortened([1.0, -2.0]);
        assert!((d1 - 0.25).abs() < 1e-15 && (d2 + 0.5).abs() < 1e-15);
        assert_eq!(parameters.shortened([0.1, 0.2]), [0.1, 0.2]);
    }
}
