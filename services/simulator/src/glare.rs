//! Wrong detections on purpose: a reflection on the lens that is brighter and larger than the blob.

use pursuit_kinematics::Camera;
use pursuit_scene::{BLOB_RADIUS_M, Glare};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Radius of a glare in radii of the blob's image: with four times its area the blob is no rival to it, so
/// that a detector of bright blobs takes the glare for the target.
const BLOB_RADII: f64 = 2.0;
/// Largest radius, share of the image's shorter side.
const MAX_RADIUS_SHARE: f64 = 0.2;
/// Least distance of its rim from the image's border, px: what touches the border is not taken for a blob.
const MARGIN_PX: f64 = 10.0;
/// First of the random streams of the glares; below it are those of the blob's places.
const STREAM: u64 = 1 << 40;

/// The glare on frame number `frame`, with a probability of `share`; its place is uniformly random in the
/// image. A function of the arguments alone.
pub fn glare(seed: u64, frame: u64, share: f64, camera: &Camera, height_m: f64) -> Option<Glare> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    random.set_stream(STREAM + frame);
    if random.random_range(0.0..1.0) >= share {
        return None;
    }
    let size = [camera.width, camera.height].map(f64::from);
    let blob_px = BLOB_RADIUS_M * camera.focal_px / height_m;
    let radius_px = (BLOB_RADII * blob_px).min(MAX_RADIUS_SHARE * size[0].min(size[1]));
    let margin = (radius_px + MARGIN_PX).min(0.45 * size[0].min(size[1]));
    let centre_px = size.map(|side| random.random_range(margin..side - margin) - 0.5);
    Some(Glare { centre_px, radius_px })
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn of(frame: u64, share: f64) -> Option<Glare> {
        glare(5, frame, share, &Camera::default_cell(), 0.5)
    }

    #[test]
    fn they_come_as_often_as_wanted() {
        for (share, low, high) in [(0.0, 0, 0), (0.15, 240, 360), (1.0, 2000, 2000)] {
            let count = (0..2000).filter(|frame| of(*frame, share).is_some()).count();
            assert!((low..=high).contains(&count), "{count} of 2000 at {share}");
        }
    }

    #[test]
    fn they_are_all_over_the_image_and_never_at_its_border() {
        let all: Vec<Glare> = (0..2000).map(|frame| of(frame, 1.0).unwrap()).collect();
        let mean = |axis: usize| all.iter().map(|glare| glare.centre_px[axis]).sum::<f64>() / 2000.0;
        // Uniform over 440 px: the mean of 2000 is within four of its standard deviations of the middle.
        assert!((mean(0) - 255.5).abs() < 12.0 && (mean(1) - 255.5).abs() < 12.0);
        let rim =
            |glare: &Glare| glare.centre_px.map(|c| (c - glare.radius_px).min(511.0 - c - glare.radius_px));
        assert!(all.iter().flat_map(rim).all(|distance| distance > 8.0));
    }

    #[test]
    fn a_frame_that_is_asked_for_again_has_the_same_glare() {
        assert_eq!(of(7, 0.9), of(7, 0.9));
        assert_ne!(of(7, 1.0), of(8, 1.0));
    }
}
