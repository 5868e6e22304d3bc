//! The payloads. Enumerations travel as numbers: a reader converts them at the border and refuses what
//! it does not know.

use iceoryx2::prelude::ZeroCopySend;

/// Joints of the arm.
pub const JOINTS: usize = 6;
/// Signed vote fields: 3 scales × 4 directions (paper, section 2.3.1).
pub const FIELDS: usize = 12;
/// Most cells of one vote field.
pub const MAX_CELLS: usize = 1024;
/// Room for the learner's weights.
pub const MAX_WEIGHTS: usize = 192;
/// Reasons for which the learner does not use what comes in.
pub const REFUSED: usize = 8;

/// Candidates that vision tells of one pair at most.
pub const MAX_CANDIDATES: usize = 4;
/// Coefficients of the global motion.
pub const MOTION_COEFFICIENTS: usize = 8;

/// Something that moves on its own, as one pair of frames shows it (robust mode).
#[derive(Clone, Copy, Debug, Default, PartialEq, ZeroCopySend)]
#[repr(C)]
#[type_name("pursuit/Candidate/1")]
pub struct Candidate {
    /// Position in the newer frame, px.
    pub u: f64,
    /// As `u`, downward.
    pub v: f64,
    /// Displacement in the image over the pair, px.
    pub vu: f64,
    /// As `vu`, downward.
    pub vv: f64,
    /// Displacement relative to the background over the pair, px (right, down).
    pub relative: [f64; 2],
    /// Area, px².
    pub area_px: f64,
    /// Probability that it is a target, 0..1.
    pub confidence: f64,
    /// Covariance of the position: uu, uv, vv, px².
    pub position_covariance: [f64; 3],
    /// Standard deviation of the displacement in each direction, px.
    pub velocity_sd: f64,
    /// Largest evidence over its threshold.
    pub evidence: f64,
    /// Share of the residual that its motion explains, 0..1.
    pub explained: f64,
}

/// The 12 vote fields of one frame pair after compensation, reduced to cells (topic VOTES); in robust mode
/// normalised votes, -1..1, and what moves on its own.
#[derive(Clone, Copy, Debug, PartialEq, ZeroCopySend)]
#[repr(C)]
#[type_name("pursuit/Votes/2")]
pub struct Votes {
    /// 1 where a pair was there to vote on, 0 for the first frame after a start or a gap.
    pub valid: u32,
    /// [`VisionMode`] as a number.
    pub mode: u32,
    /// Robust mode: [`PairOutcome`] as a number.
    pub outcome: u32,
    /// Candidates used of `candidates`.
    pub candidate_count: u32,
    /// Cells per row.
    pub columns: u32,
    /// Rows of cells.
    pub rows: u32,
    /// Paper mode: how often the older frame was moved.
    pub passes: u32,
    /// Paper mode: whole-pixel shift of the older frame onto the newer, full-resolution px.
    pub shift_u: i32,
    /// As `shift_u`, downward.
    pub shift_v: i32,
    /// Side of a cell in full-resolution px.
    pub cell_px: f32,
    /// Frames between the two of the pair: 1 unless some were passed over. All displacements here are
    /// per pair, not per frame.
    pub interval: u32,
    /// Paper mode: coherence of each field on the compensated pair, -1..1.
    pub coherence: [f64; FIELDS],
    /// Sum of the absolute coherences.
    pub coherence_sum: f64,
    /// Displacement of the background over the pair, px: in paper mode the shift plus the damped rest, in
    /// robust mode that in the middle of the image.
    pub background_u: f64,
    /// As `background_u`, downward.
    pub background_v: f64,
    /// Computing time of the pyramid, ns.
    pub pyramid_ns: u64,
    /// Computing time of the voting passes, ns.
    pub votes_ns: u64,
    /// Computing time of the compensation (estimate and shift), ns.
    pub compensation_ns: u64,
    /// Computing time of the competition of motions (robust mode), ns.
    pub competition_ns: u64,
    /// Coefficients of the global motion (robust mode), px over the pair.
    pub motion: [f64; MOTION_COEFFICIENTS],
    /// Largest evidence over its threshold, also where there is no candidate (robust mode).
    pub evidence: f64,
    /// Robust mode: what moves on its own, strongest evidence first.
    pub candidates: [Candidate; MAX_CANDIDATES],
    /// Field `k` (label `k+1` of the paper's figure 3), row by row, `columns * rows` cells used.
    pub fields: [[f32; MAX_CELLS]; FIELDS],
}

impl Default for Votes {
    fn default() -> Votes {
        Votes {
            valid: 0,
            mode: 0,
            outcome: 0,
            candidate_count: 0,
            columns: 0,
            rows: 0,
            passes: 0,
            shift_u: 0,
            shift_v: 0,
            cell_px: 0.0,
            interval: 0,
            coherence: [0.0; FIELDS],
            coherence_sum: 0.0,
            background_u: 0.0,
            background_v: 0.0,
            pyramid_ns: 0,
            votes_ns: 0,
            compensation_ns: 0,
            competition_ns: 0,
            motion: [0.0; MOTION_COEFFICIENTS],
            evidence: 0.0,
            candidates: [Candidate::default(); MAX_CANDIDATES],
            fields: [[0.0; MAX_CELLS]; FIELDS],
        }
    }
}

/// Which detector vision runs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u32)]
pub enum VisionMode {
    /// The paper's.
    #[default]
    Paper = 0,
    /// Ours.
    Robust = 1,
}

/// How far the robust detector came with a pair.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u32)]
pub enum PairOutcome {
    /// There was no pair.
    #[default]
    NoPair = 0,
    /// All the way.
    Answered = 1,
    /// Both frames are the same.
    Frozen = 2,
    /// Nothing in the frames that could be seen moving.
    Featureless = 3,
    /// No motion of a camera explains the pair.
    Unexplained = 4,
}

impl PairOutcome {
    /// The outcome with that number, if there is one.
    pub fn from_number(number: u32) -> Option<PairOutcome> {
        let all = [
            PairOutcome::NoPair,
            PairOutcome::Answered,
            PairOutcome::Frozen,
            PairOutcome::Featureless,
            PairOutcome::Unexplained,
        ];
        all.into_iter().find(|outcome| *outcome as u32 == number)
    }
}

/// What one detector says of one frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, ZeroCopySend)]
#[repr(C)]
#[type_name("pursuit/Detection/2")]
pub struct Detection {
    /// 1 where there is a target; all else is 0 where there is none.
    pub found: u32,
    /// Always 0.
    pub reserved: u32,
    /// Position in the newer frame, px.
    pub u: f64,
    /// As `u`, downward.
    pub v: f64,
    /// Velocity in the image (not relative to the background), px/frame.
    pub vu: f64,
    /// As `vu`, downward.
    pub vv: f64,
    /// 0..1.
    pub confidence: f64,
    /// Visible area, px².
    pub area_px: f64,
    /// Contrast of the best blob (paper, section 2.3.2): not a probability. In robust mode the evidence
    /// over its threshold.
    pub contrast: f64,
    /// Covariance of the position: uu, uv, vv, px²; 0 where it is not known (paper mode).
    pub position_covariance: [f64; 3],
    /// Standard deviation of the velocity in each direction, px/frame; 0 where it is not known.
    pub velocity_sd: f64,
}

/// Where a track is in its life.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u32)]
pub enum TrackPhase {
    /// There is no track that is sure enough.
    #[default]
    Lost = 0,
    /// Seen, but it may be nothing.
    Tentative = 1,
    /// There, and seen in this frame.
    Confirmed = 2,
    /// There, and not seen in this frame.
    Coasting = 3,
}

/// Segmentation's answer to one frame (topic TARGET). All detectors always answer; who trains takes the
/// blob, who follows takes the motion of the single pair or the track over time.
#[derive(Clone, Copy, Debug, Default, PartialEq, ZeroCopySend)]
#[repr(C)]
#[type_name("pursuit/Target/3")]
pub struct Target {
    /// What moves independently of the camera, from this pair alone.
    pub motion: Detection,
    /// The same with all evidence up to now (robust mode): found while a track is confirmed or coasting.
    pub track: Detection,
    /// [`TrackPhase`] as a number.
    pub track_phase: u32,
    /// Tells tracks apart; 0 where there is none.
    pub track_id: u32,
    /// A static bright object, for training.
    pub blob: Detection,
    /// Velocity of the background, px/frame: its displacement that ends in the middle of the newer image.
    pub background_u: f64,
    /// As `background_u`, downward.
    pub background_v: f64,
    /// How fast the background turns in the image, rad/frame, from right to down; 0 in paper mode.
    pub background_turn_rad: f64,
    /// Frames over which the background's motion was measured; 0 where it was not.
    pub background_frames: u32,
    /// Always 0.
    pub reserved: u32,
    /// Computing time of the segmentation, ns.
    pub segmentation_ns: u64,
}

/// Measured and issued joint state (topic JOINTS).
#[derive(Clone, Copy, Debug, Default, PartialEq, ZeroCopySend)]
#[repr(C)]
#[type_name("pursuit/Joints/1")]
pub struct Joints {
    /// Time of the reading on the loop's clock, ns.
    pub time_ns: u64,
    /// Measured positions, rad.
    pub position: [f64; JOINTS],
    /// Measured velocities, rad/s.
    pub velocity: [f64; JOINTS],
    /// 1 where the last set-point moves the arm, 0 where it holds.
    pub following: u32,
    /// [`Refusal`] of the last set-point as a number, 0 for none.
    pub refusal: u32,
}

/// Why the arm driver did not follow a set-point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Refusal {
    /// The set-point itself says hold.
    Hold = 1,
    /// Not a finite number.
    NotFinite = 2,
    /// Exposed longer ago than the watchdog allows.
    Stale = 3,
    /// Exposed after now.
    FromTheFuture = 4,
    /// Outside the working envelope.
    OutOfRange = 5,
    /// Of another epoch than the newest frame.
    OldEpoch = 6,
    /// No set-point has come yet.
    None = 7,
    /// Of a frame before the last one used: it comes from the past.
    Backwards = 8,
    /// Finite, but so large that no sane sender sends it.
    Absurd = 9,
    /// The arm has not been activated.
    Inactive = 10,
    /// The arm is stopped until an operator's reset.
    Stopped = 11,
}

impl Refusal {
    /// All, in the order of their numbers.
    pub const ALL: [Refusal; 11] = [
        Refusal::Hold,
        Refusal::NotFinite,
        Refusal::Stale,
        Refusal::FromTheFuture,
        Refusal::OutOfRange,
        Refusal::OldEpoch,
        Refusal::None,
        Refusal::Backwards,
        Refusal::Absurd,
        Refusal::Inactive,
        Refusal::Stopped,
    ];

    /// The one with that number, if there is one.
    pub fn from_number(number: u32) -> Option<Refusal> {
        Refusal::ALL.into_iter().find(|refusal| *refusal as u32 == number)
    }

    /// Why, for people.
    pub fn text(self) -> &'static str {
        match self {
            Refusal::Hold => "it says hold",
            Refusal::NotFinite => "it is not finite",
            Refusal::Stale => "its frame is too old",
            Refusal::FromTheFuture => "its frame is from the future",
            Refusal::OutOfRange => "it is outside the working envelope",
            Refusal::OldEpoch => "it is of another epoch",
            Refusal::None => "there is none",
            Refusal::Backwards => "its frame is older than the one before",
            Refusal::Absurd => "it is absurdly large",
            Refusal::Inactive => "the arm has not been activated",
            Refusal::Stopped => "the arm is stopped",
        }
    }

    /// Whether it says that the sender is broken, not that there is nothing to follow.
    pub fn is_bad_data(self) -> bool {
        matches!(self, Refusal::NotFinite | Refusal::Absurd)
    }
}

/// What the learner is doing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u32)]
pub enum Phase {
    /// Learning on the static blob, move by move.
    #[default]
    Training = 0,
    /// On the way to the pose from which tracking starts.
    Homing = 1,
    /// Following the moving target.
    Tracking = 2,
}

impl Phase {
    /// The phase with that number, if there is one.
    pub fn from_number(number: u32) -> Option<Phase> {
        [Phase::Training, Phase::Homing, Phase::Tracking].into_iter().find(|p| *p as u32 == number)
    }
}

/// Where joints 1 and 2 shall go (topic SETPOINT). One for every frame; `follow = 0` means hold.
#[derive(Clone, Copy, Debug, Default, PartialEq, ZeroCopySend)]
#[repr(C)]
#[type_name("pursuit/SetPoint/1")]
pub struct SetPoint {
    /// 1: go to `position`; 0: come to rest where you are.
    pub follow: u32,
    /// [`Phase`] as a number.
    pub phase: u32,
    /// Absolute positions of joints 1 and 2, rad.
    pub position: [f64; 2],
    /// Velocities of joints 1 and 2 at that position, rad/s.
    pub velocity: [f64; 2],
    /// Training moves finished so far.
    pub moves: u32,
    /// Counts up when the learner is done with a training target and wants another.
    pub target_index: u32,
    /// 1 where the frame's detection was used.
    pub detected: u32,
    /// Always 0.
    pub reserved: u32,
}

/// The learner's inside, for people and for evaluation (topic LEARNER_STATE).
#[derive(Clone, Copy, Debug, PartialEq, ZeroCopySend)]
#[repr(C)]
#[type_name("pursuit/LearnerState/2")]
pub struct LearnerState {
    /// [`Phase`] as a number.
    pub phase: u32,
    /// Training moves finished.
    pub moves: u32,
    /// Training targets finished.
    pub target_index: u32,
    /// Samples in the ring.
    pub ring: u32,
    /// All samples admitted so far.
    pub samples: u64,
    /// Version of the weights: counts online steps and merges.
    pub version: u64,
    /// Batch refits that were merged.
    pub refits_merged: u32,
    /// Batch refits that were dropped because they were not better.
    pub refits_rejected: u32,
    /// Time of the last refit, ns of its thread.
    pub refit_ns: u64,
    /// Mean error over the ring after the last refit (normalised units).
    pub loss: f64,
    /// Changes of the world (a knocked camera, another lens) that were noticed.
    pub changes: u32,
    /// 1 where the map foretells how the image moves; 0 where it does not and the arm follows with care.
    pub consistent: u32,
    /// Error of the map about the image's motion now, relative to that motion.
    pub surprise: f64,
    /// Standard deviation of what the map says of the last target, rad.
    pub uncertainty_rad: f64,
    /// Time that the joints' clock is ahead of the camera's, as found out and made up for, ns.
    pub clock_offset_ns: i64,
    /// Time from a set-point to its effect that is predicted over, ns.
    pub lead_ns: u64,
    /// What was not used, by reason: the learner's `Refused` has the order.
    pub refused: [u64; REFUSED],
    /// Weights used of `weights`.
    pub weight_count: u32,
    /// Hidden units.
    pub hidden: u32,
    /// The network's weights, in the order of the learning crate.
    pub weights: [f64; MAX_WEIGHTS],
}

impl Default for LearnerState {
    fn default() -> LearnerState {
        LearnerState {
            phase: 0,
            moves: 0,
            target_index: 0,
            ring: 0,
            samples: 0,
            version: 0,
            refits_merged: 0,
            refits_rejected: 0,
            refit_ns: 0,
            loss: 0.0,
            changes: 0,
            consistent: 0,
            surprise: 0.0,
            uncertainty_rad: 0.0,
            clock_offset_ns: 0,
            lead_ns: 0,
            refused: [0; REFUSED],
            weight_count: 0,
            hidden: 0,
            weights: [0.0; MAX_WEIGHTS],
        }
    }
}
