//! How much of each pixel a convex polygon covers, exactly, and then as the lens blurs it.

/// Corners that the polygons of this crate have at most: the disc's, and those that clipping adds.
pub(crate) const MAX_CORNERS: usize = 160;
/// Image coordinates farther outside the frame than this, pixels, are cut off: enough for the blur.
const MARGIN: f64 = 3.0;
/// Weight of each neighbour in the three-tap blur. A pixel's aperture has variance 1/12, the blur adds 2/12:
/// together the standard deviation of 0.5 pixels that the textures are filtered with ([`PSF_SIGMA_PX`]).
///
/// [`PSF_SIGMA_PX`]: crate::levels::PSF_SIGMA_PX
const NEIGHBOUR: f32 = 1.0 / 12.0;
/// Smaller shares are the rounding of sums that should be zero.
const LEAST_SHARE: f32 = 1e-5;

/// A convex polygon of fixed capacity.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Polygon<const D: usize> {
    corners: [[f64; D]; MAX_CORNERS],
    len: usize,
}

impl<const D: usize> Polygon<D> {
    /// No corners.
    pub(crate) fn new() -> Self {
        Self { corners: [[0.0; D]; MAX_CORNERS], len: 0 }
    }

    /// Adds a corner.
    ///
    /// # Panics
    /// If there are more than [`MAX_CORNERS`].
    pub(crate) fn push(&mut self, corner: [f64; D]) {
        self.corners[self.len] = corner;
        self.len += 1;
    }

    /// The corners in order.
    pub(crate) fn corners(&self) -> &[[f64; D]] {
        &self.corners[..self.len]
    }

    /// The part where `direction * corner[axis] >= direction * limit`, after Sutherland and Hodgman.
    pub(crate) fn clipped(&self, axis: usize, direction: f64, limit: f64) -> Self {
        let mut kept = Self::new();
        let inside = |p: &[f64; D]| direction * (p[axis] - limit) >= 0.0;
        for (i, p) in self.corners().iter().enumerate() {
            let next = &self.corners()[(i + 1) % self.len];
            if inside(p) {
                kept.push(*p);
            }
            if inside(p) != inside(next) {
                let share = (limit - p[axis]) / (next[axis] - p[axis]);
                let mut cut = [0.0; D];
                for ((c, a), b) in cut.iter_mut().zip(p).zip(next) {
                    *c = a + share * (b - a);
                }
                cut[axis] = limit;
                kept.push(cut);
            }
        }
        kept
    }
}

/// The coverage of a rectangle of pixels, which may reach over the frame's border.
pub(crate) struct Coverage {
    /// Image column of the first column.
    left: i32,
    /// Image row of the first row.
    top: i32,
    width: usize,
    height: usize,
    share: Vec<f32>,
    blurred: Vec<f32>,
    frame: [usize; 2],
}

impl Coverage {
    /// Space for polygons of any size in a frame of the given width and height.
    pub(crate) fn new(frame: [usize; 2]) -> Self {
        let side = |n: usize| n + 2 * MARGIN as usize + 6;
        let space = side(frame[0]) * side(frame[1]);
        Self {
            left: 0,
            top: 0,
            width: 0,
            height: 0,
            share: Vec::with_capacity(space),
            blurred: Vec::with_capacity(space),
            frame,
        }
    }

    /// Covers nothing.
    pub(crate) fn clear(&mut self) {
        (self.width, self.height) = (0, 0);
    }

    /// Covers what `polygon` covers, in image coordinates (pixel centres at integers), blurred by the lens.
    pub(crate) fn cover(&mut self, polygon: &Polygon<2>) {
        self.clear();
        let visible = polygon
            .clipped(0, 1.0, -MARGIN)
            .clipped(0, -1.0, self.frame[0] as f64 - 1.0 + MARGIN)
            .clipped(1, 1.0, -MARGIN)
            .clipped(1, -1.0, self.frame[1] as f64 - 1.0 + MARGIN);
        let corners = visible.corners();
        if corners.len() < 3 {
            return;
        }
        let range = |axis: usize| {
            let values = corners.iter().map(|c| c[axis]);
            let least = values.clone().fold(f64::INFINITY, f64::min);
            let most = values.fold(f64::NEG_INFINITY, f64::max);
            // the pixels touched, and two more on each side so that the blur finds its neighbours
            let first = (least + 0.5).floor() as i32 - 2;
            (first, (most + 0.5).floor() as i32 + 3 - first)
        };
        let ((left, width), (top, height)) = (range(0), range(1));
        (self.left, self.top) = (left, top);
        (self.width, self.height) = (width as usize, height as usize);
        self.share.clear();
        self.share.resize(self.width * self.height, 0.0);
        for (i, &p) in corners.iter().enumerate() {
            self.add_edge(p, corners[(i + 1) % corners.len()]);
        }
        self.integrate();
        self.blur();
    }

    /// The columns `from..to` of row `y` in which something is covered, within the frame, with their shares.
    pub(crate) fn row(&self, y: usize) -> Option<(usize, usize, &[f32])> {
        let line = usize::try_from(y as i32 - self.top).ok().filter(|&line| line < self.height)?;
        let first = (-self.left).max(0) as usize;
        let end = usize::try_from(self.frame[0] as i32 - self.left).unwrap_or(0).min(self.width);
        let row = &self.blurred[line * self.width..(line + 1) * self.width];
        let first = first + row.get(first..end)?.iter().position(|&share| share > 0.0)?;
        let end = first + row[first..end].iter().rposition(|&share| share > 0.0)? + 1;
        let column = |i: usize| (i as i32 + self.left) as usize;
        Some((column(first), column(end), &row[first..end]))
    }

    /// Adds what the edge from `p` to `q` changes from each pixel to the next: the signed area to its right.
    fn add_edge(&mut self, p: [f64; 2], q: [f64; 2]) {
        // in pixels from the rectangle's corner
        let local = |c: [f64; 2]| [c[0] + 0.5 - f64::from(self.left), c[1] + 0.5 - f64::from(self.top)];
        let (p, q) = (local(p), local(q));
        let (sign, p, q) = if p[1] < q[1] { (1.0, p, q) } else { (-1.0, q, p) };
        let slope = (q[0] - p[0]) / (q[1] - p[1]);
        if !slope.is_finite() {
            return;
        }
        for line in p[1] as usize..=q[1] as usize {
            let from = p[1].max(line as f64);
            let to = q[1].min(line as f64 + 1.0);
            if to <= from {
                continue;
            }
            let (a, b) = (p[0] + slope * (from - p[1]), p[0] + slope * (to - p[1]));
            let row = &mut self.share[line * self.width..(line + 1) * self.width];
            add_crossing(row, a.min(b), a.max(b), sign * (to - from));
        }
    }

    /// Sums the changes along each row; the sign of the polygon's sense of rotation falls away.
    fn integrate(&mut self) {
        for row in self.share.chunks_exact_mut(self.width) {
            let mut sum = 0.0;
            for share in row {
                sum += *share;
                let covered = sum.abs();
                *share = if covered < LEAST_SHARE { 0.0 } else { covered.min(1.0) };
            }
        }
    }

    fn blur(&mut self) {
        let (width, height) = (self.width, self.height);
        self.blurred.clear();
        self.blurred.resize(width * height, 0.0);
        let three = |before: f32, here: f32, after: f32| here + NEIGHBOUR * (before - 2.0 * here + after);
        for line in 1..height - 1 {
            let at = line * width;
            let out = &mut self.blurred[at..at + width];
            let rows = [at - width, at, at + width].map(|start| &self.share[start..start + width]);
            for (x, o) in out.iter_mut().enumerate() {
                *o = three(rows[0][x], rows[1][x], rows[2][x]);
            }
        }
        for row in self.blurred.chunks_exact_mut(width) {
            let mut before = 0.0;
            for x in 0..width {
                let here = row[x];
                let after = row.get(x + 1).copied().unwrap_or(0.0);
                row[x] = three(before, here, after);
                before = here;
            }
        }
    }
}

/// An edge that crosses part `height` (signed) of a pixel row while x goes from `a` to `b`. The share of pixel i to
/// its right is the mean over that way of clamp(i + 1 - x, 0, 1).
fn add_crossing(row: &mut [f32], a: f64, b: f64, height: f64) {
    let integral = |z: f64| {
        if z <= 0.0 {
            0.0
        } else if z < 1.0 {
            0.5 * z * z
        } else {
            z - 0.5
        }
    };
    let width = b - a;
    let mut before = 0.0;
    for (i, share) in row.iter_mut().enumerate().skip(a as usize) {
        let right = i as f64 + 1.0;
        let mean = if width > 1e-9 {
            (integral(right - a) - integral(right - b)) / width
        } else {
            (right - a).clamp(0.0, 1.0)
        };
        *share += (height * (mean - before)) as f32;
        before = mean;
        if right - b >= 1.0 {
            break;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn polygon(corners: &[[f64; 2]]) -> Polygon<2> {
        let mut polygon = Polygon::new();
        corners.iter().for_each(|&c| polygon.push(c));
        polygon
    }

    fn area(corners: &[[f64; 2]]) -> f64 {
        let next = |i: usize| corners[(i + 1) % corners.len()];
        0.5 * (0..corners.len()).map(|i| corners[i][0] * next(i)[1] - corners[i][1] * next(i)[0]).sum::<f64>()
    }

    #[test]
    fn shares_sum_to_the_area_and_balance_at_the_centroid() {
        let triangle = [[3.2, 4.7], [17.9, 8.1], [9.4, 20.3]];
        for corners in [triangle, [triangle[2], triangle[1], triangle[0]]] {
            let mut coverage = Coverage::new([32, 32]);
            coverage.cover(&polygon(&corners));
            let (mut sum, mut x_sum, mut y_sum) = (0.0, 0.0, 0.0);
            for y in 0..32 {
                let Some((from, _, shares)) = coverage.row(y) else { continue };
                for (i, &share) in shares.iter().enumerate() {
                    sum += f64::from(share);
                    x_sum += f64::from(share) * (from + i) as f64;
                    y_sum += f64::from(share) * y as f64;
                }
            }
            let centroid = [0, 1].map(|k| corners.iter().map(|c| c[k]).sum::<f64>() / 3.0);
            assert!((sum - area(&corners).abs()).abs() < 1e-3, "area {sum}");
            assert!((x_sum / sum - centroid[0]).abs() < 1e-3 && (y_sum / sum - centroid[1]).abs() < 1e-3);
        }
    }

    #[test]
    fn share_of_each_pixel_is_what_dense_sampling_counts() {
        let corners = [[2.3, 1.1], [9.8, 3.9], [8.1, 9.6], [1.2, 6.4]];
        let mut coverage = Coverage::new([12, 12]);
        coverage.cover(&polygon(&corners));
        let inside = |x: f64, y: f64| {
            (0..4).all(|i| {
                let (p, q) = (corners[i], corners[(i + 1) % 4]);
                (q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0]) >= 0.0
            })
        };
        for line in 0..coverage.height {
            for column in 0..coverage.width {
                let centre =
                    [f64::from(coverage.left) + column as f64, f64::from(coverage.top) + line as f64];
                let at = |i: usize| (i as f64 + 0.5) / 64.0 - 0.5;
                let hits =
                    (0..64 * 64).filter(|i| inside(centre[0] + at(i % 64), centre[1] + at(i / 64))).count();
                let share = f64::from(coverage.share[line * coverage.width + column]);
                assert!((share - hits as f64 / 4096.0).abs() < 6e-3, "{column}, {line}: {share} for {hits}");
            }
        }
    }

    #[test]
    fn polygon_larger_than_the_frame_covers_all_of_it() {
        let mut coverage = Coverage::new([16, 9]);
        coverage.cover(&polygon(&[[-1e6, -1e6], [1e6, -1e6], [1e6, 1e6], [-1e6, 1e6]]));
        for y in 0..9 {
            let (from, to, shares) = coverage.row(y).unwrap();
            assert_eq!((from, to), (0, 16));
            assert!(shares.iter().all(|&s| (s - 1.0).abs() < 1e-5), "row {y}: {shares:?}");
        }
    }

    #[test]
    fn polygon_outside_the_frame_covers_nothing() {
        let mut coverage = Coverage::new([16, 9]);
        coverage.cover(&polygon(&[[40.0, 1.0], [50.0, 1.0], [45.0, 8.0]]));
        assert!(
            (0..9).all(|y| coverage.row(y).is_none_or(|(_, _, shares)| shares.iter().all(|&s| s == 0.0)))
        );
    }
}
