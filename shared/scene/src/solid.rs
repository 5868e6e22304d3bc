//! The target's outline and faces: a disc on the table, or a box with camouflage unfolded over its sides.

use crate::coverage::Polygon;
use crate::mapping::TexturedPlane;
use crate::view::Camera;

/// Corners of the polygon that stands for the disc: its edge is off by 0.02 % of the radius.
const DISC_CORNERS: usize = 128;
/// What is nearer to the camera than this, metres, is cut off.
const NEAR_M: f64 = 0.01;

/// A face of the vehicle: where it is, and its corners in the base frame.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Face {
    /// Plane and texture.
    pub(crate) plane: TexturedPlane,
    corners: [[f64; 3]; 4],
}

/// The five faces of a box of `size` (length, width, height; metres) on the table; the roof comes first. The sides
/// continue the roof's texture, so that no edge between them shows.
pub(crate) fn vehicle_faces(position: [f64; 2], heading: f64, size: [f64; 3]) -> [Face; 5] {
    let (s, c) = (libm::sin(heading), libm::cos(heading));
    let (half_length, half_width, height) = (0.5 * size[0], 0.5 * size[1], size[2]);
    let ahead = [c, s, 0.0];
    let aside = [-s, c, 0.0];
    let up = [0.0, 0.0, 1.0];
    let at = |x: f64, y: f64, z: f64| [position[0] + c * x - s * y, position[1] + s * x + c * y, z];
    let roof = Face {
        plane: TexturedPlane {
            origin: at(0.0, 0.0, height),
            axes: [ahead, aside],
            normal: up,
            offset: [0.0; 2],
        },
        corners: [(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)]
            .map(|(x, y)| at(x * half_length, y * half_width, height)),
    };
    let corners = |[x0, y0]: [f64; 2], [x1, y1]: [f64; 2]| {
        [at(x0, y0, 0.0), at(x1, y1, 0.0), at(x1, y1, height), at(x0, y0, height)]
    };
    // front and back: u = ±(half_length + height - z), v = y
    let end = |sign: f64| Face {
        plane: TexturedPlane {
            origin: at(sign * half_length, 0.0, height),
            axes: [scaled(up, -sign), aside],
            normal: scaled(ahead, sign),
            offset: [sign * half_length, 0.0],
        },
        corners: corners([sign * half_length, -half_width], [sign * half_length, half_width]),
    };
    // left and right: u = x, v = ±(half_width + height - z)
    let flank = |sign: f64| Face {
        plane: TexturedPlane {
            origin: at(0.0, sign * half_width, height),
            axes: [ahead, scaled(up, -sign)],
            normal: scaled(aside, sign),
            offset: [0.0, sign * half_width],
        },
        corners: corners([-half_length, sign * half_width], [half_length, sign * half_width]),
    };
    [roof, end(1.0), end(-1.0), flank(1.0), flank(-1.0)]
}

impl Face {
    /// Its outline in the image.
    pub(crate) fn outline(&self, camera: &Camera) -> Polygon<2> {
        let mut polygon = Polygon::new();
        self.corners.iter().for_each(|&corner| polygon.push(camera.camera_from_base(corner)));
        projected(&polygon, camera)
    }
}

/// The outline in the image of a disc that lies on the table.
pub(crate) fn disc_outline(position: [f64; 2], radius_m: f64, camera: &Camera) -> Polygon<2> {
    // the polygon has the disc's area
    let step = std::f64::consts::TAU / DISC_CORNERS as f64;
    let radius = radius_m * (step / libm::sin(step)).sqrt();
    let mut polygon = Polygon::new();
    for i in 0..DISC_CORNERS {
        let angle = step * i as f64;
        let point = [position[0] + radius * libm::cos(angle), position[1] + radius * libm::sin(angle), 0.0];
        polygon.push(camera.camera_from_base(point));
    }
    projected(&polygon, camera)
}

/// The outline of a disc in the image itself, pixels.
pub(crate) fn image_disc([u, v]: [f64; 2], radius_px: f64) -> Polygon<2> {
    let step = std::f64::consts::TAU / DISC_CORNERS as f64;
    let mut polygon = Polygon::new();
    for i in 0..DISC_CORNERS {
        let angle = step * i as f64;
        polygon.push([u + radius_px * libm::cos(angle), v + radius_px * libm::sin(angle)]);
    }
    polygon
}

/// The image of a polygon of the camera frame, without what lies behind the camera.
fn projected(polygon: &Polygon<3>, camera: &Camera) -> Polygon<2> {
    let mut image = Polygon::new();
    polygon.clipped(2, 1.0, NEAR_M).corners().iter().for_each(|&corner| image.push(camera.project(corner)));
    image
}

fn scaled(v: [f64; 3], factor: f64) -> [f64; 3] {
    v.map(|x| x * factor)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::view::{difference, dot};

    #[test]
    fn texture_continues_over_every_edge_of_the_roof() {
        let size = [0.15, 0.10, 0.06];
        let faces = vehicle_faces([0.6, -0.1], 0.8, size);
        let texture = |face: &Face, point: [f64; 3]| {
            let offset = difference(point, face.plane.origin);
            [0, 1].map(|i| dot(face.plane.axes[i], offset) + face.plane.offset[i])
        };
        for side in &faces[1..] {
            for &corner in side.corners.iter().filter(|c| c[2] > 0.01) {
                let (a, b) = (texture(&faces[0], corner), texture(side, corner));
                assert!((a[0] - b[0]).abs() < 1e-12 && (a[1] - b[1]).abs() < 1e-12, "{a:?} and {b:?}");
            }
        }
    }

    #[test]
    fn normals_point_outward_and_corners_lie_in_their_plane() {
        let faces = vehicle_faces([0.6, -0.1], 0.8, [0.15, 0.10, 0.06]);
        for face in &faces {
            assert!(dot(face.plane.normal, difference(face.plane.origin, [0.6, -0.1, 0.03])) > 0.0);
            for &corner in &face.corners {
                assert!(dot(face.plane.normal, difference(corner, face.plane.origin)).abs() < 1e-12);
            }
        }
    }
}
