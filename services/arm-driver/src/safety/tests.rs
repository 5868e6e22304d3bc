use super::table::{TABLE, diagram};
use super::*;
use crate::arm::Reading;
use crate::guard::{self, Guard};
use crate::step::{Command, Driver, Drives, Parameters};
use proptest::prelude::*;
use pursuit_kinematics::{Arm, Coupling, JOINTS};
use pursuit_messages::{ArmEvent, ArmState, ImageShape, Refusal, SetPoint, Stamp};

use ArmEvent as E;
use ArmState as S;

const MS: u64 = 1_000_000;

/// The machine in words of its own: strength of the stops as a number, not as a table.
fn reference(state: S, event: E) -> S {
    let strength = |state: S| match state {
        S::Fault => 4,
        S::EmergencyStop => 3,
        S::ProtectiveStop => 2,
        S::Holding => 1,
        _ => 0,
    };
    let stronger = |to: S| if strength(to) > strength(state) { to } else { state };
    let operates = state == S::Active || state == S::Holding;
    let stops_if = |condition: bool, to: S| if condition { stronger(to) } else { state };
    match event {
        E::Configured if state == S::Unconfigured => S::Inactive,
        E::Activated if state == S::Inactive => S::Active,
        E::Deactivated | E::HoldExpired if state == S::Holding => S::Inactive,
        E::Deactivated if state == S::Active => S::Inactive,
        E::SetPointsLost | E::HoldAsked => stops_if(state == S::Active, S::Holding),
        E::SetPointsBack if state == S::Holding => S::Active,
        E::BadSetPoints | E::FollowingError => stops_if(operates, S::ProtectiveStop),
        E::Outside if state == S::Inactive => S::Recovery,
        E::Outside => stops_if(operates, S::ProtectiveStop),
        E::Inside if state == S::Recovery => S::Inactive,
        E::ProtectiveAsked => stronger(S::ProtectiveStop),
        E::EmergencyAsked | E::EmergencyPressed => stronger(S::EmergencyStop),
        E::DriveLost => stops_if(state != S::Unconfigured, S::Fault),
        E::Reset if state == S::Fault => S::Unconfigured,
        E::Reset if state.is_latched() => S::Inactive,
        _ => state,
    }
}

#[test]
fn every_pair_of_state_and_event_leads_where_it_should() {
    for &state in S::ALL {
        for &event in E::ALL {
            let next = table::next(state, event).unwrap_or(state);
            assert_eq!(next, reference(state, event), "{} and {}", state.word(), event.word());
        }
    }
    assert_eq!(S::ALL.len() * E::ALL.len(), 160);
}

#[test]
fn no_row_leads_nowhere_and_no_pair_is_told_twice() {
    for (index, row) in TABLE.iter().enumerate() {
        assert!(!row.from.contains(&row.to), "{row:?}");
        for other in &TABLE[index + 1..] {
            let twice = other.event == row.event && other.from.iter().any(|state| row.from.contains(state));
            assert!(!twice, "{row:?} {other:?}");
        }
    }
}

#[test]
fn architecture_shows_the_table() {
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../../ARCHITECTURE.md");
    let text = std::fs::read_to_string(file).unwrap();
    assert!(text.contains(&diagram()), "ARCHITECTURE.md must show this:\n{}", diagram());
}

fn coupling() -> Coupling {
    Coupling::new(&Arm::puma_like(), 0.5).unwrap()
}

fn rules(activation: Activation) -> Rules {
    Rules { activation, following_error_rad: 0.05 }
}

fn chain(activation: Activation) -> Chain {
    Chain::new(rules(activation), &Arm::puma_like())
}

fn reading(time_ms: u64) -> Reading {
    let position = coupling().joints(0.2, 0.6).unwrap();
    let drives = Drives { position, issued_position: position, ..Drives::default() };
    Reading { time_ns: time_ms * MS, drives, demanded: position, enabled: true, pressed: false }
}

/// A look at `frame`'s set-point with what the gates say of it.
fn look(reading: &Reading, frame: u64, judged: Result<(), Refusal>) -> Look<'_> {
    Look {
        now_ns: reading.time_ns,
        reading: Some(reading),
        latch: None,
        wish: None,
        frame: Some((1, frame)),
        judged: Some(judged),
    }
}

/// Looks at `judged` for so many frames of 80 ms, from frame `from` on; the state after them.
fn watch(chain: &mut Chain, from: u64, frames: u64, judged: Result<(), Refusal>) -> S {
    for frame in from..from + frames {
        chain.look(&look(&reading(frame * 80), frame, judged));
    }
    chain.machine().state()
}

#[test]
fn a_simulated_arm_follows_its_first_good_set_point_and_the_restarted_driver_too() {
    for frame in [0, 700] {
        let mut chain = chain(Activation::Automatic);
        let verdict = chain.look(&look(&reading(frame * 80), frame, Ok(())));
        assert_eq!((verdict.refusal, chain.machine().state()), (None, S::Active));
    }
}

#[test]
fn a_real_arm_waits_for_its_operator_and_the_operator_for_set_points() {
    let mut chain = chain(Activation::Operator);
    assert_eq!(watch(&mut chain, 0, 2, Ok(())), S::Inactive);
    let at = reading(200);
    let too_soon = chain.look(&Look { wish: Some(Wish::Activate), ..look(&at, 1, Ok(())) });
    assert_eq!((too_soon.answer, too_soon.refusal), (Some(E::ActivatedTooSoon), Some(Refusal::Inactive)));
    assert_eq!(watch(&mut chain, 3, 3, Ok(())), S::Inactive);
    let at = reading(600);
    let activated = chain.look(&Look { wish: Some(Wish::Activate), ..look(&at, 7, Ok(())) });
    assert_eq!((activated.answer, activated.refusal), (Some(E::Activated), None));
}

#[test]
fn holding_ends_by_itself_within_two_seconds_and_not_after() {
    let mut chain = chain(Activation::Operator);
    watch(&mut chain, 0, 5, Ok(()));
    let at = reading(400);
    chain.look(&Look { wish: Some(Wish::Activate), ..look(&at, 5, Ok(())) });
    assert_eq!(watch(&mut chain, 6, 24, Err(Refusal::Stale)), S::Holding);
    assert_eq!(watch(&mut chain, 30, 1, Ok(())), S::Active);
    assert_eq!(watch(&mut chain, 31, 27, Err(Refusal::Stale)), S::Inactive);
    assert_eq!(watch(&mut chain, 60, 9, Ok(())), S::Inactive);
}

#[test]
fn a_sender_that_says_hold_is_heard_for_as_long_as_it_says_so() {
    let mut chain = chain(Activation::Automatic);
    watch(&mut chain, 0, 1, Ok(()));
    assert_eq!(watch(&mut chain, 1, 100, Err(Refusal::Hold)), S::Holding);
}

#[test]
fn three_bad_set_points_in_a_row_stop_the_arm_and_one_that_is_looked_at_often_does_not() {
    let mut chain = chain(Activation::Automatic);
    watch(&mut chain, 0, 1, Ok(()));
    for time_ms in 80..100 {
        chain.look(&look(&reading(time_ms), 1, Err(Refusal::NotFinite)));
    }
    assert_eq!(chain.machine().state(), S::Holding);
    assert_eq!(watch(&mut chain, 2, 1, Err(Refusal::Absurd)), S::Holding);
    assert_eq!(watch(&mut chain, 3, 1, Err(Refusal::NotFinite)), S::ProtectiveStop);
    let after = chain.look(&look(&reading(400), 4, Ok(())));
    assert_eq!((after.refusal, after.latch), (Some(Refusal::Stopped), Some(Latch::Protective)));
}

#[test]
fn a_following_error_stops_the_arm_at_its_third_reading_and_not_a_number_is_one() {
    for off in [0.051, -0.051, f64::NAN] {
        let mut chain = chain(Activation::Automatic);
        watch(&mut chain, 0, 1, Ok(()));
        let mut states = Vec::new();
        for time_ms in [90, 90, 90, 90, 100, 110] {
            let mut reading = reading(time_ms);
            reading.demanded[3] += off;
            chain.look(&look(&reading, 0, Ok(())));
            states.push(chain.machine().state());
        }
        assert_eq!(states[..5], [S::Active; 5], "{off}");
        assert_eq!(states[5], S::ProtectiveStop, "{off}");
    }
}

#[test]
fn an_emergency_stop_ends_when_the_button_is_released_the_arm_rests_and_somebody_resets() {
    let mut chain = chain(Activation::Automatic);
    watch(&mut chain, 0, 1, Ok(()));
    let mut at = reading(80);
    at.pressed = true;
    chain.look(&look(&at, 1, Ok(())));
    assert_eq!(chain.machine().state(), S::EmergencyStop);
    let mut reset = |at: &Reading| {
        let verdict = chain.look(&Look { wish: Some(Wish::Reset), ..look(at, 2, Ok(())) });
        (verdict.answer, verdict.released, chain.machine().state())
    };
    assert_eq!(reset(&at), (Some(E::ResetWhilePressed), false, S::EmergencyStop));
    at.pressed = false;
    at.drives.velocity[1] = 0.2;
    assert_eq!(reset(&at), (Some(E::ResetWhileMoving), false, S::EmergencyStop));
    at.drives.velocity[1] = 0.0;
    // The arm is simulated: with the reset it follows again.
    assert_eq!(reset(&at), (Some(E::Reset), true, S::Active));
}

#[test]
fn a_latched_stop_is_obeyed_before_the_first_set_point() {
    for (latch, state) in [(Latch::Protective, S::ProtectiveStop), (Latch::Emergency, S::EmergencyStop)] {
        let mut chain = chain(Activation::Automatic);
        let verdict = chain.look(&Look { latch: Some(latch), ..look(&reading(0), 0, Ok(())) });
        assert_eq!((verdict.refusal, chain.machine().state()), (Some(Refusal::Stopped), state));
        assert_eq!(verdict.latch, None, "it is set already");
    }
}

#[test]
fn drives_that_are_lost_are_a_fault_and_their_return_moves_no_real_arm() {
    for (activation, after) in [(Activation::Operator, S::Fault), (Activation::Automatic, S::Active)] {
        let mut chain = chain(activation);
        watch(&mut chain, 0, 4, Ok(()));
        let gone = Look { reading: None, ..look(&reading(320), 4, Ok(())) };
        chain.look(&gone);
        assert_eq!(chain.machine().state(), S::Fault);
        assert_eq!(watch(&mut chain, 5, 3, Ok(())), after);
    }
}

#[test]
fn a_frame_from_before_is_backwards_and_the_same_one_is_not() {
    let mut chain = chain(Activation::Automatic);
    watch(&mut chain, 7, 1, Ok(()));
    let stamp = |epoch, frame| Stamp::new(epoch, frame, 0, ImageShape::grey(4, 4));
    let backwards = [(1, 6), (1, 7), (1, 8), (2, 0), (0, 9)].map(|(e, f)| chain.is_backwards(&stamp(e, f)));
    assert_eq!(backwards, [true, false, false, false, true]);
}

/// One turn of the loop as a fault injector makes it.
#[derive(Clone, Debug)]
struct Turn {
    set_point: [f64; 4],
    age_ms: u64,
    latch: u8,
    reset: bool,
    pressed: bool,
    off_rad: f64,
    lost: bool,
}

fn turn() -> impl Strategy<Value = Turn> {
    let number = prop_oneof![12 => -2.5..2.5f64, 1 => Just(f64::NAN), 1 => Just(1e9), 1 => any::<f64>()];
    let seldom = || prop::bool::weighted(0.05);
    let off = prop_oneof![9 => Just(0.0), 1 => -0.2..0.2f64];
    let latch = prop_oneof![9 => Just(0u8), 1 => 0u8..3];
    (prop::array::uniform4(number), 0u64..400, latch, seldom(), seldom(), off, seldom()).prop_map(
        |(set_point, age_ms, latch, reset, pressed, off_rad, lost)| Turn {
            set_point,
            age_ms,
            latch,
            reset,
            pressed,
            off_rad,
            lost,
        },
    )
}

proptest! {
    /// Whatever comes in whatever order: latched states end by a reset alone, and no reset leads to motion.
    #[test]
    fn latched_states_end_by_a_reset_alone(events in prop::collection::vec(0..E::ALL.len(), 0..80)) {
        let mut machine = Machine::default();
        for event in events.into_iter().map(|index| E::ALL[index]) {
            let before = machine.state();
            let changed = machine.take(event);
            prop_assert_eq!(machine.state(), reference(before, event));
            prop_assert_eq!(changed, machine.state() != before);
            if changed {
                prop_assert_eq!(machine.cause(), event);
            }
            let weaker = changed && before.is_latched() && !machine.state().is_latched();
            prop_assert!(!weaker || event == E::Reset);
            prop_assert!(event != E::Reset || !changed || !machine.allows_motion());
        }
    }

    /// Gates, chain, limiter and drives in a loop: no joint leaves its limits, no command is too fast, none
    /// follows a set-point that is too old, none follows anything while the arm is stopped.
    #[test]
    fn no_history_of_faults_breaks_the_limits(turns in prop::collection::vec(turn(), 1..120)) {
        let parameters = Parameters { max_tool_speed_m_per_s: 0.25, ..Parameters::for_coupling(&coupling()) };
        let driver = Driver::new(parameters, coupling()).unwrap();
        let mut guard = Guard::new(driver.clone(), chain(Activation::Automatic));
        let mut now = reading(1000);
        for (frame, turn) in turns.iter().enumerate() {
            let [q1, q2, v1, v2] = turn.set_point;
            let set_point =
                SetPoint { follow: 1, position: [q1, q2], velocity: [v1, v2], ..SetPoint::default() };
            let exposure = now.time_ns - turn.age_ms * MS;
            let stamp = Stamp::new(1, frame as u64, exposure, ImageShape::grey(4, 4));
            now.pressed = turn.pressed;
            now.demanded = now.drives.position.map(|position| position + turn.off_rad);
            let latch = [None, Some(Latch::Protective), Some(Latch::Emergency)][usize::from(turn.latch)];
            let before = guard.chain().machine().state();
            let (verdict, command) = guard.turn(&guard::Turn {
                now_ns: now.time_ns,
                reading: (!turn.lost).then_some(&now),
                given: Some((&set_point, &stamp)),
                latch,
                wish: turn.reset.then_some(Wish::Reset),
                looks: true,
                cycles: Some(1),
            });
            let state = guard.chain().machine().state();
            prop_assert!(!before.is_latched() || turn.reset || before == S::Fault || state.is_latched());
            // Without a reading there is nothing to go on from: the drives stop by themselves.
            prop_assert_eq!(command.is_some(), !turn.lost);
            prop_assert!(verdict.refusal.is_some() || (turn.age_ms <= 250 && state == S::Active));
            let command = command.unwrap_or_else(|| {
                driver.go(now.time_ns, &now.drives, Err(Refusal::Stopped), 1)
            });
            check_command(&driver, &now.drives, &command, verdict.refusal.is_some())?;
            let cycle = command.cycles[0];
            now.drives = Drives {
                position: cycle.position,
                velocity: cycle.velocity,
                issued_position: cycle.position,
                issued_velocity: cycle.velocity,
            };
            now.time_ns += 10 * MS;
        }
    }
}

fn check_command(
    driver: &Driver,
    before: &Drives,
    command: &Command,
    rests: bool,
) -> Result<(), TestCaseError> {
    prop_assert_eq!(command.count, 1);
    let cycle = &command.cycles[0];
    prop_assert!(Arm::puma_like().within_limits(&cycle.position));
    for joint in 0..JOINTS {
        let most = Arm::puma_like().links[joint].max_speed_rad_per_s;
        prop_assert!(cycle.velocity[joint].abs() <= most + 1e-9);
    }
    for axis in 0..2 {
        let change = (cycle.velocity[axis] - before.issued_velocity[axis]).abs();
        prop_assert!(change <= 0.08 + 1e-9, "acceleration of joint {}: {change}", axis + 1);
        let slower = cycle.velocity[axis].abs() <= before.issued_velocity[axis].abs();
        prop_assert!(!rests || slower, "who shall rest goes faster");
    }
    let [theta, rate] = [cycle.position, cycle.velocity].map(|all| [all[0], all[1]]);
    let [along, across] = driver.coupling().camera_velocity(theta, rate);
    // A hundredth more: the geometry changes within a cycle of braking.
    prop_assert!(along.hypot(across) <= 0.2525, "the tool goes at {} m/s", along.hypot(across));
    Ok(())
}

#[test]
fn the_worst_travel_is_that_of_the_design_where_the_numbers_are() {
    let slow = Parameters { max_tool_speed_m_per_s: 0.25, ..Parameters::for_coupling(&coupling()) };
    let travel = Travel::worst(&Driver::new(slow, coupling()).unwrap(), 0.0);
    // v T is 62 mm; one cycle more, and braking.
    assert!((travel.speed_m_per_s - 0.25).abs() < 1e-12, "{travel:?}");
    assert!(travel.distance_m() > 0.0625 && travel.distance_m() < 0.125, "{travel:?}");
    let fast = Travel::worst(&Driver::new(Parameters::for_coupling(&coupling()), coupling()).unwrap(), 0.08);
    assert!(fast.speed_m_per_s > 1.0 && fast.distance_m() > travel.distance_m(), "{fast:?}");
    assert!(fast.text().contains(" mm"), "{}", fast.text());
}

/// The worst case, played: full speed across the table at the longest reach, then nothing more comes.
#[test]
fn no_loss_at_full_speed_travels_further_than_is_said() {
    let driver = Driver::new(Parameters::for_coupling(&coupling()), coupling()).unwrap();
    let low = driver.limits()[1].position_rad()[0] + 0.01;
    let bound = Travel::worst(&driver, 0.0);
    let position = coupling().joints(-2.0, low).unwrap();
    let mut drives = Drives { position, issued_position: position, ..Drives::default() };
    let mut time_ns = 1000 * MS;
    let mut step = |drives: &mut Drives, exposure_ns: u64| {
        let set_point =
            SetPoint { follow: 1, position: [2.5, low], velocity: [0.0; 2], ..SetPoint::default() };
        let stamp = Stamp::new(1, 1, exposure_ns, ImageShape::grey(4, 4));
        let command = driver.step(time_ns, 1, drives, Some((&set_point, &stamp)), 1);
        let cycle = command.cycles[0];
        drives.issued_position = cycle.position;
        drives.issued_velocity = cycle.velocity;
        time_ns += 10 * MS;
        time_ns
    };
    let mut lost_ns = 1000 * MS;
    while drives.issued_velocity[0] < 1.42 {
        lost_ns = step(&mut drives, lost_ns);
    }
    let at_loss = drives.issued_position[0];
    for _ in 0..100 {
        step(&mut drives, lost_ns);
    }
    assert_eq!(drives.issued_velocity, [0.0; JOINTS]);
    let [x, y] = coupling().camera_velocity([0.0, low], [1.0, 0.0]);
    let way = (drives.issued_position[0] - at_loss) * x.hypot(y);
    assert!(way <= bound.distance_m() && way > 0.6 * bound.distance_m(), "{way} m, {bound:?}");
}
