//! The pinhole camera.

use nalgebra::{Isometry3, Point3};
use serde::{Deserialize, Serialize};

/// A pinhole camera without distortion, square pixels, principal point in the middle of the image.
///
/// Its frame: x to the right of the image, y down the image, z along the view. *Pixels* (u, v) have
/// their origin at the centre of the top-left pixel; *centred pixels* (x, y) at the principal point.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Camera {
    /// Pixels per row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Focal length, px.
    pub focal_px: f64,
    /// Angle of the camera on the flange about its own z axis, rad; see
    /// [`Arm::flange_from_camera`](crate::Arm::flange_from_camera).
    pub mount_rad: f64,
}

impl Camera {
    /// The default camera: 512 x 512 px, f = 256 px; at 0.5 m it sees 1.0 m of the table.
    pub fn default_cell() -> Camera {
        Camera { width: 512, height: 512, focal_px: 256.0, mount_rad: 0.0 }
    }

    /// The principal point, px.
    pub fn principal_point_px(&self) -> [f64; 2] {
        [(f64::from(self.width) - 1.0) / 2.0, (f64::from(self.height) - 1.0) / 2.0]
    }

    /// Centred pixels of the pixel (u, v).
    pub fn centred_from_pixel(&self, pixel: [f64; 2]) -> [f64; 2] {
        let centre = self.principal_point_px();
        [pixel[0] - centre[0], pixel[1] - centre[1]]
    }

    /// Pixel (u, v) of centred pixels.
    pub fn pixel_from_centred(&self, centred_px: [f64; 2]) -> [f64; 2] {
        let centre = self.principal_point_px();
        [centred_px[0] + centre[0], centred_px[1] + centre[1]]
    }

    /// Whether a point of the image plane, in centred pixels, is on the image. Not a number is not.
    pub fn sees(&self, centred_px: [f64; 2]) -> bool {
        centred_px[0].abs() <= f64::from(self.width) / 2.0
            && centred_px[1].abs() <= f64::from(self.height) / 2.0
    }

    /// Centred pixels of `point_m` (base frame) for a camera at `base_from_camera`; `None` when the
    /// point is not in front of the camera. It may lie outside the image: see [`Camera::sees`].
    pub fn project(&self, base_from_camera: &Isometry3<f64>, point_m: [f64; 3]) -> Option<[f64; 2]> {
        let in_camera = base_from_camera.inverse_transform_point(&Point3::from(point_m));
        (in_camera.z > 0.0)
            .then(|| [self.focal_px * in_camera.x / in_camera.z, self.focal_px * in_camera.y / in_camera.z])
    }

    /// The point of the table plane (base frame, z = 0) that is seen at `centred_px`; `None` when that
    /// ray does not meet the table.
    pub fn table_point(&self, base_from_camera: &Isometry3<f64>, centred_px: [f64; 2]) -> Option<[f64; 2]> {
        let ray = nalgebra::Vector3::new(centred_px[0], centred_px[1], self.focal_px);
        let direction = base_from_camera.rotation * ray;
        let origin = base_from_camera.translation.vector;
        let scale = -origin.z / direction.z;
        (scale > 0.0 && scale.is_finite())
            .then(|| [origin.x + scale * direction.x, origin.y + scale * direction.y])
    }
}

/// A camera in the base frame as plain numbers: it looks along its +z, image x to its +x.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CameraPose {
    /// m.
    pub translation: [f64; 3],
    /// Unit quaternion (x, y, z, w), w not negative.
    pub rotation: [f64; 4],
}

impl From<Isometry3<f64>> for CameraPose {
    fn from(base_from_camera: Isometry3<f64>) -> CameraPose {
        let q = base_from_camera.rotation.quaternion();
        let sign = if q.w < 0.0 { -1.0 } else { 1.0 };
        CameraPose {
            translation: base_from_camera.translation.vector.into(),
            rotation: [q.i, q.j, q.k, q.w].map(|part| sign * part),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Arm, Coupling};
    use proptest::prelude::*;

    fn golden_camera() -> Camera {
        Camera { width: 256, height: 256, focal_px: 200.0, mount_rad: 0.0 }
    }

    fn pose(theta: [f64; 2], mount_rad: f64) -> Isometry3<f64> {
        let arm = Arm::puma_like();
        let coupling = Coupling::new(&arm, 0.5).unwrap();
        arm.base_from_camera(&coupling.joints(theta[0], theta[1]).unwrap(), mount_rad)
    }

    #[test]
    fn the_golden_target_projects_to_the_golden_pixels() {
        let camera = golden_camera();
        let [x, y] = camera.project(&pose([0.0, 0.6], 0.0), [0.75, 0.0, 0.0]).unwrap();
        assert!((x - 31.3635).abs() < 1e-4 && (y + 60.0200).abs() < 1e-4, "{x} {y}");
        // The design prints x as 8.49168; written out by hand it is 400 (0.75 cos 0.1 - r(0.5)) = 8.491628.
        let [x, y] = camera.project(&pose([0.1, 0.5], 0.0), [0.75, 0.0, 0.0]).unwrap();
        assert!((x - 8.491628).abs() < 1e-5 && (y + 30.06998).abs() < 1e-5, "{x} {y}");
    }

    #[test]
    fn the_camera_frame_is_radial_outward_and_against_the_turn() {
        let axes = pose([0.0, 0.6], 0.0).rotation.to_rotation_matrix();
        let expected = nalgebra::Matrix3::new(1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, -1.0);
        assert!((axes.matrix() - expected).norm() < 1e-12, "{axes}");
    }

    #[test]
    fn the_mount_angle_turns_the_image_the_other_way() {
        let mount = 0.5f64;
        let camera = golden_camera();
        let [x0, y0] = camera.project(&pose([0.2, 0.6], 0.0), [0.7, 0.1, 0.0]).unwrap();
        let [x, y] = camera.project(&pose([0.2, 0.6], mount), [0.7, 0.1, 0.0]).unwrap();
        let (sin, cos) = (-mount).sin_cos();
        assert!((x - (cos * x0 - sin * y0)).abs() < 1e-9 && (y - (sin * x0 + cos * y0)).abs() < 1e-9);
    }

    #[test]
    fn what_is_behind_the_camera_is_not_projected() {
        assert_eq!(golden_camera().project(&pose([0.0, 0.6], 0.0), [0.7, 0.0, 0.6]), None);
    }

    proptest! {
        #[test]
        fn table_point_is_the_inverse_of_project(
            theta1 in -2.0..2.0f64, theta2 in 0.25..0.95f64, mount in -3.0..3.0f64,
            x in -250.0..250.0f64, y in -250.0..250.0f64,
        ) {
            let camera = Camera::default_cell();
            let base_from_camera = pose([theta1, theta2], mount);
            let [px, py] = camera.table_point(&base_from_camera, [x, y]).unwrap();
            let [x2, y2] = camera.project(&base_from_camera, [px, py, 0.0]).unwrap();
            prop_assert!((x - x2).abs() < 1e-9 && (y - y2).abs() < 1e-9);
            let back = camera.centred_from_pixel(camera.pixel_from_centred([x, y]));
            prop_assert!((x - back[0]).abs() < 1e-9 && (y - back[1]).abs() < 1e-9);
        }
    }
}
