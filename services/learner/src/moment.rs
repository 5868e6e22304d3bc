//! One frame as the learner sees it: checked, and in its own coordinates.

use pursuit_learning::{Normalisation, View};
use pursuit_messages::{Detection, ImageShape, Target, TrackPhase};

/// Everything that is known about one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Input {
    /// Number of the frame, rising.
    pub frame: u64,
    /// Time of its exposure, ns.
    pub exposure_ns: u64,
    /// Its size.
    pub image: ImageShape,
    /// What segmentation says of it.
    pub target: Target,
    /// Joints 1 and 2 *at the exposure*, rad. At any other time learning fails: 80 ms off cost 5 cm.
    pub joints: [f64; 2],
    /// Their velocities at the exposure, rad/s.
    pub velocities: [f64; 2],
}

/// An [`Input`] that has been checked.
#[derive(Clone, Copy, Debug)]
pub struct Moment {
    pub(crate) now_ns: u64,
    pub(crate) joints: [f64; 2],
    /// Larger of the two speeds, rad/s.
    pub(crate) speed: f64,
    pub(crate) blob: Option<Blob>,
    /// Motion detection.
    pub(crate) motion: Option<Motion>,
    pub(crate) normalisation: Normalisation,
}

/// What moves independently, in one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Motion {
    /// px from the image's centre.
    pub(crate) point_px: [f64; 2],
    /// Mean variance of the two directions, px², where the detector says it.
    pub(crate) variance_px2: Option<f64>,
    /// Visible area, px², 0 where it is not known.
    pub(crate) area_px2: f64,
}

/// The training target in one frame.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Blob {
    pub(crate) view: View,
    /// Whether no part of it is cut off by the image's edge: what is cut off has its centre elsewhere.
    pub(crate) whole: bool,
}

impl Moment {
    /// Where what moves independently is, px from the image's centre.
    pub fn motion_px(&self) -> Option<[f64; 2]> {
        self.motion.map(|motion| motion.point_px)
    }

    /// `None` where joints or image cannot be used. A detection that is not finite is none.
    pub fn of(input: &Input) -> Option<Moment> {
        let [width, height] = [input.image.width, input.image.height].map(f64::from);
        let joints_finite = input.joints.iter().chain(&input.velocities).all(|joint| joint.is_finite());
        if !joints_finite || width < 1.0 || height < 1.0 {
            return None;
        }
        let centred = |detection: &Detection| {
            let point = [detection.u - (width - 1.0) / 2.0, detection.v - (height - 1.0) / 2.0];
            (detection.found == 1 && point.iter().all(|axis| axis.is_finite())).then_some(point)
        };
        let half = [width / 2.0, height / 2.0];
        let blob = &input.target.blob;
        Some(Moment {
            now_ns: input.exposure_ns,
            joints: input.joints,
            speed: input.velocities[0].abs().max(input.velocities[1].abs()),
            blob: centred(blob).map(|point_px| Blob {
                view: View { point_px, joints: input.joints },
                whole: is_whole(point_px, blob.area_px, half),
            }),
            motion: centred(moving(&input.target))
                .map(|point_px| Motion::of(moving(&input.target), point_px)),
            normalisation: Normalisation { half_width_px: half[0] },
        })
    }
}

/// What moves independently: as this pair shows it, or, where that is not sure enough alone, as the track
/// that was seen in it does. A track that coasts is a guess, and a guess must not move the arm.
fn moving(target: &Target) -> &Detection {
    let seen = target.track_phase == TrackPhase::Confirmed as u32;
    if target.motion.found == 0 && seen { &target.track } else { &target.motion }
}

impl Motion {
    fn of(detection: &Detection, point_px: [f64; 2]) -> Motion {
        let [uu, _, vv] = detection.position_covariance;
        let mean = 0.5 * (uu + vv);
        let area = detection.area_px;
        Motion {
            point_px,
            variance_px2: (mean > 0.0 && mean.is_finite()).then_some(mean),
            area_px2: if area > 0.0 && area.is_finite() { area } else { 0.0 },
        }
    }
}

/// Whether a disc of that area around that point lies inside the image, with a pixel to spare.
fn is_whole(point_px: [f64; 2], area_px: f64, half: [f64; 2]) -> bool {
    let reach = (area_px.max(0.0) / std::f64::consts::PI).sqrt() + 1.0;
    point_px[0].abs() + reach <= half[0] && point_px[1].abs() + reach <= half[1]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn input(u: f64, area_px: f64) -> Input {
        let blob = Detection { found: 1, u, v: 255.5, area_px, ..Detection::default() };
        Input {
            frame: 1,
            exposure_ns: 0,
            image: ImageShape { width: 512, height: 512, stride: 512, format: 1 },
            target: Target { blob, ..Target::default() },
            joints: [0.0, 0.6],
            velocities: [0.0; 2],
        }
    }

    fn point(input: &Input) -> Option<[f64; 2]> {
        Moment::of(input).unwrap().motion.map(|motion| motion.point_px)
    }

    #[test]
    fn a_track_stands_in_for_a_pair_that_is_not_sure_enough_but_a_guess_does_not() {
        let mut input = input(0.0, 0.0);
        input.target.track = Detection { found: 1, u: 265.5, v: 255.5, ..Detection::default() };
        input.target.track_phase = TrackPhase::Coasting as u32;
        assert_eq!(point(&input), None);
        input.target.track_phase = TrackPhase::Confirmed as u32;
        assert_eq!(point(&input), Some([10.0, 0.0]));
        input.target.motion = Detection { found: 1, u: 258.5, v: 255.5, ..Detection::default() };
        assert_eq!(point(&input), Some([3.0, 0.0]), "the pair comes first");
    }

    #[test]
    fn the_middle_of_the_image_is_the_origin() {
        let blob = Moment::of(&input(255.5, 0.0)).unwrap().blob.unwrap();
        assert_eq!(blob.view.point_px, [0.0, 0.0]);
    }

    #[test]
    fn a_blob_that_touches_the_edge_is_not_whole() {
        let area = 20.0f64.powi(2) * std::f64::consts::PI;
        let whole = |u| Moment::of(&input(u, area)).unwrap().blob.unwrap().whole;
        assert!(whole(511.5 - 21.5) && !whole(511.5 - 19.0) && !whole(15.0));
    }

    #[test]
    fn what_is_not_finite_is_refused() {
        assert!(Moment::of(&input(f64::NAN, 0.0)).unwrap().blob.is_none());
        assert!(Moment::of(&Input { joints: [f64::NAN, 0.0], ..input(1.0, 0.0) }).is_none());
        assert!(Moment::of(&Input { velocities: [0.0, f64::INFINITY], ..input(1.0, 0.0) }).is_none());
        let nothing = ImageShape { width: 0, height: 0, stride: 0, format: 1 };
        assert!(Moment::of(&Input { image: nothing, ..input(1.0, 0.0) }).is_none());
    }
}
