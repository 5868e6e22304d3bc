use super::*;
use rand::{RngExt, SeedableRng};

/// Of a detection before it is measured, px².
const VARIANCE: f64 = 2.0;
const FRAME_S: f64 = 0.08;
const LEAD_S: f64 = 0.11;

fn sighting(point_px: [f64; 2], time_s: f64) -> Sighting {
    Sighting { point_px, time_ns: (time_s * 1e9).round() as u64, claimed_px2: 1.0, area_px2: 0.0 }
}

/// Errors of the prediction over [`LEAD_S`] at all frames, px; noise is uniform with this deviation.
fn errors(way: impl Fn(f64) -> [f64; 2], sd_px: f64, seconds: f64) -> Vec<f64> {
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(7);
    let mut follower = Follower::at(&sighting(way(0.0), 0.0), VARIANCE);
    let mut errors = Vec::new();
    for frame in 1..(seconds / FRAME_S) as u32 {
        let t = f64::from(frame) * FRAME_S;
        let reach = 3.0_f64.sqrt() * sd_px + 1e-12;
        let noisy = way(t).map(|axis| axis + random.random_range(-reach..reach));
        assert!(follower.take(&sighting(noisy, t)), "frame {frame} was not believed");
        let (found, truth) =
            (follower.predicted_px((t * 1e9) as u64, (LEAD_S * 1e9) as u64), way(t + LEAD_S));
        errors.push((found[0] - truth[0]).hypot(found[1] - truth[1]));
    }
    errors
}

fn rms(errors: &[f64]) -> f64 {
    (errors.iter().map(|error| error * error).sum::<f64>() / errors.len() as f64).sqrt()
}

/// 0.2 m at 0.2 m/s in the default cell.
fn circle(t: f64) -> [f64; 2] {
    [102.0 * t.cos(), 102.0 * t.sin()]
}

/// To the right at 0.2 m/s, then up, without any arc.
fn corner(t: f64) -> [f64; 2] {
    let v = 102.0;
    if t < 3.0 { [v * (t - 3.0), 0.0] } else { [0.0, v * (t - 3.0)] }
}

#[test]
fn a_steady_target_is_predicted_without_lag() {
    let errors = errors(|t| [50.0 * t, 20.0 - 30.0 * t], 0.0, 8.0);
    assert!(errors[50..].iter().all(|error| *error < 0.01), "{errors:?}");
}

#[test]
fn a_circle_is_predicted_as_a_bend() {
    let errors = errors(circle, 0.0, 12.0);
    // With the mean velocity of the last two frames, straight on, it would be
    // 0.5 * 102 * LEAD_S * (LEAD_S + FRAME_S) = 1.07 px off.
    assert!(rms(&errors[50..]) < 0.95, "{}", rms(&errors[50..]));
}

/// What is seen of a corner comes at least a frame late: at 102 px/s, LEAD_S + FRAME_S are 19 px along and
/// as many across. The overshoot is what lies beyond the corner.
#[test]
fn a_corner_is_left_within_three_frames() {
    let errors = errors(corner, 0.5, 6.0);
    let corner = (3.0 / FRAME_S) as usize;
    assert!(errors[corner + 4..].iter().all(|error| *error < 8.0), "{:?}", &errors[corner - 2..]);
    assert!(rms(&errors[corner + 8..]) < 2.0, "{:?}", &errors[corner..]);
}

#[test]
fn noise_at_rest_does_not_grow_in_the_prediction() {
    for sd_px in [0.7, 2.0, 5.0] {
        let errors = errors(|_| [3.0, 4.0], sd_px, 30.0);
        let late = &errors[100..];
        assert!(rms(late) < 1.1 * sd_px * 2.0_f64.sqrt(), "{} for {sd_px}", rms(late));
    }
}

#[test]
fn noise_is_measured_on_a_moving_target() {
    for sd_px in [1.0, 3.0] {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(3);
        let mut follower = Follower::at(&sighting(circle(0.0), 0.0), VARIANCE);
        for frame in 1..400 {
            let t = f64::from(frame) * FRAME_S;
            let reach = 3.0_f64.sqrt() * sd_px;
            follower.take(&sighting(circle(t).map(|axis| axis + random.random_range(-reach..reach)), t));
        }
        let found = follower.noise_px();
        assert!((found - sd_px).abs() < 0.3 * sd_px, "{found} for {sd_px}");
    }
}

#[test]
fn wild_measurements_are_not_believed() {
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(5);
    let mut follower = Follower::at(&sighting(circle(0.0), 0.0), VARIANCE);
    let (mut wild, mut believed) = (0, 0);
    for frame in 1..1000 {
        let t = f64::from(frame) * FRAME_S;
        let truth = circle(t);
        if frame > 20 && random.random_range(0.0..1.0) < 0.15 {
            let side = if wild % 2 == 0 { 60.0 } else { -60.0 };
            wild += 1;
            believed += u32::from(follower.take(&sighting([truth[0] + side, truth[1] - 40.0], t)));
        } else {
            follower.take(&sighting(truth.map(|axis| axis + random.random_range(-1.0..1.0)), t));
        }
    }
    assert!(wild > 100 && believed == 0, "{believed} of {wild}");
}

#[test]
fn a_long_gap_begins_anew() {
    let mut follower = Follower::at(&sighting([0.0, 5.0], 0.0), VARIANCE);
    assert!(follower.take(&sighting([80.0, 5.0], 2.0)));
    assert_eq!(follower.predicted_px(2_000_000_000, 0), [80.0, 5.0]);
}

/// 0.5 s unseen at 100 px/s would be 50 px on.
#[test]
fn a_target_that_is_no_longer_seen_comes_to_rest() {
    let mut follower = Follower::at(&sighting([0.0, 0.0], 0.0), VARIANCE);
    for frame in 1..=50 {
        let t = f64::from(frame) * FRAME_S;
        assert!(follower.take(&sighting([100.0 * t, 0.0], t)));
    }
    let after = |unseen_ns: u64| follower.predicted_px(4_000_000_000 + unseen_ns, 90_000_000)[0] - 400.0;
    assert!((after(0) - 9.0).abs() < 0.1, "{}", after(0));
    let (half_a_second, a_second) = (after(500_000_000), after(1_000_000_000));
    assert!(half_a_second < 21.0 && (a_second - half_a_second).abs() < 2.0, "{half_a_second} {a_second}");
}
