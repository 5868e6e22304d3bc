//! The run's journal: one line per frame and one per training move, for reports and for any tool that
//! opens CSV. Numbers are written so that they read back to the bit.

use pursuit_messages::{HOPS, Stamp};
use std::fmt::Write as _;
use std::str::FromStr;

/// The journal of a run without an end begins anew when it has grown to this: an hour or two, in memory.
pub const MAX_ENDLESS_BYTES: u64 = 32 << 20;

/// One frame of a run: what was true, what was answered, how long it took.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Record {
    /// Number of the frame.
    pub frame: u64,
    /// Simulated time of the exposure, s.
    pub time_s: f64,
    /// [`pursuit_messages::Phase`] as a number.
    pub phase: u32,
    /// Training moves finished.
    pub moves: u32,
    /// 1 where the frame's detection was used.
    pub detected: u32,
    /// [`pursuit_messages::Refusal`] as a number, 0 where the set-point was followed.
    pub refusal: u32,
    /// Camera above the table, base frame, m.
    pub camera_m: [f64; 2],
    /// Target on the table, base frame, m.
    pub target_m: [f64; 2],
    /// Where the set-point would bring the camera, m: the measured target through the learnt map.
    pub aimed_m: [f64; 2],
    /// 1 where the target's place was within the image.
    pub in_view: u32,
    /// 1 from the scheduled change of the cell on.
    pub changed: u32,
    /// 1 where there was a glare on the lens.
    pub glare: u32,
    /// Computing time per hop, µs, as in [`HOPS`].
    pub compute_us: [f64; 5],
    /// Waiting time before each hop, µs.
    pub wait_us: [f64; 5],
    /// From the start of the exposure's rendering to the issued command, µs.
    pub end_to_end_us: f64,
}

impl Record {
    /// Horizontal distance from the camera's axis to the target, cm.
    pub fn error_cm(&self) -> f64 {
        100.0 * (self.camera_m[0] - self.target_m[0]).hypot(self.camera_m[1] - self.target_m[1])
    }

    /// Fills in the times from the stamp of the frame's command.
    pub fn take_times(&mut self, stamp: &Stamp) {
        let mut last_end = None;
        for passed in stamp.passed() {
            let Some(hop) = HOPS.iter().position(|service| *service as u16 == passed.service) else {
                continue;
            };
            self.compute_us[hop] = passed.end_ns.saturating_sub(passed.begin_ns) as f64 / 1e3;
            self.wait_us[hop] = last_end.map_or(0.0, |end| passed.begin_ns.saturating_sub(end) as f64 / 1e3);
            last_end = Some(passed.end_ns);
        }
        if let (Some(first), Some(last)) = (stamp.passed().first(), stamp.passed().last()) {
            self.end_to_end_us = last.end_ns.saturating_sub(first.begin_ns) as f64 / 1e3;
        }
    }

    /// The columns' names.
    pub fn header() -> String {
        let mut text = String::from(
            "frame,time_s,phase,moves,detected,refusal,camera_x_m,camera_y_m,target_x_m,target_y_m,aimed_x_m,aimed_y_m,in_view,changed,glare",
        );
        for hop in HOPS {
            let name = hop.name();
            let _ = write!(text, ",{name}_compute_us,{name}_wait_us");
        }
        text.push_str(",end_to_end_us\n");
        text
    }

    /// Appends the record as one line.
    pub fn write(&self, text: &mut String) {
        let _ = write!(
            text,
            "{},{},{},{},{},{},{},{},{},{},{},{},{},{},{}",
            self.frame,
            self.time_s,
            self.phase,
            self.moves,
            self.detected,
            self.refusal,
            self.camera_m[0],
            self.camera_m[1],
            self.target_m[0],
            self.target_m[1],
            self.aimed_m[0],
            self.aimed_m[1],
            self.in_view,
            self.changed,
            self.glare,
        );
        for hop in 0..HOPS.len() {
            let _ = write!(text, ",{},{}", self.compute_us[hop], self.wait_us[hop]);
        }
        let _ = writeln!(text, ",{}", self.end_to_end_us);
    }

    /// Reads a line back; `None` for the header and for half a line.
    pub fn parse(line: &str) -> Option<Record> {
        let mut fields = line.trim_end().split(',');
        let mut record = Record {
            frame: field(&mut fields)?,
            time_s: field(&mut fields)?,
            phase: field(&mut fields)?,
            moves: field(&mut fields)?,
            detected: field(&mut fields)?,
            refusal: field(&mut fields)?,
            camera_m: [field(&mut fields)?, field(&mut fields)?],
            target_m: [field(&mut fields)?, field(&mut fields)?],
            aimed_m: [field(&mut fields)?, field(&mut fields)?],
            in_view: field(&mut fields)?,
            changed: field(&mut fields)?,
            glare: field(&mut fields)?,
            ..Record::default()
        };
        for hop in 0..HOPS.len() {
            record.compute_us[hop] = field(&mut fields)?;
            record.wait_us[hop] = field(&mut fields)?;
        }
        record.end_to_end_us = field(&mut fields)?;
        Some(record)
    }
}

/// One training move of a run.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MoveRecord {
    /// Number of the move, from 1.
    pub number: u32,
    /// Frame at which it was finished.
    pub frame: u64,
    /// Training target that it went to.
    pub target_index: u32,
    /// One-shot error of the map after it: median over the evaluation grid, cm.
    pub error_cm: f64,
    /// 90th percentile over the grid, cm.
    pub error_p90_cm: f64,
    /// Where the move itself ended: distance of the camera's axis to the blob, cm.
    pub arrived_cm: f64,
    /// Samples in the ring.
    pub ring: u32,
    /// Mean error over the ring after the refit.
    pub loss: f64,
    /// Computing time of the refit, µs.
    pub refit_us: f64,
}

impl MoveRecord {
    /// The columns' names.
    pub fn header() -> &'static str {
        "move,frame,target,error_cm,error_p90_cm,arrived_cm,ring,loss,refit_us\n"
    }

    /// Appends the record as one line.
    pub fn write(&self, text: &mut String) {
        let _ = writeln!(
            text,
            "{},{},{},{},{},{},{},{},{}",
            self.number,
            self.frame,
            self.target_index,
            self.error_cm,
            self.error_p90_cm,
            self.arrived_cm,
            self.ring,
            self.loss,
            self.refit_us
        );
    }

    /// Reads a line back; `None` for the header and for half a line.
    pub fn parse(line: &str) -> Option<MoveRecord> {
        let mut fields = line.trim_end().split(',');
        Some(MoveRecord {
            number: field(&mut fields)?,
            frame: field(&mut fields)?,
            target_index: field(&mut fields)?,
            error_cm: field(&mut fields)?,
            error_p90_cm: field(&mut fields)?,
            arrived_cm: field(&mut fields)?,
            ring: field(&mut fields)?,
            loss: field(&mut fields)?,
            refit_us: field(&mut fields)?,
        })
    }
}

fn field<'a, T: FromStr>(fields: &mut impl Iterator<Item = &'a str>) -> Option<T> {
    fields.next()?.parse().ok()
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use pursuit_messages::{ImageShape, Service, Stage};

    #[test]
    fn a_record_reads_back_to_the_bit() {
        let mut record = Record { frame: 12, time_s: 0.1 + 0.2, phase: 2, ..Record::default() };
        record.camera_m = [1.0 / 3.0, -2e-17];
        record.compute_us[4] = 0.7;
        let mut text = String::new();
        record.write(&mut text);
        assert_eq!(Record::parse(&text), Some(record));
        assert_eq!(Record::header().split(',').count(), text.split(',').count());
    }

    #[test]
    fn half_a_line_and_the_header_are_no_records() {
        let mut text = String::new();
        Record::default().write(&mut text);
        assert!(Record::parse(&text[..text.len() - 4]).is_none() || !text.ends_with('\n'));
        assert!(Record::parse(&text[..text.len() / 2]).is_none());
        assert!(Record::parse(&Record::header()).is_none());
        assert!(MoveRecord::parse(MoveRecord::header()).is_none());
    }

    #[test]
    fn waiting_and_computing_are_told_apart() {
        let stamp = Stamp::new(1, 1, 0, ImageShape::grey(4, 4))
            .extended(Service::Acquisition, Stage::Expose, 1_000, 3_000)
            .extended(Service::Vision, Stage::Votes, 8_000, 9_000);
        let mut record = Record::default();
        record.take_times(&stamp);
        assert_eq!(record.compute_us[..2], [2.0, 1.0]);
        assert_eq!(record.wait_us[..2], [0.0, 5.0]);
        assert_eq!(record.end_to_end_us, 8.0);
    }
}
