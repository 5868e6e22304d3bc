//! The clock in lock-step: no frame is passed over, none is answered twice.

use crate::cell::{Cell, Fixed};
use crate::config::Config;
use crate::journal::{MAX_ENDLESS_BYTES, MoveRecord, Record};
use pursuit_bus::{Publisher, Subscriber, wait};
use pursuit_messages::topics::{LearnerStates, MAX_BASELINE, WorldCommands, WorldStates};
use pursuit_messages::{LearnerState, Stamp, WorldCommand, WorldState};
use pursuit_runtime::checkpoint::Checkpoint;
use pursuit_runtime::clock::monotonic_ns;
use pursuit_runtime::settings::Pace;
use pursuit_runtime::{ServiceError, Station, TICK, place};
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;
use std::fs::File;
use std::io::{Seek, SeekFrom, Write};

/// Time after which an unanswered frame is asked for again, ns. An answer takes some ms; a loaded
/// machine may be slow, and a frame asked for twice is answered twice, the same way.
const ASK_AGAIN_NS: u64 = 100_000_000;
/// Frames that are shown before one that is asked for again: the rest of vision's pair.
const SHOWN_AGAIN: usize = MAX_BASELINE as usize;
/// Lock-step epochs have no start time: the same run has the same epoch.
const EPOCH: u64 = 1;
/// Version of what is checkpointed.
const SCHEMA: u32 = 3;
/// Room for a checkpoint; a cell takes about 20 kB.
const CHECKPOINT_BYTES: usize = 1 << 18;

/// A run between two frames: what is checkpointed.
#[derive(Serialize, Deserialize)]
struct Saved<C> {
    cell: C,
    /// Lengths of journal and move list, bytes: what was written after the checkpoint is cut off again.
    journal_bytes: u64,
    moves_bytes: u64,
}

/// Runs until stopped or finished.
pub fn run(mut station: Station, config: &Config) -> Result<(), ServiceError> {
    let fixed = Fixed::new(&config.cell).map_err(other)?;
    let (mut log, mut cell) = Log::open(&station, &fixed, config.cell.frames == 0)?;
    let worlds = station.bus.publisher(WorldStates)?;
    let commands = station.bus.subscriber(WorldCommands)?;
    let learner = station.bus.subscriber(LearnerStates)?;
    let anchor_ns = monotonic_ns().saturating_sub(cell.time_ns);
    let mut before: VecDeque<Question> = VecDeque::with_capacity(SHOWN_AGAIN + 1);
    while !cell.is_finished(&fixed) {
        let question = Question::of(&cell, &fixed, config);
        let ports = (&worlds, &commands, &learner);
        let Some((stamp, command, state)) = ask(&mut station, &question, &before, ports)? else {
            return Ok(());
        };
        before.push_back(question);
        if before.len() > SHOWN_AGAIN {
            before.pop_front();
        }
        let (mut record, finished_move) =
            cell.take(&fixed, cell.frame, &command, Some(&state)).map_err(other)?;
        record.take_times(&stamp);
        station.answered(cell.frame);
        let next_ns = cell.time_ns + config.cell.frame_period_ns;
        cell.advance(&fixed, next_ns).map_err(other)?;
        cell.frame += 1;
        log.write(&cell, &record, finished_move)?;
        if config.run.pace == Pace::Real && !station.sleep_until(anchor_ns + next_ns) {
            return Ok(());
        }
    }
    std::fs::write(station.directory().join(place::TRAJECTORY), cell.trajectory_sha256())
        .map_err(|e| ServiceError::Other(format!("cannot write the trajectory's hash: {e}")))?;
    Ok(())
}

type Ports<'a> = (&'a Publisher<WorldStates>, &'a Subscriber<WorldCommands>, &'a Subscriber<LearnerStates>);

/// A frame that is to be answered.
struct Question {
    stamp: Stamp,
    state: WorldState,
}

impl Question {
    fn of(cell: &Cell, fixed: &Fixed, config: &Config) -> Question {
        let stamp = Stamp::new(EPOCH, cell.frame, cell.time_ns, config.camera.shape());
        Question { stamp, state: cell.state(fixed) }
    }
}

/// Publishes the present frame's world and waits for its command, asking again from time to time; the
/// learner's state after that frame comes with it. `None` when the service shall stop.
///
/// Who asks again shows the frames before first: a restarted vision needs them.
fn ask(
    station: &mut Station,
    question: &Question,
    before: &VecDeque<Question>,
    (worlds, commands, learner): Ports<'_>,
) -> Result<Option<(Stamp, WorldCommand, LearnerState)>, ServiceError> {
    let mut asked_ns = 0;
    let mut answer = None;
    while station.turn() {
        let now = monotonic_ns();
        if now >= asked_ns + ASK_AGAIN_NS {
            for before in before.iter().filter(|_| asked_ns > 0) {
                worlds.publish(&before.stamp, &before.state)?;
            }
            asked_ns = now;
            worlds.publish(&question.stamp, &question.state)?;
        } else {
            worlds.greet_new_readers();
        }
        wait(&[commands], TICK)?;
        while let Some(message) = commands.receive()? {
            if message.stamp().trace_id == question.stamp.trace_id {
                answer = Some((*message.stamp(), *message.payload()));
            }
        }
        // A restarted simulator may get the command before the state: then it is asked for again.
        if let Some((stamp, command)) = answer
            && let Some(state) = newest_state(learner, &question.stamp)?
        {
            return Ok(Some((stamp, command, state)));
        }
    }
    Ok(None)
}

/// The learner's state for that frame: it is published before the set-point, so it is there.
fn newest_state(
    learner: &Subscriber<LearnerStates>,
    stamp: &Stamp,
) -> Result<Option<LearnerState>, ServiceError> {
    let newest = learner.newest()?;
    Ok(newest.filter(|(message, _)| message.stamp().trace_id == stamp.trace_id).map(|(m, _)| *m.payload()))
}

/// Journal, move list and checkpoint of a run.
struct Log {
    checkpoint: Checkpoint,
    journal: File,
    moves: File,
    journal_bytes: u64,
    moves_bytes: u64,
    endless: bool,
    line: String,
}

impl Log {
    /// Opens the files of a run; where there is a checkpoint the run goes on from it.
    fn open(station: &Station, fixed: &Fixed, endless: bool) -> Result<(Log, Cell), ServiceError> {
        let folder = station.directory();
        let (checkpoint, bytes) = Checkpoint::open(&station.checkpoint_file(), SCHEMA, CHECKPOINT_BYTES)?;
        let saved: Option<Saved<Cell>> = bytes.and_then(|bytes| postcard::from_bytes(&bytes).ok());
        let open = |name: &str| {
            File::options().create(true).truncate(false).write(true).open(folder.join(name)).map_err(|e| {
                ServiceError::Other(format!("cannot write {}: {e}", folder.join(name).display()))
            })
        };
        let (journal, moves) = (open(place::JOURNAL)?, open(place::MOVES)?);
        let mut log = Log {
            checkpoint,
            journal,
            moves,
            journal_bytes: 0,
            moves_bytes: 0,
            endless,
            line: String::with_capacity(1024),
        };
        match saved {
            Some(saved) => {
                tracing::info!(frame = saved.cell.frame, "going on from the checkpoint");
                (log.journal_bytes, log.moves_bytes) = (saved.journal_bytes, saved.moves_bytes);
                log.cut()?;
                Ok((log, saved.cell))
            }
            None => {
                log.cut()?;
                let cell = Cell::new(fixed).map_err(other)?;
                log.journal_bytes += append(&mut log.journal, &Record::header())?;
                log.moves_bytes += append(&mut log.moves, MoveRecord::header())?;
                Ok((log, cell))
            }
        }
    }

    fn cut(&mut self) -> Result<(), ServiceError> {
        for (file, bytes) in [(&mut self.journal, self.journal_bytes), (&mut self.moves, self.moves_bytes)] {
            file.set_len(bytes).and_then(|()| file.seek(SeekFrom::End(0))).map_err(other)?;
        }
        Ok(())
    }

    /// Writes down a frame and then the checkpoint behind it.
    fn write(&mut self, cell: &Cell, record: &Record, moved: Option<MoveRecord>) -> Result<(), ServiceError> {
        self.line.clear();
        if self.endless && self.journal_bytes > MAX_ENDLESS_BYTES {
            self.journal_bytes = 0;
            self.cut()?;
            self.line.push_str(&Record::header());
        }
        record.write(&mut self.line);
        self.journal_bytes += append(&mut self.journal, &self.line)?;
        if let Some(moved) = moved {
            self.line.clear();
            moved.write(&mut self.line);
            self.moves_bytes += append(&mut self.moves, &self.line)?;
        }
        let saved = Saved { cell, journal_bytes: self.journal_bytes, moves_bytes: self.moves_bytes };
        self.checkpoint.save_value(&saved)?;
        Ok(())
    }
}

fn append(file: &mut File, text: &str) -> Result<u64, ServiceError> {
    file.write_all(text.as_bytes())
        .map_err(|e| ServiceError::Other(format!("cannot write the run's journal (disk full?): {e}")))?;
    Ok(text.len() as u64)
}

fn other(error: impl std::fmt::Display) -> ServiceError {
    ServiceError::Other(error.to_string())
}
