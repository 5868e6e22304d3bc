//! A slow, plain implementation of design notes on vision, section 2, as the oracle for the fast one: no lanes, no
//! blocks of rows, no 16 bits.

use super::*;
use crate::cells::Grid;
use crate::compensation;
use crate::pyramid::{LEVELS, Pyramid};

/// A level as numbers.
pub(crate) struct Plain {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) values: Vec<i64>,
}

impl Plain {
    fn at(&self, x: i64, y: i64) -> i64 {
        let x = x.clamp(0, self.width as i64 - 1) as usize;
        let y = y.clamp(0, self.height as i64 - 1) as usize;
        self.values[y * self.width + x]
    }

    /// `[1 4 6 4 1]` in both directions at even rows and columns; `vertical` and `horizontal` round.
    fn halved(&self, vertical: impl Fn(i64) -> i64, horizontal: impl Fn(i64) -> i64) -> Plain {
        let (width, height) = (self.width.div_ceil(2), self.height.div_ceil(2));
        let taps = [(-2, 1), (-1, 4), (0, 6), (1, 4), (2, 1)];
        let mut values = Vec::new();
        for y in 0..height as i64 {
            for x in 0..width as i64 {
                let column = |x: i64| vertical(taps.iter().map(|&(dy, w)| w * self.at(x, 2 * y + dy)).sum());
                let inside = |x: i64| x.clamp(0, self.width as i64 - 1);
                let sum = taps.iter().map(|&(dx, w)| w * column(inside(2 * x + dx))).sum();
                values.push(horizontal(sum));
            }
        }
        Plain { width, height, values }
    }
}

/// The frame moved by `shift`, border repeated.
fn shifted(picture: &Picture, shift: (i32, i32)) -> Plain {
    let (width, height) = (picture.width, picture.height);
    let frame = Plain { width, height, values: picture.pixels.iter().map(|&p| i64::from(p)).collect() };
    let value =
        |i: usize| frame.at((i % width) as i64 - i64::from(shift.0), (i / width) as i64 - i64::from(shift.1));
    Plain { width, height, values: (0..width * height).map(value).collect() }
}

/// Levels 1 to 3, in 1/16 grey level.
pub(crate) fn pyramid(picture: &Picture, shift: (i32, i32)) -> [Plain; LEVELS] {
    let round = |sum: i64| (sum + 8) >> 4;
    let first = shifted(picture, shift).halved(|sum| sum, round);
    let second = first.halved(round, round);
    let third = second.halved(round, round);
    [first, second, third]
}

/// Ix - Iy, Ix + Iy, Ix, Iy and It in 1/64 grey level.
fn derivatives(a: &Plain, b: &Plain, x: usize, y: usize) -> ([i64; 4], i64) {
    let (x, y) = (x as i64, y as i64);
    let s = |dy: i64, dx: i64| a.at(x + dx, y + dy) + b.at(x + dx, y + dy);
    let d = |dy: i64, dx: i64| b.at(x + dx, y + dy) - a.at(x + dx, y + dy);
    let ix = s(0, 1) + s(1, 1) - s(0, 0) - s(1, 0);
    let iy = s(1, 0) + s(1, 1) - s(0, 0) - s(0, 1);
    ([ix - iy, ix + iy, ix, iy], d(0, 0) + d(0, 1) + d(1, 0) + d(1, 1))
}

/// Whether a detector hears: the printed T, squared, exact.
fn tuned(it: i64, d: i64) -> bool {
    2 * it * it > d * d && it * it < 2 * d * d
}

/// Vote of the fast path in its own units.
fn whole_vote(direction: usize, it: i64, d: i64) -> i64 {
    if !tuned(it, d) {
        return 0;
    }
    let sum = it.abs() + d.abs();
    let weight = if direction < 2 { (sum + 2) / 4 } else { sum / 2 };
    if (it < 0) == (d < 0) { -weight } else { weight }
}

/// The interior's coherence by the printed formula, in real numbers.
pub(crate) fn real_coherence(older: &Picture, newer: &Picture) -> [f64; FIELDS] {
    let (older, newer) = (pyramid(older, (0, 0)), pyramid(newer, (0, 0)));
    std::array::from_fn(|i| {
        let (k, direction) = (i / 4, i % 4);
        let (a, b) = (&older[k], &newer[k]);
        let margin = (12 >> k).max(3);
        let (mut votes, mut norm) = (0.0, 0.0);
        for y in margin..a.height - margin {
            for x in margin..a.width - margin {
                let (d, it) = derivatives(a, b, x, y);
                let (d, it) = (d[direction] as f64, it as f64);
                if 2.0 * it * it > d * d && it * it < 2.0 * d * d {
                    votes -= (it * it + d * d).sqrt() * it.signum() * d.signum();
                }
                norm += d.abs();
            }
        }
        votes / (std::f64::consts::SQRT_2 * norm)
    })
}

/// All fields of a pair by direct summation over every vote with the spline's value at its block.
pub(crate) fn fields(older: &Picture, newer: &Picture, shift: (i32, i32), field: usize) -> Vec<f64> {
    let (k, direction) = (field / 4, field % 4);
    let (a, b) = (&pyramid(older, shift)[k], &pyramid(newer, (0, 0))[k]);
    let grid = Grid::new(newer.width, newer.height);
    let cell = grid.cell_px / f64::from(2 << k);
    let block = ((cell / 4.0) as usize).clamp(1, 4);
    let region = compensation::voting_region(shift, Smoothing::Binomial, k, (a.width, a.height));
    let mut sums = vec![0.0; grid.columns * grid.rows];
    let weight = |g: usize, pixel: usize| {
        let middle = ((pixel / block) as f64 + 0.5) * block as f64;
        let knots = cell.max(1.0);
        let t = ((middle - (g as f64 + 0.5) * cell) / knots).abs();
        let spline = match t {
            t if t < 0.5 => 0.75 - t * t,
            t if t < 1.5 => 0.5 * (1.5 - t).powi(2),
            _ => 0.0,
        };
        (spline * block as f64 / knots * 4096.0).round() / 4096.0
    };
    for y in region.rows.0..region.rows.1 {
        for x in region.columns.0..region.columns.1 {
            let (d, it) = derivatives(a, b, x, y);
            let vote = whole_vote(direction, it, d[direction]) as f64;
            if vote == 0.0 {
                continue;
            }
            let near = |pixel: usize, count: usize| {
                let middle = pixel as f64 / cell;
                let reach = 1.5 * cell.max(1.0) / cell + (block as f64 / cell).max(1.0);
                (middle - reach).max(0.0) as usize..((middle + reach) as usize + 1).min(count)
            };
            for gy in near(y, grid.rows) {
                for gx in near(x, grid.columns) {
                    sums[gy * grid.columns + gx] += vote * weight(gx, x) * weight(gy, y);
                }
            }
        }
    }
    let unit = if direction < 2 { 4.0 } else { 2.0 } / 64.0 / 2f64.sqrt();
    sums.iter().map(|sum| sum * unit / (block * block) as f64).collect()
}

/// Checks pyramid and fields of the fast path on a frame pair of this size.
fn check(width: usize, height: usize, shift: (i64, i64), seed: u64) {
    let texture = Texture::natural(128, 40.0, seed);
    let disc = |u: i64| Disc { centre: (width as i64 / 2 + u, height as i64 / 2), side: 20 };
    let older = texture.with_disc((width, height), (0, 0), disc(0));
    let newer = texture.with_disc((width, height), shift, disc(shift.0 + 3));
    let mut fast = Pyramid::new(width, height, Smoothing::Binomial);
    for shift in [(0, 0), (5, -3), (-4, 7)] {
        fast.build(&older.image(), shift);
        for (fast, plain) in fast.levels.iter().zip(pyramid(&older, shift)) {
            assert_eq!((fast.width, fast.height), (plain.width, plain.height));
            for (y, row) in plain.values.chunks_exact(plain.width).enumerate() {
                let fast = &fast.values[y * fast.stride..][..fast.width];
                assert!(fast.iter().map(|&v| i64::from(v)).eq(row.iter().copied()), "row {y}");
            }
        }
    }
    let (fast, summary) = vote(&older, &newer, &Parameters::default());
    let mut largest = 0f64;
    for (field, fast) in fast.iter().enumerate() {
        let plain = fields(&older, &newer, summary.shift, field);
        assert_eq!(plain.len(), summary.columns * summary.rows);
        for (cell, (&fast, plain)) in fast.iter().zip(plain).enumerate() {
            largest = largest.max(plain.abs());
            // Only the rounding to f32 and the order of the oracle's real sums may differ.
            let tolerance = 1e-6 * plain.abs().max(1e-3);
            let difference = (f64::from(fast) - plain).abs();
            assert!(difference <= tolerance, "field {field}, cell {cell}: {fast}, oracle {plain}");
        }
    }
    assert!(largest > 0.1, "the pair must vote, its largest cell is {largest}");
}

#[test]
fn the_fast_path_is_the_oracle_at_512() {
    check(512, 512, (6, 3), 1);
}

#[test]
fn the_fast_path_is_the_oracle_at_odd_and_small_sizes() {
    for (width, height) in [(64, 64), (65, 67), (101, 64), (64, 255), (320, 180), (177, 131), (256, 256)] {
        check(width, height, (2, -1), width as u64);
    }
}

#[test]
fn the_sixteen_bit_comparison_is_the_printed_one_but_for_a_known_few() {
    let root_half = |b: u64| (b * 46341) >> 16;
    let mut wrong = Vec::new();
    for b in 0..=16_320u64 {
        let exact = ((b * b) as f64 / 2.0).sqrt().floor() as u64;
        let exact = if 2 * (exact + 1).pow(2) <= b * b { exact + 1 } else { exact };
        if root_half(b) != exact {
            assert_eq!(root_half(b), exact + 1);
            wrong.push(b);
        }
    }
    println!("{} differ, the first at {:?}", wrong.len(), wrong.first());
    assert_eq!(wrong.first(), Some(&1393));
    assert_eq!(wrong.len(), 102);
}

#[test]
fn the_spline_is_the_repeated_kernel_of_the_specification() {
    // 512 px: cells of 16, 8, 4 level px. One impulse at a time through [1 3 3 1] / 8, repeated.
    let (cell, width) = (16usize, 256usize);
    let axis = crate::cells::AxisWeights::new(16, cell as f64, 4, width / 4);
    let mut kernel = vec![vec![0.0; width]; 16];
    for pixel in 0..width {
        let mut line = vec![0.0; width];
        line[pixel] = cell as f64;
        while line.len() > 16 {
            let at = |i: i64| if i < 0 { 0.0 } else { line.get(i as usize).copied().unwrap_or(0.0) };
            line = (0..line.len() as i64 / 2)
                .map(|i| (at(2 * i - 1) + 3.0 * at(2 * i) + 3.0 * at(2 * i + 1) + at(2 * i + 2)) / 8.0)
                .collect();
        }
        for (g, value) in line.into_iter().enumerate() {
            kernel[g][pixel] = value;
        }
    }
    let mut worst = 0f64;
    // The outer cells differ: there the repeated kernel loses votes at each stage.
    for (g, (first, weights)) in axis.iter().enumerate().take(14).skip(2) {
        for block in 0..width / 4 {
            let repeated = kernel[g][4 * block..][..4].iter().sum::<f64>() / 4.0;
            let weight = block.checked_sub(first).and_then(|tap| weights.get(tap)).copied().unwrap_or(0);
            worst = worst.max((f64::from(weight) / 4096.0 * cell as f64 / 4.0 - repeated).abs());
        }
    }
    println!("largest difference {worst} of a peak of 0.75");
    assert!(worst < 0.01 * 0.75, "{worst}");
}

/// Sums of all votes of a pair of levels, in plain integers.
pub(crate) fn whole_sums(older: &crate::pyramid::Level, newer: &crate::pyramid::Level) -> [i64; 4] {
    let plain = |level: &crate::pyramid::Level| Plain {
        width: level.width,
        height: level.height,
        values: level
            .values
            .chunks_exact(level.stride)
            .flat_map(|row| row[..level.width].iter().map(|&v| i64::from(v)))
            .collect(),
    };
    let (a, b) = (plain(older), plain(newer));
    let mut sums = [0; 4];
    for y in 0..a.height - 1 {
        for x in 0..a.width - 1 {
            let (d, it) = derivatives(&a, &b, x, y);
            for (direction, sum) in sums.iter_mut().enumerate() {
                *sum += whole_vote(direction, it, d[direction]);
            }
        }
    }
    sums
}
