//! Where camera and target are, and how image and world map onto each other.
//!
//! The world is a plane with the camera's scale at mid sequence as its unit, one texel.

use crate::random::Random;

use super::scenario::{NOMINAL_SIZE_PX, Scenario};

/// Frames in a period of the pan's modulation.
const MODULATION_FRAMES: f64 = 16.0;
/// Places of the camera are multiples of 1 / this, so that whole-pixel motion shifts a picture exactly.
const STEPS_PER_TEXEL: f64 = 65536.0;

/// Camera and target over the sequence.
pub(super) struct Paths {
    /// World point in the middle of the picture, from frame -1 to one after the last.
    camera: Vec<[f64; 2]>,
    /// World point of the target's centre, the same frames.
    target: Vec<[f64; 2]>,
    /// Radians, share, 1/px, all per frame.
    rotation: f64,
    zoom: f64,
    slant: f64,
    middle: f64,
    half_size: f64,
}

/// The camera at one time.
#[derive(Clone, Copy)]
pub(super) struct Pose {
    /// World point in the middle of the picture.
    pub(super) place: [f64; 2],
    cos: f64,
    sin: f64,
    /// Pixels per texel in the middle of the picture.
    zoom: f64,
    /// Change of scale per pixel in x.
    slant: f64,
    /// Image coordinate of the middle of the picture.
    half_size: f64,
}

impl Paths {
    /// `start` is the world point in the middle of the picture at mid sequence, `offset_px` the target's place in
    /// the picture then, from the middle.
    pub(super) fn new(
        scenario: &Scenario,
        size: usize,
        start: [f64; 2],
        offset_px: [f64; 2],
        mut random: Random,
    ) -> Self {
        let mut paths = Self {
            camera: Vec::with_capacity(scenario.frames + 2),
            target: target_path(scenario),
            rotation: scenario.rotation_deg.to_radians(),
            zoom: scenario.zoom,
            slant: scenario.slant * NOMINAL_SIZE_PX as f64 / size as f64,
            middle: scenario.middle() as f64,
            half_size: 0.5 * (size - 1) as f64,
        };
        let mut pan = [0.0; 2];
        for i in 0..scenario.frames + 2 {
            let t = i as f64 - 1.0;
            let swing = scenario.pan_modulation * libm::sin(std::f64::consts::TAU * t / MODULATION_FRAMES);
            // the camera's motion into frame t, so that the picture moves by the pan along its own axes
            let motion = paths.pose_at([0.0; 2], t).rotated_to_world(scenario.pan.map(|v| v * (1.0 + swing)));
            pan = [pan[0] - motion[0], pan[1] - motion[1]];
            let jitter = [(); 2].map(|()| random.gaussian() * scenario.jitter_px);
            let follow = if scenario.camera_follows { paths.target[i] } else { [0.0; 2] };
            paths.camera.push([0, 1].map(|k| pan[k] + jitter[k] + follow[k]));
        }
        let shift_to = |path: &mut Vec<[f64; 2]>, [x, y]: [f64; 2]| {
            let [x0, y0] = path[scenario.middle() + 1];
            path.iter_mut().for_each(|p| *p = [p[0] - x0 + x, p[1] - y0 + y]);
        };
        shift_to(&mut paths.camera, start);
        let pose = paths.pose(paths.middle);
        shift_to(&mut paths.target, pose.world(offset_px.map(|o| o + pose.half_size)));
        paths
    }

    /// The camera at time `t`, frames, from -1 to one after the last.
    pub(super) fn pose(&self, t: f64) -> Pose {
        let place = interpolated(&self.camera, t);
        self.pose_at(place.map(|p| (p * STEPS_PER_TEXEL).round() / STEPS_PER_TEXEL), t)
    }

    /// The world point of the target's centre.
    pub(super) fn target(&self, t: f64) -> [f64; 2] {
        interpolated(&self.target, t)
    }

    /// The target's motion from frame t - 1 to frame t in the world.
    pub(super) fn target_motion(&self, t: usize) -> [f64; 2] {
        [0, 1].map(|k| self.target[t + 1][k] - self.target[t][k])
    }

    fn pose_at(&self, place: [f64; 2], t: f64) -> Pose {
        let from_middle = t - self.middle;
        let angle = self.rotation * from_middle;
        Pose {
            place,
            cos: libm::cos(angle),
            sin: libm::sin(angle),
            zoom: libm::pow(1.0 + self.zoom, from_middle),
            slant: self.slant * from_middle,
            half_size: self.half_size,
        }
    }
}

/// The target's path relative to the background from frame -1 to one after the last.
fn target_path(scenario: &Scenario) -> Vec<[f64; 2]> {
    let mut path = vec![[0.0; 2]; scenario.frames + 2];
    let Some(target) = &scenario.target else { return path };
    for i in 1..path.len() {
        let t = i - 1;
        let rests = target.rest.is_some_and(|(from, to)| (from..to).contains(&t));
        let speed = if rests { 0.0 } else { 1.0 };
        let angle = target.curve_deg.to_radians() * (t as f64 - scenario.middle() as f64);
        let (sin, cos) = (libm::sin(angle), libm::cos(angle));
        let [x, y] = target.velocity.map(|v| v * speed);
        path[i] = [path[i - 1][0] + cos * x - sin * y, path[i - 1][1] + sin * x + cos * y];
    }
    path
}

fn interpolated(path: &[[f64; 2]], t: f64) -> [f64; 2] {
    let along = (t + 1.0).clamp(0.0, (path.len() - 1) as f64);
    let before = (along as usize).min(path.len() - 2);
    let share = along - before as f64;
    [0, 1].map(|k| path[before][k] + share * (path[before + 1][k] - path[before][k]))
}

impl Pose {
    /// The world point seen at an image point.
    pub(super) fn world(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let (x, y) = (x - self.half_size, y - self.half_size);
        let scale = 1.0 / (1.0 + self.slant * x);
        let [x, y] = self.rotated_to_world([x * scale, y * scale]);
        [self.place[0] + x, self.place[1] + y]
    }

    /// The image point of a world point.
    pub(super) fn image(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let (x, y) = (x - self.place[0], y - self.place[1]);
        let across = (self.cos * x - self.sin * y) * self.zoom;
        let down = (self.sin * x + self.cos * y) * self.zoom;
        // across = x / (1 + q x), so x = across / (1 - q across)
        let scale = 1.0 / (1.0 - self.slant * across);
        [across * scale + self.half_size, down * scale + self.half_size]
    }

    /// Pixels' area per texel's area at a world point, the determinant of the map's derivative.
    pub(super) fn magnification(&self, [x, y]: [f64; 2]) -> f64 {
        let (x, y) = (x - self.place[0], y - self.place[1]);
        let across = (self.cos * x - self.sin * y) * self.zoom;
        let scale = 1.0 / (1.0 - self.slant * across);
        self.zoom * self.zoom * scale * scale * scale
    }

    /// World points of image points (first + i step, y) for i = 0, 1, ….
    pub(super) fn world_row(&self, y: f64, first: f64, step: f64, xs: &mut [f64], ys: &mut [f64]) {
        let [across, down] = [self.cos / self.zoom, self.sin / self.zoom];
        let (first, y) = (first - self.half_size, y - self.half_size);
        let [from_x, from_y] = self.place;
        for (i, (wx, wy)) in xs.iter_mut().zip(ys).enumerate() {
            let (mut x, mut y) = (first + step * i as u32 as f64, y);
            if self.slant != 0.0 {
                let scale = 1.0 / (1.0 + self.slant * x);
                (x, y) = (x * scale, y * scale);
            }
            *wx = from_x + (across * x + down * y);
            *wy = from_y + (across * y - down * x);
        }
    }

    /// A small motion in the picture's middle as motion in the world.
    fn rotated_to_world(self, [x, y]: [f64; 2]) -> [f64; 2] {
        [(self.cos * x + self.sin * y) / self.zoom, (self.cos * y - self.sin * x) / self.zoom]
    }
}
