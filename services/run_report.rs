//! `pursuit report`: a recording as one page that needs nothing else, with the paper's figures made from it.

use crate::check::{self, Checked, Detection};
use crate::cli::RunReport as Options;
use crate::report::{Learnt, PAPER_TRACKING_CM, Report};
use crate::{detect, plots, svg};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use pursuit_config::Document;
use pursuit_images::{Canvas, GreyImage};
use pursuit_messages::{LearnerState, Phase, Stamp, Target};
use pursuit_recording::{Reader, Sample};
use pursuit_runtime::exit;
use pursuit_simulator::journal::Record;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

/// Which frame, for all time.
type Identity = (u64, u64);

/// What a recording tells.
#[derive(Default)]
struct Run {
    records: BTreeMap<Identity, Record>,
    background: Vec<[f64; 2]>,
    target: Vec<[f64; 2]>,
    learner: Option<Box<LearnerState>>,
    /// The clearest detection, its frame, and how many frames before its pair begins.
    clearest: Option<(f64, Identity, u64)>,
    intervals: BTreeMap<Identity, u64>,
    /// Whether following has begun: what was seen in training is left out then.
    follows: bool,
    closed: bool,
}

/// Runs the verb.
pub fn run(options: &Options) -> u8 {
    let out = options.out.clone().unwrap_or_else(|| options.file.with_extension("html"));
    match page(&options.file).and_then(|page| std::fs::write(&out, page).map_err(|e| e.to_string())) {
        Ok(()) => {
            println!("{}", out.display());
            exit::OK
        }
        Err(why) => {
            eprintln!("pursuit report: {}: {why}", options.file.display());
            exit::BAD_INPUT
        }
    }
}

fn page(file: &Path) -> Result<String, String> {
    let mut reader = Reader::open(file).map_err(|e| e.to_string())?;
    let config = reader.config().filter(|config| !config.is_empty());
    let config =
        config.ok_or("holds no config of a run: only what `pursuit record` wrote can be reported on")?;
    let document = Document::parse("the recording's config", config).map_err(|e| e.to_string())?;
    let checked = check::all(&document).map_err(|e| e.to_string())?;
    let run = Run::read(&mut reader)?;
    if run.records.is_empty() {
        return Err("holds no answered frame of a simulated run".to_owned());
    }
    let pair = run.clearest.map(|(_, frame, interval)| pair(file, frame, interval)).transpose()?.flatten();
    let pictures = pair.map(|[older, newer]| {
        let detection =
            Detection { vision: checked.vision.detector, segmentation: checked.segmentation.decision };
        detect::pictures_of(&older, &newer, &detection).map_err(|e| e.to_string())
    });
    Ok(html(file, &checked, &run, pictures.transpose()?))
}

impl Run {
    fn read(reader: &mut Reader) -> Result<Run, String> {
        let mut run = Run::default();
        let mut worlds: BTreeMap<Identity, ([f64; 2], [f64; 2], u64)> = BTreeMap::new();
        while let Some(entry) = reader.next_entry().map_err(|e| e.to_string())? {
            let stamp = entry.stamp;
            let frame = (stamp.epoch, stamp.frame);
            match entry.sample {
                Sample::World(world) if world.exposes == 1 => {
                    let camera = [world.camera_position[0], world.camera_position[1]];
                    worlds.insert(frame, (camera, world.target_position, stamp.exposure_ns));
                }
                Sample::Votes(votes) => drop(run.intervals.insert(frame, u64::from(votes.interval))),
                Sample::Target(target) => run.take_target(frame, &target),
                Sample::Learner(state) => run.learner = Some(state),
                Sample::Command(command) => {
                    if command.set_point.phase == Phase::Tracking as u32 && !run.follows {
                        run.follows = true;
                        run.background.clear();
                        run.target.clear();
                        run.clearest = None;
                    }
                    if let Some((camera_m, target_m, exposure_ns)) = worlds.get(&frame) {
                        let record = run.records.entry(frame).or_insert_with(|| of_stamp(&stamp));
                        record.time_s = *exposure_ns as f64 * 1e-9;
                        (record.camera_m, record.target_m) = (*camera_m, *target_m);
                        (record.phase, record.moves) = (command.set_point.phase, command.set_point.moves);
                        (record.detected, record.refusal) = (command.set_point.detected, command.refusal);
                    }
                }
                _ => {}
            }
        }
        run.closed = reader.is_closed();
        Ok(run)
    }

    fn take_target(&mut self, frame: Identity, target: &Target) {
        if target.background_frames > 0 {
            self.background.push([target.background_u, target.background_v]);
        }
        if target.motion.found == 1 {
            let relative = [target.motion.vu - target.background_u, target.motion.vv - target.background_v];
            self.target.push(relative);
            let interval = self.intervals.get(&frame).copied().unwrap_or(1);
            let confidence = target.motion.confidence;
            if interval > 0 && self.clearest.is_none_or(|(best, _, _)| confidence > best) {
                self.clearest = Some((confidence, frame, interval));
            }
        }
    }
}

fn of_stamp(stamp: &Stamp) -> Record {
    let mut record = Record { frame: stamp.frame, aimed_m: [f64::NAN; 2], ..Record::default() };
    record.take_times(stamp);
    record
}

/// The two frames of a pair, from the recording.
fn pair(file: &Path, newer: Identity, interval: u64) -> Result<Option<[GreyImage; 2]>, String> {
    let mut reader = Reader::open(file).map_err(|e| e.to_string())?;
    let older = (newer.0, newer.1.saturating_sub(interval));
    let mut found: [Option<GreyImage>; 2] = [None, None];
    while let Some(entry) = reader.next_entry().map_err(|e| e.to_string())? {
        let Sample::Frame(pixels) = entry.sample else { continue };
        let frame = (entry.stamp.epoch, entry.stamp.frame);
        let shape = entry.stamp.image;
        if shape.stride != shape.width || pixels.len() != shape.bytes() {
            continue;
        }
        if let Some(place) = [older, newer].iter().position(|wanted| *wanted == frame) {
            found[place] = Some(GreyImage { width: shape.width, height: shape.height, pixels });
        }
        if let [Some(_), Some(_)] = &found {
            break;
        }
    }
    let [older, newer] = found;
    Ok(older.zip(newer).map(|(older, newer)| [older, newer]))
}

const STYLE: &str = "body{margin:0 auto;max-width:64rem;padding:1.5rem;font:16px/1.5 system-ui,sans-serif;color:#1a1a1a;\
background:#fff}h1{margin:0}h2{margin:2.2rem 0 .3rem}p{margin:.3rem 0 .8rem;color:#555}table{border-collapse:collapse}\
td,th{padding:.25rem 1.2rem .25rem 0;text-align:left;border-bottom:1px solid #ddd}td+td{font-variant-numeric:tabular-nums}\
img,svg{max-width:100%;height:auto}@media(prefers-color-scheme:dark){body{color:#e8e8e8;background:#16181c}p{color:#a9adb5}\
td,th{border-color:#444}}";

fn html(file: &Path, checked: &Checked, run: &Run, pictures: Option<[Canvas; 3]>) -> String {
    let records: Vec<Record> = run.records.values().cloned().collect();
    let mut report = Report::of(checked.simulator.run.seed, &records, &[]);
    report.learner = run.learner.as_ref().map(|state| Learnt::of(state));
    let name = file.file_name().unwrap_or_default().to_string_lossy();
    let mut page = format!(
        "<!doctype html>\n<html lang=\"en\"><meta charset=\"utf-8\"><meta name=\"viewport\" \
         content=\"width=device-width, initial-scale=1\">\n<title>pursuit: {0}</title>\n<style>{STYLE}</style>\n\
         <h1>{0}</h1>\n<p>{1} answered frames, {2:.1} s, {3:.1} images a second{4}.</p>\n",
        svg::escape(&name),
        records.len(),
        seconds(&records),
        checked.vision.camera.rate_hz,
        if run.closed { "" } else { "; the recorder did not close the file, what is there is whole" },
    );
    page += &table(&report);
    let following: Vec<Record> =
        records.iter().filter(|record| record.phase == Phase::Tracking as u32).cloned().collect();
    let [figure6, figure7] = plots::following(&following);
    if !following.is_empty() {
        page += &section(
            "The hand from above",
            "The paper's figure 6 shows a target on a circle at 0.1 m/s, and a \
            camera that keeps within some centimetres of it.",
            &figure6,
        );
        page += &section(
            "Position over time",
            "The paper's figure 7: the camera's x beside the target's; the lag \
            of a controller that aims where the target was shows as a shift.",
            &figure7,
        );
    }
    let plane = plots::velocity_plane(run.background.clone(), run.target.clone());
    page += &section(
        "Velocities",
        "The paper's figure 5 places what moves in the plane of velocities: the \
        background in one heap, the target beside it.",
        &plane,
    );
    if let Some([levels, fields, seen]) = pictures {
        let (_, (_, frame), _) = run.clearest.unwrap_or_default();
        page += &section(
            "What was seen",
            &format!(
                "Frame {frame}, the clearest detection of the run, as \
            `pursuit detect --annotate` draws it."
            ),
            &image(&seen),
        );
        page += &section(
            "Scales",
            "The paper's figure 2: the frame at each scale, and what changed since the one \
            before; by eye the target is not to be found.",
            &image(&levels),
        );
        page += &section(
            "Votes",
            "The paper's figure 4: twelve fields of votes, one for each direction and scale, \
            after the camera's own motion was taken out; the target is where votes gather.",
            &image(&fields),
        );
    }
    page += "</html>\n";
    page
}

fn seconds(records: &[Record]) -> f64 {
    let ends = records.first().zip(records.last());
    ends.map_or(0.0, |(first, last)| last.time_s - first.time_s)
}

/// Figures of the run beside the paper's.
fn table(report: &Report) -> String {
    let mut text = "<table><tr><th><th>here<th>the paper (1994)</tr>\n".to_owned();
    let mut row = |what: &str, ours: String, paper: &str| {
        let _ = writeln!(
            text,
            "<tr><td>{}<td>{}<td>{}</tr>",
            svg::escape(what),
            svg::escape(&ours),
            svg::escape(paper)
        );
    };
    match &report.tracking {
        Some(tracking) => {
            row("following, distance to the target, median", format!("{:.2} cm", tracking.median_cm), "-");
            let order = format!("in the order of {PAPER_TRACKING_CM:.0} cm");
            row("following, RMS", format!("{:.2} cm", tracking.rms_cm), &order);
            row("following, worst frame", format!("{:.2} cm", tracking.max_cm), "-");
            row("target detected in", format!("{:.1} % of frames", 100.0 * tracking.detected_share), "-");
        }
        None => row("following", "not in this recording".to_owned(), "-"),
    }
    if let Some(learner) = &report.learner {
        row("samples learnt from, and kept", format!("{}, {}", learner.samples, learner.ring), "all, 100");
        row("delay predicted over", format!("{:.0} ms", learner.lead_ms), "none");
        row("changes of the cell noticed", learner.changes.to_string(), "-");
    }
    for (name, latency) in &report.latency_us {
        let value = format!("{:.2} / {:.2} ms", latency.p50 / 1e3, latency.p99 / 1e3);
        row(&format!("{}, p50 / p99", name.replace('_', " ")), value, "-");
    }
    text + "</table>\n"
}

fn section(title: &str, words: &str, picture: &str) -> String {
    format!("<h2>{}</h2>\n<p>{}</p>\n{picture}\n", svg::escape(title), svg::escape(words))
}

fn image(canvas: &Canvas) -> String {
    format!("<img alt=\"\" src=\"data:image/png;base64,{}\">", STANDARD.encode(canvas.png()))
}
