//! Vision: from a pair of frames to the 12 signed vote fields, and in robust mode to what moves on its own.
//!
//! A frame's way: FRAMES (read in place) → with one a baseline before: pyramid, compensation of the camera's
//! motion, derivatives, votes; in robust mode the competition of motions → VOTES (written in place).

pub mod config;
pub mod eye;
mod pairs;
pub mod probe;

use config::Config;
use eye::Eye;
use pairs::{Pair, Pairs};
use probe::Stopwatch;
use pursuit_bus::{FrameMessage, wait};
use pursuit_messages::topics::VoteFields;
use pursuit_messages::{Service, Stage, Votes};
use pursuit_motion::{Image, ImageError, Older};
use pursuit_runtime::clock::monotonic_ns;
use pursuit_runtime::settings::Clock;
use pursuit_runtime::{ServiceError, Station, TICK};

/// Runs until stopped.
///
/// # Errors
/// [`ServiceError`] for a wrong config or a bus that fails.
pub fn run(mut station: Station) -> Result<(), ServiceError> {
    let config = station.config(Config::read)?;
    let shape = config.camera.shape();
    let mut eye = Eye::new(shape.width as usize, shape.height as usize, &config.detector)
        .map_err(|e| ServiceError::Other(e.to_string()))?;
    let votes = station.bus.publisher(VoteFields)?;
    let frames = station.bus.frame_subscriber()?;
    let mut misfits = 0;
    let mut pairs = Pairs::new(config.baseline());
    if !station.take_over()? {
        return Ok(());
    }
    while station.turn() {
        wait(&[&frames], TICK)?;
        votes.greet_new_readers();
        let mut waiting = frames.receive()?;
        while let Some(frame) = waiting {
            waiting = frames.receive()?;
            if frame.stamp().image != shape {
                misfits += 1;
                continue;
            }
            if waiting.is_some() && config.run.clock == Clock::Wall {
                // Newest wins; the one passed over still serves as the older half of the pair.
                station.health.skipped += 1;
                pairs.take(frame);
                continue;
            }
            let begin = monotonic_ns();
            pairs.take(frame);
            if config.run.clock == Clock::Lockstep && !pairs.is_complete() {
                // Just started: the frames of before are on their way, or will be asked for again.
                continue;
            }
            let Some(pair) = pairs.pair() else { continue };
            let mut loan = votes.loan()?;
            look(&mut eye, &pair, loan.payload_mut()).map_err(|e| ServiceError::Other(e.to_string()))?;
            let stamp = pair.newer.stamp().extended(Service::Vision, Stage::Votes, begin, monotonic_ns());
            loan.send(&stamp)?;
            station.answered(stamp.frame);
        }
        station.health.refused = misfits + frames.refused();
    }
    Ok(())
}

/// Looks at the newest pair; the answer goes straight into the message.
fn look(eye: &mut Eye, pair: &Pair<'_>, votes: &mut Votes) -> Result<(), ImageError> {
    let newer = image(pair.newer)?;
    let older = match pair.older {
        None => Older::Missing,
        Some(frame) if pair.continues => Older::LastNewer(image(frame)?),
        Some(frame) => Older::Frame(image(frame)?),
    };
    let mut watch = Stopwatch::start();
    eye.look(older, newer, pair.interval, votes, &mut watch);
    watch.write(votes);
    Ok(())
}

fn image(frame: &FrameMessage) -> Result<Image<'_>, ImageError> {
    let shape = frame.stamp().image;
    Image::new(frame.pixels(), shape.width as usize, shape.height as usize, shape.stride as usize)
}
