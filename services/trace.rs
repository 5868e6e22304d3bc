//! `pursuit trace`: where the frames' times go in the running system; `pursuit why`: one frame of it.

use crate::cli::Trace;
use crate::{control_of, up};
use pursuit_observer::{observe, summary, timeline};
use pursuit_runtime::{exit, place};
use pursuit_supervisor::control::Request;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::time::Duration;

/// Longest measurement, s.
const LONGEST: f64 = 86_400.0;

/// Runs the verb.
pub fn run(options: &Trace) -> u8 {
    let directory = options.place.directory();
    // Asked for the sentence that it says when nothing runs.
    if let Err(code) = control_of(&directory, &Request::Status) {
        return code;
    }
    if !(options.seconds > 0.0 && options.seconds <= LONGEST) {
        eprintln!("pursuit trace: --seconds must be above 0 and at most {LONGEST}");
        return exit::DO_NOT_RESTART;
    }
    let account = match observe(&directory, Duration::from_secs_f64(options.seconds)) {
        Ok(account) => account,
        Err(error) => {
            eprintln!("pursuit trace: {error}");
            return error.exit_code();
        }
    };
    let mut code = exit::OK;
    if let Some(file) = &options.out {
        code = code.max(up::write_json(file, &timeline::of(&account.latency)));
    }
    if let Some(file) = &options.json {
        code = code.max(up::write_json(file, &summary::json(&account)));
    }
    if options.json.as_deref() != Some(Path::new("-")) {
        let _ = std::io::stdout().write_all(summary::text(&account).as_bytes());
    }
    code
}

/// The observer answers at once, or not at all.
const PATIENCE: Duration = Duration::from_secs(5);

/// `pursuit why FRAME`: asks the observer what it remembers of a frame.
pub fn why(frame: u64, directory: &Path) -> u8 {
    if let Err(code) = control_of(directory, &Request::Status) {
        return code;
    }
    match ask(directory, frame) {
        Ok(page) if page.starts_with("frame ") && !page.contains("is not remembered") => {
            let _ = std::io::stdout().write_all(page.as_bytes());
            exit::OK
        }
        Ok(page) => {
            eprint!("pursuit why: {page}");
            exit::FAILED
        }
        Err(error) => {
            eprintln!(
                "pursuit why: the observer does not answer ({error}): it needs observer.start and observer.metrics in the config"
            );
            exit::FAILED
        }
    }
}

fn ask(directory: &Path, frame: u64) -> std::io::Result<String> {
    let address = std::fs::read_to_string(directory.join(place::OBSERVER))?;
    let address = address.trim();
    let mut stream = TcpStream::connect(address)?;
    stream.set_read_timeout(Some(PATIENCE))?;
    write!(stream, "GET /frames/{frame} HTTP/1.1\r\nHost: {address}\r\n\r\n")?;
    let mut answer = String::new();
    stream.read_to_string(&mut answer)?;
    Ok(answer.split_once("\r\n\r\n").map(|(_, page)| page.to_owned()).unwrap_or_default())
}
