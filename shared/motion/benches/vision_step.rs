//! The vision step at 512x512 on one core, and in the same run a copy of the frame to compare with.

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use pursuit_motion::{
    BlobParameters, BlobScratch, FIELDS, Fields, Image, MAX_CELLS, NoProbe, Older, Parameters,
    SegmentScratch, VoteEngine, detect_blob, segment,
};

const SIDE: usize = 512;

/// Discs of random grey on each other, moved by (`u`, `v`) px, with a camouflaged square of its own motion.
fn frame(u: i64, v: i64, target: i64) -> Vec<u8> {
    let mut random = 12345u64;
    let mut next = |n: i64| {
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((random >> 33) as i64) % n
    };
    let wide = SIDE + 128;
    let mut plane = vec![128u8; wide * wide];
    for _ in 0..6000 {
        let (x, y, radius, grey) = (next(wide as i64), next(wide as i64), 3 + next(9), 20 + next(216));
        for py in (y - radius).max(0)..(y + radius).min(wide as i64) {
            for px in (x - radius).max(0)..(x + radius).min(wide as i64) {
                if (px - x).pow(2) + (py - y).pow(2) < radius * radius {
                    plane[py as usize * wide + px as usize] = grey as u8;
                }
            }
        }
    }
    let mut pixels = vec![0; SIDE * SIDE];
    for (y, row) in pixels.chunks_exact_mut(SIDE).enumerate() {
        for (x, pixel) in row.iter_mut().enumerate() {
            let (tx, ty) = (x as i64 - 200 - target, y as i64 - 260);
            let on_target = (0..64).contains(&tx) && (0..64).contains(&ty);
            let (px, py) =
                if on_target { (tx + 64, ty + 64) } else { (x as i64 + 64 - u, y as i64 + 64 - v) };
            *pixel = plane[py as usize * wide + px as usize];
        }
    }
    pixels
}

fn white_disc() -> Vec<u8> {
    let inside = |x: usize, y: usize| (x as i64 - 300).pow(2) + (y as i64 - 200).pow(2) < 24 * 24;
    (0..SIDE * SIDE).map(|i| if inside(i % SIDE, i / SIDE) { 230 } else { 25 }).collect()
}

fn vision_step(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("vision_step");
    let name = |part: &str| BenchmarkId::new(part, format!("{SIDE}x{SIDE}"));
    let (old, new) = (frame(0, 0, 0), frame(6, 3, 10));
    let (older, newer) = (image(&old), image(&new));
    let parameters = Parameters::default();
    let mut fields: Box<Fields> = vec![[0.0; MAX_CELLS]; FIELDS].try_into().expect("as many as fields");
    let mut copy = vec![0u8; SIDE * SIDE];

    group.bench_function(name("copy_of_the_frame"), |b| {
        b.iter(|| copy.copy_from_slice(black_box(&new)));
    });

    let mut engine = engine(&parameters);
    group.bench_function(name("pyramid"), |b| {
        b.iter(|| engine.vote(Older::Missing, black_box(newer), &mut fields, &mut NoProbe));
    });

    // No compensation, and the older pyramid made afresh: two pyramids and one sweep.
    let mut still = self::engine(&Parameters { passes: 0, ..parameters });
    group.bench_function(name("two_pyramids_and_one_vote_pass"), |b| {
        b.iter(|| still.vote(Older::Frame(black_box(older)), black_box(newer), &mut fields, &mut NoProbe));
    });

    // Steady state, the paper's two passes: the last frame's pyramid is used again, one is made of the new
    // frame and one of the shifted one. With three passes of compensation, twice that at worst.
    for (part, parameters) in
        [("whole_step", Parameters::literal()), ("whole_step_up_to_3_passes", Parameters::default())]
    {
        let mut engine = self::engine(&parameters);
        engine.vote(Older::Missing, older, &mut fields, &mut NoProbe);
        let mut flip = false;
        group.bench_function(name(part), |b| {
            b.iter(|| {
                flip = !flip;
                let (older, newer) = if flip { (older, newer) } else { (newer, older) };
                engine.vote(Older::LastNewer(older), black_box(newer), &mut fields, &mut NoProbe)
            });
        });
    }

    let summary = engine.vote(Older::Frame(older), newer, &mut fields, &mut NoProbe);
    let mut scratch = SegmentScratch::new();
    assert!(segment(&fields, &summary, &parameters, &mut scratch).target.is_ok(), "the bench has a target");
    group.bench_function(name("segmentation"), |b| {
        b.iter(|| segment(black_box(&fields), &summary, &parameters, &mut scratch));
    });

    let disc = white_disc();
    let mut scratch = BlobScratch::new(SIDE, SIDE);
    group.bench_function(name("bright_blob"), |b| {
        b.iter(|| detect_blob(black_box(&image(&disc)), &BlobParameters::default(), &mut scratch));
    });
    group.finish();
}

fn image(pixels: &[u8]) -> Image<'_> {
    Image::new(pixels, SIDE, SIDE, SIDE).expect("the bench's shape is valid")
}

fn engine(parameters: &Parameters) -> VoteEngine {
    VoteEngine::new(SIDE, SIDE, parameters).expect("the bench's shape is valid")
}

criterion_group!(benches, vision_step);
criterion_main!(benches);
