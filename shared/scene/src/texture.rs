//! Camouflage: "dead leaves", ellipses that cover one another, radii distributed as r^-3, so that edges of
//! every size are everywhere and one more outline among them is not noticed (figure 2 of the paper).

use crate::random::Random;

/// Smallest and largest radius of a leaf, metres.
pub(crate) const LEAF_RADIUS_M: [f64; 2] = [0.0015, 0.060];
/// The same for the weave of the dark cloth.
const CLOTH_RADIUS_M: [f64; 2] = [0.0015, 0.006];
/// Grey level around which the leaves lie.
pub(crate) const LEAF_MEAN: f64 = 128.0;
/// Mean grey level of the cloth.
const CLOTH_MEAN: f64 = 30.0;
/// Deviation of the cloth's grey levels before the prefilter, which leaves about 4 of it.
const CLOTH_SD: f64 = 5.2;
/// A texture must repeat after more than a leaf's diameter.
pub(crate) const SMALLEST_TORUS_M: f64 = 4.0 * LEAF_RADIUS_M[1];
/// How often the average texel is painted over: e^-5, less than a hundredth, keeps the ground's mean grey.
const LAYERS: f64 = 5.0;
/// Leaves are ellipses with an axis ratio from this to 1.
const LEAST_AXIS_RATIO: f64 = 0.5;

/// A square grey texture that continues at its opposite border.
pub(crate) struct Torus {
    /// Texels per side, a power of two.
    pub(crate) side: usize,
    /// Rows of grey levels.
    pub(crate) grey: Vec<u8>,
}

/// What the leaves look like.
struct Leaves {
    radius_texels: [f64; 2],
    mean: f64,
    /// Deviation of their grey levels, which are uniform.
    sd: f64,
}

/// The texture of table or vehicle: `side` texels of `texel_m` metres, contrast `sd` grey levels.
pub(crate) fn camouflage(side: usize, texel_m: f64, sd: f64, random: Random) -> Torus {
    paint(side, &Leaves { radius_texels: LEAF_RADIUS_M.map(|r| r / texel_m), mean: LEAF_MEAN, sd }, random)
}

/// The dark cloth of the training scene.
pub(crate) fn cloth(side: usize, texel_m: f64, random: Random) -> Torus {
    let radius_texels = CLOTH_RADIUS_M.map(|r| r / texel_m);
    paint(side, &Leaves { radius_texels, mean: CLOTH_MEAN, sd: CLOTH_SD }, random)
}

fn paint(side: usize, leaves: &Leaves, mut random: Random) -> Torus {
    let mut torus = Torus { side, grey: vec![leaves.mean as u8; side * side] };
    let [least, most] = leaves.radius_texels;
    let narrow = 1.0 - (least / most) * (least / most);
    let mean_axis_ratio = 0.5 * (1.0 + LEAST_AXIS_RATIO);
    let mean_area =
        2.0 * std::f64::consts::PI * least * least * libm::log(most / least) / narrow * mean_axis_ratio;
    let count = (LAYERS * (side * side) as f64 / mean_area) as usize;
    for _ in 0..count {
        let radius = least / (1.0 - random.unit() * narrow).sqrt(); // density ~ r^-3
        let axis_ratio = LEAST_AXIS_RATIO + (1.0 - LEAST_AXIS_RATIO) * random.unit();
        let centre = [random.unit() * side as f64, random.unit() * side as f64];
        let grey = leaves.mean + (random.unit() - 0.5) * 12f64.sqrt() * leaves.sd;
        let direction = random_direction(&mut random);
        fill_ellipse(&mut torus, centre, [radius, radius * axis_ratio], direction, (grey + 0.5) as u8);
    }
    torus
}

/// A vector of length 1 in a uniformly distributed direction, without sine or cosine.
fn random_direction(random: &mut Random) -> [f64; 2] {
    loop {
        let (x, y) = (2.0 * random.unit() - 1.0, 2.0 * random.unit() - 1.0);
        let square = x * x + y * y;
        if square > 1e-4 && square < 1.0 {
            let length = square.sqrt();
            return [x / length, y / length];
        }
    }
}

/// Paints all texels whose centre lies in the ellipse with the given centre and semi-axes (texels), the first
/// along `direction`.
fn fill_ellipse(torus: &mut Torus, centre: [f64; 2], axes: [f64; 2], direction: [f64; 2], grey: u8) {
    // A x^2 + 2 B x y + C y^2 <= 1 with the first axis along (c, s)
    let [c, s] = direction;
    let (p, q) = (1.0 / (axes[0] * axes[0]), 1.0 / (axes[1] * axes[1]));
    let (a, b) = (c * c * p + s * s * q, c * s * (p - q));
    let reach = a.sqrt() * axes[0] * axes[1];
    let (widest_square, drift, narrowing) = (1.0 / a, b / a, 1.0 / (a * reach * reach));
    let mask = torus.side as i32 - 1;
    for row in ceil(centre[1] - reach)..=floor(centre[1] + reach) {
        let y = f64::from(row) - centre[1];
        let half = (widest_square - y * y * narrowing).max(0.0).sqrt();
        let middle = centre[0] - drift * y;
        let (first, last) = (ceil(middle - half), floor(middle + half));
        if first > last {
            continue;
        }
        let line = (row & mask) as usize * torus.side;
        let line = &mut torus.grey[line..line + torus.side];
        let (from, length) = ((first & mask) as usize, (last - first + 1) as usize);
        let before_border = length.min(line.len() - from);
        line[from..from + before_border].fill(grey);
        line[..length - before_border].fill(grey);
    }
}

/// Offset that makes every coordinate here positive, so that a cast, which truncates, is the floor: without
/// SSE4.1 `f64::floor` is a call.
const OFFSET: i32 = 1 << 20;

fn floor(x: f64) -> i32 {
    (x + f64::from(OFFSET)) as i32 - OFFSET
}

fn ceil(x: f64) -> i32 {
    -floor(-x)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mean_and_sd(grey: &[u8]) -> (f64, f64) {
        let n = grey.len() as f64;
        let mean = grey.iter().map(|&g| f64::from(g)).sum::<f64>() / n;
        (mean, (grey.iter().map(|&g| (f64::from(g) - mean).powi(2)).sum::<f64>() / n).sqrt())
    }

    #[test]
    fn ellipse_covers_exactly_the_texels_that_its_equation_says() {
        let (centre, axes, direction) = ([3.3, 60.8], [9.5, 5.25], [0.6, 0.8]);
        let mut torus = Torus { side: 64, grey: vec![0; 64 * 64] };
        fill_ellipse(&mut torus, centre, axes, direction, 1);
        for y in 0..64 {
            for x in 0..64 {
                // the nearest of the centre's images on the torus
                let near = |i: i32, c: f64| (f64::from(i) - c + 32.0).rem_euclid(64.0) - 32.0;
                let (dx, dy) = (near(x, centre[0]), near(y, centre[1]));
                let along = (0.6 * dx + 0.8 * dy) / axes[0];
                let across = (-0.8 * dx + 0.6 * dy) / axes[1];
                let inside = along * along + across * across <= 1.0;
                assert_eq!(torus.grey[(y * 64 + x) as usize] == 1, inside, "texel {x}, {y}");
            }
        }
    }

    #[test]
    fn camouflage_has_the_wanted_contrast_and_neither_black_nor_white() {
        let torus = camouflage(1024, 0.001, 40.0, Random::new(3, 0));
        let (mean, sd) = mean_and_sd(&torus.grey);
        assert!((mean - 128.0).abs() < 4.0, "mean {mean}");
        assert!((sd - 40.0).abs() < 2.0, "sd {sd}");
        assert!(torus.grey.iter().all(|&g| (58..=198).contains(&g)));
    }

    #[test]
    fn cloth_is_dark() {
        let (mean, sd) = mean_and_sd(&cloth(512, 0.001, Random::new(3, 1)).grey);
        assert!((mean - 30.0).abs() < 1.0 && sd < 6.0, "mean {mean} sd {sd}");
    }
}
