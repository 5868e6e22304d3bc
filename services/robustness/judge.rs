//! Right or wrong, one pair of frames at a time, and what comes of many (design notes on vision, section 4).

use pursuit_scene::sequences::Truth;
use serde::Serialize;

/// Nearer to the border than this share of the frame's side a target is not asked for.
const BORDER: f64 = 0.03;
/// From this speed relative to the background, px/frame, a target must be found.
const MOVING_PX: f64 = 0.5;
/// Below this one it is at rest, and to tell of it is a false alarm.
const RESTING_PX: f64 = 0.1;
/// A target of which less than this shows, px², is not there.
const LEAST_AREA_PX: f64 = 20.0;
/// An answer is right up to this share of the target's size (square root of its area) ...
const SHARE_OF_SIZE: f64 = 0.5;
/// ... and this share of the frame's side from its centroid.
const SHARE_OF_SIDE: f64 = 0.02;

/// Who says where an unseen target is, is right up to this share of the frame's side.
const SHARE_KNOWN: f64 = 0.06;

/// What a detector says of one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Answer {
    /// Position, px from the centre of the top-left pixel to the right.
    pub u: f64,
    /// As `u`, downward.
    pub v: f64,
    /// Velocity in the image, px/frame to the right.
    pub vu: f64,
    /// As `vu`, downward.
    pub vv: f64,
}

/// How an answer, or none, compares to the truth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Verdict {
    /// The moving target, so far from its true position and velocity.
    Hit { error_px: f64, velocity_error_px: f64 },
    /// Something else while a target moved.
    Wrong,
    /// Nothing while a target moved.
    Missed,
    /// Something while nothing moved.
    FalseAlarm,
    /// Nothing, and nothing moved.
    Quiet,
}

/// The verdict on the answer to the frame of this truth, `size` px a side; `None` where neither answer would be
/// wrong: the target is half hidden, at the border or hardly moves.
pub fn judge(truth: &Truth, answer: Option<Answer>, size: usize) -> Option<Verdict> {
    let speed = length(truth.relative_velocity);
    let side = size as f64;
    let Some(position) = truth.position else {
        return (truth.area_px < LEAST_AREA_PX).then(|| empty(truth, answer, side)).flatten();
    };
    if speed < RESTING_PX {
        return empty(truth, answer, side);
    }
    let inside = position.iter().all(|&p| p > BORDER * side && p < (1.0 - BORDER) * side);
    if !inside || speed <= MOVING_PX {
        return None;
    }
    let Some(Answer { u, v, vu, vv }) = answer else { return Some(Verdict::Missed) };
    let error_px = length([u - position[0], v - position[1]]);
    if error_px <= SHARE_OF_SIZE * truth.area_px.sqrt() + SHARE_OF_SIDE * side {
        let velocity_error_px = length([vu - truth.velocity[0], vv - truth.velocity[1]]);
        Some(Verdict::Hit { error_px, velocity_error_px })
    } else {
        Some(Verdict::Wrong)
    }
}

/// Of a frame in which no moving target can be seen. To know still where one is that rests or is hidden is
/// neither right nor wrong.
fn empty(truth: &Truth, answer: Option<Answer>, side: f64) -> Option<Verdict> {
    let Some(Answer { u, v, .. }) = answer else { return Some(Verdict::Quiet) };
    let near = |centre: [f64; 2]| length([u - centre[0], v - centre[1]]) <= SHARE_KNOWN * side;
    if truth.centre.is_some_and(near) { None } else { Some(Verdict::FalseAlarm) }
}

fn length([x, y]: [f64; 2]) -> f64 {
    x.hypot(y)
}

/// Verdicts on many frames, and the time they took.
#[derive(Clone, Debug, Default)]
pub struct Tally {
    wrong: u64,
    missed: u64,
    false_alarms: u64,
    quiet: u64,
    errors_px: Vec<f64>,
    velocity_errors_px: Vec<f64>,
    steps_us: Vec<f64>,
}

/// What is published of a [`Tally`]: shares are 0 to 1, errors are medians over the hits; `None` where there is
/// nothing to take them of.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Figures {
    /// Pairs of frames that were judged.
    pub pairs: u64,
    /// Those with a moving target.
    pub moving_pairs: u64,
    /// Those in which nothing moves by itself.
    pub empty_pairs: u64,
    /// Share of the moving ones whose target was found.
    pub detected: Option<f64>,
    /// Share of the moving ones whose answer was elsewhere.
    pub wrong: Option<f64>,
    /// Share of the empty ones with an answer.
    pub false_alarms: Option<f64>,
    /// Distance from the target's centroid, px.
    pub error_px: Option<f64>,
    /// Difference to the target's velocity, px/frame.
    pub velocity_error_px: Option<f64>,
    /// Computing time of a step, microseconds.
    pub us_per_frame: Option<f64>,
}

impl Tally {
    /// Counts a verdict.
    pub fn add(&mut self, verdict: Option<Verdict>) {
        match verdict {
            Some(Verdict::Hit { error_px, velocity_error_px }) => {
                self.errors_px.push(error_px);
                self.velocity_errors_px.push(velocity_error_px);
            }
            Some(Verdict::Wrong) => self.wrong += 1,
            Some(Verdict::Missed) => self.missed += 1,
            Some(Verdict::FalseAlarm) => self.false_alarms += 1,
            Some(Verdict::Quiet) => self.quiet += 1,
            None => {}
        }
    }

    /// Notes what one step took, microseconds.
    pub fn add_time(&mut self, step_us: f64) {
        self.steps_us.push(step_us);
    }

    /// Counts all that another one has counted.
    pub fn merge(&mut self, other: &Tally) {
        self.wrong += other.wrong;
        self.missed += other.missed;
        self.false_alarms += other.false_alarms;
        self.quiet += other.quiet;
        self.errors_px.extend(&other.errors_px);
        self.velocity_errors_px.extend(&other.velocity_errors_px);
        self.steps_us.extend(&other.steps_us);
    }

    /// All of several as one.
    pub fn sum<'a>(tallies: impl Iterator<Item = &'a Tally>) -> Tally {
        let mut sum = Tally::default();
        tallies.for_each(|tally| sum.merge(tally));
        sum
    }

    /// Shares and medians.
    pub fn figures(&self) -> Figures {
        let hits = self.errors_px.len() as u64;
        let moving_pairs = hits + self.wrong + self.missed;
        let empty_pairs = self.false_alarms + self.quiet;
        let share = |part: u64, whole: u64| (whole > 0).then(|| part as f64 / whole as f64);
        Figures {
            pairs: moving_pairs + empty_pairs,
            moving_pairs,
            empty_pairs,
            detected: share(hits, moving_pairs),
            wrong: share(self.wrong, moving_pairs),
            false_alarms: share(self.false_alarms, empty_pairs),
            error_px: median(&self.errors_px),
            velocity_error_px: median(&self.velocity_errors_px),
            us_per_frame: median(&self.steps_us),
        }
    }
}

/// The middle value, or half way between the two in the middle.
fn median(values: &[f64]) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let upper = sorted.get(sorted.len() / 2)?;
    let lower = sorted.get((sorted.len() - 1) / 2)?;
    Some(0.5 * (lower + upper))
}
