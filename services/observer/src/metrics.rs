//! The account as Prometheus reads it: text, format 0.0.4. Pure.

use crate::account::Account;
use crate::histogram::Histogram;
use pursuit_messages::{HOPS, Service};
use std::fmt::Write as _;

/// All metrics: name, kind, what it says.
pub const METRICS: [(&str, &str, &str); 9] = [
    ("pursuit_hop_wait_seconds", "summary", "Time from the hop before until a frame was taken."),
    ("pursuit_hop_compute_seconds", "summary", "Time from taking a frame to handing over the answer."),
    (
        "pursuit_end_to_end_seconds",
        "summary",
        "Time from the exposure (lock-step: its rendering) to the command.",
    ),
    ("pursuit_frames_total", "counter", "Frames by what became of them."),
    ("pursuit_ledger_mismatches_total", "counter", "Times at which the sums over the frames did not agree."),
    ("pursuit_restarts_total", "counter", "Services seen to run in another process than before."),
    ("pursuit_answered_total", "counter", "Frames answered by the present process of a service."),
    ("pursuit_skipped_total", "counter", "Frames passed over by the present process of a service."),
    ("pursuit_heartbeat_seconds", "gauge", "Monotonic time of a service's last sign of life."),
];

/// The page that a scrape gets.
pub fn exposition(account: &Account) -> String {
    let mut text = String::with_capacity(8192);
    for (name, kind, help) in METRICS {
        let _ = writeln!(text, "# HELP {name} {help}\n# TYPE {name} {kind}");
        values(&mut text, name, account);
    }
    text
}

fn values(text: &mut String, name: &str, account: &Account) {
    let (latency, sums) = (&account.latency, account.sums());
    let _ = match name {
        "pursuit_hop_wait_seconds" | "pursuit_hop_compute_seconds" => {
            let all = if name.contains("wait") { &latency.wait } else { &latency.compute };
            for (histogram, service) in all.iter().zip(HOPS) {
                summary(text, name, &format!("hop=\"{}\"", service.name()), histogram);
            }
            Ok(())
        }
        "pursuit_end_to_end_seconds" => {
            summary(text, name, "", &latency.end_to_end);
            Ok(())
        }
        "pursuit_frames_total" => {
            let ended = [
                ("acted", sums.acted),
                ("superseded", sums.superseded),
                ("dropped", sums.dropped),
                ("lost", sums.lost),
            ];
            ended.iter().try_for_each(|(state, count)| writeln!(text, "{name}{{state=\"{state}\"}} {count}"))
        }
        "pursuit_ledger_mismatches_total" => writeln!(text, "{name} {}", account.mismatches),
        "pursuit_restarts_total" => writeln!(text, "{name} {}", account.restarts),
        _ => account.healths.iter().flatten().try_for_each(|health| {
            let Some(service) = Service::from_number(health.service as u16) else { return Ok(()) };
            let value = match name {
                "pursuit_answered_total" => health.answered as f64,
                "pursuit_skipped_total" => health.skipped as f64,
                _ => health.time_ns as f64 / 1e9,
            };
            writeln!(text, "{name}{{service=\"{}\"}} {value}", service.name())
        }),
    };
}

fn summary(text: &mut String, name: &str, label: &str, histogram: &Histogram) {
    let comma = if label.is_empty() { "" } else { "," };
    for quantile in ["0.5", "0.9", "0.99", "0.999"] {
        let seconds = histogram.quantile_ns(quantile.parse().unwrap_or(1.0)) as f64 / 1e9;
        let _ = writeln!(text, "{name}{{{label}{comma}quantile=\"{quantile}\"}} {seconds}");
    }
    let braces = if label.is_empty() { String::new() } else { format!("{{{label}}}") };
    let _ = writeln!(text, "{name}_sum{braces} {}", histogram.sum_ns() as f64 / 1e9);
    let _ = writeln!(text, "{name}_count{braces} {}", histogram.total());
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_line_is_a_comment_or_a_name_with_a_number() {
        let mut account = Account::new(true);
        account.latency.end_to_end.take(2_000_000);
        let text = exposition(&account);
        for line in text.lines().filter(|line| !line.starts_with('#')) {
            let (name, value) = line.rsplit_once(' ').unwrap();
            assert!(value.parse::<f64>().is_ok(), "{line}");
            let base = name.split('{').next().unwrap().trim_end_matches("_sum").trim_end_matches("_count");
            assert!(METRICS.iter().any(|metric| metric.0 == base), "{line}");
        }
        assert!(text.contains("pursuit_end_to_end_seconds{quantile=\"0.5\"} 0.002\n"), "{text}");
        assert!(text.contains("pursuit_hop_wait_seconds_count{hop=\"vision\"} 0\n"), "{text}");
    }

    #[test]
    fn the_dashboard_is_json_and_names_only_metrics_that_exist() {
        let text = include_str!("../../../ops/grafana.json");
        let dashboard: serde_json::Value = serde_json::from_str(text).unwrap();
        assert!(!dashboard["panels"].as_array().unwrap().is_empty());
        let words = text.split(|c: char| !c.is_ascii_alphanumeric() && c != '_');
        let named: Vec<&str> = words.filter(|word| word.starts_with("pursuit_")).collect();
        assert!(named.len() > 4, "{named:?}");
        for name in named {
            assert!(METRICS.iter().any(|metric| metric.0 == name), "no metric is called {name}");
        }
    }
}
