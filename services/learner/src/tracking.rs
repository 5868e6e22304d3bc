//! Homing and tracking: the plain law of the paper, and the predictive one.

use crate::config::Controller;
use crate::follower::{Follower, Noise};
use crate::moment::Moment;
use crate::rest::{Motion, nanos};
use crate::step::{Activity, Command, Learner};
use serde::{Deserialize, Serialize};

/// So many detections that fit each other are a target.
const AGREEING: u32 = 3;
/// An arm slower than this looks like one at rest: 1 px from frame to frame in the default cell, rad/s.
const LOOKING_RAD_PER_S: f64 = 0.05;

/// Share of the displacement that is commanded while the map is not trusted.
const CAREFUL_STEP: f64 = 0.5;

impl Learner {
    pub(crate) fn go_home(&mut self, mut motion: Motion, moment: &Moment) {
        self.command = Command::GoTo(self.parameters.home_rad);
        self.activity = if motion.is_over_at(moment, &self.parameters) {
            Activity::Tracking(Track::default())
        } else {
            Activity::Homing(motion)
        };
    }

    /// The absolute joint target of a frame is joints *at the exposure* + displacement. Added to the
    /// joints of now, the motion during the delay would count twice: that oscillates (design, section 6).
    pub(crate) fn track(&mut self, mut track: Track, moment: &Moment) -> bool {
        let measured = moment.motion_px.map(|point_px| {
            let [theta1, theta2] = moment.joints;
            let displacement = self.displacement(point_px, theta2, moment);
            [theta1 + displacement[0], theta2 + displacement[1]]
        });
        let lost = track
            .seen_ns
            .is_none_or(|seen_ns| moment.now_ns.saturating_sub(seen_ns) >= nanos(self.parameters.lost_after));
        if lost {
            track.follower = None;
        }
        let consistent = self.lessons.consistent();
        if let Some(goal) = measured
            && consistent
            && std::mem::take(&mut track.cautious)
        {
            // The map fits again; the target never left the middle of the image.
            track.follower = Some(Follower::at(goal, moment.now_ns, &self.parameters.noise));
        }
        let used = measured.is_some_and(|goal| match self.parameters.controller {
            Controller::Predictive if !consistent => {
                // Prediction with a map that is wrong runs away, the plain law with half of its step comes
                // nearer as long as the map is less than 75 degrees off.
                track.cautious = true;
                let careful = [0, 1].map(|k| moment.joints[k] + CAREFUL_STEP * (goal[k] - moment.joints[k]));
                self.command = Command::GoTo(self.parameters.into_envelope(careful));
                true
            }
            Controller::Plain => {
                self.command = Command::GoTo(self.parameters.into_envelope(goal));
                true
            }
            Controller::Predictive => {
                let at_rest = moment.speed < LOOKING_RAD_PER_S;
                track.believe(goal, moment.now_ns, at_rest, &self.parameters.noise)
            }
        });
        if used {
            track.seen_ns = Some(moment.now_ns);
        }
        self.activity = Activity::Tracking(track);
        self.go_on(&track, moment.now_ns);
        used
    }

    /// What the arm is told between two measurements: on to where the target is going, then to rest, and
    /// home when the target has been away for long.
    fn go_on(&mut self, track: &Track, now_ns: u64) {
        let unseen = track.seen_ns.map(|seen_ns| now_ns.saturating_sub(seen_ns));
        match (unseen, &track.follower) {
            (None, _) => self.command = Command::GoTo(self.parameters.home_rad),
            (Some(unseen), _) if unseen >= nanos(self.parameters.return_after) => {
                self.command = Command::GoTo(self.parameters.home_rad);
            }
            (Some(unseen), _) if unseen >= nanos(self.parameters.lost_after) => self.command = Command::Hold,
            (Some(_), Some(follower))
                if self.parameters.controller == Controller::Predictive && !track.cautious =>
            {
                let (position, velocity) = follower.predicted(now_ns + nanos(self.parameters.lead));
                let inside = self.parameters.into_envelope(position);
                // At the envelope's edge the arm stops; it does not push.
                let velocity = [0, 1].map(|k| if inside[k] == position[k] { velocity[k] } else { 0.0 });
                self.command = Command::Follow { position: inside, velocity };
            }
            (Some(_), _) => {}
        }
    }
}

/// What tracking remembers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Track {
    /// Exposure of the last frame whose detection was used, ns.
    seen_ns: Option<u64>,
    /// The filter of the predictive law.
    follower: Option<Follower>,
    /// Whether the map did not fit in the last frame.
    cautious: bool,
    /// Another one, of what is detected elsewhere, and how many detections it has.
    tentative: Option<(Follower, u32)>,
}

impl Track {
    /// Whether a measurement is used. One that fits what is followed is. Others are followed by a
    /// tentative filter, which takes over when it has enough *and the arm is at rest*: a moving camera
    /// sees clutter that agrees with itself, and an arm that ran after it would see more of it.
    fn believe(&mut self, goal: [f64; 2], now_ns: u64, at_rest: bool, noise: &Noise) -> bool {
        if let Some(follower) = &mut self.follower
            && follower.take(goal, now_ns, noise)
        {
            self.tentative = None;
            return true;
        }
        let fits = self.tentative.as_mut().is_some_and(|(other, _)| other.take(goal, now_ns, noise));
        let (other, count) = match self.tentative {
            Some((other, count)) if fits => (other, count + 1),
            _ => (Follower::at(goal, now_ns, noise), 1),
        };
        self.tentative = Some((other, count));
        let takes_over = at_rest && count >= AGREEING;
        if takes_over {
            self.follower = self.tentative.take().map(|(other, _)| other);
        }
        takes_over
    }
}
