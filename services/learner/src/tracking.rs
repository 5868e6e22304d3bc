//! Homing and tracking: the plain law of the paper, and the predictive one.

use crate::chart::{Chart, Map};
use crate::config::{Controller, Lead, Parameters};
use crate::delay::Delay;
use crate::follower::{Follower, Sighting};
use crate::moment::Moment;
use crate::refusals::Refused;
use crate::rest::{Motion, nanos};
use crate::step::{Activity, Command, Learner};
use pursuit_learning::{Network, Normalisation};
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// So many detections that fit each other are a target.
const AGREEING: u32 = 3;
/// An arm slower than this looks like one at rest: 1 px from frame to frame in the default cell, rad/s.
const LOOKING_RAD_PER_S: f64 = 0.05;
/// What a detection without a covariance is said to have, px².
const UNCLAIMED_PX2: f64 = 1.0;
/// Share of the displacement that is commanded while the map does not fit.
const CAREFUL_STEP: f64 = 0.5;
/// Longest time from frame to frame over which a set-point's velocity is the mean, ns.
const LONGEST_FRAME_NS: u64 = 100_000_000;

/// How far the map is to be relied on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reliance {
    /// Whether it foretells how the image moves.
    pub consistent: bool,
    /// Share of what it says that may be commanded: 1 where it knows, less where it hardly does, 0..1.
    pub trust: f64,
}

impl Reliance {
    /// For a map that is known to be right.
    pub const FULL: Reliance = Reliance { consistent: true, trust: 1.0 };
}

/// The network as a hand-eye map.
struct Learnt<'a> {
    network: &'a Network,
    normalisation: Normalisation,
    parameters: &'a Parameters,
}

impl Map for Learnt<'_> {
    fn displacement(&self, point_px: [f64; 2], theta2: f64) -> [f64; 2] {
        let output = self.network.predict(self.normalisation.input(point_px, theta2));
        self.parameters.shortened(self.normalisation.displacement(output))
    }

    fn rotation_sign(&self) -> f64 {
        self.parameters.learning.rotation_sign
    }
}

impl Learner {
    pub(crate) fn go_home(&mut self, mut motion: Motion, moment: &Moment) {
        self.command = Command::GoTo(self.parameters.home_rad);
        self.activity = if motion.is_over_at(moment, &self.parameters) {
            Activity::Tracking(Track::default())
        } else {
            Activity::Homing(motion)
        };
    }

    /// Follows with the learnt map; whether the frame's detection was used.
    pub(crate) fn track(&mut self, mut track: Track, moment: &Moment) -> bool {
        let mut moment = *moment;
        let mut reliance = Reliance { consistent: self.lessons.consistent(), ..Reliance::FULL };
        if let Some(point_px) = moment.motion_px() {
            reliance.trust = self.displacement(point_px, moment.joints[1], &moment).trust;
            if reliance.trust <= 0.0 {
                // What the map says of it is a guess.
                self.refusals.add(Refused::Ignorant, 1);
                moment.motion = None;
            }
        }
        let map = Learnt {
            network: self.trainer.network(),
            normalisation: moment.normalisation,
            parameters: &self.parameters,
        };
        let (command, used) = track.step(&moment, &map, reliance, &self.parameters);
        if let Some(command) = command {
            self.command = command;
        }
        self.activity = Activity::Tracking(track);
        used
    }

    /// Time from a set-point to its effect, as it is predicted over now.
    pub fn lead(&self) -> Duration {
        match &self.activity {
            Activity::Tracking(track) => track.lead(&self.parameters),
            _ => self.parameters.lead.prior(),
        }
    }
}

/// What tracking remembers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Track {
    /// Exposure of the last frame whose detection was used, ns.
    seen_ns: Option<u64>,
    /// Exposure of the last frame, ns.
    last_ns: Option<u64>,
    /// Where the camera is.
    chart: Option<Chart>,
    /// The filter of the predictive law.
    follower: Option<Follower>,
    /// Whether the map did not fit in the last frame.
    cautious: bool,
    /// Another one, of what is detected elsewhere, and how many detections it has.
    tentative: Option<(Follower, u32)>,
    /// How long the arm takes.
    delay: Delay,
}

impl Track {
    /// What a frame asks of the arm (`None`: what it was told before), and whether its detection was used.
    ///
    /// Both laws see every frame, whichever has the arm: [`Parameters::controller`] may change between any
    /// two frames. While the map does not fit, the plain law has it with half of its step: prediction with
    /// a map that is wrong runs away, half a step comes nearer as long as the map is less than 75 degrees off.
    pub fn step(
        &mut self,
        moment: &Moment,
        map: &impl Map,
        reliance: Reliance,
        parameters: &Parameters,
    ) -> (Option<Command>, bool) {
        let now_ns = moment.now_ns;
        self.delay.observe(moment.joints, now_ns);
        self.draw(moment, map);
        let lost =
            self.seen_ns.is_none_or(|seen_ns| now_ns.saturating_sub(seen_ns) >= nanos(parameters.lost_after));
        let fits_again = self.cautious && reliance.consistent;
        if lost {
            self.follower = None;
        }
        self.cautious = !reliance.consistent;
        // The target never left the middle of the image: it is followed at once.
        let believed = self.look(moment, map, fits_again, parameters);
        let plain = parameters.controller == Controller::Plain || self.cautious;
        let used = if plain { moment.motion.is_some() } else { believed };
        if used {
            self.seen_ns = Some(now_ns);
        }
        let command = self.go_on(moment, map, reliance.trust, parameters);
        match &command {
            Some(Command::Follow { position, velocity }) => self.delay.told(now_ns, *position, *velocity),
            _ => self.delay.interrupt(),
        }
        self.last_ns = Some(now_ns);
        (command, used)
    }

    /// Carries the chart on to this frame; where that cannot be, everything on it is forgotten.
    fn draw(&mut self, moment: &Moment, map: &impl Map) {
        self.chart = self.chart.and_then(|chart| chart.moved(moment.joints, map));
        if self.chart.is_none() {
            self.chart = Some(Chart::at(moment.joints));
            (self.follower, self.tentative) = (None, None);
        }
    }

    /// Whether the frame's detection is believed.
    fn look(&mut self, moment: &Moment, map: &impl Map, at_once: bool, parameters: &Parameters) -> bool {
        let (Some(chart), Some(motion)) = (self.chart, moment.motion) else { return false };
        let sighting = Sighting {
            point_px: chart.from_image(motion.point_px, map),
            time_ns: moment.now_ns,
            claimed_px2: motion.variance_px2.unwrap_or(UNCLAIMED_PX2),
            area_px2: motion.area_px2,
        };
        if at_once {
            let variance_px2 = parameters.measurement_px * parameters.measurement_px;
            (self.follower, self.tentative) = (Some(Follower::at(&sighting, variance_px2)), None);
            return true;
        }
        self.believe(&sighting, moment.speed < LOOKING_RAD_PER_S, parameters.measurement_px)
    }

    /// Whether a measurement is used. One that fits what is followed is. Others are followed by a
    /// tentative filter, which takes over when it has enough *and the arm is at rest*: a moving camera
    /// sees clutter that agrees with itself, and an arm that ran after it would see more of it.
    fn believe(&mut self, sighting: &Sighting, at_rest: bool, measurement_px: f64) -> bool {
        if let Some(follower) = &mut self.follower
            && follower.take(sighting)
        {
            self.tentative = None;
            return true;
        }
        let fits = self.tentative.as_mut().is_some_and(|(other, _)| other.take(sighting));
        let (other, count) = match self.tentative {
            Some((other, count)) if fits => (other, count + 1),
            _ => (Follower::at(sighting, measurement_px * measurement_px), 1),
        };
        self.tentative = Some((other, count));
        let takes_over = at_rest && count >= AGREEING;
        if takes_over {
            self.follower = self.tentative.take().map(|(other, _)| other);
        }
        takes_over
    }

    /// What the arm is told: after the target, between two measurements on to where it is going, then to
    /// rest, and home when the target has been away for long.
    fn go_on(&self, moment: &Moment, map: &impl Map, trust: f64, parameters: &Parameters) -> Option<Command> {
        let unseen = self.seen_ns.map(|seen_ns| moment.now_ns.saturating_sub(seen_ns));
        match unseen {
            None => Some(Command::GoTo(parameters.home_rad)),
            Some(unseen) if unseen >= nanos(parameters.return_after) => {
                Some(Command::GoTo(parameters.home_rad))
            }
            Some(unseen) if unseen >= nanos(parameters.lost_after) => Some(Command::Hold),
            Some(_) if self.cautious => plain(moment, map, trust.min(CAREFUL_STEP), parameters),
            Some(_) => match parameters.controller {
                Controller::Plain => plain(moment, map, trust, parameters),
                Controller::Predictive => self.predictive(moment, map, trust, parameters),
            },
        }
    }

    /// On to where the target will be: the joints over its place on the chart when what is told now takes
    /// effect, and on the way to its place one frame later. The driver goes straight in between: on a
    /// circle of 0.2 m at 0.2 m/s and 12.5 Hz that is 0.2 mm beside the arc.
    fn predictive(
        &self,
        moment: &Moment,
        map: &impl Map,
        trust: f64,
        parameters: &Parameters,
    ) -> Option<Command> {
        let (Some(chart), Some(follower)) = (&self.chart, &self.follower) else { return None };
        let passed_ns = self.last_ns.map_or(0, |last_ns| moment.now_ns.saturating_sub(last_ns));
        let frame_ns = passed_ns.clamp(1_000_000, LONGEST_FRAME_NS);
        let lead_ns = self.lead_ns(parameters);
        let over = |ahead_ns| {
            let goal = chart.joints_over(follower.predicted_px(moment.now_ns, ahead_ns), map);
            [0, 1].map(|k| moment.joints[k] + trust * (goal[k] - moment.joints[k]))
        };
        let (position, next) = (over(lead_ns), over(lead_ns + frame_ns));
        let inside = parameters.into_envelope(position);
        // At the envelope's edge the arm stops; it does not push.
        let velocity = [0, 1].map(|k| {
            if inside[k] == position[k] { (next[k] - position[k]) / (frame_ns as f64 * 1e-9) } else { 0.0 }
        });
        Some(Command::Follow { position: inside, velocity })
    }

    /// Time from a set-point to its effect, as it is predicted over now.
    pub fn lead(&self, parameters: &Parameters) -> Duration {
        Duration::from_nanos(self.lead_ns(parameters))
    }

    fn lead_ns(&self, parameters: &Parameters) -> u64 {
        match parameters.lead {
            Lead::Fixed(lead) => nanos(lead),
            Lead::Measured { prior } => self.delay.estimate_ns(nanos(prior)),
        }
    }
}

/// The paper's law: to where the target was seen. The absolute joint target of a frame is joints *at the
/// exposure* + displacement. Added to the joints of now, the motion during the delay would count twice:
/// that oscillates (design notes on the learner, section 6). `share` of the displacement is commanded.
fn plain(moment: &Moment, map: &impl Map, share: f64, parameters: &Parameters) -> Option<Command> {
    let motion = moment.motion?;
    let [theta1, theta2] = moment.joints;
    let [first, second] = map.displacement(motion.point_px, theta2);
    let goal = [theta1 + share * first, theta2 + share * second];
    Some(Command::GoTo(parameters.into_envelope(goal)))
}
