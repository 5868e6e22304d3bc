//! Figures over seeds, and how tables show them.

use crate::report::percentile;
use serde::Serialize;

/// Median and 90th percentile over seeds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Spread {
    /// Median.
    pub p50: f64,
    /// 90th percentile.
    pub p90: f64,
}

/// A count that some seeds may never reach: those count as infinite, shown as `null`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Moves {
    /// Median.
    pub p50: Option<u32>,
    /// 90th percentile.
    pub p90: Option<u32>,
}

/// Of the values of all seeds.
pub fn spread(values: impl Iterator<Item = f64>) -> Spread {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    Spread { p50: percentile(&values, 0.5), p90: percentile(&values, 0.9) }
}

/// Of the counts of all seeds; `None` is never.
pub fn moves(values: impl Iterator<Item = Option<u32>>) -> Moves {
    let never = f64::INFINITY;
    let Spread { p50, p90 } = spread(values.map(|value| value.map_or(never, f64::from)));
    let finite = |value: f64| value.is_finite().then_some(value as u32);
    Moves { p50: finite(p50), p90: finite(p90) }
}

/// As a table shows them.
pub fn moves_text(moves: Moves) -> String {
    let text = |value: Option<u32>| value.map_or_else(|| "never".to_owned(), |value| value.to_string());
    format!("{} / {}", text(moves.p50), text(moves.p90))
}

/// As a table shows it.
pub fn spread_text(spread: Spread, unit: &str) -> String {
    format!("{:.2} / {:.2} {unit}", spread.p50, spread.p90)
}
