use std::sync::Arc;

use super::plane::Plane;
use super::surfaces::surface;
use super::*;

fn every_texture() -> Vec<Texture> {
    let pixels =
        (0..300 * 200).map(|i| (i % 300 / 2 + 40 * (i / 900 % 2) + 30 * (i / 7 % 2)) as u8).collect();
    vec![
        Texture::Noise(0.0),
        Texture::Noise(1.0),
        Texture::Noise(2.0),
        Texture::DeadLeaves,
        Texture::Checker,
        Texture::Brick,
        Texture::Gravel,
        Texture::Grass,
        Texture::Flat,
        Texture::TwoTextures,
        Texture::Photograph(Arc::new(Photograph::new(300, 200, pixels).unwrap())),
    ]
}

#[test]
fn each_texture_has_the_contrast_asked_for_and_a_mean_of_120() {
    for texture in every_texture() {
        for contrast in [8.0, 35.0, 45.0] {
            let plane = surface(&texture, contrast, 1024, &mut Random::new(4, 2));
            let (mean, deviation) = plane.mean_and_deviation();
            assert!((deviation / contrast - 1.0).abs() < 0.1, "{texture:?}, {contrast}: {deviation}");
            assert!((mean - 120.0).abs() < 4.0, "{texture:?}, {contrast}: mean {mean}");
        }
    }
}

#[test]
fn frames_show_most_of_the_contrast() {
    // what pixel and interpolation take away; white noise loses most and is not among the scenarios
    for texture in every_texture().into_iter().skip(1) {
        let scenario = Scenario { texture: texture.clone(), contrast: 30.0, ..still() };
        let (_, deviation) = mean_and_deviation(&frame(&scenario, 512, 3, 0));
        let expected = match texture {
            // what a frame holds of these differs
            Texture::Flat | Texture::TwoTextures => 15.0..50.0,
            _ => 20.0..36.0,
        };
        assert!(expected.contains(&deviation), "{texture:?}: {deviation}");
    }
}

/// Mean power of a texture's rows at wavenumbers `waves`, cycles per side.
fn power(plane: &Plane, waves: std::ops::Range<usize>) -> f64 {
    let mut sum = 0.0;
    for row in plane.grey.chunks_exact(plane.width).step_by(8) {
        for k in waves.clone() {
            let step = std::f64::consts::TAU * k as f64 / plane.width as f64;
            let (mut re, mut im) = (0.0, 0.0);
            for (x, &g) in row.iter().enumerate() {
                let (sin, cos) = (step * x as f64).sin_cos();
                (re, im) = (re + f64::from(g) * cos, im + f64::from(g) * sin);
            }
            sum += re * re + im * im;
        }
    }
    sum / waves.len() as f64
}

#[test]
fn noise_falls_with_the_exponent_asked_for() {
    for exponent in [0.75, 1.0, 1.5] {
        let plane = surface(&Texture::Noise(exponent), 20.0, 1024, &mut Random::new(1, 2));
        // from wavelengths of 85 texels to ones of 11: three octaves. A row of a plane with density f^-2a has
        // the density f^(1 - 2a).
        let octaves = (power(&plane, 10..14) / power(&plane, 80..112)).log2();
        let expected = 3.0 * (2.0 * exponent - 1.0);
        assert!((octaves - expected).abs() < 0.7, "{exponent}: power falls by 2^{octaves}, not 2^{expected}");
    }
}

#[test]
fn noise_has_nothing_coarser_than_256_texels_and_nothing_that_aliases() {
    for exponent in [0.5, 1.0, 2.0] {
        let plane = surface(&Texture::Noise(exponent), 20.0, 1024, &mut Random::new(1, 2));
        let means: Vec<f64> = (0..16)
            .map(|i| {
                let (x, y) = (i % 4 * 256, i / 4 * 256);
                let rows = (y..y + 256).flat_map(|y| &plane.grey[y * 1024 + x..][..256]);
                rows.map(|&g| f64::from(g)).sum::<f64>() / 65536.0
            })
            .collect();
        let (_, coarse) = mean_and_deviation(&means);
        assert!(coarse < 0.2 * 20.0, "{exponent}: means over 256 texels differ by {coarse}");
        let fine = power(&plane, 490..512) / power(&plane, 100..122);
        assert!(fine < 0.02, "{exponent}: {fine}");
    }
}

#[test]
fn textures_continue_at_their_border() {
    for texture in every_texture() {
        let plane = surface(&texture, 35.0, 1024, &mut Random::new(4, 2));
        let (width, height) = (plane.width, plane.height);
        let columns = |a: usize, b: usize| -> f64 {
            let steps = (0..height).map(|y| plane.grey[y * width + a] - plane.grey[y * width + b]);
            steps.map(|d| f64::from(d.abs())).sum()
        };
        let rows = |a: usize, b: usize| -> f64 {
            let steps = (0..width).map(|x| plane.grey[a * width + x] - plane.grey[b * width + x]);
            steps.map(|d| f64::from(d.abs())).sum()
        };
        let inside = |step: &dyn Fn(usize, usize) -> f64| {
            (0..width.min(height) - 1).map(|i| step(i, i + 1)).fold(0.0, f64::max)
        };
        for (border, inside) in
            [(columns(0, width - 1), inside(&columns)), (rows(0, height - 1), inside(&rows))]
        {
            assert!(border < 1.1 * inside, "{texture:?}: {border}, inside {inside}");
        }
    }
}

#[test]
fn photograph_is_mirrored_and_loses_its_coarse_shading() {
    let pixels = (0..400 * 300).map(|i| (i % 400 / 4 + 60 + 40 * (i % 400 / 10 % 2)) as u8).collect();
    let photograph = Texture::Photograph(Arc::new(Photograph::new(400, 300, pixels).unwrap()));
    let plane = surface(&photograph, 30.0, 1024, &mut Random::new(1, 2));
    assert_eq!((plane.width, plane.height), (800, 600));
    for (x, y) in [(3, 5), (120, 40), (399, 299)] {
        let grey = plane.grey[y * 800 + x];
        assert!((plane.grey[y * 800 + 799 - x] - grey).abs() < 0.1);
        assert!((plane.grey[(599 - y) * 800 + x] - grey).abs() < 0.1);
    }
    let mean = |from: usize| {
        let columns = (from..from + 100).map(|x| f64::from(plane.grey[1000 * 80 + x]));
        columns.sum::<f64>() / 100.0
    };
    // the ramp rises by 75 grey levels, beside stripes of ±20, between the two places
    assert!((mean(50) - mean(250)).abs() < 30.0, "{} and {}", mean(50), mean(250));
}

#[test]
fn target_s_place_in_the_picture_looks_like_its_surroundings() {
    let (size, seeds) = (128, 24);
    let (mut inside, mut outside) = ([0.0; 2], [0.0; 2]);
    for seed in 0..seeds {
        let scenario = Scenario { noise: 0.0, ..Scenario::default() };
        let t = scenario.middle();
        let mut sequence = Sequence::new(&scenario, size, seed).unwrap();
        let centre = sequence.truth(t).position.unwrap();
        let disc = |frame: &[f64]| {
            let texels = (0..size * size)
                .filter(|i| distance([(i % size) as f64, (i / size) as f64], centre) < 8.0)
                .map(|i| frame[i]);
            let (mean, deviation) = mean_and_deviation(&texels.collect::<Vec<_>>());
            [mean / seeds as f64, deviation / seeds as f64]
        };
        let with = disc(&frame_of(&mut sequence, t));
        let without = disc(&frame(&Scenario { target: None, ..scenario }, size, seed, t));
        assert_ne!(with, without);
        (0..2).for_each(|k| (inside[k], outside[k]) = (inside[k] + with[k], outside[k] + without[k]));
    }
    assert!((inside[0] - outside[0]).abs() < 12.0, "means {} and {}", inside[0], outside[0]);
    assert!((inside[1] / outside[1] - 1.0).abs() < 0.15, "deviations {} and {}", inside[1], outside[1]);
}

#[test]
fn target_wears_the_texture_and_contrast_asked_for() {
    let spec = TargetSpec { contrast: Some(0.0), ..TargetSpec::default() };
    let plain = Scenario { target: Some(spec.clone()), ..still() };
    let checked = TargetSpec { texture: Some(Texture::Checker), contrast: None, ..spec };
    let checked = Scenario { target: Some(checked), ..still() };
    for (scenario, deviation) in [(plain, 0.0..0.1), (checked, 25.0..38.0)] {
        let mut sequence = Sequence::new(&scenario, 256, 1).unwrap();
        let centre = sequence.truth(4).position.unwrap();
        let frame = frame_of(&mut sequence, 4);
        let inside = (0..256 * 256)
            .filter(|i| distance([(i % 256) as f64, (i / 256) as f64], centre) < 16.0)
            .map(|i| frame[i]);
        let (_, seen) = mean_and_deviation(&inside.collect::<Vec<_>>());
        assert!(deviation.contains(&seen), "{seen}");
    }
}

#[test]
fn deforming_target_changes_its_texture_and_not_its_outline() {
    let spec = TargetSpec { velocity: [0.0; 2], deformation: 0.3, ..TargetSpec::default() };
    let scenario = Scenario { target: Some(spec), ..still() };
    let mut sequence = Sequence::new(&scenario, 256, 1).unwrap();
    assert_eq!(sequence.truth(2).area_px, sequence.truth(6).area_px);
    let (a, b) = (frame_of(&mut sequence, 2), frame_of(&mut sequence, 6));
    let (count, centroid) = where_different(&a, &b, 256);
    assert!((count as f64) > 0.9 * sequence.truth(2).area_px, "{count}");
    assert!(distance(centroid, sequence.truth(2).position.unwrap()) < 0.7);
}
