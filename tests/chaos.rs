//! A running system under random faults: what must hold holds, whatever happens.

mod support;

use serde_json::Value;
use std::process::Stdio;
use support::{Place, json};

fn chaos(seconds: &str, seed: &str) -> Value {
    let place = Place::new();
    let (figures, recording) = (place.file("figures.json"), place.file("run.mcap"));
    let mut command = place.command(&["chaos", "--seconds", seconds, "--seed", seed]);
    command.arg("--json").arg(&figures).arg("--record").arg(&recording);
    // Smaller images than usual: the recording shall not fill a disk.
    command.args(["--set", "camera.width=256", "--set", "camera.height=256"]);
    let output = command.stdin(Stdio::null()).output().expect("pursuit chaos runs");
    let (out, err) = support::text(&output);
    let log = std::fs::read_to_string(place.run_dir().with_extension("log")).unwrap_or_default();
    assert!(output.status.success(), "{out}\n{err}\n{log}");
    place.assert_nothing_left();
    json(&figures)
}

/// What a loaded machine cannot excuse.
fn assert_well(figures: &Value) {
    assert_eq!(figures["violations"], 0, "{figures}");
    assert_eq!(figures["lost_samples"], 0, "{figures}");
    assert_eq!(figures["leftover_files"], 0, "{figures}");
    assert_eq!(figures["false_kills"], 0, "{figures}");
}

#[test]
fn a_minute_of_faults_breaks_nothing() {
    let figures = chaos("60", "1");
    assert_well(&figures);
    assert!(figures["faults"].as_u64() >= Some(10), "{figures}");
    assert!(figures["frames"].as_u64() >= Some(300), "{figures}");
}

#[test]
#[ignore = "ten minutes: cargo test --release --test chaos -- --ignored --nocapture"]
fn ten_minutes_of_faults_break_nothing() {
    let figures = chaos("600", "2");
    println!("{figures:#}");
    assert_well(&figures);
    assert!(figures["faults"].as_u64() >= Some(150), "{figures}");
}
