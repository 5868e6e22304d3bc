//! The bright blob: accuracy, and what is not a blob.

use proptest::prelude::*;

use super::*;

/// An anti-aliased disc (16 x 16 samples per rim pixel) on a ground, with Gaussian noise.
fn disc(size: (usize, usize), centre: (f64, f64), radius: f64, noise: f64, seed: u64) -> Picture {
    let mut random = Random(seed);
    Picture::new(size.0, size.1, |x, y| {
        let (dx, dy) = (x as f64 - centre.0, y as f64 - centre.1);
        let distance = dx.hypot(dy);
        let cover = if distance < radius - 1.0 {
            1.0
        } else if distance > radius + 1.0 {
            0.0
        } else {
            let sample = |i: usize| (i as f64 + 0.5) / 16.0 - 0.5;
            let inside = |i: usize| (dx + sample(i % 16)).hypot(dy + sample(i / 16)) < radius;
            (0..256).filter(|&i| inside(i)).count() as f64 / 256.0
        };
        25.0 + 200.0 * cover + noise * random.normal()
    })
}

fn find(picture: &Picture) -> Option<Detection> {
    let mut scratch = BlobScratch::new(picture.width, picture.height);
    detect_blob(&picture.image(), &BlobParameters::default(), &mut scratch)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    #[test]
    fn a_disc_is_found_to_a_tenth_of_a_pixel(
        x in 0.2..0.8f64, y in 0.2..0.8f64, radius in 5.0..40.0f64, seed in any::<u64>(),
        size in prop_oneof![Just((512, 512)), Just((320, 240)), Just((641, 479))],
    ) {
        let centre = (x * size.0 as f64, y * size.1 as f64);
        let found = find(&disc(size, centre, radius, 2.0, seed)).unwrap();
        let error = (found.u - centre.0).hypot(found.v - centre.1);
        prop_assert!(error < 0.1, "{} px: {:?}, centre {:?}", error, found, centre);
        let area = std::f64::consts::PI * radius * radius;
        prop_assert!((found.area_px - area).abs() < 0.05 * area + 10.0, "{} of {}", found.area_px, area);
        prop_assert!((0.0..1.0).contains(&found.confidence));
        prop_assert_eq!((found.vu, found.vv), (0.0, 0.0));
    }

    #[test]
    fn a_disc_cut_by_the_border_is_none(
        side in 0..4usize, along in 0.2..0.8f64, depth in -0.9..0.9f64, radius in 6.0..40.0f64,
    ) {
        let at = depth * radius;
        let centre = match side {
            0 => (at, along * 511.0),
            1 => (511.0 - at, along * 511.0),
            2 => (along * 511.0, at),
            _ => (along * 511.0, 511.0 - at),
        };
        prop_assert_eq!(find(&disc((512, 512), centre, radius, 2.0, 1)), None);
    }

    #[test]
    fn pure_noise_is_none(seed in any::<u64>(), sigma in 0.0..60.0f64) {
        let mut random = Random(seed);
        let picture = Picture::new(256, 200, |_, _| 120.0 + sigma * random.normal());
        prop_assert_eq!(find(&picture), None);
    }
}

#[test]
fn a_uniform_image_is_none() {
    for grey in [0.0, 25.0, 128.0, 255.0] {
        assert_eq!(find(&Picture::new(512, 512, |_, _| grey)), None);
    }
}

#[test]
fn clutter_is_none() {
    for seed in 0..10 {
        for texture in [Texture::natural(300, 35.0, seed), Texture::new(300, 6.0, 40.0, seed)] {
            let found = find(&texture.moved(512, 512, (0, 0)));
            assert_eq!(found, None, "seed {seed}");
        }
    }
}

#[test]
fn two_discs_are_none_and_a_small_speck_beside_a_disc_does_no_harm() {
    let one = disc((512, 512), (150.3, 200.7), 20.0, 2.0, 1);
    let with = |radius: f64| {
        let other = disc((512, 512), (350.0, 300.0), radius, 0.0, 1);
        let pixels = one.pixels.iter().zip(&other.pixels).map(|(a, b)| *a.max(b)).collect();
        Picture { pixels, ..one.clone() }
    };
    assert_eq!(find(&with(19.0)), None);
    let found = find(&with(8.0)).unwrap();
    assert!((found.u - 150.3).hypot(found.v - 200.7) < 0.1, "{found:?}");
}

#[test]
fn a_disc_on_an_unevenly_lit_ground_is_found() {
    let mut picture = disc((512, 512), (300.25, 140.5), 18.0, 2.0, 3);
    for (i, pixel) in picture.pixels.iter_mut().enumerate() {
        *pixel = pixel.saturating_add((i % 512 / 20) as u8);
    }
    let found = find(&picture).unwrap();
    assert!((found.u - 300.25).hypot(found.v - 140.5) < 0.1, "{found:?}");
}
