//! The frames of a video file, decoded by the external program ffmpeg, one at a time.
//!
//! ffmpeg writes a YUV4MPEG2 stream of grey frames into a pipe: its first line names the size, a line and the
//! pixels follow for each frame. What it writes to its standard error is read by a thread, so that it never
//! waits for us there.

use std::ffi::OsString;
use std::io::{BufRead, BufReader, ErrorKind, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStderr, ChildStdout, Command, Stdio};
use std::thread::JoinHandle;

use crate::{ImagesError, Limits};

/// Lines of the stream's text are shorter.
const LONGEST_LINE: u64 = 1024;
/// "Each frame as it is, none twice, none left out", for ffmpeg from 5.1 on, and for those before.
const EVERY_FRAME: [[&str; 2]; 2] = [["-fps_mode", "passthrough"], ["-vsync", "0"]];

/// A video whose frames are read one after the other. When it is dropped the process is ended and waited for.
#[derive(Debug)]
pub struct Video {
    path: PathBuf,
    width: u32,
    height: u32,
    frames: u64,
    process: Child,
    stream: BufReader<ChildStdout>,
    complaints: Option<JoinHandle<String>>,
    complaint: Option<String>,
}

impl Video {
    /// Starts to decode the first video stream of the file. Colours become grey as ffmpeg does it: what a video
    /// stores as luma, expanded to 0..=255.
    ///
    /// # Errors
    /// There is no ffmpeg, it finds no video in the file, or the frames are outside `limits`.
    pub fn open(path: &Path, limits: Limits) -> Result<Video, ImagesError> {
        let [newer, older] = EVERY_FRAME.map(|option| ffmpeg(path, option));
        match Video::start(path, newer, limits) {
            Err(ImagesError::Video { reason, .. }) if reason.contains("Option not found") => {
                Video::start(path, older, limits)
            }
            result => result,
        }
    }

    /// Reads the stream that `command` writes.
    fn start(path: &Path, mut command: Command, limits: Limits) -> Result<Video, ImagesError> {
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut process = command.spawn().map_err(|error| match error.kind() {
            ErrorKind::NotFound => ImagesError::NoFfmpeg(path.to_owned()),
            _ => ImagesError::Video { path: path.to_owned(), reason: error.to_string() },
        })?;
        let (Some(stdout), Some(stderr)) = (process.stdout.take(), process.stderr.take()) else {
            unreachable!("both are pipes");
        };
        let complaints = std::thread::spawn(move || last_line(stderr));
        let mut video = Video {
            path: path.to_owned(),
            width: 0,
            height: 0,
            frames: 0,
            process,
            stream: BufReader::new(stdout),
            complaints: Some(complaints),
            complaint: None,
        };
        let Some(head) = video.line()? else {
            video.finish()?;
            return Err(video.broken("it gives no frame"));
        };
        (video.width, video.height) =
            frame_size(&head).ok_or_else(|| video.broken("it gives no YUV4MPEG2"))?;
        limits.check_sides(path, video.width, video.height)?;
        Ok(video)
    }

    /// Pixels in a row.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// Reads the next frame into `pixels`; `false` after the last one, and `pixels` is as it was.
    ///
    /// # Errors
    /// ffmpeg fails, or ends within a frame.
    ///
    /// # Panics
    /// When `pixels` has not `width * height` bytes.
    pub fn read_into(&mut self, pixels: &mut [u8]) -> Result<bool, ImagesError> {
        let bytes = u64::from(self.width) * u64::from(self.height);
        assert_eq!(pixels.len() as u64, bytes, "the buffer is not of the video's size");
        let Some(head) = self.line()? else {
            self.finish()?;
            return Ok(false);
        };
        if !head.starts_with(b"FRAME") {
            return Err(self.broken("what it writes is no YUV4MPEG2"));
        }
        match self.stream.read_exact(pixels) {
            Ok(()) => self.frames += 1,
            Err(error) if error.kind() == ErrorKind::UnexpectedEof => return Err(self.ended_early()),
            Err(error) => return Err(self.broken(error.to_string())),
        }
        Ok(true)
    }

    /// After the last frame: what ffmpeg complained of although it went on, as of a file with its end missing.
    pub fn complaint(&self) -> Option<&str> {
        self.complaint.as_deref()
    }

    /// A line of the stream without its end, `None` at the end of the stream.
    fn line(&mut self) -> Result<Option<Vec<u8>>, ImagesError> {
        let mut line = Vec::new();
        let read = (&mut self.stream).take(LONGEST_LINE).read_until(b'\n', &mut line);
        read.map_err(|error| self.broken(error.to_string()))?;
        match line.pop() {
            None => Ok(None),
            Some(b'\n') => Ok(Some(line)),
            Some(_) if (line.len() as u64) < LONGEST_LINE - 1 => Err(self.ended_early()),
            Some(_) => Err(self.broken("what it writes is no YUV4MPEG2")),
        }
    }

    /// The stream has ended: waits for the process and keeps its last complaint.
    fn finish(&mut self) -> Result<(), ImagesError> {
        let status = self.process.wait().map_err(|error| self.broken(error.to_string()))?;
        let last = self.complaints.take().and_then(|thread| thread.join().ok()).unwrap_or_default();
        // The file stands in front of our message already.
        let named = format!("{}: ", source(&self.path).to_string_lossy());
        let last = last.strip_prefix(&named).unwrap_or(&last);
        if !status.success() {
            return Err(self.broken(if last.is_empty() { format!("{status}") } else { last.to_owned() }));
        }
        self.complaint = (!last.is_empty()).then(|| last.to_owned());
        Ok(())
    }

    fn ended_early(&mut self) -> ImagesError {
        let within = format!("its stream ends within frame {}", self.frames);
        self.finish().err().unwrap_or_else(|| self.broken(within))
    }

    fn broken(&self, reason: impl Into<String>) -> ImagesError {
        ImagesError::Video { path: self.path.clone(), reason: reason.into() }
    }
}

impl Drop for Video {
    fn drop(&mut self) {
        // Both fail only where the process has been waited for. The thread ends with the process's last pipe.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// `file:` keeps ffmpeg from taking a name with a colon for an address, one with a dash for an option.
fn source(path: &Path) -> OsString {
    let mut source = OsString::from("file:");
    source.push(path);
    source
}

fn ffmpeg(path: &Path, every_frame: [&str; 2]) -> Command {
    let mut command = Command::new("ffmpeg");
    command.args(["-nostdin", "-v", "error", "-i"]).arg(source(path)).args(every_frame);
    command.args(["-f", "yuv4mpegpipe", "-pix_fmt", "gray", "-"]);
    command
}

/// Width and height in the stream's first line, as in `YUV4MPEG2 W320 H256 F25:1 Ip A0:0 Cmono`.
fn frame_size(head: &[u8]) -> Option<(u32, u32)> {
    let mut words = std::str::from_utf8(head).ok()?.split(' ');
    if words.next() != Some("YUV4MPEG2") {
        return None;
    }
    let words: Vec<&str> = words.collect();
    let value = |key| words.iter().find_map(|word| word.strip_prefix(key));
    (value('C') == Some("mono")).then_some(())?;
    Some((value('W')?.parse().ok()?, value('H')?.parse().ok()?))
}

/// Reads all that ffmpeg says; the last line that is not empty.
fn last_line(stderr: ChildStderr) -> String {
    let mut last = String::new();
    for line in BufReader::new(stderr).split(b'\n').map_while(Result::ok) {
        let line = String::from_utf8_lossy(&line);
        if !line.trim().is_empty() {
            last = line.trim().to_owned();
        }
    }
    last
}

#[cfg(test)]
mod tests;
