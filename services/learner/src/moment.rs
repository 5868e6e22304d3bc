//! One frame as the learner sees it: checked, and in its own coordinates.

use pursuit_learning::consensus::Sighting;
use pursuit_learning::{Normalisation, View};
use pursuit_messages::{Detection, ImageShape, Target, TrackPhase};

use crate::refusals::{MAX_JOINT_RAD, MAX_JOINT_RAD_PER_S, Refusals, Refused};

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
    pub(crate) frame: u64,
    pub(crate) now_ns: u64,
    pub(crate) joints: [f64; 2],
    pub(crate) velocities: [f64; 2],
    /// Larger of the two speeds, rad/s.
    pub(crate) speed: f64,
    pub(crate) blob: Option<Blob>,
    /// Motion detection.
    pub(crate) motion: Option<Motion>,
    /// How the background moved since the last frame; `None` where that is not known.
    pub(crate) background: Option<Background>,
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

/// Motion of the background since an earlier frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Background {
    /// Displacement that ends in the middle of the image, px.
    pub(crate) shift_px: [f64; 2],
    /// Turn in the image, rad; `None` where the detector does not see turns.
    pub(crate) turn_rad: Option<f64>,
    /// Frames that it took.
    pub(crate) frames: u64,
}

/// The training target in one frame.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Blob {
    pub(crate) view: View,
    /// Whether no part of it is cut off by the image's edge: what is cut off has its centre elsewhere.
    pub(crate) whole: bool,
    /// Its distance from the image's centre along x or y, the larger, in half images.
    pub(crate) off_centre: f64,
}

impl Moment {
    /// Where what moves independently is, px from the image's centre.
    pub fn motion_px(&self) -> Option<[f64; 2]> {
        self.motion.map(|motion| motion.point_px)
    }

    /// A view of something in this frame.
    pub(crate) fn sighting(&self, view: View) -> Sighting {
        Sighting { time_ns: self.now_ns, view }
    }

    /// `Err` where joints or image cannot be used. A detection that cannot be is none, and counted.
    /// `clock_offset_s` is the time that the joints' clock is ahead: the joints of so much later belong to
    /// the image. To the first order: a few tens of ms are made up for up to a mrad.
    pub fn of(input: &Input, clock_offset_s: f64, refusals: &mut Refusals) -> Result<Moment, Refused> {
        let [width, height] = [input.image.width, input.image.height].map(f64::from);
        let finite = input.joints.iter().chain(&input.velocities).all(|joint| joint.is_finite());
        if !finite || width < 1.0 || height < 1.0 {
            return Err(Refused::NotFinite);
        }
        let turned = input.joints.iter().any(|joint| joint.abs() > MAX_JOINT_RAD);
        if turned || input.velocities.iter().any(|speed| speed.abs() > MAX_JOINT_RAD_PER_S) {
            return Err(Refused::Absurd);
        }
        let mut centred = |detection: &Detection| {
            if detection.found != 1 {
                return None;
            }
            match in_the_image([detection.u, detection.v], [width, height]) {
                Ok(point_px) => Some(point_px),
                Err(reason) => {
                    refusals.add(reason, 1);
                    None
                }
            }
        };
        let half = [width / 2.0, height / 2.0];
        let joints = [0, 1].map(|k| input.joints[k] + clock_offset_s * input.velocities[k]);
        let blob = &input.target.blob;
        Ok(Moment {
            frame: input.frame,
            now_ns: input.exposure_ns,
            joints,
            velocities: input.velocities,
            speed: input.velocities[0].abs().max(input.velocities[1].abs()),
            blob: centred(blob).map(|point_px| Blob {
                view: View { point_px, joints, velocities: input.velocities },
                whole: is_whole(point_px, blob.area_px, half),
                off_centre: (point_px[0].abs() / half[0]).max(point_px[1].abs() / half[1]),
            }),
            motion: centred(moving(&input.target))
                .map(|point_px| Motion::of(moving(&input.target), point_px)),
            background: background(&input.target),
            normalisation: Normalisation { half_width_px: half[0] },
        })
    }
}

/// A detection's place, px from the middle of an image of that size.
fn in_the_image(place: [f64; 2], size: [f64; 2]) -> Result<[f64; 2], Refused> {
    if !place.iter().all(|axis| axis.is_finite()) {
        return Err(Refused::NotFinite);
    }
    if (0..2).any(|axis| !(-0.5..=size[axis] - 0.5).contains(&place[axis])) {
        return Err(Refused::OutsideImage);
    }
    Ok([0, 1].map(|axis| place[axis] - (size[axis] - 1.0) / 2.0))
}

/// The background's motion since the frame before; `None` where there is none to be had.
fn background(target: &Target) -> Option<Background> {
    let frames = target.background_frames;
    let [u, v, turn] = [target.background_u, target.background_v, target.background_turn_rad]
        .map(|per_frame| per_frame * f64::from(frames));
    let sane = frames > 0 && [u, v, turn].iter().all(|value| value.is_finite());
    let turns = target.background_turn_rad != 0.0;
    sane.then_some(Background {
        shift_px: [u, v],
        turn_rad: turns.then_some(turn),
        frames: u64::from(frames),
    })
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

    fn moment(input: &Input) -> Result<Moment, Refused> {
        Moment::of(input, 0.0, &mut Refusals::default())
    }

    fn point(input: &Input) -> Option<[f64; 2]> {
        moment(input).unwrap().motion_px()
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
        let blob = moment(&input(255.5, 0.0)).unwrap().blob.unwrap();
        assert_eq!(blob.view.point_px, [0.0, 0.0]);
    }

    #[test]
    fn a_blob_that_touches_the_edge_is_not_whole() {
        let area = 20.0f64.powi(2) * std::f64::consts::PI;
        let whole = |u| moment(&input(u, area)).unwrap().blob.unwrap().whole;
        assert!(whole(511.5 - 21.5) && !whole(511.5 - 19.0) && !whole(15.0));
    }

    #[test]
    fn what_cannot_be_is_refused_and_counted_by_reason() {
        let mut refusals = Refusals::default();
        let mut of = |input: Input| Moment::of(&input, 0.0, &mut refusals);
        assert!(of(input(f64::NAN, 0.0)).unwrap().blob.is_none());
        assert!(of(input(512.0, 0.0)).unwrap().blob.is_none());
        assert!(of(input(511.4, 0.0)).unwrap().blob.is_some());
        let joints = |joints| Input { joints, ..input(1.0, 0.0) };
        let velocities = |velocities| Input { velocities, ..input(1.0, 0.0) };
        assert_eq!(of(joints([f64::NAN, 0.0])).err(), Some(Refused::NotFinite));
        assert_eq!(of(joints([0.0, 1e6])).err(), Some(Refused::Absurd));
        assert_eq!(of(velocities([0.0, f64::INFINITY])).err(), Some(Refused::NotFinite));
        assert_eq!(of(velocities([-90.0, 0.0])).err(), Some(Refused::Absurd));
        let nothing = ImageShape { width: 0, height: 0, stride: 0, format: 1 };
        assert_eq!(of(Input { image: nothing, ..input(1.0, 0.0) }).err(), Some(Refused::NotFinite));
        let counts = refusals.counts();
        assert_eq!([counts[Refused::NotFinite as usize], counts[Refused::OutsideImage as usize]], [1, 1]);
    }

    #[test]
    fn a_background_that_was_not_measured_did_not_rest_either() {
        let mut input = input(1.0, 0.0);
        assert_eq!(moment(&input).unwrap().background, None);
        (input.target.background_frames, input.target.background_u) = (2, 1.5);
        let background = moment(&input).unwrap().background.unwrap();
        assert_eq!((background.shift_px, background.turn_rad, background.frames), ([3.0, 0.0], None, 2));
        input.target.background_v = f64::NAN;
        assert_eq!(moment(&input).unwrap().background, None);
    }
}
