//! A learner that is killed and restored gives the same answers, bit for bit.

#![allow(clippy::unwrap_used)]

mod support;

use pursuit_learner::config::Parameters;
use pursuit_learner::step::{Learner, Output};
use pursuit_learning::refit;
use support::{Cell, Conditions};

/// Answers of a run of `frames` frames; after each answer the state is saved, and where `killed` says so
/// thrown away and restored, and the last frame asked again.
fn answers(frames: u64, killed: impl Fn(u64) -> bool) -> Vec<Output> {
    let mut learner = Learner::new(&Parameters { training_moves: 4, ..Parameters::default() }, 7);
    let mut cell = Cell::new(7, Conditions::default());
    let mut answers = Vec::new();
    for frame in 0..frames {
        // In lock-step a refit is merged when the next frame is there.
        if let Some(job) = learner.refit_job() {
            learner.merge(&refit(&job, || true));
        }
        let input = cell.expose();
        let mut output = learner.step(&input);
        if killed(frame) {
            let bytes = postcard::to_stdvec(&learner).unwrap();
            learner = postcard::from_bytes(&bytes).unwrap();
            let again = learner.step(&input);
            assert_eq!(again, output, "frame {frame} asked again");
            output = again;
        }
        cell.act(output.set_point);
        answers.push(output);
    }
    assert_eq!(answers.last().unwrap().set_point.phase, 2, "the run shall reach tracking");
    answers
}

#[test]
fn killed_after_any_frame_it_goes_on_bit_for_bit() {
    let undisturbed = answers(250, |_| false);
    assert_eq!(answers(250, |_| true), undisturbed);
    assert_eq!(answers(250, |frame| frame % 7 == 3), undisturbed);
}

#[test]
fn a_repeated_frame_changes_nothing() {
    let mut learner = Learner::new(&Parameters::default(), 7);
    let mut cell = Cell::new(7, Conditions::default());
    for _ in 0..60 {
        let input = cell.expose();
        let output = learner.step(&input);
        let state = learner.clone();
        for _ in 0..3 {
            assert_eq!(learner.step(&input), output);
        }
        assert_eq!(learner, state);
        cell.act(output.set_point);
        support::finish_refit(&mut learner);
    }
}

#[test]
fn a_late_refit_is_not_waited_for_for_ever_and_is_merged_when_it_comes() {
    let mut learner = Learner::new(&Parameters::default(), 7);
    let mut cell = Cell::new(7, Conditions::default());
    let mut late = None;
    while late.is_none() {
        cell.turn(&mut learner);
        late = learner.refit_job();
    }
    let late = refit(&late.unwrap(), || true);
    let here = learner.step(&cell.expose()).set_point.position;
    while cell.turn(&mut learner).set_point.position == here {
        assert!(cell.frame < 200, "the next move never begins");
    }
    assert_eq!(learner.merge(&late), pursuit_learning::Merge::Merged);
}

#[test]
fn a_new_epoch_keeps_what_was_learnt_and_forgets_the_frames() {
    let (_, mut learner, mut cell) =
        support::train(&Parameters { training_moves: 6, ..Parameters::default() }, 7, Conditions::default());
    let weights = learner.network().weights();
    learner.start_epoch();
    cell.frame = 0;
    let output = learner.step(&cell.expose());
    assert_eq!(output.state.moves, 6);
    assert_eq!(learner.network().weights(), weights);
}
