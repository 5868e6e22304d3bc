//! Sequences as files, so that other programs can be run on the same pictures.

use std::path::Path;

use pursuit_images::write_png_grey;
use pursuit_scene::sequences::Truth;
use serde::Serialize;

use super::sweep::{Case, Film, Group};

/// What stands in a sequence's `truth.json`.
#[derive(Serialize)]
struct Sheet {
    name: &'static str,
    group: Group,
    size: usize,
    seed: u64,
    frames: Vec<FrameTruth>,
}

/// What is true of a frame: px and px/frame, to the right and downward.
#[derive(Serialize)]
struct FrameTruth {
    position: Option<[f64; 2]>,
    centre: Option<[f64; 2]>,
    area_px: f64,
    velocity: [f64; 2],
    relative_velocity: [f64; 2],
    background: [f64; 2],
}

/// Writes `folder/NAME-SIZE/f0000.png` and so on, and `truth.json` beside them.
///
/// # Errors
/// In words, what cannot be written and why.
pub fn write(folder: &Path, case: &Case, seed: u64, film: &Film) -> Result<(), String> {
    let name = case.scenario.name;
    let folder = folder.join(format!("{name}-{}", film.size));
    let unwritable = |error: std::io::Error| format!("cannot write {}: {error}", folder.display());
    std::fs::create_dir_all(&folder).map_err(unwritable)?;
    let side = film.size as u32;
    for (t, pixels) in film.frames.iter().enumerate() {
        let file = folder.join(format!("f{t:04}.png"));
        write_png_grey(&file, side, side, pixels).map_err(|error| error.to_string())?;
    }
    let frames = film.truths.iter().map(FrameTruth::from).collect();
    let sheet = Sheet { name, group: case.group, size: film.size, seed, frames };
    let text = serde_json::to_string_pretty(&sheet).map_err(|error| error.to_string())?;
    std::fs::write(folder.join("truth.json"), text + "\n").map_err(unwritable)
}

impl From<&Truth> for FrameTruth {
    fn from(truth: &Truth) -> FrameTruth {
        let &Truth { position, centre, area_px, velocity, relative_velocity, background, .. } = truth;
        FrameTruth { position, centre, area_px, velocity, relative_velocity, background }
    }
}
