//! What systemd is told, by a socket that plays it.

mod support;

use rustix::process::Signal;
use std::os::unix::net::UnixDatagram;
use std::time::Duration;
use support::{LIMIT, Place, wait_for};

/// The words that came until `wanted` was among them; each with what came before it.
fn heard_until(socket: &UnixDatagram, wanted: &str) -> Vec<String> {
    let mut heard = Vec::new();
    let found = wait_for(|| {
        let mut text = [0u8; 4096];
        let length = socket.recv(&mut text).ok()?;
        heard.extend(String::from_utf8_lossy(&text[..length]).lines().map(str::to_owned));
        heard.iter().any(|line| line.starts_with(wanted)).then_some(())
    });
    assert!(found.is_some(), "{wanted} was never said, but {heard:?}");
    heard
}

fn socket(place: &Place) -> (UnixDatagram, String) {
    std::fs::create_dir_all(place.file("")).expect("a folder");
    let path = place.file("notify");
    let socket = UnixDatagram::bind(&path).expect("a socket");
    socket.set_read_timeout(Some(Duration::from_millis(200))).expect("a limit");
    (socket, path.display().to_string())
}

#[test]
fn the_supervisor_is_ready_when_all_run_and_then_gives_signs_of_life() {
    let place = Place::new();
    let (socket, path) = socket(&place);
    let mut command = place.command(&["up", "--set", "run.pace=real", "--set", "observer.start=never"]);
    command.env("NOTIFY_SOCKET", &path).env("WATCHDOG_USEC", "900000");
    let mut child = command.stderr(std::process::Stdio::null()).spawn().expect("pursuit up starts");
    let heard = heard_until(&socket, "READY=1");
    assert!(heard.iter().any(|line| line.starts_with("STATUS=")), "{heard:?}");
    let services = place.status().expect("it is ready, so it answers");
    assert!(services.iter().all(|s| s["state"] == "running"), "ready before all run: {services:?}");
    for _ in 0..3 {
        heard_until(&socket, "WATCHDOG=1");
    }
    support::kill(child.id(), Signal::TERM);
    heard_until(&socket, "STOPPING=1");
    assert!(child.wait().expect("it is ours").success());
    place.assert_nothing_left();
}

#[test]
fn a_service_on_its_own_tells_it_too() {
    let place = Place::new();
    let (socket, path) = socket(&place);
    let run = place.run_dir();
    let mut builder = std::fs::DirBuilder::new();
    std::os::unix::fs::DirBuilderExt::mode(&mut builder, 0o700);
    builder.create(&run).expect("a run-time directory");
    let config = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("config/sim.toml");
    std::fs::copy(config, run.join("config.toml")).expect("a config");
    let mut command = place.command(&["run", "vision"]);
    command.env("NOTIFY_SOCKET", &path).env("WATCHDOG_USEC", "900000");
    let mut child = command.stderr(std::process::Stdio::null()).spawn().expect("pursuit run starts");
    heard_until(&socket, "READY=1");
    heard_until(&socket, "WATCHDOG=1");
    support::kill(child.id(), Signal::TERM);
    let ended = wait_for(|| child.try_wait().expect("it is ours"));
    assert!(ended.is_some_and(|status| status.success()), "it does not end within {LIMIT:?}");
}
