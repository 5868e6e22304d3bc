//! The arm's safety chain, all of it pure: the states as a table, the machine that obeys it, what is
//! watched from look to look, and how far the arm can travel after a loss.
//!
//! `pursuit` is not certified: an emergency stop is hardware, this only reads and obeys it. The names are
//! those of the standards and of robot makers, the claims are not.

mod chain;
mod machine;
pub mod table;
mod travel;

pub use chain::{Activation, Chain, Look, Refused, Rules, Verdict};
pub use machine::Machine;
pub use pursuit_runtime::latch::{Latch, Wish};
pub use travel::Travel;

#[cfg(test)]
mod tests;
