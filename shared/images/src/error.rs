//! What can go wrong with image files; every message is one line and names the file.

use std::path::PathBuf;

use thiserror::Error;

/// An image file or folder that cannot be used.
#[derive(Debug, Error)]
pub enum ImagesError {
    /// There is nothing at the path.
    #[error("{}: there is no such folder", .0.display())]
    NoFolder(PathBuf),
    /// The path is a file.
    #[error("{}: is a file, give the folder that holds the images", .0.display())]
    NotAFolder(PathBuf),
    /// The operating system refused.
    #[error("{}: cannot be {action}: {reason}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// `read` or `written`.
        action: &'static str,
        /// The operating system's words.
        reason: String,
    },
    /// Not an image, a truncated one, or of a kind that cannot be decoded.
    #[error("{}: is not a whole image: {reason}", path.display())]
    Broken {
        /// The file.
        path: PathBuf,
        /// The decoder's words.
        reason: String,
    },
    /// Smaller or larger than the limits allow.
    #[error("{}: is {width}x{height} pixels, each side must be {min_side} to {max_side} pixels", path.display())]
    Sides {
        /// The file.
        path: PathBuf,
        /// Its width in pixels.
        width: u32,
        /// Its height in pixels.
        height: u32,
        /// The shortest side in pixels.
        min_side: u32,
        /// The longest side in pixels.
        max_side: u32,
    },
    /// Its pixels take more memory than the limits allow.
    #[error("{}: takes {bytes} bytes to decode, at most {max_bytes} are allowed", path.display())]
    Memory {
        /// The file.
        path: PathBuf,
        /// What its pixels take.
        bytes: u64,
        /// The most they may take.
        max_bytes: u64,
    },
    /// Not of the size of the other frames.
    #[error("{}: is {width}x{height} pixels, must be {expected_width}x{expected_height}", path.display())]
    Size {
        /// The file.
        path: PathBuf,
        /// Its width in pixels.
        width: u32,
        /// Its height in pixels.
        height: u32,
        /// The width that was asked for, in pixels.
        expected_width: u32,
        /// The height that was asked for, in pixels.
        expected_height: u32,
    },
    /// A video, and no program to decode it.
    #[error(
        "{name}: to read a video the program ffmpeg is needed and is not installed; install the package ffmpeg, \
         or where there is one extract the images with `ffmpeg -i {name} FOLDER/%06d.png` and give that folder",
        name = .0.display()
    )]
    NoFfmpeg(PathBuf),
    /// ffmpeg gives no frame, or not all of them.
    #[error("{}: ffmpeg cannot decode it: {reason}", path.display())]
    Video {
        /// The video.
        path: PathBuf,
        /// The last line of its complaints, or what became of it.
        reason: String,
    },
}
