//! `pursuit experiment change` and `outliers`: what they write, and what they refuse.

mod support;

use serde_json::Value;
use support::{Place, json};

/// An experiment with one seed; its figures.
fn figures(place: &Place, arguments: &[&str]) -> Value {
    let file = place.file("figures.json");
    let output = support::pursuit()
        .args(["experiment"])
        .args(arguments)
        .args(["--seeds", "1", "--first-seed", "104", "--json"])
        .arg(&file)
        .arg("--plots")
        .arg(place.file("plots"))
        .output()
        .expect("pursuit experiment runs");
    assert!(output.status.success(), "{}", support::text(&output).1);
    json(&file)
}

fn is_spread(value: &Value) -> bool {
    ["p50", "p90"].iter().all(|key| value[key].as_f64().is_some_and(|cm| cm > 0.0))
}

#[test]
fn a_change_is_told_as_moves_and_as_windows_of_time() {
    let place = Place::new();
    let figures = figures(&place, &["change", "--scenes", "turn-20"]);
    let learning = figures["learning"].as_array().expect("changes in training");
    assert_eq!(learning.iter().map(|row| &row["when"]).collect::<Vec<_>>(), ["start", "move"]);
    assert!(learning[0]["before_cm"].is_null() && is_spread(&learning[1]["before_cm"]));
    for row in learning {
        assert_eq!(row["change"], "turn-20");
        assert!(
            row["after_cm"].as_array().is_some_and(|all| all.len() == 5 && all.iter().all(is_spread)),
            "{row}"
        );
        assert!(row["moves_to_3cm"].is_object() && row["moves_to_1cm"].is_object());
    }
    let tracking = figures["tracking"].as_array().expect("changes while following");
    assert_eq!(tracking.len(), 1);
    assert!(tracking[0]["rms_cm"].as_array().is_some_and(|all| all.len() == 5 && all.iter().all(is_spread)));
    for share in ["out_of_view_share", "recovered_share"] {
        assert!(tracking[0][share].as_f64().is_some_and(|share| (0.0..=1.0).contains(&share)));
    }
    for plot in ["start", "move", "tracking"] {
        assert!(place.file("plots").join(format!("experiment-change-{plot}.svg")).exists());
    }
}

#[test]
fn outliers_come_in_the_share_that_was_asked_for() {
    let place = Place::new();
    let figures = figures(&place, &["outliers", "--set", "learner.training_moves=4"]);
    let outliers = figures["outliers"].as_array().expect("shares");
    assert_eq!(
        outliers.iter().map(|row| row["glare_share"].as_f64()).collect::<Vec<_>>(),
        [Some(0.0), Some(0.05), Some(0.15), Some(0.3)]
    );
    for row in outliers {
        let (asked, seen) =
            (row["glare_share"].as_f64().expect("a share"), row["seen_share"].as_f64().expect("a share"));
        assert!((asked - seen).abs() <= 0.5 * asked, "{row}");
        assert!(is_spread(&row["final_cm"]), "{row}");
    }
    assert!(place.file("plots").join("experiment-outliers.svg").exists());
}

#[test]
fn changes_and_options_that_do_not_exist_are_refused_by_name() {
    let refused = |arguments: &[&str]| {
        let output = support::pursuit().arg("experiment").args(arguments).output().expect("it runs");
        assert_eq!(output.status.code(), Some(64), "{}", support::text(&output).1);
        support::text(&output).1
    };
    assert!(refused(&["change", "--scenes", "turn-21"]).contains("turn-20"));
    assert!(refused(&["outliers", "--scenes", "turn-20"]).contains("--scenes"));
    assert!(refused(&["change", "--sizes", "256"]).contains("--sizes"));
}
