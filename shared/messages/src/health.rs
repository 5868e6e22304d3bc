//! Signs of life.

use iceoryx2::prelude::ZeroCopySend;

/// What a service, or its input, lacks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u32)]
pub enum Lack {
    /// Nothing.
    #[default]
    Nothing = 0,
    /// There is no input: a camera that vanished, say.
    Input = 1,
    /// The camera repeats itself.
    Frozen = 2,
    /// The images are dark.
    Light = 3,
    /// The images are flooded with light.
    Shade = 4,
    /// The images have no texture: a covered camera.
    Texture = 5,
}

impl Lack {
    /// The one with that number.
    pub fn from_number(number: u32) -> Lack {
        let all = [Lack::Input, Lack::Frozen, Lack::Light, Lack::Shade, Lack::Texture];
        all.into_iter().find(|lack| *lack as u32 == number).unwrap_or_default()
    }

    /// What is said about it; empty where nothing lacks.
    pub fn text(self) -> &'static str {
        match self {
            Lack::Nothing => "",
            Lack::Input => "no input",
            Lack::Frozen => "the camera repeats itself: its images are not sent",
            Lack::Light => "the images are dark",
            Lack::Shade => "the images are flooded with light",
            Lack::Texture => "the images have no texture: is the camera covered?",
        }
    }
}

/// A service's sign of life (topic HEALTH), from inside its loop.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ZeroCopySend)]
#[repr(C)]
#[type_name("pursuit/Health/2")]
pub struct Health {
    /// [`crate::Service`] as a number.
    pub service: u32,
    /// Process id.
    pub pid: u32,
    /// CLOCK_MONOTONIC, ns.
    pub time_ns: u64,
    /// Number of the last frame answered.
    pub frame: u64,
    /// Frames answered.
    pub answered: u64,
    /// Frames passed over because a newer one was there.
    pub skipped: u64,
    /// Messages refused (layout, epoch, values).
    pub refused: u64,
    /// What the service lacks: [`Lack`] as a number.
    pub degraded: u32,
    /// 1 where this process stands by: everything is attached, and it waits until the one before it has left.
    pub standing_by: u32,
}
