//! Whole runs of real processes: what a run reports, and that it is the same whoever was killed in it.

mod support;

use std::path::PathBuf;

use rustix::process::Signal;
use serde_json::Value;
use support::{Place, System, json, kill, pid_of, wait_for};

const FRAMES: &str = "40";

/// A short run with the given arguments; its report.
fn report(place: &Place, more: &[&str]) -> Value {
    let file = place.file("report.json");
    let name = file.display().to_string();
    let mut arguments = vec!["--frames", FRAMES, "--json", name.as_str()];
    arguments.extend(more);
    let (status, _) = place.up(&arguments).end();
    assert!(status.success(), "{status}\n{}", place.log());
    json(&file)
}

#[test]
fn a_run_ends_by_itself_and_reports_what_it_did() {
    let place = Place::new();
    let report = report(&place, &["--seed", "3"]);
    assert_eq!(report["seed"], 3);
    assert!(report["frames"].as_u64().is_some_and(|frames| frames > 40), "{report}");
    let moves = report["learning"]["moves"].as_array().expect("moves");
    assert_eq!(moves.len(), 4);
    assert!(moves.iter().all(|m| m["error_cm"].as_f64().is_some_and(|e| e > 0.0 && e.is_finite())));
    let tracking = &report["tracking"];
    for key in ["median_cm", "rms_cm", "max_cm", "detected_share"] {
        assert!(tracking[key].as_f64().is_some_and(f64::is_finite), "tracking.{key} in {report}");
    }
    for hop in ["acquisition", "vision", "segmentation", "learner", "arm-driver", "end_to_end"] {
        let latency = &report["latency_us"][hop];
        let (p50, p99) = (latency["p50"].as_f64(), latency["p99"].as_f64());
        assert!(p50 > Some(0.0) && p99 >= p50, "latency_us.{hop} in {report}");
    }
    assert_eq!(report["restarts"], 0);
    assert!(report["rate_hz"].as_f64() > Some(0.0));
    assert_eq!(report["trajectory_sha256"].as_str().map(str::len), Some(64));
    place.assert_nothing_left();
}

#[test]
fn one_seed_gives_one_trajectory_and_another_seed_another() {
    let (one, again, other) = (Place::new(), Place::new(), Place::new());
    let hash = |report: &Value| report["trajectory_sha256"].as_str().expect("a hash").to_owned();
    let first = hash(&report(&one, &["--seed", "5"]));
    assert_eq!(first, hash(&report(&again, &["--seed", "5"])));
    assert_ne!(first, hash(&report(&other, &["--seed", "6"])));
}

#[test]
fn what_was_learnt_outlives_the_run_where_it_is_kept() {
    let place = Place::new();
    let keep = place.file("kept");
    let set = format!("learner.keep={:?}", keep.display().to_string());
    let first = report(&place, &["--seed", "3", "--set", &set]);
    assert_eq!(first["learning"]["moves"].as_array().map(Vec::len), Some(4));
    let told = json(&keep.join("learner.json"));
    assert_eq!(told["moves"], 4, "{told}");
    assert!(told["weights"].as_array().is_some_and(|weights| weights.len() > 20), "{told}");
    // The next run goes on from there, and needs no training.
    let second = report(&place, &["--seed", "4", "--set", &set]);
    // One at most: the simulator sees the moves of before as one that ended.
    assert!(second["learning"]["moves"].as_array().is_some_and(|moves| moves.len() <= 1), "{}", place.log());
    assert!(second["tracking"]["frames"].as_u64() > Some(10), "{second}");
    // With other parameters it is not used, and not lost.
    let third = report(&place, &["--seed", "5", "--set", &set, "--set", "learner.eta=0.2"]);
    assert_eq!(third["learning"]["moves"].as_array().map(Vec::len), Some(4), "{}", place.log());
    assert!(keep.join("learner.state.refused").exists());
}

#[test]
fn one_process_gives_the_same_trajectory_as_six() {
    let place = Place::new();
    let processes = report(&place, &["--seed", "7"]);
    assert_eq!(one_process(&place, &[]), processes["trajectory_sha256"]);
}

/// The cell changes in training, and all that disturbs a camera is on.
#[test]
fn a_disturbed_run_is_the_same_in_one_process_as_in_six() {
    let disturbed: Vec<String> = [
        "change.when=move",
        "change.after=2",
        "change.mount_deg=20",
        "change.focal_factor=1.2",
        "change.forearm_factor=1.1",
        "simulator.glare_share=0.1",
        "camera.clock_offset_ms=-7",
    ]
    .iter()
    .flat_map(|set| ["--set".to_owned(), (*set).to_owned()])
    .collect();
    let more: Vec<&str> = ["--seed", "7"].into_iter().chain(disturbed.iter().map(String::as_str)).collect();
    let place = Place::new();
    let processes = report(&place, &more);
    assert_eq!(one_process(&place, &more[2..]), processes["trajectory_sha256"]);
    let calm = Place::new();
    assert_ne!(one_process(&calm, &[]), processes["trajectory_sha256"]);
}

/// The trajectory's hash of the run with seed 7 in one process.
fn one_process(place: &Place, more: &[&str]) -> Value {
    let file = place.file("experiment.json");
    let output = support::pursuit()
        .args(["experiment", "learning", "--schemes", "recommended", "--seeds", "1", "--first-seed", "7"])
        .args(["--set", "learner.training_moves=4", "--set", &format!("simulator.frames={FRAMES}")])
        .args(["--set", "camera.rate_hz=12.5"])
        .args(more)
        .arg("--json")
        .arg(&file)
        .arg("--plots")
        .arg(place.file("plots"))
        .output()
        .expect("pursuit experiment runs");
    assert!(output.status.success(), "{}", support::text(&output).1);
    json(&file)["schemes"][0]["trajectory_sha256"][0].clone()
}

/// A run with seed 9 that lasts as long as in reality, and the file that its report will be in.
fn run_to_disturb(place: &Place) -> (System<'_>, PathBuf) {
    let file = place.file("report.json");
    let name = file.display().to_string();
    let arguments = ["--frames", FRAMES, "--seed", "9", "--set", "run.pace=real", "--json", &name];
    (place.up(&arguments), file)
}

/// Kills one service with SIGKILL in training and again in tracking; the trajectory must be that of an
/// undisturbed run, to the bit.
fn survives_the_death_of(service: &str) {
    let calm = Place::new();
    let expected = report(&calm, &["--seed", "9"]);

    let place = Place::new();
    let (mut system, file) = run_to_disturb(&place);
    let services = system.wait_until_running();
    system.wait_for_phase(0);
    let first = pid_of(&services, service);
    kill(first, Signal::KILL);
    let services = system.wait_until_replaced(service, first);
    system.wait_for_phase(2);
    kill(pid_of(&services, service), Signal::KILL);
    let (status, _) = system.end();
    assert!(status.success(), "{status}\n{}", place.log());
    let report = json(&file);
    assert_eq!(report["restarts"], 2, "{report}");
    assert_eq!(report["trajectory_sha256"], expected["trajectory_sha256"], "{}", place.log());
    assert_eq!(report["learning"], expected["learning"]);
    place.assert_nothing_left();
}

/// Five deaths of each service, one after the other: the trajectory is that of an undisturbed run, to the bit.
#[test]
fn thirty_deaths_change_nothing() {
    const LONG: &str = "400";
    let calm = Place::new();
    let file = calm.file("report.json");
    let arguments = |frames, file: &PathBuf, pace: &str| {
        let file = file.display().to_string();
        let pace = format!("run.pace={pace}");
        ["--frames", frames, "--seed", "11", "--set", &pace, "--json", &file].map(str::to_owned)
    };
    let run = |place: &Place, arguments: &[String]| {
        let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
        let mut system = place.up(&arguments);
        assert!(system.end().0.success(), "{}", place.log());
    };
    run(&calm, &arguments(LONG, &file, "free"));
    let expected = json(&file);

    let place = Place::new();
    let file = place.file("report.json");
    let arguments = arguments(LONG, &file, "real");
    let mut system = place.up(&arguments.iter().map(String::as_str).collect::<Vec<_>>());
    system.wait_until_running();
    let frames = || {
        let journal = std::fs::read_to_string(place.run_dir().join("journal.csv")).unwrap_or_default();
        journal.lines().count()
    };
    for _ in 0..5 {
        for service in ["simulator", "acquisition", "vision", "segmentation", "learner", "arm-driver"] {
            let services = place.status().expect("it runs");
            let pid = pid_of(&services, service);
            kill(pid, Signal::KILL);
            system.wait_until_replaced(service, pid);
            // So much that none dies five times in ten seconds: it would be given up, as it should.
            let seen = frames();
            wait_for(|| (frames() >= seen + 10).then_some(())).expect("the run goes on");
        }
    }
    let (status, _) = system.end();
    assert!(status.success(), "{status}\n{}", place.log());
    let report = json(&file);
    assert_eq!(report["restarts"], 30, "{report}");
    assert_eq!(report["trajectory_sha256"], expected["trajectory_sha256"], "{}", place.log());
    place.assert_nothing_left();
}

#[test]
fn a_vision_that_hangs_is_replaced_and_changes_nothing() {
    let calm = Place::new();
    let expected = report(&calm, &["--seed", "9"]);
    let place = Place::new();
    let (mut system, file) = run_to_disturb(&place);
    system.wait_until_running();
    system.wait_for_phase(2);
    let services = place.status().expect("it runs");
    let pid = pid_of(&services, "vision");
    kill(pid, Signal::STOP);
    system.wait_until_replaced("vision", pid);
    let (status, _) = system.end();
    assert!(status.success(), "{status}\n{}", place.log());
    let report = json(&file);
    assert_eq!(report["restarts"], 1, "{report}");
    assert_eq!(report["trajectory_sha256"], expected["trajectory_sha256"], "{}", place.log());
}

#[test]
fn a_killed_acquisition_changes_nothing() {
    survives_the_death_of("acquisition");
}

#[test]
fn a_killed_vision_changes_nothing() {
    survives_the_death_of("vision");
}

#[test]
fn a_killed_segmentation_changes_nothing() {
    survives_the_death_of("segmentation");
}

#[test]
fn a_killed_learner_changes_nothing() {
    survives_the_death_of("learner");
}

#[test]
fn a_killed_arm_driver_changes_nothing() {
    survives_the_death_of("arm-driver");
}

#[test]
fn a_killed_simulator_changes_nothing() {
    survives_the_death_of("simulator");
}
