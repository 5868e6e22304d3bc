//! Homing and tracking: the plain law of the paper.

use crate::moment::Moment;
use crate::rest::{Motion, nanos};
use crate::step::{Activity, Command, Learner};

impl Learner {
    pub(crate) fn go_home(&mut self, mut motion: Motion, moment: &Moment) {
        self.command = Command::GoTo(self.parameters.home_rad);
        self.activity = if motion.is_over_at(moment, &self.parameters) {
            Activity::Tracking { seen_ns: None }
        } else {
            Activity::Homing(motion)
        };
    }

    /// Set-point = joints *at the exposure* + displacement. Added to the joints of now, the motion during
    /// the delay would count twice: that oscillates (design, section 6).
    pub(crate) fn track(&mut self, seen_ns: Option<u64>, moment: &Moment) {
        if let Some(point_px) = moment.motion_px {
            let [theta1, theta2] = moment.joints;
            let displacement = self.displacement(point_px, theta2, moment);
            let goal = [theta1 + displacement[0], theta2 + displacement[1]];
            self.command = Command::GoTo(self.parameters.into_envelope(goal));
            self.activity = Activity::Tracking { seen_ns: Some(moment.now_ns) };
            return;
        }
        let Some(seen_ns) = seen_ns else {
            self.command = Command::GoTo(self.parameters.home_rad);
            return;
        };
        let unseen = moment.now_ns.saturating_sub(seen_ns);
        if unseen >= nanos(self.parameters.return_after) {
            self.command = Command::GoTo(self.parameters.home_rad);
        } else if unseen >= nanos(self.parameters.lost_after) {
            self.command = Command::Hold;
        }
    }
}
