//! `pursuit detect`: vision and segmentation over a folder of images, a video or a recording, in one process.
//!
//! One line per frame: a JSON object with `--json`, else a row of a table; pictures where they are asked for.
//! u is right and v down from the centre of the top-left pixel, velocities are px/frame from the frame before.
//! The first frame has none before it, and so no target.

mod annotate;
mod detector;
mod figures;
mod input;
mod pictures;
mod print;
mod sheet;
#[cfg(test)]
mod tests;

use std::io::{self, ErrorKind, Write};
use std::path::PathBuf;

use crate::check::Detection;
use pursuit_images::{Canvas, GreyImage, ImagesError};
use thiserror::Error;

use annotate::annotated;
use detector::Detector;
pub use detector::DetectorError;
use figures::{Figure2, figure4};
use input::Input;
use pictures::Pictures;
use print::{Summary, write_head, write_json, write_row};

/// What the command line asks for.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// The folder of images, or the video.
    pub path: PathBuf,
    /// JSON lines instead of a table.
    pub json: bool,
    /// Folder for copies of the frames with the detections drawn in; folders are created when missing.
    pub annotate: Option<PathBuf>,
    /// Folder for the vote fields of each pair, as in the paper's figure 4.
    pub fields: Option<PathBuf>,
    /// Folder for the pyramid of each frame, as in the paper's figure 2.
    pub figure2: Option<PathBuf>,
}

/// Why the frames could not be worked through; one line each.
#[derive(Debug, Error)]
pub enum DetectError {
    /// A folder or file cannot be used, or an image is not of the others' size.
    #[error(transparent)]
    Images(#[from] ImagesError),
    /// There is nothing at the path.
    #[error("{}: there is no such folder or file", .0.display())]
    Missing(PathBuf),
    /// An image in place of a folder.
    #[error("{}: is one image, give the folder that holds the images, or a video", .0.display())]
    OneImage(PathBuf),
    /// A device or the like.
    #[error("{}: is neither a folder of images nor a video file", .0.display())]
    Neither(PathBuf),
    /// A recording that is broken, or of images that cannot be worked on.
    #[error("{}: {what}", path.display())]
    Recording {
        /// The recording.
        path: PathBuf,
        /// What is wrong with it.
        what: String,
    },
    /// Motion takes two frames.
    #[error("{}: {what}: {count}; at least 2 are needed to see a motion", path.display())]
    TooFew {
        /// The folder or video.
        path: PathBuf,
        /// What was counted.
        what: &'static str,
        /// How many there are.
        count: u64,
    },
    /// The detector does not take the frame, or does not work with these parameters.
    #[error("{}: {error}", path.display())]
    Detector {
        /// The image or video.
        path: PathBuf,
        /// The detector's reason.
        error: DetectorError,
    },
    /// A folder for pictures cannot be made.
    #[error("{}: cannot be made a folder for {option}: {reason}", path.display())]
    Folder {
        /// The folder.
        path: PathBuf,
        /// The option that names it.
        option: &'static str,
        /// The operating system's words.
        reason: String,
    },
    /// The pictures would replace the images, or those of another option.
    #[error("{}: holds {holds}, give {option} another folder", path.display())]
    Overwrites {
        /// The folder.
        path: PathBuf,
        /// The option that names it.
        option: &'static str,
        /// What would be replaced.
        holds: &'static str,
    },
    /// The result cannot be printed.
    #[error("the result cannot be written: {0}")]
    Output(#[from] io::Error),
}

/// The paper's figures 2 and 4 of a pair of frames, and the newer one with the answer drawn in.
///
/// # Errors
/// The detector does not take the frames.
pub fn pictures_of(
    older: &GreyImage,
    newer: &GreyImage,
    detection: &Detection,
) -> Result<[Canvas; 3], DetectorError> {
    let mut detector = Detector::new(older, detection)?;
    let mut figure2 = Figure2::default();
    detector.step(None, older)?;
    figure2.draw((None, older), detector.levels());
    let answer = detector.step(Some(older), newer)?;
    let levels = figure2.draw((Some(older), newer), detector.levels());
    Ok([levels, figure4(&detector.vote_fields()), annotated(newer, &answer)])
}

/// Detects the target in every image of the folder, in natural order of their names, or in every frame of the
/// video, and writes a line for each to `out`. A reader that closes `out` ends the run and is no error. What
/// comes back is a remark on the input that a person should see, mostly none.
///
/// # Errors
/// Fewer than two frames, one that is broken or of another size, or a folder or output that cannot be used.
/// The lines of the frames before are written by then.
pub fn run(
    options: &Options,
    detection: &Detection,
    out: &mut impl Write,
) -> Result<Option<String>, DetectError> {
    match detect(options, detection, out) {
        Err(DetectError::Output(error)) if error.kind() == ErrorKind::BrokenPipe => Ok(None),
        result => result,
    }
}

fn detect(
    options: &Options,
    detection: &Detection,
    out: &mut impl Write,
) -> Result<Option<String>, DetectError> {
    let mut input = Input::open(&options.path)?;
    let mut newer = GreyImage { width: 0, height: 0, pixels: Vec::new() };
    let mut next = input.next_into(&mut newer)?;
    let Some(first) = &next else { return Ok(input.remark()) };
    let refused = |path: &PathBuf, error| DetectError::Detector { path: path.clone(), error };
    let mut detector = Detector::new(&newer, detection).map_err(|error| refused(&first.path, error))?;
    let mut pictures = Pictures::prepare(options)?;
    let mut older = newer.clone();
    let mut summary = Summary::default();
    if !options.json {
        write_head(out, &newer)?;
    }
    let mut frame = 0;
    while let Some(name) = next {
        let before = (frame > 0).then_some(&older);
        let answer = detector.step(before, &newer).map_err(|error| refused(&name.path, error))?;
        if options.json {
            write_json(out, frame, &name.file, &answer)?;
        } else {
            write_row(out, frame, &name.file, &answer)?;
        }
        pictures.write(&name.picture, (before, &newer), &answer, &detector)?;
        summary.add(&answer);
        std::mem::swap(&mut older, &mut newer);
        next = input.next_into(&mut newer)?;
        frame += 1;
    }
    if !options.json {
        summary.write(out)?;
    }
    out.flush()?;
    Ok(input.remark())
}
