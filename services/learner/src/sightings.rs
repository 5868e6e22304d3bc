//! What is seen of a training target during a move, kept until the move has ended.

use pursuit_learning::View;
use pursuit_learning::consensus::{Sighting, keep_agreeing};
use serde::{Deserialize, Serialize};

/// Sightings of one move that are kept: 5 s at 25 Hz, longer than any move.
const MOST: usize = 128;

/// The sightings of the move under way, in the order of time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Sightings {
    list: Vec<Sighting>,
    /// When the first of them was, if that is what was seen at rest before the move, ns.
    rest_ns: Option<u64>,
}

impl Default for Sightings {
    fn default() -> Sightings {
        Sightings { list: Vec::with_capacity(MOST), rest_ns: None }
    }
}

impl Sightings {
    /// A move begins, with what was seen at rest before it.
    pub(crate) fn begin(&mut self, at_rest: Option<Sighting>) {
        self.list.clear();
        self.list.extend(at_rest);
        self.rest_ns = at_rest.map(|sighting| sighting.time_ns);
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

    /// Drops what does not agree with its neighbours: how many there were, and how many were dropped.
    pub(crate) fn keep_agreeing(&mut self, half_width_px: f64) -> (usize, usize) {
        let seen = self.list.len();
        (seen, keep_agreeing(&mut self.list, half_width_px))
    }

    /// What was seen at rest before the move, if that is still in the list.
    pub(crate) fn at_rest(&self) -> Option<View> {
        self.list.first().filter(|first| self.rest_ns == Some(first.time_ns)).map(|first| first.view)
    }

    /// The others.
    pub(crate) fn while_moving(&self) -> &[Sighting] {
        &self.list[usize::from(self.at_rest().is_some())..]
    }
}
