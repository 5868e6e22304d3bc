//! `pursuit trace`, `pursuit top` and the metrics on a running system.

mod support;

use std::io::{Read, Write};
use support::{Place, json, text, wait_for};

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
    let output = place.command(&["top", "--once"]).output().expect("pursuit top runs");
    let (screen, errors) = text(&output);
    assert!(output.status.success(), "{errors}");
    for word in ["observer", "running", "frames/s", "wait p99", "end to end", "target", "learner  training"] {
        assert!(screen.contains(word), "no {word} on the screen:\n{screen}");
    }
    system.signal(rustix::process::Signal::TERM);
    assert!(system.end().0.success());
    place.assert_nothing_left();
}

#[test]
fn a_metrics_port_in_use_is_said_and_the_loop_runs() {
    let place = Place::new();
    let taken = std::net::TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = taken.local_addr().expect("an address");
    let mut system = place.up(&["--set", "run.pace=real", "--set", &format!("observer.metrics={address}")]);
    let services = system.wait_until_running();
    assert!(services.iter().any(|s| s["service"] == "observer"));
    let log = place.log();
    assert!(log.contains("observer.metrics=127.0.0.1:PORT"), "{log}");
    system.signal(rustix::process::Signal::TERM);
    assert!(system.end().0.success());
}

#[test]
fn metrics_of_a_running_system_can_be_scraped() {
    let place = Place::new();
    let mut system = place.up(&["--set", "run.pace=real", "--set", "observer.metrics=127.0.0.1:0"]);
    system.wait_until_running();
    let acted = wait_for(|| {
        let page = scrape(port_of(&place)?)?;
        let line = page.lines().find(|line| line.starts_with("pursuit_frames_total{state=\"acted\"}"))?;
        line.rsplit(' ').next()?.parse::<u64>().ok().filter(|acted| *acted > 0)
    });
    assert!(acted.is_some(), "no frame was counted\n{}", place.log());
    let output = place.command(&["why", "999999999"]).output().expect("pursuit why runs");
    assert_eq!(output.status.code(), Some(1));
    let (_, errors) = text(&output);
    let newest = errors.trim().rsplit(' ').next().unwrap_or_default().to_owned();
    assert!(newest.parse::<u64>().is_ok(), "it says which frames there are: {errors}");
    let page = text(&place.command(&["why", &newest]).output().expect("pursuit why runs")).0;
    for word in ["vision", "segmentation", "learner", "arm-driver", "computed"] {
        assert!(page.contains(word), "no {word} on the page:\n{page}");
    }
    system.signal(rustix::process::Signal::TERM);
    assert!(system.end().0.success());
}

/// The port on which the place's observer listens.
fn port_of(place: &Place) -> Option<u16> {
    let address = std::fs::read_to_string(place.run_dir().join("observer.address")).ok()?;
    address.rsplit(':').next()?.parse().ok()
}

fn scrape(port: u16) -> Option<String> {
    String::from_utf8(get(port, "/metrics")?).ok()
}

/// Head and body of an answer.
fn get(port: u16, path: &str) -> Option<Vec<u8>> {
    let mut stream = std::net::TcpStream::connect(("127.0.0.1", port)).ok()?;
    write!(stream, "GET {path} HTTP/1.1\r\nHost: localhost:{port}\r\n\r\n").ok()?;
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer).ok()?;
    Some(answer)
}

/// What the live page is told now: the words, and how many pixels come with them.
fn live(port: u16) -> Option<(serde_json::Value, usize)> {
    let answer = get(port, "/live")?;
    let body = answer.windows(4).position(|four| four == b"\r\n\r\n")? + 4;
    let end = body + answer[body..].iter().position(|byte| *byte == b'\n')?;
    Some((serde_json::from_slice(&answer[body..end]).ok()?, answer.len() - end - 1))
}

#[test]
fn the_live_page_is_served_and_shows_the_running_system() {
    let place = Place::new();
    let mut system = place.up(&["--set", "run.pace=real", "--set", "observer.metrics=127.0.0.1:0"]);
    system.wait_until_running();
    let port = wait_for(|| port_of(&place)).unwrap_or_else(|| panic!("no page\n{}", place.log()));
    for (path, word) in [("/", "What the hand sees"), ("/page.css", "dark"), ("/page.js", "/live")] {
        let answer = String::from_utf8(get(port, path).expect("an answer")).expect("text");
        assert!(answer.starts_with("HTTP/1.1 200") && answer.contains(word), "{path}: {answer}");
        assert!(answer.contains("frame-ancestors 'none'"), "{path}: {answer}");
    }
    // The first question says that somebody looks; then images come.
    let shown = wait_for(|| {
        let (words, pixels) = live(port)?;
        let image = &words["image"];
        let wanted = image["columns"].as_u64()? * image["rows"].as_u64()?;
        (wanted > 0 && words["target"]["blob"]["u"].is_number() && words["services"].as_array()?.len() >= 6)
            .then_some((words["frame"].as_u64()?, wanted, pixels as u64))
    });
    let (frame, wanted, pixels) = shown.unwrap_or_else(|| panic!("nothing is shown\n{}", place.log()));
    assert_eq!(wanted, pixels);
    assert!(
        wait_for(|| live(port)?.0["frame"].as_u64().filter(|newest| *newest > frame)).is_some(),
        "it stands still"
    );
    system.signal(rustix::process::Signal::TERM);
    assert!(system.end().0.success());
}

#[test]
fn trace_of_nothing_says_how_to_start() {
    let place = Place::new();
    let output = place.command(&["trace"]).output().expect("pursuit trace runs");
    assert_eq!(output.status.code(), Some(1));
    assert!(text(&output).1.contains("pursuit up"), "{}", text(&output).1);
}
