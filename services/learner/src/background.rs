//! Learning while following: the background's motion between two frames, with the joints' motion between
//! them, is a sample that needs no still target (paper, section 5, future work; design notes on the learner,
//! section 7). And since it comes with every frame, it tells at once when the map no longer fits.

use pursuit_learning::{Landmark, Verdict, View};
use serde::{Deserialize, Serialize};

use crate::moment::Moment;
use crate::refusals::Refused;
use crate::rest::nanos;
use crate::step::Learner;
use std::cmp::Ordering;
use std::time::Duration;

/// What is learnt in one go, as from one move of training: then it is judged, and a refit becomes due.
const LESSON: Duration = Duration::from_millis(1000);
/// The same while the map does not fit.
const SHORT_LESSON: Duration = Duration::from_millis(400);
/// A landmark is given up for a new one after so long: errors of the background's motion add up.
const LANDMARK: Duration = Duration::from_secs(6);
/// The arm turns the image with joint 1. A turn that is off by more, rad, is not the arm's: somebody has
/// knocked the camera.
const TURN_TOLERANCE_RAD: f64 = 0.03;
/// Doubt follows the error of the map with this time constant, s.
const DOUBT_S: f64 = 0.25;
/// ...and what is usual follows doubt with this one.
const USUAL_S: f64 = 10.0;
/// What is usual is never below this.
const LEAST_USUAL: f64 = 0.05;
/// The map is not trusted from a doubt of this, and of so many times what is usual...
const DISTRUST: (f64, f64) = (0.25, 5.0);
/// ...and trusted again below.
const TRUST: (f64, f64) = (0.12, 2.4);

/// What learning from the background remembers.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Lessons {
    /// A still point and the frame in which it was seen last.
    landmark: Option<(Landmark, u64)>,
    landmark_since_ns: u64,
    lesson_since_ns: u64,
    last_ns: u64,
    /// Error of the map about the motion of the image, relative to that motion; an average over
    /// [`DOUBT_S`].
    doubt: f64,
    usual: f64,
    consistent: bool,
}

impl Default for Lessons {
    fn default() -> Lessons {
        Lessons {
            landmark: None,
            landmark_since_ns: 0,
            lesson_since_ns: 0,
            last_ns: 0,
            doubt: 0.0,
            usual: LEAST_USUAL,
            consistent: true,
        }
    }
}

/// What became of the landmark.
enum Followed {
    /// Seen again.
    Into(View),
    /// The next pair that begins where it was seen last will show it.
    NotYet,
    /// No pair will.
    Lost,
}

impl Lessons {
    /// Whether the map foretells how the image moves.
    pub(crate) fn consistent(&self) -> bool {
        self.consistent
    }

    /// How wrong the map is about that now.
    pub(crate) fn doubt(&self) -> f64 {
        self.doubt
    }

    /// The landmark's next view, if it could be followed into this frame.
    fn follow(&mut self, moment: &Moment, rotation_sign: f64) -> Result<Followed, Refused> {
        let Some((mut landmark, frame)) = self.landmark.take() else { return Ok(Followed::Lost) };
        let Some(background) = moment.background else { return Ok(Followed::Lost) };
        match (frame + background.frames).cmp(&moment.frame) {
            Ordering::Equal => {}
            // Pairs overlap: this one begins before the frame in which the landmark was seen last.
            Ordering::Greater => {
                self.landmark = Some((landmark, frame));
                return Ok(Followed::NotYet);
            }
            Ordering::Less => return Ok(Followed::Lost),
        }
        let turned = -rotation_sign * (moment.joints[0] - landmark.view().joints[0]);
        if background.turn_rad.is_some_and(|turn| (turn - turned).abs() > TURN_TOLERANCE_RAD) {
            return Err(Refused::Unexplained);
        }
        landmark.advance(background.shift_px, (moment.joints, moment.velocities), rotation_sign);
        self.landmark = Some((landmark, moment.frame));
        Ok(Followed::Into(*landmark.view()))
    }

    /// Takes in how wrong the map was about the newest motion.
    fn take(&mut self, error: f64, now_ns: u64) {
        let passed_s = now_ns.saturating_sub(self.last_ns) as f64 * 1e-9;
        self.last_ns = now_ns;
        self.doubt += (1.0 - (-passed_s / DOUBT_S).exp()) * (error - self.doubt);
        let beyond = |(least, times): (f64, f64)| self.doubt > f64::max(least, times * self.usual);
        self.consistent = if self.consistent { !beyond(DISTRUST) } else { !beyond(TRUST) };
        if self.consistent {
            let usual = self.usual + (1.0 - (-passed_s / USUAL_S).exp()) * (self.doubt - self.usual);
            self.usual = usual.max(LEAST_USUAL);
        }
    }
}

impl Learner {
    /// Learns from how the background moved up to this frame.
    pub(crate) fn learn_from_background(&mut self, moment: &Moment) {
        if !self.parameters.learn_while_following {
            return;
        }
        let mut lessons = self.lessons;
        match lessons.follow(moment, self.parameters.learning.rotation_sign) {
            Ok(Followed::NotYet) => {}
            Ok(Followed::Into(view)) => {
                self.time(moment.sighting(view), &moment.normalisation);
                if let Some(error) = self.trainer.observe(view, &moment.normalisation) {
                    let trusted = lessons.consistent;
                    lessons.take(error, moment.now_ns);
                    if trusted && !lessons.consistent {
                        // What this lesson has seen is enough to judge by.
                        lessons.lesson_since_ns = 0;
                    }
                }
                self.end_lesson(&mut lessons, view, moment.now_ns);
            }
            broken => {
                if let Err(reason) = broken {
                    self.refusals.add(reason, 1);
                }
                self.begin_landmark(&mut lessons, moment);
            }
        }
        self.lessons = lessons;
    }

    fn begin_landmark(&mut self, lessons: &mut Lessons, moment: &Moment) {
        let landmark = Landmark::in_the_middle(moment.joints, moment.velocities);
        lessons.landmark = Some((landmark, moment.frame));
        (lessons.landmark_since_ns, lessons.lesson_since_ns) = (moment.now_ns, moment.now_ns);
        lessons.last_ns = moment.now_ns;
        self.clock_offset.restart();
        self.trainer.start_target();
        self.trainer.start_move(Some(*landmark.view()));
    }

    /// Ends the lesson where it is over, and begins the next.
    fn end_lesson(&mut self, lessons: &mut Lessons, view: View, now_ns: u64) {
        let length = if lessons.consistent { LESSON } else { SHORT_LESSON };
        if now_ns < lessons.lesson_since_ns + nanos(length) || !self.trainer.can_judge() {
            return;
        }
        self.settle_clock();
        let review = self.trainer.finish_move();
        lessons.lesson_since_ns = now_ns;
        if review.verdict == Verdict::Changed {
            // What was usual was so of the map before.
            lessons.usual = LEAST_USUAL;
        }
        self.refit_due_ns = now_ns;
        self.trainer.start_move(Some(view));
        if now_ns >= lessons.landmark_since_ns + nanos(LANDMARK) {
            lessons.landmark = None;
        }
    }
}
