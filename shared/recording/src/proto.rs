//! As much of protobuf as two messages of Foxglove need: writing them, reading an image, and describing both
//! (a `FileDescriptorSet`, made from the tables below). Field numbers are those of Foxglove's schemas.

use crate::RecordingError;
use crate::wire::Wire;
use crate::{MAX_SIDE, entry::Entry, entry::Sample};
use pursuit_messages::{ImageShape, Stamp};

const VARINT: u64 = 0;
const FIXED64: u64 = 1;
const BYTES: u64 = 2;
const FIXED32: u64 = 5;

/// Our field in `foxglove.RawImage`: the stamp. Not in the description, so viewers pass over it.
const STAMP: u64 = 1000;

fn varint(mut value: u64, out: &mut Vec<u8>) {
    while value >= 0x80 {
        out.push(value as u8 | 0x80);
        value >>= 7;
    }
    out.push(value as u8);
}

fn number(field: u64, value: u64, out: &mut Vec<u8>) {
    varint(field << 3 | VARINT, out);
    varint(value, out);
}

fn bytes(field: u64, value: &[u8], out: &mut Vec<u8>) {
    varint(field << 3 | BYTES, out);
    varint(value.len() as u64, out);
    out.extend_from_slice(value);
}

fn double(field: u64, value: f64, out: &mut Vec<u8>) {
    varint(field << 3 | FIXED64, out);
    out.extend_from_slice(&value.to_le_bytes());
}

fn timestamp(time_ns: u64) -> Vec<u8> {
    let mut out = Vec::new();
    number(1, time_ns / 1_000_000_000, &mut out);
    number(2, time_ns % 1_000_000_000, &mut out);
    out
}

/// `foxglove.RawImage` of a frame, with its stamp.
pub fn image(stamp: &Stamp, pixels: &[u8], out: &mut Vec<u8>) {
    out.clear();
    out.reserve(pixels.len() + 512);
    bytes(1, &timestamp(stamp.exposure_ns), out);
    varint(2 << 3 | FIXED32, out);
    out.extend_from_slice(&stamp.image.width.to_le_bytes());
    varint(3 << 3 | FIXED32, out);
    out.extend_from_slice(&stamp.image.height.to_le_bytes());
    bytes(4, b"mono8", out);
    varint(5 << 3 | FIXED32, out);
    out.extend_from_slice(&stamp.image.stride.to_le_bytes());
    bytes(6, pixels, out);
    bytes(7, b"camera", out);
    let mut own = Vec::new();
    stamp.put(&mut own);
    bytes(STAMP, &own, out);
}

/// `foxglove.PoseInFrame` in the frame of the arm's base: position in m, rotation as a unit quaternion.
pub fn pose(time_ns: u64, position: [f64; 3], rotation: [f64; 4], out: &mut Vec<u8>) {
    out.clear();
    let part = |values: &[f64]| {
        let mut part = Vec::new();
        values.iter().enumerate().for_each(|(k, value)| double(k as u64 + 1, *value, &mut part));
        part
    };
    let mut pose = Vec::new();
    bytes(1, &part(&position), &mut pose);
    bytes(2, &part(&rotation), &mut pose);
    bytes(1, &timestamp(time_ns), out);
    bytes(2, b"base", out);
    bytes(3, &pose, out);
}

/// One field of a message.
enum Field<'a> {
    Number(u64),
    Bytes(&'a [u8]),
}

/// The next field and its number; `None` at the end, an error where the bytes are none.
fn next<'a>(input: &mut &'a [u8]) -> Result<Option<(u64, Field<'a>)>, ()> {
    if input.is_empty() {
        return Ok(None);
    }
    let key = take_varint(input).ok_or(())?;
    let field = match key & 7 {
        VARINT => Field::Number(take_varint(input).ok_or(())?),
        FIXED64 => Field::Number(u64::take(input).ok_or(())?),
        FIXED32 => Field::Number(u64::from(u32::take(input).ok_or(())?)),
        BYTES => {
            let length = usize::try_from(take_varint(input).ok_or(())?).map_err(|_| ())?;
            let (head, rest) = input.split_at_checked(length).ok_or(())?;
            *input = rest;
            Field::Bytes(head)
        }
        _ => return Err(()),
    };
    Ok(Some((key >> 3, field)))
}

fn take_varint(input: &mut &[u8]) -> Option<u64> {
    let mut value = 0;
    for shift in (0..64).step_by(7) {
        let (byte, rest) = input.split_first()?;
        *input = rest;
        value |= u64::from(byte & 0x7f) << shift;
        if byte & 0x80 == 0 {
            return Some(value);
        }
    }
    None
}

/// A frame out of a `foxglove.RawImage`; one of another program gets the number `count` and its own time.
///
/// # Errors
/// Not an image, not grey, too large, or not as many bytes as it says.
pub fn read_image(mut input: &[u8], log_ns: u64, count: u64) -> Result<Entry, RecordingError> {
    let damaged = || RecordingError::Damaged { bytes: 0, cause: format!("image {count} is broken") };
    let (mut shape, mut stride) = (ImageShape::grey(0, 0), 0);
    let (mut encoding, mut pixels, mut own): (&[u8], &[u8], &[u8]) = (b"", b"", b"");
    let side = |value: u64| u32::try_from(value).unwrap_or(u32::MAX);
    while let Some((number, field)) = next(&mut input).map_err(|()| damaged())? {
        match (number, field) {
            (2, Field::Number(value)) => shape.width = side(value),
            (3, Field::Number(value)) => shape.height = side(value),
            (4, Field::Bytes(value)) => encoding = value,
            (5, Field::Number(value)) => stride = side(value),
            (6, Field::Bytes(value)) => pixels = value,
            (STAMP, Field::Bytes(value)) => own = value,
            _ => {}
        }
    }
    if encoding != b"mono8" && encoding != b"8UC1" {
        let name: String =
            String::from_utf8_lossy(encoding).chars().filter(|c| !c.is_control()).take(32).collect();
        return Err(RecordingError::Encoding(name));
    }
    if shape.width > MAX_SIDE || shape.height > MAX_SIDE {
        let what = format!("an image of {} x {} px", shape.width, shape.height);
        return Err(RecordingError::TooLarge { what, limit: format!("{MAX_SIDE} x {MAX_SIDE} px") });
    }
    shape.stride = stride;
    let fits = shape.width > 0 && shape.height > 0 && stride >= shape.width;
    if !fits || u64::from(stride) * u64::from(shape.height) != pixels.len() as u64 {
        return Err(damaged());
    }
    let stamp = if own.is_empty() {
        Stamp::new(1, count, log_ns, shape)
    } else {
        Stamp::take(&mut own).filter(|stamp| own.is_empty() && stamp.image == shape).ok_or_else(damaged)?
    };
    Ok(Entry { log_ns, stamp, sample: Sample::Frame(pixels.to_vec()) })
}

// Types in a description of a field.
const DOUBLE: u64 = 1;
const INT64: u64 = 3;
const INT32: u64 = 5;
const FIXED32_TYPE: u64 = 7;
const STRING: u64 = 9;
const MESSAGE: u64 = 11;
const BYTES_TYPE: u64 = 12;

/// Name, number, type, and of messages the name of the type.
type Row = (&'static str, u64, u64, &'static str);

const TIMESTAMP: &[Row] = &[("seconds", 1, INT64, ""), ("nanos", 2, INT32, "")];
const VECTOR3: &[Row] = &[("x", 1, DOUBLE, ""), ("y", 2, DOUBLE, ""), ("z", 3, DOUBLE, "")];
const QUATERNION: &[Row] =
    &[("x", 1, DOUBLE, ""), ("y", 2, DOUBLE, ""), ("z", 3, DOUBLE, ""), ("w", 4, DOUBLE, "")];
const POSE: &[Row] =
    &[("position", 1, MESSAGE, ".foxglove.Vector3"), ("orientation", 2, MESSAGE, ".foxglove.Quaternion")];
const POSE_IN_FRAME: &[Row] = &[
    ("timestamp", 1, MESSAGE, ".google.protobuf.Timestamp"),
    ("frame_id", 2, STRING, ""),
    ("pose", 3, MESSAGE, ".foxglove.Pose"),
];
const RAW_IMAGE: &[Row] = &[
    ("timestamp", 1, MESSAGE, ".google.protobuf.Timestamp"),
    ("width", 2, FIXED32_TYPE, ""),
    ("height", 3, FIXED32_TYPE, ""),
    ("encoding", 4, STRING, ""),
    ("step", 5, FIXED32_TYPE, ""),
    ("data", 6, BYTES_TYPE, ""),
    ("frame_id", 7, STRING, ""),
];

/// The `FileDescriptorSet` of both messages.
pub fn description() -> Vec<u8> {
    let time = file("google/protobuf/timestamp.proto", "google.protobuf", &[], &[("Timestamp", TIMESTAMP)]);
    let messages = [
        ("Vector3", VECTOR3),
        ("Quaternion", QUATERNION),
        ("Pose", POSE),
        ("PoseInFrame", POSE_IN_FRAME),
        ("RawImage", RAW_IMAGE),
    ];
    let own = file("foxglove/pursuit.proto", "foxglove", &["google/protobuf/timestamp.proto"], &messages);
    let mut out = Vec::new();
    bytes(1, &time, &mut out);
    bytes(1, &own, &mut out);
    out
}

fn file(name: &str, package: &str, needs: &[&str], messages: &[(&str, &[Row])]) -> Vec<u8> {
    let mut out = Vec::new();
    bytes(1, name.as_bytes(), &mut out);
    bytes(2, package.as_bytes(), &mut out);
    needs.iter().for_each(|need| bytes(3, need.as_bytes(), &mut out));
    for (name, rows) in messages {
        let mut message = Vec::new();
        bytes(1, name.as_bytes(), &mut message);
        for (name, at, kind, type_name) in *rows {
            let mut field = Vec::new();
            bytes(1, name.as_bytes(), &mut field);
            number(3, *at, &mut field);
            number(4, 1, &mut field);
            number(5, *kind, &mut field);
            if !type_name.is_empty() {
                bytes(6, type_name.as_bytes(), &mut field);
            }
            bytes(2, &field, &mut message);
        }
        bytes(4, &message, &mut out);
    }
    bytes(12, b"proto3", &mut out);
    out
}
