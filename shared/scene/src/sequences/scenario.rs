//! What decides a sequence besides its size and seed, and the checks on it.

use std::sync::Arc;

use crate::ParameterError;

/// Side of the frame, pixels, for which a target's size and the slant are given.
pub const NOMINAL_SIZE_PX: usize = 512;
/// Least and largest side of a frame, pixels.
pub const SIZE_RANGE_PX: [usize; 2] = [64, 4096];

/// Beyond this zoom at either end of a sequence the supersampling would alias.
const MOST_ZOOM: f64 = 2.0;
/// Largest change of scale at the border by slant, at either end of a sequence.
const MOST_SLANT: f64 = 0.3;
const MOST_FRAMES: usize = 10_000;
/// Sides of a photograph, pixels.
const PHOTOGRAPH_PX: [f64; 2] = [16.0, 65_536.0];

/// What background or target look like; all are periodic planes around a mean grey of 120.
#[derive(Clone, Debug, PartialEq)]
pub enum Texture {
    /// Noise whose amplitude falls as 1/f^a with the given a (0 to 3): 0 is white, 1 like a natural picture.
    Noise(f64),
    /// Discs of 4 to 40 pixels that cover one another.
    DeadLeaves,
    /// Squares of 16 pixels.
    Checker,
    /// A wall: bricks of 64 by 32 pixels, each with a shade of its own, and bright mortar.
    Brick,
    /// Pebbles of 3 to 12 pixels lit from the upper left, with dark gaps.
    Gravel,
    /// Blades of one to two pixels' width, most of them upright.
    Grass,
    /// Like a photograph of a coffee cup on a table: large, dark, smooth regions, few strong edges, little
    /// texture. The target is cut from a textured place.
    Flat,
    /// A smooth sky with soft clouds beside strongly textured regions. The target is cut from the latter.
    TwoTextures,
    /// A photograph, mirrored and tiled, its shading coarser than 80 pixels removed.
    Photograph(Arc<Photograph>),
}

/// A grey picture from outside.
#[derive(Clone, Debug, PartialEq)]
pub struct Photograph {
    width: usize,
    height: usize,
    pixels: Vec<u8>,
}

/// Outline of a target.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shape {
    /// A circle.
    Disc,
    /// A rectangle with sides as 1.54 to 1.
    Rectangle,
    /// A rounded outline with lobes, another for each seed.
    Blob,
}

/// What moves independently of the camera.
#[derive(Clone, Debug, PartialEq)]
pub struct TargetSpec {
    /// Square root of its area, pixels in a frame of [`NOMINAL_SIZE_PX`]; scales with the frame.
    pub side_px: f64,
    /// Its outline.
    pub shape: Shape,
    /// Velocity relative to the background at mid sequence, px/frame in x (right) and y (down).
    pub velocity: [f64; 2],
    /// Turning about its own centre, degrees/frame.
    pub spin_deg: f64,
    /// Turning of [`velocity`](Self::velocity), degrees/frame.
    pub curve_deg: f64,
    /// Its texture; `None`: another place of the background's texture, which is camouflage.
    pub texture: Option<Texture>,
    /// Its contrast, grey levels rms; `None`: the background's.
    pub contrast: Option<f64>,
    /// Morphing of its texture into another one, radians/frame, together with a wobble of the texture. The
    /// outline stays.
    pub deformation: f64,
    /// At rest relative to the background in frames from ≤ t < to: no motion from frame t - 1 to t.
    pub rest: Option<(usize, usize)>,
}

/// Everything that decides a sequence besides its size and seed.
///
/// Lengths are pixels of the rendered frame and stay as they are at every size, except those of the target and
/// of the slant, which are for frames of [`NOMINAL_SIZE_PX`]. The middle of a sequence is frame
/// [`frames`](Self::frames) / 2.
#[derive(Clone, Debug, PartialEq)]
pub struct Scenario {
    /// Name in tables of results.
    pub name: &'static str,
    /// The background.
    pub texture: Texture,
    /// Contrast of the background, grey levels rms, before saturation.
    pub contrast: f64,
    /// Motion of the background at the middle of the picture, px/frame.
    pub pan: [f64; 2],
    /// Swing of the pan as a share of it, a sine with a period of 16 frames.
    pub pan_modulation: f64,
    /// Rotation of the picture about its middle, degrees/frame.
    pub rotation_deg: f64,
    /// Growth of the picture, share/frame.
    pub zoom: f64,
    /// Change of perspective in x: share of scale per pixel from the middle per frame.
    pub slant: f64,
    /// Random shake of the camera, px rms in each direction.
    pub jitter_px: f64,
    /// What moves, if anything.
    pub target: Option<TargetSpec>,
    /// The camera's motion cancels the target's.
    pub camera_follows: bool,
    /// Noise of the sensor, grey levels rms.
    pub noise: f64,
    /// Largest change of gain per frame, share; a sine with a period of 20 frames.
    pub gain_drift: f64,
    /// Random gain of each frame, share rms.
    pub flicker: f64,
    /// Loss of light in a soft shadow's band that moves over the picture, share.
    pub shadow: f64,
    /// Speed of the shadow, px/frame.
    pub shadow_speed: f64,
    /// Random light of each frame, smooth over a third of the picture, share rms.
    pub uneven_flicker: f64,
    /// Share of the frame interval during which the sensor sees, 0 for none of the blur.
    pub exposure: f64,
    /// Something that looks like the background hides the target fully in frames from ≤ t < to.
    pub occluder: Option<(usize, usize)>,
    /// Strips of a nearer plane move by this share of the camera's motion more than the background.
    pub parallax: f64,
    /// Length of the sequence.
    pub frames: usize,
}

impl Default for TargetSpec {
    fn default() -> Self {
        Self {
            side_px: 64.0,
            shape: Shape::Disc,
            velocity: [4.0, 0.0],
            spin_deg: 0.0,
            curve_deg: 0.0,
            texture: None,
            contrast: None,
            deformation: 0.0,
            rest: None,
        }
    }
}

impl Default for Scenario {
    fn default() -> Self {
        Self {
            name: "base",
            texture: Texture::Noise(1.0),
            contrast: 35.0,
            pan: [4.0, 2.0],
            pan_modulation: 0.0,
            rotation_deg: 0.0,
            zoom: 0.0,
            slant: 0.0,
            jitter_px: 0.0,
            target: Some(TargetSpec::default()),
            camera_follows: false,
            noise: 2.0,
            gain_drift: 0.0,
            flicker: 0.0,
            shadow: 0.0,
            shadow_speed: 5.0,
            uneven_flicker: 0.0,
            exposure: 0.0,
            occluder: None,
            parallax: 0.0,
            frames: 20,
        }
    }
}

impl Photograph {
    /// A picture from rows of grey levels.
    ///
    /// # Errors
    /// A side out of its range of 16 to 65536 pixels, or another number of pixels than width times height.
    pub fn new(width: usize, height: usize, pixels: Vec<u8>) -> Result<Self, ParameterError> {
        within("photograph width", width as f64, PHOTOGRAPH_PX)?;
        within("photograph height", height as f64, PHOTOGRAPH_PX)?;
        within("number of a photograph's pixels", pixels.len() as f64, [(width * height) as f64; 2])?;
        Ok(Self { width, height, pixels })
    }

    pub(super) fn width(&self) -> usize {
        self.width
    }

    pub(super) fn height(&self) -> usize {
        self.height
    }

    pub(super) fn pixel(&self, x: usize, y: usize) -> u8 {
        self.pixels[y * self.width + x]
    }
}

impl Scenario {
    /// Frame at which target and camera are where their parameters say: the middle.
    pub fn middle(&self) -> usize {
        self.frames / 2
    }

    /// Checks every number against its range.
    ///
    /// # Errors
    /// The first parameter out of range, by name, with its value and what is permitted.
    pub fn check(&self) -> Result<(), ParameterError> {
        within("frames", self.frames as f64, [1.0, MOST_FRAMES as f64])?;
        check_texture(&self.texture)?;
        let half = self.middle().max(1) as f64;
        let slant = self.slant * half * 0.5 * NOMINAL_SIZE_PX as f64;
        for (name, value, least, most) in [
            ("contrast", self.contrast, 0.0, 100.0),
            ("pan in x", self.pan[0], -200.0, 200.0),
            ("pan in y", self.pan[1], -200.0, 200.0),
            ("pan_modulation", self.pan_modulation, -2.0, 2.0),
            ("rotation_deg", self.rotation_deg, -30.0, 30.0),
            ("zoom", self.zoom, -0.5, 0.5),
            ("zoom at an end of the sequence", libm::pow(1.0 + self.zoom, half), 1.0 / MOST_ZOOM, MOST_ZOOM),
            ("slant at the border at an end of the sequence", slant, -MOST_SLANT, MOST_SLANT),
            ("jitter_px", self.jitter_px, 0.0, 100.0),
            ("noise", self.noise, 0.0, 100.0),
            ("gain_drift", self.gain_drift, -0.2, 0.2),
            ("flicker", self.flicker, 0.0, 1.0),
            ("shadow", self.shadow, 0.0, 1.0),
            ("shadow_speed", self.shadow_speed, -200.0, 200.0),
            ("uneven_flicker", self.uneven_flicker, 0.0, 1.0),
            ("exposure", self.exposure, 0.0, 1.0),
            ("parallax", self.parallax, -2.0, 2.0),
        ] {
            within(name, value, [least, most])?;
        }
        if let Some(target) = &self.target {
            self.check_target(target)?;
        }
        self.check_occluder()
    }

    fn check_target(&self, target: &TargetSpec) -> Result<(), ParameterError> {
        for (name, value, least, most) in [
            ("target.side_px", target.side_px, 4.0, NOMINAL_SIZE_PX as f64),
            ("target.velocity in x", target.velocity[0], -200.0, 200.0),
            ("target.velocity in y", target.velocity[1], -200.0, 200.0),
            ("target.spin_deg", target.spin_deg, -90.0, 90.0),
            ("target.curve_deg", target.curve_deg, -90.0, 90.0),
            ("target.contrast", target.contrast.unwrap_or(0.0), 0.0, 100.0),
            ("target.deformation", target.deformation, 0.0, 3.0),
        ] {
            within(name, value, [least, most])?;
        }
        if let Some(texture) = &target.texture {
            check_texture(texture)?;
        }
        target.rest.map_or(Ok(()), |rest| self.check_interval("end of target.rest", rest))
    }

    /// The occluder lies across the target's path, which must therefore have a direction.
    fn check_occluder(&self) -> Result<(), ParameterError> {
        let Some(interval) = self.occluder else { return Ok(()) };
        self.check_interval("end of occluder", interval)?;
        let [x, y] = self.target.as_ref().map_or([0.0; 2], |target| target.velocity);
        within("speed of a target with an occluder", (x * x + y * y).sqrt(), [0.1, f64::INFINITY])
    }

    fn check_interval(&self, name: &'static str, (from, to): (usize, usize)) -> Result<(), ParameterError> {
        within(name, to as f64, [from as f64 + 1.0, self.frames as f64])
    }
}

fn check_texture(texture: &Texture) -> Result<(), ParameterError> {
    match texture {
        Texture::Noise(exponent) => within("exponent of the noise texture", *exponent, [0.0, 3.0]),
        _ => Ok(()),
    }
}

/// Refuses what is outside; NaN is.
pub(super) fn within(name: &'static str, value: f64, [least, most]: [f64; 2]) -> Result<(), ParameterError> {
    if value >= least && value <= most { Ok(()) } else { Err(ParameterError { name, value, least, most }) }
}
