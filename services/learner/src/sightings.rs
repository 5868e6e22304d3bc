//! What is seen of a training target during a move, kept until the move has ended.

use pursuit_learning::consensus::Sighting;
use serde::{Deserialize, Serialize};

/// Sightings of one move that are kept: 5 s at 25 Hz, longer than any move.
const MOST: usize = 128;

/// The sightings of the move under way, in the order of time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Sightings {
    list: Vec<Sighting>,
    /// Whether the first of them is what was seen at rest before the move.
    pub(crate) begins_at_rest: bool,
}

impl Default for Sightings {
    fn default() -> Sightings {
        Sightings { list: Vec::with_capacity(MOST), begins_at_rest: false }
    }
}

impl Sightings {
    /// A move begins, with what was seen at rest before it.
    pub(crate) fn begin(&mut self, start: Option<Sighting>) {
        self.list.clear();
        self.list.extend(start);
        self.begins_at_rest = start.is_some();
    }

    pub(crate) fn clear(&mut self) {
        self.begin(None);
    }

    /// No allocation: what is beyond the room is not kept.
    pub(crate) fn push(&mut self, sighting: Sighting) {
        if self.list.len() < MOST {
            self.list.push(sighting);
        }
    }

    pub(crate) fn as_slice(&self) -> &[Sighting] {
        &self.list
    }
}
