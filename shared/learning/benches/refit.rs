//! One refit of a full ring by every method, and by argmin's conjugate gradients, on one core in one run: ms,
//! the share of our conjugate gradients' time, evaluations, the error that is left. Then, in alternation, the turns
//! of a loop beside a thread that refits and beside one that does not.

#![allow(clippy::unwrap_used)]

#[path = "../tests/support/mod.rs"]
mod support;

use std::hint::black_box;
use std::time::Instant;

use argmin::core::{CostFunction, Error, Executor, Gradient};
use argmin::solver::conjugategradient::NonlinearConjugateGradient;
use argmin::solver::conjugategradient::beta::PolakRibierePlus;
use argmin::solver::linesearch::MoreThuenteLineSearch;
use criterion::{Criterion, criterion_group};
use pursuit_learning::objective::mean_error_and_gradient;
use pursuit_learning::{Batch, Method, RefitJob, Settings, WEIGHTS, refit};
use support::job_after;

/// Moves after which the ring is full.
const MOVES: u32 = 12;
/// Rings that the table is made of.
const RINGS: u64 = 9;
/// Times that each refit is repeated; the fastest counts, which others on the machine delay least.
const REPEATS: u32 = 15;

struct Problem(Batch, std::cell::Cell<u32>);

impl Problem {
    fn evaluate(&self, weights: &[f64]) -> (f64, [f64; WEIGHTS]) {
        self.1.set(self.1.get() + 1);
        let mut gradient = [0.0; WEIGHTS];
        let value = self.0.error_and_gradient(weights.try_into().unwrap(), &mut gradient);
        (value, gradient)
    }
}

impl CostFunction for &Problem {
    type Param = Vec<f64>;
    type Output = f64;

    fn cost(&self, weights: &Vec<f64>) -> Result<f64, Error> {
        Ok(self.evaluate(weights).0)
    }
}

impl Gradient for &Problem {
    type Param = Vec<f64>;
    type Gradient = Vec<f64>;

    fn gradient(&self, weights: &Vec<f64>) -> Result<Vec<f64>, Error> {
        Ok(self.evaluate(weights).1.to_vec())
    }
}

/// Evaluations and the error left.
type Outcome = (u32, f64);

fn ours(job: &RefitJob) -> Outcome {
    let result = refit(black_box(job), || true);
    (result.evaluations, result.error[1])
}

fn argmins(job: &RefitJob) -> Outcome {
    let problem = Problem(Batch::new(&job.samples, job.huber, job.network.anchored()), Default::default());
    let line_search = MoreThuenteLineSearch::new().with_c(1e-4, 0.1).unwrap();
    let solver = NonlinearConjugateGradient::new(line_search, PolakRibierePlus::new())
        .restart_iters(WEIGHTS as u64)
        .restart_orthogonality(0.2);
    let start = job.network.weights().to_vec();
    let iterations = u64::from(job.iterations);
    let run = Executor::new(&problem, solver)
        .configure(|state| state.param(start).max_iters(iterations))
        .run()
        .unwrap();
    (problem.1.get(), run.state().get_best_cost())
}

/// A name, a method, its iterations, and who does it.
type Contestant = (&'static str, Method, u32, fn(&RefitJob) -> Outcome);

fn contestants() -> Vec<Contestant> {
    vec![
        ("conjugate gradients, 60", Method::ConjugateGradient, 60, ours),
        ("conjugate gradients, 250", Method::ConjugateGradient, 250, ours),
        ("scaled, 60", Method::ScaledConjugateGradient, 60, ours),
        ("scaled, 250", Method::ScaledConjugateGradient, 250, ours),
        ("Levenberg-Marquardt, 8", Method::LevenbergMarquardt, 8, ours),
        ("argmin's, 60", Method::ConjugateGradient, 60, argmins),
    ]
}

fn bench(criterion: &mut Criterion) {
    let ring = job_after(MOVES, 1, &Settings::recommended());
    for (name, method, iterations, run) in contestants() {
        let job = RefitJob { method, iterations, ..ring.clone() };
        criterion.bench_function(name, |b| b.iter(|| run(&job)));
    }
    let batch = Batch::new(&ring.samples, ring.huber, true);
    let (weights, mut gradient) = (ring.network.weights(), [0.0; WEIGHTS]);
    criterion.bench_function("error and gradient, together", |b| {
        b.iter(|| batch.error_and_gradient(black_box(&weights), &mut gradient))
    });
    criterion.bench_function("error and gradient, one by one", |b| {
        b.iter(|| mean_error_and_gradient(black_box(&ring.network), &ring.samples, ring.huber, &mut gradient))
    });
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

fn print_table() {
    let rings: Vec<RefitJob> =
        (1..=RINGS).map(|seed| job_after(MOVES, seed, &Settings::recommended())).collect();
    println!("\nA refit of {} samples: medians over {RINGS} rings.", rings[0].samples.len());
    println!("{:28}{:>9}{:>9}{:>14}{:>14}", "", "ms", "share", "evaluations", "error left");
    let mut reference = None;
    for (name, method, iterations, run) in contestants() {
        let jobs = rings.iter().map(|ring| RefitJob { method, iterations, ..ring.clone() });
        let (mut times, mut counts, mut errors) = (Vec::new(), Vec::new(), Vec::new());
        for job in jobs {
            let fastest = (0..REPEATS).map(|_| {
                let start = Instant::now();
                black_box(run(&job));
                start.elapsed().as_secs_f64() * 1e3
            });
            times.push(fastest.fold(f64::INFINITY, f64::min));
            let (evaluations, error) = run(&job);
            counts.push(f64::from(evaluations));
            errors.push(error);
        }
        let time = median(times);
        let share = time / *reference.get_or_insert(time);
        println!("{name:28}{time:9.3}{share:9.2}{:14.0}{:14.2e}", median(counts), median(errors));
    }
}

/// A refit for each frame at 100 Hz: more than ever are due.
const PERIOD: std::time::Duration = std::time::Duration::from_millis(10);
/// The thread computes so long in one go, and then rests so long, as the learner's.
const SPELL: std::time::Duration = std::time::Duration::from_micros(40);
const PAUSE: std::time::Duration = std::time::Duration::from_micros(50);
/// Turns of a loop at 1 kHz in each block, and blocks of each kind.
const TURNS: u32 = 250;
const BLOCKS: u32 = 8;

/// How long a turn of a loop takes, from when it is due to when its network has been asked and has learnt, while a
/// thread of its own refits a hundred times a second, and while it does not: block by block in one run, µs.
fn print_side_by_side() {
    let job = job_after(MOVES, 1, &Settings::recommended());
    let (starts, blocks) = std::sync::mpsc::sync_channel::<bool>(0);
    let (ends, done) = std::sync::mpsc::sync_channel::<()>(0);
    let busy = std::sync::Arc::new(std::sync::atomic::AtomicBool::new(false));
    let (told, thread_job) = (std::sync::Arc::clone(&busy), job.clone());
    let thread = std::thread::spawn(move || {
        let mut spent = Vec::new();
        // As the learner's does on the wall clock.
        use thread_priority::*;
        let batch = ThreadSchedulePolicy::Normal(NormalThreadSchedulePolicy::Batch);
        set_thread_priority_and_policy(thread_native_id(), ThreadPriority::Min, batch).unwrap();
        while let Ok(true) = blocks.recv() {
            while told.load(std::sync::atomic::Ordering::Relaxed) {
                let begin = Instant::now();
                let spell = std::cell::Cell::new(begin);
                black_box(refit(&thread_job, || {
                    if spell.get().elapsed() >= SPELL {
                        std::thread::sleep(PAUSE);
                        spell.set(Instant::now());
                    }
                    told.load(std::sync::atomic::Ordering::Relaxed)
                }));
                spent.push(begin.elapsed().as_secs_f64() * 1e3);
                std::thread::sleep(PERIOD.saturating_sub(begin.elapsed()));
            }
            ends.send(()).unwrap();
        }
        spent
    });
    let sample = &job.samples[..1];
    let mut gradient = [0.0; WEIGHTS];
    let mut times = [Vec::new(), Vec::new()];
    for block in 0..2 * BLOCKS {
        let refits = block % 2 == 1;
        if refits {
            busy.store(true, std::sync::atomic::Ordering::Relaxed);
            starts.send(true).unwrap();
        }
        let begin = Instant::now();
        for turn in 1..=TURNS {
            let due = begin + std::time::Duration::from_millis(u64::from(turn));
            std::thread::sleep(due.saturating_duration_since(Instant::now()));
            black_box(job.network.predict(black_box(sample[0].input)));
            black_box(mean_error_and_gradient(&job.network, sample, job.huber, &mut gradient));
            times[usize::from(refits)].push(due.elapsed().as_secs_f64() * 1e6);
        }
        if refits {
            busy.store(false, std::sync::atomic::Ordering::Relaxed);
            done.recv().unwrap();
        }
    }
    drop(starts);
    let mut spent = thread.join().unwrap();
    spent.sort_by(f64::total_cmp);
    println!(
        "\nA refit of {} iterations beside the loop: median {:.2} ms",
        job.iterations,
        spent[spent.len() / 2]
    );
    println!(
        "\nA turn of a loop at 1 kHz, from due to done, {} turns each, in alternation, us:",
        times[0].len()
    );
    println!("{:28}{:>9}{:>9}{:>9}", "", "p50", "p99", "max");
    for (name, mut times) in ["no refit", "a hundred refits a second"].into_iter().zip(times) {
        times.sort_by(f64::total_cmp);
        let at = |share: f64| times[((times.len() - 1) as f64 * share) as usize];
        println!("{name:28}{:9.1}{:9.1}{:9.1}", at(0.5), at(0.99), at(1.0));
    }
}

criterion_group!(benches, bench);

fn main() {
    benches();
    Criterion::default().configure_from_args().final_summary();
    // As cargo calls it for `cargo bench`, not to list or to test the benches.
    let has = |flag: &str| std::env::args().any(|argument| argument == flag);
    if has("--bench") && !has("--list") && !has("--test") {
        print_table();
        print_side_by_side();
    }
}
