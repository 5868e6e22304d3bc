//! A recording through the services: acquisition plays it, vision and segmentation answer, and what they say is
//! compared with what the recording says.
//!
//! On the wall clock the newest frame wins: one that vision passed over has no answer, and one whose pair is another
//! than in the recording has another. Such answers are counted as not comparable.

use super::{Digest32, Options, Outcome, open, target_digest, votes_digest};
use crate::check;
use pursuit_bus::{Bus, Instance, wait};
use pursuit_config::Document;
use pursuit_messages::Service;
use pursuit_messages::topics::{Targets, VoteFields};
use pursuit_recording::{Reader, Sample};
use pursuit_runtime::clock::monotonic_ns;
use pursuit_runtime::{TICK, place};
use pursuit_supervisor::control::{Request, ask};
use pursuit_supervisor::{Ended, Plan};
use sha2::{Digest, Sha256};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// After the last frame its answers come within so long, ns.
const LAST_NS: u64 = 2_000_000_000;
/// Services are up, and a first answer is there, within so long, ns: patience with a loaded machine.
const FIRST_NS: u64 = 60_000_000_000;

/// What the recording says of a frame.
#[derive(Default)]
struct Said {
    votes: Option<(u32, Digest32)>,
    target: Option<Digest32>,
}

/// What the recording says of all frames of its first epoch, by number.
struct Expected {
    frames: BTreeMap<u64, Said>,
    last: u64,
    /// Tracks are compared where nothing is left out at the beginning.
    with_tracks: bool,
    closed: bool,
}

/// Plays the recording, and compares.
///
/// # Errors
/// The recording, the system, or why nothing was answered.
pub fn replay(options: &Options) -> Result<Outcome, String> {
    let (reader, mut document) = open(&options.file, &options.set)?;
    let expected = read(reader, options.from)?;
    let file = std::path::absolute(&options.file).map_err(|e| e.to_string())?;
    for (key, value) in [
        ("run.clock", "wall".to_owned()),
        ("acquisition.source", "recording".to_owned()),
        ("acquisition.file", format!("{:?}", file.display().to_string())),
        ("acquisition.speed", format!("{:?}", options.speed)),
        ("acquisition.from_s", format!("{:?}", options.from)),
        ("acquisition.repeat", options.again.to_string()),
        ("acquisition.faults", "false".to_owned()),
    ] {
        document.set(key, &value).map_err(|e| e.to_string())?;
    }
    let checked = check::all(&document).map_err(|e| e.to_string())?;
    let directory = options.place.directory_or("replay");
    let plan = plan(document, &directory, checked.acquisition.camera.shape().bytes())?;
    let (mine, again) = (directory.clone(), options.again);
    let judge = std::thread::spawn(move || {
        let judged = judge(&mine, &expected, again);
        let _ = ask(&mine.join(place::CONTROL), &Request::Down);
        judged
    });
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
    let ended = runtime.map_err(|e| e.to_string())?.block_on(pursuit_supervisor::run(plan, |_| {}));
    let judged = judge.join().map_err(|_| "the comparison failed".to_owned())?;
    match ended {
        Ok(Ended::Failed(why)) => Err(why),
        Ok(Ended::Stopped | Ended::Finished) => judged,
        Err(error) => Err(error.to_string()),
    }
}

fn plan(document: Document, directory: &Path, frame_bytes: usize) -> Result<Plan, String> {
    let program: PathBuf = std::env::current_exe().map_err(|e| e.to_string())?;
    let services = vec![Service::Acquisition, Service::Vision, Service::Segmentation];
    let lease = Duration::from_secs(5);
    Ok(Plan {
        directory: directory.to_owned(),
        document,
        program,
        services,
        frame_bytes,
        bounded: true,
        lease,
    })
}

/// All that the recording says from `from_s` after its first frame on.
fn read(mut reader: Reader, from_s: f64) -> Result<Expected, String> {
    let mut frames: BTreeMap<u64, Said> = BTreeMap::new();
    let (mut epoch, mut begin_ns, mut first_answer) = (None, 0, None);
    let mut targets = Vec::new();
    while let Some(entry) = reader.next_entry().map_err(|e| e.to_string())? {
        let stamp = entry.stamp;
        // The others' stamps need not be those of a frame.
        if !matches!(entry.sample, Sample::Frame(_) | Sample::Votes(_) | Sample::Target(_)) {
            continue;
        }
        if *epoch.get_or_insert(stamp.epoch) != stamp.epoch {
            continue;
        }
        match entry.sample {
            Sample::Frame(_) => {
                begin_ns = if frames.is_empty() && begin_ns == 0 { stamp.exposure_ns } else { begin_ns };
                if stamp.exposure_ns as f64 >= begin_ns as f64 + from_s * 1e9 {
                    frames.entry(stamp.frame).or_default();
                }
            }
            Sample::Votes(votes) => {
                first_answer.get_or_insert(stamp.frame);
                if let Some(said) = frames.get_mut(&stamp.frame) {
                    said.votes = Some((votes.interval, votes_digest(&votes)));
                }
            }
            Sample::Target(target) => targets.push((stamp.frame, *target)),
            _ => {}
        }
    }
    let with_tracks = from_s == 0.0 && first_answer == Some(0);
    for (frame, target) in targets {
        if let Some(said) = frames.get_mut(&frame) {
            said.target = Some(target_digest(&target, with_tracks));
        }
    }
    let last = *frames.keys().next_back().ok_or("holds no frame from there on")?;
    Ok(Expected { frames, last, with_tracks, closed: reader.is_closed() })
}

/// Listens until the last frame is answered, or nothing more comes.
fn judge(directory: &Path, expected: &Expected, again: bool) -> Result<Outcome, String> {
    let begin = monotonic_ns();
    while place::supervisor(directory).is_none_or(|supervisor| supervisor.pid != std::process::id()) {
        if monotonic_ns() > begin + FIRST_NS {
            return Err("the system did not come up".to_owned());
        }
        std::thread::sleep(TICK);
    }
    let instance = Instance::at(directory).map_err(|e| e.to_string())?;
    let bus = Bus::join(&instance, "replay").map_err(|e| e.to_string())?;
    let votes = bus.subscriber(VoteFields).map_err(|e| e.to_string())?;
    let targets = bus.subscriber(Targets).map_err(|e| e.to_string())?;
    let mut outcome = Outcome {
        frames: expected.frames.len() as u64,
        with_tracks: expected.with_tracks,
        closed: expected.closed,
        ..Outcome::default()
    };
    let mut digests = [Sha256::new(), Sha256::new()];
    // A pair that is another one makes another answer, and from then on other tracks.
    let mut other_pairs = BTreeSet::new();
    let (mut heard_ns, mut over_ns) = (begin + FIRST_NS, None);
    while monotonic_ns() < over_ns.unwrap_or(heard_ns) {
        wait(&[&votes, &targets], TICK).map_err(|e| e.to_string())?;
        while let Some(message) = votes.receive().map_err(|e| e.to_string())? {
            heard_ns = monotonic_ns() + FIRST_NS;
            let frame = message.stamp().frame;
            let digest = votes_digest(message.payload());
            let recorded = expected.frames.get(&frame).and_then(|said| said.votes);
            match recorded.filter(|(interval, _)| *interval == message.payload().interval) {
                Some((_, recorded)) => {
                    digests[0].update(digest);
                    outcome.judge("vision", message.stamp().epoch, frame, recorded == digest);
                }
                None => {
                    other_pairs.insert(frame);
                    outcome.votes.not_comparable += 1;
                }
            }
        }
        while let Some(message) = targets.receive().map_err(|e| e.to_string())? {
            let frame = message.stamp().frame;
            let comparable = match other_pairs.first() {
                Some(first) if expected.with_tracks => frame < *first,
                _ => !other_pairs.contains(&frame),
            };
            let recorded = expected.frames.get(&frame).and_then(|said| said.target);
            match recorded.filter(|_| comparable) {
                Some(recorded) => {
                    let digest = target_digest(message.payload(), expected.with_tracks);
                    digests[1].update(digest);
                    outcome.judge("segmentation", message.stamp().epoch, frame, recorded == digest);
                }
                None => outcome.targets.not_comparable += 1,
            }
            if frame == expected.last && !again {
                over_ns.get_or_insert(monotonic_ns() + TICK.as_nanos() as u64);
            }
        }
        // The last frames may have been passed over: nothing more comes.
        let is_silent = outcome.votes.compared > 0 && monotonic_ns() + FIRST_NS > heard_ns + LAST_NS;
        if place::supervisor(directory).is_none() || (is_silent && !again) {
            break;
        }
    }
    if outcome.votes.compared + outcome.votes.not_comparable == 0 {
        return Err("nothing was answered: the services' logs are in the run-time directory".to_owned());
    }
    let hex = |digest: Sha256| super::hex(&digest.finalize());
    let [of_votes, of_targets] = digests;
    (outcome.votes.sha256, outcome.targets.sha256) = (hex(of_votes), hex(of_targets));
    Ok(outcome)
}

impl Outcome {
    fn judge(&mut self, stage: &'static str, epoch: u64, frame: u64, same: bool) {
        let counts = if stage == "vision" { &mut self.votes } else { &mut self.targets };
        counts.count(same);
        if !same {
            self.first_difference.get_or_insert((stage, epoch, frame));
        }
    }
}
