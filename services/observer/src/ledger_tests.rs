//! Tests of the ledger.

use super::*;
use proptest::prelude::*;
use pursuit_messages::{ImageShape, Stage};
use std::collections::BTreeMap;

fn stamp(frame: u64, hops: usize) -> Stamp {
    let stages = [Stage::Expose, Stage::Votes, Stage::Segment, Stage::Learn, Stage::Drive];
    (0..hops).fold(Stamp::new(1, frame, frame * 1000, ImageShape::grey(8, 8)), |stamp, hop| {
        let begin = frame * 1000 + hop as u64 * 10;
        stamp.extended(HOPS[hop], stages[hop], begin, begin + 5)
    })
}

fn fates(messages: &[(u64, usize)], restart_after: Option<(usize, Service)>) -> (Vec<(u64, Fate)>, Sums) {
    let (mut ledger, mut ended) = (Ledger::default(), Vec::new());
    let mut settled = |journey: &Journey, fate| ended.push((journey.stamp.frame, fate));
    for (number, (frame, hop)) in messages.iter().enumerate() {
        ledger.take(*hop, &stamp(*frame, hop + 1), 0, &mut settled);
        if let Some((_, service)) = restart_after.filter(|(after, _)| *after == number) {
            ledger.restarted(service);
        }
    }
    ledger.finish(&mut settled);
    (ended, ledger.sums())
}

#[test]
fn a_frame_that_a_newer_one_overtook_names_it() {
    let (ended, sums) = fates(&[(0, 4), (1, 0), (2, 0), (2, 1), (2, 4)], None);
    assert_eq!(ended[1], (1, Fate::Superseded { hop: 1, by: 2 }));
    assert_eq!((sums.acted, sums.superseded, sums.captured), (2, 1, 3));
}

#[test]
fn a_frame_that_a_crash_took_is_lost() {
    let (ended, _) = fates(&[(0, 4), (1, 0), (2, 4)], Some((1, Service::Vision)));
    assert_eq!(ended[1], (1, Fate::Lost { hop: 1, restarted: true }));
}

#[test]
fn a_late_message_of_an_earlier_hop_changes_nothing() {
    let (ended, _) = fates(&[(0, 4), (0, 1), (1, 0), (1, 4), (1, 2)], None);
    assert_eq!(ended, [(0, Fate::Acted), (1, Fate::Acted)]);
}

#[test]
fn a_frame_that_outlived_a_crash_says_so() {
    let (mut ledger, mut restarted) = (Ledger::default(), Vec::new());
    let mut settled = |journey: &Journey, fate| restarted.push((fate, journey.restarted_at));
    ledger.take(0, &stamp(0, 1), 0, &mut settled);
    ledger.restarted(Service::Vision);
    ledger.take(4, &stamp(0, 5), 0, &mut settled);
    assert_eq!(restarted, [(Fate::Acted, Some(1))], "and it is final at once");
}

#[test]
fn a_refused_set_point_is_dropped_and_hold_is_not() {
    let (mut ledger, mut ended) = (Ledger::default(), Vec::new());
    for (frame, refusal) in [(0, 3), (1, 1), (2, 0)] {
        ledger.take(4, &stamp(frame, 5), refusal, &mut |_, _| {});
    }
    ledger.finish(&mut |_, fate| ended.push(fate));
    assert_eq!(ended, [Fate::Dropped { hop: 4, reason: 3 }, Fate::Acted, Fate::Acted]);
}

proptest! {
    #[test]
    fn every_frame_ends_in_exactly_one_state_whatever_comes(
        messages in prop::collection::vec((0_u64..200, 0_usize..5), 1..600),
        restarts in prop::option::of((0_usize..600, 0_usize..5)),
    ) {
        let restart = restarts.map(|(after, hop)| (after, HOPS[hop]));
        let (ended, sums) = fates(&messages, restart);
        prop_assert!(sums.agree(), "{sums:?}");
        prop_assert_eq!(ended.len() as u64, sums.captured - sums.open);
        let mut times = BTreeMap::new();
        ended.iter().for_each(|(frame, _)| *times.entry(*frame).or_insert(0) += 1);
        prop_assert!(times.values().all(|times| *times == 1));
        for (frame, fate) in ended {
            if let Fate::Superseded { by, .. } = fate {
                prop_assert!(by > frame);
            }
        }
    }
}
