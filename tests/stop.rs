//! An operator stops the arm and lets it go on.

mod support;

use rustix::process::Signal;
use support::{Place, kill, pid_of, wait_for};

/// Refusal, frame and where the camera is, in the last whole line of the journal.
fn last(place: &Place) -> Option<(u32, (u64, String))> {
    let text = std::fs::read_to_string(place.run_dir().join("journal.csv")).ok()?;
    let whole = text.rsplit_once('\n')?.0;
    let fields: Vec<&str> = whole.lines().last()?.split(',').collect();
    let camera = format!("{} {}", fields.get(6)?, fields.get(7)?);
    Some((fields.get(5)?.parse().ok()?, (fields.first()?.parse().ok()?, camera)))
}

const STOPPED: u32 = pursuit_messages::Refusal::Stopped as u32;

#[test]
fn a_stop_holds_through_a_new_driver_until_a_reset() {
    let place = Place::new();
    let mut system = place.up(&["--set", "run.pace=real"]);
    let services = system.wait_until_running();
    assert!(wait_for(|| last(&place).filter(|(refusal, _)| *refusal == 0)).is_some(), "{}", place.log());
    assert!(place.log().contains("worst travel of the camera"), "{}", place.log());
    let output = place.command(&["stop"]).output().expect("pursuit stop runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    // At rest: the camera is where it was, for frames on end.
    let rests = || {
        let mut since: Option<(u64, String)> = None;
        wait_for(|| {
            let (refusal, (frame, camera)) = last(&place)?;
            let (first, stood) = since.get_or_insert((frame, camera.clone()));
            if refusal != STOPPED || *stood != camera {
                (*first, *stood) = (frame, camera);
                return None;
            }
            (frame > *first + 10).then_some(camera)
        })
    };
    let stands = rests().unwrap_or_else(|| panic!("the arm does not come to rest\n{}", place.log()));
    let status = place.command(&["status"]).output().expect("pursuit status runs");
    let words = String::from_utf8_lossy(&status.stdout);
    assert!(words.contains("emergency stop") && words.contains("arm: emergency_stop, at rest"), "{words}");
    let told = place.status().expect("it runs");
    let driver = told.iter().find(|s| s["service"] == "arm-driver").expect("a driver");
    assert_eq!(driver["arm"]["cause"], "emergency_asked", "{driver}");
    kill(pid_of(&services, "arm-driver"), Signal::KILL);
    system.wait_until_running();
    let later = rests().unwrap_or_else(|| panic!("a new driver forgets the stop\n{}", place.log()));
    assert_eq!(stands, later, "a new driver moves the arm");
    let output = place.command(&["reset"]).output().expect("pursuit reset runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(wait_for(|| last(&place).filter(|(refusal, _)| *refusal == 0)).is_some(), "{}", place.log());
    system.signal(Signal::TERM);
    assert!(system.end().0.success());
}

#[test]
fn an_arm_that_waits_for_its_operator_rests_until_it_is_activated() {
    let place = Place::new();
    let mut system = place.up(&["--set", "run.pace=real", "--set", "arm.activate=operator"]);
    system.wait_until_running();
    let is = |wanted: u32| wait_for(|| last(&place).filter(|(refusal, _)| *refusal == wanted)).is_some();
    assert!(is(pursuit_messages::Refusal::Inactive as u32), "{}", place.log());
    let output = place.command(&["activate"]).output().expect("pursuit activate runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(is(0), "{}", place.log());
    system.signal(Signal::TERM);
    assert!(system.end().0.success());
}

#[test]
fn a_reset_that_nobody_takes_up_says_so_and_the_stop_stays() {
    let place = Place::new();
    std::fs::create_dir_all(place.run_dir()).expect("a folder");
    assert!(place.command(&["stop"]).output().expect("runs").status.success());
    let output = place.command(&["reset"]).output().expect("runs");
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&output.stderr).contains("no arm driver"), "{output:?}");
    assert!(place.run_dir().join("stop.emergency").exists());
}

#[test]
fn a_stop_of_what_is_not_there_is_an_error() {
    let place = Place::new();
    assert_eq!(place.command(&["stop"]).output().expect("runs").status.code(), Some(1));
}
