//! `pursuit trace` on a running system.

mod support;

use support::{Place, json, text};

#[test]
fn trace_tells_where_the_time_of_each_frame_went() {
    let place = Place::new();
    let mut system = place.up(&["--set", "run.pace=real"]);
    system.wait_until_running();
    let (figures, timeline) = (place.file("trace.json"), place.file("timeline.json"));
    let mut command = place.command(&["trace", "--seconds", "4"]);
    let output = command.arg("--json").arg(&figures).arg("--out").arg(&timeline).output().expect("it runs");
    assert!(output.status.success(), "{}", text(&output).1);
    assert!(text(&output).0.contains("end to end"), "{}", text(&output).0);
    let figures = json(&figures);
    let frames = &figures["frames"];
    let count = |key: &str| frames[key].as_u64().unwrap_or_else(|| panic!("no {key} in {frames}"));
    assert!(count("acted") > 0, "{figures}");
    let ended = count("acted") + count("superseded") + count("dropped") + count("lost") + count("open");
    assert_eq!(count("captured"), ended);
    assert_eq!(figures["sums_agree"], true);
    let hops = figures["hops"].as_array().expect("hops");
    assert_eq!(hops.len(), 5);
    for hop in hops {
        assert!(hop["compute_us"]["p50"].as_f64().expect("a figure") > 0.0, "{hop}");
        assert!(hop["wait_us"]["p99"].as_f64() >= hop["wait_us"]["p50"].as_f64(), "{hop}");
    }
    let whole = figures["end_to_end_us"]["max"].as_f64().expect("a figure");
    assert!(whole >= hops[1]["compute_us"]["p50"].as_f64().expect("a figure"));
    let timeline = json(&timeline);
    let events = timeline["traceEvents"].as_array().expect("events");
    let of = |phase: &str| events.iter().filter(|event| event["ph"] == phase).count();
    assert_eq!(of("M"), 10, "a name and a place for each process");
    assert!(of("X") >= 5 && of("s") > 0 && of("s") >= of("f"), "slices and arrows");
    system.signal(rustix::process::Signal::TERM);
    assert!(system.end().0.success());
    place.assert_nothing_left();
}

#[test]
fn trace_of_nothing_says_how_to_start() {
    let place = Place::new();
    let output = place.command(&["trace"]).output().expect("pursuit trace runs");
    assert_eq!(output.status.code(), Some(1));
    assert!(text(&output).1.contains("pursuit up"), "{}", text(&output).1);
}
