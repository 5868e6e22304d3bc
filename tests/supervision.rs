//! Start, stop, restart: what an operator does, and that nothing is ever left behind.

mod support;

use rustix::process::Signal;
use serde_json::Value;
use std::time::Duration;
use support::{Place, kill, pid_of, text, wait_for};

/// Rounds of start and stop; each takes a second or two.
const ROUNDS: u64 = 6;

#[test]
fn nothing_is_left_after_a_stop_at_any_moment() {
    for round in 0..ROUNDS {
        let place = Place::new();
        let mut system = place.up(&[]);
        // From the begin of the start to the middle of the run, by either signal; not before the program
        // is far enough to have anything to leave behind.
        let locked = wait_for(|| place.run_dir().join("lock").exists().then_some(()));
        assert!(locked.is_some(), "{}", place.log());
        std::thread::sleep(Duration::from_millis(173 * round));
        system.signal(if round % 2 == 0 { Signal::INT } else { Signal::TERM });
        let (status, _) = system.end();
        assert!(status.success(), "round {round}: {status}\n{}", place.log());
        place.assert_nothing_left();
    }
}

#[test]
fn services_end_by_themselves_when_their_supervisor_is_killed() {
    let place = Place::new();
    let mut system = place.up(&[]);
    system.wait_until_running();
    system.signal(Signal::KILL);
    let _ = system.end();
    assert!(wait_for(|| place.processes().is_empty().then_some(())).is_some(), "{:?}", place.processes());
    // The next start sweeps what the killed one left.
    let mut next = place.up(&[]);
    next.wait_until_running();
    next.signal(Signal::TERM);
    assert!(next.end().0.success());
    place.assert_nothing_left();
}

#[test]
fn down_ends_everything() {
    let place = Place::new();
    let mut system = place.up(&[]);
    system.wait_until_running();
    let output = place.command(&["down"]).output().expect("pursuit down runs");
    assert!(output.status.success(), "{}", text(&output).1);
    assert!(system.end().0.success());
    place.assert_nothing_left();
}

#[test]
fn a_second_supervisor_is_refused_and_names_the_first() {
    let place = Place::new();
    let mut system = place.up(&[]);
    system.wait_until_running();
    let output = place.command(&["up"]).output().expect("pursuit up runs");
    assert_eq!(output.status.code(), Some(75));
    let (_, errors) = text(&output);
    assert!(errors.contains(&system.child.id().to_string()), "{errors}");
    assert!(place.status().is_some(), "the first one goes on");
    system.signal(Signal::TERM);
    assert!(system.end().0.success());
}

#[test]
fn restart_gives_a_service_a_new_process_and_counts_it() {
    let place = Place::new();
    let mut system = place.up(&[]);
    let before = system.wait_until_running();
    let output = place.command(&["restart", "vision"]).output().expect("pursuit restart runs");
    assert!(output.status.success(), "{}", text(&output).1);
    let after = wait_for(|| {
        let services = place.status()?;
        let vision = services.iter().find(|s| s["service"] == "vision")?;
        (vision["state"] == "running" && vision["restarts"] == 1).then_some(services)
    });
    let after = after.unwrap_or_else(|| panic!("vision did not come back\n{}", place.log()));
    assert_ne!(pid_of(&before, "vision"), pid_of(&after, "vision"));
    assert_eq!(pid_of(&before, "learner"), pid_of(&after, "learner"), "nobody else was touched");
    for key in ["service", "pid", "state", "restarts", "last_beat_ms"] {
        assert!(after.iter().all(|s| s.get(key).is_some()), "status has no {key}");
    }
    let output = place.command(&["restart", "visoin"]).output().expect("pursuit restart runs");
    assert_eq!(output.status.code(), Some(1));
    assert!(text(&output).1.contains("vision"), "{}", text(&output).1);
    system.signal(Signal::INT);
    assert!(system.end().0.success());
}

#[test]
fn a_service_that_dies_again_and_again_is_given_up_and_the_others_go_on() {
    let place = Place::new();
    let mut system = place.up(&[]);
    system.wait_until_running();
    let given_up = wait_for(|| {
        let services = place.status()?;
        let vision = services.iter().find(|s| s["service"] == "vision")?;
        if let Some(pid) = vision["pid"].as_u64() {
            kill(pid as u32, Signal::KILL);
        }
        (vision["state"] == "given-up").then_some(services)
    });
    let services = given_up.unwrap_or_else(|| panic!("never given up\n{}", place.log()));
    assert!(services.iter().filter(|s| s["state"] == "running").count() >= 5, "{services:?}");
    // An operator can have it back.
    assert!(place.command(&["restart", "vision"]).output().expect("runs").status.success());
    system.wait_until_running();
    system.signal(Signal::TERM);
    assert!(system.end().0.success());
    place.assert_nothing_left();
}

#[test]
fn doctor_tells_what_a_killed_run_left_and_what_becomes_of_it() {
    let place = Place::new();
    let left = |place: &Place| {
        let output = place.command(&["doctor", "--json"]).output().expect("pursuit doctor runs");
        let findings: Vec<Value> = serde_json::from_slice(&output.stdout).expect("JSON");
        let left = findings.iter().find(|finding| finding["what"] == "leftovers").expect("it looks");
        (
            left["grade"].as_str().expect("a word").to_owned(),
            left["found"].as_str().expect("words").to_owned(),
        )
    };
    assert_eq!(left(&place).0, "ok");
    let mut system = place.up(&["--set", "run.lease_s=1"]);
    system.wait_until_running();
    assert_eq!(left(&place), ("ok".to_owned(), "none: it runs".to_owned()));
    system.signal(Signal::KILL);
    let _ = system.end();
    assert!(wait_for(|| place.processes().is_empty().then_some(())).is_some());
    let (grade, found) = left(&place);
    // The supervisor itself could not take away what it had.
    assert!(grade == "warn" && found.contains("shared memory"), "{grade}: {found}");
    let mut next = place.up(&[]);
    next.wait_until_running();
    next.signal(Signal::TERM);
    assert!(next.end().0.success());
    assert_eq!(left(&place).0, "ok");
}

#[test]
fn status_of_nothing_says_how_to_start() {
    let place = Place::new();
    let output = place.command(&["status"]).output().expect("pursuit status runs");
    assert_eq!(output.status.code(), Some(1));
    assert!(text(&output).1.contains("pursuit up"), "{}", text(&output).1);
}

#[test]
fn a_camera_folder_that_vanishes_is_reported_and_the_arm_holds() {
    let place = Place::new();
    let folder = place.file("images");
    std::fs::create_dir_all(&folder).expect("a folder");
    for number in 0..3 {
        let pgm = [b"P5 64 64 255\n".as_slice(), &[number * 40; 64 * 64]].concat();
        std::fs::write(folder.join(format!("f{number}.pgm")), pgm).expect("an image");
    }
    let source = format!("acquisition.folder={}", folder.display());
    let wall = ["run.clock=wall", "acquisition.source=files", "acquisition.repeat=true", &source];
    let mut arguments: Vec<&str> = wall.iter().flat_map(|set| ["--set", set]).collect();
    arguments.extend(["--set", "camera.width=64", "--set", "camera.height=64"]);
    let mut system = place.up(&arguments);
    system.wait_until_running();
    std::fs::remove_dir_all(&folder).expect("the folder goes");
    let state_of_camera = |wanted: &str| {
        wait_for(|| {
            let services = place.status()?;
            services.iter().any(|s| s["service"] == "acquisition" && s["state"] == wanted).then_some(services)
        })
    };
    let services = state_of_camera("no-input").unwrap_or_else(|| panic!("not reported\n{}", place.log()));
    assert!(
        services.iter().all(|s| s["restarts"] == 0),
        "a missing camera is no reason to restart: {services:?}"
    );
    // Without frames the last set-point grows old: the driver refuses it as stale (refusal 3).
    let refused = wait_for(|| {
        let text = std::fs::read_to_string(place.run_dir().join("journal.csv")).ok()?;
        let refusal = text.lines().last()?.split(',').nth(5)?.parse::<u32>().ok()?;
        (refusal == 3).then_some(refusal)
    });
    assert!(refused.is_some(), "the arm does not hold");
    system.signal(Signal::TERM);
    assert!(system.end().0.success());
    place.assert_nothing_left();
}
