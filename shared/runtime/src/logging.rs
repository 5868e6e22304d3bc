//! Logs: state changes with fields on standard error.

use tracing_subscriber::filter::LevelFilter;

/// Starts logging to standard error, at `PURSUIT_LOG` (error, warn, info, debug, trace; `info` where it
/// is not set). Later calls do nothing.
pub fn start() {
    let level = std::env::var("PURSUIT_LOG")
        .ok()
        .and_then(|text| text.parse::<LevelFilter>().ok())
        .unwrap_or(LevelFilter::INFO);
    let _ = tracing_subscriber::fmt()
        .with_max_level(level)
        .with_writer(std::io::stderr)
        .with_ansi(false)
        .without_time()
        .with_target(false)
        .try_init();
}
