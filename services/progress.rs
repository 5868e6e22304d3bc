//! The line that lives while a run goes on.

use pursuit_messages::Phase;
use pursuit_runtime::place;
use pursuit_simulator::journal::{MoveRecord, Record};
use pursuit_supervisor::Glance;
use std::fs::File;
use std::io::{IsTerminal, Read, Seek, SeekFrom, Write};
use std::path::Path;
use std::time::Instant;

/// Cells of the bar.
const BAR: usize = 24;

/// Follows the journal of a run and shows on standard error how far it is.
pub struct Progress {
    shows: bool,
    training_moves: u32,
    frames: u64,
    started: Instant,
    first_frame: Option<Instant>,
    journal: Tail,
    moves: Tail,
    last: Option<Record>,
    last_move: Option<MoveRecord>,
    tracked: u64,
    last_phase: Option<u32>,
}

impl Progress {
    /// Progress of a run of so many training moves and tracking frames (0: no end).
    pub fn new(training_moves: u32, frames: u64) -> Progress {
        Progress {
            shows: std::io::stderr().is_terminal(),
            training_moves,
            frames,
            started: Instant::now(),
            first_frame: None,
            journal: Tail::default(),
            moves: Tail::default(),
            last: None,
            last_move: None,
            tracked: 0,
            last_phase: None,
        }
    }

    /// When the first frame was answered.
    pub fn first_frame(&self) -> Option<Instant> {
        self.first_frame
    }

    /// Looks at the run, and shows it.
    pub fn look(&mut self, glance: &Glance<'_>) {
        for line in self.journal.new_lines(&glance.directory.join(place::JOURNAL)) {
            if let Some(record) = Record::parse(&line) {
                self.first_frame.get_or_insert_with(Instant::now);
                self.tracked += u64::from(record.phase == Phase::Tracking as u32);
                self.last = Some(record);
            }
        }
        for line in self.moves.new_lines(&glance.directory.join(place::MOVES)) {
            self.last_move = MoveRecord::parse(&line).or(self.last_move);
        }
        let text = self.line(glance);
        let phase = self.last.map(|record| record.phase);
        if self.shows {
            show(&format!("\r\x1b[2K{text}"));
        } else if phase != self.last_phase {
            // Not a terminal: a line for each change of phase is enough.
            show(&format!("{text}\n"));
        }
        self.last_phase = phase;
    }

    /// Leaves the line.
    pub fn done(&self) {
        if self.shows {
            show("\n");
        }
    }

    fn line(&self, glance: &Glance<'_>) -> String {
        let running = glance.services.iter().filter(|s| s.last_beat_ms.is_some()).count();
        let restarts: u32 = glance.services.iter().map(|s| s.restarts).sum();
        let Some(record) = &self.last else {
            let seconds = self.started.elapsed().as_secs_f64();
            return format!("starting   {running} of {} services, {seconds:.1} s", glance.services.len());
        };
        let mut text = match Phase::from_number(record.phase) {
            Some(Phase::Training) | None => {
                let error = self
                    .last_move
                    .map_or("untrained".to_owned(), |m| format!("aims within {:.1} cm", m.error_cm));
                let share = f64::from(record.moves) / f64::from(self.training_moves.max(1));
                format!("learning   {} move {:>2}/{}  {error}", bar(share), record.moves, self.training_moves)
            }
            Some(Phase::Homing) => "homing     on the way to where following begins".to_owned(),
            Some(Phase::Tracking) => {
                let of = if self.frames > 0 { format!("/{}", self.frames) } else { String::new() };
                let share = self.tracked as f64 / self.frames.max(1) as f64;
                let seen = if record.detected == 1 { "vehicle seen" } else { "not seen" };
                format!(
                    "following  {} frame {}{of}  {:.1} cm away, {seen}",
                    bar(share),
                    self.tracked,
                    record.error_cm()
                )
            }
        };
        if restarts > 0 {
            text.push_str(&format!("  ({restarts} restarts)"));
        }
        text
    }
}

/// Whoever looked may have gone: that is no reason to end.
fn show(text: &str) {
    let mut out = std::io::stderr().lock();
    let _ = out.write_all(text.as_bytes()).and_then(|()| out.flush());
}

fn bar(share: f64) -> String {
    let full = ((share.clamp(0.0, 1.0)) * BAR as f64).round() as usize;
    format!("[{}{}]", "#".repeat(full), ".".repeat(BAR - full))
}

/// Whole lines that were appended to a file since the last look.
#[derive(Default)]
struct Tail {
    offset: u64,
}

impl Tail {
    fn new_lines(&mut self, path: &Path) -> Vec<String> {
        let Ok(mut file) = File::open(path) else { return Vec::new() };
        let mut text = String::new();
        if file.metadata().is_ok_and(|meta| meta.len() < self.offset) {
            self.offset = 0;
        }
        if file.seek(SeekFrom::Start(self.offset)).is_err() || file.read_to_string(&mut text).is_err() {
            return Vec::new();
        }
        let whole = text.rfind('\n').map_or(0, |end| end + 1);
        self.offset += whole as u64;
        text[..whole].lines().map(str::to_owned).collect()
    }
}
