//! Where the frames come from: a folder of images, a video or a recording, one frame in memory at a time.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use pursuit_images::{GreyImage, Limits, Video, is_image_name, list, load_grey, load_grey_into};
use pursuit_motion::{MAX_SIDE, MIN_SIDE};
use pursuit_recording::{Reader, RecordingError, Sample};

use super::DetectError;

/// Frames in order.
pub struct Input {
    path: PathBuf,
    frames: u64,
    source: Source,
}

enum Source {
    Folder(std::vec::IntoIter<PathBuf>),
    Video(Box<Video>),
    Recording(Box<Reader>),
}

/// How a frame is called.
#[derive(Clone, Debug)]
pub struct Name {
    /// The image, or the video.
    pub path: PathBuf,
    /// Its last part.
    pub file: String,
    /// The name for pictures of this frame: that of the image, with `.png` added to what does not end so, or
    /// that of the video without its ending, with the frame's number.
    pub picture: String,
}

impl Input {
    /// The images of the folder or the frames of the video at `path`.
    ///
    /// # Errors
    /// There is nothing, or only one image; the video cannot be decoded or is outside the limits of the size.
    pub fn open(path: &Path) -> Result<Input, DetectError> {
        let source = match std::fs::metadata(path) {
            Ok(it) if it.is_file() && is_image_name(path) => {
                return Err(DetectError::OneImage(path.to_owned()));
            }
            Ok(it) if it.is_file() && has_ending(&path.to_string_lossy(), ".mcap") => {
                Source::Recording(Box::new(Reader::open(path).map_err(|error| broken(path, error))?))
            }
            Ok(it) if it.is_file() => Source::Video(Box::new(Video::open(path, limits())?)),
            Ok(it) if !it.is_dir() => return Err(DetectError::Neither(path.to_owned())),
            Err(error) if error.kind() == ErrorKind::NotFound => {
                return Err(DetectError::Missing(path.to_owned()));
            }
            // What cannot be looked at: listing it says why.
            Ok(_) | Err(_) => {
                let files = list(path)?;
                enough(path, "images in this folder", files.len() as u64)?;
                Source::Folder(files.into_iter())
            }
        };
        Ok(Input { path: path.to_owned(), frames: 0, source })
    }

    /// Reads the next frame into `frame`, which takes the size of the first one where it is empty; `None` after
    /// the last.
    ///
    /// # Errors
    /// The frame is broken, of another size, or outside the limits of the size; the video had less than two.
    pub fn next_into(&mut self, frame: &mut GreyImage) -> Result<Option<Name>, DetectError> {
        let first = frame.pixels.is_empty();
        let name = match &mut self.source {
            Source::Folder(files) => {
                let Some(path) = files.next() else { return Ok(None) };
                if first {
                    *frame = load_grey(&path, limits())?;
                } else {
                    load_grey_into(&path, &mut frame.pixels, frame.width, frame.height)?;
                }
                let file = last_part(&path);
                let picture = if has_ending(&file, ".png") { file.clone() } else { format!("{file}.png") };
                Name { path, file, picture }
            }
            Source::Video(video) => {
                if first {
                    let (width, height) = (video.width(), video.height());
                    *frame = GreyImage { width, height, pixels: vec![0; width as usize * height as usize] };
                }
                if !video.read_into(&mut frame.pixels)? {
                    enough(&self.path, "frames in this video", self.frames)?;
                    return Ok(None);
                }
                self.name(self.frames)
            }
            Source::Recording(reader) => {
                let Some((number, recorded)) = next_image(&self.path, reader)? else {
                    enough(&self.path, "frames in this recording", self.frames)?;
                    return Ok(None);
                };
                if !first && (frame.width, frame.height) != (recorded.width, recorded.height) {
                    let sides = |image: &GreyImage| format!("{}x{}", image.width, image.height);
                    let what =
                        format!("frame {number} is {}, those before {}", sides(&recorded), sides(frame));
                    return Err(DetectError::Recording { path: self.path.clone(), what });
                }
                *frame = recorded;
                self.name(number)
            }
        };
        self.frames += 1;
        Ok(Some(name))
    }

    /// The name of a frame of a file that holds many.
    fn name(&self, number: u64) -> Name {
        let stem = self.path.file_stem().unwrap_or_default().to_string_lossy();
        let picture = format!("{stem}-{number:06}.png");
        Name { path: self.path.clone(), file: last_part(&self.path), picture }
    }

    /// After the last frame: what a person should know although it was no error.
    pub fn remark(&self) -> Option<String> {
        let Source::Video(video) = &self.source else { return None };
        let complaint = video.complaint()?;
        Some(format!("{}: ffmpeg went on, but says: {complaint}", self.path.display()))
    }
}

/// The next image of a recording, with its number there.
fn next_image(path: &Path, reader: &mut Reader) -> Result<Option<(u64, GreyImage)>, DetectError> {
    while let Some(entry) = reader.next_entry().map_err(|error| broken(path, error))? {
        let Sample::Frame(pixels) = entry.sample else { continue };
        let shape = entry.stamp.image;
        let sides = MIN_SIDE as u32..=MAX_SIDE as u32;
        if !sides.contains(&shape.width) || !sides.contains(&shape.height) {
            let what = format!(
                "frame {} is {}x{}, sides of {MIN_SIDE} to {MAX_SIDE} are needed",
                entry.stamp.frame, shape.width, shape.height
            );
            return Err(DetectError::Recording { path: path.to_owned(), what });
        }
        let rows = pixels.chunks(shape.stride as usize).take(shape.height as usize);
        let pixels: Vec<u8> =
            rows.flat_map(|row| &row[..row.len().min(shape.width as usize)]).copied().collect();
        if pixels.len() != shape.width as usize * shape.height as usize {
            let what = format!("frame {} is cut off", entry.stamp.frame);
            return Err(DetectError::Recording { path: path.to_owned(), what });
        }
        return Ok(Some((entry.stamp.frame, GreyImage { width: shape.width, height: shape.height, pixels })));
    }
    Ok(None)
}

fn broken(path: &Path, error: RecordingError) -> DetectError {
    DetectError::Recording { path: path.to_owned(), what: error.to_string() }
}

fn limits() -> Limits {
    Limits { min_side: MIN_SIDE as u32, max_side: MAX_SIDE as u32, ..Limits::default() }
}

fn enough(path: &Path, what: &'static str, count: u64) -> Result<(), DetectError> {
    if count < 2 { Err(DetectError::TooFew { path: path.to_owned(), what, count }) } else { Ok(()) }
}

fn last_part(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

fn has_ending(name: &str, ending: &str) -> bool {
    name.to_ascii_lowercase().ends_with(ending)
}
