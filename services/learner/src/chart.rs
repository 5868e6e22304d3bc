//! A chart of the table, drawn with the learnt map alone: px of the image with axes that do not turn.
//!
//! The map N says which joint displacement brings an image point to the middle. Read backwards it says
//! which point of the last image has become the middle of this one, which is how far the camera has
//! moved: the same relation that makes learning samples (design notes on the learner, section 3),
//! `x_i - Rot(s (th1_j - th1_i)) x_j = p` with `N(p, th2_i) = q_j - q_i`. Summed up it is where the camera
//! is. An error of the map makes the chart drift as the camera moves, not jump, and what is predicted on
//! the chart goes back to the joints through the same map: the error cancels for the motion that goes on.

use serde::{Deserialize, Serialize};

/// Iterations of the inversion; each takes off more than nine tenths of the error, for a motion between
/// two frames.
const ITERATIONS: usize = 3;
/// Half the step of the map's numerical derivative, px.
const STEP_PX: f64 = 2.0;

/// A hand-eye map.
pub trait Map {
    /// Displacement of joints 1 and 2, rad, that brings an image point (px from the centre) to the
    /// middle, at `theta2` rad.
    fn displacement(&self, point_px: [f64; 2], theta2: f64) -> [f64; 2];

    /// Sense in which the image turns with joint 1: -1, or +1 for a mirrored image.
    fn rotation_sign(&self) -> f64;
}

/// Where the camera is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Chart {
    joints: [f64; 2],
    centre_px: [f64; 2],
}

impl Chart {
    /// A chart that begins where the camera is.
    pub fn at(joints: [f64; 2]) -> Chart {
        Chart { joints, centre_px: [0.0; 2] }
    }

    /// The camera has moved to these joint positions, rad. `None` where the map has no inverse there: what
    /// was on the chart means nothing any more.
    pub fn moved(&self, joints: [f64; 2], map: &impl Map) -> Option<Chart> {
        let way = [joints[0] - self.joints[0], joints[1] - self.joints[1]];
        let theta2 = self.joints[1];
        let slope = inverse_slope(map, theta2)?;
        let mut point = apply(&slope, way);
        for _ in 1..ITERATIONS {
            let there = map.displacement(point, theta2);
            let rest = apply(&slope, [way[0] - there[0], way[1] - there[1]]);
            point = [point[0] + rest[0], point[1] + rest[1]];
        }
        let moved = turned(point, map.rotation_sign() * self.joints[0]);
        let centre_px = [self.centre_px[0] + moved[0], self.centre_px[1] + moved[1]];
        centre_px.iter().all(|axis| axis.is_finite()).then_some(Chart { joints, centre_px })
    }

    /// A point of the image on the chart.
    pub fn from_image(&self, point_px: [f64; 2], map: &impl Map) -> [f64; 2] {
        let [x, y] = turned(point_px, map.rotation_sign() * self.joints[0]);
        [self.centre_px[0] + x, self.centre_px[1] + y]
    }

    /// Joint positions, rad, at which a point of the chart is in the middle of the image.
    pub fn joints_over(&self, point_px: [f64; 2], map: &impl Map) -> [f64; 2] {
        let off = [point_px[0] - self.centre_px[0], point_px[1] - self.centre_px[1]];
        let seen = turned(off, -map.rotation_sign() * self.joints[0]);
        let [first, second] = map.displacement(seen, self.joints[1]);
        [self.joints[0] + first, self.joints[1] + second]
    }
}

/// Inverse of the map's derivative in the middle of the image, px/rad.
fn inverse_slope(map: &impl Map, theta2: f64) -> Option<[[f64; 2]; 2]> {
    let along = |x: f64, y: f64| {
        let [ahead, behind] = [1.0, -1.0].map(|side| map.displacement([side * x, side * y], theta2));
        [0, 1].map(|k| (ahead[k] - behind[k]) / (2.0 * STEP_PX))
    };
    let (x, y) = (along(STEP_PX, 0.0), along(0.0, STEP_PX));
    let determinant = x[0] * y[1] - y[0] * x[1];
    let usable = determinant.is_finite() && determinant != 0.0;
    usable.then(|| [[y[1] / determinant, -y[0] / determinant], [-x[1] / determinant, x[0] / determinant]])
}

fn apply(matrix: &[[f64; 2]; 2], vector: [f64; 2]) -> [f64; 2] {
    matrix.map(|row| row[0] * vector[0] + row[1] * vector[1])
}

fn turned([x, y]: [f64; 2], angle_rad: f64) -> [f64; 2] {
    let (sin, cos) = angle_rad.sin_cos();
    [cos * x - sin * y, sin * x + cos * y]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use pursuit_kinematics::{Arm, Camera, Coupling, exact_move};

    /// The map that the network approximates.
    struct Exact(Coupling, Camera);

    impl Map for Exact {
        fn displacement(&self, point_px: [f64; 2], theta2: f64) -> [f64; 2] {
            exact_move(&self.0, &self.1, point_px, theta2).unwrap()
        }

        fn rotation_sign(&self) -> f64 {
            -1.0
        }
    }

    fn exact(mount_rad: f64) -> Exact {
        let coupling = Coupling::new(&Arm::puma_like(), 0.5).unwrap();
        Exact(coupling, Camera { mount_rad, ..Camera::default_cell() })
    }

    proptest! {
        /// Forward kinematics is the oracle: distances on the chart are distances on the table.
        #[test]
        fn a_chart_is_the_table_to_scale(
            turn in -0.1..0.1f64, theta2 in 0.4..0.8f64, reach in -0.06..0.06f64, mount in -3.0..3.0f64,
        ) {
            let map = exact(mount);
            let (from, to) = ([0.3, theta2], [0.3 + turn, theta2 + reach]);
            let chart = Chart::at(from).moved(to, &map).unwrap();
            let place = |joints: [f64; 2]| map.0.camera_xy(joints[0], joints[1]);
            let (a, b) = (place(from), place(to));
            let way_px = (b[0] - a[0]).hypot(b[1] - a[1]) * map.1.focal_px / 0.5;
            let drawn_px = chart.centre_px[0].hypot(chart.centre_px[1]);
            prop_assert!((way_px - drawn_px).abs() < 0.05 + 0.002 * way_px, "{way_px} {drawn_px}");
        }

        #[test]
        fn what_stands_still_stands_still_on_the_chart(turn in -0.1..0.1f64, reach in -0.06..0.06f64) {
            let map = exact(0.7);
            let target = map.0.camera_xy(0.35, 0.55);
            let seen = |joints: [f64; 2]| {
                let all = map.0.joints(joints[0], joints[1]).unwrap();
                let pose = map.0.arm().base_from_camera(&all, map.1.mount_rad);
                map.1.project(&pose, [target[0], target[1], 0.0]).unwrap()
            };
            let (from, to) = ([0.3, 0.6], [0.3 + turn, 0.6 + reach]);
            let chart = Chart::at(from);
            let before = chart.from_image(seen(from), &map);
            let chart = chart.moved(to, &map).unwrap();
            let after = chart.from_image(seen(to), &map);
            prop_assert!((before[0] - after[0]).hypot(before[1] - after[1]) < 0.1, "{before:?} {after:?}");
            let over = chart.joints_over(after, &map);
            prop_assert!((over[0] - 0.35).abs() < 1e-6 && (over[1] - 0.55).abs() < 1e-6);
        }
    }

    #[test]
    fn a_map_without_an_inverse_draws_no_chart() {
        struct Flat;
        impl Map for Flat {
            fn displacement(&self, point_px: [f64; 2], _: f64) -> [f64; 2] {
                [point_px[0], point_px[0]]
            }

            fn rotation_sign(&self) -> f64 {
                -1.0
            }
        }
        assert_eq!(Chart::at([0.0, 0.6]).moved([0.1, 0.6], &Flat), None);
    }
}
