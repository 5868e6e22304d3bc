//! The two config sections that several services read: `[run]` and `[camera]`.

use pursuit_config::Checker;
use pursuit_messages::ImageShape;

/// Who sets the pace.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Clock {
    /// The simulator waits for the answer to each frame: same seed, same bits.
    Lockstep,
    /// CLOCK_MONOTONIC: the newest frame wins.
    Wall,
}

/// How fast lock-step runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pace {
    /// As fast as the machine can.
    Free,
    /// Not faster than the simulated time.
    Real,
}

/// Section `[run]`.
#[derive(Clone, Debug, PartialEq)]
pub struct Run {
    /// Name of the instance: a word that becomes a folder name.
    pub instance: String,
    /// Who sets the pace.
    pub clock: Clock,
    /// How fast lock-step runs.
    pub pace: Pace,
    /// Seed of everything random.
    pub seed: u64,
    /// Services whose supervisor is gone go on for so long, ns: then another one has adopted them, or they end.
    pub lease_ns: u64,
}

/// Longest instance name: it is part of socket paths.
const MAX_INSTANCE_NAME: usize = 16;

impl Run {
    /// Reads the section.
    pub fn read(checker: &Checker<'_>) -> Run {
        let section = checker.section("run");
        let instance = section.text_or("instance", crate::place::DEFAULT_INSTANCE);
        let plain = instance.chars().all(|c| c.is_ascii_alphanumeric() || c == '-' || c == '_');
        if instance.is_empty() || instance.len() > MAX_INSTANCE_NAME || !plain {
            section.fault(
                "instance",
                format!("must be 1 to {MAX_INSTANCE_NAME} letters, digits, - or _, is {instance:?}"),
            );
        }
        Run {
            instance,
            clock: section.choice("clock", &[("lockstep", Clock::Lockstep), ("wall", Clock::Wall)]),
            pace: section.choice_or("pace", &[("free", Pace::Free), ("real", Pace::Real)], Pace::Free),
            seed: section.integer("seed", 0..=u64::from(u32::MAX)),
            lease_ns: (section.float_or("lease_s", 0.2..=600.0, 5.0) * 1e9) as u64,
        }
    }
}

/// Section `[camera]`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Pixels per row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Frames per second.
    pub rate_hz: f64,
}

impl Camera {
    /// Reads the section's common part.
    pub fn read(checker: &Checker<'_>) -> Camera {
        let section = checker.section("camera");
        Camera {
            width: section.integer("width", 64..=4096),
            height: section.integer("height", 64..=4096),
            rate_hz: section.float("rate_hz", 0.1..=1000.0),
        }
    }

    /// The shape of its frames.
    pub fn shape(&self) -> ImageShape {
        ImageShape::grey(self.width, self.height)
    }

    /// Time from one exposure to the next, ns.
    pub fn period_ns(&self) -> u64 {
        (1e9 / self.rate_hz).round() as u64
    }
}
