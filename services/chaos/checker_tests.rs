//! The checker finds each thing that must not happen, and nothing where all is well.

use super::*;
use pursuit_kinematics::{Arm, Coupling};
use pursuit_messages::{DriveCycle, ImageShape, Stage};

use pursuit_arm_driver::step::Parameters;

const MS: u64 = 1_000_000;

fn driver() -> Driver {
    let coupling = Coupling::new(&Arm::puma_like(), 0.5).unwrap();
    Driver::new(Parameters::for_coupling(&coupling), coupling).unwrap()
}

fn checker() -> Checker {
    Checker::new(Bounds::new(driver(), 0))
}

fn stamp(frame: u64, exposure_ms: u64) -> Stamp {
    Stamp::new(1, frame, exposure_ms * MS, ImageShape::grey(64, 64))
}

/// A reading in the middle of all ranges.
fn reading(time_ms: u64, speed: f64) -> WorldState {
    let mut world = WorldState { time_ns: time_ms * MS, exposes: 1, ..WorldState::default() };
    let arm = Arm::puma_like();
    for (joint, link) in arm.links.iter().enumerate() {
        let [low, high] = link.position_limits_rad;
        world.position[joint] = (low + high) / 2.0;
    }
    (world.velocity[0], world.issued_velocity[0]) = (speed, speed);
    world
}

fn command(speed: f64, refusal: u32) -> WorldCommand {
    let driver = driver();
    let [low, high] = driver.limits()[1].position_rad();
    let mut command = WorldCommand { cycle_count: 1, refusal, ..WorldCommand::default() };
    command.cycles[0] = DriveCycle::default();
    command.cycles[0].position[1] = (low + high) / 2.0;
    command.cycles[0].velocity[0] = speed;
    command
}

/// A command for a frame at a time.
fn answer(frame: u64, exposure_ms: u64, now_ms: u64) -> Stamp {
    let at = now_ms * MS;
    stamp(frame, exposure_ms).extended(Service::Learner, Stage::Learn, at, at).extended(
        Service::ArmDriver,
        Stage::Drive,
        at,
        at,
    )
}

/// So many ticks of 10 ms of an arm that moves, with an answer to each 4th.
fn moving(ticks: u64) -> Checker {
    let mut checker = checker();
    for tick in 0..ticks {
        let (frame, ms) = (tick / 4, 1000 + tick * 10);
        let mut world = reading(ms, 0.2);
        world.exposes = u32::from(tick % 4 == 0);
        checker.world(&stamp(frame, 1000 + frame * 40), &world);
        checker.command(&answer(frame, 1000 + frame * 40, ms + 1), &command(0.2, 0));
    }
    checker
}

fn invariants(checker: &Checker) -> Vec<&'static str> {
    checker.violations.iter().map(|violation| violation.invariant).collect()
}

fn health(pid: u32, time_ms: u64) -> Health {
    Health { service: Service::Vision as u32, pid, time_ns: time_ms * MS, ..Health::default() }
}

#[test]
fn a_run_in_which_all_is_well_has_no_violation() {
    let mut checker = moving(400);
    (0..40).for_each(|beat| checker.health(&health(7, 1000 + beat * 50)));
    assert_eq!(checker.violations, []);
    assert_eq!(checker.frames.count(0, u64::MAX), 100);
    assert_eq!(checker.frames.unanswered(0, u64::MAX), 0);
    assert_eq!(checker.frames.availability(u64::MAX, 150 * MS), 1.0);
}

#[test]
fn a_joint_past_its_limit_is_seen() {
    let mut checker = moving(8);
    let mut world = reading(2000, 0.0);
    world.position[3] = 10.0;
    checker.world(&stamp(9, 2000), &world);
    assert_eq!(invariants(&checker), ["I1"]);
    let mut checker = moving(8);
    let mut far = command(0.2, 0);
    far.cycles[0].position[0] = f64::NAN;
    checker.command(&answer(2, 1080, 1090), &far);
    assert_eq!(invariants(&checker), ["I1"]);
}

#[test]
fn a_command_that_is_too_fast_or_jumps_is_seen() {
    for (speed, seen) in
        [(99.0, vec!["I2", "I2"]), (0.4, vec!["I2"]), (f64::NAN, vec!["I2", "I2"]), (0.27, vec![])]
    {
        let mut checker = moving(8);
        checker.command(&answer(2, 1080, 1090), &command(speed, 0));
        assert_eq!(invariants(&checker), seen, "{speed} rad/s");
    }
}

#[test]
fn an_old_set_point_that_is_followed_is_seen() {
    let mut checker = moving(8);
    checker.command(&answer(2, 1080, 1080 + 261), &command(0.2, 0));
    assert_eq!(invariants(&checker), ["I3"]);
    // Refused it is what must be.
    let mut checker = moving(8);
    checker.command(&answer(2, 1080, 1080 + 261), &command(0.2, 3));
    assert_eq!(checker.violations, []);
}

#[test]
fn an_arm_that_goes_on_without_fresh_set_points_is_seen() {
    let mut checker = moving(8);
    let rest_ms = checker.bounds.rest_ns / MS;
    for tick in 0..100 {
        checker.world(&stamp(2, 1080), &reading(1080 + tick * 10, 0.2));
    }
    assert!(checker.violations.iter().all(|one| one.invariant == "I4"));
    let first = checker.violations[0].time_ns / MS;
    assert!((1040 + rest_ms..=1060 + rest_ms).contains(&first), "{first} ms, bound {rest_ms} ms");
}

#[test]
fn what_moved_the_arm_before_anybody_listened_is_excused_once() {
    let mut checker = checker();
    let rest_ms = checker.bounds.rest_ns / MS;
    for tick in 0..100 {
        checker.world(&stamp(2, 1080), &reading(1080 + tick * 10, 0.2));
    }
    let first = checker.violations[0].time_ns / MS;
    assert!((1080 + rest_ms..=1100 + rest_ms).contains(&first), "{first} ms, bound {rest_ms} ms");
    // A new world is no new beginning.
    let mut after = stamp(3, 2200);
    after.epoch = 2;
    checker.violations.clear();
    (0..7).for_each(|tick| checker.world(&after, &reading(2200 + tick * 10, 0.2)));
    assert_eq!(invariants(&checker), ["I4"]);
}

#[test]
fn a_stop_that_nobody_reset_is_seen() {
    let state =
        |state: ArmState, ms| DriverState { state: state as u32, time_ns: ms * MS, ..DriverState::default() };
    for reset in [true, false] {
        let mut checker = checker();
        checker.driver_state(&state(ArmState::Active, 1));
        checker.driver_state(&state(ArmState::EmergencyStop, 2));
        if reset {
            checker.reset_asked();
        }
        checker.driver_state(&state(ArmState::Inactive, 3));
        assert_eq!(checker.violations.len(), usize::from(!reset));
        // A reset is good for one stop.
        checker.driver_state(&state(ArmState::ProtectiveStop, 4));
        checker.driver_state(&state(ArmState::Active, 5));
        assert_eq!(invariants(&checker).last(), Some(&"I5"));
    }
}

#[test]
fn two_of_one_service_and_too_many_starts_are_seen() {
    let mut checker = checker();
    for (pid, ms) in [(7, 1000), (8, 1050), (8, 1100), (7, 1120)] {
        checker.health(&health(pid, ms));
    }
    assert_eq!(invariants(&checker), ["I6"]);
    let mut checker = self::checker();
    // One that stands by is not the service.
    checker.health(&Health { standing_by: 1, ..health(9, 1010) });
    (0..6).for_each(|start| checker.health(&health(10 + start, 1000 + 1600 * u64::from(start))));
    assert_eq!(checker.violations, []);
    checker.health(&health(20, 9900));
    assert_eq!(invariants(&checker), ["I8"]);
    assert_eq!(checker.reborn(Service::Vision, 1100 * MS), Some(2600 * MS));
}

#[test]
fn a_frame_that_is_followed_after_a_later_one_is_seen() {
    let mut checker = moving(40);
    checker.command(&answer(8, 1320, 1400), &command(0.2, 0));
    assert_eq!(invariants(&checker), ["I7"]);
}

#[test]
fn frames_without_an_answer_and_lost_samples_are_counted() {
    let mut checker = checker();
    for frame in 0..10 {
        checker.world(&stamp(frame, frame * 40), &reading(frame * 40, 0.0));
        if frame != 3 && frame != 4 {
            checker.command(&answer(frame, frame * 40, frame * 40 + 5), &command(0.0, 0));
        }
    }
    assert_eq!(checker.frames.unanswered(0, u64::MAX), 2);
    assert_eq!(checker.frames.unanswered(0, 130 * MS), 1);
    for samples in [3, 4, 2, 5] {
        checker.learner(&LearnerState { samples, ..LearnerState::default() });
    }
    assert_eq!(checker.lost_samples, 2);
}

#[test]
fn who_hears_late_hears_all_in_their_order() {
    // 20 ticks while the arm speeds up, each command 0.02 rad/s faster than the reading before; all heard at once.
    let (mut checker, mut late) = (moving(8), moving(8));
    let speed = |tick: u64| 0.2 + 0.02 * tick as f64;
    let events: Vec<(Stamp, WorldState, Stamp, WorldCommand)> = (0..20)
        .map(|tick| {
            let ms = 1080 + tick * 10;
            let now = answer(2 + tick, ms, ms + 1);
            (stamp(2 + tick, ms), reading(ms, speed(tick)), now, command(speed(tick + 1), 0))
        })
        .collect();
    for (seen, world, stamp, command) in &events {
        checker.hear_world(seen, world);
        checker.hear_command(stamp, command);
    }
    events.iter().for_each(|(_, _, stamp, command)| late.hear_command(stamp, command));
    events.iter().for_each(|(seen, world, ..)| late.hear_world(seen, world));
    checker.settle();
    late.settle();
    assert_eq!((checker.violations, late.violations), (vec![], vec![]));
    assert_eq!(late.frames.unanswered(0, u64::MAX), checker.frames.unanswered(0, u64::MAX));
}
