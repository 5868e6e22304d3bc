//! From evidence to what moves on its own: blobs over the threshold, the motion of each, and what speaks for
//! and against it.

use super::competition::{How, LevelPair, MAX_CANDIDATES, MAX_PATCH, Winner};
use super::confidence;
use super::findings::{Candidate, Findings};
use super::map::Area;
use super::model::GlobalMotion;
use super::parameters::RobustParameters;
use super::patch::{Place, RUN};
use super::{MAX_TARGETS, RobustEngine};
use crate::FIELDS;
use crate::compensation::NOMINAL_VELOCITIES;
use crate::pyramid::LEVELS;

/// Evidence below this share of the strongest is not looked at.
const LEAST_OF_BEST: f64 = 0.35;
/// Blobs up to this, level px, are looked at closely.
const SMALL: i32 = 16;
/// A mask that explains less than this is noise, and its patch does not grow.
const WORTH_GROWING: f32 = 0.3;

impl RobustEngine {
    /// The blobs over the threshold, and the motion of each.
    pub(super) fn find_candidates(&mut self, findings: &mut Findings) {
        // Boxes that are taken, base px: columns, rows (first, end).
        let mut taken = [[(0, 0); 2]; MAX_TARGETS];
        for turn in 0..MAX_TARGETS {
            let mut best = (0.0f32, 0, 0);
            for (index, map) in self.evidence.maps.iter().enumerate() {
                let (z, cell) = map.peak(&taken[..turn]);
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
    fn judge(&self, mut candidate: Candidate, evidence: f64, area: &Area) -> Candidate {
        candidate.evidence = evidence;
        let (mut cells, mut loud) = (0, 0);
        for map in &self.evidence.maps {
            let survey = map.survey(area);
            let own =
                if map.untuned { &mut candidate.residual_evidence } else { &mut candidate.votes_evidence };
            *own = own.max(f64::from(survey.inside));
            candidate.rival = candidate.rival.max(f64::from(survey.outside));
            if map.cell == 2 * self.evidence.cell() {
                cells += survey.cells;
                loud += survey.loud;
            }
        }
        candidate.clutter = loud as f64 / usize::max(cells, 1) as f64;
        (candidate.position_covariance, candidate.velocity_sd) = confidence::uncertainty(&candidate);
        candidate.confidence = confidence::probability(&candidate);
        candidate
    }

    /// `self.blob`: the cells around the peak that exceed the blob level; their box, base px.
    fn grow_blob(&mut self, index: usize, cell: usize) -> Area {
        const SHARE_OF_THRESHOLD: f32 = 0.7;
        const SHARE_OF_PEAK: f32 = 0.5;
        const MOST_OF_PEAK: f32 = 0.9;
        let map = &self.evidence.maps[index];
        let peak = map.values[cell];
        // Of a weak peak at least its own cell.
        let level = (SHARE_OF_THRESHOLD * map.threshold).max(SHARE_OF_PEAK * peak).min(MOST_OF_PEAK * peak);
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
        mut area: Area,
    ) -> Option<(Candidate, Area)> {
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
            let newer = &self.pair.newer.levels[k];
            let pair = LevelPair { older: &self.warped[k], newer, spans: &self.spans[k] };
            let longer = area.iter().map(|(first, end)| (end - first) >> k).max().unwrap_or(0);
            let RobustParameters { symmetric, turn, .. } = self.parameters;
            let how = How { symmetric, turn, small: longer <= SMALL };
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
    fn outgrown(&self, found: &Winner, place: Place, k: usize) -> Option<Area> {
        let level = &self.pair.newer.levels[k];
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
    fn place(&self, area: &Area) -> Option<(usize, Place)> {
        const AROUND: f32 = 0.35;
        const LEAST_AROUND: i32 = 8;
        let longer = area.iter().map(|(first, end)| end - first).max().unwrap_or(0);
        let around = ((AROUND * longer as f32) as i32).max(LEAST_AROUND);
        for k in 0..LEVELS {
            let level = &self.pair.newer.levels[k];
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
}

/// The vote-weighted mean of the nominal velocities, full-resolution px per pair.
fn mean_motion(votes: &[f64; FIELDS]) -> [f32; 2] {
    let total: f64 = votes.iter().map(|vote| vote.abs()).sum();
    let along = |axis: usize| {
        votes.iter().zip(&NOMINAL_VELOCITIES).map(|(vote, v)| vote * v[axis]).sum::<f64>() / total.max(1e-9)
    };
    [along(0) as f32, along(1) as f32]
}

/// Motions worth a trial, full-resolution px per pair; how many.
fn list_motions(
    votes: &[f64; FIELDS],
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
    let mut order: [usize; FIELDS] = std::array::from_fn(|i| i);
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
