//! A still thing that nobody has to show: a point of the background, carried along by the background's own
//! motion.
//!
//! The paper's future work (section 5): learning "can even take place during the tracking" with the
//! velocity of the background. For frames i and j, p = x_i − Rot(s Δθ1) x_j holds of any still point; a
//! chain of background motions says where one point of the table went, and it is a view like any other.

use serde::{Deserialize, Serialize};

use crate::samples::View;

/// A point of the background and where it was seen last.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Landmark {
    view: View,
}

impl Landmark {
    /// The point that is now in the middle of the image.
    pub fn in_the_middle(joints: [f64; 2], velocities: [f64; 2]) -> Landmark {
        Landmark { view: View { point_px: [0.0; 2], joints, velocities } }
    }

    /// Where it was seen last.
    pub fn view(&self) -> &View {
        &self.view
    }

    /// Goes along to the next frame, taken at the angles `joints` (rad) and `velocities` (rad/s). `shift_px` is the background's
    /// displacement *that ends in the middle of the newer image*, px over the pair.
    ///
    /// p of the two frames is −shift, so x_j = Rot(−s Δθ1) (x_i + shift): the image turns with joint 1 and
    /// with nothing else (the camera is vertical and keeps its height); s as in
    /// [`displacement_px`](crate::samples::displacement_px).
    pub fn advance(
        &mut self,
        shift_px: [f64; 2],
        (joints, velocities): ([f64; 2], [f64; 2]),
        rotation_sign: f64,
    ) {
        let [x, y] = [0, 1].map(|k| self.view.point_px[k] + shift_px[k]);
        let (sin, cos) = (-rotation_sign * (joints[0] - self.view.joints[0])).sin_cos();
        self.view = View { point_px: [cos * x - sin * y, sin * x + cos * y], joints, velocities };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pursuit_kinematics::{Arm, Camera, Coupling};
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    /// Against the exact arm and lens: after 40 frames of any motion the landmark is where the camera sees
    /// the point of the table that it began over.
    #[test]
    fn a_chain_of_exact_background_motions_ends_where_the_camera_sees_the_point() {
        let coupling = Coupling::new(&Arm::puma_like(), 0.5).unwrap();
        let camera = Camera { mount_rad: 0.7, ..Camera::default_cell() };
        let project = |[theta1, theta2]: [f64; 2], point: [f64; 2]| {
            let all = coupling.joints(theta1, theta2).unwrap();
            let pose = coupling.arm().base_from_camera(&all, camera.mount_rad);
            camera.project(&pose, [point[0], point[1], 0.0]).unwrap()
        };
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        let mut joints = [0.1, 0.6];
        let start = coupling.camera_xy(joints[0], joints[1]);
        let mut landmark = Landmark::in_the_middle(joints, [0.0; 2]);
        for _ in 0..40 {
            let next = [joints[0] + rng.random_range(-0.05..0.06), joints[1] + rng.random_range(-0.02..0.02)];
            // The point of the table that the newer image has in its middle came from here:
            let origin = project(joints, coupling.camera_xy(next[0], next[1]));
            landmark.advance([-origin[0], -origin[1]], (next, [0.0; 2]), -1.0);
            joints = next;
        }
        let truth = project(joints, start);
        let seen = landmark.view().point_px;
        assert!((seen[0] - truth[0]).hypot(seen[1] - truth[1]) < 1e-6, "{seen:?} for {truth:?}");
        assert!(truth[0].hypot(truth[1]) > 20.0, "it did move");
    }
}
