//! The pictures of each frame, each kind in a folder of its own under the frame's name.

use std::path::{Path, PathBuf};

use pursuit_images::GreyImage;

use super::annotate::annotated;
use super::detector::{Answer, Detector};
use super::figures::{Figure2, figure4};
use super::{DetectError, Options};

/// Where the pictures go, and what they need of the frame before.
pub struct Pictures {
    annotate: Option<PathBuf>,
    fields: Option<PathBuf>,
    figure2: Option<(PathBuf, Figure2)>,
}

impl Pictures {
    /// Makes the folders.
    ///
    /// # Errors
    /// A folder cannot be made, is that of the images, or is asked for twice: pictures of a frame have the same
    /// name in each.
    pub fn prepare(options: &Options) -> Result<Pictures, DetectError> {
        let asked = [
            ("--annotate", &options.annotate),
            ("--fields", &options.fields),
            ("--figure2", &options.figure2),
        ];
        let mut taken = vec![(canonical(&options.path, "the images")?, "the images themselves")];
        for (option, folder) in asked {
            let Some(folder) = folder else { continue };
            std::fs::create_dir_all(folder).map_err(|error| refused(folder, option, &error))?;
            let place = canonical(folder, option)?;
            if let Some(&(_, holds)) = taken.iter().find(|(other, _)| *other == place) {
                return Err(DetectError::Overwrites { path: folder.clone(), option, holds });
            }
            taken.push((place, "other pictures"));
        }
        Ok(Pictures {
            annotate: options.annotate.clone(),
            fields: options.fields.clone(),
            figure2: options.figure2.clone().map(|folder| (folder, Figure2::default())),
        })
    }

    /// Writes all that are asked for of one frame. There are no vote fields where there is no frame before.
    ///
    /// # Errors
    /// A picture cannot be written.
    pub fn write(
        &mut self,
        name: &str,
        (before, frame): (Option<&GreyImage>, &GreyImage),
        answer: &Answer,
        detector: &Detector,
    ) -> Result<(), DetectError> {
        if let Some(folder) = &self.annotate {
            annotated(frame, answer).write_png(&folder.join(name))?;
        }
        if let Some(folder) = &self.fields {
            let fields = detector.vote_fields();
            if !fields.is_empty() {
                figure4(&fields).write_png(&folder.join(name))?;
            }
        }
        if let Some((folder, figure)) = &mut self.figure2 {
            figure.draw((before, frame), detector.levels()).write_png(&folder.join(name))?;
        }
        Ok(())
    }
}

fn canonical(folder: &Path, option: &'static str) -> Result<PathBuf, DetectError> {
    folder.canonicalize().map_err(|error| refused(folder, option, &error))
}

fn refused(folder: &Path, option: &'static str, error: &std::io::Error) -> DetectError {
    DetectError::Folder { path: folder.to_owned(), option, reason: error.to_string() }
}
