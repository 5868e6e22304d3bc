//! Tables for people.

use super::judge::Figures;
use super::overall;
use super::sweep::{Group, Plan, Row};

/// What the robust detector is to reach, on the scenarios that are not hard, at the size [`TARGET_SIZE`].
const TARGET_MODE: &str = "robust";
const TARGET_SIZE: usize = 512;
const LEAST_DETECTED: f64 = 0.99;
const MOST_FALSE_ALARMS: f64 = 0.01;
const MOST_ERROR_PX: f64 = 1.0;
const MOST_VELOCITY_ERROR_PX: f64 = 0.1;
/// ... and on each of them alone.
const LEAST_DETECTED_ANYWHERE: f64 = 0.9;

/// Everything, size by size, the totals at the end.
pub fn tables(plan: &Plan, rows: &[Row]) {
    println!(
        "found, wrong: share of the frame pairs with a moving target, %; px: median error of what was found"
    );
    for &size in &plan.sizes {
        for (group, title) in [
            (Group::WithTarget, "with a moving target"),
            (Group::Hard, "hard, not in the totals"),
            (Group::WithoutTarget, "nothing moves by itself: false alarms, % of the frame pairs"),
        ] {
            let rows: Vec<&Row> = rows.iter().filter(|r| r.size == size && r.group == group).collect();
            if !rows.is_empty() {
                println!("\n  {size} px, {title}");
                table(plan, &rows, group);
            }
        }
    }
    println!("\n  all but the hard ones");
    totals(plan, rows);
    let has_target_size = plan.sizes.contains(&TARGET_SIZE);
    if let Some(mode) = plan.modes.iter().position(|m| m.name == TARGET_MODE).filter(|_| has_target_size) {
        targets(rows, mode);
    }
}

fn table(plan: &Plan, rows: &[&Row], group: Group) {
    let empty = group == Group::WithoutTarget;
    let names: String = plan.modes.iter().map(|mode| format!("{:>21}", mode.name)).collect();
    println!("  {:<22}{:>6}{names}", "", "pairs");
    if !empty {
        println!(
            "  {:<28}{}",
            "",
            format!("{:>8}{:>6}{:>7}", "found", "wrong", "px").repeat(plan.modes.len())
        );
    }
    for row in rows {
        let all: Vec<Figures> = row.tallies.iter().map(|tally| tally.figures()).collect();
        let pairs = all.first().map_or(0, |f| if empty { f.empty_pairs } else { f.moving_pairs });
        let cells: String = all
            .iter()
            .map(|f| {
                if empty {
                    format!("{:>21}", percent(f.false_alarms))
                } else {
                    let (found, wrong) = (percent(f.detected), percent(f.wrong));
                    format!("{found:>8}{wrong:>6}{:>7}", number(f.error_px))
                }
            })
            .collect();
        println!("  {:<22}{pairs:>6}{cells}", row.name);
    }
}

fn totals(plan: &Plan, rows: &[Row]) {
    println!(
        "  {:<16}{:>4}{:>8}{:>8}{:>7}{:>14}{:>8}{:>12}{:>14}",
        "", "px", "pairs", "found", "wrong", "false alarms", "px", "px/frame", "us per frame"
    );
    for &size in &plan.sizes {
        for (k, mode) in plan.modes.iter().enumerate() {
            let f = overall(rows, k, Some(size));
            println!(
                "  {:<16}{size:>4}{:>8}{:>8}{:>7}{:>14}{:>8}{:>12}{:>14}",
                mode.name,
                f.pairs,
                percent(f.detected),
                percent(f.wrong),
                percent(f.false_alarms),
                number(f.error_px),
                number(f.velocity_error_px),
                f.us_per_frame.map_or_else(none, |us| format!("{us:.0}"))
            );
        }
    }
}

/// Whether the robust detector reaches what it is meant to.
fn targets(rows: &[Row], mode: usize) {
    let f = overall(rows, mode, Some(TARGET_SIZE));
    println!("\n  {TARGET_MODE} at {TARGET_SIZE} px is to");
    let least = |value: Option<f64>, bound: f64| value.map(|value| value >= bound);
    let most = |value: Option<f64>, bound: f64| value.map(|value| value <= bound);
    let (detected, anywhere) = (percent(Some(LEAST_DETECTED)), percent(Some(LEAST_DETECTED_ANYWHERE)));
    let weakest = weakest(rows, mode, TARGET_SIZE);
    let name = weakest.map_or_else(String::new, |(name, share)| of_scene(name, share));
    let weakest = weakest.map(|(_, share)| share);
    for (what, value, reached) in [
        (format!("find {detected} % or more"), percent(f.detected), least(f.detected, LEAST_DETECTED)),
        (
            format!("find {anywhere} % or more of each scenario"),
            percent(weakest) + &name,
            least(weakest, LEAST_DETECTED_ANYWHERE),
        ),
        (
            format!("raise {} % false alarms at most", percent(Some(MOST_FALSE_ALARMS))),
            percent(f.false_alarms),
            most(f.false_alarms, MOST_FALSE_ALARMS),
        ),
        (
            format!("be {MOST_ERROR_PX:.1} px off at most"),
            number(f.error_px),
            most(f.error_px, MOST_ERROR_PX),
        ),
        (
            format!("be {MOST_VELOCITY_ERROR_PX:.1} px/frame off at most"),
            number(f.velocity_error_px),
            most(f.velocity_error_px, MOST_VELOCITY_ERROR_PX),
        ),
    ] {
        let verdict = reached.map_or("not measured", |yes| if yes { "reached" } else { "MISSED" });
        println!("    {what:<40} {value:<22} {verdict}");
    }
}

/// The scenario of which least is found, hard ones apart, and how much that is.
pub fn weakest(rows: &[Row], mode: usize, size: usize) -> Option<(&'static str, f64)> {
    let of_size = rows.iter().filter(|row| row.group == Group::WithTarget && row.size == size);
    let shares = of_size.filter_map(|row| Some((row.name, row.tallies[mode].figures().detected?)));
    shares.min_by(|a, b| a.1.total_cmp(&b.1))
}

/// The name of the scenario in brackets, where not everything is found in it.
pub fn of_scene(name: &str, share: f64) -> String {
    if share < 1.0 { format!(" ({name})") } else { String::new() }
}

/// A share as %.
pub fn percent(share: Option<f64>) -> String {
    share.map_or_else(none, |share| format!("{:.1}", 100.0 * share))
}

/// A length or speed.
pub fn number(value: Option<f64>) -> String {
    value.map_or_else(none, |value| format!("{value:.2}"))
}

fn none() -> String {
    "-".to_owned()
}
