//! What `pursuit trace` says, as JSON and in words.

use crate::account::Account;
use crate::histogram::Histogram;
use crate::latency::Told;
use pursuit_messages::{HOPS, Phase};
use serde_json::{Value, json};
use std::fmt::Write as _;

/// The figures as JSON.
pub fn json(account: &Account) -> Value {
    let latency = &account.latency;
    let hops: Vec<Value> = (0..HOPS.len())
        .map(|hop| {
            json!({"from": before(hop), "to": HOPS[hop].name(),
                "wait_us": quantiles(&latency.wait[hop]), "compute_us": quantiles(&latency.compute[hop])})
        })
        .collect();
    let worst: Vec<Value> = latency.worst().iter().map(|told| worst(account, told)).collect();
    let dominant = latency.dominant().map(|(hop, waits)| {
        json!({"from": before(hop), "to": HOPS[hop].name(), "part": if waits { "waiting" } else { "computing" }})
    });
    let sums = account.sums();
    json!({"hops": hops, "end_to_end_us": quantiles(&latency.end_to_end), "slow_frames_hop": dominant,
        "frames": {"captured": sums.captured, "acted": sums.acted, "superseded": sums.superseded,
            "dropped": sums.dropped, "lost": sums.lost, "open": sums.open},
        "sums_agree": sums.agree() && account.mismatches == 0, "worst": worst})
}

/// The hops in short, for a screen: p50 and p99 of waiting and computing.
pub fn short(account: &Account) -> String {
    let latency = &account.latency;
    let mut text = format!(
        "{:<13} {:>10} {:>10} {:>11} {:>11}\n",
        "us", "wait p50", "wait p99", "compute p50", "compute p99"
    );
    let us = |histogram: &Histogram, share| histogram.quantile_ns(share) as f64 / 1e3;
    for (hop, service) in HOPS.iter().enumerate() {
        let (wait, compute) = (&latency.wait[hop], &latency.compute[hop]);
        let _ = writeln!(
            text,
            "{:<13} {:>10.0} {:>10.0} {:>11.0} {:>11.0}",
            service.name(),
            us(wait, 0.5),
            us(wait, 0.99),
            us(compute, 0.5),
            us(compute, 0.99)
        );
    }
    let (p50, p99) = (us(&latency.end_to_end, 0.5) / 1e3, us(&latency.end_to_end, 0.99) / 1e3);
    let sums = account.sums();
    let _ = writeln!(
        text,
        "end to end    p50 {p50:.2} ms, p99 {p99:.2} ms; {} frames: {} acted on, {} superseded, {} dropped, {} lost",
        sums.captured, sums.acted, sums.superseded, sums.dropped, sums.lost
    );
    text
}

/// What the eye and the hand say now, in two lines.
pub fn now(account: &Account) -> String {
    let mut text = String::new();
    let _ = match account.target {
        Some((frame, target)) => {
            let (name, seen) = [("track", target.track), ("pair", target.motion), ("blob", target.blob)]
                .into_iter()
                .find(|(_, detection)| detection.found == 1)
                .unwrap_or(("none", target.motion));
            writeln!(
                text,
                "target   frame {frame}: {name} at ({:.1}, {:.1}) px, moves ({:.2}, {:.2}) px/frame, confidence {:.2}",
                seen.u, seen.v, seen.vu, seen.vv, seen.confidence
            )
        }
        None => writeln!(text, "target   nothing heard yet"),
    };
    let _ = match &account.learner {
        Some(state) => {
            let phase = match Phase::from_number(state.phase) {
                Some(Phase::Training) => "training",
                Some(Phase::Homing) => "homing",
                Some(Phase::Tracking) => "following",
                None => "unknown",
            };
            writeln!(
                text,
                "learner  {phase}, {} moves, {} samples, {} refits, loss {:.2e}, {}",
                state.moves,
                state.samples,
                state.refits_merged,
                state.loss,
                if state.consistent == 1 { "map fits" } else { "map does not fit yet" }
            )
        }
        None => writeln!(text, "learner  nothing heard yet"),
    };
    text
}

/// The figures for people.
pub fn text(account: &Account) -> String {
    let (latency, sums) = (&account.latency, account.sums());
    let mut text = format!("{:<28}{:<11}", "from -> to, us", "");
    for name in ["p50", "p90", "p99", "p99.9", "max"] {
        let _ = write!(text, "{name:>10}");
    }
    text.push('\n');
    for (hop, service) in HOPS.iter().enumerate() {
        let name = format!("{} -> {}", before(hop), service.name());
        row(&mut text, &name, "waiting", &latency.wait[hop]);
        row(&mut text, "", "computing", &latency.compute[hop]);
    }
    row(&mut text, "end to end", "", &latency.end_to_end);
    let _ = writeln!(
        text,
        "\n{} frames: {} acted on, {} superseded, {} dropped, {} lost, {} on their way",
        sums.captured, sums.acted, sums.superseded, sums.dropped, sums.lost, sums.open
    );
    if !sums.agree() || account.mismatches > 0 {
        text.push_str("ALARM: the sums do not agree\n");
    }
    if let Some((hop, waits)) = latency.dominant() {
        let what = if waits { "waiting for" } else { "computing in" };
        let _ = writeln!(text, "slow frames are slow by {what} {}", HOPS[hop].name());
    }
    let worst = latency.worst();
    if !worst.is_empty() {
        text.push_str("worst frames:\n");
    }
    for told in worst {
        let took = told.times.map_or("-".to_owned(), |t| format!("{:.2} ms", t.end_to_end_ns as f64 / 1e6));
        let _ = writeln!(text, "  {:>8} {took:>10}  {}", told.stamp.frame, latency.reason(&told));
    }
    text
}

fn row(text: &mut String, name: &str, part: &str, histogram: &Histogram) {
    let _ = write!(text, "{name:<28}{part:<11}");
    for share in [0.5, 0.9, 0.99, 0.999, 1.0] {
        let _ = write!(text, "{:>10.1}", histogram.quantile_ns(share) as f64 / 1e3);
    }
    text.push('\n');
}

fn before(hop: usize) -> &'static str {
    if hop == 0 { "exposure" } else { HOPS[hop - 1].name() }
}

fn quantiles(histogram: &Histogram) -> Value {
    let us = |share| histogram.quantile_ns(share) as f64 / 1e3;
    json!({"p50": us(0.5), "p90": us(0.9), "p99": us(0.99), "p99.9": us(0.999),
        "max": histogram.max_ns() as f64 / 1e3})
}

fn worst(account: &Account, told: &Told) -> Value {
    json!({"frame": told.stamp.frame, "epoch": told.stamp.epoch,
        "end_to_end_us": told.times.map(|times| times.end_to_end_ns as f64 / 1e3),
        "reason": account.latency.reason(told)})
}
