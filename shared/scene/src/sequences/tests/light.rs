use super::*;

/// Frame `t` of both over each other, per pixel.
fn ratios(changed: &Scenario, size: usize, t: usize) -> Vec<f64> {
    let plain = Scenario { contrast: 0.0, ..still() };
    let changed = Scenario { contrast: 0.0, ..changed.clone() };
    frame(&changed, size, 1, t).iter().zip(frame(&plain, size, 1, 0)).map(|(a, b)| a / b).collect()
}

#[test]
fn gain_drifts_by_at_most_what_is_asked_for_per_frame() {
    let scenario = Scenario { gain_drift: 0.04, frames: 20, ..still() };
    let mut sequence = Sequence::new(&Scenario { contrast: 0.0, ..scenario }, 64, 1).unwrap();
    let gains: Vec<f64> = (0..20).map(|t| frame_of(&mut sequence, t)[0] / 120.0).collect();
    let largest = gains.windows(2).map(|g| (g[1] - g[0]).abs()).fold(0.0, f64::max);
    assert!((largest - 0.04).abs() < 0.009, "{gains:?}");
    // a quarter of the period of 20 frames
    assert!((gains[5] - (1.0 + 0.04 * 20.0 / std::f64::consts::TAU)).abs() < 0.005, "{}", gains[5]);
}

#[test]
fn flicker_has_the_deviation_asked_for_and_is_the_same_all_over_a_frame() {
    let scenario = Scenario { flicker: 0.1, frames: 200, ..still() };
    let mut sequence = Sequence::new(&Scenario { contrast: 0.0, ..scenario }, 64, 1).unwrap();
    let mut gains = Vec::new();
    for t in 0..200 {
        let frame = frame_of(&mut sequence, t);
        assert!(frame.iter().all(|&p| p == frame[0]));
        gains.push(frame[0] / 120.0);
    }
    let (mean, deviation) = mean_and_deviation(&gains);
    assert!((mean - 1.0).abs() < 0.03 && (deviation - 0.1).abs() < 0.02, "{mean}, {deviation}");
}

#[test]
fn shadow_takes_its_share_of_light_in_a_band_that_moves() {
    let size = 256;
    let scenario = Scenario { shadow: 0.5, shadow_speed: 5.0, ..still() };
    let light = ratios(&scenario, size, 4);
    let middle = |t: usize| {
        // along the band's motion, the middle of the band lies at (0.2 + 0.35 / 2) of the width, and moves
        let along = 0.375 * size as f64 + 5.0 * t as f64;
        [0.8 * along, 0.6 * along].map(|c| c as usize)
    };
    let [x, y] = middle(4);
    assert!((light[y * size + x] - 0.5).abs() < 0.01);
    assert_eq!((light[0], light[size * size - 1]), (1.0, 1.0));
    let edge = |t: usize| ratios(&scenario, size, t)[..size].iter().position(|&l| l < 0.75).unwrap();
    // 5 px along the motion are 6.25 px along a row
    assert!((edge(6) as f64 - edge(2) as f64 - 25.0).abs() <= 1.0);
}

#[test]
fn uneven_light_is_smooth_and_has_the_deviation_asked_for() {
    let size = 64;
    let scenario = Scenario { uneven_flicker: 0.1, frames: 100, contrast: 0.0, ..still() };
    let mut sequence = Sequence::new(&scenario, size, 1).unwrap();
    let mut nodes = Vec::new();
    for t in 0..100 {
        let frame = frame_of(&mut sequence, t);
        // the middles of the thirds are the nodes
        nodes.extend([10, 31, 53].iter().flat_map(|y| [10, 31, 53].map(|x| frame[y * size + x] / 120.0)));
        let steepest = frame.windows(2).enumerate().filter(|(i, _)| i % size != size - 1);
        let steepest = steepest.map(|(_, p)| (p[1] - p[0]).abs()).fold(0.0, f64::max);
        assert!(steepest <= 6.0, "{steepest} grey levels from pixel to pixel");
    }
    let (mean, deviation) = mean_and_deviation(&nodes);
    assert!((mean - 1.0).abs() < 0.02 && (deviation - 0.1).abs() < 0.012, "{mean}, {deviation}");
}

#[test]
fn noise_has_the_deviation_asked_for_and_differs_from_frame_to_frame() {
    let scenario = Scenario { contrast: 0.0, noise: 10.0, ..still() };
    let mut sequence = Sequence::new(&scenario, 256, 1).unwrap();
    let (a, b) = (frame_of(&mut sequence, 1), frame_of(&mut sequence, 2));
    let (mean, deviation) = mean_and_deviation(&a);
    assert!((mean - 120.0).abs() < 0.3 && (deviation - 10.0).abs() < 0.3, "{mean}, {deviation}");
    let difference: Vec<f64> = a.iter().zip(&b).map(|(a, b)| a - b).collect();
    let (_, deviation) = mean_and_deviation(&difference);
    assert!((deviation - 10.0 * 2f64.sqrt()).abs() < 0.3, "{deviation}");
}
