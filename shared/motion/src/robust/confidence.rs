//! From evidence to the probability that something moves on its own, and how well its place is known.

use super::Candidate;

/// Logistic regression on what is known of a candidate: the natural logarithms of the votes' evidence over
/// its threshold and of the weaker of the two channels', the share that is explained, the logarithm of the
/// strongest evidence elsewhere, the share of cells elsewhere that are half over the threshold, the
/// logarithms of the speed in px and of the area in 1000 px².
///
/// Fitted on the scenarios with seeds 101 to 103 at 256 and 512 px and on four real sequences, each group of
/// them with the same weight; the intercept is lower than fitted by [`CAUTION`], which was set on seeds 104
/// to 108.
const INTERCEPT: f64 = 0.68;
const VOTES: f64 = 2.36;
const WEAKER: f64 = 2.49;
const EXPLAINED: f64 = 3.35;
const RIVAL: f64 = -3.30;
const CLUTTER: f64 = -9.09;
const SPEED: f64 = -1.62;
const AREA: f64 = 0.62;
/// Keeps false alarms near 1 % of the pairs without target at a confidence of 0.5.
const CAUTION: f64 = 0.6;
/// Evidence below this counts as this.
const LEAST: f64 = 0.05;
/// Quieter surroundings than this say no more.
const LEAST_RIVAL: f64 = 0.8;
/// ... nor does more clutter.
const MOST_CLUTTER: f64 = 0.05;
/// Speeds outside of this, px, count as its ends.
const SPEEDS: (f64, f64) = (1.0, 8.0);
/// Areas outside of this, 1000 px², count as its ends.
const AREAS: (f64, f64) = (0.3, 5.0);

/// The probability that the candidate is a target, 0..1.
pub(crate) fn probability(candidate: &Candidate) -> f64 {
    let log = |value: f64| value.max(LEAST).ln();
    let [u, v] = candidate.relative;
    let weaker = candidate.votes_evidence.min(candidate.residual_evidence);
    let score = INTERCEPT - CAUTION
        + VOTES * log(candidate.votes_evidence)
        + WEAKER * log(weaker)
        + EXPLAINED * candidate.explained.clamp(0.0, 1.0)
        + RIVAL * candidate.rival.max(LEAST_RIVAL).ln()
        + CLUTTER * candidate.clutter.min(MOST_CLUTTER)
        + SPEED * u.hypot(v).clamp(SPEEDS.0, SPEEDS.1).ln()
        + AREA * (candidate.area_px / 1000.0).clamp(AREAS.0, AREAS.1).ln();
    1.0 / (1.0 + (-score).exp())
}

/// Standard deviation of the position across the motion, px, where the motion explains most.
const POSITION_SD: f64 = 0.6;
/// What it grows by along the motion, per px of motion: the uncovered background biases.
const ALONG: f64 = 0.1;
/// Where the motion explains less than this, both are doubled.
const WELL_EXPLAINED: f64 = 0.7;
/// Standard deviation of the velocity, px per pair.
const VELOCITY_SD: f64 = 0.1;

/// Covariance of the position (uu, uv, vv, px²) and standard deviation of the velocity per axis, px per
/// pair (design notes on vision, section 6 R12).
pub(crate) fn uncertainty(candidate: &Candidate) -> ([f64; 3], f64) {
    let [u, v] = candidate.relative;
    let speed = u.hypot(v);
    let doubt = if candidate.explained < WELL_EXPLAINED { 2.0 } else { 1.0 };
    let across = (doubt * POSITION_SD).powi(2);
    let along = (doubt * (POSITION_SD + ALONG * speed)).powi(2);
    let more = if speed > 0.0 { (along - across) / (speed * speed) } else { 0.0 };
    ([across + more * u * u, more * u * v, across + more * v * v], doubt * VELOCITY_SD)
}
