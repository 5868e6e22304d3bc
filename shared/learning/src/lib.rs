//! The arm learns its own hand-eye coordination: from where the target is in the image and the angle of
//! joint 2 to the joint displacements that bring the target to the centre of the image (Bartholomeus,
//! Kröse and Noest 1994, section 3).
//!
//! The way of a frame: [`View`] (where the target was seen, at which joint angles) → [`Episode`] pairs it
//! with earlier views → [`Sample`], correct whatever the network did ("indirect learning") → one online
//! step of back-propagation, and a place in the [`Ring`] of 100 → at rest a [`RefitJob`], run by
//! [`refit`] wherever the caller likes → [`Trainer::merge`].
//!
//! Pure: no clock, file, log, thread. Random numbers come from one seeded stream. All state can be
//! serialised; what is restored goes on bit for bit as if it had never stopped.
//!
//! Symbols of the paper: x is [`View::point_px`], θ is [`View::joints`], p is
//! [`samples::displacement_px`], Δθ is the difference of joints. Where this crate departs from the
//! paper, [`Settings::paper`] is the way back and the line says so.

#![cfg_attr(test, allow(clippy::unwrap_used))]
// Matrices are written with their indices, as in the books.
#![allow(clippy::needless_range_loop)]

pub mod activation;
pub mod batch;
pub mod change;
pub mod clock_offset;
pub mod conjugate_gradient;
pub mod consensus;
pub mod coverage;
pub mod episode;
pub mod grid;
pub mod landmark;
pub mod levenberg_marquardt;
mod line_search;
pub mod network;
pub mod objective;
pub mod refit;
pub mod reframe;
pub mod ring;
pub mod samples;
pub mod scaled_conjugate_gradient;
pub mod settings;
#[cfg(test)]
mod test_functions;
pub mod trainer;
mod watch;

pub use batch::Batch;
pub use change::{ChangeDetector, Verdict};
pub use clock_offset::ClockOffset;
pub use conjugate_gradient::{Descent, Stop};
pub use coverage::Coverage;
pub use episode::Episode;
pub use grid::{GridCase, GridError, evaluate_grid};
pub use landmark::Landmark;
pub use network::{HIDDEN, Network, WEIGHTS};
pub use refit::{RefitJob, RefitResult, refit};
pub use reframe::Frame;
pub use ring::Ring;
pub use samples::{Normalisation, Sample, View};
pub use settings::{Method, Pairing, Retention, Settings};
pub use trainer::{Counters, Merge, Trainer};
pub use watch::Review;
