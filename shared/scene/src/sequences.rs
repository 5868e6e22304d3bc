//! Synthetic sequences with exact ground truth: a textured plane seen by a moving camera, and on it a target
//! that moves by itself and is cut from another place of the same texture (design notes on vision, section 4).
//!
//! A frame is a function of scenario, size, seed and its number alone, so that frames may be asked for in any
//! order. Each is sampled 2 x 2 times per pixel, by cubic interpolation in a periodic texture, and averaged over
//! the pixel and the exposure; then come light and sensor noise.
//!
//! Coordinates: x to the right, y down, pixels; the *centre* of the top left pixel is (0, 0). Times: frames.
//!
//! What a mask of 2 x 2 samples says of a target's area and centroid is exact to about a tenth of a pixel. The
//! texture repeats after [`texture_period_px`] texels. Strips of parallax lie beneath the target.

mod camera;
mod catalogue;
mod light;
mod plane;
mod scenario;
mod surfaces;
mod target;
#[cfg(test)]
mod tests;

use crate::ParameterError;
use crate::random::Random;

use camera::{Paths, Pose};
use light::Light;
use plane::Lookup;
use target::Target;

pub use catalogue::{hard, with_target, without_target};
pub use scenario::{NOMINAL_SIZE_PX, Photograph, SIZE_RANGE_PX, Scenario, Shape, TargetSpec, Texture};

/// A target of which less than this share shows has no position.
pub const LEAST_VISIBLE_SHARE: f64 = 0.2;

/// Samples per pixel each way.
const SAMPLES: usize = 2;
/// Sub-frames of an exposure.
const SUB_FRAMES: usize = 5;
/// At mid sequence the target is so far from the picture's middle at most, shares of the frame's side.
const LARGEST_OFFSET: f64 = 0.1;
/// Strips of a nearer plane: period and width, texels, and the place of their texture.
const STRIP_PERIOD: f64 = 260.0;
const STRIP_WIDTH: f64 = 50.0;
const STRIP_CUT: [f64; 2] = [777.0, 333.0];
/// Streams of random numbers of a sequence's seed.
const PLACE_STREAM: u64 = 1;
const TEXTURE_STREAM: u64 = 2;
const TARGET_TEXTURE_STREAM: u64 = 3;
const SHAPE_STREAM: u64 = 4;
const SHAKE_STREAM: u64 = 5;
const LIGHT_STREAM: u64 = 100;

/// What is true of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Truth {
    /// Centroid of what shows of the target, px; `None` without target or with less of it than
    /// [`LEAST_VISIBLE_SHARE`].
    pub position: Option<[f64; 2]>,
    /// Where the target's centre is, px, be it visible or not; `None` without target.
    pub centre: Option<[f64; 2]>,
    /// Area of what shows of the target, px²; partly covered pixels count in part.
    pub area_px: f64,
    /// What shows of the target, 0 to 1: the rest is hidden or outside the frame.
    pub visible_share: f64,
    /// Velocity of the target's centre in the picture from the frame before to this one, px/frame; 0 without
    /// target.
    pub velocity: [f64; 2],
    /// The same relative to the background beneath it.
    pub relative_velocity: [f64; 2],
    /// Velocity of the background in the middle of the picture, px/frame.
    pub background: [f64; 2],
}

/// A scenario that can be rendered.
pub struct Sequence {
    size: usize,
    frames: usize,
    exposure: f64,
    parallax: f64,
    /// World point in the middle of the picture at mid sequence.
    start: [f64; 2],
    paths: Paths,
    ground: Lookup,
    target: Option<Target>,
    /// The target's texture where it is not the ground's.
    own: Option<Lookup>,
    light: Light,
    scratch: Scratch,
}

/// One row of samples, and one of pixels.
struct Scratch {
    xs: Vec<f64>,
    ys: Vec<f64>,
    samples: Vec<f32>,
    grey: Vec<f32>,
}

/// After how many texels the texture of a frame of `size` pixels repeats; photographs repeat after twice their
/// own sides.
pub fn texture_period_px(size: usize) -> usize {
    if size > 256 { 2048 } else { 1024 }
}

impl Sequence {
    /// The scenario in square frames of `size` pixels a side; another seed makes other textures, places, noise.
    ///
    /// # Errors
    /// A size outside [`SIZE_RANGE_PX`], or what [`Scenario::check`] refuses.
    pub fn new(scenario: &Scenario, size: usize, seed: u64) -> Result<Self, ParameterError> {
        scenario::within("size", size as f64, SIZE_RANGE_PX.map(|s| s as f64))?;
        scenario.check()?;
        let period = texture_period_px(size);
        let mut texture_random = Random::new(seed, TEXTURE_STREAM);
        let plane = surfaces::surface(&scenario.texture, scenario.contrast, period, &mut texture_random);
        let mut places = Random::new(seed, PLACE_STREAM);
        let start = [plane.width, plane.height].map(|side| places.unit() * side as f64);
        let offset = [(); 2].map(|()| LARGEST_OFFSET * size as f64 * (2.0 * places.unit() - 1.0));
        let paths = Paths::new(scenario, size, start, offset, Random::new(seed, SHAKE_STREAM));
        let mut own = None;
        let target = scenario.target.as_ref().map(|spec| {
            let texture = spec.texture.as_ref().unwrap_or(&scenario.texture);
            if spec.texture.is_some() || spec.contrast.is_some() {
                let contrast = spec.contrast.unwrap_or(scenario.contrast);
                let mut random = Random::new(seed, TARGET_TEXTURE_STREAM);
                own = Some(surfaces::surface(texture, contrast, period, &mut random));
            }
            let here = paths.target(scenario.middle() as f64);
            let side_px = spec.side_px * size as f64 / NOMINAL_SIZE_PX as f64;
            let from = own.as_ref().unwrap_or(&plane);
            let cuts = [(); 2].map(|()| surfaces::cut(from, texture, here, side_px, &mut places));
            Target::new(scenario, spec, size, &paths, cuts, Random::new(seed, SHAPE_STREAM))
        });
        Ok(Self {
            size,
            frames: scenario.frames,
            exposure: scenario.exposure,
            parallax: scenario.parallax,
            start,
            paths,
            ground: Lookup::new(&plane),
            target,
            own: own.as_ref().map(Lookup::new),
            light: Light::new(scenario, size, seed, LIGHT_STREAM),
            scratch: Scratch::new(size),
        })
    }

    /// Number of frames.
    pub fn frames(&self) -> usize {
        self.frames
    }

    /// Side of a frame, pixels.
    pub fn size(&self) -> usize {
        self.size
    }

    /// Writes frame `t` as rows of grey levels.
    ///
    /// # Panics
    /// If there is no frame `t` or the number of pixels is not the square of the size.
    pub fn render(&mut self, t: usize, pixels: &mut [u8]) {
        assert!(t < self.frames, "frame {t} of {}", self.frames);
        assert!(pixels.len() == self.size * self.size, "{} pixels for a side of {}", pixels.len(), self.size);
        let mut scratch = std::mem::replace(&mut self.scratch, Scratch::new(0));
        let light = self.light.on_frame(t);
        let times = self.times(t);
        let share = 1.0 / (times.len() * SAMPLES * SAMPLES) as f32;
        let views: Vec<View<'_>> = times.iter().map(|&time| View::new(self, time)).collect();
        for (y, row) in pixels.chunks_exact_mut(self.size).enumerate() {
            scratch.grey.fill(0.0);
            for view in &views {
                for sample in 0..SAMPLES {
                    self.draw(view, (y, sample), &mut scratch);
                    for (g, pair) in scratch.grey.iter_mut().zip(scratch.samples.chunks_exact(SAMPLES)) {
                        *g += pair[0] + pair[1];
                    }
                }
            }
            scratch.grey.iter_mut().for_each(|g| *g *= share);
            self.light.expose(&light, y, &mut scratch.grey, row);
        }
        drop(views);
        self.scratch = scratch;
    }

    /// What is true of frame `t`.
    ///
    /// # Panics
    /// If there is no frame `t`.
    pub fn truth(&self, t: usize) -> Truth {
        assert!(t < self.frames, "frame {t} of {}", self.frames);
        let (now, before) = (self.paths.pose(t as f64), self.paths.pose(t as f64 - 1.0));
        let middle = [0.5 * (self.size - 1) as f64; 2];
        let mut truth = Truth {
            position: None,
            centre: None,
            area_px: 0.0,
            visible_share: 0.0,
            velocity: [0.0; 2],
            relative_velocity: [0.0; 2],
            background: difference(now.image(before.world(middle)), middle),
        };
        let Some(target) = &self.target else { return truth };
        let (place, place_before) = (self.paths.target(t as f64), self.paths.target(t as f64 - 1.0));
        let centre = now.image(place);
        truth.centre = Some(centre);
        truth.velocity = difference(centre, before.image(place_before));
        truth.relative_velocity = difference(centre, now.image(place_before));
        let (area, centroid) = self.mask(t);
        truth.area_px = area;
        truth.visible_share = (area / (target.area() * now.magnification(place))).min(1.0);
        if truth.visible_share >= LEAST_VISIBLE_SHARE {
            truth.position = Some(centroid);
        }
        truth
    }

    /// Area, px², and centroid, px, of what shows of the target.
    fn mask(&self, t: usize) -> (f64, [f64; 2]) {
        let (mut count, mut sum) = (0.0, [0.0; 2]);
        let times = self.times(t);
        let mut scratch = Scratch::new(self.size);
        for &time in &times {
            let view = View::new(self, time);
            let Some(placed) = &view.target else { continue };
            let ((from, to), (top, bottom)) = (placed.columns, placed.rows);
            for (y, sample) in (top..bottom).flat_map(|y| (0..SAMPLES).map(move |sample| (y, sample))) {
                view.place_samples((y, sample), &mut scratch);
                for i in from * SAMPLES..to * SAMPLES {
                    if placed.covers(scratch.xs[i], scratch.ys[i]).is_some() {
                        count += 1.0;
                        sum = [sum[0] + sample_place(i), sum[1] + sample_place(y * SAMPLES + sample)];
                    }
                }
            }
        }
        let area = count / (times.len() * SAMPLES * SAMPLES) as f64;
        (area, if count > 0.0 { sum.map(|s| s / count) } else { [0.0; 2] })
    }

    /// Draws one row of samples: `sample` counts those within the row `y` of pixels.
    fn draw(&self, view: &View<'_>, (y, sample): (usize, usize), scratch: &mut Scratch) {
        view.place_samples((y, sample), scratch);
        self.ground.read(&scratch.xs, &scratch.ys, &mut scratch.samples);
        let Scratch { xs, ys, samples, .. } = scratch;
        if self.parallax != 0.0 {
            let shift = difference(view.pose.place, self.start).map(|d| d * self.parallax);
            for ((s, x), y) in samples.iter_mut().zip(&*xs).zip(&*ys) {
                let (x, y) = (x + shift[0], y + shift[1]);
                if x.rem_euclid(STRIP_PERIOD) < STRIP_WIDTH {
                    *s = self.ground.at(x + STRIP_CUT[0], y + STRIP_CUT[1]);
                }
            }
        }
        let Some(placed) = &view.target else { return };
        if y < placed.rows.0 || y >= placed.rows.1 {
            return;
        }
        let texture = self.own.as_ref().unwrap_or(&self.ground);
        for i in placed.columns.0 * SAMPLES..placed.columns.1 * SAMPLES {
            if let Some(local) = placed.covers(xs[i], ys[i]) {
                samples[i] = placed.grey(local, texture);
            }
        }
    }

    /// The instants that make up frame `t`.
    fn times(&self, t: usize) -> Vec<f64> {
        if self.exposure == 0.0 {
            return vec![t as f64];
        }
        let offset = |k: usize| (k as f64 + 0.5) / SUB_FRAMES as f64 - 0.5;
        (0..SUB_FRAMES).map(|k| t as f64 + self.exposure * offset(k)).collect()
    }
}

/// Camera and target at one instant.
struct View<'a> {
    pose: Pose,
    target: Option<target::Placed<'a>>,
}

impl<'a> View<'a> {
    fn new(sequence: &'a Sequence, time: f64) -> Self {
        let pose = sequence.paths.pose(time);
        let target = sequence.target.as_ref();
        let target = target.map(|target| target.placed(&sequence.paths, &pose, time, sequence.size));
        Self { pose, target }
    }

    fn place_samples(&self, (y, sample): (usize, usize), scratch: &mut Scratch) {
        let y = sample_place(y * SAMPLES + sample);
        self.pose.world_row(y, sample_place(0), 1.0 / SAMPLES as f64, &mut scratch.xs, &mut scratch.ys);
    }
}

impl Scratch {
    fn new(size: usize) -> Self {
        let samples = size * SAMPLES;
        Self {
            xs: vec![0.0; samples],
            ys: vec![0.0; samples],
            samples: vec![0.0; samples],
            grey: vec![0.0; size],
        }
    }
}

/// Image coordinate of the `i`-th sample of a row or column.
fn sample_place(i: usize) -> f64 {
    (i as f64 + 0.5) / SAMPLES as f64 - 0.5
}

fn difference(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0] - b[0], a[1] - b[1]]
}
