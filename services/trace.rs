//! `pursuit trace`: where the frames' times go in the running system.

use crate::cli::Trace;
use crate::{control_of, up};
use pursuit_observer::{observe, summary, timeline};
use pursuit_runtime::exit;
use pursuit_supervisor::control::Request;
use std::io::Write;
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
