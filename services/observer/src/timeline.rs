//! The last frames as a trace-event file, which Perfetto and Chrome's viewer open: a track for each process,
//! an arrow from each hop to the next.

use crate::latency::Latency;
use pursuit_messages::{HOPS, Service};
use serde_json::{Value, json};

/// The file's content.
pub fn of(latency: &Latency) -> Value {
    let mut events = Vec::new();
    for service in HOPS {
        events.push(json!({"ph": "M", "name": "process_name", "pid": service as u16, "tid": 1,
            "args": {"name": service.name()}}));
        events.push(json!({"ph": "M", "name": "process_sort_index", "pid": service as u16, "tid": 1,
            "args": {"sort_index": service as u16}}));
    }
    for told in &latency.frames {
        let frame = told.stamp.frame;
        let id = format!("{:016x}", told.stamp.trace_id);
        let stages = told.stamp.passed();
        for (place, stage) in stages.iter().enumerate() {
            let Some(service) = Service::from_number(stage.service) else { continue };
            let (pid, begin) = (stage.service, stage.begin_ns as f64 / 1e3);
            let took = stage.end_ns.saturating_sub(stage.begin_ns) as f64 / 1e3;
            events
                .push(json!({"ph": "X", "name": format!("frame {frame}"), "cat": service.name(), "pid": pid,
                "tid": 1, "ts": begin, "dur": took, "args": {"frame": frame, "epoch": told.stamp.epoch}}));
            if stages.len() < 2 {
                continue;
            }
            // An arrow leaves and arrives within the slices that it joins.
            let phase = if place == 0 {
                "s"
            } else if place + 1 == stages.len() {
                "f"
            } else {
                "t"
            };
            let mut arrow = json!({"ph": phase, "name": "frame", "cat": "frame", "id": id, "pid": pid,
                "tid": 1, "ts": begin + took / 2.0});
            if phase == "f" {
                arrow["bp"] = json!("e");
            }
            events.push(arrow);
        }
    }
    json!({"displayTimeUnit": "ms", "traceEvents": events})
}
