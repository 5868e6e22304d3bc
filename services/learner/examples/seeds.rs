//! Training over many seeds without any bus: `cargo run --release -p pursuit-learner --example seeds [SEEDS]`.
//! One line per scheme: median/p90.

#[path = "../tests/support/mod.rs"]
mod support;

use pursuit_learner::config::{Parameters, Profile};
use pursuit_learner::step::Learner;
use pursuit_learning::{Method, refit};
use pursuit_messages::Phase;
use support::{Cell, Conditions, Run, quantile, train};

/// Defaults were chosen looking at seeds 1000 to 1099.
const FIRST_SEED: u64 = 2000;
/// The rendered cell's blob detection: standard deviation of 0.013 px on every axis, at rest and moving.
const RENDERED_NOISE_PX: f64 = 0.013;

fn main() {
    let seeds = std::env::args().nth(1).and_then(|count| count.parse().ok()).unwrap_or(50);
    let recommended = Parameters::of(Profile::Recommended);
    let paper = Parameters::of(Profile::Paper);
    let any = Conditions::default();
    let exact = Conditions { noise_px: RENDERED_NOISE_PX, ..any };
    let at_first = |parameters| Parameters { moves_per_target: 12, training_moves: 12, ..parameters };
    let schemes = [
        ("recommended", recommended, any),
        ("recommended, first target", at_first(recommended), any),
        ("recommended, as rendered", recommended, exact),
        ("scaled conjugate gradients", with_method(recommended, Method::ScaledConjugateGradient), any),
        ("Levenberg-Marquardt", with_method(recommended, Method::LevenbergMarquardt), any),
        ("paper", paper, any),
        ("paper, first target", at_first(paper), any),
        ("paper, online only", with_iterations(paper, 0), any),
        ("recommended, online only", with_iterations(recommended, 0), any),
    ];
    for (name, parameters, conditions) in schemes {
        let runs: Vec<Run> =
            (0..seeds).map(|seed| train(&parameters, FIRST_SEED + seed, conditions).0).collect();
        report(name, &runs);
    }
    let turned: Vec<Run> = (0..seeds)
        .map(|seed| {
            let mount_rad = std::f64::consts::TAU * golden_share(seed);
            train(&recommended, FIRST_SEED + seed, Conditions { mount_rad, ..any }).0
        })
        .collect();
    report("recommended, any mount", &turned);
    report_refit_time();
}

/// Spread evenly over 0 to 1, for any number of seeds.
fn golden_share(seed: u64) -> f64 {
    (seed as f64 * 0.618_033_988_749_895).fract()
}

fn with_method(mut parameters: Parameters, method: Method) -> Parameters {
    parameters.learning.method = method;
    parameters
}

fn with_iterations(mut parameters: Parameters, iterations: u32) -> Parameters {
    parameters.learning.iterations = iterations;
    parameters
}

fn report(name: &str, runs: &[Run]) {
    let moves = |of: &dyn Fn(&Run) -> Option<usize>| {
        [0.5, 0.9]
            .map(|share| quantile(runs.iter().map(of), share).map_or("-".into(), |m| m.to_string()))
            .join("/")
    };
    let centimetres = |of: &dyn Fn(&Run) -> Option<f64>| {
        [0.5, 0.9]
            .map(|share| {
                quantile(runs.iter().map(of), share).map_or("-".into(), |m| format!("{:.2}", 100.0 * m))
            })
            .join("/")
    };
    println!(
        "{name:28} moves to 3 cm {:6} 1 cm {:6} 5 mm {:6} | after 5 moves {:9} cm, all {:9} cm, p90 {:9} cm | \
         first target 3 cm {:5} 1 cm {:5} 5 mm {:5} | targets {} frames {} rejected {}",
        moves(&|run| run.moves_to(0.03)),
        moves(&|run| run.moves_to(0.01)),
        moves(&|run| run.moves_to(0.005)),
        centimetres(&|run| run.grid.get(4).map(|grid| grid.median)),
        centimetres(&|run| run.grid.last().map(|grid| grid.median)),
        centimetres(&|run| run.grid.last().map(|grid| grid.p90)),
        moves(&|run| run.moves_on_first_target(0.03)),
        moves(&|run| run.moves_on_first_target(0.01)),
        moves(&|run| run.moves_on_first_target(0.005)),
        runs.iter().map(|run| run.targets).sum::<u32>() / runs.len() as u32,
        runs.iter().map(|run| run.frames).sum::<u64>() / runs.len() as u64,
        runs.iter().map(|run| run.rejected).sum::<u32>(),
    );
}

/// Computing time of one refit of a full ring, from the jobs of one run's later half.
fn report_refit_time() {
    let mut learner = Learner::new(&Parameters::default(), FIRST_SEED);
    let mut cell = Cell::new(FIRST_SEED, Conditions::default());
    let (mut times, mut evaluations) = (Vec::new(), Vec::new());
    while learner.phase() == Phase::Training {
        cell.turn(&mut learner);
        if let Some(job) = learner.refit_job() {
            let begin = computing_ms();
            let result = refit(&job, || true);
            if job.samples.len() >= 100 {
                times.push(Some(computing_ms() - begin));
                evaluations.push(Some(result.evaluations));
            }
            learner.merge(&result);
        }
    }
    let [fastest, median, p90] =
        [0.0, 0.5, 0.9].map(|share| quantile(times.iter().copied(), share).unwrap_or(f64::NAN));
    let evaluations = quantile(evaluations, 0.5).unwrap_or(0);
    println!(
        "refit of 100 samples: fastest {fastest:.1}, median {median:.1}, p90 {p90:.1} ms of computing, \
         {evaluations} evaluations (median)"
    );
}

/// Time that this thread has computed so far, ms: on a busy machine the clock says nothing.
fn computing_ms() -> f64 {
    let times = std::fs::read_to_string("/proc/thread-self/schedstat").expect("Linux counts a thread's time");
    let nanoseconds: f64 =
        times.split(' ').next().and_then(|ns| ns.parse().ok()).expect("schedstat begins with ns");
    nanoseconds * 1e-6
}
