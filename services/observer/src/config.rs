//! Section `[observer]`.

use pursuit_config::Checker;
use pursuit_runtime::settings::{self, Clock, Pace};
use std::net::SocketAddr;
use std::time::Duration;

/// What the observer needs.
#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    /// Section `[run]`.
    pub run: settings::Run,
    /// Section `[camera]`.
    pub camera: settings::Camera,
    /// When `pursuit up` starts it.
    pub start: Start,
    /// Where metrics are served; `None` for nowhere.
    pub metrics: Option<SocketAddr>,
    /// The collector that frames are told to as traces; `None` for none.
    pub otlp: Option<String>,
    /// Each so many-th frame is told.
    pub otlp_every: u64,
}

/// When `pursuit up` starts the observer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Start {
    /// Where somebody can follow: not in lock-step at a free pace.
    RealTime,
    /// Always.
    Always,
    /// Never.
    Never,
}

/// Where metrics are served by default; the port that exporters of this kind have by custom.
const METRICS: &str = "127.0.0.1:9464";
/// The observer never sleeps longer between two looks.
const LONGEST_LOOK: Duration = Duration::from_millis(10);
/// Nor shorter: looking costs some µs.
const SHORTEST_LOOK: Duration = Duration::from_millis(1);

impl Config {
    /// Reads the sections; faults go to the checker.
    pub fn read(checker: &Checker<'_>) -> Config {
        let run = settings::Run::read(checker);
        let camera = settings::Camera::read(checker);
        let section = checker.section("observer");
        let starts = [("real-time", Start::RealTime), ("always", Start::Always), ("never", Start::Never)];
        let start = section.choice_or("start", &starts, Start::RealTime);
        let address = section.text_or("metrics", METRICS);
        let metrics = address.parse().ok().filter(|address: &SocketAddr| address.ip().is_loopback());
        if metrics.is_none() && !address.is_empty() {
            section.fault(
                "metrics",
                format!("must be an address of this machine alone, as {METRICS}, or empty, is {address:?}"),
            );
        }
        let otlp = section.text_or("otlp", "");
        if !otlp.is_empty() && !otlp.starts_with("http://") {
            section.fault("otlp", format!("must be as http://127.0.0.1:4318, or empty, is {otlp:?}"));
        }
        let otlp = Some(otlp).filter(|otlp| !otlp.is_empty());
        let otlp_every = section.integer_or("otlp_every", 1..=1_000_000, 1);
        Config { run, camera, start, metrics, otlp, otlp_every }
    }

    /// Whether `pursuit up` starts it.
    pub fn is_started(&self) -> bool {
        match self.start {
            Start::Always => true,
            Start::Never => false,
            Start::RealTime => self.run.clock == Clock::Wall || self.run.pace == Pace::Real,
        }
    }

    /// Time from one look at the topics to the next: half a frame's, so that no topic overflows before it is
    /// looked at.
    pub fn look(&self) -> Duration {
        (Duration::from_nanos(self.camera.period_ns()) / 2).clamp(SHORTEST_LOOK, LONGEST_LOOK)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pursuit_config::{Document, Scope};

    fn config(run: &str) -> Config {
        let text = format!("[run]\nseed = 1\n{run}\n[camera]\nwidth = 64\nheight = 64\nrate_hz = 400.0\n");
        let document = Document::parse("test.toml", &text).unwrap();
        let checker = Checker::new(&document);
        let config = Config::read(&checker);
        checker.finish(Scope::ReadKeys).unwrap();
        config
    }

    #[test]
    fn it_is_not_started_where_nobody_can_follow() {
        assert!(!config("clock = \"lockstep\"").is_started());
        assert!(config("clock = \"lockstep\"\npace = \"real\"").is_started());
        assert!(config("clock = \"wall\"").is_started());
        assert!(config("clock = \"lockstep\"\n[observer]\nstart = \"always\"").is_started());
        assert!(!config("clock = \"wall\"\n[observer]\nstart = \"never\"").is_started());
    }

    #[test]
    fn it_looks_more_often_than_a_frame_comes() {
        assert_eq!(config("clock = \"wall\"").look(), Duration::from_micros(1250));
    }
}
