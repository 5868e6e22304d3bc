//! What was not learnt from, and not followed, counted by reason.

use pursuit_messages::payload::REFUSED;
use serde::{Deserialize, Serialize};

/// Why something that came in was not used. The numbers travel in
/// [`LearnerState::refused`](pursuit_messages::LearnerState::refused).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(usize)]
pub enum Refused {
    /// A number that is not finite, or an image without a size.
    NotFinite = 0,
    /// Joints that no arm can have: see [`MAX_JOINT_RAD`], [`MAX_JOINT_RAD_PER_S`].
    Absurd = 1,
    /// No joint reading for the frame's exposure.
    NoJoints = 2,
    /// A detection outside the image.
    OutsideImage = 3,
    /// A training target that was somewhere else in the frames around.
    Wild = 4,
    /// A training target that does not stand still.
    Restless = 5,
    /// A target where the map is ignorant.
    Ignorant = 6,
    /// A background motion that the arm did not cause.
    Unexplained = 7,
}

impl Refused {
    /// All, in the order of their numbers, each with a few words.
    pub const ALL: [(Refused, &'static str); REFUSED] = [
        (Refused::NotFinite, "not finite"),
        (Refused::Absurd, "absurd joints"),
        (Refused::NoJoints, "no joints at the exposure"),
        (Refused::OutsideImage, "outside the image"),
        (Refused::Wild, "somewhere else in the frames around"),
        (Refused::Restless, "did not stand still"),
        (Refused::Ignorant, "where the map knows nothing"),
        (Refused::Unexplained, "motion that the arm did not cause"),
    ];
}

/// No joint turns further, rad.
pub const MAX_JOINT_RAD: f64 = 4.0 * std::f64::consts::PI;
/// No joint is faster, rad/s.
pub const MAX_JOINT_RAD_PER_S: f64 = 50.0;

/// Counts by reason.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Refusals([u64; REFUSED]);

impl Refusals {
    /// Counts `count` more for this reason.
    pub fn add(&mut self, reason: Refused, count: u64) {
        let place = &mut self.0[reason as usize];
        *place = place.saturating_add(count);
    }

    /// All counts, in the order of [`Refused`].
    pub fn counts(&self) -> [u64; REFUSED] {
        self.0
    }
}
