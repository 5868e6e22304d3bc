//! What can be set about learning, and the two sets of values that have a name.

use serde::{Deserialize, Serialize};

/// Which earlier views a new view of a move is paired with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Pairing {
    /// The move's start, a random earlier view of the move, a random view of earlier moves to the same
    /// target; each pair in both directions.
    LongBaseline,
    /// The view before (the paper's wording: a new sample every 40 ms), forwards only.
    Consecutive,
}

/// Which sample a full ring gives up.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Retention {
    /// The older of the two that teach the most similar thing.
    Coverage,
    /// The oldest.
    Fifo,
}

/// How a refit minimises.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Method {
    /// Conjugate gradients with a line search, as in the paper.
    #[default]
    ConjugateGradient,
    /// Scaled conjugate gradients (Møller).
    ScaledConjugateGradient,
    /// Levenberg-Marquardt, [`Method::MARQUARDT_ITERATIONS`] at most: it gets deeper with each, and more
    /// would fit what the few samples of the first moves do not say.
    LevenbergMarquardt,
}

impl Method {
    /// Iterations of Levenberg-Marquardt in one refit at most.
    pub const MARQUARDT_ITERATIONS: u32 = 8;
    /// ρ of Levenberg-Marquardt: how firmly a refit holds to the weights that it starts from.
    pub const MARQUARDT_RIDGE: f64 = 1e-4;
}

/// All settings of learning.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Settings {
    /// Whether the network says nothing for a target in the centre, by construction.
    pub anchored: bool,
    /// Pairs from which samples are made.
    pub pairing: Pairing,
    /// What a full ring gives up.
    pub retention: Retention,
    /// Samples the ring holds, 4..=1000.
    pub memory: u32,
    /// Samples of one move that go to the ring, chosen at random, 1..=1000.
    pub kept_per_move: u32,
    /// Least motion of a joint that makes a pair a sample, rad, > 0.
    pub min_motion_rad: f64,
    /// Sense in which the image turns with joint 1: −1 for an unmirrored camera looking down, +1 for a
    /// mirrored one.
    pub rotation_sign: f64,
    /// Step size η of the online back-propagation, 0 (off) to 1.
    pub eta: f64,
    /// Residual beyond which a sample pulls only linearly, normalised units; `None`: quadratic.
    pub huber: Option<f64>,
    /// How a refit minimises.
    pub method: Method,
    /// Iterations of a refit at most, 0 (off) to 1000.
    pub iterations: u32,
    /// Whether a world that changed is noticed, and what no longer holds forgotten: see
    /// [`ChangeDetector`](crate::ChangeDetector).
    pub detect_change: bool,
}

impl Settings {
    /// What works best here: learns to 3 cm in 2 or 3 moves.
    pub const fn recommended() -> Settings {
        Settings {
            anchored: true,
            pairing: Pairing::LongBaseline,
            retention: Retention::Coverage,
            memory: 100,
            kept_per_move: 40,
            min_motion_rad: 0.03,
            rotation_sign: -1.0,
            eta: 0.1,
            huber: Some(0.05),
            method: Method::ConjugateGradient,
            // 60 are enough for the design's camera, which sees 0.64 m. The default cell's sees 1.0 m, its map
            // is more curved: with 250 in place of 120 the moves to 1 cm are fewer by a quarter.
            iterations: 250,
            detect_change: true,
        }
    }

    /// Section 3 of the paper to the letter.
    pub const fn paper() -> Settings {
        Settings {
            anchored: false,
            pairing: Pairing::Consecutive,
            retention: Retention::Fifo,
            memory: 100,
            kept_per_move: 100,
            min_motion_rad: 0.004,
            rotation_sign: -1.0,
            eta: 0.1,
            huber: None,
            method: Method::ConjugateGradient,
            iterations: 50,
            detect_change: false,
        }
    }
}
