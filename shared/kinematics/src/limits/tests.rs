use super::*;
use proptest::prelude::*;

/// Rounding of a few hundred cycles.
const ROUNDING: f64 = 1e-9;

fn limits() -> Limits {
    Limits::new([-2.5, 2.5], 0.94, DEFAULT_MAX_ACCELERATION_RAD_PER_S2, 0.01).unwrap()
}

/// Issued states on the way to a resting goal, the start included.
fn way(limits: &Limits, start: Motion, goal: Motion, cycles: usize) -> Vec<Motion> {
    let mut states = vec![start];
    for _ in 0..cycles {
        states.push(limits.next(states[states.len() - 1], goal).unwrap());
    }
    states
}

/// Brakes cycle by cycle: the oracle for the closed form.
fn simulated_braking(limits: &Limits, speed: f64) -> f64 {
    let mut state = Motion { position: 0.0, velocity: speed };
    while state.velocity > 0.0 {
        state = limits.brake(state).unwrap();
    }
    state.position
}

fn assert_within(limits: &Limits, states: &[Motion]) {
    let [low, high] = limits.position_rad();
    for pair in states.windows(2) {
        let acceleration = (pair[1].velocity - pair[0].velocity) / limits.cycle_s();
        assert!(acceleration.abs() <= limits.max_acceleration_rad_per_s2() + 1e-9, "{pair:?}");
        assert!(pair[1].velocity.abs() <= limits.max_speed_rad_per_s() + 1e-12, "{pair:?}");
        assert!(low - ROUNDING <= pair[1].position && pair[1].position <= high + ROUNDING, "{pair:?}");
        let mean = (pair[0].velocity + pair[1].velocity) / 2.0;
        assert!((pair[1].position - pair[0].position - mean * limits.cycle_s()).abs() < 1e-12);
    }
}

#[test]
fn a_long_way_takes_the_time_of_the_trapezoid() {
    let limits = limits();
    let goal = Motion::at_rest(1.0);
    let states = way(&limits, Motion::at_rest(0.0), goal, 200);
    let arrival = states.iter().position(|state| (state.position - 1.0).abs() < ROUNDING).unwrap();
    // Way / speed + speed / acceleration = 1.181 s; at most two cycles more in whole cycles.
    let exact = 1.0 / 0.94 + 0.94 / 8.0;
    assert!((arrival as f64 * 0.01 - exact) < 0.02 && arrival as f64 * 0.01 >= exact - ROUNDING, "{arrival}");
}

#[test]
fn what_is_not_a_number_is_refused() {
    let limits = limits();
    let good = Motion::at_rest(0.0);
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        for motion in [Motion { position: bad, velocity: 0.0 }, Motion { position: 0.0, velocity: bad }] {
            assert!(matches!(limits.next(good, motion), Err(LimitsError::NotFinite { .. })));
            assert!(matches!(limits.next(motion, good), Err(LimitsError::NotFinite { .. })));
            assert!(matches!(limits.brake(motion), Err(LimitsError::NotFinite { .. })));
        }
        assert!(Limits::new([-1.0, 1.0], bad, 8.0, 0.01).is_err());
        assert!(Limits::new([-1.0, bad], 1.0, 8.0, 0.01).is_err());
    }
    assert!(Limits::new([1.0, -1.0], 1.0, 8.0, 0.01).is_err());
    assert!(Limits::new([-1.0, 1.0], 1.0, 8.0, 0.0).is_err());
}

#[test]
fn resting_at_the_goal_is_kept_to_the_bit() {
    let there = Motion::at_rest(0.123);
    assert_eq!(limits().next(there, there).unwrap(), there);
    assert_eq!(limits().brake(there).unwrap(), there);
}

#[test]
fn a_state_outside_the_range_comes_back() {
    let states = way(&limits(), Motion::at_rest(2.7), Motion::at_rest(3.0), 100);
    assert!((states[100].position - 2.5).abs() < ROUNDING, "{:?}", states[100]);
    assert!(states.windows(2).all(|pair| pair[1].position <= pair[0].position + ROUNDING));
}

proptest! {
    #[test]
    fn the_braking_distance_is_the_simulated_one(speed in 0.0..0.94f64) {
        let limits = limits();
        let simulated = simulated_braking(&limits, speed);
        prop_assert!((limits.braking_distance_rad(speed) - simulated).abs() < 1e-12);
        prop_assert!(simulated >= speed * speed / 16.0 - 1e-12);
    }

    #[test]
    fn a_resting_goal_is_met_without_overshoot(
        start in -2.4..2.4f64, goal in -2.4..2.4f64, share in -1.0..1.0f64,
    ) {
        let limits = limits();
        let towards = (goal - start).signum();
        // Any speed from which the goal is beyond the braking distance, or away from it.
        let mut velocity = share * 0.94;
        if velocity * towards > 0.0 && limits.braking_distance_rad(velocity) > (goal - start).abs() {
            velocity = 0.0;
        }
        let room = limits.braking_distance_rad(velocity);
        prop_assume!(start - room > -2.5 && start + room < 2.5);
        let states = way(&limits, Motion { position: start, velocity }, Motion::at_rest(goal), 900);
        assert_within(&limits, &states);
        for state in &states {
            prop_assert!((state.position - goal) * towards <= ROUNDING, "{:?}", state);
        }
        let last = states[states.len() - 1];
        prop_assert!((last.position - goal).abs() < ROUNDING && last.velocity.abs() < ROUNDING);
    }

    #[test]
    fn from_rest_it_never_moves_away_from_the_goal(start in -2.4..2.4f64, goal in -2.4..2.4f64) {
        let states = way(&limits(), Motion::at_rest(start), Motion::at_rest(goal), 600);
        for pair in states.windows(2) {
            let (before, after) = ((pair[0].position - goal).abs(), (pair[1].position - goal).abs());
            prop_assert!(after <= before + 1e-12);
        }
    }

    #[test]
    fn any_history_of_goals_stays_within_the_limits(
        goals in prop::collection::vec((-1e3..1e3f64, -1e3..1e3f64, 1usize..40), 1..40),
        braking in prop::collection::vec(any::<bool>(), 40),
    ) {
        // Narrow, so that the edges are met at speed.
        let limits = Limits::new([-0.2, 0.3], 0.94, 8.0, 0.01).unwrap();
        let mut states = vec![Motion::at_rest(0.0)];
        for (k, (position, velocity, cycles)) in goals.into_iter().enumerate() {
            // Near goals as well as absurd ones.
            let scale = if k % 2 == 0 { 1e-3 } else { 1.0 };
            let goal = Motion { position: position * scale, velocity: velocity * scale };
            for _ in 0..cycles {
                let issued = states[states.len() - 1];
                let next = if braking[k] { limits.brake(issued) } else { limits.next(issued, goal) };
                states.push(next.unwrap());
            }
        }
        assert_within(&limits, &states);
    }

    #[test]
    fn a_moving_goal_is_caught_and_then_followed_exactly(
        offset in -0.3..0.3f64, velocity in -0.5..0.5f64, start_velocity in -0.5..0.5f64,
    ) {
        let limits = limits();
        let goal_at = |cycle: usize| Motion { position: offset + velocity * cycle as f64 * 0.01, velocity };
        let mut state = Motion { position: 0.0, velocity: start_velocity };
        for cycle in 1..=250 {
            state = limits.next(state, goal_at(cycle)).unwrap();
        }
        prop_assert!((state.position - goal_at(250).position).abs() < ROUNDING, "{:?}", state);
        prop_assert!((state.velocity - velocity).abs() < ROUNDING);
    }

    #[test]
    fn two_limiters_in_series_equal_one(
        position in -2.0..2.0f64, velocity in -0.9..0.9f64,
        goal_position in -3.0..3.0f64, goal_velocity in -2.0..2.0f64,
    ) {
        let limits = limits();
        let issued = Motion { position, velocity };
        let once = limits.next(issued, Motion { position: goal_position, velocity: goal_velocity }).unwrap();
        let twice = limits.next(issued, once).unwrap();
        prop_assert!((once.velocity - twice.velocity).abs() < 1e-9, "{:?} {:?}", once, twice);
        prop_assert!((once.position - twice.position).abs() < 1e-11);
    }

    #[test]
    fn the_largest_numbers_do_no_harm(
        position in any::<f64>(), velocity in any::<f64>(), goal in any::<f64>(), rate in any::<f64>(),
    ) {
        prop_assume!([position, velocity, goal, rate].iter().all(|value| value.is_finite()));
        let goal = Motion { position: goal, velocity: rate };
        let next = limits().next(Motion::at_rest(position.clamp(-2.5, 2.5)), goal).unwrap();
        prop_assert!(next.is_finite() && next.velocity.abs() <= 0.081);
        // An absurd issued state is handled, whatever the answer.
        let _ = limits().next(Motion { position, velocity }, goal);
    }
}
