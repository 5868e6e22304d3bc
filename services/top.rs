//! `pursuit top`: the running system on one screen, for those on a terminal.

use crate::cli::Top;
use crate::control_of;
use pursuit_observer::account::Account;
use pursuit_observer::{Watch, summary};
use pursuit_runtime::exit;
use pursuit_supervisor::control::{Answer, Request};
use pursuit_supervisor::status::ServiceStatus;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::Write;
use std::path::Path;
use std::time::{Duration, Instant};

/// Allowed times between two screens, s.
const EVERY: std::ops::RangeInclusive<f64> = 0.1..=3600.0;
/// Clears the terminal and begins at its top left.
const CLEAR: &str = "\x1b[H\x1b[2J";

/// Runs the verb; it ends when the system does, or when nobody reads any more.
pub fn run(options: &Top) -> u8 {
    let directory = options.place.directory();
    if !EVERY.contains(&options.every) {
        eprintln!("pursuit top: --every must be {} to {} seconds", EVERY.start(), EVERY.end());
        return exit::DO_NOT_RESTART;
    }
    // Asked first for the sentence that it says when nothing runs.
    let (mut rates, services) = match services_of(&directory) {
        Ok(services) => (Rates::default(), services),
        Err(code) => return code,
    };
    let mut watch = match Watch::join(&directory) {
        Ok(watch) => watch,
        Err(error) => {
            eprintln!("pursuit top: {error}");
            return error.exit_code();
        }
    };
    rates.update(&services, Instant::now());
    loop {
        watch.keep_watching(Duration::from_secs_f64(options.every));
        let services = match services_of(&directory) {
            Ok(services) => services,
            Err(code) => return code,
        };
        let text = screen(&services, &rates.update(&services, Instant::now()), &watch.account);
        let clear = if options.once { "" } else { CLEAR };
        let mut out = std::io::stdout().lock();
        let written = write!(out, "{clear}{text}").and_then(|()| out.flush());
        if options.once || written.is_err() {
            return exit::OK;
        }
    }
}

fn services_of(directory: &Path) -> Result<Vec<ServiceStatus>, u8> {
    match control_of(directory, &Request::Status)? {
        Answer::Status { services } => Ok(services),
        _ => Err(exit::FAILED),
    }
}

/// Frames that each service answers in a second, from two looks at its count.
#[derive(Default)]
struct Rates {
    before: BTreeMap<String, (Instant, u32, u64)>,
}

impl Rates {
    fn update(&mut self, services: &[ServiceStatus], now: Instant) -> Vec<Option<f64>> {
        let rate = |s: &ServiceStatus| {
            let this = (now, s.pid.unwrap_or_default(), s.answered);
            let (then, pid, answered) = self.before.insert(s.service.clone(), this)?;
            let elapsed_s = (now - then).as_secs_f64();
            (pid == this.1 && elapsed_s > 0.0).then(|| s.answered.saturating_sub(answered) as f64 / elapsed_s)
        };
        services.iter().map(rate).collect()
    }
}

fn screen(services: &[ServiceStatus], rates: &[Option<f64>], account: &Account) -> String {
    let mut text = format!(
        "{:<13} {:>8} {:<11} {:>8} {:>10} {:>8}\n",
        "service", "pid", "state", "restarts", "frames/s", "skipped"
    );
    for (s, rate) in services.iter().zip(rates) {
        let pid = s.pid.map_or_else(|| "-".to_owned(), |pid| pid.to_string());
        let rate = rate.map_or_else(|| "-".to_owned(), |rate| format!("{rate:.1}"));
        let (state, restarts) = (s.state.word(), s.restarts);
        let _ = writeln!(
            text,
            "{:<13} {pid:>8} {state:<11} {restarts:>8} {rate:>10} {:>8}",
            s.service, s.skipped
        );
    }
    format!("{text}\n{}\n{}", summary::short(account), summary::now(account))
}

#[cfg(test)]
mod tests {
    use super::*;
    use pursuit_supervisor::status::State;

    #[test]
    fn a_rate_is_of_one_process_only() {
        let of = |pid, answered| ServiceStatus {
            service: "vision".to_owned(),
            pid: Some(pid),
            state: State::Running,
            restarts: 0,
            last_beat_ms: Some(1),
            answered,
            skipped: 0,
            adopted: false,
            last_end: None,
            refused: 0,
            lack: None,
        };
        let (mut rates, start) = (Rates::default(), Instant::now());
        let later = |s| start + Duration::from_secs(s);
        assert_eq!(rates.update(&[of(7, 100)], start), [None]);
        assert_eq!(rates.update(&[of(7, 150)], later(2)), [Some(25.0)]);
        assert_eq!(rates.update(&[of(8, 3)], later(4)), [None], "another process");
        assert_eq!(rates.update(&[of(8, 13)], later(5)), [Some(10.0)]);
    }
}
