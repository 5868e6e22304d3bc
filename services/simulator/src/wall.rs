//! The world on the wall clock: a tick each drive cycle, an exposure each frame period, nobody is waited for.

use crate::cell::{Cell, Fixed};
use crate::config::{CYCLE_NS, Config};
use crate::journal::{MAX_ENDLESS_BYTES, Record};
use pursuit_bus::wait;
use pursuit_messages::Stamp;
use pursuit_messages::topics::{LearnerStates, WorldCommands, WorldStates};
use pursuit_runtime::clock::{monotonic_ns, sleep_until_ns};
use pursuit_runtime::{ServiceError, Station, place};
use std::io::Write;
use std::time::Duration;

/// A world that is later than this does not hurry after the clock: it takes the time as it is.
const RE_ANCHOR_NS: u64 = 20_000_000;

/// Runs until stopped or finished.
pub fn run(mut station: Station, config: &Config) -> Result<(), ServiceError> {
    let fixed = Fixed::new(&config.cell).map_err(other)?;
    let mut cell = Cell::new(&fixed).map_err(other)?;
    let worlds = station.bus.publisher(WorldStates)?;
    let commands = station.bus.subscriber(WorldCommands)?;
    let learner = station.bus.subscriber(LearnerStates)?;
    let mut journal = create(&station, place::JOURNAL, &Record::header())?;
    let mut moves = create(&station, place::MOVES, crate::journal::MoveRecord::header())?;
    let epoch = monotonic_ns();
    let mut anchor_ns = epoch;
    let cycles_per_frame = (config.cell.frame_period_ns / CYCLE_NS).max(1);
    let mut tick: u64 = 0;
    let mut last_written = None;
    let mut written = 0;
    let mut state_of_learner = None;
    let mut line = String::with_capacity(1024);
    while station.turn() && !cell.is_finished(&fixed) {
        let exposes = tick.is_multiple_of(cycles_per_frame);
        cell.frame = tick / cycles_per_frame;
        let exposure_ns = anchor_ns + cell.frame * config.cell.frame_period_ns;
        let stamp = Stamp::new(epoch, cell.frame, exposure_ns, config.camera.shape());
        let mut state = cell.state(&fixed);
        state.time_ns = anchor_ns + cell.time_ns;
        state.exposes = u32::from(exposes);
        worlds.publish(&stamp, &state)?;

        let next_ns = anchor_ns + cell.time_ns + CYCLE_NS;
        let mut newest = None;
        loop {
            wait(&[&commands], Duration::from_nanos(next_ns.saturating_sub(monotonic_ns())))?;
            if let Some((message, _)) = commands.newest()? {
                newest = Some((*message.stamp(), *message.payload()));
            }
            if let Some((message, _)) = learner.newest()? {
                state_of_learner = Some(*message.payload());
            }
            if monotonic_ns() >= next_ns {
                break;
            }
        }
        if let Some((stamp, command)) = newest {
            let (mut record, moved) =
                cell.take(&fixed, stamp.frame, &command, state_of_learner.as_ref()).map_err(other)?;
            // A line for each frame, and one when the driver begins or ends to refuse.
            if last_written != Some((stamp.frame, command.refusal)) {
                last_written = Some((stamp.frame, command.refusal));
                record.take_times(&stamp);
                line.clear();
                record.write(&mut line);
                written += line.len() as u64;
                if config.cell.frames == 0 && written > MAX_ENDLESS_BYTES {
                    written = 0;
                    journal = create(&station, place::JOURNAL, &Record::header())?;
                }
                journal.write_all(line.as_bytes()).map_err(other)?;
                station.answered(stamp.frame);
            }
            if let Some(moved) = moved {
                line.clear();
                moved.write(&mut line);
                moves.write_all(line.as_bytes()).map_err(other)?;
            }
        }
        sleep_until_ns(next_ns);
        cell.advance(&fixed, cell.time_ns + CYCLE_NS).map_err(other)?;
        tick += 1;
        let late = monotonic_ns().saturating_sub(anchor_ns + cell.time_ns);
        if late > RE_ANCHOR_NS {
            anchor_ns += late;
            station.health.skipped += 1;
        }
    }
    if cell.is_finished(&fixed) {
        std::fs::write(station.directory().join(place::TRAJECTORY), cell.trajectory_sha256())
            .map_err(other)?;
    }
    Ok(())
}

fn create(station: &Station, name: &str, header: &str) -> Result<std::fs::File, ServiceError> {
    let path = station.directory().join(name);
    let mut file =
        std::fs::File::create(&path).map_err(|e| ServiceError::Other(format!("{}: {e}", path.display())))?;
    file.write_all(header.as_bytes()).map_err(other)?;
    Ok(file)
}

fn other(error: impl std::fmt::Display) -> ServiceError {
    ServiceError::Other(error.to_string())
}
