//! The claim of the paper's section 3, on an exact arm without any bus: the camera teaches itself.

#![allow(clippy::unwrap_used)]

mod support;

use pursuit_learner::config::{Parameters, Profile};
use pursuit_learner::step::Learner;
use pursuit_messages::Phase;
use support::{Conditions, Run, finish_refit, quantile, train};

const SEEDS: u64 = 5;

fn runs(parameters: &Parameters) -> Vec<Run> {
    (0..SEEDS).map(|seed| train(parameters, seed, Conditions::default()).0).collect()
}

fn final_error(runs: &[Run]) -> f64 {
    quantile(runs.iter().map(|run| run.grid.last().map(|grid| grid.median)), 0.5).unwrap()
}

/// Median over seeds; the 90th percentiles are for the experiment, which has more of them.
#[test]
fn one_move_lands_within_3_cm_after_3_moves_and_within_1_cm_after_9() {
    let runs = runs(&Parameters::of(Profile::Recommended));
    let to_3_cm = quantile(runs.iter().map(|run| run.moves_to(0.03)), 0.5);
    let to_1_cm = quantile(runs.iter().map(|run| run.moves_to(0.01)), 0.5);
    assert!(to_3_cm.is_some_and(|moves| moves <= 3), "{to_3_cm:?}");
    assert!(to_1_cm.is_some_and(|moves| moves <= 9), "{to_1_cm:?}");
    assert!(final_error(&runs) < 0.0045, "{}", final_error(&runs));
}

/// From nothing, the two fixed moves counted.
#[test]
fn the_first_target_is_within_3_cm_and_1_cm_after_4_moves() {
    let first = Parameters { moves_per_target: 12, training_moves: 8, ..Parameters::default() };
    let runs = runs(&first);
    for limit_m in [0.03, 0.01] {
        let moves = quantile(runs.iter().map(|run| run.moves_on_first_target(limit_m)), 0.5);
        assert!(moves.is_some_and(|moves| moves <= 4), "{limit_m} m: {moves:?}");
    }
}

/// "In about 5 moves to the target a precision of approximately 3 cm" (paper, section 3).
#[test]
fn the_papers_scheme_reaches_its_first_target_in_about_5_moves() {
    let paper = Parameters { moves_per_target: 15, training_moves: 15, ..Parameters::of(Profile::Paper) };
    let to_3_cm = quantile(runs(&paper).iter().map(|run| run.moves_on_first_target(0.03)), 0.5);
    assert!(to_3_cm.is_some_and(|moves| moves <= 7), "{to_3_cm:?}");
}

/// Mutation: the image turns with joint 1, and which way is not a matter of taste.
#[test]
fn the_wrong_rotation_sign_never_learns() {
    let mut parameters = Parameters { training_moves: 15, ..Parameters::default() };
    parameters.learning.rotation_sign = 1.0;
    assert!(final_error(&runs(&parameters)) > 0.03);
}

/// Mutation: joint angles of 80 ms after the exposure, as a careless reader would take them.
#[test]
fn joints_read_80_ms_late_never_learn_to_1_cm() {
    let parameters = Parameters { training_moves: 15, ..Parameters::default() };
    let mut learner = Learner::new(&parameters, 3);
    let mut cell = support::Cell::new(3, Conditions::default());
    let cases = support::grid_cases(&cell.coupling, &cell.camera);
    let mut best = f64::INFINITY;
    while learner.phase() == Phase::Training {
        let mut input = cell.expose();
        for joint in 0..2 {
            input.joints[joint] += 0.08 * input.velocities[joint];
        }
        cell.act(learner.step(&input).set_point);
        finish_refit(&mut learner);
        best = best.min(support::one_shot_error(learner.network(), &cell, &cases).median);
    }
    assert!(best > 0.015, "{best}");
}

#[test]
fn any_mount_angle_is_learnt() {
    let parameters = Parameters { training_moves: 15, ..Parameters::default() };
    let runs: Vec<Run> = [0.8, 2.4, -1.9]
        .into_iter()
        .map(|mount_rad| train(&parameters, 3, Conditions { mount_rad, ..Conditions::default() }).0)
        .collect();
    assert!(final_error(&runs) < 0.015, "{}", final_error(&runs));
}

#[test]
fn no_detection_at_all_neither_moves_the_arm_out_of_its_envelope_nor_begins_to_track() {
    let parameters = Parameters { training_moves: 2, ..Parameters::default() };
    let mut learner = Learner::new(&parameters, 3);
    let mut cell = support::Cell::new(3, Conditions::default());
    for _ in 0..1000 {
        let mut input = cell.expose();
        input.target = pursuit_messages::Target::default();
        cell.act(learner.step(&input).set_point);
        finish_refit(&mut learner);
        assert_eq!(learner.phase(), Phase::Training);
    }
}
