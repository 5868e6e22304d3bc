//! Planned restarts, upgrades, hung services, and a supervisor that dies: who takes over from whom.

mod support;

use rustix::process::Signal;
use serde_json::Value;
use std::path::PathBuf;
use support::{Place, System, kill, pid_of, text, wait_for};

const SERVICES: [&str; 6] = ["simulator", "acquisition", "vision", "segmentation", "learner", "arm-driver"];
/// As a person watches it.
const REAL: [&str; 4] = ["--set", "run.pace=real", "--set", "observer.start=never"];

fn service<'a>(services: &'a [Value], name: &str) -> &'a Value {
    services.iter().find(|s| s["service"] == name).expect("the service is in the status")
}

fn pids(services: &[Value]) -> Vec<u32> {
    SERVICES.iter().map(|name| pid_of(services, name)).collect()
}

/// The program file that a process runs.
fn program_of(pid: u32) -> PathBuf {
    std::fs::read_link(format!("/proc/{pid}/exe")).expect("the process lives")
}

fn end(mut system: System<'_>) {
    system.signal(Signal::TERM);
    assert!(system.end().0.success());
    system.place.assert_nothing_left();
}

#[test]
fn every_service_is_restarted_while_the_others_go_on() {
    let place = Place::new();
    let mut system = place.up(&REAL);
    let before = system.wait_until_running();
    for name in SERVICES {
        let output = place.command(&["restart", name]).output().expect("pursuit restart runs");
        assert!(output.status.success(), "{name}: {}\n{}", text(&output).1, place.log());
    }
    // The answer comes when the new process is the service.
    let after = system.wait_until_running();
    for name in SERVICES {
        assert_ne!(pid_of(&before, name), pid_of(&after, name));
        assert_eq!(service(&after, name)["restarts"], 1, "{name}");
        assert_eq!(service(&after, name)["last_end"], Value::Null, "{name} was asked to end, and did");
    }
    end(system);
}

#[test]
fn an_upgrade_that_cannot_run_leaves_the_old_process() {
    let place = Place::new();
    let mut system = place.up(&REAL);
    let before = system.wait_until_running();
    for (program, complaint) in [("/bin/false", "old one stays"), ("/no/such/file", "No such file")] {
        let output = place.command(&["restart", "vision", "--program", program]).output().expect("it runs");
        assert_eq!(output.status.code(), Some(1));
        assert!(text(&output).1.contains(complaint), "{}", text(&output).1);
    }
    let after = system.wait_until_running();
    assert_eq!(pids(&before), pids(&after));
    end(system);
}

#[test]
fn after_a_crash_the_same_build_is_started_also_when_its_file_was_replaced() {
    let place = Place::new();
    let mut system = place.up(&REAL);
    system.wait_until_running();
    std::fs::create_dir_all(place.file("")).expect("a folder");
    let upgrade = place.file("upgrade");
    std::fs::copy(env!("CARGO_BIN_EXE_pursuit"), &upgrade).expect("a copy of the program");
    let program = upgrade.display().to_string();
    let output = place.command(&["restart", "vision", "--program", &program]).output().expect("it runs");
    assert!(output.status.success(), "{}\n{}", text(&output).1, place.log());
    let upgraded = pid_of(&system.wait_until_running(), "vision");
    assert_eq!(program_of(upgraded), upgrade);
    // Another file takes its place, as a package manager does it.
    std::fs::write(place.file("new"), "#!/bin/false\n").expect("a file");
    std::fs::rename(place.file("new"), &upgrade).expect("it takes the place");
    kill(upgraded, Signal::KILL);
    let services = system.wait_until_replaced("vision", upgraded);
    let running = program_of(pid_of(&services, "vision")).display().to_string();
    assert!(running.starts_with(&program) && running.ends_with("(deleted)"), "{running}");
    assert_eq!(service(&services, "vision")["last_end"], "signal: 9 (SIGKILL)");
    end(system);
}

#[test]
fn a_stopped_service_is_found_and_replaced() {
    let place = Place::new();
    let mut system = place.up(&REAL);
    let before = system.wait_until_running();
    for name in ["vision", "learner", "arm-driver"] {
        let pid = pid_of(&before, name);
        kill(pid, Signal::STOP);
        let services = system.wait_until_replaced(name, pid);
        let end = service(&services, name)["last_end"].as_str().unwrap_or_default();
        assert!(end.contains("was stopped"), "{end}");
    }
    end(system);
}

#[test]
fn torn_memory_is_thrown_away_and_all_begin_anew() {
    let place = Place::new();
    let mut system = place.up(&REAL);
    let before = system.wait_until_running();
    // The memory of the frames: who touches it next gets a SIGBUS.
    let frames = place
        .shared_memory()
        .into_iter()
        .max_by_key(|object| std::fs::metadata(object).map_or(0, |metadata| metadata.len()));
    let frames = std::fs::File::options().write(true).open(frames.expect("there is shared memory"));
    frames.and_then(|file| file.set_len(0)).expect("it is ours");
    let anew = wait_for(|| {
        let services = place.status()?;
        let all_new = SERVICES.iter().all(|name| {
            let now = service(&services, name);
            now["state"] == "running" && now["pid"] != pid_of(&before, name)
        });
        all_new.then_some(services)
    });
    assert!(anew.is_some(), "{}", place.log());
    end(system);
}

#[test]
fn a_new_supervisor_adopts_what_the_dead_one_left_and_restarts_nobody() {
    let place = Place::new();
    let mut first = place.up(&REAL);
    let before = first.wait_until_running();
    first.signal(Signal::KILL);
    let _ = first.end();
    let mut second = place.up(&REAL);
    let after = second.wait_until_running();
    assert_eq!(pids(&before), pids(&after), "{}", place.log());
    assert!(after.iter().all(|s| s["adopted"] == true && s["restarts"] == 0), "{after:?}");
    // It looks after them as if they were its own.
    let vision = pid_of(&after, "vision");
    kill(vision, Signal::KILL);
    second.wait_until_replaced("vision", vision);
    let learner = pid_of(&after, "learner");
    assert!(place.command(&["restart", "learner"]).output().expect("it runs").status.success());
    second.wait_until_replaced("learner", learner);
    end(second);
}

#[test]
fn what_a_dead_supervisor_left_is_ended_before_another_config_runs() {
    let place = Place::new();
    let mut first = place.up(&REAL);
    let before = first.wait_until_running();
    first.signal(Signal::KILL);
    let _ = first.end();
    let mut second = place.up(&[&REAL[..], &["--set", "run.seed=7"]].concat());
    let after = second.wait_until_running();
    assert!(pids(&after).iter().all(|pid| !pids(&before).contains(pid)));
    assert!(after.iter().all(|s| s["adopted"] == false), "{after:?}");
    end(second);
}

#[test]
fn without_a_supervisor_all_end_when_their_lease_does() {
    let place = Place::new();
    let mut system = place.up(&[&REAL[..], &["--set", "run.lease_s=1"]].concat());
    system.wait_until_running();
    system.signal(Signal::KILL);
    let _ = system.end();
    assert!(wait_for(|| place.processes().is_empty().then_some(())).is_some(), "{:?}", place.processes());
    let log = place.log();
    assert!(log.contains("no supervisor any more"), "{log}");
}
