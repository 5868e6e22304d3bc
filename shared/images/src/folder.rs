//! The image files of a folder in the order in which a person numbers them.

use std::cmp::Ordering;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use crate::ImagesError;

const ENDINGS: [&str; 8] = ["png", "jpg", "jpeg", "pgm", "ppm", "pnm", "tif", "tiff"];

/// The files of `folder` whose names end like an image's, in natural order of their names (`f2` before
/// `f10`). Folders, hidden files and all other files are passed over; none at all is not an error.
///
/// # Errors
/// The folder is missing, is a file, or cannot be read.
pub fn list(folder: &Path) -> Result<Vec<PathBuf>, ImagesError> {
    let refused = |error: std::io::Error| match error.kind() {
        ErrorKind::NotFound => ImagesError::NoFolder(folder.to_owned()),
        ErrorKind::NotADirectory => ImagesError::NotAFolder(folder.to_owned()),
        _ => ImagesError::Io { path: folder.to_owned(), action: "read", reason: error.to_string() },
    };
    let mut images = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(refused)? {
        let path = entry.map_err(refused)?.path();
        // `is_dir` and not `is_file`: a link to nowhere is an image that is missing, and loading it says so.
        if is_image_name(&path) && !path.is_dir() {
            images.push(path);
        }
    }
    images.sort_by(|a, b| natural_order(name(a), name(b)));
    Ok(images)
}

fn name(path: &Path) -> &[u8] {
    path.file_name().map(|name| name.as_encoded_bytes()).unwrap_or_default()
}

/// Whether the name ends like an image's that [`list`] would give.
pub fn is_image_name(path: &Path) -> bool {
    let ending = path.extension().and_then(|ending| ending.to_str()).unwrap_or_default();
    !name(path).starts_with(b".") && ENDINGS.iter().any(|known| known.eq_ignore_ascii_case(ending))
}

/// Runs of digits compare as numbers of any length, all else byte by byte; names that differ in leading zeros
/// only (`f01`, `f1`) fall back to the bytes, so that the order is total.
fn natural_order(a: &[u8], b: &[u8]) -> Ordering {
    let (mut rest_a, mut rest_b) = (a, b);
    loop {
        let (Some(&first_a), Some(&first_b)) = (rest_a.first(), rest_b.first()) else {
            return rest_a.len().cmp(&rest_b.len()).then_with(|| a.cmp(b));
        };
        let ordering = if first_a.is_ascii_digit() && first_b.is_ascii_digit() {
            let (number_a, number_b) = (take_number(&mut rest_a), take_number(&mut rest_b));
            number_a.len().cmp(&number_b.len()).then_with(|| number_a.cmp(number_b))
        } else {
            (rest_a, rest_b) = (&rest_a[1..], &rest_b[1..]);
            first_a.cmp(&first_b)
        };
        if ordering != Ordering::Equal {
            return ordering;
        }
    }
}

/// Takes the digits at the front; gives them without leading zeros.
fn take_number<'a>(rest: &mut &'a [u8]) -> &'a [u8] {
    let end = rest.iter().position(|byte| !byte.is_ascii_digit()).unwrap_or(rest.len());
    let (digits, after) = rest.split_at(end);
    *rest = after;
    let zeros = digits.iter().take_while(|&&digit| digit == b'0').count();
    &digits[zeros..]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_in_names_count_as_numbers() {
        let mut names =
            ["f10", "f2", "f1", "f01", "g", "f", "f2a10", "f2a9", "f99999999999999999999999", "f1.png"];
        names.sort_by(|a, b| natural_order(a.as_bytes(), b.as_bytes()));
        let expected =
            ["f", "f01", "f1", "f1.png", "f2", "f2a9", "f2a10", "f10", "f99999999999999999999999", "g"];
        assert_eq!(names, expected);
    }
}
