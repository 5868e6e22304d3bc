//! The [`Stamp`]: which frame caused a message, when it was exposed, and when each service held it.

use iceoryx2::prelude::ZeroCopySend;

/// Layout number of [`Stamp`] and of all payloads. A reader refuses any other: iceoryx2 compares only
/// the name, size and alignment of a type, not its fields.
pub const LAYOUT: u32 = 1;

/// How many stages one frame can pass.
pub const MAX_STAGES: usize = 12;

/// The services of the system, in the order in which a frame meets them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(u16)]
pub enum Service {
    /// The simulated cell that stands in for hardware.
    Simulator = 1,
    /// Exposes and stamps frames.
    Acquisition = 2,
    /// Pyramid, vote fields, compensation.
    Vision = 3,
    /// Blobs, target position and velocity.
    Segmentation = 4,
    /// Network, samples, set-points.
    Learner = 5,
    /// Coupling, limits, watchdog, drives.
    ArmDriver = 6,
    /// Starts, watches and ends the others.
    Supervisor = 7,
    /// Sees everything and tells the loop nothing.
    Observer = 8,
}

/// The hops of a frame: the services that it passes, in the order of its way.
pub const HOPS: [Service; 5] =
    [Service::Acquisition, Service::Vision, Service::Segmentation, Service::Learner, Service::ArmDriver];

impl Service {
    /// All services that run as child processes, in the order of the data flow.
    pub const ALL: [Service; 7] = [
        Service::Simulator,
        Service::Acquisition,
        Service::Vision,
        Service::Segmentation,
        Service::Learner,
        Service::ArmDriver,
        Service::Observer,
    ];

    /// Whether the loop needs it: one that it does not need can die, or never start, and the run goes on.
    pub const fn is_in_the_loop(self) -> bool {
        !matches!(self, Service::Supervisor | Service::Observer)
    }

    /// The name on the command line, in the config and in tables.
    pub const fn name(self) -> &'static str {
        match self {
            Service::Simulator => "simulator",
            Service::Acquisition => "acquisition",
            Service::Vision => "vision",
            Service::Segmentation => "segmentation",
            Service::Learner => "learner",
            Service::ArmDriver => "arm-driver",
            Service::Supervisor => "supervisor",
            Service::Observer => "observer",
        }
    }

    /// The service of that name, if there is one.
    pub fn from_name(name: &str) -> Option<Service> {
        Service::ALL.into_iter().chain([Service::Supervisor]).find(|service| service.name() == name)
    }

    /// The service with that number, if there is one.
    pub fn from_number(number: u16) -> Option<Service> {
        Service::ALL.into_iter().chain([Service::Supervisor]).find(|service| *service as u16 == number)
    }
}

/// What a service did between two time stamps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u16)]
pub enum Stage {
    /// Rendering or reading the frame into the loaned sample.
    Expose = 1,
    /// Vision's step.
    Votes = 2,
    /// Segmentation's step.
    Segment = 3,
    /// The learner's step.
    Learn = 4,
    /// The arm driver's step up to the issued command.
    Drive = 5,
}

/// One stage of a frame's way, in CLOCK_MONOTONIC nanoseconds also in lock-step: it measures computing,
/// it never decides anything.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ZeroCopySend)]
#[repr(C)]
#[type_name("pursuit/StageStamp/1")]
pub struct StageStamp {
    /// [`Service`] as a number.
    pub service: u16,
    /// [`Stage`] as a number.
    pub stage: u16,
    /// Always 0.
    pub reserved: u32,
    /// When the service took the message that made it work.
    pub begin_ns: u64,
    /// When it handed its answer to the bus.
    pub end_ns: u64,
}

/// Size and pixel format of the frame behind a message.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ZeroCopySend)]
#[repr(C)]
#[type_name("pursuit/ImageShape/1")]
pub struct ImageShape {
    /// Pixels per row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Bytes from one row to the next, at least `width`.
    pub stride: u32,
    /// 1 = 8-bit grey, the only format of this version.
    pub format: u32,
}

/// Grey, one byte per pixel.
pub const FORMAT_GREY8: u32 = 1;

impl ImageShape {
    /// The shape of an 8-bit grey image whose rows follow each other without a gap.
    pub const fn grey(width: u32, height: u32) -> ImageShape {
        ImageShape { width, height, stride: width, format: FORMAT_GREY8 }
    }

    /// Bytes of the whole frame.
    pub const fn bytes(&self) -> usize {
        self.stride as usize * self.height as usize
    }
}

/// Header of every message: the frame that caused it.
///
/// `repr(C)`, no padding. Each service copies the stamp of its input into its output and adds its own
/// [`StageStamp`]; age is measured from the exposure.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ZeroCopySend)]
#[repr(C)]
#[type_name("pursuit/Stamp/1")]
pub struct Stamp {
    /// [`LAYOUT`] of the writer.
    pub layout: u32,
    /// How many of `stages` are set.
    pub stage_count: u32,
    /// Start of the camera's (in simulation: the world's) life, ns; a new one means that frame numbers
    /// began again.
    pub epoch: u64,
    /// Frame number within the epoch, from 0.
    pub frame: u64,
    /// Same for all messages of one frame, unique over epochs.
    pub trace_id: u64,
    /// Middle of the exposure on the loop's clock: CLOCK_MONOTONIC, in lock-step the simulated time.
    pub exposure_ns: u64,
    /// Size of the frame.
    pub image: ImageShape,
    /// The stages passed so far.
    pub stages: [StageStamp; MAX_STAGES],
}

impl Stamp {
    /// The stamp of a fresh frame.
    pub fn new(epoch: u64, frame: u64, exposure_ns: u64, image: ImageShape) -> Stamp {
        Stamp {
            layout: LAYOUT,
            stage_count: 0,
            epoch,
            frame,
            trace_id: trace_id(epoch, frame),
            exposure_ns,
            image,
            stages: [StageStamp::default(); MAX_STAGES],
        }
    }

    /// The same stamp with one more stage. When the array is full the last entry is replaced.
    #[must_use]
    pub fn extended(mut self, service: Service, stage: Stage, begin_ns: u64, end_ns: u64) -> Stamp {
        let slot = (self.stage_count as usize).min(MAX_STAGES - 1);
        self.stages[slot] =
            StageStamp { service: service as u16, stage: stage as u16, reserved: 0, begin_ns, end_ns };
        self.stage_count = (slot + 1) as u32;
        self
    }

    /// The stages passed so far, oldest first.
    pub fn passed(&self) -> &[StageStamp] {
        &self.stages[..(self.stage_count as usize).min(MAX_STAGES)]
    }
}

/// A number that is the same for all messages of one frame: a pure function of epoch and frame
/// (SplitMix64's finaliser).
pub fn trace_id(epoch: u64, frame: u64) -> u64 {
    let mut z = epoch ^ frame.wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stamp_has_no_padding() {
        let fields = 4 + 4 + 8 * 4 + 16 + MAX_STAGES * std::mem::size_of::<StageStamp>();
        assert_eq!(std::mem::size_of::<Stamp>(), fields);
    }

    #[test]
    fn stages_are_kept_in_order_and_never_overflow() {
        let mut stamp = Stamp::new(7, 3, 1_000, ImageShape::grey(4, 4));
        for k in 0..(MAX_STAGES as u64 + 3) {
            stamp = stamp.extended(Service::Vision, Stage::Votes, k, k + 1);
        }
        assert_eq!(stamp.passed().len(), MAX_STAGES);
        assert_eq!(stamp.passed()[0].begin_ns, 0);
        assert_eq!(stamp.passed()[MAX_STAGES - 1].begin_ns, MAX_STAGES as u64 + 2);
    }

    #[test]
    fn every_service_is_found_by_its_name_and_number() {
        for service in Service::ALL {
            assert_eq!(Service::from_name(service.name()), Some(service));
            assert_eq!(Service::from_number(service as u16), Some(service));
        }
        assert_eq!(Service::from_name("visoin"), None);
    }

    #[test]
    fn trace_ids_of_neighbouring_frames_differ() {
        let ids: std::collections::BTreeSet<u64> =
            (0..1000).flat_map(|frame| (0..3).map(move |epoch| trace_id(epoch, frame))).collect();
        assert_eq!(ids.len(), 3000);
    }
}
