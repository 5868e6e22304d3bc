//! The target: which points of the world it covers and what it looks like.

use std::f64::consts::{PI, TAU};

use crate::random::Random;

use super::camera::{Paths, Pose};
use super::plane::Lookup;
use super::scenario::{NOMINAL_SIZE_PX, Scenario, Shape, TargetSpec};
use super::surfaces::MEAN_GREY;

/// Half of a rectangle's longer side, in square roots of its area.
const RECTANGLE_HALF: f64 = 0.62;
/// Lobes of a blob: amplitude of the second and the third harmonic of its radius.
const LOBES: [f64; 2] = [0.15, 0.12];
/// A deforming texture's wobble: wavelength and largest amplitude in sides, radians per frame in x and y.
const WOBBLE_WAVELENGTH: f64 = 0.8;
const WOBBLE_AMPLITUDE: f64 = 0.12;
const WOBBLE_RATE: [f64; 2] = [0.6, -0.5];
/// With this morphing, radians/frame, the wobble has its largest amplitude.
const FULL_WOBBLE: f64 = 0.4;
/// The occluder hides a little more than it must.
const OCCLUDER_MARGIN_PX: f64 = 1.0;

/// What does not change over the sequence.
pub(super) struct Target {
    /// Square root of its area, texels.
    side: f64,
    shape: Shape,
    /// Phases of a blob's lobes.
    lobes: [f64; 2],
    /// Where in the texture it is cut from, before and after morphing.
    cuts: [[f64; 2]; 2],
    spin: f64,
    deformation: f64,
    occluder: Option<Occluder>,
    middle: f64,
}

/// A bar across the target's path, fixed in the world and looking like the background.
struct Occluder {
    middle: [f64; 2],
    /// Along the path, length 1.
    direction: [f64; 2],
    half_width: f64,
}

/// The target at one time.
pub(super) struct Placed<'a> {
    target: &'a Target,
    centre: [f64; 2],
    cos: f64,
    sin: f64,
    t: f64,
    /// Columns and rows of the frame that may show it, half open.
    pub(super) columns: (usize, usize),
    pub(super) rows: (usize, usize),
}

impl Target {
    /// `cuts` are the places in its texture.
    pub(super) fn new(
        scenario: &Scenario,
        spec: &TargetSpec,
        size: usize,
        paths: &Paths,
        cuts: [[f64; 2]; 2],
        mut random: Random,
    ) -> Self {
        let side = spec.side_px * size as f64 / NOMINAL_SIZE_PX as f64;
        Self {
            side,
            shape: spec.shape,
            lobes: [(); 2].map(|()| random.unit() * TAU),
            cuts,
            spin: spec.spin_deg.to_radians(),
            deformation: spec.deformation,
            occluder: scenario
                .occluder
                .map(|interval| Occluder::new(interval, reach(spec.shape) * side, paths)),
            middle: scenario.middle() as f64,
        }
    }

    /// Its area if nothing hides it, texels.
    pub(super) fn area(&self) -> f64 {
        self.side * self.side
    }

    /// At time `t`, seen from `pose` in a frame of `size` pixels.
    pub(super) fn placed(&self, paths: &Paths, pose: &Pose, t: f64, size: usize) -> Placed<'_> {
        let centre = paths.target(t);
        let turned = self.spin * (t - self.middle);
        // the slant makes the nearer half larger than the middle tells
        let reach_px = 1.2 * reach(self.shape) * self.side * pose.magnification(centre).abs().sqrt() + 2.0;
        let span = |middle: f64| {
            let clamped = |x: f64| x.clamp(0.0, size as f64) as usize;
            (clamped(middle - reach_px), clamped(middle + reach_px + 1.0))
        };
        let [x, y] = pose.image(centre);
        Placed {
            target: self,
            centre,
            cos: libm::cos(turned),
            sin: libm::sin(turned),
            t,
            columns: span(x),
            rows: span(y),
        }
    }

    /// Whether the outline holds a point relative to the centre, in the target's own axes.
    fn holds(&self, [x, y]: [f64; 2]) -> bool {
        let square = x * x + y * y;
        match self.shape {
            Shape::Disc => square * PI <= self.area(),
            Shape::Rectangle => {
                let half = RECTANGLE_HALF * self.side;
                x.abs() <= half && y.abs() * (4.0 * half) <= self.area()
            }
            Shape::Blob => {
                if square == 0.0 {
                    return true;
                }
                // sine and cosine of twice and thrice the angle, without the angle
                let (c2, s2) = ((x * x - y * y) / square, 2.0 * x * y / square);
                let radius = square.sqrt();
                let (c3, s3) = ((c2 * x - s2 * y) / radius, (s2 * x + c2 * y) / radius);
                let lobe = |s: f64, c: f64, k: usize| {
                    LOBES[k] * (s * libm::cos(self.lobes[k]) + c * libm::sin(self.lobes[k]))
                };
                // a radius of r (1 + a sin + b sin) encloses pi r^2 (1 + a^2/2 + b^2/2)
                let enclosed = PI * (1.0 + 0.5 * (LOBES[0] * LOBES[0] + LOBES[1] * LOBES[1]));
                let swing = 1.0 + lobe(s2, c2, 0) + lobe(s3, c3, 1);
                square * enclosed <= self.area() * swing * swing
            }
        }
    }
}

/// How far an outline reaches from the centre, in square roots of its area.
fn reach(shape: Shape) -> f64 {
    match shape {
        Shape::Disc => 0.565,
        Shape::Rectangle => 0.74,
        Shape::Blob => 0.71,
    }
}

impl Placed<'_> {
    /// The point in the target's own axes, if the target shows there.
    pub(super) fn covers(&self, x: f64, y: f64) -> Option<[f64; 2]> {
        let (dx, dy) = (x - self.centre[0], y - self.centre[1]);
        let local = [self.cos * dx + self.sin * dy, self.cos * dy - self.sin * dx];
        let hidden = self.target.occluder.as_ref().is_some_and(|occluder| occluder.hides(x, y));
        (!hidden && self.target.holds(local)).then_some(local)
    }

    /// The grey level at a point in the target's own axes.
    pub(super) fn grey(&self, [x, y]: [f64; 2], texture: &Lookup) -> f32 {
        let Target { side, deformation, cuts, .. } = *self.target;
        let read = |k: usize, x: f64, y: f64| texture.at(x + cuts[k][0], y + cuts[k][1]);
        if deformation == 0.0 {
            return read(0, x, y);
        }
        let radians_per_px = TAU / (side * WOBBLE_WAVELENGTH);
        let amplitude = side * WOBBLE_AMPLITUDE * (deformation / FULL_WOBBLE).min(1.0);
        let [rate_x, rate_y] = WOBBLE_RATE;
        let moved_x = x + amplitude * libm::sin(radians_per_px * y + rate_x * self.t);
        let moved_y = y + amplitude * libm::sin(radians_per_px * x + rate_y * self.t);
        let phase = deformation * self.t;
        let mean = MEAN_GREY as f32;
        mean + (read(0, moved_x, moved_y) - mean) * libm::cos(phase) as f32
            + (read(1, moved_x, moved_y) - mean) * libm::sin(phase) as f32
    }
}

impl Occluder {
    /// `reach` is how far the target reaches from its centre.
    fn new((from, to): (usize, usize), reach: f64, paths: &Paths) -> Self {
        let (first, last) = (from as f64, to as f64 - 1.0);
        let (a, b) = (paths.target(first), paths.target(last));
        // of an interval of one frame: the motion into it
        let motion = if last > first { [b[0] - a[0], b[1] - a[1]] } else { paths.target_motion(from) };
        let length = (motion[0] * motion[0] + motion[1] * motion[1]).sqrt();
        let direction = if length > 0.0 { motion.map(|m| m / length) } else { [1.0, 0.0] };
        let span = ((b[0] - a[0]) * direction[0] + (b[1] - a[1]) * direction[1]).abs();
        Self {
            middle: [0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])],
            direction,
            half_width: 0.5 * span + reach + OCCLUDER_MARGIN_PX,
        }
    }

    fn hides(&self, x: f64, y: f64) -> bool {
        let (dx, dy) = (x - self.middle[0], y - self.middle[1]);
        (dx * self.direction[0] + dy * self.direction[1]).abs() <= self.half_width
    }
}
