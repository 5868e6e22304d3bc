//! Wrong configs are refused before anything starts, all faults at once.

mod support;

use support::{Place, pursuit, text};

#[test]
fn the_shipped_configs_are_right() {
    for folder in ["config", "config/scenarios"] {
        for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
            let path = entry.path();
            if path.extension().is_some_and(|e| e == "toml") {
                let output = pursuit().arg("check").arg(&path).output().expect("pursuit check runs");
                assert!(output.status.success(), "{}", text(&output).1);
            }
        }
    }
}

#[test]
fn all_faults_come_at_once_with_file_line_and_key_and_nothing_starts() {
    let place = Place::new();
    let file = place.file("bad.toml");
    std::fs::create_dir_all(place.directory.join("files")).expect("a folder");
    let good = std::fs::read_to_string("config/sim.toml").expect("the config");
    let bad = good
        .replace("rate_hz = 12.5", "rate_hz = 5000")
        .replace("passes = 3", "pases = 3")
        .replace("seed = 1", "seed = \"one\"")
        .replace("latency_ms = 80.0", "latency_ms = -1.0");
    std::fs::write(&file, bad).expect("a file");
    let name = file.display().to_string();
    let output = place.command(&["up", "--frames", "1", "--config", &name]).output().expect("runs");
    assert_eq!(output.status.code(), Some(64));
    let (_, errors) = text(&output);
    for key in ["camera.rate_hz", "vision.pases", "run.seed", "simulator.latency_ms"] {
        let line = errors.lines().find(|line| line.contains(key));
        let line = line.unwrap_or_else(|| panic!("{key} is missing in:\n{errors}"));
        assert!(line.contains("bad.toml:"), "{line}");
    }
    assert!(errors.contains("passes"), "a spelling is proposed: {errors}");
    assert!(!place.run_dir().join("journal.csv").exists(), "something was started");
    assert!(place.processes().is_empty());
}

#[test]
fn a_setting_of_the_command_line_is_checked_like_the_file() {
    let place = Place::new();
    let output = place.command(&["up", "--frames", "1", "--set", "camera.width=7"]).output().expect("runs");
    assert_eq!(output.status.code(), Some(64));
    let (_, errors) = text(&output);
    assert!(errors.contains("camera.width") && errors.contains("--set"), "{errors}");
}

#[test]
fn a_missing_file_is_named() {
    let output = pursuit().args(["up", "--config", "no/such.toml"]).output().expect("runs");
    assert_eq!(output.status.code(), Some(64));
    assert!(text(&output).1.contains("no/such.toml"));
}
