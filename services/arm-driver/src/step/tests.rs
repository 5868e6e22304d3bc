use super::*;
use proptest::prelude::*;
use pursuit_kinematics::Arm;
use pursuit_messages::ImageShape;

const MS: u64 = 1_000_000;
const EPOCH: u64 = 7;
/// Rounding of a few hundred cycles.
const ROUNDING: f64 = 1e-9;

fn coupling() -> Coupling {
    Coupling::new(&Arm::puma_like(), 0.5).unwrap()
}

fn driver() -> Driver {
    Driver::new(Parameters::for_coupling(&coupling()), coupling()).unwrap()
}

fn resting(theta: [f64; 2]) -> Drives {
    let position = coupling().joints(theta[0], theta[1]).unwrap();
    Drives { position, issued_position: position, ..Drives::default() }
}

fn follow(position: [f64; 2], velocity: [f64; 2]) -> SetPoint {
    SetPoint { follow: 1, position, velocity, ..SetPoint::default() }
}

fn stamp(exposure_ns: u64) -> Stamp {
    Stamp::new(EPOCH, 1, exposure_ns, ImageShape::grey(4, 4))
}

/// The drives as they report after they have accepted `command`.
fn after(command: &Command, drives: Drives) -> Drives {
    match command.used().last() {
        Some(last) => Drives {
            position: last.position,
            velocity: last.velocity,
            issued_position: last.position,
            issued_velocity: last.velocity,
        },
        None => drives,
    }
}

fn refusal_of(set_point: SetPoint, stamp: Stamp, now_ns: u64) -> Option<Refusal> {
    driver().step(now_ns, EPOCH, &resting([0.0, 0.6]), Some((&set_point, &stamp)), 4).refusal
}

#[test]
fn every_gate_has_its_refusal() {
    let now = 1000 * MS;
    let good = follow([0.1, 0.5], [0.0; 2]);
    assert_eq!(refusal_of(good, stamp(now), now), None);
    assert_eq!(driver().step(now, EPOCH, &resting([0.0, 0.6]), None, 4).refusal, Some(Refusal::None));
    let other_layout = Stamp { layout: LAYOUT + 1, ..stamp(now) };
    assert_eq!(refusal_of(good, other_layout, now), Some(Refusal::OldEpoch));
    let other_epoch = Stamp { epoch: EPOCH + 1, ..stamp(now) };
    assert_eq!(refusal_of(good, other_epoch, now), Some(Refusal::OldEpoch));
    for bad in [f64::NAN, f64::INFINITY] {
        assert_eq!(refusal_of(follow([bad, 0.5], [0.0; 2]), stamp(now), now), Some(Refusal::NotFinite));
        assert_eq!(refusal_of(follow([0.0, 0.5], [0.0, bad]), stamp(now), now), Some(Refusal::NotFinite));
    }
    assert_eq!(refusal_of(good, stamp(now - 250 * MS), now), None);
    assert_eq!(refusal_of(good, stamp(now - 250 * MS - 1), now), Some(Refusal::Stale));
    assert_eq!(refusal_of(good, stamp(now + 1), now), Some(Refusal::FromTheFuture));
    assert_eq!(refusal_of(SetPoint::default(), stamp(now), now), Some(Refusal::Hold));
    assert_eq!(refusal_of(SetPoint { follow: 2, ..good }, stamp(now), now), Some(Refusal::Hold));
    for theta in [[2.62, 0.6], [-2.62, 0.6], [0.0, 11.9f64.to_radians()], [0.0, 57.1f64.to_radians()]] {
        assert_eq!(refusal_of(follow(theta, [0.0; 2]), stamp(now), now), Some(Refusal::OutOfRange));
    }
    assert_eq!(refusal_of(follow([0.0, 12.1f64.to_radians()], [0.0; 2]), stamp(now), now), None);
}

#[test]
fn a_set_point_is_reached_and_the_camera_hangs_over_it() {
    let driver = driver();
    let mut drives = resting([0.0, 0.6]);
    for frame in 0..50 {
        let now = frame * 40 * MS;
        let command = driver.step(now, EPOCH, &drives, Some((&follow([0.3, 0.4], [0.0; 2]), &stamp(now))), 4);
        assert_eq!((command.count, command.refusal), (4, None));
        drives = after(&command, drives);
    }
    let expected = coupling().joints(0.3, 0.4).unwrap();
    for (is, expected) in drives.issued_position.iter().zip(expected) {
        assert!((is - expected).abs() < ROUNDING, "{drives:?}");
    }
    assert!(drives.issued_velocity.iter().all(|velocity| velocity.abs() < ROUNDING), "{drives:?}");
}

#[test]
fn a_moving_set_point_means_the_position_at_its_exposure() {
    let driver = driver();
    let mut drives = resting([0.0, 0.6]);
    let mut now = 0;
    for frame in 0..60 {
        now = frame * 40 * MS;
        let exposure = now.saturating_sub(30 * MS);
        let position = [0.3 * exposure as f64 * 1e-9, 0.6 - 0.05 * exposure as f64 * 1e-9];
        let set_point = follow(position, [0.3, -0.05]);
        drives = after(&driver.step(now, EPOCH, &drives, Some((&set_point, &stamp(exposure))), 4), drives);
    }
    let end_s = (now + 40 * MS) as f64 * 1e-9;
    assert!((drives.issued_position[0] - 0.3 * end_s).abs() < 1e-9, "{drives:?}");
    assert!((drives.issued_position[1] - (0.6 - 0.05 * end_s)).abs() < 1e-9);
    assert!((drives.issued_velocity[0] - 0.3).abs() < 1e-9);
}

#[test]
fn one_command_brakes_when_the_watchdogs_time_is_over() {
    let set_point = follow([0.0, 0.6], [0.5, 0.0]);
    let command = driver().step(0, EPOCH, &resting([0.0, 0.6]), Some((&set_point, &stamp(0))), MAX_CYCLES);
    let used = command.used();
    assert_eq!((used.len(), command.refusal), (MAX_CYCLES, None));
    assert!((used[24].position[0] - 0.125).abs() < ROUNDING && (used[24].velocity[0] - 0.5).abs() < ROUNDING);
    assert_eq!(used[MAX_CYCLES - 1].velocity, [0.0; JOINTS]);
    assert!(used.windows(2).all(|pair| pair[0].position[0] <= pair[1].position[0]));
}

#[test]
fn a_set_point_that_moves_out_of_the_envelope_is_followed_to_its_edge() {
    let driver = driver();
    let [low, high] = driver.limits()[1].position_rad();
    for (edge, out) in [(low, -0.9f64), (high, 0.9)] {
        let mut drives = resting([0.0, 0.6]);
        for frame in 0..100 {
            let now = frame * 40 * MS;
            let set_point = follow([0.0, edge - out.signum() * 0.01], [0.0, out]);
            let stamp = stamp(now.saturating_sub(200 * MS));
            let command = driver.step(now, EPOCH, &drives, Some((&set_point, &stamp)), 4);
            for cycle in command.used() {
                assert_safe(&driver, &drives, cycle);
                drives = after(&Command { cycles: [*cycle; MAX_CYCLES], count: 1, refusal: None }, drives);
            }
        }
        assert!((drives.issued_position[1] - edge).abs() < ROUNDING, "{drives:?}");
    }
}

#[test]
fn a_restarted_driver_goes_on_to_the_bit() {
    let set_point = follow([0.5, 0.5], [0.1, 0.0]);
    let start = resting([0.0, 0.6]);
    let whole = driver().step(0, EPOCH, &start, Some((&set_point, &stamp(0))), 8);
    let first = driver().step(0, EPOCH, &start, Some((&set_point, &stamp(0))), 4);
    let drives = after(&first, start);
    let second = driver().step(40 * MS, EPOCH, &drives, Some((&set_point, &stamp(0))), 4);
    assert_eq!(whole.used()[..4], *first.used());
    assert_eq!(whole.used()[4..], *second.used());
}

#[test]
fn an_arm_off_its_coupling_gets_no_cycles() {
    let set_point = follow([0.1, 0.5], [0.0; 2]);
    let mut drives = resting([0.0, 0.6]);
    drives.issued_position[2] += 0.1;
    let command = driver().step(0, EPOCH, &drives, Some((&set_point, &stamp(0))), 4);
    assert_eq!((command.count, command.refusal), (0, Some(Refusal::OutOfRange)));
    drives.issued_position[2] = f64::NAN;
    let command = driver().step(0, EPOCH, &drives, Some((&set_point, &stamp(0))), 4);
    assert_eq!((command.count, command.refusal), (0, Some(Refusal::NotFinite)));
}

#[test]
fn the_message_carries_the_command() {
    let set_point = follow([0.1, 0.5], [0.0; 2]);
    let command = driver().step(0, EPOCH + 1, &resting([0.0, 0.6]), Some((&set_point, &stamp(0))), 99);
    let message = command.message(DEFAULT_CYCLE_NS, set_point);
    assert_eq!(message.cycle_count as usize, MAX_CYCLES);
    assert_eq!(message.refusal, Refusal::OldEpoch as u32);
    assert_eq!(message.cycle_ns, 10 * MS);
}

#[test]
fn parameters_that_bound_nothing_are_refused() {
    let good = Parameters::for_coupling(&coupling());
    let bad = [
        Parameters { cycle_ns: 0, ..good },
        Parameters { max_speed_rad_per_s: [f64::NAN, 1.0], ..good },
        Parameters { max_speed_rad_per_s: [1.0, 0.0], ..good },
        Parameters { max_acceleration_rad_per_s2: [8.0, f64::INFINITY], ..good },
        Parameters { slack_rad: f64::NAN, ..good },
    ];
    for parameters in bad {
        assert!(Driver::new(parameters, coupling()).is_err(), "{parameters:?}");
    }
    let fast = Parameters { max_speed_rad_per_s: [100.0; 2], ..good };
    let limits = *Driver::new(fast, coupling()).unwrap().limits();
    assert!(limits[0].max_speed_rad_per_s() <= 1.43 && limits[1].max_speed_rad_per_s() <= 0.94);
}

/// Any number that a broken sender could send, the sensible ones more often.
fn number() -> impl Strategy<Value = f64> {
    prop_oneof![
        6 => -3.0..3.0f64,
        1 => any::<f64>(),
        1 => Just(f64::NAN),
        1 => Just(f64::INFINITY),
        1 => Just(f64::NEG_INFINITY),
    ]
}

fn angles() -> impl Strategy<Value = [f64; 2]> {
    prop_oneof![
        3 => (-2.6..2.6f64, 0.22..0.98f64).prop_map(|(theta1, theta2)| [theta1, theta2]),
        1 => (number(), number()).prop_map(|(theta1, theta2)| [theta1, theta2]),
    ]
}

/// A set-point or none, how long before (positive) or after now its frame was exposed in ms, its epoch
/// and how many cycles are asked for.
type Input = (Option<SetPoint>, i64, u64, usize);

fn input() -> impl Strategy<Value = Input> {
    let set_point =
        (angles(), prop::array::uniform2(number()), 0u32..3).prop_map(|(position, velocity, kind)| {
            // Mostly to be followed.
            SetPoint { follow: u32::from(kind > 0), position, velocity, ..SetPoint::default() }
        });
    let age_ms = prop_oneof![4 => 0i64..250, 1 => -100i64..1000];
    (prop::option::weighted(0.9, set_point), age_ms, prop_oneof![9 => Just(EPOCH), 1 => 0u64..9], 0usize..8)
}

/// Joints 1 to 6 within position and velocity limits, joints 1 and 2 within acceleration limits and
/// moving as they say.
fn assert_safe(driver: &Driver, before: &Drives, cycle: &DriveCycle) {
    let arm = Arm::puma_like();
    assert!(arm.within_limits(&cycle.position), "{cycle:?}");
    for joint in 0..JOINTS {
        let limit = arm.links[joint].max_speed_rad_per_s;
        assert!(cycle.velocity[joint].abs() <= limit + ROUNDING, "joint {}: {cycle:?}", joint + 1);
    }
    for axis in 0..2 {
        let limits = &driver.limits()[axis];
        let [low, high] = limits.position_rad();
        assert!(low - ROUNDING <= cycle.position[axis] && cycle.position[axis] <= high + ROUNDING);
        let change = cycle.velocity[axis] - before.issued_velocity[axis];
        assert!(change.abs() <= limits.max_acceleration_rad_per_s2() * limits.cycle_s() + ROUNDING);
        let mean = (cycle.velocity[axis] + before.issued_velocity[axis]) / 2.0;
        let way = cycle.position[axis] - before.issued_position[axis];
        assert!((way - mean * limits.cycle_s()).abs() < ROUNDING, "{before:?} {cycle:?}");
    }
    let coupled = driver.coupling.joints(cycle.position[0], cycle.position[1]);
    assert_eq!(coupled, Some(cycle.position));
}

/// Feeds `inputs` one after the other; the drives accept everything. Checks each cycle.
fn run(driver: &Driver, inputs: &[Input]) -> (u64, Drives) {
    let (mut now, mut drives) = (1_000 * MS, resting([0.2, 0.6]));
    for (set_point, age_ms, epoch, cycles) in inputs {
        let exposure = now.checked_add_signed(-age_ms * MS as i64).unwrap();
        let stamp = Stamp { epoch: *epoch, ..stamp(exposure) };
        let input = set_point.as_ref().map(|set_point| (set_point, &stamp));
        let command = driver.step(now, EPOCH, &drives, input, *cycles);
        assert_eq!(command.count, *cycles);
        for cycle in command.used() {
            assert_safe(driver, &drives, cycle);
            drives = Drives {
                issued_position: cycle.position,
                issued_velocity: cycle.velocity,
                position: cycle.position,
                velocity: cycle.velocity,
            };
        }
        now += *cycles as u64 * DEFAULT_CYCLE_NS;
    }
    (now, drives)
}

proptest! {
    #[test]
    fn no_history_of_set_points_leaves_the_limits(inputs in prop::collection::vec(input(), 1..60)) {
        run(&driver(), &inputs);
    }

    /// The last set-point stays the newest one; nothing else comes.
    #[test]
    fn after_the_loss_of_set_points_the_arm_rests_in_time(
        inputs in prop::collection::vec(input(), 1..30), last in angles(), speed in prop::array::uniform2(-2.0..2.0f64),
    ) {
        let driver = driver();
        let (lost_ns, mut drives) = run(&driver, &inputs);
        let (set_point, stamp) = (follow(last, speed), stamp(lost_ns));
        let mut now = lost_ns;
        let braking_s = driver
            .limits()
            .iter()
            .map(|limits| limits.max_speed_rad_per_s() / limits.max_acceleration_rad_per_s2())
            .fold(0.0, f64::max);
        // The watchdog, braking from full speed, and the two cycles that are begun meanwhile.
        let deadline = lost_ns + DEFAULT_WATCHDOG_NS + (braking_s * 1e9) as u64 + 2 * DEFAULT_CYCLE_NS;
        while now < deadline {
            let command = driver.step(now, EPOCH, &drives, Some((&set_point, &stamp)), 1);
            assert_safe(&driver, &drives, &command.cycles[0]);
            drives = after(&command, drives);
            now += DEFAULT_CYCLE_NS;
        }
        prop_assert_eq!(drives.issued_velocity, [0.0; JOINTS]);
    }
}
