//! The exact payloads as bytes: all fields in their order, little-endian, without padding.

use crate::entry::{Entry, Sample, Topic};
use pursuit_messages::{
    Candidate, Detection, DriveCycle, DriverState, Health, ImageShape, Joints, LearnerState, SetPoint,
    StageStamp, Stamp, Target, Votes, WorldCommand, WorldState,
};

/// What can be written as bytes and read back to the bit.
pub trait Wire: Sized {
    /// Appends it.
    fn put(&self, out: &mut Vec<u8>);
    /// Takes it from the front; `None` where there are too few bytes.
    fn take(input: &mut &[u8]) -> Option<Self>;
}

macro_rules! numbers {
    ($($number:ty),*) => { $(
        impl Wire for $number {
            fn put(&self, out: &mut Vec<u8>) {
                out.extend_from_slice(&self.to_le_bytes());
            }
            fn take(input: &mut &[u8]) -> Option<Self> {
                let (head, rest) = input.split_first_chunk()?;
                *input = rest;
                Some(<$number>::from_le_bytes(*head))
            }
        }
    )* };
}

numbers!(u16, u32, u64, i32, i64, f32, f64);

impl<T: Wire + Copy, const N: usize> Wire for [T; N] {
    fn put(&self, out: &mut Vec<u8>) {
        out.reserve(size_of::<Self>());
        self.iter().for_each(|value| value.put(out));
    }
    fn take(input: &mut &[u8]) -> Option<Self> {
        let mut all = [T::take(input)?; N];
        for value in &mut all[1..] {
            *value = T::take(input)?;
        }
        Some(all)
    }
}

/// A field that is missing here does not compile.
macro_rules! payload {
    ($payload:ident { $($field:ident),* $(,)? }) => {
        impl Wire for $payload {
            fn put(&self, out: &mut Vec<u8>) {
                let $payload { $($field),* } = self;
                $($field.put(out);)*
            }
            fn take(input: &mut &[u8]) -> Option<Self> {
                Some($payload { $($field: Wire::take(input)?),* })
            }
        }
    };
}

payload!(ImageShape { width, height, stride, format });
payload!(StageStamp { service, stage, reserved, begin_ns, end_ns });
payload!(Stamp { layout, stage_count, epoch, frame, trace_id, exposure_ns, image, stages });
payload!(Candidate {
    u,
    v,
    vu,
    vv,
    relative,
    area_px,
    confidence,
    position_covariance,
    velocity_sd,
    evidence,
    explained
});
payload!(Votes {
    valid,
    mode,
    outcome,
    candidate_count,
    columns,
    rows,
    passes,
    shift_u,
    shift_v,
    cell_px,
    interval,
    coherence,
    coherence_sum,
    background_u,
    background_v,
    pyramid_ns,
    votes_ns,
    compensation_ns,
    competition_ns,
    motion,
    evidence,
    candidates,
    fields
});
payload!(Detection {
    found,
    reserved,
    u,
    v,
    vu,
    vv,
    confidence,
    area_px,
    contrast,
    position_covariance,
    velocity_sd
});
payload!(Target {
    motion,
    track,
    track_phase,
    track_id,
    blob,
    background_u,
    background_v,
    background_turn_rad,
    background_frames,
    reserved,
    segmentation_ns
});
payload!(Joints { time_ns, position, velocity, following, refusal });
payload!(SetPoint { follow, phase, position, velocity, moves, target_index, detected, reserved });
payload!(LearnerState {
    phase,
    moves,
    target_index,
    ring,
    samples,
    version,
    refits_merged,
    refits_rejected,
    refit_ns,
    loss,
    changes,
    consistent,
    surprise,
    uncertainty_rad,
    clock_offset_ns,
    lead_ns,
    refused,
    weight_count,
    hidden,
    weights
});
payload!(WorldState {
    time_ns,
    exposes,
    glares,
    scene,
    finished,
    position,
    velocity,
    issued_position,
    issued_velocity,
    demanded_position,
    camera_position,
    camera_rotation,
    focal_px,
    glare_px,
    glare_radius_px,
    target_position,
    target_heading,
    target_velocity
});
payload!(DriveCycle { position, velocity });
payload!(DriverState { time_ns, since_ns, answered, pid, state, cause, answer, at_rest, refusal });
payload!(Health { service, pid, time_ns, frame, answered, skipped, refused, degraded, standing_by });
payload!(WorldCommand { cycle_count, refusal, cycle_ns, set_point, cycles });

/// Stamp and payload of what is not a frame; which topic it belongs to.
pub fn encode(entry: &Entry, out: &mut Vec<u8>) -> Option<Topic> {
    out.clear();
    entry.stamp.put(out);
    Some(match &entry.sample {
        Sample::Frame(_) => return None,
        Sample::Votes(votes) => put(votes.as_ref(), Topic::Votes, out),
        Sample::Target(target) => put(target.as_ref(), Topic::Target, out),
        Sample::Joints(joints) => put(joints, Topic::Joints, out),
        Sample::SetPoint(point) => put(point, Topic::SetPoint, out),
        Sample::Learner(state) => put(state.as_ref(), Topic::Learner, out),
        Sample::World(world) => put(world.as_ref(), Topic::World, out),
        Sample::Command(command) => put(command.as_ref(), Topic::Command, out),
        Sample::Driver(state) => put(state, Topic::Driver, out),
        Sample::Health(health) => put(health, Topic::Health, out),
    })
}

fn put(payload: &impl Wire, topic: Topic, out: &mut Vec<u8>) -> Topic {
    payload.put(out);
    topic
}

/// The message of a topic; `None` where the bytes do not fit it.
pub fn decode(topic: Topic, log_ns: u64, mut bytes: &[u8]) -> Option<Entry> {
    let input = &mut bytes;
    let stamp = Stamp::take(input)?;
    let sample = match topic {
        Topic::Votes => Sample::Votes(Box::new(Wire::take(input)?)),
        Topic::Target => Sample::Target(Box::new(Wire::take(input)?)),
        Topic::Joints => Sample::Joints(Wire::take(input)?),
        Topic::SetPoint => Sample::SetPoint(Wire::take(input)?),
        Topic::Learner => Sample::Learner(Box::new(Wire::take(input)?)),
        Topic::World => Sample::World(Box::new(Wire::take(input)?)),
        Topic::Command => Sample::Command(Box::new(Wire::take(input)?)),
        Topic::Driver => Sample::Driver(Wire::take(input)?),
        Topic::Health => Sample::Health(Wire::take(input)?),
    };
    input.is_empty().then_some(Entry { log_ns, stamp, sample })
}
