//! A scheduled change of the cell: when it comes, what it does, that it survives a restart.
#![allow(clippy::unwrap_used)]

mod support;

use pursuit_kinematics::Rig;
use pursuit_learning::Normalisation;
use pursuit_messages::Phase;
use pursuit_simulator::change::{Change, When};
use pursuit_simulator::evaluation::Evaluation;
use support::{PERIOD_NS, Run, cell_config, training};

fn change(when: When) -> Change {
    Change { when, mount_rad: 0.5, focal_factor: 2.0, forearm_factor: 1.2 }
}

fn run(change: Change) -> Run {
    Run::new(&pursuit_simulator::config::CellConfig { change, ..cell_config() })
}

#[test]
fn it_comes_when_the_last_move_before_it_has_been_evaluated() {
    let mut run = run(change(When::Moves(2)));
    let focal: Vec<f64> = [0, 1, 1, 2, 2, 2]
        .map(|moves| {
            let seen = run.state().focal_px;
            run.frame(&training(moves));
            seen
        })
        .to_vec();
    // The second move ends in frame 3, is evaluated in frame 4; frame 5 is the first of another camera.
    assert_eq!(focal, [256.0, 256.0, 256.0, 256.0, 256.0, 512.0]);
    assert_eq!(run.records.iter().map(|r| r.changed).collect::<Vec<_>>(), [0, 0, 0, 0, 0, 1]);
}

#[test]
fn it_comes_at_its_time_of_tracking_and_never_in_training() {
    let mut run = run(change(When::Tracking(2 * PERIOD_NS)));
    for _ in 0..5 {
        run.frame(&training(7));
    }
    for _ in 0..4 {
        run.frame(&support::in_phase(Phase::Tracking));
    }
    assert_eq!(run.records.iter().map(|r| r.changed).collect::<Vec<_>>(), [0, 0, 0, 0, 0, 0, 0, 1, 1]);
}

#[test]
fn at_the_start_it_is_there_with_the_first_exposure() {
    let (before, after) = (run(change(When::Never)), run(change(When::Start)));
    let (before, after) = (before.state(), after.state());
    assert_eq!(before.position, after.position);
    assert_eq!(after.focal_px, 2.0 * before.focal_px);
    // Forearm x1.2: the camera sinks to 0.42 to 0.473 m.
    assert!((before.camera_position[2] - 0.5).abs() < 1e-4, "{before:?}");
    assert!((0.41..0.48).contains(&after.camera_position[2]), "{after:?}");
    // Two unit quaternions that are a turn of 0.5 rad apart.
    let product: f64 = before.camera_rotation.iter().zip(after.camera_rotation).map(|(a, b)| a * b).sum();
    assert!((2.0 * product.abs().acos() - 0.5).abs() < 1e-6, "{product}");
}

#[test]
fn a_cell_that_never_changes_does_not_care_what_the_change_would_be() {
    let trajectory = |change: Change| {
        let mut run = run(change);
        (0..10).for_each(|_| run.frame(&training(3)));
        run.cell.trajectory_sha256()
    };
    let nothing = Change { when: When::Never, mount_rad: 0.0, focal_factor: 1.0, forearm_factor: 1.0 };
    assert_eq!(trajectory(change(When::Never)), trajectory(nothing));
    assert_ne!(trajectory(change(When::Start)), trajectory(nothing));
}

#[test]
fn a_cell_restored_at_any_frame_goes_on_to_the_bit() {
    let commands: Vec<_> = [0, 1, 1, 2, 2, 2, 2].into_iter().map(training).collect();
    let mut calm = run(change(When::Moves(1)));
    commands.iter().for_each(|command| calm.frame(command));
    for killed in 0..commands.len() {
        let mut run = run(change(When::Moves(1)));
        for (number, command) in commands.iter().enumerate() {
            if number == killed {
                run.restart();
            }
            run.frame(command);
        }
        assert_eq!(run.cell.trajectory_sha256(), calm.cell.trajectory_sha256(), "killed in frame {killed}");
        assert_eq!(run.records, calm.records);
    }
}

#[test]
fn the_map_is_measured_against_the_changed_cell() {
    // A network of zeros never moves: its error is the distance of what is in view, and a lens with twice the
    // focal length has half of that in view.
    let config = cell_config();
    let coupling = support::coupling();
    let zeros = vec![0.0; pursuit_learning::WEIGHTS];
    let error = |rig: &Rig| {
        Evaluation::new(rig, Normalisation { half_width_px: 256.0 }).one_shot_cm(&zeros).unwrap().median
    };
    let nominal = Change { when: When::Start, mount_rad: 0.0, focal_factor: 1.0, forearm_factor: 1.0 };
    let plain = error(&nominal.rig(&coupling, &config.camera));
    let tele = error(&Change { focal_factor: 2.0, ..nominal }.rig(&coupling, &config.camera));
    assert!((0.4..0.7).contains(&(tele / plain)), "{tele} cm, {plain} cm");
    // A turn of the camera alone changes what is right, not how far things are.
    let turned = error(&Change { mount_rad: 3.0, ..nominal }.rig(&coupling, &config.camera));
    assert!((turned / plain - 1.0).abs() < 0.2, "{turned} cm, {plain} cm");
}
