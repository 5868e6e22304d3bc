//! `pursuit record`: everything that travels on the bus of an instance, into one MCAP file.
//!
//! One thread takes messages off the bus and copies them into a bounded queue; another writes. A full queue
//! drops messages and counts them. Nothing here can hold up the loop: every topic overflows.

use crate::cli::Record as Options;
use pursuit_bus::{Bus, Instance};
use pursuit_messages::Stamp;
use pursuit_observer::ears::{Ears, Heard};
use pursuit_recording::{Entry, RecordingError, Sample, Writer};
use pursuit_runtime::clock::monotonic_ns;
use pursuit_runtime::{exit, place};
use pursuit_supervisor::instance::is_running;
use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::time::Duration;

/// Messages that may wait for the disk.
const QUEUE: usize = 128;
/// Between two looks at the bus: a topic keeps some messages, so that nobody need wake the recorder.
const LOOK: Duration = Duration::from_millis(1);
/// How often is looked whether the instance still runs, ns.
const LOOK_NS: u64 = 500_000_000;
/// Longest wait of the writer for a message: bounds how long a chunk stays open.
const WRITER_WAIT: Duration = Duration::from_millis(100);

/// Records until a signal, the end of the instance, or the end of the time asked for.
pub fn run(options: &Options) -> u8 {
    let directory = options.place.directory();
    if options.wait && !is_running(&directory) && !wait_for_a_run(&directory) {
        return exit::OK;
    }
    if !is_running(&directory) {
        eprintln!("pursuit record: nothing runs in {}; start it with `pursuit up`", directory.display());
        return exit::FAILED;
    }
    let file = options.out.clone().unwrap_or_else(|| PathBuf::from("pursuit.mcap"));
    match record(&directory, &file, options.seconds) {
        Ok(counts) => {
            let Counts { frames, missed, dropped } = counts;
            println!(
                "{}: {frames} frames, {missed} that could not be taken in time, {dropped} messages dropped \
                 because the disk was too slow",
                file.display()
            );
            exit::OK
        }
        Err(sentence) => {
            eprintln!("pursuit record: {}: {sentence}", file.display());
            exit::FAILED
        }
    }
}

/// Waits until something runs; `false` where a signal came first.
fn wait_for_a_run(directory: &Path) -> bool {
    eprintln!("waiting for `pursuit up` in {}; Ctrl-C ends it", directory.display());
    let stop = Arc::new(AtomicBool::new(false));
    let signals = [signal_hook::consts::SIGTERM, signal_hook::consts::SIGINT];
    let handlers = signals.map(|signal| signal_hook::flag::register(signal, Arc::clone(&stop)));
    while !is_running(directory) && !stop.load(Ordering::Relaxed) {
        std::thread::sleep(Duration::from_millis(2));
    }
    handlers.into_iter().flatten().for_each(|handler| {
        signal_hook::low_level::unregister(handler);
    });
    !stop.load(Ordering::Relaxed)
}

/// What was recorded, and what was not.
#[derive(Default)]
struct Counts {
    frames: u64,
    missed: u64,
    dropped: u64,
}

fn record(directory: &Path, file: &Path, seconds: Option<f64>) -> Result<Counts, String> {
    let stop = Arc::new(AtomicBool::new(false));
    use signal_hook::consts::{SIGINT, SIGTERM, SIGXFSZ};
    // SIGXFSZ would end the process where a file may grow no further: the failed write tells it, too.
    let ignored = Arc::new(AtomicBool::new(false));
    for (signal, flag) in [(SIGTERM, &stop), (SIGINT, &stop), (SIGXFSZ, &ignored)] {
        let register = signal_hook::flag::register(signal, Arc::clone(flag));
        register.map_err(|e| format!("cannot take over signal {signal}: {e}"))?;
    }
    let config = std::fs::read_to_string(directory.join(place::CONFIG)).unwrap_or_default();
    let instance = Instance::at(directory).map_err(|e| e.to_string())?;
    let bus = Bus::join(&instance, "record").map_err(|e| e.to_string())?;
    let ears = Ears::open(&bus).map_err(|e| e.to_string())?;
    let writer = Writer::create(file, &config).map_err(|e| e.to_string())?;
    let (queue, waiting) = sync_channel(QUEUE);
    let writing = std::thread::spawn(move || write(writer, &waiting));
    let mut tap = Tap {
        queue,
        look: 0,
        held: Default::default(),
        counts: Counts::default(),
        last: None,
        broken: false,
    };
    let end_ns = seconds.map(|s| monotonic_ns() + (s.max(0.0) * 1e9) as u64);
    let mut look_ns = monotonic_ns() + LOOK_NS;
    eprintln!("recording into {}; Ctrl-C ends it", file.display());
    while !stop.load(Ordering::Relaxed) && !tap.broken {
        if ears.listen(|heard| tap.hear(heard)) > 0 {
            return Err("the bus cannot be read".to_owned());
        }
        tap.release(false);
        std::thread::sleep(LOOK);
        let now = monotonic_ns();
        if end_ns.is_some_and(|end| now >= end) {
            break;
        }
        if now >= look_ns {
            look_ns = now + LOOK_NS;
            if !is_running(directory) {
                break;
            }
        }
    }
    tap.release(true);
    let Tap { queue, counts, .. } = tap;
    drop(queue);
    match writing.join() {
        Ok(Ok(())) => Ok(counts),
        Ok(Err(error)) if error.is_disk_full() => Err(format!(
            "there is no room for more ({error}): the recording ends here, what was written before can be read; \
             the run goes on"
        )),
        Ok(Err(error)) => Err(error.to_string()),
        Err(_) => Err("the writer failed".to_owned()),
    }
}

/// The writer's thread: to the end of the queue.
fn write(mut writer: Writer, waiting: &Receiver<Entry>) -> Result<(), RecordingError> {
    loop {
        match waiting.recv_timeout(WRITER_WAIT) {
            Ok(entry) => writer.write(&entry)?,
            Err(RecvTimeoutError::Timeout) => writer.flush_at(monotonic_ns())?,
            Err(RecvTimeoutError::Disconnected) => return writer.finish(),
        }
    }
}

/// Where messages go: an answer behind what it answers. Topic after topic is read, so that an answer may be read
/// before what it answers, which then comes at the next look.
struct Tap {
    queue: SyncSender<Entry>,
    /// Number of this look.
    look: u64,
    /// Vote fields, which wait for one look, and all else, which waits for two; each with the look that it is of.
    held: [VecDeque<(u64, Entry)>; 2],
    counts: Counts,
    /// Epoch and number of the newest frame.
    last: Option<(u64, u64)>,
    /// The writer is gone: the disk is full, say.
    broken: bool,
}

impl Tap {
    fn hear(&mut self, heard: Heard<'_>) {
        match heard {
            Heard::Frame(frame) => {
                self.count(frame.stamp());
                self.take(frame.stamp(), Sample::Frame(frame.pixels().to_vec()));
            }
            Heard::Votes(stamp, votes) => self.take(stamp, Sample::Votes(Box::new(*votes))),
            Heard::Target(stamp, target) => self.take(stamp, Sample::Target(Box::new(*target))),
            Heard::Joints(stamp, joints) => self.take(stamp, Sample::Joints(*joints)),
            Heard::SetPoint(stamp, point) => self.take(stamp, Sample::SetPoint(*point)),
            Heard::Learner(stamp, state) => self.take(stamp, Sample::Learner(Box::new(*state))),
            Heard::World(stamp, world) => self.take(stamp, Sample::World(Box::new(*world))),
            Heard::Command(stamp, command) => self.take(stamp, Sample::Command(Box::new(*command))),
            Heard::Driver(stamp, state) => self.take(stamp, Sample::Driver(*state)),
            Heard::Health(stamp, health) => self.take(stamp, Sample::Health(*health)),
        }
    }

    fn take(&mut self, stamp: &Stamp, sample: Sample) {
        let entry = Entry { log_ns: monotonic_ns(), stamp: *stamp, sample };
        match entry.sample {
            Sample::Frame(_) => self.pass_on(entry),
            Sample::Votes(_) => self.held[0].push_back((self.look, entry)),
            _ => self.held[1].push_back((self.look, entry)),
        }
    }

    /// A look is over: passes on what has waited for long enough, at the end (`all`) everything.
    fn release(&mut self, all: bool) {
        for kind in 0..self.held.len() {
            let wait = kind as u64 + 1;
            while self.held[kind].front().is_some_and(|(look, _)| all || look + wait <= self.look) {
                if let Some((_, entry)) = self.held[kind].pop_front() {
                    self.pass_on(entry);
                }
            }
        }
        self.look += 1;
    }

    fn pass_on(&mut self, entry: Entry) {
        match self.queue.try_send(entry) {
            Ok(()) => {}
            Err(TrySendError::Full(_)) => self.counts.dropped += 1,
            Err(TrySendError::Disconnected(_)) => self.broken = true,
        }
    }

    fn count(&mut self, stamp: &Stamp) {
        self.counts.frames += 1;
        if let Some((epoch, frame)) = self.last.replace((stamp.epoch, stamp.frame))
            && epoch == stamp.epoch
        {
            self.counts.missed += stamp.frame.saturating_sub(frame + 1);
        }
    }
}
