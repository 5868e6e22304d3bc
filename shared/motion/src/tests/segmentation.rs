//! From hand-made vote fields to targets.

use super::*;

/// A 16 x 16 grid of 32 px cells, shifted by (6, 3).
fn summary() -> VoteSummary {
    VoteSummary {
        valid: true,
        columns: 16,
        rows: 16,
        cell_px: 32.0,
        shift: (6, 3),
        passes: 1,
        coherence: [0.0; FIELDS],
        coherence_sum: 0.0,
        background: (6.0, 3.0),
    }
}

/// Fields of weak noise with the votes (label, column, row, vote) on top.
fn fields(votes: &[(usize, usize, usize, f32)]) -> Box<Fields> {
    let mut random = Random(5);
    let mut fields = no_fields();
    for field in fields.iter_mut() {
        field[..256].fill_with(|| 0.1 * random.normal() as f32);
    }
    for &(label, x, y, vote) in votes {
        fields[label - 1][y * 16 + x] = vote;
    }
    fields
}

fn segment_fields(fields: &Fields, parameters: &Parameters) -> Segmentation {
    segment(fields, &summary(), parameters, &mut SegmentScratch::new())
}

#[test]
fn position_velocity_and_area_are_those_of_the_blob() {
    // Two cells vote for +x at 4 px/frame (label 7), one of them twice as loud.
    let fields = fields(&[(7, 4, 9, 10.0), (7, 5, 9, 20.0)]);
    let found = segment_fields(&fields, &Parameters::default());
    let target = found.target.unwrap();
    let centre = (4.5 * 10.0 + 5.5 * 20.0) / 30.0 * 32.0;
    assert!((target.u - (centre + 2.0)).abs() < 0.5, "half the displacement is added: {target:?}");
    assert!((target.v - 9.5 * 32.0).abs() < 0.5, "{target:?}");
    assert!((target.vu - 10.0).abs() < 0.5 && (target.vv - 3.0).abs() < 0.5, "{target:?}");
    assert_eq!(target.area_px, 2.0 * 32.0 * 32.0);
    assert_eq!(target.confidence, 1.0 - 3.0 / target.contrast);
    assert!(found.background.0 == 6.0 && found.background.1 == 3.0, "{:?}", found.background);
}

#[test]
fn a_negative_vote_moves_the_other_way() {
    let fields = fields(&[(12, 8, 8, -15.0), (12, 8, 9, -15.0)]);
    let target = segment_fields(&fields, &Parameters::default()).target.unwrap();
    assert!((target.vv - (3.0 - 8.0)).abs() < 0.7, "{target:?}");
    assert!((target.v - (9.0 * 32.0 - 4.0)).abs() < 0.7, "{target:?}");
}

#[test]
fn what_is_larger_than_a_target_may_be_is_none() {
    let mut large = Vec::new();
    for i in 0..25 {
        large.push((3, 2 + i % 5, 2 + i / 5, 5.0));
    }
    let found = segment_fields(&fields(&large), &Parameters::default()).target;
    let at_block = |t: &Detection| t.u < 8.0 * 32.0 && t.v < 8.0 * 32.0 && t.contrast > 6.0;
    assert!(!found.is_ok_and(|target| at_block(&target)), "{found:?}");
    let found = segment_fields(&fields(&large[..24]), &Parameters::default()).target;
    assert!(found.is_ok_and(|target| at_block(&target)), "{found:?}");
}

#[test]
fn the_cut_on_the_contrast_refuses_the_best_blob() {
    let fields = fields(&[(7, 4, 9, 10.0)]);
    let cut = Parameters { contrast_cut: 1e6, ..Parameters::default() };
    let found = segment_fields(&fields, &cut);
    assert!(matches!(found.target, Err(NoTarget::LowContrast(contrast)) if contrast > 10.0), "{found:?}");
}

#[test]
fn blobs_touch_at_corners() {
    let fields = fields(&[(7, 4, 4, 10.0), (7, 5, 5, 10.0), (7, 6, 4, 10.0)]);
    let target = segment_fields(&fields, &Parameters::default()).target.unwrap();
    assert_eq!(target.area_px, 3.0 * 32.0 * 32.0);
}

#[test]
fn the_loudest_of_three_blobs_is_the_target_and_a_fourth_does_not_count() {
    // Contrast ranks single cells alike within a field; the other fields' blobs are quieter.
    let fields = fields(&[(7, 2, 2, 10.0), (8, 2, 2, 9.0), (11, 12, 12, 9.5), (12, 7, 7, 1.0)]);
    let target = segment_fields(&fields, &Parameters::default()).target.unwrap();
    assert!((target.u - 2.5 * 32.0).abs() < 8.0 && (target.v - 2.5 * 32.0).abs() < 8.0, "{target:?}");
}

#[test]
fn the_background_leaves_the_target_out_and_is_damped() {
    let mut fields = no_fields();
    fields[2][..256].fill(1.0);
    fields[11][100] = -50.0;
    let mut summary = summary();
    let segment = |summary: &VoteSummary, floor| {
        let parameters = Parameters { floor, ..Parameters::default() };
        segment(&fields, summary, &parameters, &mut SegmentScratch::new()).background
    };
    summary.coherence_sum = 0.5;
    assert_eq!(segment(&summary, 1.0), (7.0, 3.0), "half of the 2 px/frame that label 3 votes for");
    assert_eq!(segment(&summary, 0.0), (8.0, 3.0), "literal: all of it");
    summary.coherence_sum = 2.0;
    assert_eq!(segment(&summary, 1.0), (8.0, 3.0));
}
