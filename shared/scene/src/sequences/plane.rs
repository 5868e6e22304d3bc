//! A periodic grey picture, and the cubic look-up in it.

/// Coefficients of 1, f, f², f³ in the weights of the four neighbours of a place f beyond the second
/// (Catmull-Rom: R. Keys, "Cubic convolution interpolation", 1981, with a = -1/2).
const CUBIC: [[f32; 4]; 4] =
    [[0.0, 1.0, 0.0, 0.0], [-0.5, 0.0, 0.5, 0.0], [1.0, -2.5, 2.0, -0.5], [-0.5, 1.5, -1.5, 0.5]];
/// Makes coordinates positive, so that a cast, which truncates, is the floor.
const OFFSET: i32 = 1 << 20;
/// Places are worked on in blocks that stay in the first-level cache.
const BLOCK: usize = 256;
const LANES: usize = 8;

/// A picture that continues at its opposite border.
#[derive(Clone)]
pub(super) struct Plane {
    pub(super) width: usize,
    pub(super) height: usize,
    /// Rows of grey levels.
    pub(super) grey: Vec<f32>,
}

impl Plane {
    /// All of one grey.
    pub(super) fn uniform(width: usize, height: usize, grey: f32) -> Self {
        Self { width, height, grey: vec![grey; width * height] }
    }

    /// Each texel from its column and row.
    pub(super) fn from_fn(width: usize, height: usize, grey: impl Fn(usize, usize) -> f32) -> Self {
        let mut plane = Self::uniform(width, height, 0.0);
        for (y, row) in plane.grey.chunks_exact_mut(width).enumerate() {
            row.iter_mut().enumerate().for_each(|(x, g)| *g = grey(x, y));
        }
        plane
    }

    /// Mean and standard deviation.
    pub(super) fn mean_and_deviation(&self) -> (f64, f64) {
        let n = self.grey.len() as f64;
        // several sums side by side, so that one addition need not wait for the one before
        let (mut sums, mut squares) = ([0.0f64; LANES], [0.0f64; LANES]);
        for greys in self.grey.chunks(LANES) {
            for ((sum, square), &g) in sums.iter_mut().zip(&mut squares).zip(greys) {
                *sum += f64::from(g);
                *square += f64::from(g) * f64::from(g);
            }
        }
        let mean = sums.iter().sum::<f64>() / n;
        let variance = squares.iter().sum::<f64>() / n - mean * mean;
        (mean, variance.max(0.0).sqrt())
    }

    /// With mean 0 and standard deviation 1; 0 where there was no contrast at all.
    pub(super) fn standardised(mut self) -> Self {
        let (mean, deviation) = self.mean_and_deviation();
        let factor = if deviation > 1e-5 { 1.0 / deviation } else { 0.0 };
        self.grey.iter_mut().for_each(|g| *g = ((f64::from(*g) - mean) * factor) as f32);
        self
    }

    /// Adds `weight` times the other plane, which has the same size.
    pub(super) fn add(&mut self, other: &Plane, weight: f32) {
        self.grey.iter_mut().zip(&other.grey).for_each(|(g, o)| *g += weight * o);
    }

    /// Convolved in both directions with a symmetric kernel: its middle, then the weights outwards.
    pub(super) fn convolved(&self, kernel: &[f32]) -> Self {
        let (width, height, reach) = (self.width, self.height, kernel.len() - 1);
        let mut across = Self::uniform(width, height, 0.0);
        let mut padded = vec![0.0; width + 2 * reach];
        for (source, target) in self.grey.chunks_exact(width).zip(across.grey.chunks_exact_mut(width)) {
            for (i, p) in padded.iter_mut().enumerate() {
                *p = source[(i + width * reach - reach) % width];
            }
            for (i, &weight) in kernel.iter().enumerate() {
                add_pair(target, &padded[reach - i..], &padded[reach + i..], folded(i, weight));
            }
        }
        let mut result = Self::uniform(width, height, 0.0);
        for (y, target) in result.grey.chunks_exact_mut(width).enumerate() {
            for (i, &weight) in kernel.iter().enumerate() {
                let row = |y: usize| &across.grey[y % height * width..][..width];
                add_pair(target, row(y + height * kernel.len() - i), row(y + i), folded(i, weight));
            }
        }
        result
    }

    /// Convolved with a Gaussian of `sigma` texels.
    pub(super) fn blurred(&self, sigma: f64) -> Self {
        let reach = (3.5 * sigma).ceil() as i32;
        let weights: Vec<f64> =
            (0..=reach).map(|i| libm::exp(-0.5 * f64::from(i) / sigma * f64::from(i) / sigma)).collect();
        let sum = 2.0 * weights.iter().sum::<f64>() - weights[0];
        let kernel: Vec<f32> = weights.iter().map(|w| (w / sum) as f32).collect();
        self.convolved(&kernel)
    }

    /// Sum of the differences between neighbours in a box about a place, `half` texels in each direction: how much
    /// texture there is, be there an edge or not.
    pub(super) fn roughness_near(&self, [x, y]: [f64; 2], half: usize) -> f64 {
        let [x, y] = [(x, self.width), (y, self.height)].map(|(v, side)| v as usize + side - half % side);
        let texel = |x: usize, y: usize| self.grey[y % self.height * self.width + x % self.width];
        let texels = (y..=y + 2 * half).flat_map(|y| (x..=x + 2 * half).map(move |x| (x, y)));
        let steps = texels.map(|(x, y)| {
            let here = texel(x, y);
            f64::from((texel(x + 1, y) - here).abs() + (texel(x, y + 1) - here).abs())
        });
        steps.sum()
    }
}

/// The middle of a kernel is added twice as a pair.
fn folded(i: usize, weight: f32) -> f32 {
    if i == 0 { 0.5 * weight } else { weight }
}

fn add_pair(target: &mut [f32], left: &[f32], right: &[f32], weight: f32) {
    for ((t, l), r) in target.iter_mut().zip(left).zip(right) {
        *t += weight * (l + r);
    }
}

/// A plane made ready for cubic interpolation. Texel (i, j) is at coordinate (i, j).
pub(super) struct Lookup {
    size: [f64; 2],
    inverse: [f64; 2],
    stride: usize,
    /// The plane with one texel more to the left and above, three to the right and below.
    grey: Vec<f32>,
}

impl Lookup {
    /// Of the given plane.
    pub(super) fn new(plane: &Plane) -> Self {
        let (width, height) = (plane.width, plane.height);
        let stride = width + 4;
        let mut grey = Vec::with_capacity(stride * (height + 4));
        for y in 0..height + 4 {
            let row = &plane.grey[(y + height - 1) % height * width..][..width];
            grey.extend((0..stride).map(|x| row[(x + width - 1) % width]));
        }
        let size = [width as f64, height as f64];
        Self { size, inverse: size.map(|s| 1.0 / s), stride, grey }
    }

    /// The grey at one place, any finite coordinates within a few hundred periods.
    pub(super) fn at(&self, x: f64, y: f64) -> f32 {
        let column = split(x, self.size[0], self.inverse[0]);
        let row = split(y, self.size[1], self.inverse[1]);
        cubic(&self.grey, self.stride, column, row)
    }

    /// The greys at many places.
    pub(super) fn read(&self, xs: &[f64], ys: &[f64], grey: &mut [f32]) {
        let (mut columns, mut rows) = ([Split::default(); BLOCK], [Split::default(); BLOCK]);
        for ((grey, xs), ys) in grey.chunks_mut(BLOCK).zip(xs.chunks(BLOCK)).zip(ys.chunks(BLOCK)) {
            split_all(xs, self.size[0], self.inverse[0], &mut columns);
            split_all(ys, self.size[1], self.inverse[1], &mut rows);
            interpolate(&self.grey, self.stride, (&columns, &rows), grey);
        }
    }
}

#[multiversion::multiversion(targets("x86_64+avx2"))]
fn split_all(places: &[f64], period: f64, inverse: f64, parts: &mut [Split]) {
    for (part, &place) in parts.iter_mut().zip(places) {
        *part = split(place, period, inverse);
    }
}

#[multiversion::multiversion(targets("x86_64+avx2"))]
fn interpolate(texels: &[f32], stride: usize, (columns, rows): (&[Split], &[Split]), grey: &mut [f32]) {
    for ((g, &column), &row) in grey.iter_mut().zip(columns).zip(rows) {
        *g = cubic(texels, stride, column, row);
    }
}

/// A coordinate within the period.
#[derive(Clone, Copy, Default)]
struct Split {
    /// The texel before it.
    texel: i32,
    /// How far beyond that it is, 0 to 1.
    beyond: f32,
}

/// Exact for coordinates that are multiples of 2^-18, so that whole-pixel motion shifts a picture exactly.
#[inline(always)]
fn split(x: f64, period: f64, inverse: f64) -> Split {
    let periods = (x * inverse + f64::from(OFFSET)) as i32 - OFFSET;
    let within = x - f64::from(periods) * period;
    let texel = within as i32;
    Split { texel, beyond: (within - f64::from(texel)) as f32 }
}

/// Interpolates between 4 x 4 texels of a [`Lookup`].
#[inline(always)]
fn cubic(texels: &[f32], stride: usize, column: Split, row: Split) -> f32 {
    let texels = &texels[row.texel as usize * stride + column.texel as usize..];
    let (across, down) = (weights(column.beyond), weights(row.beyond));
    let mut sums = [0.0f32; 4];
    for (j, weight) in down.iter().enumerate() {
        let row = &texels[j * stride..j * stride + 4];
        for (sum, texel) in sums.iter_mut().zip(row) {
            *sum += weight * texel;
        }
    }
    (sums[0] * across[0] + sums[2] * across[2]) + (sums[1] * across[1] + sums[3] * across[3])
}

#[inline(always)]
fn weights(f: f32) -> [f32; 4] {
    std::array::from_fn(|i| CUBIC[0][i] + f * (CUBIC[1][i] + f * (CUBIC[2][i] + f * CUBIC[3][i])))
}
