//! The simulated scene's textures, kept for the next process: painting them takes ten times as long as all else
//! that a camera needs to start.

use pursuit_scene::{SceneParameters, Textures};
use std::path::Path;

/// Length of the checksum behind the textures, bytes.
const CHECKSUM: usize = 4;

/// The textures of the file at `path`; they are painted, and kept there, where the file has none of these
/// parameters, or not all of them.
pub fn textures(path: &Path, parameters: &SceneParameters) -> Textures {
    if let Some(kept) = read(path, parameters) {
        return kept;
    }
    let painted = Textures::paint(parameters);
    if let Err(error) = keep(path, painted.to_bytes(parameters)) {
        tracing::debug!("{}: {error}; a restart paints the scene again", path.display());
    }
    painted
}

fn read(path: &Path, parameters: &SceneParameters) -> Option<Textures> {
    let bytes = std::fs::read(path).ok()?;
    let (textures, checksum) = bytes.split_at(bytes.len().checked_sub(CHECKSUM)?);
    let whole = checksum == crc32fast::hash(textures).to_le_bytes();
    Textures::from_bytes(parameters, textures).filter(|_| whole)
}

/// Written aside: whoever reads finds all, or nothing.
fn keep(path: &Path, mut bytes: Vec<u8>) -> std::io::Result<()> {
    bytes.extend(crc32fast::hash(&bytes).to_le_bytes());
    let aside = path.with_extension("new");
    std::fs::write(&aside, bytes)?;
    std::fs::rename(aside, path)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_kept_is_used_and_what_is_damaged_is_painted_again() {
        let path = std::env::temp_dir().join(format!("pursuit-textures-{}", std::process::id()));
        let parameters = SceneParameters { texture_texels: 256, ..SceneParameters::default() };
        let painted = textures(&path, &parameters).to_bytes(&parameters);
        let whole = std::fs::read(&path).unwrap();
        assert!(read(&path, &parameters).is_some());
        for at in [0, 40, whole.len() / 2, whole.len() - 1] {
            let mut damaged = whole.clone();
            damaged[at] ^= 4;
            std::fs::write(&path, &damaged).unwrap();
            assert!(read(&path, &parameters).is_none(), "byte {at}");
            assert!(textures(&path, &parameters).to_bytes(&parameters) == painted);
            assert!(std::fs::read(&path).unwrap() == whole, "mended");
        }
        std::fs::write(&path, &whole[..whole.len() / 2]).unwrap();
        assert!(read(&path, &parameters).is_none());
        std::fs::write(&path, b"").unwrap();
        assert!(read(&path, &parameters).is_none());
        std::fs::remove_file(&path).unwrap();
    }

    #[test]
    fn a_directory_that_is_not_there_stops_nobody() {
        let parameters = SceneParameters { texture_texels: 256, ..SceneParameters::default() };
        let kept = textures(Path::new("/nowhere/textures"), &parameters).to_bytes(&parameters);
        assert!(kept == Textures::paint(&parameters).to_bytes(&parameters));
    }
}
