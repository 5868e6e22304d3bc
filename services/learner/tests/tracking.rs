//! Tracking with the plain law of the paper and with the predictive one, on an exact arm without any bus.

#![allow(clippy::unwrap_used)]

mod support;

use pursuit_learner::config::{Controller, Parameters};
use pursuit_learner::step::Learner;
use pursuit_messages::{Phase, SetPoint, Target};
use support::{Cell, Conditions, train};

/// A trained learner at home.
fn at_home() -> (Learner, Cell) {
    at_home_with(Controller::Plain)
}

fn at_home_with(controller: Controller) -> (Learner, Cell) {
    let parameters = Parameters { training_moves: 15, controller, ..Parameters::default() };
    let (_, mut learner, mut cell) = train(&parameters, 3, Conditions::default());
    while learner.phase() == Phase::Homing {
        cell.turn(&mut learner);
    }
    (learner, cell)
}

fn blind(learner: &mut Learner, cell: &mut Cell) -> SetPoint {
    let mut input = cell.expose();
    input.target = Target::default();
    let set_point = learner.step(&input).set_point;
    cell.act(set_point);
    set_point
}

#[test]
fn after_training_the_arm_goes_home() {
    let (learner, cell) = at_home();
    let home = learner.parameters().home_rad;
    assert!((cell.joints[0] - home[0]).abs() < 0.01 && (cell.joints[1] - home[1]).abs() < 0.01);
}

/// The paper's "in the order of 2 cm" at 0.1 m/s is the plain law's lag: speed times delay.
#[test]
fn a_target_at_a_tenth_of_a_metre_per_second_is_followed_within_3_cm() {
    let (mut learner, mut cell) = at_home();
    cell.target = [0.55, -0.1];
    cell.target_velocity = [0.0, 0.1];
    let mut worst: f64 = 0.0;
    for frame in 0..75 {
        cell.turn(&mut learner);
        if frame > 35 {
            worst = worst.max(cell.error_m());
        }
    }
    assert!(worst < 0.03, "{worst}");
}

#[test]
fn a_lost_target_makes_it_repeat_then_hold_then_go_home() {
    let (mut learner, mut cell) = at_home();
    cell.target = [0.6, 0.1];
    cell.target_velocity = [0.0, 0.0];
    for _ in 0..40 {
        cell.turn(&mut learner);
    }
    let last = learner.step(&cell.expose()).set_point;
    let frame_ns = support::FRAME_NS as f64;
    let frames = |duration: std::time::Duration| (duration.as_nanos() as f64 / frame_ns).ceil() as u64;
    let (lost, home) = (frames(learner.parameters().lost_after), frames(learner.parameters().return_after));
    for frame in 1..home + 3 {
        let set_point = blind(&mut learner, &mut cell);
        assert_eq!(set_point.detected, 0);
        match frame {
            _ if frame < lost => assert_eq!(set_point.position, last.position),
            _ if frame < home => assert_eq!(set_point.follow, 0),
            _ => assert_eq!((set_point.follow, set_point.position), (1, learner.parameters().home_rad)),
        }
    }
}

#[test]
fn what_is_not_finite_stops_the_arm_for_that_frame_only() {
    let (mut learner, mut cell) = at_home();
    cell.target = [0.6, 0.1];
    let mut input = cell.expose();
    assert_eq!(learner.step(&input).set_point.follow, 1);
    input.frame += 1;
    input.joints[0] = f64::NAN;
    assert_eq!(learner.step(&input).set_point.follow, 0);
    cell.frame += 1;
    assert_eq!(learner.step(&cell.expose()).set_point.follow, 1);
}

#[test]
fn no_set_point_leaves_the_envelope() {
    let (mut learner, mut cell) = at_home();
    let parameters = *learner.parameters();
    for step in 0..400 {
        let mut input = cell.expose();
        let angle = 0.7 * f64::from(step);
        input.target.motion.found = 1;
        (input.target.motion.u, input.target.motion.v) =
            (255.5 + 250.0 * angle.sin(), 255.5 + 250.0 * angle.cos());
        let set_point = learner.step(&input).set_point;
        assert_eq!(set_point.position, parameters.into_envelope(set_point.position));
        cell.act(set_point);
    }
}

#[test]
fn the_predictive_law_follows_closer_than_the_plain_one() {
    let rms_m = |controller| {
        let (mut learner, mut cell) = at_home_with(controller);
        cell.target = [0.55, -0.1];
        cell.target_velocity = [0.0, 0.1];
        let mut sum = 0.0;
        for frame in 0..75 {
            cell.turn(&mut learner);
            if frame >= 45 {
                sum += cell.error_m().powi(2) / 30.0;
            }
        }
        sum.sqrt()
    };
    let (plain, predictive) = (rms_m(Controller::Plain), rms_m(Controller::Predictive));
    assert!(predictive < 0.7 * plain, "predictive {predictive} m, plain {plain} m");
}

#[test]
fn the_predictive_law_starts_only_when_detections_agree_and_the_arm_is_at_rest() {
    let (mut learner, mut cell) = at_home_with(Controller::Predictive);
    cell.target = [0.6, 0.1];
    cell.target_velocity = [0.0, 0.0];
    let home = learner.parameters().home_rad;
    for _ in 0..2 {
        assert_eq!(learner.step(&cell.expose()).set_point.position, home, "two are not enough");
        cell.frame += 1;
    }
    let mut moving = cell.expose();
    moving.velocities = [0.3, 0.0];
    assert_eq!(learner.step(&moving).set_point.position, home, "a moving arm does not start");
    cell.frame += 1;
    let started = learner.step(&cell.expose()).set_point;
    assert!(started.position != home && started.detected == 1, "{started:?}");
}

/// The target drives out of the arm's reach at 0.1 m/s and comes back the same way.
#[test]
fn an_unreachable_target_is_waited_for_at_the_limit_and_followed_again() {
    let (mut learner, mut cell) = at_home_with(Controller::Predictive);
    let parameters = *learner.parameters();
    cell.target = [0.72, -0.1];
    cell.target_velocity = [0.0, 0.0];
    for _ in 0..30 {
        cell.turn(&mut learner);
    }
    cell.target_velocity = [0.1, 0.0];
    let (mut at_limit, mut farthest) = (0, 0.0_f64);
    for frame in 0..150 {
        cell.target_velocity = if frame < 60 { [0.1, 0.0] } else { [-0.1, 0.0] };
        let before = cell.joints;
        let set_point = cell.turn(&mut learner).set_point;
        assert_eq!(set_point.position, parameters.into_envelope(set_point.position));
        if set_point.position[1] == parameters.theta2_rad[0] {
            at_limit += 1;
            assert_eq!(set_point.velocity[1], 0.0, "it does not push against the limit");
        }
        farthest = farthest.max(cell.error_m());
        let step = (cell.joints[1] - before[1]).abs();
        assert!(step < 0.04, "{step} rad in one frame");
    }
    assert!(at_limit > 10 && farthest > 0.05, "{at_limit} frames at the limit, {farthest} m off");
    assert!(cell.error_m() < 0.03, "{} m off after it came back", cell.error_m());
}
