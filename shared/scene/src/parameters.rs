//! What a scene is made of: sizes, contrasts, noise, and the checks on them.

use std::fmt;

/// Side of the square frame, pixels.
pub const FRAME_PX: usize = 512;
/// Usual focal length, pixels: with [`FRAME_PX`] an opening of 90 degrees.
pub const FOCAL_PX: f64 = 256.0;
/// Side of the table's toroidal texture, texels; a power of two.
pub const TEXTURE_TEXELS: usize = 2048;
/// Side of a texel on the table, metres: half a pixel's footprint at 0.5 m, so that one texel of prefilter is
/// half a pixel of blur.
pub const TEXEL_M: f64 = 0.001;
/// Side of a texel for [`Profile::Reference`], metres: two texels of prefilter are half a pixel of blur.
pub const REFERENCE_TEXEL_M: f64 = 0.0005;
/// Standard deviation of the grey levels of table and vehicle before any blur.
pub const CONTRAST_SD: f64 = 40.0;
/// Standard deviation of the sensor's noise, grey levels.
pub const NOISE_SIGMA: f64 = 2.0;
/// Vehicle: length along its heading, width, height, metres.
pub const VEHICLE_SIZE_M: [f64; 3] = [0.15, 0.10, 0.06];
/// Radius of the white disc of the training scene, metres.
pub const BLOB_RADIUS_M: f64 = 0.025;

/// Largest contrast that the uniform distribution of the leaves' grey levels holds within 0 to 255.
const MAX_CONTRAST_SD: f64 = 73.0;

/// With coarser texels the smallest leaf, 1.5 mm, is none.
const COARSEST_TEXEL_M: f64 = 0.002;

/// How carefully the texture is prefiltered before the bilinear look-up (design notes on the simulator, section 3).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Profile {
    /// One texel of Gaussian prefilter: the shift of a frame is right within 1 %.
    Fast,
    /// Two texels of Gaussian prefilter: bilinear interpolation is all but exact. Wants texels of half the size.
    Reference,
}

impl Profile {
    /// Standard deviation of the Gaussian prefilter of every level, in that level's texels.
    pub(crate) fn prefilter_texels(self) -> f64 {
        match self {
            Profile::Fast => 1.0,
            Profile::Reference => 2.0,
        }
    }
}

/// The light on the scene and the lens's fall-off.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lighting {
    /// Factor on all grey levels, not negative.
    pub gain: f64,
    /// Loss of light at the middle of each border of the frame, 0 to 0.5; the corners lose it twice.
    pub vignetting: f64,
    /// Half swing of the lamps' flicker as a fraction of the gain, 0 to 1.
    pub flicker: f64,
    /// Frequency of the flicker, Hz.
    pub flicker_hz: f64,
}

impl Default for Lighting {
    fn default() -> Self {
        Self { gain: 1.0, vignetting: 0.0, flicker: 0.0, flicker_hz: 100.0 }
    }
}

/// Everything that decides a frame besides its [`View`](crate::View).
#[derive(Clone, Debug, PartialEq)]
pub struct SceneParameters {
    /// Seed of textures and noise.
    pub seed: u64,
    /// Width of the frame, pixels, 8 to 4096.
    pub width: usize,
    /// Height of the frame, pixels, 8 to 4096.
    pub height: usize,
    /// Side of the table's texture, texels, a power of two, 256 to 8192; see [`TEXTURE_TEXELS`].
    pub texture_texels: usize,
    /// Side of a texel, metres; see [`TEXEL_M`].
    pub texel_m: f64,
    /// Contrast of table and vehicle, grey levels; see [`CONTRAST_SD`].
    pub contrast_sd: f64,
    /// Sensor noise, grey levels; see [`NOISE_SIGMA`].
    pub noise_sigma: f64,
    /// Length, width, height of the vehicle, metres; see [`VEHICLE_SIZE_M`].
    pub vehicle_size_m: [f64; 3],
    /// Radius of the disc, metres; see [`BLOB_RADIUS_M`].
    pub blob_radius_m: f64,
    /// Care in prefiltering.
    pub profile: Profile,
    /// Light at the start; [`Scene::set_lighting`](crate::Scene::set_lighting) changes it.
    pub lighting: Lighting,
}

impl Default for SceneParameters {
    fn default() -> Self {
        Self {
            seed: 1,
            width: FRAME_PX,
            height: FRAME_PX,
            texture_texels: TEXTURE_TEXELS,
            texel_m: TEXEL_M,
            contrast_sd: CONTRAST_SD,
            noise_sigma: NOISE_SIGMA,
            vehicle_size_m: VEHICLE_SIZE_M,
            blob_radius_m: BLOB_RADIUS_M,
            profile: Profile::Fast,
            lighting: Lighting::default(),
        }
    }
}

impl SceneParameters {
    /// The defaults with the careful prefilter and the finer texels that it wants. The texture then repeats
    /// after 1.02 m instead of 2.05 m.
    pub fn reference() -> Self {
        Self { profile: Profile::Reference, texel_m: REFERENCE_TEXEL_M, ..Self::default() }
    }

    /// Checks every number against its range.
    ///
    /// # Errors
    /// The first parameter out of range, by name, with its value and what is permitted.
    pub fn check(&self) -> Result<(), ParameterError> {
        let within = |name, value: f64, least: f64, most: f64| {
            if value >= least && value <= most {
                Ok(())
            } else {
                Err(ParameterError { name, value, least, most })
            }
        };
        within("width", self.width as f64, 8.0, 4096.0)?;
        within("height", self.height as f64, 8.0, 4096.0)?;
        let texels = self.texture_texels;
        let power = if texels.is_power_of_two() { texels as f64 } else { f64::NAN };
        within("texture_texels (a power of two)", power, 256.0, 8192.0)?;
        let smallest = crate::texture::SMALLEST_TORUS_M / texels as f64;
        within("texel_m", self.texel_m, smallest.max(1e-4), COARSEST_TEXEL_M)?;
        within("contrast_sd", self.contrast_sd, 0.0, MAX_CONTRAST_SD)?;
        within("noise_sigma", self.noise_sigma, 0.0, 50.0)?;
        for (name, value) in
            ["vehicle length", "vehicle width", "vehicle height"].into_iter().zip(self.vehicle_size_m)
        {
            within(name, value, 0.005, 1.0)?;
        }
        within("blob_radius_m", self.blob_radius_m, 0.001, 0.5)?;
        self.lighting.check()
    }
}

impl Lighting {
    /// Checks every number against its range.
    ///
    /// # Errors
    /// The first number out of range.
    pub fn check(&self) -> Result<(), ParameterError> {
        for (name, value, most) in [
            ("lighting.gain", self.gain, 100.0),
            ("lighting.vignetting", self.vignetting, 0.5),
            ("lighting.flicker", self.flicker, 1.0),
            ("lighting.flicker_hz", self.flicker_hz, 1e6),
        ] {
            if !(value >= 0.0 && value <= most) {
                return Err(ParameterError { name, value, least: 0.0, most });
            }
        }
        Ok(())
    }
}

/// A parameter out of its range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ParameterError {
    /// Name of the parameter.
    pub name: &'static str,
    /// Its value; NaN where it is not of the kind that the name says.
    pub value: f64,
    /// Least value permitted.
    pub least: f64,
    /// Largest value permitted.
    pub most: f64,
}

impl fmt::Display for ParameterError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { name, value, least, most } = self;
        write!(f, "{name} is {value}, permitted is {least} to {most}")
    }
}

impl std::error::Error for ParameterError {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn defaults_pass_and_each_bad_number_is_named() {
        assert_eq!(SceneParameters::default().check(), Ok(()));
        assert_eq!(SceneParameters::reference().check(), Ok(()));
        let bad = SceneParameters { texture_texels: 2000, ..Default::default() };
        assert_eq!(bad.check().unwrap_err().name, "texture_texels (a power of two)");
        let bad = SceneParameters { noise_sigma: f64::NAN, ..Default::default() };
        assert_eq!(bad.check().unwrap_err().name, "noise_sigma");
        let bad = Lighting { gain: -0.5, ..Default::default() };
        assert_eq!(bad.check().unwrap_err().to_string(), "lighting.gain is -0.5, permitted is 0 to 100");
    }
}
