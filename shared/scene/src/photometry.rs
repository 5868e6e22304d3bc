//! From the light on a pixel to its byte: gain, flicker, vignetting, noise, saturation.

use crate::parameters::Lighting;
use crate::random::Random;
use crate::warp::ROUNDING;

/// Entries of the noise table; each row of a frame starts at a place of its own in it.
const TABLE: usize = 1 << 18;
/// Units of the noise table per standard deviation: ±127 are four deviations.
const UNITS: f32 = 32.0;

/// The sensor.
pub(crate) struct Photometry {
    seed: u64,
    lighting: Lighting,
    /// Grey levels per unit of the noise table.
    noise_scale: f32,
    /// [`TABLE`] entries, then the first again for the length of a row.
    noise: Vec<i8>,
    columns: Vec<f32>,
    rows: Vec<f32>,
}

impl Photometry {
    /// For frames of the given size; `random` fills the noise table, `seed` tells apart the frames of scenes.
    pub(crate) fn new(frame: [usize; 2], noise_sigma: f64, seed: u64, mut random: Random) -> Self {
        let mut noise: Vec<i8> = (0..TABLE)
            .map(|_| (random.gaussian() * f64::from(UNITS)).clamp(-127.0, 127.0).round() as i8)
            .collect();
        noise.extend_from_within(..frame[0]);
        let mut photometry = Self {
            seed,
            lighting: Lighting::default(),
            noise_scale: noise_sigma as f32 / UNITS,
            noise,
            columns: vec![1.0; frame[0]],
            rows: vec![1.0; frame[1]],
        };
        photometry.set_lighting(Lighting::default());
        photometry
    }

    /// Changes the light.
    pub(crate) fn set_lighting(&mut self, lighting: Lighting) {
        for factors in [&mut self.columns, &mut self.rows] {
            let half = 0.5 * factors.len() as f64;
            for (i, factor) in factors.iter_mut().enumerate() {
                let from_middle = (i as f64 + 0.5 - half) / half;
                *factor = (1.0 - lighting.vignetting * from_middle * from_middle) as f32;
            }
        }
        self.lighting = lighting;
    }

    /// The gain at a time, flicker included.
    pub(crate) fn gain_at(&self, time_ns: u64) -> f32 {
        let Lighting { gain, flicker, flicker_hz, .. } = self.lighting;
        if flicker == 0.0 {
            return gain as f32;
        }
        let cycles = time_ns as f64 * 1e-9 * flicker_hz;
        (gain * (1.0 + flicker * libm::sin(std::f64::consts::TAU * (cycles - cycles.floor())))) as f32
    }

    /// Writes row `y` of frame number `frame` from the light on its pixels.
    pub(crate) fn expose(&self, grey: &[f32], gain: f32, (frame, y): (u64, usize), pixels: &mut [u8]) {
        let start = place_of_row(self.seed, frame, y);
        let noise = &self.noise[start..start + grey.len()];
        expose_row(grey, &self.columns, noise, (gain * self.rows[y], self.noise_scale), pixels);
    }
}

/// Where in the noise table the row starts: a hash of seed, frame and row (the finaliser of SplitMix64, twice).
fn place_of_row(seed: u64, frame: u64, y: usize) -> usize {
    let mix = |mut z: u64| {
        z = z.wrapping_add(0x9e37_79b9_7f4a_7c15);
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ z >> 31
    };
    (mix(mix(seed ^ frame.rotate_left(32)) ^ y as u64) % TABLE as u64) as usize
}

#[multiversion::multiversion(targets("x86_64+avx2"))]
fn expose_row(grey: &[f32], columns: &[f32], noise: &[i8], scales: (f32, f32), pixels: &mut [u8]) {
    expose_body(grey, columns, noise, scales, pixels);
}

#[inline(always)]
fn expose_body(grey: &[f32], columns: &[f32], noise: &[i8], scales: (f32, f32), pixels: &mut [u8]) {
    let (gain, noise_scale) = scales;
    for (((pixel, &g), &c), &n) in pixels.iter_mut().zip(grey).zip(columns).zip(noise) {
        let value = g * (gain * c) + f32::from(n) * noise_scale;
        let value = if value > 0.0 { value } else { 0.0 };
        let value = if value < 255.0 { value } else { 255.0 };
        *pixel = (value + ROUNDING).to_bits() as u8;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sensor(noise_sigma: f64) -> Photometry {
        Photometry::new([512, 512], noise_sigma, 1, Random::new(1, 9))
    }

    fn exposed(sensor: &Photometry, grey: f32, frame: u64, y: usize) -> Vec<u8> {
        let mut pixels = vec![0; 512];
        sensor.expose(&[grey; 512], sensor.gain_at(0), (frame, y), &mut pixels);
        pixels
    }

    #[test]
    fn noise_is_a_function_of_frame_and_row_alone_and_has_the_wanted_deviation() {
        let sensor = sensor(2.0);
        let row = exposed(&sensor, 100.0, 7, 31);
        assert_eq!(row, exposed(&sensor, 100.0, 7, 31));
        assert_ne!(row, exposed(&sensor, 100.0, 8, 31));
        assert_ne!(row, exposed(&sensor, 100.0, 7, 32));
        let all: Vec<f64> =
            (0..512).flat_map(|y| exposed(&sensor, 100.0, 3, y)).map(|p| f64::from(p) - 100.0).collect();
        let mean = all.iter().sum::<f64>() / all.len() as f64;
        let sd = (all.iter().map(|x| x * x).sum::<f64>() / all.len() as f64).sqrt();
        // rounding to bytes adds 1/12 to the variance
        assert!(
            mean.abs() < 0.02 && (sd - (4.0f64 + 1.0 / 12.0).sqrt()).abs() < 0.02,
            "mean {mean}, sd {sd}"
        );
    }

    #[test]
    fn bytes_round_and_saturate() {
        let sensor = sensor(0.0);
        for (light, byte) in [(-3.0, 0), (0.4, 0), (0.6, 1), (99.7, 100), (254.6, 255), (3000.0, 255)] {
            assert_eq!(exposed(&sensor, light, 0, 0)[17], byte, "{light}");
        }
    }

    #[test]
    fn lighting_does_what_its_numbers_say() {
        let mut sensor = sensor(0.0);
        sensor.set_lighting(Lighting { gain: 0.5, vignetting: 0.2, flicker: 0.1, flicker_hz: 100.0 });
        assert!((sensor.gain_at(0) - 0.5).abs() < 1e-6);
        assert!((sensor.gain_at(2_500_000) - 0.55).abs() < 1e-6);
        assert_eq!(exposed(&sensor, 200.0, 0, 256)[256], 100);
        assert_eq!(exposed(&sensor, 200.0, 0, 256)[0], 80);
        assert_eq!(exposed(&sensor, 200.0, 0, 0)[0], 64);
    }

    #[test]
    fn vector_and_plain_versions_give_the_same_bits() {
        let grey: Vec<f32> = (0..301).map(|i| i as f32 * 1.37 - 60.0).collect();
        let columns: Vec<f32> = (0..301).map(|i| 1.0 - i as f32 * 1e-3).collect();
        let noise: Vec<i8> = (0..301).map(|i| (i * 37 % 255 - 127) as i8).collect();
        let (mut a, mut b) = (vec![0; 301], vec![0; 301]);
        expose_row(&grey, &columns, &noise, (0.93, 0.061), &mut a);
        expose_body(&grey, &columns, &noise, (0.93, 0.061), &mut b);
        assert_eq!(a, b);
    }
}
