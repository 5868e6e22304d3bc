//! The vision step on one core at three sizes, paper and robust mode with their parts; and in the same run
//! a copy of the frame to compare with. The table at the end has for each part the time, how many copies of
//! the frame that is, and its cost per pixel against that at 512x512.

use std::hint::black_box;
use std::time::Instant;

use criterion::{BenchmarkId, Criterion, criterion_group};
use pursuit_motion::{
    BlobParameters, BlobScratch, FIELDS, Fields, Image, MAX_CELLS, NoProbe, Older, Parameters, Part, Probe,
    RobustEngine, RobustParameters, SegmentScratch, Tracker, TrackerParameters, VoteEngine, detect_blob,
    segment,
};

const SIZES: [(usize, usize); 3] = [(256, 256), (512, 512), (1280, 1024)];

/// A pair of frames and what is needed to work on it.
struct Bench {
    width: usize,
    height: usize,
    old: Vec<u8>,
    new: Vec<u8>,
    disc: Vec<u8>,
}

/// A part's name, and what does it once.
type Named<'a> = (&'static str, Box<dyn FnMut() + 'a>);

/// What pans under the camera, px per frame, and how the target moves relative to it: not whole.
const PAN: (f64, f64) = (6.5, 3.0);
const RELATIVE: (f64, f64) = (4.0, -1.5);

impl Bench {
    fn new((width, height): (usize, usize)) -> Bench {
        let plane = Plane::new(width, height);
        let centre = (0.4 * width as f64, 0.55 * height as f64);
        let moved = (centre.0 + PAN.0 + RELATIVE.0, centre.1 + PAN.1 + RELATIVE.1);
        Bench {
            width,
            height,
            old: plane.frame((width, height), (0.0, 0.0), centre, 1),
            new: plane.frame((width, height), PAN, moved, 2),
            disc: white_disc(width, height),
        }
    }

    fn image<'a>(&self, pixels: &'a [u8]) -> Image<'a> {
        Image::new(pixels, self.width, self.height, self.width).expect("the bench's shape is valid")
    }

    fn older(&self) -> Image<'_> {
        self.image(&self.old)
    }

    fn newer(&self) -> Image<'_> {
        self.image(&self.new)
    }

    fn paper(&self, parameters: &Parameters) -> VoteEngine {
        VoteEngine::new(self.width, self.height, parameters).expect("the bench's shape is valid")
    }

    fn robust(&self) -> RobustEngine {
        RobustEngine::new(self.width, self.height, &RobustParameters::default())
            .expect("the bench's shape is valid")
    }

    /// Every part that can be done alone.
    fn parts(&self) -> Vec<Named<'_>> {
        let mut parts: Vec<Named<'_>> = Vec::new();
        let mut copy = vec![0u8; self.new.len()];
        parts.push((COPY, Box::new(move || black_box(&mut copy).copy_from_slice(black_box(&self.new)))));

        let mut engine = self.paper(&Parameters::default());
        let mut fields = no_fields();
        parts.push((
            "pyramid",
            Box::new(move || {
                engine.vote(Older::Missing, black_box(self.newer()), &mut fields, &mut NoProbe);
            }),
        ));

        // No compensation, and the older pyramid made afresh.
        let mut engine = self.paper(&Parameters { passes: 0, ..Parameters::default() });
        let mut fields = no_fields();
        parts.push((
            "two pyramids, one vote pass",
            Box::new(move || {
                let older = Older::Frame(black_box(self.older()));
                engine.vote(older, black_box(self.newer()), &mut fields, &mut NoProbe);
            }),
        ));

        // Steady state: the last frame's pyramid is used again. Literally, one pass of compensation; by
        // default up to three.
        for (name, parameters) in
            [("paper, literal", Parameters::literal()), ("paper, default", Parameters::default())]
        {
            let mut engine = self.paper(&parameters);
            let mut fields = no_fields();
            engine.vote(Older::Missing, self.older(), &mut fields, &mut NoProbe);
            let mut turn = self.turns();
            parts.push((
                name,
                Box::new(move || {
                    let (older, newer) = turn();
                    engine.vote(Older::LastNewer(older), black_box(newer), &mut fields, &mut NoProbe);
                }),
            ));
        }

        let mut fields = no_fields();
        let parameters = Parameters::default();
        let mut engine = self.paper(&parameters);
        let summary = engine.vote(Older::Frame(self.older()), self.newer(), &mut fields, &mut NoProbe);
        let mut scratch = SegmentScratch::new();
        assert!(segment(&fields, &summary, &parameters, &mut scratch).target.is_ok(), "there is a target");
        parts.push((
            "segmentation",
            Box::new(move || {
                black_box(segment(black_box(&fields), &summary, &parameters, &mut scratch));
            }),
        ));

        let mut scratch = BlobScratch::new(self.width, self.height);
        parts.push((
            "bright blob",
            Box::new(move || {
                let disc = self.image(&self.disc);
                black_box(detect_blob(black_box(&disc), &BlobParameters::default(), &mut scratch));
            }),
        ));

        let mut engine = self.robust();
        let found = engine.detect(Older::Frame(self.older()), self.newer(), &mut NoProbe);
        assert!(found.target(0.5).is_some(), "there is a target");
        engine.detect(Older::Missing, self.older(), &mut NoProbe);
        let mut turn = self.turns();
        parts.push((
            "robust",
            Box::new(move || {
                let (older, newer) = turn();
                black_box(engine.detect(Older::LastNewer(older), black_box(newer), &mut NoProbe));
            }),
        ));

        let mut engine = self.robust();
        let mut tracker = Tracker::new(&TrackerParameters::default());
        engine.detect(Older::Missing, self.older(), &mut NoProbe);
        let mut turn = self.turns();
        parts.push((
            "robust + tracker",
            Box::new(move || {
                let (older, newer) = turn();
                let found = engine.detect(Older::LastNewer(older), black_box(newer), &mut NoProbe);
                tracker.step(&found, 1);
                black_box(tracker.target());
            }),
        ));
        parts
    }

    /// There and back again: each call gives the next pair.
    fn turns<'a>(&'a self) -> impl FnMut() -> (Image<'a>, Image<'a>) {
        let mut back = true;
        move || {
            back = !back;
            if back { (self.newer(), self.older()) } else { (self.older(), self.newer()) }
        }
    }
}

const COPY: &str = "copy of the frame";

/// Discs of random grey on each other, at twice the frames' resolution.
struct Plane {
    width: usize,
    grey: Vec<u8>,
}

/// Room around the frame, px of it.
const AROUND: usize = 64;

impl Plane {
    fn new(width: usize, height: usize) -> Plane {
        let mut random = random(12345);
        let (width, height) = (2 * (width + 2 * AROUND), 2 * (height + 2 * AROUND));
        let mut grey = vec![128u8; width * height];
        // As dense at each size.
        for _ in 0..width * height / 270 {
            let mut next = |n: usize| random() as i64 % n as i64;
            let (x, y, radius, value) = (next(width), next(height), 6 + next(18), 20 + next(216));
            for py in (y - radius).max(0)..(y + radius).min(height as i64) {
                for px in (x - radius).max(0)..(x + radius).min(width as i64) {
                    if (px - x).pow(2) + (py - y).pow(2) < radius * radius {
                        grey[py as usize * width + px as usize] = value as u8;
                    }
                }
            }
        }
        Plane { width, grey }
    }

    /// The plane moved by `pan` with a square cut from another place of it at `target`, 2 x 2 averaged, with
    /// the noise of a sensor.
    fn frame(
        &self,
        (width, height): (usize, usize),
        pan: (f64, f64),
        target: (f64, f64),
        seed: u64,
    ) -> Vec<u8> {
        let mut noise = random(seed);
        let double = |v: f64| (2.0 * v).round() as i64;
        let (u, v) = (double(pan.0), double(pan.1));
        let half = (width.min(height) / 16) as f64;
        let (left, top) = (double(target.0 - half), double(target.1 - half));
        let at = |x: i64, y: i64| {
            let inside = |from: i64, x: i64| (0..double(2.0 * half)).contains(&(x - from));
            let (x, y) = if inside(left, x) && inside(top, y) {
                (x - left + 32, y - top + 48)
            } else {
                (x - u + 2 * AROUND as i64, y - v + 2 * AROUND as i64)
            };
            u32::from(self.grey[y as usize * self.width + x as usize])
        };
        (0..width * height)
            .map(|i| {
                let (x, y) = (2 * (i % width) as i64, 2 * (i / width) as i64);
                let sum = at(x, y) + at(x + 1, y) + at(x, y + 1) + at(x + 1, y + 1);
                let noise = (noise() % 7) as i32 - 3;
                (sum as i32 / 4 + noise).clamp(0, 255) as u8
            })
            .collect()
    }
}

/// Whole numbers of 31 bits.
fn random(seed: u64) -> impl FnMut() -> u64 {
    let mut state = seed;
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        state >> 33
    }
}

fn white_disc(width: usize, height: usize) -> Vec<u8> {
    let (u, v, radius) = (width as i64 * 3 / 5, height as i64 * 2 / 5, width as i64 / 21);
    let inside = |x: usize, y: usize| (x as i64 - u).pow(2) + (y as i64 - v).pow(2) < radius * radius;
    (0..width * height).map(|i| if inside(i % width, i / width) { 230 } else { 25 }).collect()
}

fn no_fields() -> Box<Fields> {
    vec![[0.0; MAX_CELLS]; FIELDS].try_into().expect("as many as fields")
}

fn vision_step(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("vision_step");
    for size in SIZES {
        let bench = Bench::new(size);
        for (name, mut part) in bench.parts() {
            let id = BenchmarkId::new(name, format!("{}x{}", size.0, size.1));
            group.bench_function(id, |b| b.iter(&mut part));
        }
    }
    group.finish();
}

/// Times the parts of a step.
struct Clock {
    last: Instant,
    /// Pyramid, compensation, votes, competition, ms.
    parts: [f64; 4],
}

const ROBUST_PARTS: [(Part, &str); 4] = [
    (Part::Pyramid, "  its pyramid"),
    (Part::Compensation, "  its compensation"),
    (Part::Votes, "  its votes"),
    (Part::Competition, "  its competition"),
];

impl Probe for Clock {
    fn ended(&mut self, part: Part) {
        let place = ROBUST_PARTS.iter().position(|(known, _)| *known == part).expect("all parts are listed");
        self.parts[place] += self.last.elapsed().as_secs_f64() * 1e3;
        self.last = Instant::now();
    }
}

fn median(mut samples: Vec<f64>) -> f64 {
    samples.sort_by(f64::total_cmp);
    samples[samples.len() / 2]
}

/// Median time of one call, ms, from samples of about 2 ms each.
fn time(part: &mut dyn FnMut()) -> f64 {
    let calls = |part: &mut dyn FnMut(), n: usize| {
        let start = Instant::now();
        (0..n).for_each(|_| part());
        start.elapsed().as_secs_f64() * 1e3
    };
    calls(part, 10);
    let n = (2.0 / (calls(part, 10) / 10.0)).ceil().clamp(1.0, 1e5) as usize;
    median((0..41).map(|_| calls(part, n) / n as f64).collect())
}

/// Median time of each part of robust mode, ms.
fn time_robust_parts(bench: &Bench) -> [f64; 4] {
    let mut engine = bench.robust();
    engine.detect(Older::Missing, bench.older(), &mut NoProbe);
    let mut turn = bench.turns();
    let steps: Vec<[f64; 4]> = (0..80)
        .map(|_| {
            let (older, newer) = turn();
            let mut clock = Clock { last: Instant::now(), parts: [0.0; 4] };
            engine.detect(Older::LastNewer(older), newer, &mut clock);
            clock.parts
        })
        .collect();
    std::array::from_fn(|i| median(steps[10..].iter().map(|step| step[i]).collect()))
}

fn print_table() {
    let columns: Vec<Vec<(&str, f64)>> = SIZES
        .iter()
        .map(|&size| {
            let bench = Bench::new(size);
            let mut rows: Vec<(&str, f64)> =
                bench.parts().into_iter().map(|(name, mut part)| (name, time(&mut part))).collect();
            let at = rows.iter().position(|(name, _)| *name == "robust").map_or(rows.len(), |i| i + 1);
            let parts = time_robust_parts(&bench);
            rows.splice(at..at, ROBUST_PARTS.iter().zip(parts).map(|((_, name), ms)| (*name, ms)));
            rows
        })
        .collect();
    println!("\nOne core: ms, copies of the frame, cost per pixel against 512x512.");
    print!("{:28}", "");
    SIZES.iter().for_each(|(width, height)| print!("{:>28}", format!("{width}x{height}")));
    println!();
    let pixels = |i: usize| (SIZES[i].0 * SIZES[i].1) as f64;
    for (row, (name, _)) in columns[0].iter().enumerate() {
        print!("{name:28}");
        let per_pixel = columns[1][row].1 / pixels(1);
        for (i, column) in columns.iter().enumerate() {
            let ms = column[row].1;
            print!("{ms:11.4}{:10.1}{:7.2}", ms / column[0].1, ms / pixels(i) / per_pixel);
        }
        println!();
    }
}

criterion_group!(benches, vision_step);

fn main() {
    benches();
    Criterion::default().configure_from_args().final_summary();
    // As cargo calls it for `cargo bench`, not to list or to test the benches.
    let has = |flag: &str| std::env::args().any(|argument| argument == flag);
    if has("--bench") && !has("--list") && !has("--test") {
        print_table();
    }
}
