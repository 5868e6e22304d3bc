//! The motion detectors, as pure functions: frames in, target out; no clock, file, log or thread.
//!
//! ```text
//! paper (section 2):
//! frame pair ─► pyramid ─► derivatives ─► 12 votes ─► cells ─► shift ─┐      VoteEngine::vote
//!                  ▲                                                  │
//!                  └──────────── compensated older frame ◄────────────┘
//! vote fields ─► blobs ─► three best ─► threshold ─► target, velocities      segment
//!
//! robust: frame pair ─► candidates (picture in robust.rs)                    RobustEngine::detect
//!         candidates, frame by frame ─► tracks                              Tracker::step
//!
//! frame ─► bright component ─► centroid                                     detect_blob
//! ```
//!
//! Votes are whole numbers up to the cells: the fields are the same to the bit on every processor; robust mode
//! computes in f32 lanes of fixed order, the same with and without AVX2 or AVX-512.
//! Positions are px from the centre of the top-left pixel (u to the right, v down), velocities px/frame
//! from the older to the newer frame.

#![cfg_attr(test, allow(clippy::unwrap_used))]

mod blobs;
pub mod bright_blob;
mod cells;
mod compensation;
mod engine;
mod image;
mod pair;
pub mod parameters;
mod pyramid;
pub mod robust;
mod segment;
#[cfg(test)]
mod tests;
pub mod tracker;
mod votes;

pub use bright_blob::{BlobParameters, BlobScratch, detect_blob};
pub use cells::{CELLS_ALONG_SHORTER_SIDE, MAX_CELLS};
pub use compensation::NOMINAL_VELOCITIES;
pub use engine::{EngineError, FIELDS, Fields, NoProbe, Older, Part, Probe, VoteEngine, VoteSummary};
pub use image::{Image, ImageError, MAX_SIDE, MIN_SIDE};
pub use parameters::{ParameterError, Parameters, Smoothing};
pub use robust::model::{GlobalMotion, MotionModel};
pub use robust::parameters::{EvidenceParameters, RobustParameters};
pub use robust::{Candidate, Findings, MAX_TARGETS, Outcome, RobustEngine};
pub use segment::{Detection, NoTarget, SegmentScratch, Segmentation, segment};
pub use tracker::{Track, TrackState, Tracker, TrackerParameters};
