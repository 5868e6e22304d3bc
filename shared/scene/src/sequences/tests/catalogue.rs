use std::collections::BTreeSet;

use super::*;

#[test]
fn same_seed_gives_the_same_bytes_in_whatever_order_and_another_seed_gives_others() {
    let scenario = with_target().into_iter().find(|s| s.name == "combined").unwrap();
    let scenario = Scenario { jitter_px: 2.0, flicker: 0.1, uneven_flicker: 0.1, ..scenario };
    let mut one = Sequence::new(&scenario, 64, 9).unwrap();
    let forward: Vec<Vec<f64>> = (0..one.frames()).map(|t| frame_of(&mut one, t)).collect();
    let mut other = Sequence::new(&scenario, 64, 9).unwrap();
    for t in (0..other.frames()).rev() {
        assert_eq!(other.truth(t), one.truth(t));
        assert_eq!(frame_of(&mut other, t), forward[t], "frame {t}");
    }
    assert_ne!(frame(&scenario, 64, 10, 5), forward[5]);
}

#[test]
fn lists_are_complete_and_no_name_comes_twice() {
    let (with, without, hard) = (with_target(), without_target(), hard());
    assert_eq!(with.len(), 31);
    assert_eq!((without.len(), hard.len()), (24, 25));
    assert!(with.iter().chain(&hard).all(|s| s.target.is_some()));
    assert!(without.iter().all(|s| s.target.is_none()));
    let names: BTreeSet<&str> = with.iter().chain(&without).chain(&hard).map(|s| s.name).collect();
    assert_eq!(names.len(), 31 + 24 + 25);
}

fn check_all(scenarios: &[Scenario], size: usize) {
    for scenario in scenarios {
        let mut sequence = Sequence::new(scenario, size, 1).unwrap();
        let middle = scenario.middle();
        let first = frame_of(&mut sequence, 0);
        let at_middle = frame_of(&mut sequence, middle);
        frame_of(&mut sequence, scenario.frames - 1);
        assert_ne!(first, at_middle, "{} at {size}", scenario.name);
        let truth = sequence.truth(middle);
        let Some(spec) = &scenario.target else {
            assert_eq!((truth.position, truth.centre, truth.area_px), (None, None, 0.0));
            continue;
        };
        let reach = 0.6 * spec.side_px * size as f64 / 512.0;
        let inside = |c: f64| c >= reach && c <= size as f64 - 1.0 - reach;
        assert!(truth.centre.unwrap().into_iter().all(inside), "{} at {size}: {truth:?}", scenario.name);
        let hidden = scenario.occluder.is_some_and(|(from, to)| (from..to).contains(&middle));
        assert_eq!(truth.position.is_none(), hidden, "{} at {size}: {truth:?}", scenario.name);
    }
}

#[test]
fn every_scenario_renders_at_256_px_with_its_target_inside_at_mid_sequence() {
    check_all(&with_target(), 256);
    check_all(&hard(), 256);
}

#[test]
fn every_scenario_renders_at_64_px_with_its_target_inside_at_mid_sequence() {
    check_all(&with_target(), 64);
    check_all(&hard(), 64);
}

#[test]
fn scenarios_without_target_have_none() {
    let standing = |s: &Scenario| s.name == "empty_static";
    check_all(&without_target(), 64);
    assert_eq!(without_target().iter().filter(|s| standing(s)).count(), 1);
}

#[test]
fn targets_of_scenarios_are_in_the_picture_in_at_least_six_frames_in_a_row_at_512_px() {
    for scenario in with_target().iter().chain(&hard()) {
        // the paths do not depend on the texture, and this one is quick to make
        let scenario = Scenario { texture: Texture::Checker, ..scenario.clone() };
        let sequence = Sequence::new(&scenario, 512, 0).unwrap();
        let (mut run, mut longest) = (0, 0);
        for t in 0..sequence.frames() {
            run = if sequence.truth(t).visible_share > 0.9 { run + 1 } else { 0 };
            longest = longest.max(run);
        }
        assert!(longest >= 6, "{}: {longest}", scenario.name);
    }
}

#[test]
fn nonsense_is_refused_by_name() {
    let refused = |scenario: Scenario, size: usize| Sequence::new(&scenario, size, 1).err().unwrap().name;
    let base = Scenario::default;
    let target = |spec: TargetSpec| Scenario { target: Some(spec), ..base() };
    assert_eq!(refused(base(), 63), "size");
    assert_eq!(refused(base(), 4097), "size");
    assert_eq!(refused(Scenario { frames: 0, ..base() }, 64), "frames");
    assert_eq!(refused(Scenario { pan: [0.0, f64::NAN], ..base() }, 64), "pan in y");
    assert_eq!(refused(Scenario { noise: -1.0, ..base() }, 64), "noise");
    assert_eq!(refused(Scenario { zoom: 0.2, ..base() }, 64), "zoom at an end of the sequence");
    assert_eq!(
        refused(Scenario { slant: 1e-3, ..base() }, 64),
        "slant at the border at an end of the sequence"
    );
    let texture = Texture::Noise(f64::INFINITY);
    assert_eq!(refused(Scenario { texture, ..base() }, 64), "exponent of the noise texture");
    assert_eq!(refused(Scenario { occluder: Some((5, 21)), ..base() }, 64), "end of occluder");
    let blind = Scenario { occluder: Some((5, 9)), target: None, ..base() };
    assert_eq!(refused(blind, 64), "speed of a target with an occluder");
    let spec = TargetSpec { side_px: f64::NAN, ..TargetSpec::default() };
    assert_eq!(refused(target(spec), 64), "target.side_px");
    let spec = TargetSpec { rest: Some((7, 7)), ..TargetSpec::default() };
    assert_eq!(refused(target(spec), 64), "end of target.rest");
    assert_eq!(Photograph::new(20, 20, vec![0; 399]).unwrap_err().name, "number of a photograph's pixels");
    assert_eq!(Photograph::new(8, 20, vec![0; 160]).unwrap_err().name, "photograph width");
}

#[test]
fn smallest_and_odd_frames_render() {
    for size in [64, 65, 257, 1023] {
        let mut sequence = Sequence::new(&Scenario::default(), size, 1).unwrap();
        let (mean, deviation) = mean_and_deviation(&frame_of(&mut sequence, 3));
        assert!((mean - 120.0).abs() < 25.0 && (20.0..50.0).contains(&deviation), "{mean}, {deviation}");
    }
}
