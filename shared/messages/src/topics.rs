//! The wiring of the whole system: who writes what, who reads it, and how much is kept.
//!
//! | topic | written by | read by |
//! |---|---|---|
//! | FRAMES | acquisition | vision, segmentation |
//! | VOTES | vision | segmentation |
//! | TARGET | segmentation | learner |
//! | JOINTS | arm-driver | learner |
//! | DRIVER_STATE | arm-driver | `pursuit reset`, `pursuit activate` |
//! | SETPOINT | learner | arm-driver |
//! | LEARNER_STATE | learner | simulator (evaluation) |
//! | WORLD_STATE | simulator | acquisition (simulated camera), arm-driver (simulated drives) |
//! | WORLD_COMMAND | arm-driver | simulator |
//! | HEALTH | every service | supervisor |
//!
//! The observer reads all of them, and so does, for a while, who asks for a trace or a recording: hence the
//! numbers of readers.

use crate::health::Health;
use crate::payload::*;
use crate::safety::DriverState;
use crate::world::*;

/// The two frames that vision compares are at most so many frames apart. Who comes late finds as many before
/// the newest.
pub const MAX_BASELINE: u64 = 8;
/// Frames that a pair of that baseline spans.
const SPANNED: usize = MAX_BASELINE as usize + 1;

/// How a topic is kept. All topics overflow: a slow or dead reader never blocks a writer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Quality {
    /// Writers at once; 2 lets a replacement start before the dead one is cleaned up.
    pub publishers: usize,
    /// Readers at once.
    pub subscribers: usize,
    /// Messages a reader can be behind before the oldest is lost.
    pub buffer: usize,
    /// Messages a reader can hold at once: what it keeps, and two while it looks for the newest.
    pub borrowed: usize,
    /// Messages that a late reader still gets.
    pub history: usize,
}

/// One topic: its name on the bus, its payload, how it is kept.
pub trait Topic {
    /// What a message holds. `[u8]` for frames.
    type Payload: ?Sized;
    /// Service name on the bus, with the version of the payload.
    const NAME: &'static str;
    /// Depths and numbers of peers.
    const QUALITY: Quality;
    /// Whether all its messages are of one camera, so that an older epoch than one seen is of a camera that is
    /// gone. Where world and camera both cause messages their epochs mix.
    const OF_ONE_CAMERA: bool;
}

macro_rules! topic {
    ($(#[$doc:meta])* $topic:ident, $payload:ty, $name:literal, $quality:expr) => {
        topic!($(#[$doc])* $topic, $payload, $name, $quality, of_one_camera = false);
    };
    ($(#[$doc:meta])* $topic:ident, $payload:ty, $name:literal, $quality:expr, of_one_camera = $one:literal) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug)]
        pub struct $topic;
        impl Topic for $topic {
            type Payload = $payload;
            const NAME: &'static str = $name;
            const QUALITY: Quality = $quality;
            const OF_ONE_CAMERA: bool = $one;
        }
    };
}

const fn kept(
    publishers: usize,
    subscribers: usize,
    buffer: usize,
    borrowed: usize,
    history: usize,
) -> Quality {
    Quality { publishers, subscribers, buffer, borrowed, history }
}

topic!(
    /// Camera frames, written once into the loaned sample. Vision holds those that its pair spans.
    Frames, [u8], "frames/v1", kept(2, 8, SPANNED + 1, SPANNED + 3, SPANNED), of_one_camera = true
);
topic!(
    /// Vote fields of a frame pair.
    VoteFields, Votes, "votes/v2", kept(2, 8, 4, 4, 1), of_one_camera = true
);
topic!(
    /// Detections of a frame.
    Targets, Target, "target/v2", kept(2, 10, 16, 4, 1), of_one_camera = true
);
topic!(
    /// Joint readings.
    JointStates, Joints, "joints/v1", kept(2, 10, 64, 2, 16)
);
topic!(
    /// The arm driver's state.
    DriverStates, DriverState, "driver-state/v1", kept(2, 8, 16, 2, 1)
);
topic!(
    /// Set-points: the newest wins.
    SetPoints, SetPoint, "setpoint/v1", kept(2, 10, 4, 4, 1), of_one_camera = true
);
topic!(
    /// The learner's inside.
    LearnerStates, LearnerState, "learner-state/v1", kept(2, 10, 16, 2, 1), of_one_camera = true
);
topic!(
    /// The simulated world.
    WorldStates, WorldState, "world-state/v3", kept(2, 10, 16, 2, SPANNED)
);
topic!(
    /// Commands to the simulated drives.
    WorldCommands, WorldCommand, "world-command/v1", kept(2, 10, 16, 2, 1)
);
topic!(
    /// Signs of life.
    Healths, Health, "health/v2", kept(16, 8, 32, 2, 0)
);
