//! Vehicles are where their paths say, and continue to the bit after a restart.
#![allow(clippy::unwrap_used)]

use pursuit_scene::paths::{Arena, Disturbance, Mode, Path, Pose2, SpeedProfile, Vehicle};

const DT: f64 = 0.001;

fn circle(clockwise: bool) -> Path {
    Path::Circle { centre: [0.63, 0.0], radius_m: 0.2, speed_m_per_s: 0.1, clockwise, start_phase_rad: 0.4 }
}

fn all_paths() -> Vec<Path> {
    vec![
        circle(false),
        circle(true),
        Path::FigureEight { centre: [0.63, 0.0], half_width_m: 0.25, speed_m_per_s: 0.1 },
        Path::square([0.63, 0.0], 0.4, 0.1),
        Path::RandomWalk { arena: Arena { least: [0.4, -0.3], most: [0.85, 0.3] }, speed_m_per_s: 0.1 },
    ]
}

fn driven(mut vehicle: Vehicle, steps: usize) -> Vec<Pose2> {
    (0..steps)
        .map(|_| {
            vehicle.advance(DT);
            vehicle.pose()
        })
        .collect()
}

#[test]
fn circle_is_its_closed_form() {
    for clockwise in [false, true] {
        let sense = if clockwise { -1.0 } else { 1.0 };
        for (i, pose) in driven(Vehicle::new(circle(clockwise), Mode::Exact, 1), 20_000).iter().enumerate() {
            let phase = 0.4 + sense * 0.1 / 0.2 * DT * (i as f64 + 1.0);
            let wanted = [0.63 + 0.2 * phase.cos(), 0.2 * phase.sin()];
            let error = (pose.position[0] - wanted[0]).hypot(pose.position[1] - wanted[1]);
            assert!(error < 1e-10, "step {i}: {pose:?}, wanted {wanted:?}");
        }
    }
}

#[test]
fn velocity_and_heading_are_the_finite_differences_of_position() {
    for path in all_paths() {
        let poses = driven(Vehicle::new(path.clone(), Mode::Exact, 3), 15_000);
        let mut jumps = 0;
        for three in poses.windows(3) {
            let v = [0, 1].map(|k| (three[2].position[k] - three[0].position[k]) / (2.0 * DT));
            let error = (v[0] - three[1].velocity[0]).hypot(v[1] - three[1].velocity[1]);
            let along =
                three[1].velocity[0] * three[1].heading.cos() + three[1].velocity[1] * three[1].heading.sin();
            assert!((along - 0.1).abs() < 1e-9, "{path:?}");
            // a walk's curvature jumps where it turns back, and it may be reflected
            jumps += usize::from(error > 1e-4);
        }
        let permitted = if matches!(path, Path::RandomWalk { .. }) { 10 } else { 0 };
        assert!(jumps <= permitted, "{path:?}: {jumps}");
    }
}

#[test]
fn bicycle_keeps_within_two_millimetres_of_its_circle() {
    for (clockwise, speed_m_per_s, radius_m) in [(false, 0.1, 0.2), (true, 0.1, 0.2), (false, 0.2, 0.18)] {
        let path =
            Path::Circle { centre: [0.63, 0.0], radius_m, speed_m_per_s, clockwise, start_phase_rad: 0.0 };
        let poses = driven(Vehicle::new(path, Mode::Bicycle(None), 1), 30_000);
        let worst = poses
            .iter()
            .map(|p| ((p.position[0] - 0.63).hypot(p.position[1]) - radius_m).abs())
            .fold(0.0, f64::max);
        println!("radius {radius_m} m at {speed_m_per_s} m/s: off by {:.3} mm at most", 1e3 * worst);
        assert!(worst < 0.002, "off by {worst} m");
        let round = poses.windows(2).map(|w| (w[1].heading - w[0].heading).rem_euclid(std::f64::consts::TAU));
        let turned: f64 = round.map(|d| if d > 3.0 { d - std::f64::consts::TAU } else { d }).sum();
        let wanted = speed_m_per_s / radius_m * 29.999 * if clockwise { -1.0 } else { 1.0 };
        assert!((turned / wanted - 1.0).abs() < 0.01, "turned {turned}, wanted {wanted}");
    }
}

#[test]
fn bicycle_returns_to_its_path_when_disturbed() {
    let disturbance = Disturbance::default();
    for path in all_paths() {
        let poses = driven(Vehicle::new(path.clone(), Mode::Bicycle(Some(disturbance)), 5), 60_000);
        for pose in &poses {
            let [x, y] = pose.position;
            assert!((0.3..0.96).contains(&x) && y.abs() < 0.4, "{path:?}: at {x}, {y}");
            let speed = pose.velocity[0].hypot(pose.velocity[1]);
            assert!((0.05..0.15).contains(&speed), "{path:?}: {speed} m/s");
        }
        if let Path::Circle { .. } = path {
            let off = poses.iter().map(|p| ((p.position[0] - 0.63).hypot(p.position[1]) - 0.2).abs());
            let worst = off.fold(0.0, f64::max);
            assert!(worst > 1e-4 && worst < 0.02, "off by {worst} m");
        }
    }
}

#[test]
fn stored_vehicle_continues_to_the_bit() {
    let profile = SpeedProfile::stop_and_go(0.1, 1.0, 0.5, 0.3).unwrap();
    for path in all_paths() {
        for mode in [Mode::Exact, Mode::Bicycle(None), Mode::Bicycle(Some(Disturbance::default()))] {
            for profiled in [false, true] {
                let mut vehicle = Vehicle::new(path.clone(), mode, 9);
                if profiled {
                    vehicle = vehicle.with_profile(profile.clone());
                }
                (0..1234).for_each(|_| vehicle.advance(DT));
                let bytes = postcard::to_allocvec(&vehicle).unwrap();
                let restored: Vehicle = postcard::from_bytes(&bytes).unwrap();
                assert_eq!(restored, vehicle);
                let bits = |poses: Vec<Pose2>| -> Vec<u64> {
                    let numbers =
                        |p: &Pose2| [p.position[0], p.position[1], p.heading, p.velocity[0], p.velocity[1]];
                    poses.iter().flat_map(numbers).map(f64::to_bits).collect()
                };
                assert_eq!(bits(driven(vehicle, 3000)), bits(driven(restored, 3000)), "{path:?} {mode:?}");
            }
        }
    }
}

#[test]
fn seeds_differ_and_repeat() {
    let walk = all_paths().pop().unwrap();
    let end = |seed| {
        driven(Vehicle::new(walk.clone(), Mode::Bicycle(Some(Disturbance::default())), seed), 5000)[4999]
    };
    assert_eq!(end(1), end(1));
    assert_ne!(end(1), end(2));
}

#[test]
fn profile_moves_and_stops_the_vehicle() {
    let profile = SpeedProfile::stop_and_go(0.1, 1.0, 1.0, 0.2).unwrap();
    let exact = driven(Vehicle::new(circle(false), Mode::Exact, 1).with_profile(profile.clone()), 4000);
    assert_eq!(exact[1500].velocity, [0.0, 0.0]);
    assert_eq!(exact[1500].position, exact[2000].position);
    assert!(exact[2600].velocity[0].hypot(exact[2600].velocity[1]) > 0.099);
    let lagging = driven(Vehicle::new(circle(false), Mode::Bicycle(None), 1).with_profile(profile), 4000);
    let speed = |pose: &Pose2| pose.velocity[0].hypot(pose.velocity[1]);
    assert!(speed(&lagging[1200]) > 0.02 && speed(&lagging[2150]) < 0.01);
}

#[test]
fn stopped_vehicle_stands_still_and_drives_on_from_there() {
    for mode in [Mode::Exact, Mode::Bicycle(None)] {
        let mut vehicle = Vehicle::new(circle(false), mode, 1);
        (0..500).for_each(|_| vehicle.advance(DT));
        let before = vehicle.pose();
        vehicle.set_stopped(true);
        (0..500).for_each(|_| vehicle.advance(DT));
        assert_eq!(vehicle.pose().position, before.position);
        assert_eq!(vehicle.pose().velocity, [0.0, 0.0]);
        vehicle.set_stopped(false);
        vehicle.advance(DT);
        let step = (vehicle.pose().position[0] - before.position[0])
            .hypot(vehicle.pose().position[1] - before.position[1]);
        assert!((step - 1e-4).abs() < 1e-6, "step of {step} m");
    }
}

#[test]
fn a_steered_vehicle_that_stops_and_goes_stands_quite_still_and_goes_on_along_its_circle() {
    let profile = SpeedProfile::stop_and_go(0.1, 4.0, 3.0, 0.5).unwrap();
    for mode in [Mode::Bicycle(None), Mode::Bicycle(Some(Disturbance::default()))] {
        let vehicle = Vehicle::new(circle(false), mode, 1).with_profile(profile.clone());
        let poses = driven(vehicle, 16_000);
        // Stops from 4 to 4.5 s, sets off at 7.5 s; the lag of 0.3 s takes 0.1 m/s below 1 mm/s in 1.4 s.
        let standing = &poses[6_000..7_499];
        assert!(standing.iter().all(|p| p.velocity == [0.0; 2] && p.position == standing[0].position));
        let speed = |p: &Pose2| p.velocity[0].hypot(p.velocity[1]);
        assert!(speed(&poses[3_900]) > 0.08 && speed(&poses[11_500]) > 0.08);
        let off = |p: &Pose2| ((p.position[0] - 0.63).hypot(p.position[1]) - 0.2).abs();
        let worst = poses.iter().map(off).fold(0.0, f64::max);
        assert!(worst < 0.02, "{worst} m off the circle");
    }
}
