//! The inner loop: one row of a texture as the camera sees it.
//!
//! Three passes over a row that stays in the first-level cache: coordinates, loads, interpolation. Only the
//! loads are scalar. Rust never contracts to fused multiply-add, so that the AVX2 version gives the same bits.

use crate::levels::{Choice, Level};
use crate::mapping::{Homography, RowMap};

/// Samples per pixel, each way, of a plane that is seen at a slant.
const SLANT_SAMPLES: usize = 4;

/// 1.5 * 2^23: adding it to a number below 2^22 leaves that number, rounded, in the low bits; a plain cast
/// would saturate, which is slower.
pub(crate) const ROUNDING: f32 = 12_582_912.0;

/// Working space of one row.
pub(crate) struct RowScratch {
    /// 0, 1, 2, … as floats.
    columns: Vec<f32>,
    index: Vec<u32>,
    weights: Vec<u32>,
    blend: Vec<f32>,
    sample: Vec<f32>,
}

impl RowScratch {
    /// Space for rows of `width` pixels.
    pub(crate) fn new(width: usize) -> Self {
        Self {
            columns: (0..width).map(|x| x as f32).collect(),
            index: vec![0; width],
            weights: vec![0; width],
            blend: vec![0.0; width],
            sample: vec![0.0; width],
        }
    }

    /// Writes columns `from..to` of row `y` into the same columns of `grey`; those that do not see the plane get
    /// `void`.
    pub(crate) fn draw(
        &mut self,
        homography: &Homography,
        choice: &Choice<'_>,
        (y, from, to): (usize, usize, usize),
        void: f32,
        grey: &mut [f32],
    ) {
        self.draw_level(homography, choice.level, (y, from, to), void, grey);
        if let Some((level, share)) = choice.blend {
            let mut other = std::mem::take(&mut self.blend);
            self.draw_level(homography, level, (y, from, to), void, &mut other);
            for (g, o) in grey[from..to].iter_mut().zip(&other[from..to]) {
                *g += share * (o - *g);
            }
            self.blend = other;
        }
    }

    /// As [`draw`](Self::draw), with the mean of 4 x 4 samples per pixel: for planes whose texture is squeezed by
    /// perspective, which a level that is blurred alike in all directions does not hold.
    pub(crate) fn draw_slanted(
        &mut self,
        homography: &Homography,
        choice: &Choice<'_>,
        (y, from, to): (usize, usize, usize),
        void: f32,
        grey: &mut [f32],
    ) {
        let mut sample = std::mem::take(&mut self.sample);
        grey[from..to].fill(0.0);
        let offset = |i: usize| (i as f64 + 0.5) / SLANT_SAMPLES as f64 - 0.5;
        for i in 0..SLANT_SAMPLES * SLANT_SAMPLES {
            let shifted = homography.shifted(offset(i % SLANT_SAMPLES), offset(i / SLANT_SAMPLES));
            self.draw(&shifted, choice, (y, from, to), void, &mut sample);
            for (g, s) in grey[from..to].iter_mut().zip(&sample[from..to]) {
                *g += s * (1.0 / (SLANT_SAMPLES * SLANT_SAMPLES) as f32);
            }
        }
        self.sample = sample;
    }

    fn draw_level(
        &mut self,
        homography: &Homography,
        level: &Level,
        (y, from, to): (usize, usize, usize),
        void: f32,
        grey: &mut [f32],
    ) {
        let Some(row) = homography.row(y, from, to, level) else {
            grey[from..to].fill(void);
            return;
        };
        grey[from..row.from].fill(void);
        grey[row.to..to].fill(void);
        let span = row.from..row.to;
        warp(
            &row,
            level,
            &self.columns[span.clone()],
            (&mut self.index[span.clone()], &mut self.weights[span.clone()]),
            &mut grey[span],
        );
    }
}

/// Samples `level` at the columns of `row`; all slices have the length of the row's visible part.
#[multiversion::multiversion(targets("x86_64+avx2"))]
fn warp(row: &RowMap, level: &Level, columns: &[f32], scratch: (&mut [u32], &mut [u32]), grey: &mut [f32]) {
    warp_body(row, level, columns, scratch, grey);
}

#[inline(always)]
fn warp_body(
    row: &RowMap,
    level: &Level,
    columns: &[f32],
    scratch: (&mut [u32], &mut [u32]),
    grey: &mut [f32],
) {
    let (index, weights) = scratch;
    let mask = level.side as i32 - 1;
    let shift = level.side.trailing_zeros();
    let anchor = row.anchor as f32;
    for ((&column, i), w) in columns.iter().zip(index.iter_mut()).zip(weights.iter_mut()) {
        let d = column - anchor;
        let t = d / (1.0 + row.bend * d);
        let u = subtexels(row.u.rest + row.u.slope * t);
        let v = subtexels(row.v.rest + row.v.slope * t);
        let x = (u >> 8).wrapping_add(row.u.whole) & mask;
        let y = (v >> 8).wrapping_add(row.v.whole) & mask;
        *i = (y << shift | x) as u32;
        *w = (u & 255 | (v & 255) << 16) as u32;
    }
    let quads = &level.quads[..level.side * level.side];
    for i in index.iter_mut() {
        *i = quads[*i as usize];
    }
    for ((g, &quad), &weight) in grey.iter_mut().zip(index.iter()).zip(weights.iter()) {
        *g = interpolate(quad, weight);
    }
}

/// Rounded to an integer.
#[inline(always)]
fn subtexels(x: f32) -> i32 {
    ((x + ROUNDING).to_bits() as i32).wrapping_sub(ROUNDING.to_bits() as i32)
}

/// Bilinear between the four texels of `quad`; weights of 8 bits in the two halves of `weight`; exact in 24 bits.
#[inline(always)]
fn interpolate(quad: u32, weight: u32) -> f32 {
    let (fu, fv) = ((weight & 0xffff) as i32, (weight >> 16) as i32);
    let byte = |n: u32| (quad >> (8 * n) & 255) as i32;
    let upper = (byte(0) << 8) + fu * (byte(1) - byte(0));
    let lower = (byte(2) << 8) + fu * (byte(3) - byte(2));
    ((upper << 8) + fv * (lower - upper)) as f32 * (1.0 / 65536.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mapping::AxisMap;

    #[test]
    fn interpolation_is_bilinear() {
        let quad = 10 | 50 << 8 | 90 << 16 | 250 << 24;
        for (fu, fv) in [(0u32, 0u32), (255, 0), (0, 255), (128, 64), (255, 255)] {
            let (a, b) = (f64::from(fu) / 256.0, f64::from(fv) / 256.0);
            let wanted = (1.0 - b) * (10.0 + a * 40.0) + b * (90.0 + a * 160.0);
            let got = f64::from(interpolate(quad, fu | fv << 16));
            assert!((got - wanted).abs() < 1e-4, "weights {fu} {fv}: {got}, wanted {wanted}");
        }
    }

    #[test]
    fn rounding_holds_for_both_signs() {
        for x in [-4_000_000.0f32, -300.6, -0.4, 0.4, 17.0, 255.6, 4_000_000.0] {
            assert_eq!(subtexels(x), x.round() as i32, "{x}");
        }
    }

    /// Oracle: the four texels around the point, weighted in double precision.
    #[test]
    fn row_is_the_bilinear_interpolation_of_its_texels() {
        let side = 64;
        let grey = |x: i64, y: i64| ((x.rem_euclid(64) * 37 + y.rem_euclid(64) * 101) % 251) as f64;
        let byte = |x: usize, y: usize| grey(x as i64, y as i64) as u32;
        let quads = (0..side * side)
            .map(|i| (i % side, i / side))
            .map(|(x, y)| byte(x, y) | byte(x + 1, y) << 8 | byte(x, y + 1) << 16 | byte(x + 1, y + 1) << 24)
            .collect();
        let level = Level { side, texel_m: 0.001, quads };
        let columns: Vec<f32> = (0..200).map(|x| x as f32).collect();
        let u = AxisMap { whole: 13, rest: 77.7, slope: 499.3 };
        let v = AxisMap { whole: 61, rest: 3.3, slope: -211.9 };
        let row = RowMap { from: 0, to: 200, anchor: 90, u, v, bend: 4e-4 };
        let (mut got, mut scratch) = (vec![0.0; 200], (vec![0; 200], vec![0; 200]));
        warp(&row, &level, &columns, (&mut scratch.0, &mut scratch.1), &mut got);
        for (x, &got) in got.iter().enumerate() {
            let d = x as f64 - 90.0;
            let t = d / (1.0 + f64::from(row.bend) * d);
            let at = |a: AxisMap| f64::from(a.whole) + (f64::from(a.rest) + f64::from(a.slope) * t) / 256.0;
            let (u, v) = (at(u), at(v));
            let (i, j) = (u.floor() as i64, v.floor() as i64);
            let (a, b) = (u.rem_euclid(1.0), v.rem_euclid(1.0));
            let upper = (1.0 - a) * grey(i, j) + a * grey(i + 1, j);
            let lower = (1.0 - a) * grey(i, j + 1) + a * grey(i + 1, j + 1);
            let wanted = (1.0 - b) * upper + b * lower;
            // half a subtexel each way, and neighbours differ by up to 250
            assert!((f64::from(got) - wanted).abs() < 1.0, "column {x}: {got}, wanted {wanted}");
        }
    }

    /// Where the machine has AVX2 this compares the two instruction sets.
    #[test]
    fn vector_and_plain_versions_give_the_same_bits() {
        let side = 64;
        let quads = (0..side * side).map(|i| (i as u32).wrapping_mul(2_654_435_761)).collect();
        let level = Level { side, texel_m: 0.001, quads };
        let columns: Vec<f32> = (0..301).map(|x| x as f32).collect();
        for bend in [0.0, 7.3e-4, -1.1e-3] {
            let u = AxisMap { whole: 13, rest: 77.7, slope: 499.3 };
            let v = AxisMap { whole: 61, rest: 3.3, slope: -211.9 };
            let row = RowMap { from: 0, to: 301, anchor: 150, u, v, bend };
            let (mut a, mut b) = (vec![0.0; 301], vec![0.0; 301]);
            let mut scratch = (vec![0; 301], vec![0; 301]);
            warp(&row, &level, &columns, (&mut scratch.0, &mut scratch.1), &mut a);
            warp_body(&row, &level, &columns, (&mut scratch.0, &mut scratch.1), &mut b);
            let bits = |row: &[f32]| row.iter().map(|g| g.to_bits()).collect::<Vec<_>>();
            assert_eq!(bits(&a), bits(&b), "bend {bend}");
        }
    }
}
