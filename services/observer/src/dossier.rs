//! What is remembered of the last frames one by one, and the page on one of them. Pure.

use crate::ears::Heard;
use pursuit_messages::{Detection, HOPS, PairOutcome, Refusal, Service, SetPoint, Stamp, Target, Votes};
use std::collections::VecDeque;
use std::fmt::Write as _;

/// Frames that are remembered.
pub const REMEMBERED: usize = 512;

/// All that was heard of one frame, without its pixels and vote fields.
#[derive(Clone, Debug, Default)]
pub struct Dossier {
    stamp: Stamp,
    votes: Option<String>,
    target: Option<Target>,
    set_point: Option<SetPoint>,
    refusal: Option<u32>,
}

/// The dossiers of the last frames.
#[derive(Debug, Default)]
pub struct Dossiers {
    kept: VecDeque<Dossier>,
}

impl Dossiers {
    /// Takes in a message.
    pub fn take(&mut self, heard: &Heard<'_>) {
        match heard {
            Heard::Frame(frame) => drop(self.of(frame.stamp())),
            Heard::Votes(stamp, votes) => self.of(stamp).votes = Some(votes_page(votes)),
            Heard::Target(stamp, target) => self.of(stamp).target = Some(**target),
            Heard::SetPoint(stamp, set_point) => self.of(stamp).set_point = Some(**set_point),
            Heard::Command(stamp, command) if stamp.passed().len() > 1 => {
                // The first command is the answer; on the wall clock it is repeated each cycle.
                let dossier = self.of(stamp);
                dossier.refusal = dossier.refusal.or(Some(command.refusal));
            }
            _ => {}
        }
    }

    /// The page on the newest frame of that number; a sentence where it is not remembered.
    pub fn page(&self, frame: u64) -> Result<String, String> {
        let found = self.kept.iter().rev().find(|dossier| dossier.stamp.frame == frame);
        let range = || match (self.kept.front(), self.kept.back()) {
            (Some(first), Some(last)) => format!("{} to {}", first.stamp.frame, last.stamp.frame),
            _ => "none yet".to_owned(),
        };
        found
            .map(Dossier::page)
            .ok_or_else(|| format!("frame {frame} is not remembered; there are {}\n", range()))
    }

    fn of(&mut self, stamp: &Stamp) -> &mut Dossier {
        let place = self.kept.iter().rposition(|dossier| dossier.stamp.trace_id == stamp.trace_id);
        let place = place.unwrap_or_else(|| {
            if self.kept.len() == REMEMBERED {
                self.kept.pop_front();
            }
            self.kept.push_back(Dossier { stamp: *stamp, ..Dossier::default() });
            self.kept.len() - 1
        });
        let dossier = &mut self.kept[place];
        if stamp.passed().len() > dossier.stamp.passed().len() {
            dossier.stamp = *stamp;
        }
        dossier
    }
}

impl Dossier {
    fn page(&self) -> String {
        let stamp = &self.stamp;
        let mut text = format!(
            "frame {} of epoch {}, {} x {} px, exposed at {:.3} s\n\n",
            stamp.frame,
            stamp.epoch,
            stamp.image.width,
            stamp.image.height,
            stamp.exposure_ns as f64 / 1e9
        );
        let mut before = None;
        for service in HOPS {
            let Some(stage) = stamp.passed().iter().find(|stage| stage.service == service as u16) else {
                let _ = writeln!(text, "{:<13} did not answer it", service.name());
                continue;
            };
            let wait = stage.begin_ns.saturating_sub(before.unwrap_or(stage.begin_ns)) as f64 / 1e3;
            let took = stage.end_ns.saturating_sub(stage.begin_ns) as f64 / 1e3;
            let _ = writeln!(text, "{:<13} waited {wait:>9.1} us, computed {took:>9.1} us", service.name());
            before = Some(stage.end_ns);
        }
        text.push_str("\nvision        ");
        text.push_str(self.votes.as_deref().unwrap_or("not heard\n"));
        if let Some(target) = &self.target {
            let all = [("pair", &target.motion), ("track", &target.track), ("blob", &target.blob)];
            for (name, detection) in all {
                let _ = writeln!(text, "segmentation  {name}: {}", detection_line(detection));
            }
        }
        if let Some(set_point) = &self.set_point {
            let [q1, q2] = set_point.position;
            let [v1, v2] = set_point.velocity;
            let what = if set_point.follow == 1 {
                format!("joints 1, 2 to ({q1:.4}, {q2:.4}) rad at ({v1:.3}, {v2:.3}) rad/s")
            } else {
                "hold".to_owned()
            };
            let used = if set_point.detected == 1 { "used" } else { "did not use" };
            let _ = writeln!(
                text,
                "learner       {what}; it {used} the detection; {} moves made",
                set_point.moves
            );
        }
        let name = Service::ArmDriver.name();
        let _ = match self.refusal {
            None => writeln!(text, "{name}    issued no command for it"),
            Some(0) => writeln!(text, "{name}    followed the set-point"),
            Some(reason) => writeln!(text, "{name}    did not follow it: {}", refusal_words(reason)),
        };
        text
    }
}

/// Why the arm driver did not follow, in words.
fn refusal_words(reason: u32) -> &'static str {
    Refusal::from_number(reason).map_or("of a reason that this version does not know", Refusal::text)
}

fn votes_page(votes: &Votes) -> String {
    if votes.valid == 0 {
        return "there was no pair to vote on\n".to_owned();
    }
    let outcome = match PairOutcome::from_number(votes.outcome) {
        Some(PairOutcome::Frozen) => ", both frames are the same",
        Some(PairOutcome::Featureless) => ", nothing that could be seen moving",
        Some(PairOutcome::Unexplained) => ", no motion of a camera explains the pair",
        _ => "",
    };
    let mut text = format!(
        "pair over {} frame(s){outcome}; background moved ({:.2}, {:.2}) px; evidence {:.2} of its threshold\n",
        votes.interval, votes.background_u, votes.background_v, votes.evidence
    );
    let count = (votes.candidate_count as usize).min(votes.candidates.len());
    for (rank, c) in votes.candidates[..count].iter().enumerate() {
        let _ = writeln!(
            text,
            "   candidate {}: at ({:.1}, {:.1}) px, relative motion ({:.2}, {:.2}) px, {:.0} px2, evidence {:.2}, explained {:.0} %, confidence {:.2}",
            rank + 1,
            c.u,
            c.v,
            c.relative[0],
            c.relative[1],
            c.area_px,
            c.evidence,
            100.0 * c.explained,
            c.confidence
        );
    }
    text
}

fn detection_line(d: &Detection) -> String {
    if d.found == 0 {
        return "none".to_owned();
    }
    format!(
        "at ({:.1}, {:.1}) px, moves ({:.2}, {:.2}) px/frame, contrast {:.2}, confidence {:.2}",
        d.u, d.v, d.vu, d.vv, d.contrast, d.confidence
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use pursuit_messages::ImageShape;

    #[test]
    fn a_frame_is_told_and_a_forgotten_one_says_what_there_is() {
        let mut dossiers = Dossiers::default();
        let stamp = |frame| Stamp::new(1, frame, 0, ImageShape::grey(8, 8));
        let mut target = Target::default();
        (target.blob.found, target.blob.u) = (1, 12.5);
        for frame in 0..=REMEMBERED as u64 {
            dossiers.take(&Heard::Target(&stamp(frame), &target));
        }
        let page = dossiers.page(1).unwrap();
        assert!(page.contains("blob: at (12.5") && page.contains("issued no command"), "{page}");
        assert!(dossiers.page(0).unwrap_err().contains("there are 1 to 512"));
    }
}
