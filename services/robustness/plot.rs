//! The plot: a row for each scenario, a dot in it for each mode.

use std::fmt::Write as _;

use super::sweep::{Group, Plan, Row};
use crate::svg::{escape, head};

/// Width of the picture, px; its height follows the number of rows.
const WIDTH: f64 = 760.0;
/// From left to right: where the names end, where 0 % and 100 % are, px.
const NAMES_END: f64 = 196.0;
const SCALE: [f64; 2] = [212.0, 730.0];
/// Height of the head, of a row, of a block's title, px.
const HEAD: f64 = 64.0;
const ROW: f64 = 17.0;
const TITLE: f64 = 44.0;
/// Dots of a row lie so far below one another, px, as most would cover each other.
const STEP: f64 = 3.6;
const RADIUS: f64 = 2.6;
const COLOURS: [&str; 4] = ["#d55e00", "#0072b2", "#009e73", "#cc79a7"];

/// Detections and false alarms of all modes, at the first size of the plan.
pub fn svg(plan: &Plan, rows: &[Row]) -> String {
    let size = plan.sizes.first().copied().unwrap_or_default();
    let blocks = [
        (Group::WithTarget, "found, % of the frame pairs with a moving target"),
        (Group::Hard, "the same where detectors begin to fail"),
        (Group::WithoutTarget, "false alarms, % of the frame pairs without one"),
    ]
    .map(|(group, title)| {
        let rows = rows.iter().filter(|row| row.size == size && row.group == group);
        (title, group, rows.collect::<Vec<_>>())
    });
    let filled = || blocks.iter().filter(|(_, _, rows)| !rows.is_empty());
    let height = HEAD + filled().map(|(_, _, rows)| TITLE + ROW * rows.len() as f64).sum::<f64>() + 16.0;
    let mut svg = head((WIDTH, height), 16.0, &format!("What the detectors find, {size} px"));
    legend(plan, &mut svg);
    let mut top = HEAD;
    for (title, group, rows) in filled() {
        block(title, *group, rows, top, &mut svg);
        top += TITLE + ROW * rows.len() as f64;
    }
    svg.push_str("</svg>\n");
    svg
}

fn legend(plan: &Plan, svg: &mut String) {
    for (k, mode) in plan.modes.iter().enumerate() {
        let x = SCALE[0] + 130.0 * k as f64;
        let _ = writeln!(
            svg,
            "<circle cx=\"{x:.1}\" cy=\"48\" r=\"4\" fill=\"{}\"/>\
             <text class=\"ink\" x=\"{:.1}\" y=\"52\">{}</text>",
            colour(k),
            x + 10.0,
            escape(mode.name)
        );
    }
}

fn block(title: &str, group: Group, rows: &[&Row], top: f64, svg: &mut String) {
    let (first, end) = (top + TITLE, top + TITLE + ROW * rows.len() as f64);
    let _ = writeln!(
        svg,
        "<text class=\"ink\" x=\"{:.1}\" y=\"{:.1}\">{}</text>",
        SCALE[0],
        top + 20.0,
        escape(title)
    );
    for percent in [0, 20, 40, 60, 80, 100] {
        let x = place(f64::from(percent) / 100.0);
        let _ = writeln!(
            svg,
            "<line class=\"grid\" x1=\"{x:.1}\" x2=\"{x:.1}\" y1=\"{first:.1}\" y2=\"{end:.1}\"/>\
             <text class=\"ink\" x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"middle\" font-size=\"11\">{percent}</text>",
            first - 5.0
        );
    }
    for (k, row) in rows.iter().enumerate() {
        let y = first + ROW * (k as f64 + 0.5);
        let _ = writeln!(
            svg,
            "<line class=\"grid\" x1=\"{NAMES_END}\" x2=\"{:.1}\" y1=\"{line:.1}\" y2=\"{line:.1}\" \
             stroke-width=\"0.5\"/><text class=\"ink\" x=\"{NAMES_END}\" y=\"{:.1}\" text-anchor=\"end\" \
             font-size=\"12\">{}</text>",
            SCALE[1],
            y + 4.0,
            escape(row.name),
            line = y + 0.5 * ROW
        );
        dots(row, group, y, svg);
    }
}

fn dots(row: &Row, group: Group, y: f64, svg: &mut String) {
    let middle = 0.5 * (row.tallies.len() as f64 - 1.0);
    for (k, tally) in row.tallies.iter().enumerate() {
        let figures = tally.figures();
        let share = if group == Group::WithoutTarget { figures.false_alarms } else { figures.detected };
        if let Some(share) = share {
            let (x, y) = (place(share), y + STEP * (k as f64 - middle));
            let _ =
                writeln!(svg, "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{RADIUS}\" fill=\"{}\"/>", colour(k));
        }
    }
}

fn place(share: f64) -> f64 {
    SCALE[0] + share * (SCALE[1] - SCALE[0])
}

fn colour(mode: usize) -> &'static str {
    COLOURS[mode % COLOURS.len()]
}
