//! What is asked of a scene: where the camera is and where the target is, at one exposure.

use std::fmt;

use crate::parameters::{FOCAL_PX, SceneParameters};

/// A quaternion may be off unit length by this much before it is refused; it is normalised anyway.
const NORM_TOLERANCE: f64 = 1e-3;
/// Least focal length, pixels: a wider lens is no pinhole any more.
const LEAST_FOCAL_PX: f64 = 1.0;

/// Which scene is filmed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// The training scene: a white disc on dark cloth.
    Blob,
    /// The pursuit scene: a box in the same camouflage as the table it drives on.
    Vehicle,
}

/// A reflection on the lens: a disc of the brightest white that hides what is behind it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Glare {
    /// Its middle in the image (right, down), pixels.
    pub centre_px: [f64; 2],
    /// Its radius, pixels.
    pub radius_px: f64,
}

/// One exposure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Optical centre in the base frame, metres.
    pub camera_position: [f64; 3],
    /// base_from_camera, a unit quaternion (x, y, z, w).
    pub camera_rotation: [f64; 4],
    /// Focal length, pixels; the principal point is the middle of the frame.
    pub focal_px: f64,
    /// Which scene.
    pub kind: Kind,
    /// Centre of the target's footprint on the table, base frame, metres.
    pub target_position: [f64; 2],
    /// Direction of the target's long axis from the base's x axis, radians.
    pub target_heading: f64,
    /// The glare on the lens, if there is one.
    pub glare: Option<Glare>,
    /// Number of the frame: the noise is a function of it, of the row and of the seed.
    pub frame: u64,
    /// Simulated time of the exposure's middle, nanoseconds: the lamps' flicker is a function of it.
    pub time_ns: u64,
}

impl View {
    /// A camera at `position` that looks straight down, turned so that the image's x axis points along
    /// (cos `yaw`, sin `yaw`), metres and radians; its focal length is [`FOCAL_PX`].
    pub fn looking_down(position: [f64; 3], yaw: f64, kind: Kind) -> Self {
        let (s, c) = (libm::sin(0.5 * yaw), libm::cos(0.5 * yaw));
        Self {
            camera_position: position,
            // rotation by yaw about z after half a turn about x
            camera_rotation: [c, s, 0.0, 0.0],
            focal_px: FOCAL_PX,
            kind,
            target_position: [position[0], position[1]],
            target_heading: 0.0,
            glare: None,
            frame: 0,
            time_ns: 0,
        }
    }
}

/// A view that cannot be rendered.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ViewError {
    /// A pose holds a number that is not finite.
    NotFinite {
        /// Which field of the view.
        field: &'static str,
    },
    /// No lens has this focal length.
    FocalLength {
        /// Pixels.
        focal_px: f64,
    },
    /// The camera's quaternion is not of unit length.
    NotARotation {
        /// Its length.
        norm: f64,
    },
    /// The pixels given do not hold the frame.
    BufferTooSmall {
        /// Bytes given.
        given: usize,
        /// Bytes that rows, stride and width need.
        needed: usize,
    },
    /// Rows would overlap.
    StrideTooSmall {
        /// Stride given, bytes.
        stride: usize,
        /// Width of a row, bytes.
        width: usize,
    },
}

impl fmt::Display for ViewError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotFinite { field } => write!(f, "{field} of the view is not finite"),
            Self::FocalLength { focal_px } => {
                write!(f, "a focal length of {focal_px} px, permitted is {LEAST_FOCAL_PX} or more")
            }
            Self::NotARotation { norm } => {
                write!(f, "camera_rotation has length {norm}, a rotation has length 1")
            }
            Self::BufferTooSmall { given, needed } => {
                write!(f, "the frame needs {needed} bytes, the buffer has {given}")
            }
            Self::StrideTooSmall { stride, width } => {
                write!(f, "the stride is {stride} bytes, a row has {width}")
            }
        }
    }
}

impl std::error::Error for ViewError {}

/// A pinhole camera in its place.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Camera {
    /// Optical centre, base frame, metres.
    pub(crate) position: [f64; 3],
    /// Columns of base_from_camera: the camera's x, y, z axes in the base frame.
    pub(crate) axes: [[f64; 3]; 3],
    /// Focal length, pixels.
    pub(crate) focal_px: f64,
    /// Principal point: the middle of the frame.
    pub(crate) principal: [f64; 2],
}

impl Camera {
    /// The camera of `parameters` at the pose of `view`.
    ///
    /// # Errors
    /// A pose that is not finite or not a rotation, a focal length that is none.
    pub(crate) fn new(parameters: &SceneParameters, view: &View) -> Result<Self, ViewError> {
        check_finite(view)?;
        let norm = view.camera_rotation.iter().map(|q| q * q).sum::<f64>().sqrt();
        if (norm - 1.0).abs() > NORM_TOLERANCE {
            return Err(ViewError::NotARotation { norm });
        }
        if !(view.focal_px >= LEAST_FOCAL_PX && view.focal_px.is_finite()) {
            return Err(ViewError::FocalLength { focal_px: view.focal_px });
        }
        let [x, y, z, w] = view.camera_rotation.map(|q| q / norm);
        Ok(Self {
            position: view.camera_position,
            axes: [
                [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + z * w), 2.0 * (x * z - y * w)],
                [2.0 * (x * y - z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + x * w)],
                [2.0 * (x * z + y * w), 2.0 * (y * z - x * w), 1.0 - 2.0 * (x * x + y * y)],
            ],
            focal_px: view.focal_px,
            principal: [0.5 * (parameters.width as f64 - 1.0), 0.5 * (parameters.height as f64 - 1.0)],
        })
    }

    /// A point of the base frame in the camera's, metres.
    pub(crate) fn camera_from_base(&self, point: [f64; 3]) -> [f64; 3] {
        let offset = difference(point, self.position);
        self.axes.map(|axis| dot(axis, offset))
    }

    /// Image coordinates of a point of the camera frame in front of the camera.
    pub(crate) fn project(&self, point: [f64; 3]) -> [f64; 2] {
        let scale = self.focal_px / point[2];
        [scale * point[0] + self.principal[0], scale * point[1] + self.principal[1]]
    }
}

fn check_finite(view: &View) -> Result<(), ViewError> {
    let glare =
        view.glare.map_or([0.0; 3], |glare| [glare.centre_px[0], glare.centre_px[1], glare.radius_px]);
    let fields: [(&'static str, &[f64]); 5] = [
        ("camera_position", &view.camera_position),
        ("camera_rotation", &view.camera_rotation),
        ("target_position", &view.target_position),
        ("target_heading", &[view.target_heading]),
        ("glare", &glare),
    ];
    for (field, numbers) in fields {
        if !numbers.iter().all(|x| x.is_finite()) {
            return Err(ViewError::NotFinite { field });
        }
    }
    Ok(())
}

pub(crate) fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(crate) fn difference(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn looking_down_has_its_axes_where_its_name_says() {
        let yaw = 0.7;
        let view = View::looking_down([0.6, 0.1, 0.5], yaw, Kind::Blob);
        let camera = Camera::new(&SceneParameters::default(), &view).unwrap();
        let expected = [[yaw.cos(), yaw.sin(), 0.0], [yaw.sin(), -yaw.cos(), 0.0], [0.0, 0.0, -1.0]];
        for (axis, wanted) in camera.axes.iter().zip(expected) {
            for (a, b) in axis.iter().zip(wanted) {
                assert!((a - b).abs() < 1e-12, "{axis:?} for {wanted:?}");
            }
        }
    }

    #[test]
    fn poses_that_are_none_are_refused() {
        let parameters = SceneParameters::default();
        let mut view = View::looking_down([0.6, 0.1, 0.5], 0.0, Kind::Blob);
        view.target_heading = f64::NAN;
        let error = Camera::new(&parameters, &view).unwrap_err();
        assert_eq!(error, ViewError::NotFinite { field: "target_heading" });
        let mut view = View::looking_down([0.6, 0.1, 0.5], 0.0, Kind::Blob);
        view.camera_rotation = [0.0; 4];
        assert_eq!(Camera::new(&parameters, &view).unwrap_err(), ViewError::NotARotation { norm: 0.0 });
        let view = View { focal_px: 0.0, ..View::looking_down([0.6, 0.1, 0.5], 0.0, Kind::Blob) };
        assert_eq!(Camera::new(&parameters, &view).unwrap_err(), ViewError::FocalLength { focal_px: 0.0 });
    }
}
