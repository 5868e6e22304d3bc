//! Configuration from a TOML file, checked, with all faults reported at once.
//!
//! A [`Document`] is the file plus the overrides of the command line. A [`Checker`] reads it section by
//! section into checked values; whatever is wrong is collected, and [`Checker::finish`] returns it all:
//!
//! ```text
//! config/sim.toml:14: camera.rate_hz is 5000, must be between 0.1 and 1000
//! config/sim.toml:20: vision.pyramid_levls is not a key of [vision], did you mean pyramid_levels?
//! --set arm.mode: arm.mode is "fast", must be one of "slow", "normal"
//! ```
//!
//! ```
//! use pursuit_config::{Checker, Document, Scope};
//! let mut document = Document::parse("sim.toml", "[camera]\nrate_hz = 25\n")?;
//! document.set("camera.width_px", "640")?;
//! let checker = Checker::new(&document);
//! let camera = checker.section("camera");
//! let rate_hz = camera.float("rate_hz", 0.1..=1000.0);
//! let width_px: u32 = camera.integer_or("width_px", 64..=4096, 512);
//! checker.finish(Scope::All)?;
//! assert_eq!((rate_hz, width_px), (25.0, 640));
//! # Ok::<(), pursuit_config::Faults>(())
//! ```
//!
//! This is the only crate that names `toml`.
#![cfg_attr(test, allow(clippy::unwrap_used))]

mod checker;
mod document;
mod faults;
mod number;
mod section;
mod spelling;
mod syntax;
#[cfg(test)]
mod tests;

pub use checker::{Checker, Scope};
pub use document::Document;
pub use faults::{Fault, Faults};
pub use number::Integer;
pub use section::Section;
