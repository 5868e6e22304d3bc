//! One line per frame: JSON, or a row of a table with a summary at its end.

use std::io::{self, Write};
use std::time::Duration;

use pursuit_images::GreyImage;
use serde::Serialize;

use super::detector::{self, Answer, Times};

/// One line of `--json`; this is a contract with whoever reads it.
#[derive(Serialize)]
struct Line<'a> {
    frame: usize,
    file: &'a str,
    target: Option<Target>,
    /// The best answer of this pair alone, sure or not.
    pair: Option<Target>,
    background: Background,
    us: Microseconds,
}

#[derive(Serialize)]
struct Target {
    u: f64,
    v: f64,
    vu: f64,
    vv: f64,
    confidence: f64,
    area_px: f64,
    /// uu, uv, vv, px²; null where it is not known.
    position_covariance: Option<[f64; 3]>,
    /// px/frame; null where it is not known.
    velocity_sd: Option<f64>,
    /// Number of the track, null where it is one pair's answer.
    track: Option<u32>,
    /// Whether it is carried on without being seen in this frame.
    coasting: bool,
}

#[derive(Serialize)]
struct Background {
    vu: f64,
    vv: f64,
}

#[derive(Serialize)]
struct Microseconds {
    pyramid: f64,
    votes: f64,
    compensation: f64,
    segmentation: f64,
}

/// An object.
pub fn write_json(out: &mut impl Write, frame: usize, file: &str, answer: &Answer) -> io::Result<()> {
    let target = answer.target.as_ref().ok().map(printed);
    let pair = answer.pair.as_ref().map(printed);
    let background = Background { vu: rounded(answer.background.0), vv: rounded(answer.background.1) };
    let Times { pyramid, votes, compensation, segmentation } = answer.times;
    let us = Microseconds {
        pyramid: microseconds(pyramid),
        votes: microseconds(votes),
        compensation: microseconds(compensation),
        segmentation: microseconds(segmentation),
    };
    serde_json::to_writer(&mut *out, &Line { frame, file, target, pair, background, us })?;
    writeln!(out)
}

fn printed(target: &detector::Target) -> Target {
    Target {
        u: rounded(target.u),
        v: rounded(target.v),
        vu: rounded(target.vu),
        vv: rounded(target.vv),
        confidence: rounded(target.confidence),
        area_px: rounded(target.area_px),
        position_covariance: target.uncertainty.map(|(covariance, _)| covariance.map(rounded)),
        velocity_sd: target.uncertainty.map(|(_, sd)| rounded(sd)),
        track: target.track,
        coasting: target.coasting,
    }
}

/// To three decimals, without a negative zero.
fn rounded(value: f64) -> f64 {
    assert!(value.is_finite(), "the detector gave {value}, which is not a number");
    (value * 1000.0).round() / 1000.0 + 0.0
}

/// To one decimal, without a negative zero.
fn tenths(value: f64) -> f64 {
    (value * 10.0).round() / 10.0 + 0.0
}

fn microseconds(time: Duration) -> f64 {
    rounded(time.as_nanos() as f64 / 1000.0)
}

/// Width of the column of file names; longer names push their row to the right.
const NAME_COLUMNS: usize = 16;

/// What stands above the rows.
pub fn write_head(out: &mut impl Write, frame: &GreyImage) -> io::Result<()> {
    let (width, height) = (frame.width, frame.height);
    writeln!(out, "images of {width}x{height} px; positions in px, velocities in px/frame")?;
    writeln!(
        out,
        "frame {:NAME_COLUMNS$} {:>8} {:>8} {:>7} {:>7} {:>5} {:>7} {:>8} {:>8} {:>7}",
        "file", "u", "v", "vu", "vv", "conf", "area", "scene vu", "scene vv", "us"
    )
}

/// A row.
pub fn write_row(out: &mut impl Write, frame: usize, file: &str, answer: &Answer) -> io::Result<()> {
    write!(out, "{frame:5} {file:NAME_COLUMNS$} ")?;
    match &answer.target {
        Ok(detector::Target { u, v, vu, vv, confidence, area_px, .. }) => {
            let (vu, vv) = (tenths(*vu), tenths(*vv));
            write!(out, "{u:8.1} {v:8.1} {vu:7.1} {vv:7.1} {confidence:5.2} {area_px:7.0}")?;
        }
        Err(_) => write!(out, "{:>8} {:>8} {:>7} {:>7} {:>5} {:>7}", "-", "-", "-", "-", "-", "-")?,
    }
    let (vu, vv) = (tenths(answer.background.0), tenths(answer.background.1));
    write!(out, " {vu:8.1} {vv:8.1} {:7.0}", microseconds(answer.times.total()))?;
    match &answer.target {
        Ok(_) => writeln!(out),
        Err(reason) => writeln!(out, "  {reason}"),
    }
}

/// What the last line of the table says.
#[derive(Default)]
pub struct Summary {
    pairs: usize,
    found: usize,
    frames: usize,
    total: Times,
}

impl Summary {
    /// Counts a frame.
    pub fn add(&mut self, answer: &Answer) {
        self.pairs += usize::from(self.frames > 0);
        self.frames += 1;
        self.found += usize::from(answer.target.is_ok());
        let Times { pyramid, votes, compensation, segmentation } = answer.times;
        self.total.pyramid += pyramid;
        self.total.votes += votes;
        self.total.compensation += compensation;
        self.total.segmentation += segmentation;
    }

    /// Writes the last lines.
    pub fn write(&self, out: &mut impl Write) -> io::Result<()> {
        let mean = |time: Duration| microseconds(time) / self.frames as f64;
        let Times { pyramid, votes, compensation, segmentation } = self.total;
        writeln!(out, "a target in {} of {} pairs", self.found, self.pairs)?;
        writeln!(
            out,
            "on average {:.0} us a frame: pyramid {:.0}, votes {:.0}, compensation {:.0}, segmentation {:.0}",
            mean(self.total.total()),
            mean(pyramid),
            mean(votes),
            mean(compensation),
            mean(segmentation),
        )
    }
}
