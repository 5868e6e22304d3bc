//! The life of tracks, from findings made by hand.

use nalgebra::{Matrix4, SymmetricEigen};
use proptest::prelude::*;

use super::*;
use crate::tracker::MAX_TRACKS;

const SIDE: usize = 512;

/// A candidate of 40 x 40 px at (u, v) that moves by `relative` more than the background.
fn seen(u: f64, v: f64, relative: [f64; 2], confidence: f64) -> Candidate {
    Candidate {
        u,
        v,
        vu: relative[0],
        vv: relative[1],
        relative,
        area_px: 1600.0,
        confidence,
        position_covariance: [0.6, 0.1, 0.4],
        velocity_sd: 0.1,
        evidence: 3.0,
        spread: [130.0, 0.0, 130.0],
        ..Candidate::default()
    }
}

/// What the detector would have found while the background moved by `pan`.
fn findings(pan: (f64, f64), candidates: &[Candidate]) -> Findings {
    let mut findings = Findings {
        outcome: Outcome::Answered,
        background: GlobalMotion::still(SIDE, SIDE).translated(pan.0, pan.1),
        candidates: [Candidate::default(); MAX_TARGETS],
        count: candidates.len(),
        evidence: 1.0,
    };
    findings.candidates[..candidates.len()].copy_from_slice(candidates);
    for candidate in &mut findings.candidates[..candidates.len()] {
        candidate.vu += pan.0;
        candidate.vv += pan.1;
    }
    findings
}

fn without_pair(outcome: Outcome) -> Findings {
    Findings { outcome, ..findings((0.0, 0.0), &[]) }
}

fn tracker() -> Tracker {
    Tracker::new(&TrackerParameters::default())
}

/// A tracker that has followed a target of velocity (3, -1) to (200 + 3 n, 300 - n) for n = 10 frames.
fn following() -> Tracker {
    let mut tracker = tracker();
    for i in 0..=10 {
        let i = f64::from(i);
        tracker.step(&findings((0.0, 0.0), &[seen(200.0 + 3.0 * i, 300.0 - i, [3.0, -1.0], 0.9)]), 1);
    }
    tracker
}

#[test]
fn a_strong_target_is_confirmed_after_two_or_three_frames() {
    for confidence in [0.8, 0.9, 0.98] {
        let mut tracker = tracker();
        let mut confirmed = None;
        for i in 0..5 {
            let u = 100.0 + 4.0 * f64::from(i);
            tracker.step(&findings((0.0, 0.0), &[seen(u, 200.0, [4.0, 0.0], confidence)]), 1);
            if i == 0 {
                assert!(tracker.target().is_none(), "one frame is not enough");
                assert_eq!(tracker.tracks().next().map(|track| track.state), Some(TrackState::Tentative));
            }
            if tracker.target().is_some() {
                confirmed = confirmed.or(Some(i + 1));
            }
        }
        assert!(matches!(confirmed, Some(2 | 3)), "confidence {confidence}: after {confirmed:?} frames");
        let Some(track) = tracker.target() else { panic!("it was confirmed") };
        assert_eq!((track.state, track.hits, track.misses), (TrackState::Confirmed, 5, 0));
        assert!((track.mean[0] - 116.0).hypot(track.mean[1] - 200.0) < 0.5, "{:?}", track.mean);
        assert!((track.velocity[0] - 4.0).hypot(track.velocity[1]) < 0.2, "{:?}", track.velocity);
    }
}

#[test]
fn weak_candidates_that_are_seen_once_never_make_a_target() {
    for confidence in [0.2, 0.5] {
        let mut tracker = tracker();
        for i in 0..40 {
            // One frame in five, each time elsewhere.
            let weak = seen(60.0 + 9.0 * f64::from(i), 400.0 - 8.0 * f64::from(i), [2.0, 2.0], confidence);
            let candidates: &[Candidate] = if i % 5 == 0 { &[weak] } else { &[] };
            tracker.step(&findings((1.0, 0.0), candidates), 1);
            assert!(tracker.target().is_none(), "frame {i}, confidence {confidence}");
        }
    }
}

#[test]
fn candidates_below_the_least_confidence_are_not_looked_at() {
    let mut tracker = tracker();
    tracker.step(&findings((0.0, 0.0), &[seen(100.0, 100.0, [2.0, 0.0], 0.02)]), 1);
    assert_eq!(tracker.tracks().count(), 0);
}

/// Whether `count` uniformly random candidates per frame ever made a target within 200 frames.
fn clutter_is_confirmed(seed: u64, count: usize, confidence: f64) -> bool {
    let mut random = Random(seed);
    let mut tracker = tracker();
    (0..200).any(|_| {
        let mut within = |low: f64, high: f64| low + (high - low) * random.uniform();
        let candidates: Vec<Candidate> = (0..count)
            .map(|_| {
                let (u, v) = (within(0.0, SIDE as f64), within(0.0, SIDE as f64));
                seen(u, v, [within(-8.0, 8.0), within(-8.0, 8.0)], confidence)
            })
            .collect();
        tracker.step(&findings((3.0, 1.0), &candidates), 1);
        tracker.target().is_some()
    })
}

#[test]
fn random_clutter_hardly_ever_makes_a_target() {
    // Measured: 0, 0, 0, 0 and 4 of 500. One chance meeting confirms a track only from 0.8 on.
    let most = MAX_TARGETS;
    let cases = [(1, 0.2, 0), (most, 0.2, 0), (most, 0.5, 0), (most, 0.7, 2), (1, 0.8, 12)];
    for (count, confidence, bound) in cases {
        let run = |seed: &u64| clutter_is_confirmed(*seed, count, confidence);
        let confirmed = (0..500).filter(run).count();
        println!("{count} per frame of {confidence}: {confirmed} of 500 runs of 200 frames");
        assert!(confirmed <= bound, "{count} of {confidence}: {confirmed} of 500 runs made a target");
    }
}

#[test]
fn a_target_that_is_hidden_for_six_frames_is_the_same_one_afterwards_though_the_camera_pans() {
    let mut tracker = following();
    let Some(before) = tracker.target().copied() else { panic!("followed") };
    // The camera pans from now on; the target goes on by itself, as it did.
    let pan = (7.0, 4.0);
    let truth = |n: f64| (230.0 + (3.0 + pan.0) * n, 290.0 + (-1.0 + pan.1) * n);
    for n in 1..=6 {
        tracker.step(&findings(pan, &[]), 1);
        let Some(track) = tracker.target() else { panic!("lost after {n} frames") };
        assert_eq!((track.id, track.state, track.misses), (before.id, TrackState::Coasting, n));
        let (u, v) = truth(f64::from(n));
        let off = (track.mean[0] - u).hypot(track.mean[1] - v);
        // It is thought to slow down by a tenth per frame: 3.16 px/frame lose 4.4 px in 6 frames.
        assert!(off < 5.0, "{off:.2} px off after {n} frames");
        let sd = (track.covariance[0][0] + track.covariance[1][1]).sqrt();
        assert!(off < 3.0 * sd, "{off:.2} px off, but {sd:.2} px said");
        let slip = (track.velocity[0] - 3.0 - pan.0).hypot(track.velocity[1] + 1.0 - pan.1);
        assert!(slip < 1.7, "{:?}", track.velocity);
    }
    let (u, v) = truth(7.0);
    tracker.step(&findings(pan, &[seen(u, v, [3.0, -1.0], 0.9)]), 1);
    let Some(track) = tracker.target() else { panic!("seen again") };
    assert_eq!((track.id, track.state, track.misses), (before.id, TrackState::Confirmed, 0));
    assert!((track.mean[0] - u).hypot(track.mean[1] - v) < 1.0, "{:?}", track.mean);
    assert_eq!(tracker.tracks().count(), 1, "no second track beside it");
}

#[test]
fn a_track_goes_with_a_background_that_turns() {
    let mut tracker = following();
    let turn = 0.02;
    // Displacement that ends at (x, y), relative to the middle: (x, y) less itself turned back.
    let mut background = GlobalMotion::still(SIDE, SIDE);
    let half = SIDE as f64 / 2.0;
    let (sin, cos) = f64::sin_cos(turn);
    background.coefficients =
        [0.0, half * (1.0 - cos), -half * sin, 0.0, half * sin, half * (1.0 - cos), 0.0, 0.0];
    let still = seen(0.0, 0.0, [0.0, 0.0], 0.9);
    let middle = (SIDE as f64 - 1.0) / 2.0;
    let before = tracker.target().map(|track| track.mean).unwrap();
    // It stands still on the background from now on.
    tracker.step(&Findings { background, ..findings((0.0, 0.0), &[still]) }, 1);
    let after = tracker.target().map(|track| track.mean).unwrap();
    let (x, y) = (before[0] - middle, before[1] - middle);
    let expected = (middle + x * cos - y * sin + before[2], middle + x * sin + y * cos + before[3]);
    assert!((after[0] - expected.0).hypot(after[1] - expected.1) < 0.1, "{after:?}, not {expected:?}");
}

#[test]
fn a_target_that_stays_away_is_lost() {
    let mut tracker = following();
    let mut lost = None;
    for n in 1..=TrackerParameters::default().coast_frames + 1 {
        tracker.step(&findings((0.0, 0.0), &[]), 1);
        if tracker.target().is_none() {
            lost = lost.or(Some(n));
        }
    }
    let Some(frames) = lost else { panic!("never lost") };
    assert!(frames > 6, "lost after {frames} frames");
    assert_eq!(tracker.tracks().count(), 0);
    // What comes back is somebody else.
    for i in 0..3 {
        let u = 260.0 + 3.0 * f64::from(i);
        tracker.step(&findings((0.0, 0.0), &[seen(u, 280.0, [3.0, 0.0], 0.9)]), 1);
    }
    assert!(tracker.target().is_some_and(|track| track.id > 1));
}

#[test]
fn coast_frames_ends_a_track_that_is_still_believed_in() {
    let parameters = TrackerParameters { coast_frames: 2, ..TrackerParameters::default() };
    let mut tracker = Tracker::new(&parameters);
    for _ in 0..6 {
        tracker.step(&findings((0.0, 0.0), &[seen(100.0, 100.0, [0.0, 1.0], 0.95)]), 1);
    }
    let alive: Vec<bool> = (0..3)
        .map(|_| {
            tracker.step(&findings((0.0, 0.0), &[]), 1);
            tracker.target().is_some()
        })
        .collect();
    assert_eq!(alive, [true, true, false]);
}

#[test]
fn frozen_frames_change_nothing_and_a_missing_pair_ends_all() {
    let mut tracker = following();
    let before = tracker.clone();
    tracker.step(&without_pair(Outcome::Frozen), 1);
    assert!(tracker == before, "a frozen frame has changed a track");
    let mut tracker = before.clone();
    tracker.step(&without_pair(Outcome::NoPair), 1);
    assert!(tracker.target().is_none() && tracker.tracks().count() == 0);
    // Numbers are not given twice.
    tracker.step(&findings((0.0, 0.0), &[seen(50.0, 50.0, [2.0, 0.0], 0.9)]), 1);
    assert!(tracker.tracks().all(|track| track.id > 1));
}

#[test]
fn a_moment_of_blindness_is_a_miss_and_not_the_end() {
    for outcome in [Outcome::Featureless, Outcome::Unexplained] {
        let mut tracker = following();
        let id = tracker.target().unwrap().id;
        tracker.step(&without_pair(outcome), 1);
        let track = tracker.target().unwrap();
        assert_eq!((track.id, track.state, track.misses), (id, TrackState::Coasting, 1), "{outcome:?}");
        for _ in 0..30 {
            tracker.step(&without_pair(outcome), 1);
        }
        assert!(tracker.target().is_none(), "{outcome:?}");
    }
}

#[test]
fn a_track_ends_in_blindness_of_any_length() {
    let mut tracker = following();
    tracker.step(&without_pair(Outcome::Unexplained), 1);
    assert_eq!(tracker.target().unwrap().misses, 1);
    tracker.step_after(&without_pair(Outcome::Unexplained), 1, u32::MAX);
    assert_eq!(tracker.tracks().count(), 0);
}

#[test]
fn a_track_goes_on_over_frames_that_were_passed_over() {
    // The background moves by (16, 0) a frame, the target by (3, 0) more; every third pair is seen.
    let mut tracker = Tracker::new(&TrackerParameters::default());
    let at = |frame: f64| 40.0 + 19.0 * frame;
    tracker.step(&findings((16.0, 0.0), &[seen(at(0.0), 60.0, [3.0, 0.0], 0.99)]), 1);
    for frame in [3.0, 6.0, 9.0] {
        tracker.step_after(&findings((16.0, 0.0), &[seen(at(frame), 60.0, [3.0, 0.0], 0.99)]), 1, 3);
        let track = tracker.target().unwrap();
        assert_eq!((track.id, track.misses), (1, 0), "frame {frame}");
        assert!((track.mean[0] - at(frame)).abs() < 1.0, "frame {frame}: {:?}", track.mean);
    }
    tracker.step_after(&findings((16.0, 0.0), &[]), 1, 4);
    assert_eq!(tracker.target().unwrap().misses, 4);
}

#[test]
fn a_stronger_second_target_does_not_take_over_while_the_first_is_seen() {
    let mut tracker = tracker();
    let mut first = None;
    for i in 0..40 {
        let i = f64::from(i);
        let weaker = seen(100.0 + 3.0 * i, 150.0, [3.0, 0.0], 0.7);
        let stronger = seen(400.0 - 4.0 * i, 350.0 - i, [-4.0, -1.0], 0.99);
        let both = [stronger, weaker];
        tracker.step(&findings((0.0, 0.0), if i < 5.0 { &both[1..] } else { &both }), 1);
        first = first.or(tracker.target().map(|track| track.id));
        if i > 10.0 {
            let Some(target) = tracker.target() else { panic!("lost at frame {i}") };
            assert_eq!(Some(target.id), first, "frame {i}");
            assert!((target.mean[0] - 100.0 - 3.0 * i).abs() < 2.0, "{:?}", target.mean);
        }
    }
    assert_eq!(tracker.tracks().filter(|track| track.state == TrackState::Confirmed).count(), 2);
    // When the first is gone, the second is the target.
    for i in 40..60 {
        let i = f64::from(i);
        tracker.step(&findings((0.0, 0.0), &[seen(400.0 - 4.0 * i, 350.0 - i, [-4.0, -1.0], 0.99)]), 1);
    }
    assert!(tracker.target().is_some_and(|track| Some(track.id) != first));
}

#[test]
fn no_more_tracks_than_there_is_room_for_and_no_confirmed_one_gives_way() {
    let mut tracker = following();
    let id = tracker.target().map(|track| track.id);
    for i in 0..10 {
        let crowd: Vec<Candidate> = (0..MAX_TARGETS)
            .map(|n| seen(40.0 + 100.0 * n as f64, 60.0 + 17.0 * f64::from(i), [0.0, 1.0], 0.3))
            .collect();
        tracker.step(&findings((0.0, 0.0), &crowd), 1);
        assert!(tracker.tracks().count() <= MAX_TRACKS);
        assert_eq!(tracker.target().map(|track| track.id), id, "frame {i}");
        if tracker.target().is_some_and(|track| track.misses > 4) {
            break;
        }
    }
}

#[test]
fn longer_intervals_give_the_same_velocity_per_frame() {
    let mut tracker = tracker();
    for i in 0..8 {
        let u = 100.0 + 6.0 * f64::from(i);
        // Every second frame: the candidate's motion is that of two.
        tracker.step(&findings((8.0, 0.0), &[seen(u + 8.0 * f64::from(i), 90.0, [6.0, 0.0], 0.9)]), 2);
    }
    let Some(track) = tracker.target() else { panic!("followed") };
    assert!((track.mean[2] - 3.0).abs() < 0.1, "{:?}", track.mean);
    assert!((track.velocity[0] - 7.0).abs() < 0.1, "{:?}", track.velocity);
}

#[test]
fn a_tracker_survives_being_written_and_read() {
    let tracker = following();
    let bytes = postcard::to_allocvec(&tracker).unwrap();
    let read: Tracker = postcard::from_bytes(&bytes).unwrap();
    assert!(read == tracker, "{} bytes", bytes.len());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(16))]

    #[test]
    fn covariances_stay_symmetric_and_positive(seed in any::<u64>()) {
        let mut random = Random(seed);
        let mut tracker = tracker();
        let mut checked = 0;
        for _ in 0..1000 {
            let mut within = |low: f64, high: f64| low + (high - low) * random.uniform();
            let target = tracker.tracks().next().map(|track| track.mean);
            let mut candidates = Vec::new();
            if let Some([u, v, ..]) = target
                && within(0.0, 1.0) < 0.6
            {
                let relative = [within(-9.0, 9.0), within(-9.0, 9.0)];
                candidates.push(seen(u + within(-4.0, 4.0), v + within(-4.0, 4.0), relative, 0.6));
            }
            let (u, v) = (within(-20.0, 532.0), within(-20.0, 532.0));
            let mut other = seen(u, v, [within(-20.0, 20.0), within(-20.0, 20.0)], within(0.0, 1.0));
            other.area_px = within(1.0, 9000.0);
            candidates.push(other);
            let pan = (within(-30.0, 30.0), within(-30.0, 30.0));
            let interval = [1, 1, 1, 2, 4][(within(0.0, 5.0) as usize).min(4)];
            tracker.step(&findings(pan, &candidates), interval);
            for track in tracker.tracks() {
                let p = Matrix4::from(track.covariance);
                let largest = p.amax();
                prop_assert!((p - p.transpose()).amax() <= 1e-9 * largest, "not symmetric: {largest}");
                let least = SymmetricEigen::new(p).eigenvalues.min();
                prop_assert!(least > 0.0, "eigenvalue {least}");
                prop_assert!(track.mean.iter().all(|value| value.is_finite()));
                prop_assert!((0.0..=1.0).contains(&track.existence), "existence {}", track.existence);
                checked += 1;
            }
        }
        prop_assert!(checked > 500, "{checked} covariances");
    }
}
