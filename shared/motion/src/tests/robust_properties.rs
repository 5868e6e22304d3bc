//! Whatever the frames: no panic, finite numbers, answers inside of the frame; and numbers that do not
//! depend on where or how a row is stored.

use proptest::prelude::*;

use super::waves::{Shot, Waves, fault, find, find_in};
use super::*;

/// Content of a pair: each of them has brought some detector down.
#[derive(Clone, Copy, Debug)]
enum Content {
    /// Both frames random, nothing in common.
    Noise,
    /// A target in front of a moving background.
    Scene,
    /// Black with some white pixels, different in both.
    Stars,
    /// Two-valued blocks.
    Blocks,
}

fn draw(content: Content, (width, height): (usize, usize), seed: u64) -> [Picture; 2] {
    let mut random = Random(seed);
    match content {
        Content::Noise => [0, 1].map(|_| Picture::new(width, height, |_, _| 255.0 * random.uniform())),
        Content::Stars => [0, 1]
            .map(|_| Picture::new(width, height, |_, _| if random.uniform() < 0.001 { 255.0 } else { 0.0 })),
        Content::Blocks => {
            let side = 1 + (random.next() % 40) as usize;
            let (u, v) = ((random.next() % 30) as usize, (random.next() % 30) as usize);
            [(0, 0), (u, v)].map(|(u, v)| {
                let on = |x: usize, y: usize| Random(((x / side) * 7919 + y / side) as u64).next() % 2;
                Picture::new(width, height, |x, y| 255.0 * on(x + u, y + v) as f64)
            })
        }
        Content::Scene => {
            let waves = Waves::new(10.0 + 40.0 * random.uniform(), seed);
            let place = |random: &mut Random, side: usize| side as f64 * random.uniform();
            let (u, v) = (place(&mut random, width), place(&mut random, height));
            let speed = |random: &mut Random| 24.0 * (random.uniform() - 0.5);
            let (pan, own) =
                ((speed(&mut random), speed(&mut random)), (speed(&mut random), speed(&mut random)));
            let still = Shot::still(width, height);
            let radius = 4.0 + 40.0 * random.uniform();
            [
                still.with_spot(u - own.0, v - own.1, radius).taken(&waves),
                still.panned(pan.0, pan.1).with_spot(u, v, radius).taken(&waves),
            ]
        }
    }
}

fn content() -> impl Strategy<Value = Content> {
    prop_oneof![
        Just(Content::Noise),
        Just(Content::Stars),
        Just(Content::Blocks),
        Just(Content::Scene),
        Just(Content::Scene),
    ]
}

/// The rows `stride` apart, with random bytes between.
fn padded(picture: &Picture, stride: usize, seed: u64) -> Vec<u8> {
    let mut random = Random(seed);
    let rows = picture.pixels.chunks_exact(picture.width);
    rows.flat_map(|row| {
        let filling: Vec<u8> = (picture.width..stride).map(|_| random.next() as u8).collect();
        row.iter().copied().chain(filling)
    })
    .collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    #[test]
    fn any_pair_of_any_size_is_answered_soundly(
        width in 64..=400usize,
        height in 64..=400usize,
        content in content(),
        seed in any::<u64>(),
    ) {
        let [older, newer] = draw(content, (width, height), seed);
        prop_assert_eq!(fault(&find(&older, &newer), (width, height)), None);
    }

    #[test]
    fn bytes_between_the_rows_do_not_matter(
        width in 64..=200usize,
        height in 64..=200usize,
        more in 0..70usize,
        seed in any::<u64>(),
    ) {
        let [older, newer] = draw(Content::Scene, (width, height), seed);
        let stride = width + more;
        let (a, b) = (padded(&older, stride, seed ^ 1), padded(&newer, stride, seed ^ 2));
        let image = |bytes| Image::new(bytes, width, height, stride).unwrap();
        let found = find_in(image(&a), image(&b));
        prop_assert!(found == find(&older, &newer), "{width}x{height}, rows {stride} apart");
    }
}

#[test]
fn the_longest_and_the_smallest_frames_are_answered_soundly() {
    let sizes = [(64, 4096), (4096, 64), (64, 64), (65, 64), (64, 65), (4095, 67), (71, 1000)];
    for (seed, size) in sizes.into_iter().enumerate() {
        for content in [Content::Scene, Content::Noise] {
            let [older, newer] = draw(content, size, seed as u64);
            assert_eq!(fault(&find(&older, &newer), size), None, "{content:?} {size:?}");
        }
    }
}

#[test]
fn a_size_or_a_frame_that_does_not_fit_is_refused() {
    let error = |width, height| RobustEngine::new(width, height, &RobustParameters::default()).err();
    assert_eq!(error(63, 64), Some(EngineError::Size { width: 63, height: 64 }));
    assert_eq!(error(64, 4097), Some(EngineError::Size { width: 64, height: 4097 }));
}

#[test]
#[should_panic(expected = "was given to an engine")]
fn a_frame_of_another_shape_is_a_bug_in_robust_mode_too() {
    let frame = Picture::new(128, 128, |_, _| 0.0);
    let mut engine = RobustEngine::new(129, 128, &RobustParameters::default()).unwrap();
    engine.detect(Older::Missing, frame.image(), &mut NoProbe);
}
