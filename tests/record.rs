//! `pursuit record` beside a running system: what is in the file, and what a kill or a full disk costs.

mod support;

use pursuit_recording::{Entry, Reader, Sample};
use std::path::Path;
use std::process::{Child, Stdio};
use support::{Place, kill, text, wait_for};

/// All messages of a file that can be read, and whether it was closed.
fn read(file: &Path) -> (Vec<Entry>, bool) {
    let mut reader = Reader::open(file).expect("a recording");
    let mut all = Vec::new();
    while let Some(entry) = reader.next_entry().expect("whole up to its end") {
        all.push(entry);
    }
    (all, reader.is_closed())
}

/// Length of a file that may not be there yet, bytes.
fn length(file: &Path) -> u64 {
    std::fs::metadata(file).map_or(0, |data| data.len())
}

fn start_recorder(place: &Place, file: &Path) -> Child {
    let out = file.to_str().expect("a plain name");
    let mut command = place.command(&["record", "--out", out]);
    command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("pursuit record starts")
}

#[test]
fn a_recording_holds_every_topic_and_is_closed_on_sigterm() {
    let place = Place::new();
    let mut system = place.up(&["--set", "run.pace=\"real\""]);
    system.wait_until_running();
    let file = place.file("run.mcap");
    let recorder = start_recorder(&place, &file);
    assert!(wait_for(|| (length(&file) > 3_000_000).then_some(())).is_some(), "{}", place.log());
    kill(recorder.id(), rustix::process::Signal::TERM);
    let output = recorder.wait_with_output().expect("pursuit record ends");
    assert!(output.status.success(), "{:?}", text(&output));
    let (all, closed) = read(&file);
    assert!(closed);
    let count = |wanted: fn(&Sample) -> bool| all.iter().filter(|entry| wanted(&entry.sample)).count();
    let counts = [
        count(|s| matches!(s, Sample::Frame(_))),
        count(|s| matches!(s, Sample::Votes(_))),
        count(|s| matches!(s, Sample::Target(_))),
        count(|s| matches!(s, Sample::Joints(_))),
        count(|s| matches!(s, Sample::SetPoint(_))),
        count(|s| matches!(s, Sample::Learner(_))),
        count(|s| matches!(s, Sample::World(_))),
        count(|s| matches!(s, Sample::Command(_))),
        count(|s| matches!(s, Sample::Driver(_))),
        count(|s| matches!(s, Sample::Health(_))),
    ];
    assert!(counts.iter().all(|count| *count > 2), "{counts:?}");
    let config = Reader::open(&file).expect("a recording").config().map(str::to_owned);
    assert!(config.is_some_and(|config| config.contains("training_moves")), "the config of the run is in it");
}

#[test]
fn a_killed_recorder_loses_less_than_a_second() {
    let place = Place::new();
    let mut system = place.up(&["--set", "run.pace=\"real\""]);
    system.wait_until_running();
    let file = place.file("killed.mcap");
    let mut recorder = start_recorder(&place, &file);
    assert!(wait_for(|| (length(&file) > 5_000_000).then_some(())).is_some(), "{}", place.log());
    let killed_ns = pursuit_runtime::clock::monotonic_ns();
    kill(recorder.id(), rustix::process::Signal::KILL);
    let _ = recorder.wait();
    let (all, closed) = read(&file);
    assert!(!closed);
    let last_ns = all.last().expect("messages").log_ns;
    assert!(killed_ns.saturating_sub(last_ns) < 1_000_000_000, "lost {} ns", killed_ns - last_ns);
    let services = system.wait_until_running();
    assert!(services.iter().all(|service| service["restarts"] == 0), "{services:?}");
}

#[test]
fn a_full_disk_ends_the_recording_and_nothing_else() {
    let place = Place::new();
    let mut system = place.up(&["--set", "run.pace=\"real\""]);
    system.wait_until_running();
    let file = place.file("full.mcap");
    let mut recorder = start_recorder(&place, &file);
    // The kernel refuses to let the file grow further, as a full disk does: after some chunks, which are of a second
    // at most.
    let most = Some(10_000_000);
    let limit = rustix::process::Rlimit { current: most, maximum: most };
    let pid = rustix::process::Pid::from_raw(recorder.id() as i32);
    rustix::process::prlimit(pid, rustix::process::Resource::Fsize, limit).expect("the child is ours");
    let ended = wait_for(|| recorder.try_wait().expect("the child is ours"));
    assert!(ended.is_some_and(|status| status.code() == Some(1)), "{ended:?}");
    let output = recorder.wait_with_output().expect("pursuit record ends");
    assert!(text(&output).1.contains("no room"), "{:?}", text(&output));
    let (all, closed) = read(&file);
    assert!(!closed && !all.is_empty());
    let services = system.wait_until_running();
    assert!(services.iter().all(|service| service["restarts"] == 0), "{services:?}");
}

#[test]
fn without_a_running_system_there_is_nothing_to_record() {
    let place = Place::new();
    let output = place.command(&["record"]).output().expect("pursuit record runs");
    let (_, error) = text(&output);
    assert!(!output.status.success() && error.contains("pursuit up"), "{error}");
}

/// Records a run from its first frame; the file.
fn record_from_the_start(place: &Place, arguments: &[&str]) -> std::path::PathBuf {
    let file = place.file("whole.mcap");
    let out = file.display().to_string();
    let mut command = place.command(&["record", "--wait", "--out", &out]);
    let recorder = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("it starts");
    let mut system = place.up(arguments);
    system.wait_until_running();
    assert!(wait_for(|| (length(&file) > 6_000_000).then_some(())).is_some(), "{}", place.log());
    kill(recorder.id(), rustix::process::Signal::TERM);
    let output = recorder.wait_with_output().expect("pursuit record ends");
    assert!(output.status.success(), "{:?}", text(&output));
    system.signal(rustix::process::Signal::TERM);
    assert!(system.end().0.success());
    file
}

fn replay(file: &Path, more: &[&str]) -> (Option<i32>, serde_json::Value) {
    let output = support::pursuit().arg("replay").arg(file).args(["--json", "-"]).args(more).output();
    let output = output.expect("pursuit replay runs");
    let (out, err) = text(&output);
    let outcome = serde_json::from_str(&out).unwrap_or_else(|error| panic!("{error}: {out} {err}"));
    (output.status.code(), outcome)
}

#[test]
fn a_replay_is_the_recording_to_the_bit_and_another_detector_is_told_apart() {
    let place = Place::new();
    let file = record_from_the_start(&place, &["--set", "run.pace=real", "--set", "observer.start=never"]);
    let (code, outcome) = replay(&file, &[]);
    assert_eq!(code, Some(0), "{outcome}");
    assert_eq!(outcome["with_tracks"], true, "{outcome}");
    for stage in ["votes", "targets"] {
        assert!(outcome[stage]["compared"].as_u64() > Some(10), "{outcome}");
        assert_eq!(outcome[stage]["compared"], outcome[stage]["same"], "{outcome}");
        assert_eq!(outcome[stage]["not_comparable"], 0, "{outcome}");
    }
    // The same again, and not the same with another detector: stage and frame are named.
    assert_eq!(replay(&file, &[]).1, outcome);
    let (code, other) = replay(&file, &["--set", "vision.light=false"]);
    assert_eq!(code, Some(1));
    assert_eq!(other["first_difference"][0], "vision", "{other}");
    // Through the services as processes of their own: the same bits, as far as none was passed over.
    let run = place.run_dir().display().to_string();
    let (code, processes) = replay(&file, &["--services", "--speed", "0.5", "--run-dir", &run]);
    assert_eq!(code, Some(0), "{processes}\n{}", place.log());
    assert!(processes["votes"]["same"].as_u64() > Some(10), "{processes}");
    assert_eq!(processes["votes"]["compared"], processes["votes"]["same"], "{processes}");
    assert_eq!(processes["targets"]["compared"], processes["targets"]["same"], "{processes}");
    place.assert_nothing_left();
    // As a page that needs nothing else.
    let page = place.file("whole.html");
    let output = support::pursuit().arg("report").arg(&file).output().expect("it runs");
    assert!(output.status.success(), "{}", text(&output).1);
    let html = std::fs::read_to_string(&page).expect("the page is beside the recording");
    for wanted in
        ["What was seen", "figure 2", "figure 4", "figure 5", "data:image/png;base64,", "the paper (1994)"]
    {
        assert!(html.contains(wanted), "the page has no {wanted}");
    }
    let elsewhere = html.matches("http").count() - html.matches("http://www.w3.org/2000/svg").count();
    assert_eq!(elsewhere, 0, "the page needs something from elsewhere");
    // The detector by itself takes the recording, too.
    let output = support::pursuit().args(["detect", "--json"]).arg(&file).output().expect("it runs");
    let (lines, errors) = text(&output);
    assert!(output.status.success(), "{errors}");
    assert_eq!(lines.lines().count() as u64, outcome["frames"].as_u64().expect("a number"));
}

#[test]
fn what_is_no_recording_is_refused_with_a_reason() {
    let place = Place::new();
    std::fs::create_dir_all(place.file("")).expect("a folder");
    for (name, bytes) in
        [("empty.mcap", Vec::new()), ("noise.mcap", (0..=255u8).cycle().take(9999).collect())]
    {
        let file = place.file(name);
        std::fs::write(&file, bytes).expect("a file");
        for verb in ["replay", "detect", "report"] {
            let output = support::pursuit().arg(verb).arg(&file).output().expect("it runs");
            assert_eq!(output.status.code(), Some(2), "{verb} {name}");
            assert!(text(&output).1.contains(name), "{}", text(&output).1);
        }
    }
}
