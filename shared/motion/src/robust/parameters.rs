//! What can be set in robust mode.

use super::model::MotionModel;

/// Window scales of the evidence: cells of 8, 16, 32 px at 512 px.
pub const SCALES: usize = 3;

/// The parts of robust mode, each of which can be switched off and measured alone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RobustParameters {
    /// Which motions the background may have.
    pub model: MotionModel,
    /// Correct light that changes locally.
    pub light: bool,
    /// Search for large translations.
    pub search: bool,
    /// Let target motions compete for the blob; else its centroid and mean vote are the answer.
    pub competition: bool,
    /// Average the mask's centroid with that of the older frame.
    pub symmetric: bool,
    /// Let the target turn while it moves.
    pub turn: bool,
    /// The evidence.
    pub evidence: EvidenceParameters,
    /// Evidence over the threshold from which there may be a target.
    pub cut: f32,
}

/// How evidence is weighed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EvidenceParameters {
    /// Least threshold of the normalised votes per window scale.
    pub vote_floor: [f32; SCALES],
    /// Threshold of the normalised votes over the quantile.
    pub vote_factor: [f32; SCALES],
    /// Whether the residual channel counts.
    pub untuned: bool,
    /// Least threshold of the residual per window scale, base px.
    pub residual_floor: [f32; SCALES],
    /// Threshold of the residual over the quantile.
    pub residual_factor: [f32; SCALES],
    /// Weight of the residual channel against the votes.
    pub residual_weight: f32,
    /// Share of the cells that are taken for background.
    pub quantile: f32,
    /// Gradient that is added to the normaliser of the votes, grey levels.
    pub least_gradient: f32,
    /// Gradient that is added to that of the residual, grey levels.
    pub least_energy: f32,
}

impl Default for EvidenceParameters {
    /// Floors, factors and additions are those of the design notes on vision, section 6 R5 and R6: set so that
    /// twelve sequences without target stay below the threshold.
    fn default() -> EvidenceParameters {
        EvidenceParameters {
            vote_floor: [0.24, 0.20, 0.09],
            vote_factor: [3.2, 3.0, 2.5],
            untuned: true,
            residual_floor: [0.22, 0.16, 0.14],
            residual_factor: [6.0, 4.5, 3.0],
            residual_weight: 0.9,
            quantile: 0.85,
            least_gradient: 2.0,
            least_energy: 1.5,
        }
    }
}

impl Default for RobustParameters {
    fn default() -> RobustParameters {
        RobustParameters {
            model: MotionModel::Planar,
            light: true,
            search: true,
            competition: true,
            symmetric: true,
            turn: true,
            evidence: EvidenceParameters::default(),
            // Weak candidates cannot be targets of one pair, but may be those of a track.
            cut: 0.6,
        }
    }
}
