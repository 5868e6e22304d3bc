//! What `pursuit trace` says, as JSON and in words.

use crate::account::Account;
use crate::histogram::Histogram;
use crate::latency::Told;
use crate::ledger::HOPS;
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

/// The figures for people.
pub fn text(account: &Account) -> String {
    let (latency, sums) = (&account.latency, account.sums());
    let mut text = format!("{:<28}{:<11}", "from -> to, us", "");
    for name in ["p50", "p90", "p99", "p99.9", "max"] {
        let _ = write!(text, "{name:>10}");
    }
    text.push('\n');
    for hop in 0..HOPS.len() {
        let name = format!("{} -> {}", before(hop), HOPS[hop].name());
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
