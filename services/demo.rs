//! `pursuit demo`, the main job: a simulated robot teaches itself, follows the camouflaged vehicle, reports.

use crate::check;
use crate::cli::{Demo, Up};
use crate::up;
use pursuit_runtime::exit;
use std::path::{Path, PathBuf};

/// Frames of tracking where none are asked for: 60 s of simulated time at 12.5 Hz, almost five rounds.
const FRAMES: u64 = 750;
/// Where the plots go.
const PLOTS: &str = "pursuit-out";
/// Name of the demo's instance: it never meets a running system.
const INSTANCE: &str = "demo";

/// Runs the verb.
pub fn run(options: &Demo) -> u8 {
    eprintln!(
        "pursuit {}: a simulated arm with a camera in its hand. It first teaches itself how its joints move\n\
         the image (nobody calibrates anything), on a white blob; then it follows a vehicle that wears the\n\
         pattern of the table, so that no single image shows it.\n",
        env!("CARGO_PKG_VERSION")
    );
    let up = Up {
        frames: Some(options.frames.unwrap_or(FRAMES)),
        seed: options.seed,
        place: options.place.clone(),
        ..Up::default()
    };
    let document = match document(&up) {
        Ok(document) => document,
        Err(faults) => {
            eprintln!("{faults}");
            return exit::DO_NOT_RESTART;
        }
    };
    let run = match up::run_system(&up, document) {
        Ok(Some(run)) => run,
        Ok(None) => return exit::OK,
        Err(code) => return code,
    };
    println!("\n{}", run.report.text());
    println!("  one-shot error after each move, cm:");
    let errors: Vec<String> =
        run.report.learning.moves.iter().map(|m| format!("{:.1}", m.error_cm)).collect();
    for line in errors.chunks(15) {
        println!("    {}", line.join(" "));
    }
    let plots = options.plots.clone().unwrap_or_else(|| PathBuf::from(PLOTS));
    let code = run.publish(options.json.as_deref(), Some(&plots));
    println!("{}", what_next());
    code
}

fn document(up: &Up) -> Result<pursuit_config::Document, pursuit_config::Faults> {
    let instance = up.place.instance.as_deref().unwrap_or(INSTANCE);
    let mut set =
        vec![format!("simulator.frames={}", up.frames.unwrap_or(FRAMES)), format!("run.instance={instance}")];
    set.extend(up.seed.map(|seed| format!("run.seed={seed}")));
    check::document(None::<&Path>, &set)
}

fn what_next() -> &'static str {
    "\n  next:\n\
     \x20   pursuit up                           the same system until you stop it, in real time, with a live page\n\
     \x20   pursuit status                       its services; kill one and watch it come back\n\
     \x20   pursuit detect tests/data/camouflage --annotate pursuit-out/camouflage\n\
     \x20                                        the detector on a folder of images\n\
     \x20   pursuit experiment tracking          the measured figures over many seeds\n\
     \x20 (pursuit = target/release/pursuit)"
}
