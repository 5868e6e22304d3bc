//! `pursuit replay`: a recording once more through the detector that made it, stage by stage, and whether it comes to
//! the same to the bit.
//!
//! In this process, or through acquisition and the same services as they run ([`services`]): the same bits.
//!
//! Vision's answer to a frame depends on that frame and on one before it, which the recorded answer names; so each
//! recorded answer can be made again. Segmentation remembers tracks: they are compared where the recording begins
//! with the run, else only what it says of each pair alone. Times of computing are no answer.

mod services;

use crate::check;
use crate::cli::Replay as Options;
use pursuit_config::Document;
use pursuit_messages::{Detection, ImageShape, Stamp, Target, Votes};
use pursuit_motion::{Image, NoProbe, Older};
use pursuit_recording::{Reader, Sample};
use pursuit_runtime::exit;
use pursuit_segmentation::step::Segmenter;
use pursuit_vision::eye::Eye;
use serde::Serialize;
use sha2::{Digest, Sha256};
use std::collections::VecDeque;
use std::path::Path;

/// Frames kept: a pair is at most so many apart, also where vision passed some over.
const KEPT: usize = 40;
/// Votes kept until the target that is made of them comes.
const PENDING: usize = 16;

/// SHA-256.
type Digest32 = [u8; 32];

/// How a stage compares.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
struct Stage {
    /// Answers that were made again.
    compared: u64,
    /// Those that are the same to the bit.
    same: u64,
    /// Answers whose input is not in the recording.
    not_comparable: u64,
    /// SHA-256 over all that were made again, in their order.
    sha256: String,
}

/// What a replay came to.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
struct Outcome {
    frames: u64,
    votes: Stage,
    targets: Stage,
    /// Whether tracks were compared: the recording begins with the run.
    with_tracks: bool,
    /// Whether the recorder closed the file.
    closed: bool,
    /// The first difference: stage, epoch and frame.
    first_difference: Option<(&'static str, u64, u64)>,
}

/// Runs the verb.
pub fn run(options: &Options) -> u8 {
    let outcome =
        if options.services { services::replay(options) } else { replay(&options.file, &options.set) };
    match outcome {
        Ok(outcome) => {
            if let Some(file) = &options.json {
                let code = crate::up::write_json(file, &outcome);
                if code != exit::OK {
                    return code;
                }
            }
            if options.json.as_deref() != Some(Path::new("-")) {
                print!("{}", text(&outcome));
            }
            if outcome.first_difference.is_none() { exit::OK } else { exit::FAILED }
        }
        Err(why) => {
            eprintln!("pursuit replay: {}: {why}", options.file.display());
            exit::BAD_INPUT
        }
    }
}

fn text(outcome: &Outcome) -> String {
    let line = |name: &str, stage: &Stage| {
        let Stage { compared, same, not_comparable, sha256 } = stage;
        let digest = sha256.get(..16).unwrap_or_default();
        format!(
            "{name:<9} {same} of {compared} the same to the bit, {not_comparable} without their input; {digest}\n"
        )
    };
    let mut text = format!("{} frames\n", outcome.frames);
    text += &line("votes", &outcome.votes);
    text += &line("targets", &outcome.targets);
    if !outcome.with_tracks {
        text += "tracks were not compared: the recording begins in the middle of a run\n";
    }
    if !outcome.closed {
        text += "the recorder did not close the file: what is there is whole\n";
    }
    if let Some((stage, epoch, frame)) = outcome.first_difference {
        text += &format!("FIRST DIFFERENCE in {stage} of frame {frame} (epoch {epoch})\n");
    }
    text
}

/// A frame that is kept.
struct Kept {
    stamp: Stamp,
    pixels: Vec<u8>,
}

struct Machine {
    eye: Eye,
    segmenter: Segmenter,
    shape: ImageShape,
    frames: VecDeque<Kept>,
    pending: VecDeque<((u64, u64), Box<Votes>)>,
    digests: [Sha256; 2],
    outcome: Outcome,
}

/// A recording, and the config that its run had, with these settings on top.
fn open(file: &Path, set: &[String]) -> Result<(Reader, Document), String> {
    let reader = Reader::open(file).map_err(|e| e.to_string())?;
    let config = reader.config().filter(|config| !config.is_empty());
    let config =
        config.ok_or("holds no config of a run: only what `pursuit record` wrote can be replayed")?;
    let mut document = Document::parse("the recording's config", config).map_err(|e| e.to_string())?;
    for setting in set {
        let (key, value) = setting.split_once('=').unwrap_or((setting, ""));
        document.set(key.trim(), value.trim()).map_err(|e| e.to_string())?;
    }
    Ok((reader, document))
}

/// In this process.
fn replay(file: &Path, set: &[String]) -> Result<Outcome, String> {
    let (mut reader, document) = open(file, set)?;
    let checked = check::all(&document).map_err(|e| e.to_string())?;
    let shape = checked.vision.camera.shape();
    let eye = Eye::new(shape.width as usize, shape.height as usize, &checked.vision.detector);
    let mut machine = Machine {
        eye: eye.map_err(|e| e.to_string())?,
        segmenter: Segmenter::new(&checked.segmentation),
        shape,
        frames: VecDeque::with_capacity(KEPT),
        pending: VecDeque::with_capacity(PENDING),
        digests: [Sha256::new(), Sha256::new()],
        outcome: Outcome::default(),
    };
    while let Some(entry) = reader.next_entry().map_err(|e| e.to_string())? {
        match entry.sample {
            Sample::Frame(pixels) => machine.keep(entry.stamp, pixels),
            Sample::Votes(votes) => machine.see(&entry.stamp, votes)?,
            Sample::Target(target) => machine.decide(&entry.stamp, &target)?,
            _ => {}
        }
    }
    let [votes, targets] = machine.digests.map(|digest| hex(&digest.finalize()));
    let mut outcome = machine.outcome;
    (outcome.votes.sha256, outcome.targets.sha256) = (votes, targets);
    outcome.closed = reader.is_closed();
    Ok(outcome)
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

fn identity(stamp: &Stamp) -> (u64, u64) {
    (stamp.epoch, stamp.frame)
}

impl Machine {
    fn keep(&mut self, stamp: Stamp, pixels: Vec<u8>) {
        self.outcome.frames += 1;
        if stamp.image != self.shape || pixels.len() != self.shape.bytes() {
            return;
        }
        if self.frames.len() == KEPT {
            self.frames.pop_front();
        }
        self.frames.push_back(Kept { stamp, pixels });
    }

    /// Vision once more.
    fn see(&mut self, stamp: &Stamp, recorded: Box<Votes>) -> Result<(), String> {
        let (epoch, number) = identity(stamp);
        if self.outcome.votes.seen() == 0 {
            // Nothing was answered, and so nothing tracked, before.
            self.outcome.with_tracks = number == 0;
        }
        let image = |number| image_of(&self.frames, self.shape, (epoch, number));
        let newer = image(number)?;
        let older = match number.checked_sub(u64::from(recorded.interval)) {
            Some(older) if recorded.interval > 0 => image(older)?.map(Older::Frame),
            _ => Some(Older::Missing),
        };
        if let (Some(newer), Some(older)) = (newer, older) {
            let mut again = Box::<Votes>::default();
            self.eye.look(older, newer, recorded.interval, &mut again, &mut NoProbe);
            let again = votes_digest(&again);
            self.digests[0].update(again);
            let same = votes_digest(&recorded) == again;
            self.outcome.votes.count(same);
            if !same {
                self.outcome.first_difference.get_or_insert(("vision", epoch, number));
            }
        } else {
            self.outcome.votes.not_comparable += 1;
        }
        if self.pending.len() == PENDING {
            self.pending.pop_front();
        }
        self.pending.push_back(((epoch, number), recorded));
        Ok(())
    }

    /// Segmentation once more, of what vision said in the recording: a difference there is not told twice.
    fn decide(&mut self, stamp: &Stamp, recorded: &Target) -> Result<(), String> {
        let frame = identity(stamp);
        let image = image_of(&self.frames, self.shape, frame)?;
        let votes = self.pending.iter().rev().find(|(of, _)| *of == frame).map(|(_, votes)| votes);
        let (Some(votes), Some(image)) = (votes, image) else {
            self.outcome.targets.not_comparable += 1;
            return Ok(());
        };
        let again = self.segmenter.answer(frame, votes, Some(image));
        let again = target_digest(&again, self.outcome.with_tracks);
        self.digests[1].update(again);
        let same = target_digest(recorded, self.outcome.with_tracks) == again;
        self.outcome.targets.count(same);
        if !same {
            self.outcome.first_difference.get_or_insert(("segmentation", frame.0, frame.1));
        }
        Ok(())
    }
}

impl Stage {
    fn seen(&self) -> u64 {
        self.compared + self.not_comparable
    }

    fn count(&mut self, same: bool) {
        self.compared += 1;
        self.same += u64::from(same);
    }
}

/// The image of an epoch with that number, where it is kept.
fn image_of(
    frames: &VecDeque<Kept>,
    shape: ImageShape,
    wanted: (u64, u64),
) -> Result<Option<Image<'_>>, String> {
    let (width, height, stride) = (shape.width as usize, shape.height as usize, shape.stride as usize);
    let found = frames.iter().rev().find(|kept| identity(&kept.stamp) == wanted);
    found.map(|kept| Image::new(&kept.pixels, width, height, stride).map_err(|e| e.to_string())).transpose()
}

/// Everything that vision says of a frame but how long it took.
fn votes_digest(votes: &Votes) -> Digest32 {
    let v = votes;
    let mut digest = Sha256::new();
    let shape =
        (v.valid, v.mode, v.outcome, v.candidate_count, v.columns, v.rows, v.passes, v.shift_u, v.shift_v);
    let motion =
        (v.cell_px, v.interval, v.coherence, v.coherence_sum, v.background_u, v.background_v, v.motion);
    digest.update(format!("{shape:?} {motion:?} {:?} {:?}", v.evidence, v.candidates));
    for cell in v.fields.iter().flatten() {
        digest.update(cell.to_bits().to_le_bytes());
    }
    digest.finalize().into()
}

/// Everything that segmentation says of a frame but how long it took; without its tracks where they are of frames
/// that are not there.
fn target_digest(target: &Target, with_tracks: bool) -> Digest32 {
    let mut target = *target;
    target.segmentation_ns = 0;
    if !with_tracks {
        (target.track, target.track_phase, target.track_id) = (Detection::default(), 0, 0);
    }
    Sha256::digest(format!("{target:?}")).into()
}
