use super::*;
use pursuit_kinematics::{Arm, CameraPose, Coupling, JOINTS};

const MS: u64 = 1_000_000;
const CYCLE_NS: u64 = 10 * MS;

fn parked(_time_ns: u64) -> VehiclePose {
    VehiclePose::PARKED
}

fn parameters(substeps: usize) -> WorldParameters {
    WorldParameters { substeps, ..WorldParameters::starting_at([0.0, 0.6], 0.5).unwrap() }
}

/// The camera on the reference circle: radius 0.2 m around (0.63, 0), speed rising to
/// `speed_m_per_s` within a second. Joint positions and velocities at `time_ns`.
fn on_the_circle(speed_m_per_s: f64, time_ns: u64) -> ([f64; JOINTS], [f64; JOINTS]) {
    let coupling = Coupling::new(&Arm::puma_like(), 0.5).unwrap();
    let theta_at = |time_s: f64| {
        let ramped_s = if time_s < 1.0 { time_s * time_s / 2.0 } else { time_s - 0.5 };
        let angle = speed_m_per_s / 0.2 * ramped_s;
        coupling.theta_over([0.63 - 0.2 * angle.cos(), -0.2 * angle.sin()]).unwrap()
    };
    let time_s = time_ns as f64 * 1e-9;
    let (theta, step_s) = (theta_at(time_s), 1e-6);
    let (before, after) = (theta_at(time_s - step_s), theta_at(time_s + step_s));
    let rate = [0, 1].map(|axis| (after[axis] - before[axis]) / (2.0 * step_s));
    (coupling.joints(theta[0], theta[1]).unwrap(), coupling.velocities(theta, rate))
}

fn circle_world(substeps: usize) -> World {
    World::new(&WorldParameters { start_rad: on_the_circle(0.2, 0).0, ..parameters(substeps) }).unwrap()
}

/// The four cycles of the frame that begins at `frame_ns`.
fn circle_cycles(speed_m_per_s: f64, frame_ns: u64) -> Vec<TimedCycle> {
    (1..=4)
        .map(|k| {
            let due_ns = frame_ns + k * CYCLE_NS;
            let (position, velocity) = on_the_circle(speed_m_per_s, due_ns);
            TimedCycle { due_ns, duration_ns: CYCLE_NS, position, velocity }
        })
        .collect()
}

fn largest_difference(a: &[f64; JOINTS], b: &[f64; JOINTS]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// Largest joint error, rad, on the circle after the first second, and after two seconds of rest.
fn tracking_errors(substeps: usize, speed_m_per_s: f64, frames: u64) -> (f64, f64) {
    let mut world = circle_world(substeps);
    let mut moving: f64 = 0.0;
    for frame in 0..frames {
        world.accept(&circle_cycles(speed_m_per_s, frame * 4 * CYCLE_NS)).unwrap();
        for ms in 1..=40 {
            world.step_until(frame * 4 * CYCLE_NS + ms * MS, parked).unwrap();
            if world.time_ns() > 1000 * MS {
                moving = moving.max(largest_difference(&world.positions(), &world.set_point().0));
            }
        }
    }
    world.step_until(world.time_ns() + 2000 * MS, parked).unwrap();
    (moving, largest_difference(&world.positions(), &world.set_point().0))
}

/// Run with `--nocapture` to read the figures.
#[test]
fn the_drives_track_the_circle_within_four_milliradians_and_rest_within_five() {
    for substeps in [FAST_SUBSTEPS, HARDWARE_SUBSTEPS] {
        for speed in [0.05, 0.1, 0.2] {
            let (moving, resting) = tracking_errors(substeps, speed, 200);
            println!("{substeps} substeps, {speed} m/s: moving {moving:.2e} rad, at rest {resting:.2e} rad");
            assert!(moving < 4.5e-3, "{moving}");
            assert!(resting < 5e-3, "{resting}");
        }
    }
}

#[test]
fn at_rest_nothing_moves() {
    let mut world = World::new(&parameters(FAST_SUBSTEPS)).unwrap();
    let start = world.parameters().start_rad;
    assert!(largest_difference(&world.positions(), &start) < 1e-6);
    world.step_until(3000 * MS, parked).unwrap();
    assert!(largest_difference(&world.positions(), &start) < 5e-4, "{:?}", world.positions());
    assert!(world.velocities().iter().all(|velocity| velocity.abs() < 1e-3), "{:?}", world.velocities());
    assert!(!world.touching());
}

#[test]
fn the_camera_is_where_the_joints_put_it() {
    let world = World::new(&parameters(FAST_SUBSTEPS)).unwrap();
    let pose = CameraPose::from(world.parameters().arm.base_from_camera(&world.positions(), 0.0));
    let expected = [0.671591, -0.15005, 0.5];
    for (is, expected) in pose.translation.iter().zip(expected) {
        assert!((is - expected).abs() < 2e-6, "{pose:?}");
    }
    // Half a turn about the base's x axis: x outward, y against the turn, z down.
    assert!((pose.rotation[0].abs() - 1.0).abs() < 1e-6, "{pose:?}");
}

#[test]
fn two_worlds_are_equal_to_the_bit() {
    let run = |speed: f64| {
        let mut world = circle_world(HARDWARE_SUBSTEPS);
        for frame in 0..25 {
            world.accept(&circle_cycles(speed, frame * 4 * CYCLE_NS)).unwrap();
            world.step_until((frame + 1) * 4 * CYCLE_NS, parked).unwrap();
        }
        world.state_hash()
    };
    assert_eq!(run(0.2), run(0.2));
    assert_ne!(run(0.2), run(0.2000001));
}

#[test]
fn a_restored_world_continues_to_the_bit() {
    let mut world = circle_world(FAST_SUBSTEPS);
    let frame = |world: &mut World, frame: u64| {
        world.accept(&circle_cycles(0.2, frame * 4 * CYCLE_NS)).unwrap();
        // Saved in the middle of a cycle, with cycles waiting.
        world.step_until(frame * 4 * CYCLE_NS + 17 * MS, driving).unwrap();
    };
    let rest = |world: &mut World, frame: u64| {
        world.step_until((frame + 1) * 4 * CYCLE_NS, driving).unwrap();
    };
    for k in 0..20 {
        frame(&mut world, k);
        rest(&mut world, k);
    }
    frame(&mut world, 20);
    let saved = postcard::to_allocvec(&world).unwrap();
    println!("snapshot: {} bytes", saved.len());
    let mut restored: World = postcard::from_bytes(&saved).unwrap();
    assert_eq!(restored.state_hash(), world.state_hash());
    for k in 20..70 {
        for world in [&mut world, &mut restored] {
            rest(world, k);
            frame(world, k + 1);
        }
        assert_eq!(restored.state_hash(), world.state_hash(), "frame {k}");
    }
    assert!(world.time_ns() > 20 * 4 * CYCLE_NS + 17 * MS + 1999 * MS);
    assert_eq!(postcard::to_allocvec(&restored).unwrap(), postcard::to_allocvec(&world).unwrap());
}

fn driving(time_ns: u64) -> VehiclePose {
    let angle = time_ns as f64 * 1e-9 * 0.5;
    VehiclePose { x_m: 0.63 + 0.2 * angle.cos(), y_m: 0.2 * angle.sin(), heading_rad: angle + 1.571 }
}

#[test]
fn what_is_not_finite_never_reaches_the_physics() {
    let mut world = World::new(&parameters(FAST_SUBSTEPS)).unwrap();
    let mut cycle = *world.issued();
    cycle.due_ns = CYCLE_NS;
    cycle.duration_ns = CYCLE_NS;
    cycle.position[2] = f64::NAN;
    let refused = world.accept(&[cycle]);
    assert_eq!(refused, Err(WorldError::Refused(CyclesError::NotFinite { index: 0 })));
    let nowhere = |_| VehiclePose { x_m: f64::NAN, ..VehiclePose::PARKED };
    assert_eq!(world.step_until(MS, nowhere), Err(WorldError::Vehicle { time_ns: 0 }));
    let timeless = WorldParameters { step_ns: 0, ..parameters(1) };
    assert!(matches!(World::new(&timeless), Err(WorldError::Parameters(_))));
}

#[test]
fn a_stopped_command_stream_brings_the_arm_to_rest() {
    let mut world = circle_world(FAST_SUBSTEPS);
    for frame in 0..50 {
        world.accept(&circle_cycles(0.2, frame * 4 * CYCLE_NS)).unwrap();
        world.step_until((frame + 1) * 4 * CYCLE_NS, parked).unwrap();
    }
    assert!(world.issued().velocity.iter().any(|velocity| velocity.abs() > 0.1));
    world.step_until(world.time_ns() + 500 * MS, parked).unwrap();
    assert_eq!(world.issued().velocity, [0.0; JOINTS]);
    assert!(world.velocities().iter().all(|velocity| velocity.abs() < 2e-3), "{:?}", world.velocities());
}

/// design notes on the simulator: a tip commanded into the table rests on it and stays finite.
#[test]
fn the_table_stops_the_camera() {
    let mut world = World::new(&parameters(FAST_SUBSTEPS)).unwrap();
    let arm = world.parameters().arm;
    let mut target = world.parameters().start_rad;
    // The shoulder alone turns down: the camera would end below the table.
    target[1] -= 1.3;
    assert!(arm.base_from_camera(&target, 0.0).translation.vector.z < 0.0);
    let cycle =
        TimedCycle { due_ns: 3000 * MS, duration_ns: 3000 * MS, position: target, velocity: [0.0; 6] };
    world.accept(&[cycle]).unwrap();
    world.step_until(5000 * MS, parked).unwrap();
    assert!(world.touching());
    let height = arm.base_from_camera(&world.positions(), 0.0).translation.vector.z;
    // The camera's housing has a radius of 35 mm.
    assert!(height > 0.02, "the camera is at {height} m");
}
