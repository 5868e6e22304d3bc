//! Cost of a frame beside the cost of copying it.
#![allow(missing_docs)]

use criterion::{Criterion, criterion_group, criterion_main};
use pursuit_scene::{Kind, Scene, SceneParameters, View};
use std::hint::black_box;

fn frame(criterion: &mut Criterion) {
    let parameters = SceneParameters::default();
    let mut scene = Scene::new(&parameters);
    let mut pixels = vec![0u8; parameters.width * parameters.height];
    for (name, kind) in [("vehicle", Kind::Vehicle), ("blob", Kind::Blob)] {
        let mut view = View::looking_down([0.6, 0.05, 0.5], 0.3, kind);
        view.target_heading = 0.7;
        criterion.bench_function(&format!("{name} frame 512x512"), |bencher| {
            bencher.iter(|| {
                view.frame += 1;
                scene.render(black_box(&view), &mut pixels, 512)
            });
        });
    }
    let mut copy = vec![0u8; pixels.len()];
    criterion.bench_function("memcpy 512x512", |bencher| {
        bencher.iter(|| copy.copy_from_slice(black_box(&pixels)));
    });
}

fn start_up(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("start-up");
    group.sample_size(10);
    group.bench_function("Scene::new", |bencher| bencher.iter(|| Scene::new(&SceneParameters::default())));
    group.finish();
}

criterion_group!(benches, frame, start_up);
criterion_main!(benches);
