//! The scenarios that detectors are judged by (design notes on vision, sections 4 and 5).

use super::scenario::{Scenario, TargetSpec, Texture};

/// Frames of the scenarios without target.
const EMPTY_FRAMES: usize = 11;
/// Contrast of pictures with large flat regions, grey levels rms.
const FLAT_CONTRAST: f64 = 45.0;

/// 31 scenarios: what camera, target, light, and ground do, each at a strength that a good detector bears.
///
/// Deviations from the notes: procedural textures in place of photographs; where an occluder is, the camera pans
/// against the target's motion and the sequence is longer, so that the target is in full view before and after.
pub fn with_target() -> Vec<Scenario> {
    let mut all = motions();
    all.extend(targets());
    all.extend(lights());
    all.extend(pictures());
    all
}

/// 24 scenarios in which nothing moves by itself: the notes' twelve, then more light, motion, and textures.
pub fn without_target() -> Vec<Scenario> {
    let mut all = vec![
        Scenario { pan: [0.0, 0.0], ..named("empty_static") },
        Scenario { pan: [4.3, 2.1], ..named("empty_pan") },
        Scenario { pan: [3.0, 1.0], rotation_deg: 0.6, ..named("empty_rotation") },
        Scenario { pan: [2.0, 0.0], zoom: 0.012, ..named("empty_zoom") },
        Scenario { noise: 10.0, ..named("empty_noise") },
        Scenario { rotation_deg: 0.2, texture: Texture::Gravel, ..named("empty_gravel") },
        Scenario { texture: Texture::Flat, contrast: FLAT_CONTRAST, ..named("empty_flat") },
        Scenario { flicker: 0.1, ..named("empty_flicker") },
        Scenario { shadow: 0.5, ..named("empty_shadow") },
        Scenario { contrast: 8.0, ..named("empty_low_contrast") },
        Scenario { pan: [3.0, 2.0], slant: 2.5e-5, rotation_deg: 0.2, ..named("empty_perspective") },
        lab(Scenario { noise: 3.0, ..named("empty_dead_leaves") }),
        Scenario { uneven_flicker: 0.15, ..named("empty_uneven_flicker") },
        Scenario { jitter_px: 12.0, ..named("empty_jitter") },
        Scenario { pan: [14.0, -8.0], ..named("empty_fast_pan") },
        Scenario { pan: [8.0, 4.0], exposure: 0.9, ..named("empty_motion_blur") },
        Scenario { rotation_deg: 3.0, zoom: 0.02, ..named("empty_rotation3_zoom2") },
        Scenario { gain_drift: 0.04, ..named("empty_gain_drift") },
        Scenario { texture: Texture::Brick, ..named("empty_brick") },
        Scenario { texture: Texture::Grass, ..named("empty_grass") },
        Scenario { texture: Texture::TwoTextures, contrast: FLAT_CONTRAST, ..named("empty_two_textures") },
        Scenario { pan: [5.0, -2.0], rotation_deg: 0.3, flicker: 0.05, shadow: 0.3, ..named("empty_light") },
        Scenario { contrast: 20.0, noise: 25.0, ..named("empty_noise25") },
        Scenario { contrast: 3.0, noise: 3.0, ..named("empty_contrast3") },
    ];
    for scenario in &mut all {
        scenario.target = None;
        scenario.frames = EMPTY_FRAMES;
    }
    all
}

/// 25 scenarios where detectors begin to fail: the notes' hard set and the far ends of their sweep.
pub fn hard() -> Vec<Scenario> {
    let mut all = hard_targets();
    all.extend(hard_noise());
    all.extend(hard_motion());
    all
}

/// What the camera does.
fn motions() -> Vec<Scenario> {
    vec![
        Scenario { pan: [0.0, 0.0], ..named("static_cam") },
        Scenario { pan: [6.0, 3.0], ..named("pan") },
        Scenario { pan: [3.3, -1.6], ..named("pan_frac") },
        Scenario { pan: [14.0, -8.0], ..named("fast_pan") },
        lab(with(
            Scenario { noise: 3.0, ..named("lab_1994") },
            TargetSpec { side_px: 90.0, velocity: [-7.0, 3.0], curve_deg: 2.0, ..disc() },
        )),
        Scenario { pan: [3.0, 1.0], rotation_deg: 0.6, ..named("rotation") },
        Scenario { pan: [2.0, 0.0], zoom: 0.012, ..named("zoom") },
        Scenario { pan: [3.0, 2.0], slant: 2.5e-5, rotation_deg: 0.2, ..named("perspective") },
        Scenario { pan: [1.0, 0.0], jitter_px: 3.0, ..named("jitter") },
        Scenario { pan: [8.0, 4.0], exposure: 0.9, ..moving("motion_blur", [6.0, 0.0]) },
        with(
            Scenario { pan: [0.0, 0.0], rotation_deg: 0.2, camera_follows: true, ..named("tracking_cam") },
            TargetSpec { velocity: [6.0, 3.0], curve_deg: 3.0, ..disc() },
        ),
        Scenario { parallax: 0.25, ..named("parallax") },
    ]
}

/// What the target is and does.
fn targets() -> Vec<Scenario> {
    vec![
        sized("small", 32.0),
        sized("large", 125.0),
        moving("slow", [1.6, 0.0]),
        moving("fast", [11.0, 8.0]),
        with(Scenario { frames: 28, ..named("stop_start") }, TargetSpec { rest: Some((8, 16)), ..disc() }),
        with(
            Scenario { pan: [-4.0, 2.0], frames: 36, occluder: Some((14, 21)), ..named("occlusion") },
            TargetSpec { side_px: 56.0, velocity: [8.0, 0.0], ..disc() },
        ),
        with(named("deforming"), TargetSpec { deformation: 0.12, spin_deg: 2.0, ..disc() }),
    ]
}

/// What light and sensor do.
fn lights() -> Vec<Scenario> {
    vec![
        Scenario { noise: 10.0, ..named("noise10") },
        Scenario { contrast: 8.0, ..named("low_contrast") },
        Scenario { gain_drift: 0.04, ..named("gain_drift") },
        Scenario { flicker: 0.1, ..named("flicker") },
        Scenario { shadow: 0.5, ..named("shadow") },
        Scenario { uneven_flicker: 0.08, ..named("uneven_flicker") },
    ]
}

/// What the ground looks like, and everything together.
fn pictures() -> Vec<Scenario> {
    vec![
        Scenario { texture: Texture::Gravel, ..named("gravel") },
        Scenario { texture: Texture::Grass, ..named("grass") },
        Scenario { texture: Texture::Flat, contrast: FLAT_CONTRAST, ..named("flat") },
        Scenario { texture: Texture::TwoTextures, contrast: FLAT_CONTRAST, ..named("two_textures") },
        Scenario { texture: Texture::Brick, ..named("brick") },
        with(
            Scenario {
                texture: Texture::Gravel,
                pan: [5.0, -3.0],
                pan_modulation: 0.4,
                rotation_deg: 0.3,
                zoom: 0.004,
                noise: 4.0,
                gain_drift: 0.02,
                shadow: 0.2,
                exposure: 0.4,
                ..named("combined")
            },
            TargetSpec { velocity: [5.0, 2.0], curve_deg: 2.0, ..disc() },
        ),
    ]
}

fn hard_targets() -> Vec<Scenario> {
    vec![
        Scenario { noise: 4.0, ..sized("target16", 16.0) },
        sized("target12", 12.0),
        with(named("target9"), TargetSpec { side_px: 9.0, velocity: [3.0, 2.0], ..disc() }),
        // an eighth of a frame's area
        sized("target_eighth", 181.0),
        moving("slow0.94", [0.8, 0.5]),
        moving("slow0.58", [0.5, 0.3]),
        Scenario { frames: 10, ..moving("fast20", [16.0, 12.0]) },
        with(named("morph0.5"), TargetSpec { deformation: 0.5, ..disc() }),
        with(
            Scenario { pan: [-4.0, 2.0], frames: 30, occluder: Some((11, 17)), ..named("occlusion_small") },
            TargetSpec { side_px: 48.0, velocity: [8.0, 0.0], ..disc() },
        ),
        Scenario { texture: Texture::Brick, noise: 8.0, ..sized("brick_noise", 40.0) },
    ]
}

fn hard_noise() -> Vec<Scenario> {
    vec![
        Scenario { contrast: 20.0, noise: 25.0, ..named("noise25") },
        Scenario { contrast: 25.0, noise: 25.0, ..sized("noise25_small", 32.0) },
        Scenario { noise: 30.0, ..named("noise30") },
        Scenario { contrast: 25.0, noise: 50.0, ..sized("noise50", 40.0) },
        Scenario { contrast: 25.0, noise: 12.0, ..sized("noise12_target16", 16.0) },
        Scenario { contrast: 3.0, noise: 3.0, ..named("contrast3") },
        Scenario { uneven_flicker: 0.15, ..named("uneven_flicker15") },
        Scenario { flicker: 0.4, ..named("flicker40") },
    ]
}

fn hard_motion() -> Vec<Scenario> {
    vec![
        Scenario { rotation_deg: 3.0, zoom: 0.02, ..named("rotation3_zoom2") },
        Scenario { rotation_deg: 4.0, ..named("rotation4") },
        Scenario { zoom: 0.08, frames: 10, ..named("zoom8") },
        Scenario { jitter_px: 12.0, ..named("jitter12") },
        // so short that the target stays in the picture
        Scenario { pan: [48.0, 0.0], frames: 8, ..named("pan48") },
        Scenario { pan: [16.0, 8.0], exposure: 1.0, frames: 14, ..moving("blur18", [8.0, 4.0]) },
        Scenario { parallax: 0.6, ..named("parallax0.6") },
    ]
}

fn named(name: &'static str) -> Scenario {
    Scenario { name, ..Scenario::default() }
}

fn with(scenario: Scenario, target: TargetSpec) -> Scenario {
    Scenario { target: Some(target), ..scenario }
}

fn disc() -> TargetSpec {
    TargetSpec::default()
}

fn sized(name: &'static str, side_px: f64) -> Scenario {
    with(named(name), TargetSpec { side_px, ..disc() })
}

fn moving(name: &'static str, velocity: [f64; 2]) -> Scenario {
    with(named(name), TargetSpec { velocity, ..disc() })
}

/// The laboratory of figure 2 of the paper: discs seen by an arm that turns a little.
fn lab(scenario: Scenario) -> Scenario {
    Scenario { texture: Texture::DeadLeaves, pan: [5.0, -2.0], rotation_deg: 0.25, ..scenario }
}
