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
    /// Whether a former supervisor had started it.
    #[serde(default)]
    pub adopted: bool,
    /// How its process before this one ended, where nobody had asked it to.
    #[serde(default)]
    pub last_end: Option<String>,
    /// Messages that the present process has refused.
    #[serde(default)]
    pub refused: u64,
    /// What it lacks, in words; empty where nothing.
    #[serde(default)]
    pub lack: Option<String>,
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
    /// Its heart does not beat, and it does not hang: it gets no core, or waits for a disk.
    Late,
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
            State::Late => "late",
            State::Restarting => "restarting",
            State::Stopping => "stopping",
            State::Ended => "ended",
            State::GivenUp => "given up",
        }
    }
}

/// The table that `pursuit status` prints.
pub fn table(services: &[ServiceStatus]) -> String {
    let line = |words: [&str; 9]| {
        let [service, pid, state, restarts, beat, answered, skipped, refused, note] = words;
        let line = format!(
            "{service:<13} {pid:>8} {state:<11} {restarts:>8} {beat:>10} {answered:>10} {skipped:>8} {refused:>8}  {note}"
        );
        line.trim_end().to_owned() + "\n"
    };
    let head = ["service", "pid", "state", "restarts", "last beat", "answered", "skipped", "refused", ""];
    let mut text = line(head);
    for s in services {
        let pid = s.pid.map_or_else(|| "-".to_owned(), |pid| pid.to_string());
        let beat = s.last_beat_ms.map_or_else(|| "-".to_owned(), |ms| format!("{ms} ms"));
        text += &line([
            &s.service,
            &pid,
            s.state.word(),
            &s.restarts.to_string(),
            &beat,
            &s.answered.to_string(),
            &s.skipped.to_string(),
            &s.refused.to_string(),
            &note(s),
        ]);
    }
    text
}

/// What else there is to say.
fn note(status: &ServiceStatus) -> String {
    let lack = status.lack.clone().filter(|lack| !lack.is_empty());
    let before = status.last_end.as_ref().map(|end| format!("before: {end}"));
    let adopted = status.adopted.then(|| "adopted".to_owned());
    [lack, before, adopted].into_iter().flatten().collect::<Vec<_>>().join("; ")
}
