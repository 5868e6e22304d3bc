//! Evidence over time: tracks that begin, are confirmed, coast through gaps, and are lost (design notes on
//! vision, section 6 R11).
//!
//! A track is a constant-velocity Kalman filter in coordinates that go with the background: its place is
//! carried on by the global motion, its own velocity is that relative to the background. Beside it runs the
//! probability that it exists at all (integrated probabilistic data association, Musicki, Evans and
//! Stankovic 1994, for one measurement per track).

use nalgebra::{Matrix4, Vector4};
use serde::{Deserialize, Serialize};

use crate::robust::{Candidate, Findings, Outcome};

/// Tracks at once.
pub const MAX_TRACKS: usize = 4;

/// How tracks live.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrackerParameters {
    /// Candidates below this confidence are not looked at.
    pub least_confidence: f64,
    /// How fast a target changes its velocity, px/frame^2 (standard deviation).
    pub acceleration: f64,
    /// Candidates farther away than this many standard deviations are another's.
    pub gate: f64,
    /// Existence from which a track is confirmed.
    pub confirm: f64,
    /// Existence below which it is dropped.
    pub drop: f64,
    /// Frames without a candidate after which it is lost.
    pub coast_frames: u32,
}

impl Default for TrackerParameters {
    fn default() -> TrackerParameters {
        TrackerParameters {
            least_confidence: 0.03,
            acceleration: 1.0,
            gate: 4.0,
            confirm: 0.9,
            drop: 0.1,
            coast_frames: 12,
        }
    }
}

/// Where a track is in its life.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum TrackState {
    /// Seen, but it may be nothing.
    #[default]
    Tentative,
    /// There, and seen in this frame.
    Confirmed,
    /// There, and not seen in this frame.
    Coasting,
}

/// Something that is followed from frame to frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Track {
    /// Tells it from others, rising.
    pub id: u32,
    /// Where it is in its life.
    pub state: TrackState,
    /// Position, px from the centre of the top-left pixel (right, down), then velocity relative to the
    /// background, px/frame.
    pub mean: [f64; 4],
    /// Covariance of `mean`, row by row.
    pub covariance: [[f64; 4]; 4],
    /// Velocity in the image, px/frame.
    pub velocity: [f64; 2],
    /// Probability that there is such a thing, 0..1.
    pub existence: f64,
    /// Area, px², smoothed.
    pub area_px: f64,
    /// Frames in which it was seen.
    pub hits: u32,
    /// Frames since it was seen.
    pub misses: u32,
}

/// A target that is not seen slows down in our mind: it may have stopped behind what hides it.
const SLOWING: f64 = 0.9;
/// Probability that a track ends from one frame to the next.
const DEATH: f64 = 0.01;
/// Probability that a target is seen in a frame: what a miss says.
const SEEN: f64 = 0.3;
/// Most that a candidate's place can say for a track: the gate's share of the image.
const PLACE_GAIN: f64 = 8.0;
/// Odds are held to this, so that a long life does not outweigh what is seen now.
const MOST_ODDS: f64 = 300.0;
/// Existence of a new track, as odds, times those of its candidate.
const BIRTH_ODDS: f64 = 0.15;
/// A target that is not seen for so many frames gives way to another that is.
const PATIENCE: u32 = 3;
/// Share of a new area in the smoothed one.
const AREA_GAIN: f64 = 0.2;

/// Follows what moves.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Tracker {
    parameters: TrackerParameters,
    tracks: [Option<Track>; MAX_TRACKS],
    primary: Option<u32>,
    next_id: u32,
}

impl Tracker {
    /// Without any track.
    pub fn new(parameters: &TrackerParameters) -> Tracker {
        Tracker { parameters: *parameters, tracks: [None; MAX_TRACKS], primary: None, next_id: 1 }
    }

    /// What it follows with.
    pub fn parameters(&self) -> &TrackerParameters {
        &self.parameters
    }

    /// All tracks.
    pub fn tracks(&self) -> impl Iterator<Item = &Track> {
        self.tracks.iter().flatten()
    }

    /// The track that is the target: the one that was before while it lives, else the confirmed one that
    /// most surely exists.
    pub fn target(&self) -> Option<&Track> {
        self.tracks().find(|track| Some(track.id) == self.primary)
    }

    /// Takes in what was found between two frames `interval` frames apart, the older of which was the newer
    /// one of the last step.
    pub fn step(&mut self, findings: &Findings, interval: u32) {
        self.step_after(findings, interval, interval);
    }

    /// As [`Tracker::step`], `gap` frames after the last step: more than the interval where frames were
    /// passed over. The background is then taken to have moved on alike.
    pub fn step_after(&mut self, findings: &Findings, interval: u32, gap: u32) {
        match findings.outcome {
            Outcome::Answered => {}
            // Nothing is known, nothing has moved.
            Outcome::Frozen => return,
            Outcome::NoPair => {
                self.tracks = [None; MAX_TRACKS];
                self.primary = None;
                return;
            }
            // Blind for a moment.
            Outcome::Featureless | Outcome::Unexplained => {
                self.tracks.iter_mut().flatten().for_each(|track| track.miss(gap.max(1)));
                self.end();
                return;
            }
        }
        let (frames, gap) = (f64::from(interval.max(1)), gap.max(1));
        for track in self.tracks.iter_mut().flatten() {
            track.predict(findings, (frames, f64::from(gap)), self.parameters.acceleration);
        }
        self.associate(&findings.candidates[..findings.count], frames, gap);
        self.end();
    }

    /// Forgets what is over, and chooses the target among the rest.
    fn end(&mut self) {
        for slot in &mut self.tracks {
            if slot.is_some_and(|track| track.is_over(&self.parameters)) {
                *slot = None;
            }
        }
        self.choose();
    }

    /// Gives each track, the surest first, the candidate that fits it best; what is left begins tracks.
    fn associate(&mut self, candidates: &[Candidate], frames: f64, gap: u32) {
        let parameters = self.parameters;
        let mut free = [true; crate::MAX_TARGETS];
        for (free, candidate) in free.iter_mut().zip(candidates) {
            *free = candidate.confidence >= parameters.least_confidence;
        }
        let mut order: [usize; MAX_TRACKS] = std::array::from_fn(|i| i);
        let existence = |slot: &Option<Track>| slot.map_or(-1.0, |track| track.existence);
        order.sort_by(|&a, &b| existence(&self.tracks[b]).total_cmp(&existence(&self.tracks[a])));
        for index in order {
            let Some(track) = &mut self.tracks[index] else { continue };
            let mut best: Option<(f64, usize)> = None;
            for (i, candidate) in candidates.iter().enumerate().filter(|(i, _)| free[*i]) {
                let distance = track.distance(candidate);
                let ratio = evidence_ratio(candidate, distance);
                // What is more probably clutter than this target is no sight of it.
                let is_sight = distance < parameters.gate * parameters.gate && ratio > 1.0 - SEEN;
                if is_sight && best.is_none_or(|(held, _)| ratio > held) {
                    best = Some((ratio, i));
                }
            }
            match best {
                Some((ratio, i)) => {
                    free[i] = false;
                    track.update(&candidates[i], ratio, frames, &parameters);
                }
                None => track.miss(gap),
            }
        }
        for (candidate, _) in candidates.iter().zip(free).filter(|(_, free)| *free) {
            self.begin(candidate, frames);
        }
    }

    /// A new track in a free place, or in that of the least sure tentative one.
    fn begin(&mut self, candidate: &Candidate, frames: f64) {
        let track = Track::new(self.next_id, candidate, frames, self.parameters.confirm);
        let weak = |slot: &Option<Track>| match slot {
            None => -1.0,
            Some(track) if track.state == TrackState::Tentative => track.existence,
            Some(_) => f64::INFINITY,
        };
        let weakest = self.tracks.iter_mut().min_by(|a, b| weak(a).total_cmp(&weak(b)));
        if let Some(slot) = weakest.filter(|slot| weak(slot) < track.existence) {
            *slot = Some(track);
            self.next_id = self.next_id.wrapping_add(1);
        }
    }

    fn choose(&mut self) {
        let held = self.target();
        let unseen = held.is_none_or(|track| track.misses >= PATIENCE);
        if unseen {
            // One that is seen is better than one that is remembered.
            let rank = |track: &&Track| (track.misses < PATIENCE, track.existence);
            let confirmed = self.tracks().filter(|track| track.state != TrackState::Tentative);
            let best = confirmed.max_by(|a, b| {
                let ((a_seen, a), (b_seen, b)) = (rank(a), rank(b));
                a_seen.cmp(&b_seen).then(a.total_cmp(&b))
            });
            self.primary = best.map(|track| track.id);
        }
    }
}

impl Track {
    fn new(id: u32, candidate: &Candidate, frames: f64, confirm: f64) -> Track {
        let noise = measurement_noise(candidate, frames, candidate.area_px);
        let odds = BIRTH_ODDS * odds(candidate.confidence);
        // One pair that leaves no doubt is enough.
        let sure = odds / (1.0 + odds) >= confirm;
        Track {
            id,
            state: if sure { TrackState::Confirmed } else { TrackState::Tentative },
            mean: measurement(candidate, frames).into(),
            covariance: (noise * 4.0).into(),
            velocity: [candidate.vu / frames, candidate.vv / frames],
            existence: odds / (1.0 + odds),
            area_px: candidate.area_px,
            hits: 1,
            misses: 0,
        }
    }

    /// Carries the track on over `gap` frames; the findings are of the last `interval` of them.
    fn predict(&mut self, findings: &Findings, (interval, gap): (f64, f64), acceleration: f64) {
        let [u, v, ru, rv] = self.mean;
        let (bu, bv) = findings.background.forward(u, v);
        let background = [(bu - u) / interval, (bv - v) / interval];
        self.velocity = [background[0] + ru, background[1] + rv];
        self.mean = [u + self.velocity[0] * gap, v + self.velocity[1] * gap, ru, rv];
        let mut transition = Matrix4::identity();
        transition[(0, 2)] = gap;
        transition[(1, 3)] = gap;
        let mut noise = Matrix4::zeros();
        let q = (acceleration * gap).powi(2);
        for i in 0..2 {
            noise[(i, i)] = q * gap * gap / 4.0;
            noise[(i, i + 2)] = q * gap / 2.0;
            noise[(i + 2, i)] = q * gap / 2.0;
            noise[(i + 2, i + 2)] = q;
        }
        let covariance = Matrix4::from(self.covariance);
        self.covariance = (transition * covariance * transition.transpose() + noise).into();
        self.existence *= (1.0 - DEATH).powf(gap);
    }

    /// Squared Mahalanobis distance of the candidate's position.
    fn distance(&self, candidate: &Candidate) -> f64 {
        let noise = measurement_noise(candidate, 1.0, self.area_px);
        let s = Matrix4::from(self.covariance) + noise;
        let (du, dv) = (candidate.u - self.mean[0], candidate.v - self.mean[1]);
        let (a, b, c) = (s[(0, 0)], s[(0, 1)], s[(1, 1)]);
        (c * du * du - 2.0 * b * du * dv + a * dv * dv) / (a * c - b * b)
    }

    /// Is seen, as a candidate that is `ratio` times more probable if the track is real.
    fn update(&mut self, candidate: &Candidate, ratio: f64, frames: f64, parameters: &TrackerParameters) {
        let covariance = Matrix4::from(self.covariance);
        let mut noise = measurement_noise(candidate, frames, self.area_px);
        let innovation = measurement(candidate, frames) - Vector4::from(self.mean);
        // A motion that cannot be this target's (texture that aliases) says nothing; its place does.
        let spread = covariance[(2, 2)].max(covariance[(3, 3)]) + noise[(2, 2)];
        if innovation[2].hypot(innovation[3]) > parameters.gate * spread.sqrt() {
            noise[(2, 2)] *= 1e4;
            noise[(3, 3)] *= 1e4;
        }
        let Some(inverse) = (covariance + noise).try_inverse() else { return self.miss(1) };
        let gain = covariance * inverse;
        let mean = Vector4::from(self.mean) + gain * innovation;
        let left = Matrix4::identity() - gain;
        // Joseph's form stays positive.
        let covariance = left * covariance * left.transpose() + gain * noise * gain.transpose();
        let background = [self.velocity[0] - self.mean[2], self.velocity[1] - self.mean[3]];
        self.mean = mean.into();
        self.covariance = covariance.into();
        self.velocity = [background[0] + self.mean[2], background[1] + self.mean[3]];
        self.area_px += AREA_GAIN * (candidate.area_px - self.area_px);
        self.hits += 1;
        self.misses = 0;
        self.weigh(ratio);
        if self.state != TrackState::Tentative || self.existence >= parameters.confirm {
            self.state = TrackState::Confirmed;
        }
    }

    /// Is not seen, for the first time after `gap` frames.
    fn miss(&mut self, gap: u32) {
        self.misses = self.misses.saturating_add(gap);
        let slowing = SLOWING.powi(gap.min(1000) as i32);
        self.mean[2] *= slowing;
        self.mean[3] *= slowing;
        self.weigh(1.0 - SEEN);
        if self.state == TrackState::Confirmed {
            self.state = TrackState::Coasting;
        }
    }

    /// Bayes' rule with a likelihood ratio.
    fn weigh(&mut self, ratio: f64) {
        let odds = (odds(self.existence) * ratio).clamp(1e-6, MOST_ODDS);
        self.existence = odds / (1.0 + odds);
    }

    fn is_over(&self, parameters: &TrackerParameters) -> bool {
        let impossible = !self.mean.iter().all(|value| value.is_finite());
        impossible || self.existence < parameters.drop || self.misses > parameters.coast_frames
    }
}

/// How much more probable the candidate is if the track is real, from its confidence and its squared distance.
fn evidence_ratio(candidate: &Candidate, distance: f64) -> f64 {
    odds(candidate.confidence) * PLACE_GAIN * (-0.5 * distance).exp()
}

fn odds(probability: f64) -> f64 {
    let p = probability.clamp(1e-6, 1.0 - 1e-6);
    p / (1.0 - p)
}

fn measurement(candidate: &Candidate, frames: f64) -> Vector4<f64> {
    let [ru, rv] = candidate.relative;
    Vector4::new(candidate.u, candidate.v, ru / frames, rv / frames)
}

/// The candidate's covariance; where it shows less of the target than was known, its centroid is that of a
/// part.
fn measurement_noise(candidate: &Candidate, frames: f64, area_px: f64) -> Matrix4<f64> {
    let [uu, uv, vv] = candidate.position_covariance;
    let hidden = (0.5 * (area_px.sqrt() - candidate.area_px.sqrt())).max(0.0).powi(2);
    let velocity = (candidate.velocity_sd / frames).powi(2);
    let mut noise = Matrix4::zeros();
    noise[(0, 0)] = uu + hidden;
    noise[(0, 1)] = uv;
    noise[(1, 0)] = uv;
    noise[(1, 1)] = vv + hidden;
    noise[(2, 2)] = velocity;
    noise[(3, 3)] = velocity;
    noise
}
