//! From a pixel to the point of a plane that it sees: the homography, and its restriction to one row.

use crate::levels::Level;
use crate::view::{Camera, difference, dot};

/// What lies deeper than this many texels along the viewing direction is not drawn: 4 m with texels of 1 mm, far
/// beyond the table's end, and well within the 2^14 texels that [`RowMap`] can count.
const DEEPEST_TEXELS: f64 = 4000.0;
/// Units per texel of the look-up's interpolation weights.
pub(crate) const SUBTEXELS: f64 = 256.0;

/// A plane with its texture's axes, in the base frame.
#[derive(Clone, Copy, Debug)]
pub(crate) struct TexturedPlane {
    /// A point of the plane, metres.
    pub(crate) origin: [f64; 3],
    /// Unit vectors of the texture's u and v in the plane.
    pub(crate) axes: [[f64; 3]; 2],
    /// Unit normal, on the visible side.
    pub(crate) normal: [f64; 3],
    /// Texture coordinates of the origin, metres.
    pub(crate) offset: [f64; 2],
}

impl TexturedPlane {
    /// The table: z = 0, textured in the base's x and y.
    pub(crate) const TABLE: Self = Self {
        origin: [0.0; 3],
        axes: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
        normal: [0.0, 0.0, 1.0],
        offset: [0.0; 2],
    };

    /// Height of the camera above the plane, metres; negative where the back of the plane is seen.
    pub(crate) fn height_of(&self, camera: &Camera) -> f64 {
        dot(self.normal, difference(camera.position, self.origin))
    }
}

/// Texture coordinates (metres) of pixel (x, y) are (U/W, V/W); each is a x + b y + c; W is one over the depth.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Homography {
    u: [f64; 3],
    v: [f64; 3],
    w: [f64; 3],
}

impl Homography {
    /// The homography from the camera's image to `plane`; `None` unless the camera is on its visible side.
    pub(crate) fn new(camera: &Camera, plane: &TexturedPlane) -> Option<Self> {
        let height = plane.height_of(camera);
        if height < 1e-6 {
            return None;
        }
        // the ray o + depth * d meets the plane where depth * (n . d) = n . (origin - o) = -height
        let w = along_ray(camera, plane.normal).map(|a| -a / height);
        let offset = difference(camera.position, plane.origin);
        let row = |i: usize| {
            let along = along_ray(camera, plane.axes[i]);
            let at_camera = dot(plane.axes[i], offset) + plane.offset[i];
            [0, 1, 2].map(|j| along[j] + at_camera * w[j])
        };
        Some(Self { u: row(0), v: row(1), w })
    }

    /// The homography of an image whose pixels are moved by (dx, dy): its pixel (x, y) is this one's (x + dx, y + dy).
    pub(crate) fn shifted(&self, dx: f64, dy: f64) -> Self {
        let shift = |line: &[f64; 3]| [line[0], line[1], line[2] + line[0] * dx + line[1] * dy];
        Self { u: shift(&self.u), v: shift(&self.v), w: shift(&self.w) }
    }

    /// The mapping of row `y`, for those of its pixels in `from..to` that see `level`'s plane.
    pub(crate) fn row(&self, y: usize, from: usize, to: usize, level: &Level) -> Option<RowMap> {
        let at_row = |line: &[f64; 3]| line[1] * y as f64 + line[2];
        let least_w = 1.0 / (DEEPEST_TEXELS * level.texel_m);
        let (from, to) = visible(self.w[0], at_row(&self.w) - least_w, from, to)?;
        // relative to the pixel at the middle, x = anchor + d: u = u_a + d (U' - u_a W') / (W_a + d W')
        let anchor = (from + to) / 2;
        let x = anchor as f64;
        let w = self.w[0] * x + at_row(&self.w);
        let axis = |line: &[f64; 3]| {
            let metres = (line[0] * x + at_row(line)) / w;
            let texels = (metres / level.texel_m).rem_euclid(level.side as f64);
            let whole = texels.floor();
            let slope = (line[0] - metres * self.w[0]) / w * SUBTEXELS / level.texel_m;
            AxisMap { whole: whole as i32, rest: ((texels - whole) * SUBTEXELS) as f32, slope: slope as f32 }
        };
        let (u, v) = (axis(&self.u), axis(&self.v));
        Some(RowMap { from, to, anchor, u, v, bend: (self.w[0] / w) as f32 })
    }
}

/// The part of a row that sees the plane: for column x, d = x - anchor, t = d / (1 + bend d), a texture
/// coordinate is whole + (rest + slope t) / 256 texels.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RowMap {
    /// First column that sees the plane.
    pub(crate) from: usize,
    /// Column after the last.
    pub(crate) to: usize,
    /// Column of d = 0.
    pub(crate) anchor: usize,
    /// First texture coordinate.
    pub(crate) u: AxisMap,
    /// Second texture coordinate.
    pub(crate) v: AxisMap,
    /// Relative change of inverse depth per column.
    pub(crate) bend: f32,
}

/// One texture coordinate along a row.
#[derive(Clone, Copy, Debug)]
pub(crate) struct AxisMap {
    /// Whole texels at the anchor.
    pub(crate) whole: i32,
    /// Rest at the anchor, subtexels.
    pub(crate) rest: f32,
    /// Subtexels per unit of t.
    pub(crate) slope: f32,
}

/// `g` . ray direction as a x + b y + c, for the ray of pixel (x, y) whose camera z component is 1.
fn along_ray(camera: &Camera, g: [f64; 3]) -> [f64; 3] {
    let [x, y, z] = camera.axes.map(|axis| dot(axis, g));
    let (a, b) = (x / camera.focal_px, y / camera.focal_px);
    [a, b, z - a * camera.principal[0] - b * camera.principal[1]]
}

/// The columns in `from..to` where slope x + rest >= 0.
fn visible(slope: f64, rest: f64, from: usize, to: usize) -> Option<(usize, usize)> {
    let (first, last) = (from as f64, to as f64 - 1.0);
    let root = -rest / slope;
    let (from, to) = if slope > 0.0 && root > first {
        (root.ceil().min(to as f64) as usize, to)
    } else if slope < 0.0 && root < last {
        (from, (root.floor() + 1.0).max(first) as usize)
    } else if slope == 0.0 && rest < 0.0 {
        return None;
    } else {
        (from, to)
    };
    (from < to).then_some((from, to))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parameters::SceneParameters;
    use crate::view::{Kind, View};
    use proptest::prelude::*;

    #[test]
    fn only_columns_below_the_horizon_are_visible() {
        for (slope, rest) in
            [(0.5, -3.2), (-0.5, 3.2), (0.0, 1.0), (0.0, -1.0), (0.1, 5.0), (-0.1, -5.0), (1.0, -100.0)]
        {
            let wanted: Vec<usize> = (2..14).filter(|&x| slope * x as f64 + rest >= 0.0).collect();
            let got: Vec<usize> = visible(slope, rest, 2, 14).map_or(vec![], |(a, b)| (a..b).collect());
            assert_eq!(got, wanted, "slope {slope} rest {rest}");
        }
    }

    proptest! {
        /// Oracle: intersect the pixel's ray with the table by hand.
        #[test]
        fn row_map_agrees_with_the_ray(
            x in -1.0f64..1.0, y in -1.0f64..1.0, z in 0.2f64..1.0,
            yaw in -3.0f64..3.0, tilt in -0.5f64..0.5, column in 0usize..512, line in 0usize..512,
        ) {
            let mut view = View::looking_down([x, y, z], yaw, Kind::Vehicle);
            // tilt about the camera's own y axis: q * (0, sin, 0, cos)
            let [a, b, _, _] = view.camera_rotation;
            let (s, c) = (0.5 * tilt).sin_cos();
            view.camera_rotation = [a * c, b * c, a * s, -b * s];
            let camera = Camera::new(&SceneParameters::default(), &view).unwrap();
            let level = Level { side: 2048, texel_m: 0.001, quads: vec![] };
            let row = Homography::new(&camera, &TexturedPlane::TABLE).unwrap().row(line, 0, 512, &level).unwrap();
            prop_assert!(row.from == 0 && row.to == 512);
            let d = column as f32 - row.anchor as f32;
            let t = d / (1.0 + row.bend * d);
            let ray = [(column as f64 - 255.5) / 256.0, (line as f64 - 255.5) / 256.0, 1.0];
            let world = |i: usize| (0..3).map(|j| camera.axes[j][i] * ray[j]).sum::<f64>();
            let depth = -z / world(2);
            for (axis, start, i) in [(row.u, x, 0), (row.v, y, 1)] {
                let texels = f64::from(axis.whole) + f64::from(axis.rest + axis.slope * t) / 256.0;
                let wanted = (start + depth * world(i)) / 0.001;
                let error = (texels - wanted + 1024.0).rem_euclid(2048.0) - 1024.0;
                prop_assert!(error.abs() < 2e-3, "texel {texels}, by the ray {wanted}");
            }
        }
    }
}
