//! The scene: textures once, then a frame per call.

use crate::coverage::Coverage;
use crate::mapping::{Homography, TexturedPlane};
use crate::parameters::{Lighting, ParameterError, SceneParameters};
use crate::photometry::Photometry;
use crate::random::Random;
use crate::solid::{disc_outline, image_disc, vehicle_faces};
use crate::texture::LEAF_MEAN;
use crate::textures::Textures;
use crate::view::{Camera, Kind, View, ViewError};
use crate::warp::RowScratch;

/// Grey level of the disc: white, with room for the noise.
pub(crate) const WHITE: f32 = 235.0;
/// Grey level of a glare: the end of the scale.
const GLARE: f32 = 255.0;
/// Grey level where a pixel sees no table: above the horizon, or from below.
const VOID: f32 = LEAF_MEAN as f32;
/// A camera outside a box sees at most three of its faces.
const MAX_SURFACES: usize = 3;
/// Stream of the seed; those before it are the textures'.
const NOISE_STREAM: u64 = 4;

/// Table, cloth, vehicle and disc, and the camera's sensor. Rendering allocates nothing.
pub struct Scene {
    parameters: SceneParameters,
    textures: Textures,
    photometry: Photometry,
    coverage: [Coverage; MAX_SURFACES],
    glare: Coverage,
    scratch: RowScratch,
    ground: Vec<f32>,
    surface: Vec<f32>,
}

/// A face that hides the ground, with the number of its coverage.
#[derive(Clone, Copy)]
enum Surface {
    White,
    Roof(Homography),
    Side(Homography),
}

impl Scene {
    /// Paints and filters the textures, the work of a tenth of a second, and sets up the scene.
    ///
    /// # Panics
    /// If the parameters do not pass [`SceneParameters::check`].
    pub fn new(parameters: &SceneParameters) -> Scene {
        Scene::with_textures(parameters, Textures::paint(parameters))
    }

    /// A scene of textures that were painted before, for the same parameters.
    ///
    /// # Panics
    /// If the parameters do not pass [`SceneParameters::check`].
    pub fn with_textures(parameters: &SceneParameters, textures: Textures) -> Scene {
        if let Err(error) = parameters.check() {
            panic!("scene parameters must be checked before use: {error}");
        }
        let frame = [parameters.width, parameters.height];
        let noise = Random::new(parameters.seed, NOISE_STREAM);
        let mut scene = Scene {
            textures,
            photometry: Photometry::new(frame, parameters.noise_sigma, parameters.seed, noise),
            coverage: std::array::from_fn(|_| Coverage::new(frame)),
            glare: Coverage::new(frame),
            scratch: RowScratch::new(parameters.width),
            ground: vec![0.0; parameters.width],
            surface: vec![0.0; parameters.width],
            parameters: parameters.clone(),
        };
        scene.photometry.set_lighting(parameters.lighting);
        scene
    }

    /// What the scene was made from; its lighting is the current one.
    pub fn parameters(&self) -> &SceneParameters {
        &self.parameters
    }

    /// Changes the light for the frames that follow.
    ///
    /// # Errors
    /// A number out of range; the light then stays as it is.
    pub fn set_lighting(&mut self, lighting: Lighting) -> Result<(), ParameterError> {
        lighting.check()?;
        self.photometry.set_lighting(lighting);
        self.parameters.lighting = lighting;
        Ok(())
    }

    /// Writes the frame that the camera of `view` exposes: rows of `width` grey bytes, `stride` bytes apart; bytes
    /// between the rows stay as they are. The result depends on the arguments, the parameters and the current
    /// lighting, and on no earlier frame.
    ///
    /// # Errors
    /// A pose that is none, or pixels that do not hold the frame; nothing is written then.
    pub fn render(&mut self, view: &View, pixels: &mut [u8], stride: usize) -> Result<(), ViewError> {
        let (width, height) = (self.parameters.width, self.parameters.height);
        if stride < width {
            return Err(ViewError::StrideTooSmall { stride, width });
        }
        let needed = (height - 1) * stride + width;
        if pixels.len() < needed {
            return Err(ViewError::BufferTooSmall { given: pixels.len(), needed });
        }
        let camera = Camera::new(&self.parameters, view)?;
        let surfaces = self.place_target(&camera, view);
        self.glare.clear();
        if let Some(glare) = view.glare {
            self.glare.cover(&image_disc(glare.centre_px, glare.radius_px));
        }
        let gain = self.photometry.gain_at(view.time_ns);
        let footprint = |depth: f64| depth.abs() / camera.focal_px;
        let ground = match view.kind {
            Kind::Blob => &self.textures.cloth,
            Kind::Vehicle => &self.textures.table,
        };
        let ground_level = ground.choose(footprint(camera.position[2]));
        let roof_level =
            self.textures.vehicle.choose(footprint(camera.position[2] - self.parameters.vehicle_size_m[2]));
        let table = Homography::new(&camera, &TexturedPlane::TABLE);
        for (y, line) in pixels.chunks_mut(stride).take(height).enumerate() {
            match &table {
                Some(table) => self.scratch.draw(table, &ground_level, (y, 0, width), VOID, &mut self.ground),
                None => self.ground.fill(VOID),
            }
            hide_ground(&self.coverage, y, &mut self.surface, &mut self.ground);
            for (surface, coverage) in surfaces.iter().zip(&self.coverage) {
                let (Some(surface), Some((from, to, shares))) = (surface, coverage.row(y)) else { continue };
                match surface {
                    Surface::White => self.surface[from..to].fill(WHITE),
                    Surface::Roof(map) => {
                        self.scratch.draw(map, &roof_level, (y, from, to), VOID, &mut self.surface);
                    }
                    Surface::Side(map) => {
                        self.scratch.draw_slanted(map, &roof_level, (y, from, to), VOID, &mut self.surface);
                    }
                }
                add_surface(shares, &self.surface[from..to], &mut self.ground[from..to]);
            }
            if let Some((from, to, shares)) = self.glare.row(y) {
                let hidden = self.ground[from..to].iter_mut().zip(shares);
                hidden.for_each(|(grey, share)| *grey += share * (GLARE - *grey));
            }
            self.photometry.expose(&self.ground, gain, (view.frame, y), &mut line[..width]);
        }
        Ok(())
    }

    /// Sets the coverages of the faces in sight; those that are `None` cover nothing.
    fn place_target(&mut self, camera: &Camera, view: &View) -> [Option<Surface>; MAX_SURFACES] {
        let mut surfaces = [None; MAX_SURFACES];
        self.coverage.iter_mut().for_each(Coverage::clear);
        match view.kind {
            Kind::Blob if camera.position[2] > 0.0 => {
                let outline = disc_outline(view.target_position, self.parameters.blob_radius_m, camera);
                self.coverage[0].cover(&outline);
                surfaces[0] = Some(Surface::White);
            }
            Kind::Blob => {}
            Kind::Vehicle => {
                let faces =
                    vehicle_faces(view.target_position, view.target_heading, self.parameters.vehicle_size_m);
                let in_sight = faces
                    .iter()
                    .filter_map(|face| Homography::new(camera, &face.plane).map(|map| (face, map)));
                for (i, (face, map)) in in_sight.take(MAX_SURFACES).enumerate() {
                    self.coverage[i].cover(&face.outline(camera));
                    let is_roof = face.plane.normal[2] > 0.0;
                    surfaces[i] = Some(if is_roof { Surface::Roof(map) } else { Surface::Side(map) });
                }
            }
        }
        surfaces
    }
}

/// Takes away from the ground what the faces together cover of it.
fn hide_ground(coverage: &[Coverage], y: usize, hidden: &mut [f32], ground: &mut [f32]) {
    if coverage.iter().all(|c| c.row(y).is_none()) {
        return;
    }
    hidden.fill(0.0);
    for (from, to, shares) in coverage.iter().filter_map(|c| c.row(y)) {
        hidden[from..to].iter_mut().zip(shares).for_each(|(h, share)| *h += share);
    }
    ground.iter_mut().zip(hidden).for_each(|(g, h)| *g *= (1.0 - *h).max(0.0));
}

fn add_surface(shares: &[f32], surface: &[f32], ground: &mut [f32]) {
    for ((g, &share), &s) in ground.iter_mut().zip(shares).zip(surface) {
        *g += share * s;
    }
}

#[cfg(test)]
mod tests;
