use super::*;
use crate::network::WEIGHTS;
use crate::refit::refit;

const NORMALISATION: Normalisation = Normalisation { half_width_px: 256.0 };

/// A view of a target that moves across the image in proportion to the joints.
fn view(move_number: u32, step: u32) -> View {
    let (a, b) = (0.06 * f64::from(step), 0.03 * f64::from(step + move_number));
    View { point_px: [200.0 - 300.0 * a, 150.0 - 250.0 * b], joints: [a, 0.4 + b], ..View::default() }
}

fn make_move(trainer: &mut Trainer, move_number: u32) {
    trainer.start_move(Some(view(move_number, 0)));
    for step in 1..8 {
        trainer.observe(view(move_number, step), &NORMALISATION);
    }
    trainer.finish_move();
}

fn trainer_after(moves: u32) -> Trainer {
    let mut trainer = Trainer::new(&Settings::recommended(), 5);
    for move_number in 0..moves {
        make_move(&mut trainer, move_number);
        let result = refit(&trainer.refit_job().unwrap(), || true);
        trainer.merge(&result);
    }
    trainer
}

#[test]
fn a_refit_makes_the_error_on_the_ring_smaller() {
    let mut trainer = Trainer::new(&Settings::recommended(), 5);
    make_move(&mut trainer, 0);
    let before = trainer.error();
    let result = refit(&trainer.refit_job().unwrap(), || true);
    assert_eq!(trainer.merge(&result), Merge::Merged);
    assert!(trainer.error() < 0.1 * before, "{before} to {}", trainer.error());
    assert_eq!(result.error, [before, trainer.error()]);
    assert_eq!(trainer.refit_number(), None);
}

#[test]
fn a_result_that_nobody_waits_for_is_refused() {
    let mut trainer = trainer_after(1);
    make_move(&mut trainer, 1);
    let overtaken = refit(&trainer.refit_job().unwrap(), || true);
    make_move(&mut trainer, 2);
    let live = trainer.clone();
    assert_eq!(trainer.merge(&overtaken), Merge::Stale);
    assert_eq!(trainer, live);
    let result = refit(&trainer.refit_job().unwrap(), || true);
    assert_eq!(trainer.merge(&result), Merge::Merged);
    assert_eq!(trainer.merge(&result), Merge::Stale);
}

#[test]
fn a_result_that_is_not_better_or_not_sound_is_refused() {
    let mut trainer = trainer_after(3);
    make_move(&mut trainer, 3);
    let job = trainer.refit_job().unwrap();
    let mut result = refit(&job, || true);
    let mut worse = result.network.weights();
    worse[4] += 1.0;
    let weights = trainer.network().weights();
    result.network = Network::from_weights(&worse, true);
    assert_eq!(trainer.clone().merge(&result), Merge::NotBetter);
    worse[4] = f64::NAN;
    result.network = Network::from_weights(&worse, true);
    assert_eq!(trainer.merge(&result), Merge::Unsound);
    assert_eq!(trainer.network().weights(), weights);
    assert_eq!(trainer.counters().refits_rejected, 1);
}

/// Result (of the first move) + samples (of the second) = what the second move alone makes of the result:
/// computed here step by step for a network with one unit that is not zero.
#[test]
fn what_arrived_since_is_replayed_on_the_result() {
    let settings = Settings { huber: None, min_motion_rad: 0.1, ..Settings::paper() };
    let mut trainer = Trainer::new(&settings, 5);
    trainer.ring.admit(Sample { input: [0.3, 0.0, 0.1], output: [0.2, 0.1], ..Sample::default() });
    for _ in 0..MIN_REFIT_SAMPLES {
        trainer.ring.admit(trainer.samples()[0]);
    }
    trainer.start_move(None);
    trainer.finish_move();
    let mut weights = [0.0; WEIGHTS];
    weights[..6].copy_from_slice(&[0.5, 0.2, 0.1, 0.3, 0.7, 0.4]);
    let mut result = refit(&trainer.refit_job().unwrap(), || false);
    result.network = Network::from_weights(&weights, false);

    let first = View { point_px: [80.0, 20.0], joints: [0.0, 0.6], ..View::default() };
    let second = View { point_px: [10.0, -30.0], joints: [0.2, 0.5], ..View::default() };
    trainer.start_move(Some(first));
    trainer.observe(second, &NORMALISATION);
    assert_eq!(trainer.merge(&result), Merge::Merged);

    let sample = NORMALISATION.sample(&first, &second, -1.0, 0.1).unwrap();
    let [x, y, t] = sample.input;
    let hidden = (0.5 * x + 0.2 * y + 0.1 * t + 0.3).tanh();
    let residual = [0.7 * hidden - sample.output[0], 0.4 * hidden - sample.output[1]];
    let back = (0.7 * residual[0] + 0.4 * residual[1]) * (1.0 - hidden * hidden);
    let eta = settings.eta;
    let expected = [
        0.5 - eta * back * x,
        0.2 - eta * back * y,
        0.1 - eta * back * t,
        0.3 - eta * back,
        0.7 - eta * residual[0] * hidden,
        0.4 - eta * residual[1] * hidden,
    ];
    let merged = trainer.network().weights();
    for (found, expected) in merged.iter().zip(expected) {
        assert!((found - expected).abs() < 1e-14, "{found} {expected}");
    }
    assert!((merged[WEIGHTS - 2] + eta * residual[0]).abs() < 1e-14);
}

#[test]
fn what_is_restored_goes_on_as_if_it_had_never_stopped() {
    let mut never_stopped = trainer_after(2);
    make_move(&mut never_stopped, 2);
    // Killed with a refit out and in the middle of the next move.
    never_stopped.start_move(Some(view(3, 0)));
    never_stopped.observe(view(3, 1), &NORMALISATION);
    let bytes = postcard::to_stdvec(&never_stopped).unwrap();
    let mut restored: Trainer = postcard::from_bytes(&bytes).unwrap();
    assert_eq!(restored.refit_job(), never_stopped.refit_job());
    for trainer in [&mut never_stopped, &mut restored] {
        trainer.observe(view(3, 2), &NORMALISATION);
        let result = refit(&trainer.refit_job().unwrap(), || true);
        trainer.merge(&result);
        make_move(trainer, 4);
    }
    assert_eq!(restored, never_stopped);
    assert_eq!(
        restored.network().weights().map(f64::to_bits),
        never_stopped.network().weights().map(f64::to_bits)
    );
}

#[test]
fn the_same_seed_gives_the_same_weights_and_another_seed_others() {
    assert_eq!(trainer_after(3), trainer_after(3));
    assert_ne!(
        Trainer::new(&Settings::recommended(), 1).network,
        Trainer::new(&Settings::recommended(), 2).network
    );
}

#[test]
fn a_move_of_any_length_adds_at_most_the_kept_samples() {
    let mut trainer = Trainer::new(&Settings::recommended(), 5);
    trainer.start_move(Some(view(0, 0)));
    for round in 0..40 {
        trainer.observe(view(0, 1 + round % 7), &NORMALISATION);
    }
    trainer.finish_move();
    assert_eq!(trainer.samples().len(), Settings::recommended().kept_per_move as usize);
}
