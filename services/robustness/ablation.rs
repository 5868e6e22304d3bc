//! The robust detector with one of its parts changed at a time.

use pursuit_motion::{EvidenceParameters, MotionModel, RobustParameters};
use pursuit_runtime::exit;
use serde::Serialize;

use super::judge::Figures;
use super::modes::{CALIBRATED, Cut, Kind, Mode};
use super::print::{number, of_scene, percent, weakest};
use super::sweep::{Group, Row, sweep};
use super::{overall, plan};
use crate::cli::Experiment;
use crate::experiment::seeds_text;
use crate::up::write_json;

/// Sides of the frames, px.
const SIZES: [usize; 1] = [512];
/// The confidence is calibrated with all parts at work; the evidence means the same without it.
const PLAIN: Cut = Cut::Evidence(1.0);

/// What is left of the detector without a part.
#[derive(Serialize)]
struct Variant {
    name: &'static str,
    size: usize,
    #[serde(flatten)]
    figures: Figures,
    weakest_scene: Option<&'static str>,
    weakest_detected: Option<f64>,
    /// The same with every candidate an answer whose evidence is above 1.
    by_evidence: Figures,
}

/// Runs `pursuit experiment ablation`.
///
/// # Errors
/// In words: an unknown scenario, a size out of range, a file that cannot be written.
pub fn run(options: &Experiment) -> Result<u8, String> {
    #[derive(Serialize)]
    struct Published {
        variants: Vec<Variant>,
    }
    // Each variant twice: cut by confidence, then by evidence.
    let modes = variants().into_iter().flat_map(|(name, parameters)| {
        [CALIBRATED, PLAIN].map(|cut| Mode { name, kind: Kind::Robust(parameters, cut) })
    });
    let plan = plan(options, &[Group::WithTarget, Group::WithoutTarget], &SIZES, modes.collect())?;
    println!("the robust detector with one part changed at a time, seeds {}", seeds_text(options));
    println!("beside it, as the confidence was calibrated with all parts: cut at evidence 1 instead");
    let rows = sweep(&plan)?;
    let mut published = Published { variants: Vec::new() };
    for &size in &plan.sizes {
        print_head(size);
        for (pair, modes) in plan.modes.chunks_exact(2).enumerate() {
            let variant = variant(modes[0].name, size, &rows, 2 * pair);
            print_row(&variant);
            published.variants.push(variant);
        }
    }
    Ok(options.json.as_deref().map_or(exit::OK, |json| write_json(json, &published)))
}

fn variants() -> Vec<(&'static str, RobustParameters)> {
    let full = RobustParameters::default();
    let without_residual = EvidenceParameters { untuned: false, ..full.evidence };
    vec![
        ("full", full),
        ("translation", RobustParameters { model: MotionModel::Translation, ..full }),
        ("similarity", RobustParameters { model: MotionModel::Similarity, ..full }),
        ("affine", RobustParameters { model: MotionModel::Affine, ..full }),
        ("no light correction", RobustParameters { light: false, ..full }),
        ("no search", RobustParameters { search: false, ..full }),
        ("no competition", RobustParameters { competition: false, ..full }),
        ("one-sided centroid", RobustParameters { symmetric: false, ..full }),
        ("no turning target", RobustParameters { turn: false, ..full }),
        ("no residual channel", RobustParameters { evidence: without_residual, ..full }),
    ]
}

/// A variant whose mode cut by confidence has the number `mode`, and that cut by evidence the next.
fn variant(name: &'static str, size: usize, rows: &[Row], mode: usize) -> Variant {
    let weakest = weakest(rows, mode, size);
    Variant {
        name,
        size,
        figures: overall(rows, mode, Some(size)),
        weakest_scene: weakest.map(|(name, _)| name),
        weakest_detected: weakest.map(|(_, share)| share),
        by_evidence: overall(rows, mode + 1, Some(size)),
    }
}

fn print_head(size: usize) {
    println!("\n  {:<20}{:>39}{:>50}", format!("{size} px"), "confidence 0.5", "evidence 1");
    println!(
        "  {:<20}{:>8}{:>14}{:>7}{:>10}   {:<25}{:>8}{:>14}",
        "", "found", "false alarms", "px", "px/frame", "weakest scenario", "found", "false alarms"
    );
}

fn print_row(variant: &Variant) {
    let (f, plain) = (&variant.figures, &variant.by_evidence);
    let weakest = variant.weakest_scene.zip(variant.weakest_detected);
    let name = weakest.map_or_else(String::new, |(name, share)| of_scene(name, share));
    println!(
        "  {:<20}{:>8}{:>14}{:>7}{:>10}   {:<25}{:>8}{:>14}",
        variant.name,
        percent(f.detected),
        percent(f.false_alarms),
        number(f.error_px),
        number(f.velocity_error_px),
        percent(variant.weakest_detected) + &name,
        percent(plain.detected),
        percent(plain.false_alarms)
    );
}
