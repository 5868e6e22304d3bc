//! Which frames were answered. Pure.

use pursuit_messages::Stamp;

/// A frame whose world is gone can be answered by nobody.
#[derive(Clone, Copy, Debug)]
struct Exposed {
    epoch: u64,
    frame: u64,
    exposure_ns: u64,
    answered_ns: Option<u64>,
}

/// All frames of a run, in the order of their exposure.
#[derive(Default)]
pub struct Frames {
    all: Vec<Exposed>,
}

/// Frames looked back for an answer.
const BACK: usize = 64;

impl Frames {
    /// A frame was exposed.
    pub fn exposed(&mut self, stamp: &Stamp) {
        let is_new = self.all.last().is_none_or(|last| (last.epoch, last.frame) < (stamp.epoch, stamp.frame));
        if is_new {
            let (epoch, frame, exposure_ns) = (stamp.epoch, stamp.frame, stamp.exposure_ns);
            self.all.push(Exposed { epoch, frame, exposure_ns, answered_ns: None });
        }
    }

    /// A command answers a frame at `time_ns`.
    pub fn answered(&mut self, stamp: &Stamp, time_ns: u64) {
        let wanted = (stamp.epoch, stamp.frame);
        let found = self.all.iter_mut().rev().take(BACK).find(|frame| (frame.epoch, frame.frame) == wanted);
        if let Some(frame) = found {
            frame.answered_ns.get_or_insert(time_ns);
        }
    }

    /// How many frames exposed in `[from_ns, to_ns)` were not answered.
    pub fn unanswered(&self, from_ns: u64, to_ns: u64) -> usize {
        self.within(from_ns, to_ns).filter(|frame| frame.answered_ns.is_none()).count()
    }

    /// How many were exposed in that time.
    pub fn count(&self, from_ns: u64, to_ns: u64) -> usize {
        self.within(from_ns, to_ns).count()
    }

    /// Share of all frames exposed before `to_ns` that were answered within `limit_ns`.
    pub fn availability(&self, to_ns: u64, limit_ns: u64) -> f64 {
        let in_time = |frame: &&Exposed| {
            frame.answered_ns.is_some_and(|at| at.saturating_sub(frame.exposure_ns) <= limit_ns)
        };
        let all = self.count(0, to_ns).max(1);
        self.within(0, to_ns).filter(in_time).count() as f64 / all as f64
    }

    fn within(&self, from_ns: u64, to_ns: u64) -> impl Iterator<Item = &Exposed> {
        self.all.iter().filter(move |frame| (from_ns..to_ns).contains(&frame.exposure_ns))
    }
}
