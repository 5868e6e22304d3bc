//! Robust mode: the paper's votes, with the camera's motion compensated to a fraction of a pixel and the
//! evidence weighed so that it means the same in every scene (design notes on vision, section 6).
//!
//! ```text
//! pair ─► pyramids ─► search ─► global motion ◄─► local gain        fit, level by level
//!                                     │
//!               older levels ─► warped older levels ─► votes / norms, residual / gradient ─► evidence
//!                                                                                            │
//!               target, velocity, covariance ◄─ competition of motions ◄─ blobs over the threshold
//! ```

pub(crate) mod competition;
pub(crate) mod confidence;
pub(crate) mod evidence;
pub(crate) mod fit;
pub(crate) mod gain;
pub mod model;
pub mod parameters;
pub(crate) mod patch;
pub(crate) mod search;
pub(crate) mod warp;

use competition::{Competition, LevelPair, MAX_CANDIDATES, MAX_PATCH, Winner};
use evidence::{Evidence, Map};
use fit::{Histogram, histogram, mean_residual, moments, residual_scale};
use gain::Gain;
use model::GlobalMotion;
use parameters::RobustParameters;
use patch::{Place, RUN};
use search::{MAX_SHORTER, Search};
use warp::{Span, warp};

use crate::blobs::Flood;
use crate::cells::MAX_CELLS;
use crate::compensation::NOMINAL_VELOCITIES;
use crate::engine::{EngineError, Fields, Older, Part, Probe};
use crate::image::{Image, MAX_SIDE, MIN_SIDE};
use crate::parameters::Smoothing;
use crate::pyramid::{LEVELS, Level, Pyramid, halve_level};

/// Targets that are told of one pair at most.
pub const MAX_TARGETS: usize = 4;
/// The fit does not begin on levels whose shorter side is below this.
const LEAST_SIDE: usize = 24;
/// Gauss-Newton steps on the coarsest level, the one below it, the finest.
const STEPS: [usize; LEVELS] = [1, 3, 4];

/// Blobs up to this, level px, are looked at closely.
const SMALL: i32 = 16;

/// A mask that explains less than this is noise, and its patch does not grow.
const WORTH_GROWING: f32 = 0.3;
/// Evidence below this share of the strongest is not looked at.
const LEAST_OF_BEST: f64 = 0.35;

/// Something that moves on its own.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Candidate {
    /// Position in the newer frame, px from the centre of the top-left pixel to the right.
    pub u: f64,
    /// As `u`, downward.
    pub v: f64,
    /// Displacement in the image over the pair, px.
    pub vu: f64,
    /// As `vu`, downward.
    pub vv: f64,
    /// Displacement relative to the background, px.
    pub relative: [f64; 2],
    /// Area, px².
    pub area_px: f64,
    /// Probability that this is a target, 0..1; calibrated so that 0.5 is the cut for a single pair.
    pub confidence: f64,
    /// Covariance of the position: uu, uv, vv, px².
    pub position_covariance: [f64; 3],
    /// Standard deviation of the velocity in each direction, px per pair.
    pub velocity_sd: f64,
    /// Largest evidence over its threshold: 1 is at the threshold.
    pub evidence: f64,
    /// The same of the normalised votes alone.
    pub votes_evidence: f64,
    /// The same of the residual alone.
    pub residual_evidence: f64,
    /// Largest evidence over its threshold anywhere else in the image.
    pub rival: f64,
    /// Share of the cells elsewhere whose evidence is above half of its threshold.
    pub clutter: f64,
    /// Share of the residual that the target's motion explains, 0..1; 0 without competition.
    pub explained: f64,
    /// Second moments of the extent: uu, uv, vv, px².
    pub spread: [f64; 3],
}

/// The answer to one pair.
#[derive(Clone, Debug, PartialEq)]
pub struct Findings {
    /// Why there is nothing to say, where there is not.
    pub outcome: Outcome,
    /// The background's motion.
    pub background: GlobalMotion,
    /// What moves on its own, strongest evidence first.
    pub candidates: [Candidate; MAX_TARGETS],
    /// How many of them there are.
    pub count: usize,
    /// The largest evidence over its threshold, also where it is below 1.
    pub evidence: f64,
}

impl Findings {
    /// The candidate that is most probably a target, if one is so with at least `confidence`.
    pub fn target(&self, confidence: f64) -> Option<&Candidate> {
        let best = self.candidates[..self.count].iter().max_by(|a, b| a.confidence.total_cmp(&b.confidence));
        best.filter(|candidate| candidate.confidence >= confidence)
    }
}

/// How far the detector came with a pair.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// All the way.
    Answered,
    /// There was no pair of frames.
    NoPair,
    /// Both frames are the same to the last bit: the camera has stopped sending, or nothing is alive.
    Frozen,
    /// The frames have no structure that could move.
    Featureless,
}

/// The robust detector for frames of one shape. After construction nothing is allocated, and nothing of one
/// pair is remembered for the next but the pyramid of its newer frame.
#[derive(Clone, Debug)]
pub struct RobustEngine {
    size: (usize, usize),
    parameters: RobustParameters,
    newer: Pyramid,
    older: Pyramid,
    warped: [Level; LEVELS],
    spans: [Vec<Span>; LEVELS],
    holds_newer: bool,
    coarsest: usize,
    thumbnails: [Vec<Level>; 2],
    sums: Vec<u16>,
    search: Search,
    gain: Gain,
    counts: Box<Histogram>,
    evidence: Evidence,
    flood: Flood,
    blob: Vec<usize>,
    competition: Competition,
}

impl RobustEngine {
    /// An engine for frames of `width` x `height` px.
    ///
    /// # Errors
    /// A side outside [`MIN_SIDE`]`..=`[`MAX_SIDE`].
    pub fn new(
        width: usize,
        height: usize,
        parameters: &RobustParameters,
    ) -> Result<RobustEngine, EngineError> {
        let sides = MIN_SIDE..=MAX_SIDE;
        if !sides.contains(&width) || !sides.contains(&height) {
            return Err(EngineError::Size { width, height });
        }
        let pyramid = Pyramid::new(width, height, Smoothing::Binomial);
        let shorter = |level: &Level| level.width.min(level.height);
        let coarsest = (0..LEVELS).rev().find(|&k| shorter(&pyramid.levels[k]) >= LEAST_SIDE).unwrap_or(0);
        let mut thumbnails = Vec::new();
        let (mut w, mut h) = (pyramid.levels[coarsest].width, pyramid.levels[coarsest].height);
        while w.min(h) > MAX_SHORTER {
            (w, h) = (w.div_ceil(2), h.div_ceil(2));
            thumbnails.push(Level::new(w, h));
        }
        let [first, _, third] = &pyramid.levels;
        let evidence = Evidence::new(first.width, first.height, parameters.evidence);
        let cells = evidence.maps[0].values.len();
        Ok(RobustEngine {
            size: (width, height),
            parameters: *parameters,
            warped: pyramid.levels.clone(),
            spans: std::array::from_fn(|k| vec![(0, 0); pyramid.levels[k].height]),
            holds_newer: false,
            coarsest,
            thumbnails: [thumbnails.clone(), thumbnails],
            sums: vec![0; width + 2 * RUN],
            search: Search::new(w, h),
            gain: Gain::new(third.width, third.height, first.width),
            counts: histogram(),
            flood: Flood::new(cells),
            blob: Vec::with_capacity(cells),
            evidence,
            competition: Competition::new(),
            newer: pyramid.clone(),
            older: pyramid,
        })
    }

    /// What moves on its own between the two frames.
    ///
    /// # Panics
    /// If a frame is not of the engine's shape.
    pub fn detect(&mut self, older: Older<'_>, newer: Image<'_>, probe: &mut impl Probe) -> Findings {
        let pair = self.build_pyramids(older, &newer);
        probe.ended(Part::Pyramid);
        let mut findings = Findings {
            outcome: Outcome::Answered,
            background: GlobalMotion::still(self.size.0, self.size.1),
            candidates: [Candidate::default(); MAX_TARGETS],
            count: 0,
            evidence: 0.0,
        };
        if !pair {
            return Findings { outcome: Outcome::NoPair, ..findings };
        }
        if (0..LEVELS).rev().all(|k| self.older.levels[k].values == self.newer.levels[k].values) {
            return Findings { outcome: Outcome::Frozen, ..findings };
        }
        let Some(background) = self.fit() else {
            return Findings { outcome: Outcome::Featureless, ..findings };
        };
        findings.background = background;
        self.compensate(&background);
        probe.ended(Part::Compensation);
        self.evidence.measure(&self.warped, &self.newer.levels, &self.spans);
        probe.ended(Part::Votes);
        self.find_candidates(&mut findings);
        probe.ended(Part::Competition);
        findings
    }

    /// Brings both pyramids up to date; whether there is a pair.
    fn build_pyramids(&mut self, older: Older<'_>, newer: &Image<'_>) -> bool {
        self.assert_shape(newer);
        let pair = match older {
            Older::Missing => false,
            Older::LastNewer(image) if self.holds_newer => {
                self.assert_shape(&image);
                std::mem::swap(&mut self.older, &mut self.newer);
                self.thumbnails.swap(0, 1);
                true
            }
            Older::LastNewer(image) | Older::Frame(image) => {
                self.assert_shape(&image);
                self.older.build(&image, (0, 0));
                make_thumbnails(&self.older.levels[self.coarsest], &mut self.thumbnails[0], &mut self.sums);
                true
            }
        };
        self.newer.build(newer, (0, 0));
        make_thumbnails(&self.newer.levels[self.coarsest], &mut self.thumbnails[1], &mut self.sums);
        self.holds_newer = true;
        pair
    }

    fn assert_shape(&self, image: &Image<'_>) {
        let size = (image.width(), image.height());
        assert!(size == self.size, "a frame of {size:?} px was given to an engine for {:?} px", self.size);
    }

    /// The background's motion; `None` where the image has no structure.
    fn fit(&mut self) -> Option<GlobalMotion> {
        let still = GlobalMotion::still(self.size.0, self.size.1);
        let pixel = f64::from(2u32 << (self.coarsest + self.thumbnails[0].len()));
        let older = self.thumbnails[0].last().unwrap_or(&self.older.levels[self.coarsest]);
        let newer = self.thumbnails[1].last().unwrap_or(&self.newer.levels[self.coarsest]);
        let starts =
            if self.parameters.search { self.search.candidates(older, newer) } else { [Some((0, 0)), None] };
        let mut best: Option<(f64, GlobalMotion)> = None;
        for (u, v) in starts.into_iter().flatten() {
            let start = still.translated(f64::from(u) * pixel, f64::from(v) * pixel);
            let Some(motion) = self.fit_level(start, self.coarsest) else { continue };
            self.warp_level(&motion, self.coarsest, true);
            let k = self.coarsest;
            let residual = mean_residual(&self.warped[k], &self.newer.levels[k], &self.spans[k]);
            if best.is_none_or(|(held, _)| residual < held) {
                best = Some((residual, motion));
            }
        }
        let (_, mut motion) = best?;
        for k in (0..self.coarsest).rev() {
            motion = self.fit_level(motion, k)?;
        }
        Some(motion)
    }

    /// Gauss-Newton steps on level `k`.
    fn fit_level(&mut self, mut motion: GlobalMotion, k: usize) -> Option<GlobalMotion> {
        let steps = STEPS[k].max(if k == self.coarsest { STEPS[LEVELS - 1] } else { 0 });
        let pixel = f64::from(2u32 << k);
        for step in 0..steps {
            // While the fit is coarse, what is light and what is motion must be told apart again.
            if step == 0 || (step == 2 && k == self.coarsest) {
                self.measure_gain(&motion);
            }
            self.warp_level(&motion, k, true);
            let (older, newer, spans) = (&self.warped[k], &self.newer.levels[k], &self.spans[k]);
            let scale = residual_scale(older, newer, spans, &mut self.counts);
            let sums = moments(older, newer, spans, (k, &motion), scale);
            let current = motion.coefficients.map(|a| a / pixel);
            let prior = motion.prior().map(|a| a / pixel);
            let correction = sums.solve(self.parameters.model, current, prior, scale / 2.0)?;
            for (a, c) in motion.coefficients.iter_mut().zip(correction) {
                *a -= c * pixel;
            }
            if !self.plausible(&motion) {
                return None;
            }
        }
        Some(motion)
    }

    /// A motion that leaves some of the older frame in sight.
    fn plausible(&self, motion: &GlobalMotion) -> bool {
        let limit = self.size.0.max(self.size.1) as f64;
        motion.is_finite() && motion.coefficients.iter().all(|a| a.abs() < limit)
    }

    fn measure_gain(&mut self, motion: &GlobalMotion) {
        if self.parameters.light {
            let coarsest = LEVELS - 1;
            self.warp_level(motion, coarsest, false);
            self.gain.measure(&self.warped[coarsest], &self.newer.levels[coarsest], &self.spans[coarsest]);
        }
    }

    fn warp_level(&mut self, motion: &GlobalMotion, k: usize, light: bool) {
        let gain = (&mut self.gain, light && self.parameters.light);
        warp(&self.older.levels[k], motion, gain, k, &mut self.warped[k], &mut self.spans[k]);
    }

    /// All levels of the older frame as the newer would show the background.
    fn compensate(&mut self, motion: &GlobalMotion) {
        self.measure_gain(motion);
        for k in 0..LEVELS {
            self.warp_level(motion, k, true);
        }
    }

    /// The blobs over the threshold, and the motion of each.
    fn find_candidates(&mut self, findings: &mut Findings) {
        // Boxes that are taken, base px: columns, rows (first, end).
        let mut taken = [[(0, 0); 2]; MAX_TARGETS];
        for turn in 0..MAX_TARGETS {
            let mut best = (0.0f32, 0, 0);
            for (index, map) in self.evidence.maps.iter().enumerate() {
                let (z, cell) = map.peak(|cell| !taken[..turn].iter().any(|area| covers(area, map, cell)));
                if z > best.0 {
                    best = (z, index, cell);
                }
            }
            let (z, index, cell) = best;
            if turn == 0 {
                findings.evidence = f64::from(z);
            }
            if z < self.parameters.cut || f64::from(z) < LEAST_OF_BEST * findings.evidence {
                return;
            }
            let area = self.grow_blob(index, cell);
            let candidate = self.measure_candidate(&findings.background, index, area);
            taken[turn] = area;
            let Some((candidate, extent)) = candidate else { continue };
            // The outskirts of a target lead to it once more.
            let known = |candidate: &Candidate| {
                taken[..turn].iter().any(|area| {
                    let inside = |(first, end): (i32, i32), x: f64| {
                        f64::from(2 * first) <= x && x < f64::from(2 * end)
                    };
                    inside(area[0], candidate.u) && inside(area[1], candidate.v)
                })
            };
            if known(&candidate) {
                continue;
            }
            // The blob, the target, and what the target has uncovered; the place itself, which in noise may
            // lie outside of all of them, so that nothing is told twice.
            let both = |i: usize| {
                let back = (-candidate.relative[i] / 2.0).round() as i32;
                let (first, end) = extent[i];
                let place = ([candidate.u, candidate.v][i] / 2.0).floor() as i32;
                let first = area[i].0.min(first).min(first + back).min(place - 1);
                (first, area[i].1.max(end).max(end + back).max(place + 2))
            };
            taken[turn] = [both(0), both(1)];
            findings.candidates[findings.count] = self.judge(candidate, f64::from(z), &taken[turn]);
            findings.count += 1;
        }
    }

    /// The candidate with all that speaks for and against it; `area` is its box, base px.
    fn judge(&self, mut candidate: Candidate, evidence: f64, area: &[(i32, i32); 2]) -> Candidate {
        candidate.evidence = evidence;
        let (mut cells, mut loud) = (0, 0);
        for map in &self.evidence.maps {
            let (peak, _) = map.peak(|cell| covers(area, map, cell));
            let own =
                if map.untuned { &mut candidate.residual_evidence } else { &mut candidate.votes_evidence };
            *own = own.max(f64::from(peak));
            let (peak, _) = map.peak(|cell| !covers(area, map, cell));
            candidate.rival = candidate.rival.max(f64::from(peak));
            if map.cell == 2 * self.evidence.cell() {
                for (cell, value) in map.values.iter().enumerate() {
                    if !covers(area, map, cell) {
                        cells += 1;
                        loud += usize::from(*value > 0.5 * map.threshold);
                    }
                }
            }
        }
        candidate.clutter = loud as f64 / usize::max(cells, 1) as f64;
        (candidate.position_covariance, candidate.velocity_sd) = confidence::uncertainty(&candidate);
        candidate.confidence = confidence::probability(&candidate);
        candidate
    }

    /// `self.blob`: the cells around the peak that exceed the blob level; their box, base px.
    fn grow_blob(&mut self, index: usize, cell: usize) -> [(i32, i32); 2] {
        const SHARE_OF_THRESHOLD: f32 = 0.7;
        const SHARE_OF_PEAK: f32 = 0.5;
        let map = &self.evidence.maps[index];
        let level = (SHARE_OF_THRESHOLD * map.threshold).max(SHARE_OF_PEAK * map.values[cell]);
        self.flood.start(map.columns, map.rows);
        let cells = self.flood.component(cell, |i| map.values[i] > level);
        self.blob.clear();
        self.blob.extend_from_slice(cells);
        let over = |value: &dyn Fn(usize) -> usize| {
            let first = cells.iter().map(|&i| value(i)).min().unwrap_or(0);
            let last = cells.iter().map(|&i| value(i)).max().unwrap_or(0);
            ((first * map.cell) as i32, ((last + 1) * map.cell) as i32)
        };
        [over(&|i| i % map.columns), over(&|i| i / map.columns)]
    }

    /// Position and motion of the blob, and the target's box, base px.
    fn measure_candidate(
        &mut self,
        background: &GlobalMotion,
        index: usize,
        mut area: [(i32, i32); 2],
    ) -> Option<(Candidate, [(i32, i32); 2])> {
        let untuned = self.evidence.maps[index].untuned;
        let votes = self.evidence.votes_over(index / 2, &self.blob);
        let mean = mean_motion(&votes);
        if !self.parameters.competition {
            return Some((self.by_votes(background, index, mean), area));
        }
        let mut candidates = [[0f32; 2]; MAX_CANDIDATES];
        let count = list_motions(&votes, mean, untuned, &mut candidates);
        let mut winner: Option<(Winner, usize)> = None;
        for _ in 0..3 {
            let (k, place) = self.place(&area)?;
            let pixel = f32::from(2u16 << k);
            let mut tried = [[0f32; 2]; MAX_CANDIDATES];
            for (t, u) in tried.iter_mut().zip(&candidates[..count]) {
                *t = u.map(|u| u / pixel);
            }
            // Of a patch that grew the motion is known.
            let known =
                winner.map(|(winner, level)| winner.motion.map(|u| u * f32::from(2u16 << level) / pixel));
            let pair =
                LevelPair { older: &self.warped[k], newer: &self.newer.levels[k], spans: &self.spans[k] };
            let longer = area.iter().map(|(first, end)| (end - first) >> k).max().unwrap_or(0);
            let how = (self.parameters.symmetric, longer <= SMALL);
            let Some(found) = self.competition.decide(pair, place, (&tried[..count], known), how) else {
                break;
            };
            winner = Some((found, k));
            if found.explained < WORTH_GROWING {
                break;
            }
            let Some(larger) = self.outgrown(&found, place, k) else { break };
            area = larger;
        }
        let (winner, k) = winner?;
        let pixel = f64::from(2u32 << k);
        let [u, v] = winner.position.map(|p| f64::from(p) * pixel);
        let relative = winner.motion.map(|p| f64::from(p) * pixel);
        let (bu, bv) = background.at(u, v);
        let candidate = Candidate {
            u,
            v,
            vu: bu + relative[0],
            vv: bv + relative[1],
            relative,
            area_px: f64::from(winner.area) * pixel * pixel,
            explained: f64::from(winner.explained),
            spread: winner.spread.map(|s| f64::from(s) * pixel * pixel),
            ..Candidate::default()
        };
        let base = |(first, end): (i32, i32)| (first << k, end << k);
        Some((candidate, winner.extent.map(base)))
    }

    /// The box that the target needs where its mask reaches the patch's border; base px.
    fn outgrown(&self, found: &Winner, place: Place, k: usize) -> Option<[(i32, i32); 2]> {
        let level = &self.newer.levels[k];
        let axis = |extent: (i32, i32), first: i32, length: usize, side: usize| {
            let end = first + length as i32;
            let more = length as i32 / 3;
            let grows = |reaches: bool| if reaches { more } else { 0 };
            let low = grows(extent.0 <= first + 1 && first > 0);
            let high = grows(extent.1 >= end - 1 && end < side as i32);
            (low + high > 0, (extent.0 - low, extent.1 + high))
        };
        let (x_grows, x) = axis(found.extent[0], place.x, place.width, level.width);
        let (y_grows, y) = axis(found.extent[1], place.y, place.height, level.height);
        (x_grows || y_grows).then(|| [x, y].map(|(first, end)| (first << k, end << k)))
    }

    /// The level and patch on which the box and its surroundings are looked at.
    fn place(&self, area: &[(i32, i32); 2]) -> Option<(usize, Place)> {
        const AROUND: f32 = 0.35;
        const LEAST_AROUND: i32 = 8;
        let longer = area.iter().map(|(first, end)| end - first).max().unwrap_or(0);
        let around = ((AROUND * longer as f32) as i32).max(LEAST_AROUND);
        for k in 0..LEVELS {
            let level = &self.newer.levels[k];
            let axis = |(first, end): (i32, i32), side: usize| {
                let first = ((first - around) >> k).max(0);
                let end = (((end + around) >> k) + 1).min(side as i32);
                (first, (end - first).max(0) as usize)
            };
            let (x, width) = axis(area[0], level.width);
            let (y, height) = axis(area[1], level.height);
            if width.max(height) > MAX_PATCH && k + 1 < LEVELS {
                continue;
            }
            let (width, height) = (width.min(MAX_PATCH), height.min(MAX_PATCH));
            let width = width.next_multiple_of(RUN);
            return (width >= 8 && height >= 8).then_some((k, Place { x, y, width, height }));
        }
        None
    }

    /// Without competition: centroid of the blob and mean vote, brought to the newer frame.
    fn by_votes(&self, background: &GlobalMotion, index: usize, mean: [f32; 2]) -> Candidate {
        let map = &self.evidence.maps[index];
        let weight = |i: usize| f64::from(map.values[i]);
        let total: f64 = self.blob.iter().map(|&i| weight(i)).sum();
        let side = 2.0 * map.cell as f64;
        let centre = |value: &dyn Fn(usize) -> usize| {
            self.blob.iter().map(|&i| weight(i) * (value(i) as f64 + 0.5) * side).sum::<f64>() / total
        };
        let relative = mean.map(f64::from);
        let u = centre(&|i| i % map.columns) + relative[0] / 2.0;
        let v = centre(&|i| i / map.columns) + relative[1] / 2.0;
        let (bu, bv) = background.at(u, v);
        let area_px = self.blob.len() as f64 * side * side;
        let round = area_px / std::f64::consts::PI / 4.0;
        Candidate {
            u,
            v,
            vu: bu + relative[0],
            vv: bv + relative[1],
            relative,
            area_px,
            spread: [round, 0.0, round],
            ..Candidate::default()
        }
    }

    /// Writes the normalised votes as fields, in windows of about a 16th of the frame: cells per row, rows, and the side of a
    /// cell, full-resolution px. All 0 where there was no answer.
    pub fn fields(&self, findings: &Findings, fields: &mut Fields) -> (usize, usize, f64) {
        let (columns, rows, cell) = self.evidence.shown_grid();
        // A long frame may have more cells than there is room for: then several are one.
        let block = (1..).find(|b| columns.div_ceil(*b) * rows.div_ceil(*b) <= MAX_CELLS).unwrap_or(1);
        let (wide, high) = (columns.div_ceil(block), rows.div_ceil(block));
        for (i, field) in fields.iter_mut().enumerate() {
            field[..wide * high].fill(0.0);
            if findings.outcome == Outcome::Answered {
                for (cell, vote) in self.evidence.shown_votes(i).enumerate() {
                    let (x, y) = (cell % columns / block, cell / columns / block);
                    field[y * wide + x] += vote / (block * block) as f32;
                }
            }
        }
        (wide, high, (2 * cell * block) as f64)
    }

    /// Level `k` (0, 1, 2) of the newer frame of the last call: columns, rows, values from row to row, and
    /// the values, in 1/16 grey level.
    ///
    /// # Panics
    /// If there is no such level.
    pub fn level(&self, k: usize) -> (usize, usize, usize, &[i16]) {
        let level = &self.newer.levels[k];
        (level.width, level.height, level.stride, &level.values)
    }
}

/// Halves `level` again and again.
fn make_thumbnails(level: &Level, thumbnails: &mut [Level], sums: &mut [u16]) {
    for i in 0..thumbnails.len() {
        let (done, rest) = thumbnails.split_at_mut(i);
        halve_level(done.last().unwrap_or(level), &mut rest[0], sums);
    }
}

/// Whether the cell's middle lies in the box.
fn covers(area: &[(i32, i32); 2], map: &Map, cell: usize) -> bool {
    let middle = |i: usize| (i * map.cell + map.cell / 2) as i32;
    let inside = |(first, end): (i32, i32), x: i32| first <= x && x < end;
    // One cell around it is still its window.
    let wide = |(first, end): (i32, i32)| (first - map.cell as i32, end + map.cell as i32);
    inside(wide(area[0]), middle(cell % map.columns)) && inside(wide(area[1]), middle(cell / map.columns))
}

/// The vote-weighted mean of the nominal velocities, full-resolution px per pair.
fn mean_motion(votes: &[f64; crate::FIELDS]) -> [f32; 2] {
    let total: f64 = votes.iter().map(|vote| vote.abs()).sum();
    let along = |axis: usize| {
        votes.iter().zip(&NOMINAL_VELOCITIES).map(|(vote, v)| vote * v[axis]).sum::<f64>() / total.max(1e-9)
    };
    [along(0) as f32, along(1) as f32]
}

/// Motions worth a trial, full-resolution px per pair; how many.
fn list_motions(
    votes: &[f64; crate::FIELDS],
    mean: [f32; 2],
    untuned: bool,
    list: &mut [[f32; 2]; MAX_CANDIDATES],
) -> usize {
    let mut count = 0;
    let mut add = |u: [f32; 2]| {
        if count < list.len() {
            list[count] = u;
            count += 1;
        }
    };
    for factor in [1.0, 1.3, 2.0] {
        add(mean.map(|u| factor * u));
    }
    let mut order: [usize; crate::FIELDS] = std::array::from_fn(|i| i);
    order.sort_by(|&i, &j| votes[j].abs().total_cmp(&votes[i].abs()));
    let signed = |i: usize| NOMINAL_VELOCITIES[i].map(|v| (v * votes[i].signum()) as f32);
    order[..4].iter().for_each(|&i| add(signed(i)));
    let (first, second) = (signed(order[0]), signed(order[1]));
    add([(first[0] + second[0]) / 2.0, (first[1] + second[1]) / 2.0]);
    if untuned {
        for sign in [1.0, -1.0] {
            for (i, v) in NOMINAL_VELOCITIES.iter().enumerate() {
                add(v.map(|v| (sign * v) as f32));
                if i < 4 {
                    add(v.map(|v| (0.5 * sign * v) as f32));
                }
            }
        }
    }
    count
}
