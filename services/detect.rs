//! `pursuit detect`: vision and segmentation over a folder of images, in one process.
//!
//! One line per image: a JSON object with `--json`, else a row of a table. u is right and v down from the
//! centre of the top-left pixel, velocities are px/frame from the image before. The first image has none
//! before it, and so no target.

use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use pursuit_images::{Canvas, GreyImage, ImagesError, Limits, list, load_grey, load_grey_into};
use pursuit_motion::{
    Detection, EngineError, FIELDS, Fields, Image, ImageError, MAX_CELLS, Older, Parameters, Part, Probe,
    SegmentScratch, Segmentation, VoteEngine, segment,
};
use serde::Serialize;
use thiserror::Error;

/// What the command line asks for.
#[derive(Clone, Debug)]
pub struct Options {
    /// The folder of images.
    pub path: PathBuf,
    /// JSON lines instead of a table.
    pub json: bool,
    /// Folder for copies of the images with the detections drawn in; created when it is missing.
    pub annotate: Option<PathBuf>,
}

/// Why the images could not be worked through; one line each.
#[derive(Debug, Error)]
pub enum DetectError {
    /// A folder or file cannot be used, or an image is not of the others' size.
    #[error(transparent)]
    Images(#[from] ImagesError),
    /// Motion takes two images.
    #[error("{}: images in this folder: {count}; at least 2 are needed to see a motion", path.display())]
    TooFew {
        /// The folder.
        path: PathBuf,
        /// The images in it.
        count: usize,
    },
    /// The detector does not work on images of this size, or with these parameters.
    #[error("{}: {error}", path.display())]
    Engine {
        /// The first image.
        path: PathBuf,
        /// The detector's reason.
        error: EngineError,
    },
    /// The detector refuses the image.
    #[error("{}: {error}", path.display())]
    Frame {
        /// The image.
        path: PathBuf,
        /// The detector's reason.
        error: ImageError,
    },
    /// The folder for annotated images cannot be made.
    #[error("{}: cannot be made a folder for annotated images: {reason}", path.display())]
    Folder {
        /// The folder.
        path: PathBuf,
        /// The operating system's words.
        reason: String,
    },
    /// The annotated images would replace the images.
    #[error("{}: holds the images themselves, give --annotate another folder", .0.display())]
    Overwrites(PathBuf),
    /// The result cannot be printed.
    #[error("the result cannot be written: {0}")]
    Output(#[from] io::Error),
}

/// Detects the target in every image of the folder, in natural order of their names, and writes a line for
/// each to `out`. A reader that closes `out` ends the run and is no error.
///
/// # Errors
/// Fewer than two images, one that is broken or of another size, or a folder or output that cannot be used.
/// The lines of the images before are written by then.
pub fn run(options: &Options, parameters: &Parameters, out: &mut impl Write) -> Result<(), DetectError> {
    match detect(options, parameters, out) {
        Err(DetectError::Output(error)) if error.kind() == ErrorKind::BrokenPipe => Ok(()),
        result => result,
    }
}

fn detect(options: &Options, parameters: &Parameters, out: &mut impl Write) -> Result<(), DetectError> {
    let files = list(&options.path)?;
    let (Some(first), true) = (files.first(), files.len() >= 2) else {
        return Err(DetectError::TooFew { path: options.path.clone(), count: files.len() });
    };
    let mut newer = load_grey(first, Limits::default())?;
    let mut older = newer.clone();
    let mut detector = Detector::new(&newer, parameters)
        .map_err(|error| DetectError::Engine { path: first.clone(), error })?;
    if let Some(folder) = &options.annotate {
        prepare_folder(folder, &options.path)?;
    }
    let mut summary = Summary::default();
    if !options.json {
        write_head(out, &newer)?;
    }
    for (frame, path) in files.iter().enumerate() {
        if frame > 0 {
            std::mem::swap(&mut older, &mut newer);
            load_grey_into(path, &mut newer.pixels, newer.width, newer.height)?;
        }
        let (found, times) = detector
            .step((frame > 0).then_some(&older), &newer)
            .map_err(|error| DetectError::Frame { path: path.clone(), error })?;
        let file = path.file_name().map(|name| name.to_string_lossy()).unwrap_or_default();
        if options.json {
            write_json(out, frame, &file, &found, &times)?;
        } else {
            write_row(out, frame, &file, &found, &times)?;
        }
        if let Some(folder) = &options.annotate {
            annotated(&newer, &found).write_png(&folder.join(png_name(&file)))?;
        }
        summary.add(&found, &times);
    }
    if !options.json {
        summary.write(out)?;
    }
    Ok(out.flush()?)
}

/// The two steps of the detector and their memory.
struct Detector {
    engine: VoteEngine,
    parameters: Parameters,
    fields: Box<Fields>,
    scratch: SegmentScratch,
}

impl Detector {
    fn new(frame: &GreyImage, parameters: &Parameters) -> Result<Detector, EngineError> {
        Ok(Detector {
            engine: VoteEngine::new(frame.width as usize, frame.height as usize, parameters)?,
            parameters: *parameters,
            fields: Box::new([[0.0; MAX_CELLS]; FIELDS]),
            scratch: SegmentScratch::new(),
        })
    }

    /// The target in `newer`. `older` is the frame that was `newer` in the last call, `None` in the first.
    fn step(
        &mut self,
        older: Option<&GreyImage>,
        newer: &GreyImage,
    ) -> Result<(Segmentation, Times), ImageError> {
        let older = older.map(view).transpose()?.map_or(Older::Missing, Older::LastNewer);
        let newer = view(newer)?;
        let mut stopwatch = Stopwatch::start();
        let votes = self.engine.vote(older, newer, &mut self.fields, &mut stopwatch);
        let found = segment(&self.fields, &votes, &self.parameters, &mut self.scratch);
        stopwatch.lap(|times| &mut times.segmentation);
        Ok((found, stopwatch.times))
    }
}

fn view(frame: &GreyImage) -> Result<Image<'_>, ImageError> {
    let (width, height) = (frame.width as usize, frame.height as usize);
    Image::new(&frame.pixels, width, height, width)
}

/// Time spent on one frame.
#[derive(Clone, Copy, Default)]
struct Times {
    pyramid: Duration,
    votes: Duration,
    compensation: Duration,
    segmentation: Duration,
}

impl Times {
    fn total(&self) -> Duration {
        self.pyramid + self.votes + self.compensation + self.segmentation
    }
}

/// Adds up the parts of a step.
struct Stopwatch {
    last: Instant,
    times: Times,
}

impl Stopwatch {
    fn start() -> Stopwatch {
        Stopwatch { last: Instant::now(), times: Times::default() }
    }

    fn lap(&mut self, part: impl FnOnce(&mut Times) -> &mut Duration) {
        let now = Instant::now();
        *part(&mut self.times) += now - self.last;
        self.last = now;
    }
}

impl Probe for Stopwatch {
    fn ended(&mut self, part: Part) {
        self.lap(|times| match part {
            Part::Pyramid => &mut times.pyramid,
            Part::Compensation => &mut times.compensation,
            Part::Votes => &mut times.votes,
        });
    }
}

/// One line of `--json`; this is a contract with whoever reads it.
#[derive(Serialize)]
struct Line<'a> {
    frame: usize,
    file: &'a str,
    target: Option<Target>,
    background: Background,
    us: Microseconds,
}

#[derive(Serialize)]
struct Target {
    u: f64,
    v: f64,
    vu: f64,
    vv: f64,
    confidence: f64,
    area_px: f64,
}

#[derive(Serialize)]
struct Background {
    vu: f64,
    vv: f64,
}

#[derive(Serialize)]
struct Microseconds {
    pyramid: f64,
    votes: f64,
    compensation: f64,
    segmentation: f64,
}

fn write_json(
    out: &mut impl Write,
    frame: usize,
    file: &str,
    found: &Segmentation,
    times: &Times,
) -> io::Result<()> {
    let target = found.target.ok().map(|target| Target {
        u: rounded(target.u),
        v: rounded(target.v),
        vu: rounded(target.vu),
        vv: rounded(target.vv),
        confidence: rounded(target.confidence),
        area_px: rounded(target.area_px),
    });
    let background = Background { vu: rounded(found.background.0), vv: rounded(found.background.1) };
    let us = Microseconds {
        pyramid: microseconds(times.pyramid),
        votes: microseconds(times.votes),
        compensation: microseconds(times.compensation),
        segmentation: microseconds(times.segmentation),
    };
    serde_json::to_writer(&mut *out, &Line { frame, file, target, background, us })?;
    writeln!(out)
}

/// To three decimals, without a negative zero.
fn rounded(value: f64) -> f64 {
    assert!(value.is_finite(), "the detector gave {value}, which is not a number");
    (value * 1000.0).round() / 1000.0 + 0.0
}

/// To one decimal, without a negative zero.
fn tenths(value: f64) -> f64 {
    (value * 10.0).round() / 10.0 + 0.0
}

fn microseconds(time: Duration) -> f64 {
    rounded(time.as_nanos() as f64 / 1000.0)
}

/// Width of the column of file names; longer names push their row to the right.
const NAME_COLUMNS: usize = 16;

fn write_head(out: &mut impl Write, frame: &GreyImage) -> io::Result<()> {
    let (width, height) = (frame.width, frame.height);
    writeln!(out, "images of {width}x{height} px; positions in px, velocities in px/frame")?;
    writeln!(
        out,
        "frame {:NAME_COLUMNS$} {:>8} {:>8} {:>7} {:>7} {:>5} {:>7} {:>8} {:>8} {:>7}",
        "file", "u", "v", "vu", "vv", "conf", "area", "scene vu", "scene vv", "us"
    )
}

fn write_row(
    out: &mut impl Write,
    frame: usize,
    file: &str,
    found: &Segmentation,
    times: &Times,
) -> io::Result<()> {
    write!(out, "{frame:5} {file:NAME_COLUMNS$} ")?;
    match &found.target {
        Ok(Detection { u, v, vu, vv, confidence, area_px, .. }) => {
            let (vu, vv) = (tenths(*vu), tenths(*vv));
            write!(out, "{u:8.1} {v:8.1} {vu:7.1} {vv:7.1} {confidence:5.2} {area_px:7.0}")?;
        }
        Err(_) => write!(out, "{:>8} {:>8} {:>7} {:>7} {:>5} {:>7}", "-", "-", "-", "-", "-", "-")?,
    }
    let (vu, vv) = (tenths(found.background.0), tenths(found.background.1));
    write!(out, " {vu:8.1} {vv:8.1} {:7.0}", microseconds(times.total()))?;
    match &found.target {
        Ok(_) => writeln!(out),
        Err(reason) => writeln!(out, "  {reason}"),
    }
}

/// What the last line of the table says.
#[derive(Default)]
struct Summary {
    pairs: usize,
    found: usize,
    frames: usize,
    total: Times,
}

impl Summary {
    fn add(&mut self, found: &Segmentation, times: &Times) {
        self.pairs += usize::from(self.frames > 0);
        self.frames += 1;
        self.found += usize::from(found.target.is_ok());
        self.total.pyramid += times.pyramid;
        self.total.votes += times.votes;
        self.total.compensation += times.compensation;
        self.total.segmentation += times.segmentation;
    }

    fn write(&self, out: &mut impl Write) -> io::Result<()> {
        let mean = |time: Duration| microseconds(time) / self.frames as f64;
        let Times { pyramid, votes, compensation, segmentation } = self.total;
        writeln!(out, "a target in {} of {} pairs", self.found, self.pairs)?;
        writeln!(
            out,
            "on average {:.0} us a frame: pyramid {:.0}, votes {:.0}, compensation {:.0}, segmentation {:.0}",
            mean(self.total.total()),
            mean(pyramid),
            mean(votes),
            mean(compensation),
            mean(segmentation),
        )
    }
}

/// Makes the folder for annotated images, which must not be that of the images: they have the same names.
fn prepare_folder(folder: &Path, images: &Path) -> Result<(), DetectError> {
    let refused =
        |error: io::Error| DetectError::Folder { path: folder.to_owned(), reason: error.to_string() };
    std::fs::create_dir_all(folder).map_err(refused)?;
    if folder.canonicalize().map_err(refused)? == images.canonicalize().map_err(refused)? {
        return Err(DetectError::Overwrites(folder.to_owned()));
    }
    Ok(())
}

/// The name of the annotated image: that of the image, with `.png` added to what does not end so.
fn png_name(file: &str) -> String {
    if file.to_ascii_lowercase().ends_with(".png") { file.to_owned() } else { format!("{file}.png") }
}

/// The frame with a cross on the target, a circle of its area, and an arrow along its motion in
/// [`ARROW_FRAMES`] frames; the same arrow of the background starts in the middle.
fn annotated(frame: &GreyImage, found: &Segmentation) -> Canvas {
    /// Arrows show this many frames of motion; one frame's would be too short to see.
    const ARROW_FRAMES: f64 = 4.0;
    /// Longer arms than this hide the target.
    const CROSS_ARM_PX: f64 = 5.0;
    const TARGET: [u8; 3] = [255, 64, 48];
    const AREA: [u8; 3] = [255, 208, 0];
    const BACKGROUND: [u8; 3] = [64, 192, 255];
    let mut canvas = Canvas::over(frame);
    let middle = (f64::from(frame.width / 2), f64::from(frame.height / 2));
    let (vu, vv) = found.background;
    canvas.arrow(middle, (ARROW_FRAMES * vu, ARROW_FRAMES * vv), BACKGROUND);
    if let Ok(target) = &found.target {
        let centre = (target.u, target.v);
        canvas.circle(centre, (target.area_px / std::f64::consts::PI).sqrt(), AREA);
        canvas.arrow(centre, (ARROW_FRAMES * target.vu, ARROW_FRAMES * target.vv), TARGET);
        canvas.cross(centre, CROSS_ARM_PX, TARGET);
    }
    canvas
}

#[cfg(test)]
mod tests {
    use super::*;
    use pursuit_images::write_png_grey;

    const SIDE: u32 = 128;

    /// A folder of its own for one test, removed at its end.
    struct Folder(PathBuf);

    impl Folder {
        fn new(test: &str) -> Folder {
            let path = std::env::temp_dir().join(format!("pursuit-detect-{}-{test}", std::process::id()));
            std::fs::create_dir_all(&path).unwrap();
            Folder(path)
        }

        /// Writes `count` frames: a random texture at rest and a square of 20 px with another texture, its
        /// top-left corner at (30 + 4 i, 50).
        fn with_frames(test: &str, count: u32) -> Folder {
            let folder = Folder::new(test);
            for i in 0..count {
                let left = 30 + 4 * i;
                let pixels: Vec<u8> = (0..SIDE * SIDE)
                    .map(|index| {
                        let (u, v) = (index % SIDE, index / SIDE);
                        let inside = (left..left + 20).contains(&u) && (50..70).contains(&v);
                        if inside { texture(u + 1000 - left, v + 500) } else { texture(u, v) }
                    })
                    .collect();
                write_png_grey(&folder.0.join(format!("f{i}.png")), SIDE, SIDE, &pixels).unwrap();
            }
            folder
        }

        fn run(&self, json: bool, annotate: Option<PathBuf>) -> (Result<(), DetectError>, String) {
            let options = Options { path: self.0.clone(), json, annotate };
            let mut out = Vec::new();
            let result = run(&options, &Parameters::default(), &mut out);
            (result, String::from_utf8(out).unwrap())
        }

        fn complaint(&self) -> String {
            let text = self.run(true, None).0.unwrap_err().to_string();
            assert_eq!(text.lines().count(), 1, "{text}");
            assert!(text.starts_with(&*self.0.to_string_lossy()), "{text}");
            text
        }
    }

    impl Drop for Folder {
        fn drop(&mut self) {
            let _ = std::fs::remove_dir_all(&self.0);
        }
    }

    /// Value noise of 4 px.
    fn texture(u: u32, v: u32) -> u8 {
        let hash = |x: u32, y: u32| {
            let mixed = (x.wrapping_mul(0x9e37_79b1) ^ y.wrapping_mul(0x85eb_ca6b)).wrapping_mul(0xc2b2_ae35);
            f64::from(mixed >> 24)
        };
        let (x, y) = (u / 4, v / 4);
        let (a, b) = (f64::from(u % 4) / 4.0, f64::from(v % 4) / 4.0);
        let row = |y| hash(x, y) * (1.0 - a) + hash(x + 1, y) * a;
        (row(y) * (1.0 - b) + row(y + 1) * b) as u8
    }

    #[test]
    fn each_image_gives_one_json_line_and_the_target_is_found() {
        let folder = Folder::with_frames("json", 12);
        std::fs::write(folder.0.join("notes.txt"), "passed over").unwrap();
        let (result, out) = folder.run(true, None);
        result.unwrap();
        let lines: Vec<serde_json::Value> =
            out.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
        assert_eq!(lines.len(), 12);
        let keys = ["background", "file", "frame", "target", "us"];
        let mut near = 0;
        for (frame, line) in lines.iter().enumerate() {
            let mut found: Vec<&str> = line.as_object().unwrap().keys().map(String::as_str).collect();
            found.sort_unstable();
            assert_eq!(found, keys);
            assert_eq!(line["frame"], frame);
            assert_eq!(line["file"], format!("f{frame}.png"));
            assert!(line["background"]["vu"].is_f64() && line["us"]["votes"].is_f64());
            let centre = (39.5 + 4.0 * frame as f64, 59.5);
            if let (Some(u), Some(v)) = (line["target"]["u"].as_f64(), line["target"]["v"].as_f64()) {
                near += usize::from((u - centre.0).hypot(v - centre.1) < 10.0);
            }
        }
        assert!(lines[0]["target"].is_null());
        assert!(near >= 8, "{near} of 11 near the target:\n{out}");
    }

    #[test]
    fn the_table_has_a_row_for_each_image_and_a_summary() {
        let (result, out) = Folder::with_frames("table", 3).run(false, None);
        result.unwrap();
        let lines: Vec<&str> = out.lines().collect();
        assert_eq!(lines.len(), 2 + 3 + 2, "{out}");
        assert!(lines[2].contains("f0.png") && lines[2].ends_with("there is no frame before this one"));
        assert!(lines[5].starts_with("a target in ") && lines[5].ends_with(" of 2 pairs"));
    }

    #[test]
    fn annotated_images_are_copies_with_the_detection_drawn_in() {
        let folder = Folder::with_frames("annotate", 3);
        std::fs::copy(folder.0.join("f2.png"), folder.0.join("f3.tif")).unwrap();
        let copies = folder.0.join("a/b");
        folder.run(true, Some(copies.clone())).0.unwrap();
        let names: Vec<PathBuf> =
            ["f0.png", "f1.png", "f2.png", "f3.tif.png"].map(|name| copies.join(name)).into();
        assert_eq!(list(&copies).unwrap(), names);
        let load = |path: &Path| load_grey(path, Limits::default()).unwrap();
        assert_eq!(load(&names[0]), load(&folder.0.join("f0.png")));
        assert_ne!(load(&names[1]), load(&folder.0.join("f1.png")));
        let refused = folder.run(true, Some(folder.0.join("a/.."))).0.unwrap_err();
        assert!(matches!(refused, DetectError::Overwrites(_)), "{refused}");
    }

    #[test]
    fn what_cannot_be_worked_through_is_named_in_one_line() {
        let folder = Folder::with_frames("bad", 1);
        assert!(
            folder.complaint().ends_with("images in this folder: 1; at least 2 are needed to see a motion")
        );
        let second = folder.0.join("f1.png");
        write_png_grey(&second, 64, 128, &[0; 64 * 128]).unwrap();
        assert!(folder.complaint().ends_with("f1.png: is 64x128 pixels, must be 128x128"));
        std::fs::write(&second, b"\x89PNG\r\n\x1a\ngarbage").unwrap();
        assert!(folder.complaint().contains("f1.png: is not a whole image: "));
        for name in ["f0.png", "f1.png"] {
            write_png_grey(&folder.0.join(name), 8, 8, &[0; 64]).unwrap();
        }
        assert!(folder.complaint().contains("f0.png: frames are 8x8 px"));
    }

    #[test]
    fn a_reader_that_goes_away_is_no_error() {
        struct Closed;
        impl Write for Closed {
            fn write(&mut self, _: &[u8]) -> io::Result<usize> {
                Err(ErrorKind::BrokenPipe.into())
            }
            fn flush(&mut self) -> io::Result<()> {
                Ok(())
            }
        }
        let folder = Folder::with_frames("closed", 2);
        for json in [true, false] {
            let options = Options { path: folder.0.clone(), json, annotate: None };
            assert!(run(&options, &Parameters::default(), &mut Closed).is_ok());
        }
    }
}
