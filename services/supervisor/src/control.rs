//! The control socket: one JSON line for a question, one for its answer.

use crate::status::ServiceStatus;
use serde::{Deserialize, Serialize};
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;
use tokio::io::{AsyncBufReadExt, AsyncReadExt, AsyncWriteExt};
use tokio::net::{UnixListener, UnixStream};
use tokio::sync::{mpsc, oneshot};

/// Longest question, bytes.
const MAX_REQUEST: u64 = 4096;
/// A client waits no longer for its answer.
const ANSWER_LIMIT: Duration = Duration::from_secs(30);

/// A question.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "verb", rename_all = "kebab-case")]
pub enum Request {
    /// How are all services?
    Status,
    /// Start a service anew: the new process takes over from the old one.
    Restart {
        /// Its name.
        service: String,
        /// From this program file from now on; without one, from where it is.
        #[serde(default)]
        program: Option<PathBuf>,
    },
    /// End everything.
    Down,
}

/// An answer.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "answer", rename_all = "kebab-case")]
pub enum Answer {
    /// All services.
    Status {
        /// One entry each.
        services: Vec<ServiceStatus>,
    },
    /// It is done.
    Done,
    /// It is not done.
    Refused {
        /// Why.
        why: String,
    },
}

/// The supervisor's side. The socket goes when the run-time directory is swept.
pub struct Control {
    questions: mpsc::Receiver<(Request, oneshot::Sender<Answer>)>,
}

impl Control {
    /// Listens on a socket that only its owner can use.
    ///
    /// # Errors
    /// The file system's reason.
    pub fn listen(path: &Path) -> std::io::Result<Control> {
        use std::os::unix::fs::PermissionsExt;
        let _ = std::fs::remove_file(path);
        let listener = UnixListener::bind(path)?;
        std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o600))?;
        let (asked, questions) = mpsc::channel(8);
        tokio::spawn(async move {
            while let Ok((stream, _)) = listener.accept().await {
                tokio::spawn(serve(stream, asked.clone()));
            }
        });
        Ok(Control { questions })
    }

    /// The next question, and where its answer goes.
    pub async fn next(&mut self) -> Option<(Request, oneshot::Sender<Answer>)> {
        self.questions.recv().await
    }
}

async fn serve(stream: UnixStream, asked: mpsc::Sender<(Request, oneshot::Sender<Answer>)>) {
    let (reader, mut writer) = stream.into_split();
    let mut line = String::new();
    let mut reader = tokio::io::BufReader::new(reader.take(MAX_REQUEST));
    if reader.read_line(&mut line).await.is_err() {
        return;
    }
    let answer = match serde_json::from_str(&line) {
        Ok(request) => {
            let (reply, answer) = oneshot::channel();
            if asked.send((request, reply)).await.is_err() {
                return;
            }
            answer.await.unwrap_or(Answer::Refused { why: "the supervisor is ending".to_owned() })
        }
        Err(error) => Answer::Refused { why: format!("not a request: {error}") },
    };
    if let Ok(mut text) = serde_json::to_vec(&answer) {
        text.push(b'\n');
        let _ = writer.write_all(&text).await;
    }
}

/// Asks the supervisor whose socket this is.
///
/// # Errors
/// No supervisor there, or no answer.
pub fn ask(socket: &Path, request: &Request) -> std::io::Result<Answer> {
    let mut stream = std::os::unix::net::UnixStream::connect(socket)?;
    stream.set_read_timeout(Some(ANSWER_LIMIT))?;
    let mut text = serde_json::to_vec(request)?;
    text.push(b'\n');
    stream.write_all(&text)?;
    let mut line = String::new();
    BufReader::new(stream).read_line(&mut line)?;
    Ok(serde_json::from_str(&line)?)
}
