//! A camera whose clock is off: images and joints that are said to be of one time are of two.
#![allow(clippy::unwrap_used)]

mod support;

use pursuit_messages::{DriveCycle, Phase, WorldCommand, WorldState};
use pursuit_simulator::config::CellConfig;
use support::{PERIOD_NS, Run, cell_config, coupling};

const CYCLE_NS: u64 = 10_000_000;
/// rad/s, of joint 1.
const SPEED: f64 = 0.4;
const FRAMES: u64 = 20;

/// Joint 1 turns steadily while the vehicle drives.
fn turning(run: &Run) -> WorldCommand {
    let mut command = support::in_phase(Phase::Tracking);
    let start = run.state();
    command.cycle_ns = CYCLE_NS;
    command.cycle_count = (PERIOD_NS / CYCLE_NS) as u32;
    for (index, cycle) in command.cycles[..command.cycle_count as usize].iter_mut().enumerate() {
        *cycle = DriveCycle { position: start.issued_position, velocity: [0.0; 6] };
        cycle.position[0] += SPEED * (index as f64 + 1.0) * CYCLE_NS as f64 * 1e-9;
        cycle.velocity[0] = SPEED;
    }
    command
}

fn states(clock_offset_steps: i64, restarts: bool) -> Vec<WorldState> {
    let mut run = Run::new(&CellConfig { clock_offset_steps, ..cell_config() });
    (0..FRAMES)
        .map(|_| {
            let state = run.state();
            if restarts {
                run.restart();
            }
            run.frame(&turning(&run));
            state
        })
        .collect()
}

/// Angle of joint 1 at which the camera is where it is, rad.
fn joint_1_of_the_image(state: &WorldState) -> f64 {
    let [x, y, _] = state.camera_position;
    coupling().theta_over([x, y]).unwrap()[0]
}

#[test]
fn an_image_taken_later_shows_a_hand_that_has_moved_on_and_a_vehicle_too() {
    let punctual = states(0, false);
    for (offset, sign) in [(20, 1.0), (-20, -1.0)] {
        let states = states(offset, false);
        let last = states.last().unwrap();
        // 20 ms at 0.4 rad/s.
        let ahead = joint_1_of_the_image(last) - last.position[0];
        assert!((ahead - sign * 0.008).abs() < 1e-4, "{ahead} rad at {offset} ms");
        // Only one of the two is of another time: the hand itself moves as ever.
        let as_ever = punctual.last().unwrap();
        assert_eq!(last.issued_position, as_ever.issued_position);
        if offset > 0 {
            assert_eq!(
                (last.camera_position, last.target_position),
                (as_ever.camera_position, as_ever.target_position)
            );
        } else {
            assert_eq!(last.position, as_ever.position);
            let behind = (0..2)
                .map(|k| (as_ever.target_position[k] - last.target_position[k]).powi(2))
                .sum::<f64>()
                .sqrt();
            // 20 ms at 0.1 m/s.
            assert!((behind - 0.002).abs() < 1e-4, "{behind} m");
        }
    }
    let state = punctual.last().unwrap();
    assert!((joint_1_of_the_image(state) - state.position[0]).abs() < 1e-5);
}

#[test]
fn an_offset_longer_than_a_frame_or_not_a_divisor_of_it_is_as_exact() {
    for offset in [-40, -13, 1, 7, 40] {
        let states = states(offset, false);
        let last = states.last().unwrap();
        let ahead = joint_1_of_the_image(last) - last.position[0];
        assert!((ahead - SPEED * 1e-3 * offset as f64).abs() < 1e-4, "{ahead} rad at {offset} ms");
    }
}

#[test]
fn a_restored_cell_remembers_what_was() {
    for offset in [-20, 20] {
        assert_eq!(states(offset, true), states(offset, false));
    }
}
