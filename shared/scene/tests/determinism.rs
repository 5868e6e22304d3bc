//! A frame is a function of its arguments, to the bit.
#![allow(clippy::unwrap_used)]

mod common;

use common::{about, product};
use pursuit_scene::{Kind, Lighting, Scene, SceneParameters, View, ViewError};

/// FNV-1a.
fn hash(pixels: &[u8]) -> u64 {
    pixels.iter().fold(0xcbf2_9ce4_8422_2325, |h, &p| (h ^ u64::from(p)).wrapping_mul(0x100_0000_01b3))
}

fn views() -> Vec<View> {
    (0..6)
        .map(|i| {
            let t = f64::from(i);
            let kind = if i % 2 == 0 { Kind::Vehicle } else { Kind::Blob };
            let mut view = View::looking_down([0.6 + 0.01 * t, 0.02 * t, 0.5 + 0.05 * t], 0.3 * t, kind);
            view.camera_rotation = product(view.camera_rotation, about(0, 0.05 * t));
            view.target_position = [0.63, 0.02 * t];
            view.target_heading = t;
            view.frame = i as u64 + 40;
            view
        })
        .collect()
}

fn hash_of(scene: &mut Scene, view: &View) -> u64 {
    let mut pixels = vec![0; 512 * 512];
    scene.render(view, &mut pixels, 512).unwrap();
    hash(&pixels)
}

#[test]
fn frames_repeat_whatever_was_rendered_before() {
    let mut scene = Scene::new(&SceneParameters::default());
    let forward: Vec<u64> = views().iter().map(|view| hash_of(&mut scene, view)).collect();
    let mut backward: Vec<u64> = views().iter().rev().map(|view| hash_of(&mut scene, view)).collect();
    backward.reverse();
    assert_eq!(forward, backward);
    let mut another = Scene::new(&SceneParameters::default());
    assert_eq!(hash_of(&mut another, &views()[4]), forward[4]);
    let mut other_seed = Scene::new(&SceneParameters { seed: 2, ..Default::default() });
    assert_ne!(hash_of(&mut other_seed, &views()[4]), forward[4]);
}

#[test]
fn noise_depends_on_frame_and_row_and_not_on_the_view() {
    // without contrast both views see nothing but noise on one grey
    let mut scene = Scene::new(&SceneParameters { contrast_sd: 0.0, ..Default::default() });
    let here = View::looking_down([0.6, 0.0, 0.5], 0.0, Kind::Vehicle);
    let there =
        View { frame: here.frame, time_ns: 77, ..View::looking_down([0.1, 0.7, 0.4], 2.0, Kind::Vehicle) };
    assert_eq!(hash_of(&mut scene, &here), hash_of(&mut scene, &there));
    assert_ne!(hash_of(&mut scene, &here), hash_of(&mut scene, &View { frame: 1, ..here }));
}

#[test]
fn stride_leaves_the_bytes_between_rows_alone() {
    let parameters = SceneParameters { width: 100, height: 60, ..Default::default() };
    let mut scene = Scene::new(&parameters);
    let view = views()[0];
    let (mut tight, mut wide) = (vec![0; 6000], vec![7; 59 * 128 + 100]);
    scene.render(&view, &mut tight, 100).unwrap();
    scene.render(&view, &mut wide, 128).unwrap();
    for y in 0..60 {
        assert_eq!(tight[y * 100..(y + 1) * 100], wide[y * 128..y * 128 + 100], "row {y}");
        assert!(wide.iter().skip(y * 128 + 100).take(28).all(|&b| b == 7), "behind row {y}");
    }
    let needed = wide.len();
    wide.pop();
    let error = scene.render(&view, &mut wide, 128).unwrap_err();
    assert_eq!(error, ViewError::BufferTooSmall { given: needed - 1, needed });
    assert_eq!(
        scene.render(&view, &mut tight, 99),
        Err(ViewError::StrideTooSmall { stride: 99, width: 100 })
    );
}

#[test]
fn lighting_changes_what_follows_and_bad_lighting_changes_nothing() {
    let mut scene = Scene::new(&SceneParameters::default());
    let view = views()[0];
    let bright = hash_of(&mut scene, &view);
    assert!(scene.set_lighting(Lighting { gain: f64::NAN, ..Default::default() }).is_err());
    assert_eq!(hash_of(&mut scene, &view), bright);
    scene.set_lighting(Lighting { gain: 0.5, ..Default::default() }).unwrap();
    assert_ne!(hash_of(&mut scene, &view), bright);
    scene.set_lighting(Lighting::default()).unwrap();
    assert_eq!(hash_of(&mut scene, &view), bright);
}
