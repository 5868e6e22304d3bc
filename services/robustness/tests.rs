//! The judge, with values by hand.

use pursuit_scene::sequences::Truth;

use super::judge::{Answer, Figures, Tally, Verdict, judge};
use super::sweep::{Group, cases};

/// At (100, 60), 400 px², 4 px/frame to the right relative to a background of (1, 2).
const TRUTH: Truth = Truth {
    position: Some([100.0, 60.0]),
    centre: Some([100.0, 60.0]),
    area_px: 400.0,
    visible_share: 1.0,
    velocity: [5.0, 2.0],
    relative_velocity: [4.0, 0.0],
    background: [1.0, 2.0],
};

fn at(u: f64, v: f64) -> Option<Answer> {
    Some(Answer { u, v, vu: 5.0, vv: 2.0 })
}

#[test]
fn a_hit_is_half_a_target_and_two_percent_of_the_side_off_at_most() {
    // half of sqrt(400) is 10, 2 % of 200 are 4
    let hit = judge(&TRUTH, at(114.0, 60.0), 200);
    assert_eq!(hit, Some(Verdict::Hit { error_px: 14.0, velocity_error_px: 0.0 }));
    assert_eq!(judge(&TRUTH, at(114.1, 60.0), 200), Some(Verdict::Wrong));
    assert_eq!(judge(&TRUTH, at(100.0, 45.9), 200), Some(Verdict::Wrong));
    assert_eq!(judge(&TRUTH, None, 200), Some(Verdict::Missed));
}

#[test]
fn errors_are_lengths_and_velocities_those_in_the_picture() {
    let answer = Answer { u: 103.0, v: 56.0, vu: 5.0, vv: 0.5 };
    let hit = judge(&TRUTH, Some(answer), 200);
    assert_eq!(hit, Some(Verdict::Hit { error_px: 5.0, velocity_error_px: 1.5 }));
}

#[test]
fn a_target_at_the_border_is_not_asked_for() {
    for position in [[6.0, 60.0], [194.0, 60.0], [100.0, 5.0], [100.0, 195.0]] {
        let truth = Truth { position: Some(position), ..TRUTH };
        assert_eq!(judge(&truth, None, 200), None, "{position:?}");
    }
    let inside = Truth { position: Some([6.1, 193.9]), ..TRUTH };
    assert_eq!(judge(&inside, None, 200), Some(Verdict::Missed));
}

#[test]
fn slow_targets_are_not_asked_for_and_resting_ones_must_not_move_elsewhere() {
    let truth = |speed: f64| Truth { relative_velocity: [0.0, -speed], ..TRUTH };
    assert_eq!(judge(&truth(0.51), None, 200), Some(Verdict::Missed));
    assert_eq!(judge(&truth(0.5), at(100.0, 60.0), 200), None);
    assert_eq!(judge(&truth(0.1), at(100.0, 60.0), 200), None);
    assert_eq!(judge(&truth(0.09), at(120.0, 60.0), 200), Some(Verdict::FalseAlarm));
    // 6 % of 200 are 12: to know where one rests is no alarm
    assert_eq!(judge(&truth(0.09), at(111.0, 60.0), 200), None);
    assert_eq!(judge(&truth(0.0), None, 200), Some(Verdict::Quiet));
}

#[test]
fn without_target_every_answer_is_a_false_alarm_but_half_hidden_ones_are_not_judged() {
    let hidden = |area_px: f64| Truth { position: None, area_px, ..TRUTH };
    assert_eq!(judge(&hidden(0.0), at(10.0, 10.0), 200), Some(Verdict::FalseAlarm));
    assert_eq!(judge(&hidden(19.9), None, 200), Some(Verdict::Quiet));
    assert_eq!(judge(&hidden(20.0), at(10.0, 10.0), 200), None);
}

#[test]
fn shares_are_of_their_own_pairs_and_medians_of_the_hits() {
    let mut tally = Tally::default();
    for error_px in [1.0, 9.0, 2.0, 4.0] {
        tally.add(Some(Verdict::Hit { error_px, velocity_error_px: 10.0 * error_px }));
    }
    let mut other = Tally::default();
    let quiet = [Verdict::Quiet; 3].map(Some);
    for verdict in [Some(Verdict::Wrong), Some(Verdict::Missed), None, Some(Verdict::FalseAlarm)] {
        other.add(verdict);
    }
    quiet.into_iter().for_each(|verdict| other.add(verdict));
    [30.0, 10.0, 20.0].into_iter().for_each(|us| other.add_time(us));
    tally.merge(&other);
    let expected = Figures {
        pairs: 10,
        moving_pairs: 6,
        empty_pairs: 4,
        detected: Some(4.0 / 6.0),
        wrong: Some(1.0 / 6.0),
        false_alarms: Some(0.25),
        error_px: Some(3.0),
        velocity_error_px: Some(30.0),
        us_per_frame: Some(20.0),
    };
    assert_eq!(tally.figures(), expected);
}

#[test]
fn nothing_counted_gives_no_figure() {
    let figures = Tally::default().figures();
    assert_eq!((figures.pairs, figures.detected, figures.false_alarms), (0, None, None));
    assert_eq!((figures.error_px, figures.us_per_frame), (None, None));
}

#[test]
fn scenarios_are_taken_by_name_and_unknown_names_refused() {
    let groups = [Group::WithTarget, Group::WithoutTarget];
    let names = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>();
    let some = cases(&groups, &names(&["empty_pan", "pan"])).unwrap();
    assert_eq!(some.iter().map(|case| case.scenario.name).collect::<Vec<_>>(), ["pan", "empty_pan"]);
    assert_eq!(cases(&groups, &[]).unwrap().len(), 31 + 24);
    let refused = cases(&groups, &names(&["pan", "pam"])).err().unwrap();
    assert!(refused.contains("\"pam\"") && refused.contains("fast_pan"), "{refused}");
}
