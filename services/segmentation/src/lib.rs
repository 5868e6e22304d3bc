//! Segmentation: from the vote fields to the target, and from the frame to the training blob.
//!
//! A frame's way: VOTES and the frame that they are of (both read in place) → paper mode: blobs by contrast,
//! centre of gravity, velocities; robust mode: the most probable candidate, and the tracks, which are saved
//! so that a kill loses none; the brightest blob → TARGET.

pub mod config;
pub mod step;

use config::Config;
use pursuit_bus::{FrameMessage, FrameSubscriber, Message, wait};
use pursuit_messages::topics::{Targets, VoteFields};
use pursuit_messages::{Service, Stage, Stamp, VisionMode};
use pursuit_runtime::checkpoint::Checkpoint;
use pursuit_runtime::clock::monotonic_ns;
use pursuit_runtime::settings::Clock;
use pursuit_runtime::{ServiceError, Station, TICK};
use step::{Memory, Segmenter};

/// Longest wait on the wall clock for the frame behind a vote message, ns: after that the blob is answered as not found.
const FRAME_PATIENCE_NS: u64 = 100_000_000;

/// Version of the saved tracks.
const SCHEMA: u32 = 1;
/// Room for them: two times four tracks take about 2 kB.
const CHECKPOINT_BYTES: usize = 1 << 14;

/// Runs until stopped.
///
/// # Errors
/// [`ServiceError`] for a wrong config or a bus that fails.
pub fn run(mut station: Station) -> Result<(), ServiceError> {
    let config = station.config(Config::read)?;
    let mut segmenter = Segmenter::new(&config);
    let targets = station.bus.publisher(Targets)?;
    let frames = station.bus.frame_subscriber()?;
    let votes = station.bus.subscriber(VoteFields)?;
    let mut recent = RecentFrames::default();
    let mut pending: Option<(Message<VoteFields>, u64)> = None;
    if !station.take_over()? {
        return Ok(());
    }
    let (mut checkpoint, saved) = Checkpoint::open(&station.checkpoint_file(), SCHEMA, CHECKPOINT_BYTES)?;
    restore(saved, &mut segmenter);
    while station.turn() {
        wait(&[&votes, &frames], TICK)?;
        targets.greet_new_readers();
        recent.take_all(&frames)?;
        if let Some((message, passed)) = votes.newest()? {
            station.health.skipped += passed;
            station.health.skipped += u64::from(pending.is_some());
            let since = pending.take().map_or_else(monotonic_ns, |(_, since)| since);
            pending = Some((message, since));
            // The frame was sent before its votes; look again before deciding that it is missing.
            recent.take_all(&frames)?;
        }
        let Some((message, since)) = pending.take() else { continue };
        let begin = monotonic_ns();
        let frame = recent.find(message.stamp());
        let patient = config.run.clock == Clock::Lockstep || begin < since + FRAME_PATIENCE_NS;
        if frame.is_none() && patient {
            pending = Some((message, since));
            continue;
        }
        let mut target = segmenter.step(message.stamp(), message.payload(), frame);
        if message.payload().mode == VisionMode::Robust as u32 {
            checkpoint.save_value(segmenter.memory())?;
        }
        let end = monotonic_ns();
        target.segmentation_ns = end - begin;
        let stamp = message.stamp().extended(Service::Segmentation, Stage::Segment, begin, end);
        targets.publish(&stamp, &target)?;
        station.answered(stamp.frame);
        station.health.refused = frames.refused() + votes.refused();
    }
    Ok(())
}

/// Goes on with the tracks of before a kill, if there were any and the parameters are the same.
fn restore(saved: Option<Vec<u8>>, segmenter: &mut Segmenter) {
    let memory: Option<Memory> = saved.and_then(|bytes| postcard::from_bytes(&bytes).ok());
    match memory.map(|memory| segmenter.resume(memory)) {
        Some(true) => tracing::info!("going on with the tracks of before"),
        Some(false) => tracing::warn!("the saved tracks have other parameters: starting without any"),
        None => {}
    }
}

/// The last two frames, held in shared memory.
#[derive(Default)]
struct RecentFrames {
    kept: [Option<FrameMessage>; 2],
}

impl RecentFrames {
    fn take_all(&mut self, frames: &FrameSubscriber) -> Result<(), ServiceError> {
        while let Some(frame) = frames.receive()? {
            self.kept.swap(0, 1);
            self.kept[1] = Some(frame);
        }
        Ok(())
    }

    fn find(&self, stamp: &Stamp) -> Option<&FrameMessage> {
        self.kept.iter().flatten().find(|frame| frame.stamp().trace_id == stamp.trace_id)
    }
}
