//! Warp, fit, gain, search and patches of robust mode against direct computations, and the processor's widest
//! version against the plain one.

use multiversion::multiversion;
use nalgebra::{DMatrix, DVector};

use super::*;
use crate::pyramid::{LEVELS, Level};
use crate::robust::fit::{Moments, moments, moments_body};
use crate::robust::gain::Gain;
use crate::robust::patch::{Lines, Place, shifted};
use crate::robust::search::Search;
use crate::robust::warp::{Span, warp, warp_row};

pub(super) fn level(width: usize, height: usize, mut value: impl FnMut(usize, usize) -> f64) -> Level {
    let mut level = Level::new(width, height);
    for y in 0..height {
        for x in 0..width {
            level.values[y * level.stride + x] = value(x, y).round().clamp(0.0, 4080.0) as i16;
        }
    }
    level
}

fn noise(width: usize, height: usize, seed: u64) -> Level {
    let mut random = Random(seed);
    level(width, height, |_, _| 4080.0 * random.uniform())
}

pub(super) fn full(level: &Level) -> Vec<Span> {
    vec![(0, level.width); level.height]
}

/// A motion of an image of `size` px with random coefficients.
fn motion(size: (usize, usize), random: &mut Random) -> GlobalMotion {
    let mut motion = GlobalMotion::still(size.0, size.1);
    let half = size.0.max(size.1) as f64 / 2.0;
    let scales = [0.2, 0.05, 0.05, 0.2, 0.05, 0.05, 0.01, 0.01];
    motion.coefficients = scales.map(|scale| 2.0 * scale * half * (random.uniform() - 0.5));
    motion
}

// ---- The same bits on every processor ----

/// The warp as a processor without vectors wider than 16 bytes computes it.
fn warp_plainly(source: &Level, motion: &GlobalMotion, gain: &mut Gain, k: usize) -> (Level, Vec<Span>) {
    let mut out = source.clone();
    let spans = (0..out.height)
        .map(|y| {
            let line = &mut out.values[y * out.stride..][..out.stride];
            warp_row(source, motion, gain.row(k, y), ((k, y), (0, 0)), line)
        })
        .collect();
    (out, spans)
}

#[multiversion(targets("x86_64+avx2"))]
fn warp_row_of_avx2(
    source: &Level,
    motion: &GlobalMotion,
    factors: &[f32],
    place: (usize, usize),
    line: &mut [i16],
) -> Span {
    warp_row(source, motion, factors, (place, (0, 0)), line)
}

#[multiversion(targets("x86_64+avx2"))]
fn moments_of_avx2(a: &Level, b: &Level, spans: &[Span], at: (usize, &GlobalMotion), s: f32) -> Moments {
    moments_body(a, b, spans, at, s)
}

/// A gain that is not 1 for levels of an image of `size` px.
fn some_gain(size: (usize, usize), seed: u64) -> Gain {
    let (w, h) = (size.0.div_ceil(8), size.1.div_ceil(8));
    let mut gain = Gain::new(w, h, size.0.div_ceil(2));
    let (a, b) = (noise(w, h, seed), noise(w, h, seed + 1));
    gain.measure(&a, &b, &full(&a));
    gain
}

#[test]
fn the_warp_is_the_same_to_the_bit_on_every_path() {
    let mut random = Random(1);
    for (seed, size) in [(256usize, 256usize), (321, 257), (130, 64), (64, 200)].into_iter().enumerate() {
        for k in 0..LEVELS {
            let source = noise(size.0.div_ceil(2 << k), size.1.div_ceil(2 << k), seed as u64);
            let motion = motion(size, &mut random);
            let mut gain = some_gain(size, seed as u64);
            let (mut out, mut spans) = (source.clone(), full(&source));
            warp(&source, &motion, (&mut gain, true), k, &mut out, &mut spans);
            let (plain, plain_spans) = warp_plainly(&source, &motion, &mut gain, k);
            assert!(spans.iter().any(|span| span.1 > span.0), "{size:?}: something to compare");
            assert!(spans == plain_spans && out.values == plain.values, "{size:?} level {k}: plain");
            let mut line = vec![0; out.stride];
            for (y, &expected) in spans.iter().enumerate() {
                let span = warp_row_of_avx2(&source, &motion, gain.row(k, y), (k, y), &mut line);
                let row = &out.values[y * out.stride..][..out.width];
                assert!(span == expected && line[..out.width] == *row, "{size:?} level {k}: 256 bits");
            }
        }
    }
}

#[test]
fn the_sums_of_the_fit_are_the_same_to_the_bit_on_every_path() {
    let mut random = Random(2);
    for (seed, (width, height)) in [(128, 128), (161, 129), (33, 40), (65, 24)].into_iter().enumerate() {
        let (a, b) = (noise(width, height, seed as u64), noise(width, height, 9 + seed as u64));
        let motion = motion((2 * width, 2 * height), &mut random);
        let spans: Vec<Span> = (0..height).map(|y| (y % 7, width - y % 5)).collect();
        let fast = moments(&a, &b, &spans, (0, &motion), 700.0);
        assert!(fast != Moments::default());
        assert!(fast == moments_body(&a, &b, &spans, (0, &motion), 700.0), "{width}x{height}: plain");
        assert!(fast == moments_of_avx2(&a, &b, &spans, (0, &motion), 700.0), "{width}x{height}: 256 bits");
    }
}

// ---- Warp ----

#[test]
fn a_warp_by_whole_pixels_copies_them_and_leaves_out_what_comes_from_outside() {
    let source = noise(90, 70, 3);
    for (u, v) in [(0, 0), (7, -4), (-30, 2), (11, 33)] {
        let motion = GlobalMotion::still(180, 140).translated(f64::from(2 * u), f64::from(2 * v));
        let mut gain = Gain::new(23, 18, 90);
        let (mut out, mut spans) = (source.clone(), full(&source));
        warp(&source, &motion, (&mut gain, false), 0, &mut out, &mut spans);
        let mut copied = 0;
        for (y, &(from, to)) in spans.iter().enumerate() {
            for x in 0..out.width {
                let value = out.values[y * out.stride + x];
                if (from..to).contains(&x) {
                    let (sx, sy) = ((x as i32 - u) as usize, (y as i32 - v) as usize);
                    assert_eq!(value, source.values[sy * source.stride + sx], "({x}, {y}) from ({u}, {v})");
                    copied += 1;
                } else {
                    assert_eq!(value, 0, "({x}, {y}) is outside");
                }
            }
        }
        // All that is at least 3 px inside of the older level.
        let expected = (90 - 6 - u.abs()) * (70 - 6 - v.abs());
        assert!(copied >= expected && copied < expected + 5 * 160, "{copied}, not about {expected}");
    }
}

#[test]
fn a_warp_of_a_smooth_level_is_the_level_at_the_displaced_places() {
    let mut random = Random(5);
    let size = (256, 200);
    // Waves of 30 and 41 px, second difference up to 70: bilinear is 9 off at most, its continuation 2 more.
    let grey =
        |x: f64, y: f64| 2000.0 + 800.0 * (x / 4.8 + y / 7.0).sin() + 700.0 * (y / 6.5 - x / 30.0).cos();
    let source = level(128, 100, |x, y| grey(x as f64, y as f64));
    for _ in 0..10 {
        let motion = motion(size, &mut random);
        let mut gain = Gain::new(32, 25, 128);
        let (mut out, mut spans) = (source.clone(), full(&source));
        warp(&source, &motion, (&mut gain, false), 0, &mut out, &mut spans);
        let mut worst: f64 = 0.0;
        for (y, &(from, to)) in spans.iter().enumerate() {
            for x in from..to {
                // A level's pixel is two of the frame.
                let (u, v) = motion.at(2.0 * x as f64, 2.0 * y as f64);
                let expected = grey(x as f64 - u / 2.0, y as f64 - v / 2.0);
                worst = worst.max((f64::from(out.values[y * out.stride + x]) - expected).abs());
            }
        }
        assert!(worst < 16.0, "{worst} sixteenths of a grey level off");
    }
}

// ---- Fit ----

/// The weighted least-squares step of all coefficients in `free`, pixel by pixel with nalgebra.
fn direct_step(a: &Level, b: &Level, motion: &GlobalMotion, scale: f64, free: &[[f64; 8]]) -> DVector<f64> {
    let at = |level: &Level, x: usize, y: usize| f64::from(level.values[y * level.stride + x]);
    let mean = |x: usize, y: usize| (at(a, x, y) + at(b, x, y)) / 2.0;
    let mut matrix = DMatrix::zeros(free.len(), free.len());
    let mut vector = DVector::zeros(free.len());
    for top in (2..a.height - 2).step_by(8) {
        let rows = top..(top + 8).min(a.height - 2);
        for left in (2..a.width - 2).step_by(16) {
            let mut block_matrix = DMatrix::zeros(free.len(), free.len());
            let mut block_vector = DVector::zeros(free.len());
            let mut energy = 0.0;
            for (x, y) in rows.clone().flat_map(|y| (left..(left + 16).min(a.width - 2)).map(move |x| (x, y)))
            {
                let gx = (mean(x + 1, y) - mean(x - 1, y)) / 2.0;
                let gy = (mean(x, y + 1) - mean(x, y - 1)) / 2.0;
                let r = at(b, x, y) - at(a, x, y);
                let w = 1.0 / (1.0 + (r / scale).powi(2)).powi(2);
                let [px, py] = motion.normalised(2.0 * x as f64, 2.0 * y as f64);
                let u = [1.0, px, py, 0.0, 0.0, 0.0, px * px, px * py];
                let v = [0.0, 0.0, 0.0, 1.0, px, py, px * py, py * py];
                let row = DVector::from_iterator(
                    free.len(),
                    free.iter().map(|d| (0..8).map(|i| d[i] * (gx * u[i] + gy * v[i])).sum::<f64>()),
                );
                energy += w * (gx * gx + gy * gy) / 128.0;
                block_matrix += w * &row * row.transpose();
                block_vector += w * r * row;
            }
            let say = 1.0 / (1.0 + energy / 1024.0);
            matrix += say * block_matrix;
            vector += say * block_vector;
        }
    }
    let solved = matrix.lu().solve(&vector).unwrap();
    let mut step = DVector::zeros(8);
    for (d, s) in free.iter().zip(solved.iter()) {
        step += *s * DVector::from_row_slice(d);
    }
    step
}

#[test]
fn a_gauss_newton_step_is_that_of_a_direct_least_squares_fit() {
    let unit = |i: usize| std::array::from_fn(|j| f64::from(u8::from(i == j)));
    let turn = [0.0, 0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0];
    let zoom = [0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0];
    let models: [(MotionModel, Vec<[f64; 8]>); 4] = [
        (MotionModel::Translation, vec![unit(0), unit(3)]),
        (MotionModel::Similarity, vec![unit(0), unit(3), zoom, turn]),
        (MotionModel::Affine, (0..6).map(unit).collect()),
        (MotionModel::Planar, (0..8).map(unit).collect()),
    ];
    let waves = waves::Waves::new(400.0, 6);
    // Whole blocks, so that each has one middle.
    let (width, height) = (4 + 16 * 12, 4 + 8 * 20);
    let truth = [0.3, 0.2, -0.3, -0.2, 0.3, 0.1, 0.15, -0.1];
    let motion = GlobalMotion::still(2 * width, 2 * height);
    let mut random = Random(4);
    let mut grey = |moved: f64| {
        level(width, height, |x, y| {
            let (x, y) = (x as f64, y as f64);
            let [px, py] = motion.normalised(2.0 * x, 2.0 * y);
            let a = truth.map(|a| moved * a);
            let u = a[0] + a[1] * px + a[2] * py + a[6] * px * px + a[7] * px * py;
            let v = a[3] + a[4] * px + a[5] * py + a[6] * px * py + a[7] * py * py;
            2000.0 + waves.at(x - u, y - v) + 20.0 * random.normal()
        })
    };
    let (older, newer) = (grey(0.0), grey(1.0));
    let scale = 150.0;
    let sums = moments(&older, &newer, &full(&older), (0, &motion), scale);
    for (model, free) in models {
        let step = sums.solve(model, [0.0; 8], [1e9; 8], scale / 2.0).unwrap();
        let direct = direct_step(&older, &newer, &motion, f64::from(scale), &free);
        for i in 0..8 {
            // One place for each block of 16 x 8 px, and the ridge.
            assert!((step[i] - direct[i]).abs() < 0.01, "{model:?}: {step:.3?}, not {direct:.3?}");
        }
        if model == MotionModel::Planar {
            for i in 0..8 {
                // The correction is subtracted; one step does most of it.
                assert!((step[i] + truth[i]).abs() < 0.06, "{step:.3?} against {truth:?}");
            }
        }
    }
}

#[test]
fn a_level_without_structure_determines_no_motion() {
    let flat = level(64, 64, |_, _| 900.0);
    let motion = GlobalMotion::still(128, 128);
    let sums = moments(&flat, &flat, &full(&flat), (0, &motion), 5.0);
    let step = sums.solve(MotionModel::Planar, [0.0; 8], motion.prior(), 2.5);
    assert!(step.is_none_or(|step| step.iter().all(|a| a.abs() < 1e-6)), "{step:?}");
}

// ---- Gain ----

#[test]
fn the_gain_is_the_ratio_of_box_means_over_valid_pixels() {
    let (width, height, dark) = (80, 64, 64.0);
    // 28 of 256 rows of level 1 are 7 of 64 of level 3.
    let radius = 3i32;
    let (a, b) = (noise(width, height, 7), noise(width, height, 8));
    let valid = |y: usize| if (6..height - 9).contains(&y) { (5 + y % 3, width - 12) } else { (0, 0) };
    let spans: Vec<Span> = (0..height).map(valid).collect();
    let mut gain = Gain::new(width, height, 4 * width);
    gain.measure(&a, &b, &spans);
    let direct = |cx: i32, cy: i32| {
        let (mut older, mut newer) = (0.0, 0.0);
        for y in (cy - radius).max(0)..=(cy + radius).min(height as i32 - 1) {
            for x in (cx - radius).max(0)..=(cx + radius).min(width as i32 - 1) {
                let (from, to) = valid(y as usize);
                if (from..to).contains(&(x as usize)) {
                    let at = y as usize * a.stride + x as usize;
                    older += f64::from(a.values[at]) + dark;
                    newer += f64::from(b.values[at]) + dark;
                }
            }
        }
        (older > 0.0).then(|| newer / older)
    };
    let mut empty = 0;
    for y in 0..height {
        let row = gain.row(2, y)[..width].to_vec();
        for (x, factor) in row.into_iter().enumerate() {
            let (x, y) = (x as i32, y as i32);
            // Where the window is empty, the nearest one that is not: within the row, then among rows.
            let near_y = y.clamp(6 - radius, height as i32 - 10 + radius);
            let seen = |x: i32| direct(x, near_y);
            let near_x = (0..width as i32).filter(|&x| seen(x).is_some()).min_by_key(|i| (i - x).abs());
            let expected = near_x.and_then(seen).unwrap();
            empty += usize::from(direct(x, y).is_none());
            assert!((f64::from(factor) - expected).abs() < 1e-5, "({x}, {y}): {factor}, not {expected}");
        }
    }
    assert!(empty > 100, "{empty} windows without a valid pixel");
}

#[test]
fn without_any_valid_pixel_the_gain_is_1() {
    let mut gain = some_gain((256, 256), 1);
    let level = noise(32, 32, 2);
    gain.measure(&level, &level, &[(0, 0); 32]);
    assert!((0..32).all(|y| gain.row(2, y)[..32].iter().all(|&factor| factor == 1.0)));
}

#[test]
fn the_gain_of_finer_levels_is_bilinear_between_that_of_level_3() {
    let size = (250, 190);
    let mut gain = some_gain(size, 4);
    let (width, height) = (size.0.div_ceil(8), size.1.div_ceil(8));
    let coarse: Vec<Vec<f32>> = (0..height).map(|y| gain.row(2, y)[..width].to_vec()).collect();
    for k in 0..2 {
        let step = 4 >> k;
        for y in 0..size.1.div_ceil(2 << k) {
            let row = gain.row(k, y)[..size.0.div_ceil(2 << k)].to_vec();
            for (x, factor) in row.into_iter().enumerate() {
                let (cx, cy) = (x as f64 / step as f64, y as f64 / step as f64);
                let (x0, y0) = (cx.floor() as usize, cy.floor() as usize);
                let (fx, fy) = (cx - x0 as f64, cy - y0 as f64);
                let at = |x: usize, y: usize| f64::from(coarse[y.min(height - 1)][x.min(width - 1)]);
                let expected = (1.0 - fx) * (1.0 - fy) * at(x0, y0)
                    + fx * (1.0 - fy) * at(x0 + 1, y0)
                    + (1.0 - fx) * fy * at(x0, y0 + 1)
                    + fx * fy * at(x0 + 1, y0 + 1);
                assert!((f64::from(factor) - expected).abs() < 1e-4, "level {k} ({x}, {y})");
            }
        }
    }
}

// ---- Search ----

/// `picture` moved by (u, v), something else coming in.
fn moved(picture: &Level, (u, v): (i32, i32), seed: u64) -> Level {
    let other = noise(picture.width, picture.height, seed);
    level(picture.width, picture.height, |x, y| {
        let (sx, sy) = (x as i32 - u, y as i32 - v);
        let inside = (0..picture.width as i32).contains(&sx) && (0..picture.height as i32).contains(&sy);
        let from = if inside { (picture, sx, sy) } else { (&other, x as i32, y as i32) };
        f64::from(from.0.values[from.2 as usize * from.0.stride + from.1 as usize])
    })
}

#[test]
fn the_search_finds_any_shift_up_to_its_reach() {
    // A fifth of the side.
    for (width, height, reach) in [(60, 50, (12, 10)), (96, 96, (19, 19)), (25, 37, (5, 7))] {
        let older = noise(width, height, 1);
        let mut search = Search::new(width, height);
        for u in [-reach.0, -3, 0, 1, reach.0] {
            for v in [-reach.1, 0, 2, reach.1] {
                let newer = moved(&older, (u, v), 2);
                let found = search.candidates(&older, &newer);
                assert_eq!(found, [Some((u, v)), None], "{width}x{height}");
            }
        }
    }
}

#[test]
fn a_periodic_picture_has_a_rival_a_period_away() {
    let period = 9;
    let tile = noise(period, 50, 3);
    let older = level(60, 50, |x, y| f64::from(tile.values[y * tile.stride + x % period]));
    let found = Search::new(60, 50).candidates(&older, &moved(&older, (2, 1), 4));
    let [Some((u, v)), Some((ru, rv))] = found else { panic!("{found:?}") };
    assert_eq!((v, rv), (1, 1));
    assert_eq!(((u - 2) % period as i32, (ru - u).abs() % period as i32), (0, 0), "{found:?}");
    assert_ne!(u, ru);
}

#[test]
fn of_equally_good_shifts_the_shortest_is_searched_first() {
    let bars = level(60, 50, |x, _| if x * x % 11 < 5 { 3000.0 } else { 500.0 });
    let found = Search::new(60, 50).candidates(&bars, &bars);
    assert_eq!(found[0], Some((0, 0)), "bars along v");
    let flat = level(60, 50, |_, _| 700.0);
    assert_eq!(Search::new(60, 50).candidates(&flat, &flat)[0], Some((0, 0)), "nothing to see");
}

// ---- Patch ----

#[test]
fn a_displaced_patch_is_bilinear_between_the_pixels_with_the_border_repeated() {
    let source = noise(70, 60, 5);
    let grey = |x: i32, y: i32| {
        let (x, y) = (x.clamp(0, 69) as usize, y.clamp(0, 59) as usize);
        f32::from(source.values[y * source.stride + x]) / 16.0
    };
    for (x, y, u) in
        [(10, 9, [0.0, 0.0]), (-7, 40, [2.25, -3.5]), (50, -5, [-40.75, 0.125]), (3, 3, [90.0, 70.0])]
    {
        let place = Place { x, y, width: 32, height: 30 };
        let mut out = vec![0.0; place.pixels()];
        shifted(&source, place, u, &mut out, &mut Lines::new(64));
        for (i, &value) in out.iter().enumerate() {
            let (px, py) = ((i % 32) as f32 + x as f32 - u[0], (i / 32) as f32 + y as f32 - u[1]);
            let (x0, y0) = (px.floor(), py.floor());
            let (fx, fy) = (px - x0, py - y0);
            let (x0, y0) = (x0 as i32, y0 as i32);
            let top = grey(x0, y0) + fx * (grey(x0 + 1, y0) - grey(x0, y0));
            let bottom = grey(x0, y0 + 1) + fx * (grey(x0 + 1, y0 + 1) - grey(x0, y0 + 1));
            // Fractions of eighths: the numbers are exact.
            assert_eq!(value, top + fy * (bottom - top), "{i} of {place:?} by {u:?}");
        }
    }
}
