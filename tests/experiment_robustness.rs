//! `pursuit experiment robustness` and `ablation` as a process: what they write, and that it is about detectors.

mod support;

use serde_json::Value;
use std::path::Path;
use support::{Place, json, text};

/// The smallest run that has a target, and a run without.
const SMALL: [&str; 6] = ["--seeds", "1", "--sizes", "256", "--scenes", "pan,empty_pan"];

fn experiment(place: &Place, name: &str, more: &[&str]) -> Value {
    let file = place.file("experiment.json");
    std::fs::create_dir_all(place.file("")).expect("a folder for files");
    let mut command = support::pursuit();
    command.args(["experiment", name]).args(SMALL).args(more);
    command.arg("--json").arg(&file).arg("--plots").arg(place.file("plots"));
    let output = command.output().expect("pursuit experiment runs");
    assert!(output.status.success(), "{}", text(&output).1);
    json(&file)
}

fn scene<'a>(results: &'a Value, name: &str, mode: &str) -> &'a Value {
    let scenes = results["scenes"].as_array().expect("scenes");
    scenes.iter().find(|s| s["name"] == name && s["mode"] == mode).expect("the scene in this mode")
}

#[test]
fn robustness_tells_the_detectors_apart_and_writes_what_they_saw() {
    let place = Place::new();
    let frames = place.file("frames");
    let results = experiment(&place, "robustness", &["--frames", &frames.display().to_string()]);

    let (robust, literal) = (scene(&results, "pan", "robust"), scene(&results, "pan", "paper literal"));
    assert_eq!(
        (&robust["size"], &robust["has_target"], &robust["pairs"]),
        (&256.into(), &true.into(), &19.into())
    );
    assert!(robust["detected"].as_f64() > Some(0.9), "{robust}");
    assert!(robust["error_px"].as_f64() < literal["error_px"].as_f64(), "{robust} {literal}");
    assert!(robust["velocity_error_px"].as_f64() < Some(0.5), "{robust}");
    assert_eq!(robust["false_alarms"], Value::Null);
    // The paper's method reports a target wherever it looks.
    assert_eq!(scene(&results, "empty_pan", "paper literal")["false_alarms"], 1.0);
    assert_eq!(scene(&results, "empty_pan", "robust")["detected"], Value::Null);

    for mode in ["paper literal", "paper", "robust"] {
        for total in [&results["total"][mode], &results["total"][mode]["sizes"]["256"]] {
            for key in ["detected", "wrong", "false_alarms", "error_px", "velocity_error_px", "us_per_frame"]
            {
                assert!(total[key].as_f64().is_some_and(f64::is_finite), "{mode}: {key} in {total}");
            }
        }
    }
    assert!(place.file("plots").join("experiment-robustness.svg").exists());
    the_frames_are_those_of_the_truth(&frames.join("pan-256"), 20);
    the_frames_are_those_of_the_truth(&frames.join("empty_pan-256"), 11);
}

fn the_frames_are_those_of_the_truth(folder: &Path, count: usize) {
    let truth = json(&folder.join("truth.json"));
    let frames = truth["frames"].as_array().expect("frames");
    assert_eq!((frames.len(), &truth["size"]), (count, &256.into()));
    let last = folder.join(format!("f{:04}.png", count - 1));
    assert!(last.exists() && !folder.join(format!("f{count:04}.png")).exists());
    let has_target = truth["name"] == "pan";
    assert!(frames.iter().all(|frame| frame["position"].is_array() == has_target), "{truth}");
}

#[test]
fn ablation_shows_what_the_competition_of_motions_is_good_for() {
    let place = Place::new();
    let results = experiment(&place, "ablation", &[]);
    let variants = results["variants"].as_array().expect("variants");
    let error = |name: &str| {
        let variant = variants.iter().find(|v| v["name"] == name).expect("the variant");
        assert!(variant["by_evidence"]["detected"].as_f64() > Some(0.9), "{variant}");
        variant["velocity_error_px"].as_f64().expect("a velocity error")
    };
    assert!(error("full") < error("no competition"), "{results}");
}

#[test]
fn an_option_of_another_experiment_or_an_unknown_scenario_is_refused() {
    for (arguments, word) in [
        (["robustness", "--scenes", "pam"], "fast_pan"),
        (["robustness", "--set", "camera.rate_hz=25.0"], "--set"),
        (["robustness", "--sizes", "20"], "64 to 4096"),
        (["learning", "--scenes", "pan"], "--scenes"),
    ] {
        let output = support::pursuit().arg("experiment").args(arguments).output().expect("it runs");
        assert!(!output.status.success(), "{arguments:?}");
        assert!(text(&output).1.contains(word), "{arguments:?}: {}", text(&output).1);
    }
}
