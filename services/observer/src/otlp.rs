//! Frames as traces for Jaeger, Tempo and their like: OTLP over HTTP, in its JSON encoding (OpenTelemetry protocol
//! 1.x, "OTLP/HTTP"). One trace for a frame, one span for each service that held it.
//!
//! Off unless the config names a collector. A thread of its own sends; what it has no time for is dropped and
//! counted: a collector that is slow or gone delays nobody.

use pursuit_messages::{Service, Stamp};
use pursuit_runtime::clock::monotonic_ns;
use serde_json::{Value, json};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// Frames that may wait to be sent.
const QUEUE: usize = 512;
/// Frames sent at once, at most.
const BATCH: usize = 100;
/// A frame waits no longer for others.
const GATHER: Duration = Duration::from_secs(1);
/// A collector has so long to take a batch.
const PATIENCE: Duration = Duration::from_secs(5);
/// Kind of a span: inside of a service (SPAN_KIND_INTERNAL).
const INTERNAL: u32 = 1;

/// Where frames go.
pub struct Exporter {
    queue: SyncSender<Stamp>,
    counts: Arc<Counts>,
    every: u64,
    last: Option<(u64, u64)>,
}

/// What became of the frames.
#[derive(Debug, Default)]
pub struct Counts {
    /// Sent.
    pub sent: AtomicU64,
    /// Dropped: the collector is slow, or does not take them.
    pub dropped: AtomicU64,
}

impl Exporter {
    /// Sends each `every`-th frame to the collector at `endpoint` ("http://host:4318").
    ///
    /// # Errors
    /// Where there is no thread.
    pub fn start(endpoint: &str, every: u64) -> std::io::Result<Exporter> {
        let (queue, waiting) = sync_channel(QUEUE);
        let counts = Arc::new(Counts::default());
        let (told, address) = (Arc::clone(&counts), format!("{}/v1/traces", endpoint.trim_end_matches('/')));
        std::thread::Builder::new()
            .name("otlp".to_owned())
            .spawn(move || export(&address, &waiting, &told))?;
        Ok(Exporter { queue, counts, every: every.max(1), last: None })
    }

    /// Takes a frame that was answered; its stamp has all that is told.
    pub fn take(&mut self, stamp: &Stamp) {
        let frame = (stamp.epoch, stamp.frame);
        // On the wall clock the answer is repeated each cycle.
        if self.last.replace(frame) == Some(frame) || !stamp.frame.is_multiple_of(self.every) {
            return;
        }
        if let Err(TrySendError::Full(_) | TrySendError::Disconnected(_)) = self.queue.try_send(*stamp) {
            self.counts.dropped.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// What became of the frames so far.
    pub fn counts(&self) -> &Counts {
        &self.counts
    }
}

/// The thread: gathers, sends, and goes on whatever comes of it.
fn export(address: &str, waiting: &Receiver<Stamp>, counts: &Counts) {
    let config = ureq::Agent::config_builder().timeout_global(Some(PATIENCE)).build();
    let agent = ureq::Agent::new_with_config(config);
    let mut failing = false;
    while let Ok(first) = waiting.recv() {
        let mut batch = vec![first];
        let end = Instant::now() + GATHER;
        let mut is_over = false;
        while batch.len() < BATCH {
            match waiting.recv_timeout(end.saturating_duration_since(Instant::now())) {
                Ok(stamp) => batch.push(stamp),
                Err(RecvTimeoutError::Timeout) => break,
                Err(RecvTimeoutError::Disconnected) => {
                    is_over = true;
                    break;
                }
            }
        }
        let body = request(&batch, to_wall_ns()).to_string();
        let sent = agent.post(address).header("Content-Type", "application/json").send(body);
        let frames = batch.len() as u64;
        match sent {
            Ok(_) => {
                counts.sent.fetch_add(frames, Ordering::Relaxed);
                failing = false;
            }
            Err(error) => {
                counts.dropped.fetch_add(frames, Ordering::Relaxed);
                if !failing {
                    tracing::warn!("no traces: {address}: {error}; frames are dropped until it takes them");
                }
                failing = true;
            }
        }
        if is_over {
            return;
        }
    }
}

/// What is added to CLOCK_MONOTONIC for the wall clock, ns.
fn to_wall_ns() -> u64 {
    let wall = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_nanos() as u64);
    wall.saturating_sub(monotonic_ns())
}

/// ExportTraceServiceRequest of these frames.
fn request(frames: &[Stamp], to_wall_ns: u64) -> Value {
    let services = Service::ALL.into_iter().filter_map(|service| {
        let spans: Vec<Value> =
            frames.iter().flat_map(|stamp| spans_of(stamp, service, to_wall_ns)).collect();
        (!spans.is_empty()).then(|| {
            json!({
                "resource": { "attributes": [
                    text("service.namespace", "pursuit"),
                    text("service.name", service.name()),
                ] },
                "scopeSpans": [{ "scope": { "name": "pursuit", "version": env!("CARGO_PKG_VERSION") }, "spans": spans }],
            })
        })
    });
    json!({ "resourceSpans": services.collect::<Vec<_>>() })
}

/// The spans of a frame in one service; each is a child of the one before it on the frame's way.
fn spans_of(stamp: &Stamp, service: Service, to_wall_ns: u64) -> Vec<Value> {
    let stages = stamp.passed();
    let id = |place: usize| format!("{:016x}", stamp.trace_id.wrapping_add(1 + place as u64) | 1 << 63);
    let at = |ns: u64| (ns + to_wall_ns).to_string();
    stages
        .iter()
        .enumerate()
        .filter(|(_, stage)| stage.service == service as u16)
        .map(|(place, stage)| {
            let waited_ns =
                place.checked_sub(1).map_or(0, |before| stage.begin_ns.saturating_sub(stages[before].end_ns));
            json!({
                "traceId": format!("{:016x}{:016x}", stamp.epoch, stamp.trace_id),
                "spanId": id(place),
                "parentSpanId": place.checked_sub(1).map(id).unwrap_or_default(),
                "name": service.name(),
                "kind": INTERNAL,
                "startTimeUnixNano": at(stage.begin_ns),
                "endTimeUnixNano": at(stage.end_ns.max(stage.begin_ns)),
                "attributes": [
                    number("pursuit.frame", stamp.frame),
                    number("pursuit.epoch", stamp.epoch),
                    number("pursuit.waited_ns", waited_ns),
                ],
            })
        })
        .collect()
}

fn text(key: &str, value: &str) -> Value {
    json!({ "key": key, "value": { "stringValue": value } })
}

/// 64-bit numbers are strings in this encoding.
fn number(key: &str, value: u64) -> Value {
    json!({ "key": key, "value": { "intValue": value.to_string() } })
}

#[cfg(test)]
mod tests {
    use super::*;
    use pursuit_messages::{ImageShape, Stage};
    use std::collections::BTreeSet;
    use std::io::{Read, Write};
    use std::net::TcpListener;

    fn stamp(frame: u64) -> Stamp {
        Stamp::new(7, frame, 1000, ImageShape::grey(64, 64))
            .extended(Service::Acquisition, Stage::Expose, 1000, 1400)
            .extended(Service::Vision, Stage::Votes, 1500, 3000)
            .extended(Service::Segmentation, Stage::Segment, 3100, 3200)
    }

    /// A collector that takes one batch, and what it was told.
    fn collector() -> (String, std::thread::JoinHandle<(String, Value)>) {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = format!("http://{}", listener.local_addr().unwrap());
        let thread = std::thread::spawn(move || {
            let (mut stream, _) = listener.accept().unwrap();
            let (mut text, mut part) = (Vec::new(), [0; 4096]);
            loop {
                let count = stream.read(&mut part).unwrap();
                text.extend_from_slice(&part[..count]);
                let whole = String::from_utf8_lossy(&text).into_owned();
                if let Some((head, body)) = whole.split_once("\r\n\r\n")
                    && let Ok(value) = serde_json::from_str(body)
                {
                    let answer =
                        "HTTP/1.1 200 OK\r\nContent-Type: application/json\r\nContent-Length: 2\r\n\r\n{}";
                    stream.write_all(answer.as_bytes()).unwrap();
                    return (head.to_owned(), value);
                }
                assert!(count > 0, "the question ends early: {whole}");
            }
        });
        (address, thread)
    }

    #[test]
    fn a_frame_is_one_trace_with_a_span_for_each_service() {
        let (address, collector) = collector();
        let mut exporter = Exporter::start(&address, 2).unwrap();
        // Frame 4 comes twice, as on the wall clock; odd ones are left out.
        [4, 4, 5, 6].iter().for_each(|frame| exporter.take(&stamp(*frame)));
        let (head, told) = collector.join().unwrap();
        assert!(head.starts_with("POST /v1/traces HTTP/1.1"), "{head}");
        let resources = told["resourceSpans"].as_array().unwrap();
        let names: Vec<&str> = resources
            .iter()
            .map(|one| one["resource"]["attributes"][1]["value"]["stringValue"].as_str().unwrap())
            .collect();
        assert_eq!(names, ["acquisition", "vision", "segmentation"]);
        let spans: Vec<&Value> =
            resources.iter().flat_map(|one| one["scopeSpans"][0]["spans"].as_array().unwrap()).collect();
        assert_eq!(spans.len(), 6, "two frames, three services");
        let ids: BTreeSet<&str> = spans.iter().map(|span| span["spanId"].as_str().unwrap()).collect();
        assert_eq!(ids.len(), 6);
        for span in spans {
            assert_eq!(span["traceId"].as_str().unwrap().len(), 32);
            assert_eq!(span["spanId"].as_str().unwrap().len(), 16);
            let parent = span["parentSpanId"].as_str().unwrap();
            assert!(parent.is_empty() || ids.contains(parent));
            let [start, end] = ["startTimeUnixNano", "endTimeUnixNano"]
                .map(|key| span[key].as_str().unwrap().parse::<u64>().unwrap());
            assert!(start < end && start > 1_600_000_000_000_000_000);
        }
    }

    #[test]
    fn without_a_collector_frames_are_dropped_and_counted() {
        let nobody = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
        let mut exporter = Exporter::start(&format!("http://{nobody}"), 1).unwrap();
        let limit = Instant::now() + Duration::from_secs(60);
        let mut frame = 0;
        while exporter.counts().dropped.load(Ordering::Relaxed) == 0 {
            exporter.take(&stamp(frame));
            frame += 1;
            assert!(Instant::now() < limit, "nothing is dropped");
            std::thread::sleep(Duration::from_millis(5));
        }
        assert_eq!(exporter.counts().sent.load(Ordering::Relaxed), 0);
    }
}
