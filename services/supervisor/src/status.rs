//! What is told about a service.

use serde::{Deserialize, Serialize};

/// One service as `pursuit status` shows it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ServiceStatus {
    /// Its name.
    pub service: String,
    /// Its process, where it has one.
    pub pid: Option<u32>,
    /// What it is doing.
    pub state: State,
    /// How often it was started again.
    pub restarts: u32,
    /// Age of its last heartbeat, ms.
    pub last_beat_ms: Option<u64>,
    /// Frames answered by the present process.
    pub answered: u64,
    /// Frames passed over by the present process.
    pub skipped: u64,
}

/// What a service is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum State {
    /// Its process was started, no heartbeat yet.
    Starting,
    /// Its heart beats.
    Running,
    /// Its heart beats, but it has no input (a camera that vanished).
    NoInput,
    /// It died and will be started again.
    Restarting,
    /// It was asked to end.
    Stopping,
    /// It has ended.
    Ended,
    /// It died too often.
    GivenUp,
}

impl State {
    /// The word for it.
    pub fn word(self) -> &'static str {
        match self {
            State::Starting => "starting",
            State::Running => "running",
            State::NoInput => "no input",
            State::Restarting => "restarting",
            State::Stopping => "stopping",
            State::Ended => "ended",
            State::GivenUp => "given up",
        }
    }
}

/// The table that `pursuit status` prints.
pub fn table(services: &[ServiceStatus]) -> String {
    let mut text = format!(
        "{:<13} {:>8} {:<11} {:>8} {:>10} {:>10} {:>8}\n",
        "service", "pid", "state", "restarts", "last beat", "answered", "skipped"
    );
    for s in services {
        let pid = s.pid.map_or_else(|| "-".to_owned(), |pid| pid.to_string());
        let beat = s.last_beat_ms.map_or_else(|| "-".to_owned(), |ms| format!("{ms} ms"));
        text.push_str(&format!(
            "{:<13} {:>8} {:<11} {:>8} {:>10} {:>10} {:>8}\n",
            s.service,
            pid,
            s.state.word(),
            s.restarts,
            beat,
            s.answered,
            s.skipped
        ));
    }
    text
}
