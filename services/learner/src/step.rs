//! The answer to one frame: a set-point, and what was learnt.
//!
//! [`Learner`] is the whole state: serialised after an answer and restored in another process, it goes on
//! bit for bit as if nothing had happened. No clock, no thread: time is the exposure of the frames, and a
//! batch refit is handed out and its result taken back:
//!
//! ```text
//! on frame n:  if a refit is running:  learner.merge(&its result)     in lock-step wait for it
//!              output = learner.step(&input)                          publish, save the state
//!              if learner.refit_number() is one that is not running:  run refit(&learner.refit_job())
//! ```
//!
//! The next move waits for the result, or for [`Parameters::refit_deadline`].

use pursuit_learning::{ClockOffset, Merge, Network, Normalisation, RefitJob, RefitResult, Trainer};
use pursuit_messages::{LearnerState, MAX_WEIGHTS, Phase, SetPoint};
use serde::{Deserialize, Serialize};

use crate::background::Lessons;
use crate::config::Parameters;
pub use crate::moment::Input;
use crate::moment::Moment;
use crate::refusals::{Refusals, Refused};
use crate::rest::{Motion, Observation};
use crate::sightings::Sightings;
use crate::tracking::Track;

/// The answer to one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Output {
    /// Where the arm shall go.
    pub set_point: SetPoint,
    /// The learner's inside; the time of a refit is the caller's to measure, here it is 0.
    pub state: LearnerState,
}

/// What the learner is doing. There is one of it: that its variants differ in size costs nothing.
#[allow(clippy::large_enum_variant)]
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) enum Activity {
    /// Training: the arm comes to rest and is at rest; looks, then decides.
    Observing(Observation),
    /// Training: one move is under way.
    Moving(Motion),
    /// Training: another target was asked for; the old one was seen at `old_px`.
    AwaitingTarget { since_ns: u64, old_px: Option<[f64; 2]> },
    /// On the way to the pose where tracking begins.
    Homing(Motion),
    /// Following what moves.
    Tracking(Track),
}

/// What the arm is told; position and velocity of the message follow from it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Command {
    /// Come to rest.
    Hold,
    /// Go there, rad, and rest.
    GoTo([f64; 2]),
    /// On the way that leads through `position` with `velocity` at the exposure.
    Follow {
        /// Joints 1 and 2, rad.
        position: [f64; 2],
        /// Their velocities, rad/s.
        velocity: [f64; 2],
    },
}

impl Command {
    /// Its part of a set-point.
    pub fn set_point(&self) -> SetPoint {
        let (follow, position, velocity) = match *self {
            Command::Hold => (0, [0.0; 2], [0.0; 2]),
            Command::GoTo(position) => (1, position, [0.0; 2]),
            Command::Follow { position, velocity } => (1, position, velocity),
        };
        SetPoint { follow, position, velocity, ..SetPoint::default() }
    }
}

/// How far training has come.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Progress {
    pub(crate) moves: u32,
    pub(crate) target_index: u32,
    pub(crate) moves_to_target: u32,
    pub(crate) bootstrap_moves: u32,
    /// Pose at rest from which the target was last seen.
    pub(crate) last_seen_from: [f64; 2],
}

/// The last frame that was answered, for when it is asked for again.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Answer {
    frame: u64,
    command: Command,
    detected: bool,
}

/// The learner: its whole state.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Learner {
    pub(crate) parameters: Parameters,
    pub(crate) trainer: Trainer,
    pub(crate) activity: Activity,
    pub(crate) progress: Progress,
    /// What the arm is told until something else is decided.
    pub(crate) command: Command,
    /// Exposure of the frame at which the last refit became due, ns.
    pub(crate) refit_due_ns: u64,
    /// What was seen of the training target in the move under way.
    pub(crate) sightings: Sightings,
    /// Learning from the background.
    pub(crate) lessons: Lessons,
    pub(crate) clock_offset: ClockOffset,
    pub(crate) refusals: Refusals,
    /// Doubt of what the map said last, rad.
    pub(crate) uncertainty_rad: f64,
    /// Error over the ring after the last refit.
    refit_error: f64,
    answer: Option<Answer>,
}

impl Learner {
    /// An untrained learner.
    ///
    /// # Panics
    /// If a parameter is out of its range: see [`Parameters::fault`].
    pub fn new(parameters: &Parameters, seed: u64) -> Learner {
        if let Some(fault) = parameters.fault() {
            panic!("{fault}");
        }
        Learner {
            parameters: *parameters,
            trainer: Trainer::new(&parameters.learning, seed),
            activity: Activity::Observing(Observation::default()),
            progress: Progress {
                moves: 0,
                target_index: 0,
                moves_to_target: 0,
                bootstrap_moves: 0,
                last_seen_from: parameters.home_rad,
            },
            command: Command::Hold,
            refit_due_ns: 0,
            sightings: Sightings::default(),
            lessons: Lessons::default(),
            clock_offset: ClockOffset::default(),
            refusals: Refusals::default(),
            uncertainty_rad: 0.0,
            refit_error: 0.0,
            answer: None,
        }
    }

    /// One frame. A frame that is not newer than the last gets the last answer again and changes nothing.
    pub fn step(&mut self, input: &Input) -> Output {
        let answer = match self.answer {
            Some(answer) if input.frame <= answer.frame => answer,
            _ => {
                // A frame that cannot be used stops the arm and is forgotten.
                let (command, detected) = match self.moment(input) {
                    Ok(moment) => {
                        let used = self.advance(&moment);
                        (self.command, used)
                    }
                    Err(reason) => {
                        self.refusals.add(reason, 1);
                        (Command::Hold, false)
                    }
                };
                Answer { frame: input.frame, command, detected }
            }
        };
        self.answer = Some(answer);
        Output { set_point: self.set_point(&answer), state: self.report() }
    }

    fn moment(&mut self, input: &Input) -> Result<Moment, Refused> {
        Moment::of(input, self.clock_offset.seconds(), &mut self.refusals)
    }

    /// Takes a frame in; whether its detection was used.
    fn advance(&mut self, moment: &Moment) -> bool {
        match self.activity {
            Activity::Observing(observation) => self.observe_at_rest(observation, moment),
            Activity::Moving(motion) => self.learn_from_move(motion, moment),
            Activity::AwaitingTarget { since_ns, old_px } => self.await_target(since_ns, old_px, moment),
            Activity::Homing(motion) => {
                self.go_home(motion, moment);
                return false;
            }
            Activity::Tracking(track) => {
                self.learn_from_background(moment);
                return self.track(track, moment);
            }
        }
        moment.blob.is_some()
    }

    /// Number of the refit that is due or running; `None` while there is none.
    pub fn refit_number(&self) -> Option<u64> {
        self.trainer.refit_number()
    }

    /// The refit that is due or running: the same job, however often it is asked for, also after a
    /// restore. Allocates.
    pub fn refit_job(&self) -> Option<RefitJob> {
        self.trainer.refit_job()
    }

    /// Takes the result of a refit, in time or late; see [`Trainer::merge`].
    pub fn merge(&mut self, result: &RefitResult) -> Merge {
        let merge = self.trainer.merge(result);
        if merge != Merge::Stale {
            self.refit_error = self.trainer.error();
        }
        merge
    }

    /// Frame numbers or exposures begin anew: forgets everything that a pair of frames must not span, keeps
    /// what was learnt. A move under way counts as never made.
    pub fn start_epoch(&mut self) {
        self.answer = None;
        self.command = Command::Hold;
        self.trainer.start_target();
        self.sightings.clear();
        self.lessons = Lessons::default();
        self.refit_due_ns = 0;
        self.activity = match self.phase() {
            Phase::Training => Activity::Observing(Observation::default()),
            Phase::Homing => Activity::Homing(Motion::to(self.parameters.home_rad, 0)),
            Phase::Tracking => Activity::Tracking(Track::default()),
        };
    }

    /// Counts a frame that never came to [`Learner::step`].
    pub fn refuse(&mut self, reason: Refused) {
        self.refusals.add(reason, 1);
    }

    /// The same learner told to do otherwise from now on; what was learnt stays.
    ///
    /// # Panics
    /// If a parameter is out of its range: see [`Parameters::fault`].
    pub fn set_parameters(&mut self, parameters: &Parameters) {
        if let Some(fault) = parameters.fault() {
            panic!("{fault}");
        }
        self.parameters = *parameters;
    }

    /// The parameters it works with.
    pub fn parameters(&self) -> &Parameters {
        &self.parameters
    }

    /// The live network.
    pub fn network(&self) -> &Network {
        self.trainer.network()
    }

    /// Standard deviation of what the map says, rad of the joint that it is larger for, of a target at `point_px`
    /// from the centre of an image of that half width, seen at the angle `theta2` (rad).
    pub fn uncertainty_rad(&self, point_px: [f64; 2], half_width_px: f64, theta2: f64) -> f64 {
        let normalisation = Normalisation { half_width_px };
        let doubt = self.trainer.doubt(normalisation.input(point_px, theta2));
        let [unit1, unit2] = normalisation.displacement([doubt; 2]);
        unit1.max(unit2)
    }

    /// What the learner is doing, as others see it.
    pub fn phase(&self) -> Phase {
        match self.activity {
            Activity::Observing(_) | Activity::Moving(_) | Activity::AwaitingTarget { .. } => Phase::Training,
            Activity::Homing(_) => Phase::Homing,
            Activity::Tracking(_) => Phase::Tracking,
        }
    }

    fn set_point(&self, answer: &Answer) -> SetPoint {
        SetPoint {
            phase: self.phase() as u32,
            moves: self.progress.moves,
            target_index: self.progress.target_index,
            detected: u32::from(answer.detected),
            ..answer.command.set_point()
        }
    }

    /// The learner's inside as it is now, for who could not ask it for an answer.
    pub fn report(&self) -> LearnerState {
        let counters = self.trainer.counters();
        let mut weights = [0.0; MAX_WEIGHTS];
        let weight_count = self.network().export(&mut weights) as u32;
        LearnerState {
            phase: self.phase() as u32,
            moves: self.progress.moves,
            target_index: self.progress.target_index,
            ring: self.trainer.samples().len() as u32,
            samples: counters.samples,
            version: counters.version,
            refits_merged: counters.refits_merged,
            refits_rejected: counters.refits_rejected,
            refit_ns: 0,
            loss: self.refit_error,
            changes: counters.changes,
            consistent: u32::from(self.lessons.consistent()),
            surprise: self.lessons.doubt(),
            uncertainty_rad: self.uncertainty_rad,
            clock_offset_ns: (self.clock_offset.seconds() * 1e9) as i64,
            lead_ns: crate::rest::nanos(self.lead()),
            refused: self.refusals.counts(),
            weight_count,
            hidden: pursuit_learning::HIDDEN as u32,
            weights,
        }
    }
}
