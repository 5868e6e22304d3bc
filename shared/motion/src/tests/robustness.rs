//! Sizes, repeats, refusals.

use super::*;

fn pair(width: usize, height: usize) -> (Picture, Picture) {
    let texture = Texture::natural(256, 35.0, 9);
    let disc = |u: i64| Disc { centre: (width as i64 / 2 + u, height as i64 / 3), side: 24 };
    (
        texture.with_disc((width, height), (0, 0), disc(0)),
        texture.with_disc((width, height), (4, -2), disc(8)),
    )
}

fn bits(fields: &Fields) -> Vec<u32> {
    fields.iter().flatten().map(|vote| vote.to_bits()).collect()
}

#[test]
fn every_size_up_to_four_to_one_is_voted_on_without_nan() {
    for (width, height) in [
        (64, 64),
        (64, 256),
        (256, 64),
        (65, 65),
        (127, 129),
        (333, 250),
        (1280, 1024),
        (640, 481),
        (4096, 1024),
    ] {
        let (older, newer) = pair(width, height);
        let (fields, summary) = vote(&older, &newer, &Parameters::default());
        assert!(used(&fields, &summary).all(f32::is_finite), "{width}x{height}");
        assert!(used(&fields, &summary).any(|vote| vote != 0.0), "{width}x{height}");
        assert_eq!(summary.columns.min(summary.rows), 16);
        if width.min(height) >= 256 {
            // Below, level 3 is too small for the estimate (design notes on vision, section 5).
            let off = (summary.shift.0 - 4).abs().max((summary.shift.1 + 2).abs());
            assert!(off <= 1, "{width}x{height}: {:?}", summary.shift);
        }
        let found = segment(&fields, &summary, &Parameters::default(), &mut SegmentScratch::new());
        if let Ok(target) = found.target {
            let numbers = [target.u, target.v, target.vu, target.vv, target.confidence, target.contrast];
            assert!(numbers.iter().all(|n| n.is_finite()), "{width}x{height}: {target:?}");
        }
    }
}

#[test]
fn extreme_images_give_finite_answers() {
    type Grey = fn(usize, usize) -> f64;
    let pictures: [(&str, Grey); 4] = [
        ("black", |_, _| 0.0),
        ("white", |_, _| 255.0),
        ("chequers", |x, y| if (x + y) % 2 == 0 { 255.0 } else { 0.0 }),
        ("stripes", |x, _| if x / 4 % 2 == 0 { 255.0 } else { 0.0 }),
    ];
    for (first, a) in pictures {
        for (second, b) in pictures {
            for parameters in [Parameters::default(), Parameters::literal()] {
                let (older, newer) = (Picture::new(130, 97, a), Picture::new(130, 97, b));
                let (fields, summary) = vote(&older, &newer, &parameters);
                assert!(used(&fields, &summary).all(f32::is_finite), "{first} then {second}");
                assert!(summary.background.0.is_finite() && summary.background.1.is_finite());
                let found = segment(&fields, &summary, &parameters, &mut SegmentScratch::new());
                assert!(found.background.0.is_finite() && found.background.1.is_finite());
            }
        }
    }
}

#[test]
fn a_repeated_frame_and_a_restarted_engine_give_the_same_bits() {
    let texture = Texture::natural(256, 35.0, 2);
    let frames: Vec<Picture> = (0..5i64)
        .map(|i| {
            let disc = Disc { centre: (90 + 7 * i, 100), side: 24 };
            texture.with_disc((256, 200), (3 * i, i), disc)
        })
        .collect();
    let parameters = Parameters::default();
    let mut engine = VoteEngine::new(256, 200, &parameters).unwrap();
    let mut fields = no_fields();
    engine.vote(Older::Missing, frames[0].image(), &mut fields, &mut NoProbe);
    for i in 1..frames.len() {
        let (older, newer) = (frames[i - 1].image(), frames[i].image());
        let summary = engine.vote(Older::LastNewer(older), newer, &mut fields, &mut NoProbe);
        let first = bits(&fields);
        assert!(summary.valid && summary.passes > 0);
        let again = engine.vote(Older::Frame(older), newer, &mut fields, &mut NoProbe);
        assert_eq!((bits(&fields), again), (first.clone(), summary), "frame {i} repeated");
        let (fresh, restarted) = vote(&frames[i - 1], &frames[i], &parameters);
        assert_eq!((bits(&fresh), restarted), (first, summary), "frame {i} after a restart");
    }
}

#[test]
fn a_fresh_engine_does_not_believe_that_it_holds_the_last_frame() {
    let (older, newer) = pair(200, 150);
    let (expected, summary) = vote(&older, &newer, &Parameters::default());
    let mut engine = VoteEngine::new(200, 150, &Parameters::default()).unwrap();
    let mut fields = no_fields();
    let last = Older::LastNewer(older.image());
    assert_eq!(engine.vote(last, newer.image(), &mut fields, &mut NoProbe), summary);
    assert_eq!(bits(&fields), bits(&expected));
}

#[test]
fn rows_with_gaps_are_read_as_rows_without() {
    let (older, newer) = pair(131, 90);
    let (expected, summary) = vote(&older, &newer, &Parameters::default());
    let gapped = |picture: &Picture| -> Vec<u8> {
        let rows = picture.pixels.chunks_exact(picture.width);
        rows.flat_map(|row| row.iter().copied().chain([7; 13])).collect()
    };
    let (old, new) = (gapped(&older), gapped(&newer));
    let image = |pixels| Image::new(pixels, 131, 90, 144).unwrap();
    let mut engine = VoteEngine::new(131, 90, &Parameters::default()).unwrap();
    let mut fields = no_fields();
    let frame = Older::Frame(image(&old));
    assert_eq!(engine.vote(frame, image(&new), &mut fields, &mut NoProbe), summary);
    assert_eq!(bits(&fields), bits(&expected));
}

#[test]
fn without_an_older_frame_nothing_is_voted() {
    let (older, newer) = pair(128, 128);
    let mut engine = VoteEngine::new(128, 128, &Parameters::default()).unwrap();
    let mut fields = no_fields();
    engine.vote(Older::Frame(older.image()), newer.image(), &mut fields, &mut NoProbe);
    let summary = engine.vote(Older::Missing, newer.image(), &mut fields, &mut NoProbe);
    assert!(!summary.valid);
    assert!(used(&fields, &summary).all(|vote| vote == 0.0));
    let found = segment(&fields, &summary, &Parameters::default(), &mut SegmentScratch::new());
    assert_eq!(found, Segmentation { target: Err(NoTarget::NoPair), background: (0.0, 0.0) });
}

#[test]
fn the_probe_hears_each_part_when_it_ends() {
    struct Heard(Vec<Part>);
    impl Probe for Heard {
        fn ended(&mut self, part: Part) {
            self.0.push(part);
        }
    }
    let (older, newer) = pair(256, 256);
    let mut engine = VoteEngine::new(256, 256, &Parameters::default()).unwrap();
    let mut heard = Heard(Vec::new());
    let older = Older::Frame(older.image());
    let summary = engine.vote(older, newer.image(), &mut no_fields(), &mut heard);
    let mut expected = vec![Part::Pyramid, Part::Votes];
    for _ in 0..summary.passes {
        expected.extend([Part::Compensation, Part::Votes]);
    }
    assert_eq!(heard.0, expected);
}

#[test]
fn literal_parameters_compensate_exactly_once() {
    let texture = Texture::natural(256, 35.0, 4);
    let (older, newer) = (texture.moved(256, 256, (0, 0)), texture.moved(256, 256, (9, 0)));
    let (_, summary) = vote(&older, &newer, &Parameters::literal());
    assert_eq!(summary.passes, 1);
    let (_, summary) = vote(&older, &newer, &Parameters::default());
    assert_eq!(summary.shift, (9, 0));
    assert!(summary.passes > 1);
}

#[test]
fn images_that_lie_about_their_shape_are_refused() {
    let pixels = vec![0; 100 * 100];
    let refused = |width, height, stride| Image::new(&pixels, width, height, stride).unwrap_err();
    assert_eq!(refused(63, 100, 100), ImageError::Size { width: 63, height: 100 });
    assert_eq!(refused(100, 4097, 100), ImageError::Size { width: 100, height: 4097 });
    assert_eq!(refused(100, 90, 99), ImageError::Stride { stride: 99, width: 100 });
    assert_eq!(refused(100, 100, 101), ImageError::TooShort { bytes: 10_000, needed: 10_099 });
    assert_eq!(refused(100, 100, usize::MAX), ImageError::Stride { stride: usize::MAX, width: 100 });
    assert!(Image::new(&pixels[..9_990], 90, 100, 100).is_ok(), "the last row may end early");
}

#[test]
fn shapes_and_parameters_out_of_range_are_refused() {
    let refused = |width, height, parameters: &Parameters| {
        VoteEngine::new(width, height, parameters).err().map_or_else(String::new, |error| error.to_string())
    };
    let ok = Parameters::default();
    assert!(refused(32, 64, &ok).contains("64 to 4096"));
    assert!(refused(64, 64, &Parameters { floor: f64::NAN, ..ok }).starts_with("floor is NaN"));
    assert!(refused(64, 64, &Parameters { passes: 11, ..ok }).starts_with("passes is 11"));
    assert!(refused(64, 64, &Parameters { min_blob_cells: 0, ..ok }).starts_with("min_blob_cells"));
    assert!(refused(64, 64, &Parameters { max_blob_cells: 0, ..ok }).starts_with("max_blob_cells"));
    assert!(refused(64, 64, &Parameters { sum_threshold: 1.0, ..ok }).starts_with("sum_threshold"));
}

#[test]
fn frames_longer_than_four_to_one_have_fewer_cells_along_the_shorter_side() {
    for (width, height) in [(64, 261), (261, 64), (64, 4096), (4096, 64), (100, 1700)] {
        for parameters in [Parameters::default(), Parameters::literal()] {
            let (older, newer) = pair(width, height);
            let (fields, summary) = vote(&older, &newer, &parameters);
            let size = format!("{width}x{height}: {} x {} cells", summary.columns, summary.rows);
            assert!(summary.valid, "{size}");
            assert!(summary.columns * summary.rows <= MAX_CELLS, "{size}");
            assert!((1..CELLS_ALONG_SHORTER_SIDE).contains(&summary.columns.min(summary.rows)), "{size}");
            // The cells cover the frame, up to a part of one at the longer side's end.
            let covered = [summary.columns, summary.rows].map(|n| n as f64 * f64::from(summary.cell_px));
            for (covered, side) in covered.into_iter().zip([width as f64, height as f64]) {
                assert!(covered < side + 0.1 && covered > side - f64::from(summary.cell_px), "{size}");
            }
            assert!(used(&fields, &summary).all(f32::is_finite), "{size}");
            assert!(used(&fields, &summary).any(|vote| vote != 0.0), "{size}");
            if let Ok(target) = segment(&fields, &summary, &parameters, &mut SegmentScratch::new()).target {
                let (u, v) = (target.u, target.v);
                let margin = 2.0 * f64::from(summary.cell_px);
                assert!((-margin..width as f64 + margin).contains(&u), "{size}: {u}");
                assert!((-margin..height as f64 + margin).contains(&v), "{size}: {v}");
            }
        }
    }
}

#[test]
#[should_panic(expected = "was given to an engine")]
fn a_frame_of_another_shape_is_a_bug() {
    let (older, newer) = pair(128, 128);
    let mut engine = VoteEngine::new(129, 128, &Parameters::default()).unwrap();
    engine.vote(Older::Frame(older.image()), newer.image(), &mut no_fields(), &mut NoProbe);
}
