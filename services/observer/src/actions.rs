//! What a person may do from the live page: the same as from a terminal, and no more.
//!
//! A stop is a file that the arm driver looks for, a restart is asked of the supervisor; the observer itself moves
//! nothing. Who may ask is [`crate::endpoint`]'s.

use pursuit_messages::Service;
use pursuit_runtime::latch::{Latch, Latches, Wish};
use pursuit_runtime::place;
use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Write};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::time::Duration;

/// The supervisor has so long to answer: a new process has to take over.
const PATIENCE: Duration = Duration::from_secs(30);

/// What can be asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Action {
    /// An emergency stop.
    Stop,
    /// A protective stop.
    Hold,
    /// Out of a stop.
    Reset,
    /// Follow set-points.
    Activate,
    /// A new process for a service.
    Restart(Service),
}

impl Action {
    /// The one that a path asks for.
    pub fn of(path: &str) -> Option<Action> {
        match path.strip_prefix("/do/")? {
            "stop" => Some(Action::Stop),
            "hold" => Some(Action::Hold),
            "reset" => Some(Action::Reset),
            "activate" => Some(Action::Activate),
            other => {
                let service = Service::from_name(other.strip_prefix("restart/")?)?;
                Service::ALL.contains(&service).then_some(Action::Restart(service))
            }
        }
    }

    /// Whether everybody on this machine may: stopping is never wrong.
    pub fn is_free(self) -> bool {
        matches!(self, Action::Stop | Action::Hold)
    }

    /// Does it, in the instance in `directory`.
    ///
    /// # Errors
    /// Why not, for people.
    pub fn done(self, directory: &Path) -> Result<(), String> {
        let latches = || Latches::open(directory).map_err(|error| error.to_string());
        let done = |outcome: std::io::Result<()>| outcome.map_err(|error| error.to_string());
        match self {
            Action::Stop => done(latches()?.latch(Latch::Emergency)),
            Action::Hold => done(latches()?.latch(Latch::Protective)),
            Action::Reset => done(latches()?.wish(Wish::Reset)),
            Action::Activate => done(latches()?.wish(Wish::Activate)),
            Action::Restart(service) => restart(directory, service),
        }
    }
}

/// Asks the supervisor for a restart: a line of JSON, and one for the answer.
fn restart(directory: &Path, service: Service) -> Result<(), String> {
    let ask = || -> std::io::Result<Value> {
        let mut stream = UnixStream::connect(directory.join(place::CONTROL))?;
        stream.set_read_timeout(Some(PATIENCE))?;
        writeln!(stream, "{}", json!({ "verb": "restart", "service": service.name() }))?;
        let mut line = String::new();
        BufReader::new(stream).read_line(&mut line)?;
        Ok(serde_json::from_str(&line)?)
    };
    let answer = ask().map_err(|error| format!("the supervisor does not answer: {error}"))?;
    match answer["answer"].as_str() {
        Some("done") => Ok(()),
        _ => Err(answer["why"].as_str().unwrap_or("the supervisor gives no reason").to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_a_person_may_do_is_an_action() {
        assert_eq!(Action::of("/do/restart/vision"), Some(Action::Restart(Service::Vision)));
        assert_eq!(Action::of("/do/stop"), Some(Action::Stop));
        for path in [
            "/do/",
            "/do/restart",
            "/do/restart/",
            "/do/restart/supervisor",
            "/do/Stop",
            "/stop",
            "/do/stop/",
        ] {
            assert_eq!(Action::of(path), None, "{path}");
        }
        assert!(Action::Stop.is_free() && Action::Hold.is_free());
        assert!(
            !Action::Reset.is_free()
                && !Action::Activate.is_free()
                && !Action::Restart(Service::Vision).is_free()
        );
    }

    #[test]
    fn nobody_there_is_said() {
        let nowhere = Path::new("/nonexistent/pursuit");
        assert!(Action::Restart(Service::Vision).done(nowhere).unwrap_err().contains("supervisor"));
        assert!(Action::Stop.done(nowhere).is_err());
    }
}
