//! Is the arm there, is it still, and what is seen when it is.

use pursuit_learning::View;
use serde::{Deserialize, Serialize};

use crate::config::{MAX_STILL_FRAMES, Parameters};
use crate::moment::Moment;

/// A target that is seen within this distance, px, is in one place: some times the noise of a detection.
const STILL_PX: f64 = 4.0;
/// Time in which a moving arm comes to rest: the latency of a command and the braking itself, ns.
const BRAKING_NS: f64 = 160e6;
/// So far out, in half images, a target begins to be cut off.
const EDGE: f64 = 0.95;

/// A motion to a set-point.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Motion {
    goal: [f64; 2],
    began_ns: u64,
    still_since_ns: Option<u64>,
    still_frames: u32,
    /// What is watched for: that the target does not leave the image.
    watch: Option<Watch>,
}

/// How far out the target was when it was last seen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Watch {
    last: Option<(u64, f64)>,
}

impl Motion {
    pub(crate) fn to(goal: [f64; 2], now_ns: u64) -> Motion {
        Motion { goal, began_ns: now_ns, still_since_ns: None, still_frames: 0, watch: None }
    }

    /// A motion that shall not lose sight of the target: see [`Motion::loses_sight`].
    pub(crate) fn watched(self) -> Motion {
        Motion { watch: Some(Watch::default()), ..self }
    }

    /// Whether a target that goes on as since the last frame is out of view before the arm can be at rest.
    pub(crate) fn loses_sight(&mut self, moment: &Moment) -> bool {
        let (Some(watch), Some(blob)) = (&mut self.watch, &moment.blob) else { return false };
        let before = watch.last.replace((moment.now_ns, blob.off_centre));
        let Some((since_ns, off_centre)) = before else { return false };
        let passed_ns = moment.now_ns.saturating_sub(since_ns) as f64;
        let speed = (blob.off_centre - off_centre) / passed_ns;
        speed > 0.0 && blob.off_centre + speed * BRAKING_NS > EDGE
    }

    /// Takes the frame into account and says whether the motion is over: arrived and still, or stalled,
    /// or too long.
    pub(crate) fn is_over_at(&mut self, moment: &Moment, parameters: &Parameters) -> bool {
        let passed = |since_ns: u64| moment.now_ns.saturating_sub(since_ns);
        if moment.speed < parameters.still_rad_per_s {
            self.still_since_ns.get_or_insert(moment.now_ns);
            self.still_frames += 1;
        } else {
            (self.still_since_ns, self.still_frames) = (None, 0);
        }
        let off = |joint: usize| (moment.joints[joint] - self.goal[joint]).abs();
        let arrived = off(0).max(off(1)) < parameters.arrived_rad;
        let stalled = self.still_since_ns.is_some_and(|since| passed(since) >= nanos(parameters.stall));
        (arrived && self.still_frames >= parameters.settle_frames)
            || stalled
            || passed(self.began_ns) >= nanos(parameters.move_limit)
    }
}

/// Frames of the arm at rest, collected one by one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Observation {
    still_frames: u32,
    looked: u32,
    views: [View; MAX_STILL_FRAMES],
    seen: u32,
    cut_off: bool,
}

/// What was seen at rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Sight {
    /// Median of the frames, axis by axis.
    pub(crate) view: View,
    /// Whether the target was whole in all of them.
    pub(crate) whole: bool,
}

impl Observation {
    /// Takes the frame in, if the arm has been still long enough and frames are still wanted; begins anew
    /// when the arm moves.
    pub(crate) fn take(&mut self, moment: &Moment, parameters: &Parameters) {
        if moment.speed >= parameters.still_rad_per_s {
            *self = Observation::default();
            return;
        }
        self.still_frames = self.still_frames.saturating_add(1);
        if self.still_frames <= parameters.settle_frames || self.is_complete(parameters) {
            return;
        }
        self.looked += 1;
        if let Some(blob) = &moment.blob
            && let Some(place) = self.views.get_mut(self.seen as usize)
        {
            *place = blob.view;
            self.seen += 1;
            self.cut_off |= !blob.whole;
        }
    }

    /// Whether it has looked often enough: longer where what it has seen does not agree.
    pub(crate) fn is_complete(&self, parameters: &Parameters) -> bool {
        self.looked >= parameters.still_frames && (self.agrees() || self.looked >= MAX_STILL_FRAMES as u32)
    }

    /// Whether the target was somewhere else from frame to frame though the arm was at rest.
    pub(crate) fn is_restless(&self) -> bool {
        self.seen > 0 && !self.agrees()
    }

    /// Whether it was mostly not seen, or mostly in one place.
    fn agrees(&self) -> bool {
        let Some(median) = self.median() else { return true };
        let near = |view: &View| {
            let off = [0, 1].map(|k| view.point_px[k] - median.point_px[k]);
            off[0].hypot(off[1]) < STILL_PX
        };
        2 * self.views[..self.seen as usize].iter().filter(|view| near(view)).count() > self.seen as usize
    }

    /// The median view; `None` where the target was seen in less than half of the frames, or not in one
    /// place.
    pub(crate) fn sight(&self) -> Option<Sight> {
        let view = self.median().filter(|_| self.agrees())?;
        Some(Sight { view, whole: !self.cut_off })
    }

    fn median(&self) -> Option<View> {
        if self.seen == 0 || 2 * self.seen < self.looked {
            return None;
        }
        let median = |value: fn(&View) -> f64| {
            let mut values = [f64::INFINITY; MAX_STILL_FRAMES];
            for (place, view) in values.iter_mut().zip(&self.views[..self.seen as usize]) {
                *place = value(view);
            }
            values.sort_by(f64::total_cmp);
            let upper = self.seen as usize / 2;
            let lower = (self.seen as usize - 1) / 2;
            0.5 * (values[lower] + values[upper])
        };
        Some(View {
            point_px: [median(|view| view.point_px[0]), median(|view| view.point_px[1])],
            joints: [median(|view| view.joints[0]), median(|view| view.joints[1])],
            velocities: [0.0; 2],
        })
    }
}

pub(crate) fn nanos(duration: std::time::Duration) -> u64 {
    u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::moment::Blob;
    use pursuit_learning::Normalisation;

    const FRAME_NS: u64 = 40_000_000;

    fn moment(frame: u64, speed: f64, point: Option<f64>) -> Moment {
        let view = |x| View { point_px: [x, -x], joints: [0.0, 0.6], velocities: [0.0; 2] };
        Moment {
            frame,
            now_ns: frame * FRAME_NS,
            joints: [0.0, 0.6],
            velocities: [speed, 0.0],
            background: None,
            speed,
            blob: point.map(|x| Blob { view: view(x), whole: true, off_centre: x.abs() / 256.0 }),
            motion: None,
            normalisation: Normalisation { half_width_px: 256.0 },
        }
    }

    #[test]
    fn one_wild_detection_does_not_move_the_median() {
        let parameters = Parameters::default();
        let mut observation = Observation::default();
        for (frame, x) in [100.0, 100.0, 1.0, 3.0, 200.0, 2.0, 4.0, 9.0].into_iter().enumerate() {
            observation.take(&moment(frame as u64, 0.0, Some(x)), &parameters);
        }
        // Two frames to settle, five looked at (1, 3, 200, 2, 4), the last not wanted.
        assert_eq!(observation.sight().unwrap().view.point_px, [3.0, -3.0]);
    }

    #[test]
    fn an_arm_that_moves_begins_anew() {
        let parameters = Parameters::default();
        let mut observation = Observation::default();
        for (frame, speed) in [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.1].into_iter().enumerate() {
            observation.take(&moment(frame as u64, speed, Some(1.0)), &parameters);
        }
        assert!(!observation.is_complete(&parameters));
        assert_eq!(observation.sight(), None);
    }

    #[test]
    fn seen_in_the_minority_of_frames_is_not_seen() {
        let parameters = Parameters::default();
        let mut observation = Observation::default();
        for (frame, x) in [None, None, None, None, None, Some(1.0), Some(1.0)].into_iter().enumerate() {
            observation.take(&moment(frame as u64, 0.0, x), &parameters);
        }
        assert!(observation.is_complete(&parameters));
        assert_eq!(observation.sight(), None);
    }

    #[test]
    fn a_target_on_its_way_out_is_noticed_before_it_is_gone() {
        let loses_sight = |motion: Motion, points: &[f64]| {
            let mut motion = motion;
            let see = |(frame, x): (usize, &f64)| motion.loses_sight(&moment(frame as u64, 0.5, Some(*x)));
            points.iter().enumerate().map(see).collect::<Vec<bool>>()
        };
        let motion = Motion::to([0.2, 0.6], 0);
        // 20 px a frame: four frames later it is where the image ends.
        let leaving = [120.0, 140.0, 160.0, 180.0];
        assert_eq!(loses_sight(motion.watched(), &leaving), [false, false, false, true]);
        assert_eq!(loses_sight(motion, &leaving), [false; 4]);
        assert_eq!(loses_sight(motion.watched(), &[240.0, 220.0, 200.0, 180.0]), [false; 4]);
    }

    #[test]
    fn a_motion_waits_out_the_latency_of_its_command_and_ends_when_it_stalls() {
        let parameters = Parameters::default();
        let mut motion = Motion::to([0.2, 0.6], 0);
        let over: Vec<bool> =
            (1..=14).map(|frame| motion.is_over_at(&moment(frame, 0.0, None), &parameters)).collect();
        // Still since frame 1: the stall of 0.5 s is reached 13 frames later.
        assert!(over[..13].iter().all(|over| !over) && over[13]);
    }
}
