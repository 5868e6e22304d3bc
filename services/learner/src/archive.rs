//! What was learnt, on a disk: it outlives the run and the machine (`learner.keep`).
//!
//! Two files: the state, in two slots with checksums, put on the disk twice a second by a thread of its own; and
//! `learner.json`, the same for people, which nothing reads back.

use crate::section::Config;
use crate::step::Learner;
use crate::{CHECKPOINT_BYTES, SCHEMA, usable};
use pursuit_messages::LearnerState;
use pursuit_runtime::ServiceError;
use pursuit_runtime::checkpoint::keeper::{Keeper, PERIOD, Vault};
use pursuit_runtime::checkpoint::{Checkpoint, refused_name};
use serde_json::{Value, json};
use std::path::Path;

/// The state.
const STATE: &str = "learner.state";
/// The same for people.
const READABLE: &str = "learner.json";

/// What was kept, and who keeps it from now on; neither where nothing is to be kept.
///
/// # Errors
/// The folder cannot be used, or another process keeps its state there.
pub(crate) fn open(
    config: &Config,
    checkpoint: &mut Checkpoint,
) -> Result<(Option<Vec<u8>>, Option<Keeper>), ServiceError> {
    let Some(folder) = &config.keep else { return Ok((None, None)) };
    let file = folder.join(STATE);
    let (vault, mut restored) = Vault::open(&file, SCHEMA, CHECKPOINT_BYTES)?;
    if let Some(Err(why)) = restored.state.as_deref().map(|state| usable(state, &config.parameters)) {
        // It is somebody's, if not ours: it is not written over.
        let kept = refused_name(&file);
        std::fs::copy(&file, &kept)
            .map_err(|e| ServiceError::Other(format!("{} cannot be kept: {e}", file.display())))?;
        tracing::warn!("what was learnt before {why}; kept as {}; starting untrained", kept.display());
        restored.state = None;
    }
    checkpoint.number_from(restored.sequence);
    let (parameters, readable) = (config.parameters, folder.join(READABLE));
    let tell = move |state: &[u8]| {
        if let Ok(saved) = usable(state, &parameters) {
            write_readable(&readable, &saved.learner);
        }
    };
    let keeper = Keeper::start(checkpoint, vault, PERIOD, tell)
        .map_err(|e| ServiceError::Other(format!("no thread to keep the state: {e}")))?;
    Ok((restored.state, Some(keeper)))
}

/// Aside and then in its place: who reads it reads a whole one. One that cannot be written is no loss.
fn write_readable(path: &Path, learner: &Learner) {
    let aside = path.with_extension("json.new");
    let text = serde_json::to_string_pretty(&readable(&learner.report())).unwrap_or_default();
    let _ = std::fs::write(&aside, text + "\n").and_then(|()| std::fs::rename(&aside, path));
}

fn readable(state: &LearnerState) -> Value {
    let weights = &state.weights[..(state.weight_count as usize).min(state.weights.len())];
    json!({
        "moves": state.moves,
        "samples": state.samples,
        "ring": state.ring,
        "version": state.version,
        "refits": { "merged": state.refits_merged, "rejected": state.refits_rejected },
        "loss": state.loss,
        "changes": state.changes,
        "clock_offset_ms": state.clock_offset_ns as f64 * 1e-6,
        "lead_ms": state.lead_ns as f64 * 1e-6,
        "refused": crate::refusals::Refused::ALL
            .map(|(reason, words)| (words, state.refused[reason as usize]))
            .into_iter()
            .collect::<std::collections::BTreeMap<_, _>>(),
        "hidden_units": state.hidden,
        "weights": weights,
    })
}
