//! Whether a camera's images are images: frozen, dark, bright, or covered cameras go on sending. Pure.
//!
//! An image sensor has noise, so two images are never the same to the bit. A camera that repeats itself is stuck,
//! and its images, however fresh their stamps, say nothing of now: they must not be sent. An image without light or
//! texture says what it shows, which is nothing; it is sent, and told.

use pursuit_messages::Lack;

/// Rows and columns that are looked at for light and texture: each so many.
const STEP: usize = 8;
/// A mean grey level up to this is darkness, from [`BRIGHT`] on a flood of light.
const DARK: f64 = 6.0;
/// See [`DARK`].
const BRIGHT: f64 = 249.0;
/// A standard deviation of grey levels below this is noise, no texture.
const FLAT: f64 = 4.0;
/// An image that came again once may be a slow camera's accident.
const TWICE: u32 = 2;
/// Lack of light or texture is told when it lasts so long, ns.
const LASTS_NS: u64 = 300_000_000;

/// Watches one camera's images.
#[derive(Clone, Debug)]
pub struct Sanity {
    /// The same image for so long is a stuck camera, ns; 0: never.
    frozen_ns: u64,
    /// Checksum of the last image, since when it is the same, ns, and how often it came again.
    last: Option<(u32, u64, u32)>,
    /// What the images have lacked, and since when, ns.
    lacks: Option<(Lack, u64)>,
}

impl Sanity {
    /// One that has seen nothing.
    pub fn new(frozen_ns: u64) -> Sanity {
        Sanity { frozen_ns, last: None, lacks: None }
    }

    /// What an image of rows of `width` pixels lacks that was taken at `time_ns`.
    pub fn look(&mut self, pixels: &[u8], width: usize, time_ns: u64) -> Lack {
        if self.is_frozen(pixels, time_ns) {
            return Lack::Frozen;
        }
        let lack = lack_of(pixels, width);
        let since = match self.lacks {
            Some((before, since)) if before == lack => since,
            _ => time_ns,
        };
        self.lacks = Some((lack, since));
        if time_ns.saturating_sub(since) >= LASTS_NS { lack } else { Lack::Nothing }
    }

    fn is_frozen(&mut self, pixels: &[u8], time_ns: u64) -> bool {
        if self.frozen_ns == 0 {
            return false;
        }
        let sum = crc32fast::hash(pixels);
        match &mut self.last {
            Some((last, since, again)) if *last == sum => {
                *again = again.saturating_add(1);
                *again >= TWICE && time_ns.saturating_sub(*since) >= self.frozen_ns
            }
            _ => {
                self.last = Some((sum, time_ns, 0));
                false
            }
        }
    }
}

/// Light and texture of an image.
fn lack_of(pixels: &[u8], width: usize) -> Lack {
    let (mut count, mut sum, mut squares) = (0u64, 0u64, 0u64);
    for row in pixels.chunks_exact(width.max(1)).step_by(STEP) {
        for grey in row.iter().step_by(STEP).map(|grey| u64::from(*grey)) {
            count += 1;
            sum += grey;
            squares += grey * grey;
        }
    }
    let count = count.max(1) as f64;
    let mean = sum as f64 / count;
    let deviation = (squares as f64 / count - mean * mean).max(0.0).sqrt();
    match mean {
        _ if deviation >= FLAT => Lack::Nothing,
        mean if mean <= DARK => Lack::Light,
        mean if mean >= BRIGHT => Lack::Shade,
        _ => Lack::Texture,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: usize = 64;
    const MS: u64 = 1_000_000;

    /// Noise of some grey levels around a pattern; another one for each number.
    fn image(mean: f64, contrast: f64, number: u32) -> Vec<u8> {
        let noise = |at: usize| {
            let mixed = (at as u32 + 1).wrapping_mul(2_654_435_761) ^ number.wrapping_mul(0x9e37_79b9);
            f64::from(mixed.wrapping_mul(0x85eb_ca6b) >> 30)
        };
        let grey = |at: usize| {
            let wave = if (at / 16).is_multiple_of(2) { contrast } else { -contrast };
            (mean + wave + noise(at)).clamp(0.0, 255.0) as u8
        };
        (0..WIDTH * WIDTH).map(grey).collect()
    }

    /// What is said of images at 25 Hz.
    fn said(images: impl IntoIterator<Item = Vec<u8>>, frozen_ns: u64) -> Vec<Lack> {
        let mut sanity = Sanity::new(frozen_ns);
        let images = images.into_iter().enumerate();
        images.map(|(number, image)| sanity.look(&image, WIDTH, number as u64 * 40 * MS)).collect()
    }

    #[test]
    fn a_camera_that_repeats_itself_is_stuck_and_one_that_moves_again_is_not() {
        let stuck = (0..6).map(|_| image(100.0, 40.0, 3));
        let lacks = said(stuck.chain([image(100.0, 40.0, 4)]), 100 * MS);
        let (nothing, frozen) = (Lack::Nothing, Lack::Frozen);
        assert_eq!(lacks, [nothing, nothing, nothing, frozen, frozen, frozen, nothing]);
        assert!(said((0..9).map(|_| image(100.0, 40.0, 3)), 0).iter().all(|lack| *lack == nothing));
    }

    #[test]
    fn one_repeated_image_of_a_slow_camera_is_no_stuck_one() {
        let mut sanity = Sanity::new(100 * MS);
        let slow = |number: u64| number * 500 * MS;
        let lacks = [3, 3, 4, 4, 4].into_iter().zip(0..);
        let said: Vec<Lack> =
            lacks.map(|(image_of, at)| sanity.look(&image(100.0, 40.0, image_of), WIDTH, slow(at))).collect();
        assert_eq!(said[..4], [Lack::Nothing; 4]);
        assert_eq!(said[4], Lack::Frozen);
    }

    #[test]
    fn noise_alone_is_not_frozen() {
        let lacks = said((0..50).map(|number| image(100.0, 40.0, number)), 100 * MS);
        assert!(lacks.iter().all(|lack| *lack == Lack::Nothing), "{lacks:?}");
    }

    #[test]
    fn darkness_flood_and_cover_are_told_when_they_last() {
        for (mean, lack) in [(1.0, Lack::Light), (253.0, Lack::Shade), (90.0, Lack::Texture)] {
            let lacks = said((0..12).map(|number| image(mean, 0.0, number)), 100 * MS);
            assert!(lacks[..7].iter().all(|lack| *lack == Lack::Nothing), "a moment is none: {lacks:?}");
            assert_eq!(lacks[11], lack);
        }
    }

    /// Real images of four cameras: none lacks anything, and none repeats itself.
    #[test]
    fn real_sequences_trip_nothing() {
        let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
        let Ok(sequences) = std::fs::read_dir(&folder) else {
            eprintln!("skipped: no real image sequences in {}", folder.display());
            return;
        };
        let mut images = 0;
        for sequence in sequences.flatten().map(|entry| entry.path()).filter(|path| path.is_dir()) {
            let mut sanity = Sanity::new(MS);
            for file in pursuit_images::list(&sequence).unwrap_or_default() {
                let Ok(image) = pursuit_images::load_grey(&file, pursuit_images::Limits::default()) else {
                    continue;
                };
                images += 1;
                let lack = sanity.look(&image.pixels, image.width as usize, images * 40 * MS);
                assert_eq!(lack, Lack::Nothing, "{}", file.display());
            }
        }
        assert!(images > 100, "{images} images");
    }
}
