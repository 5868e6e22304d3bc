//! The frame against the ideal camera: each pixel a Gaussian of half a pixel over the painted texture.

use super::*;
use crate::levels::PSF_SIGMA_PX;
use crate::texture::Torus;

/// The part of the frame that is compared, pixels.
const CROP: std::ops::Range<usize> = 200..264;

/// What the ideal camera, looking straight down from `position` with its x axis along the base's, sees in the crop.
fn ideal(torus: &Torus, texel_m: f64, position: [f64; 3]) -> Vec<f64> {
    let footprint = position[2] / 256.0;
    let sigma = PSF_SIGMA_PX * footprint / texel_m;
    let mut grey = vec![];
    for y in CROP {
        for x in CROP {
            let u = (position[0] + (x as f64 - 255.5) * footprint) / texel_m;
            let v = (position[1] - (y as f64 - 255.5) * footprint) / texel_m;
            let reach = (5.0 * sigma).ceil() as i64;
            let (mut sum, mut weights) = (0.0, 0.0);
            for j in v.round() as i64 - reach..=v.round() as i64 + reach {
                for i in u.round() as i64 - reach..=u.round() as i64 + reach {
                    let distance = (i as f64 - u).powi(2) + (j as f64 - v).powi(2);
                    let weight = (-0.5 * distance / (sigma * sigma)).exp();
                    let wrap = |n: i64| n.rem_euclid(torus.side as i64) as usize;
                    sum += weight * f64::from(torus.grey[wrap(j) * torus.side + wrap(i)]);
                    weights += weight;
                }
            }
            grey.push(sum / weights);
        }
    }
    grey
}

fn rms(values: impl Iterator<Item = f64> + Clone) -> f64 {
    (values.clone().map(|x| x * x).sum::<f64>() / values.count() as f64).sqrt()
}

/// Error of a frame (grey levels rms) and of the temporal derivative for a quarter of a pixel (share of its rms).
fn errors(parameters: &SceneParameters) -> (f64, f64) {
    let mut scene = Scene::new(parameters);
    let torus = Textures::painted_table(parameters);
    let mut frames = [0.0, 0.25].map(|shift| {
        let position = [0.6 + shift * 0.5 / 256.0, 0.05, 0.5];
        let mut view = View::looking_down(position, 0.0, Kind::Vehicle);
        view.target_position = [30.0, 30.0];
        let mut pixels = vec![0; 512 * 512];
        scene.render(&view, &mut pixels, 512).unwrap();
        let rendered: Vec<f64> =
            CROP.flat_map(|y| CROP.map(move |x| y * 512 + x)).map(|i| f64::from(pixels[i])).collect();
        (rendered, ideal(&torus, parameters.texel_m, position))
    });
    let [(a, ideal_a), (b, ideal_b)] = &mut frames;
    let change = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| y - x).collect::<Vec<f64>>();
    let (got, wanted) = (change(a, b), change(ideal_a, ideal_b));
    let error = rms(got.iter().zip(&wanted).map(|(g, w)| g - w));
    (rms(a.iter().zip(ideal_a.iter()).map(|(x, y)| x - y)), error / rms(wanted.iter().copied()))
}

/// design notes on the simulator, section 3: "dI/dt error < 20 %".
#[test]
fn frame_and_its_change_are_those_of_the_ideal_camera() {
    let fast = SceneParameters { noise_sigma: 0.0, ..Default::default() };
    let reference = SceneParameters { noise_sigma: 0.0, ..SceneParameters::reference() };
    for (name, parameters, most_grey, most_change) in
        [("fast", fast, 2.0, 0.20), ("reference", reference, 1.0, 0.15)]
    {
        let (grey, change) = errors(&parameters);
        println!("{name}: frame off by {grey:.2} grey levels rms, its change by {:.1} %", 100.0 * change);
        assert!(grey < most_grey && change < most_change, "{name}: {grey} grey levels, {change}");
    }
}
