//! Turns detections into set-points, and learns how to.
//!
//! [`step`] is the pure answer to one frame; [`config`] its parameters.

#![cfg_attr(test, allow(clippy::unwrap_used))]

pub mod config;
mod moment;
mod rest;
pub mod step;
mod tracking;
mod training;
