//! A camera that is stuck, dark or covered is found, told, and moves no arm.

mod support;

use rustix::process::Signal;
use support::{Place, wait_for};

/// State and lack of the camera's service.
fn camera(place: &Place) -> Option<(String, String)> {
    let services = place.status()?;
    let camera = services.iter().find(|s| s["service"] == "acquisition")?;
    Some((camera["state"].as_str()?.to_owned(), camera["lack"].as_str()?.to_owned()))
}

/// Why the last set-point was refused, as the journal has it.
fn refusal(place: &Place) -> Option<u32> {
    let text = std::fs::read_to_string(place.run_dir().join("journal.csv")).ok()?;
    text.rsplit_once('\n')?.0.lines().last()?.split(',').nth(5)?.parse().ok()
}

const STALE: u32 = pursuit_messages::Refusal::Stale as u32;

#[test]
fn a_stuck_camera_is_told_and_the_arm_rests_until_it_is_well() {
    let place = Place::new();
    let settings =
        ["run.clock=wall", "camera.rate_hz=12.5", "acquisition.faults=true", "observer.start=never"];
    let mut system = place.up(&settings.map(|set| ["--set", set]).concat());
    system.wait_until_running();
    let fault = place.run_dir().join("camera.fault");
    // Stuck: its images are not sent, so that the set-points grow old.
    std::fs::write(&fault, "stuck").expect("a file");
    let told = wait_for(|| camera(&place).filter(|(_, lack)| lack.contains("repeats itself")));
    let (state, _) = told.unwrap_or_else(|| panic!("not told\n{}", place.log()));
    assert_eq!(state, "no-input");
    assert!(wait_for(|| refusal(&place).filter(|refusal| *refusal == STALE)).is_some(), "{}", place.log());
    std::fs::remove_file(&fault).expect("it is there");
    let well = wait_for(|| camera(&place).filter(|(state, lack)| state == "running" && lack.is_empty()));
    assert!(well.is_some(), "{}", place.log());
    assert!(wait_for(|| refusal(&place).filter(|refusal| *refusal != STALE)).is_some(), "{}", place.log());
    // Dark, flooded, covered: told, and still sent.
    for (word, words) in [("black", "dark"), ("white", "flooded"), ("covered", "no texture")] {
        std::fs::write(&fault, word).expect("a file");
        let told = wait_for(|| camera(&place).filter(|(_, lack)| lack.contains(words)));
        assert_eq!(told.map(|(state, _)| state).as_deref(), Some("running"), "{word}\n{}", place.log());
        std::fs::remove_file(&fault).expect("it is there");
        assert!(wait_for(|| camera(&place).filter(|(_, lack)| lack.is_empty())).is_some(), "{}", place.log());
    }
    let services = place.status().expect("it runs");
    assert!(
        services.iter().all(|s| s["restarts"] == 0),
        "a bad camera is no reason to restart: {services:?}"
    );
    system.signal(Signal::TERM);
    assert!(system.end().0.success());
    place.assert_nothing_left();
}
