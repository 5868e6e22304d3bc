//! The target-motion competition: which motion explains the blob better than the background's does, and
//! which pixels it explains (design notes on vision, section 6 R8, R9).

use super::patch::{Lines, Place, RUN, advantage, blur, least_squares, score, shifted, valid};
use super::turn::Rigid;
use super::warp::Span;
use crate::blobs::Flood;
use crate::pyramid::Level;

/// Motions that are tried at most.
pub(crate) const MAX_CANDIDATES: usize = 48;
/// Longest side of a patch, px of its level; larger blobs are looked at on a coarser level.
pub(crate) const MAX_PATCH: usize = 128;
/// Slower than this, level px, a motion cannot be told from the background's.
const LEAST_SPEED: f32 = 0.2;
/// Pixels where the target's motion explains this much more than the background's, of what both leave.
const MASK_THRESHOLD: f32 = 0.08;
/// Grey levels added to what both leave: noise decides nothing.
const MASK_NOISE: f32 = 1.0;
/// ... and this share of what the patch's pixels typically leave.
const MASK_TYPICAL: f32 = 0.2;
/// Fewer pixels than this are no target.
const LEAST_PIXELS: usize = 8;
/// Least-squares steps.
const STEPS: usize = 4;
/// ... where it may also turn: the mask grows from one to the next.
const TURN_STEPS: usize = 8;
/// A smaller target, pixels, is not asked whether it turns: all of it is near its middle.
const LEAST_TURNING: f32 = 100.0;
/// A turn must explain so much more than the translation alone; noise explains a little.
const TURN_GAIN: f32 = 1.05;

/// What the competition found, in px of the level.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Winner {
    /// Centroid in the newer frame.
    pub(crate) position: [f32; 2],
    /// Displacement relative to the background.
    pub(crate) motion: [f32; 2],
    /// Pixels.
    pub(crate) area: f32,
    /// Share of the residual that the motion explains, 0..1.
    pub(crate) explained: f32,
    /// Second moments of the mask: xx, xy, yy.
    pub(crate) spread: [f32; 3],
    /// Columns and rows of the mask (first, end).
    pub(crate) extent: [(i32, i32); 2],
    /// How much less the motion leaves in the mask than the background's does, grey levels.
    gain: f32,
}

/// How a blob is looked at.
#[derive(Clone, Copy)]
pub(crate) struct How {
    /// From both frames.
    pub(crate) symmetric: bool,
    /// The target may turn.
    pub(crate) turn: bool,
    /// The blob is so small that the mask must be looked at closely.
    pub(crate) small: bool,
}

/// One level of the compensated pair.
#[derive(Clone, Copy)]
pub(crate) struct LevelPair<'a> {
    pub(crate) older: &'a Level,
    pub(crate) newer: &'a Level,
    pub(crate) spans: &'a [Span],
}

/// Working memory.
#[derive(Clone, Debug)]
pub(crate) struct Competition {
    lines: Lines,
    newer: Vec<f32>,
    older: Vec<f32>,
    /// abs(newer - older): what the background's motion leaves.
    rest: Vec<f32>,
    trial: Vec<f32>,
    better: Vec<f32>,
    blurred: Vec<f32>,
    total: Vec<f32>,
    flood: Flood,
    mask: Vec<usize>,
    sorted: Vec<f32>,
    /// Whether the blob is so small that the mask must be looked at closely.
    small: bool,
}

impl Competition {
    pub(crate) fn new() -> Competition {
        let side = MAX_PATCH + 2 * RUN;
        let pixels = || vec![0.0; side * side];
        Competition {
            lines: Lines::new(side),
            newer: pixels(),
            older: pixels(),
            rest: pixels(),
            trial: pixels(),
            better: pixels(),
            blurred: pixels(),
            total: pixels(),
            flood: Flood::new(side * side),
            mask: Vec::with_capacity(side * side),
            sorted: Vec::with_capacity(side * side),
            small: false,
        }
    }

    /// The motion among `candidates` (level px) and around them that explains the most inside `place`, and
    /// what it covers; `None` where none explains anything. A `known` motion has no rivals.
    pub(crate) fn decide(
        &mut self,
        pair: LevelPair<'_>,
        place: Place,
        (candidates, known): (&[[f32; 2]], Option<[f32; 2]>),
        how: How,
    ) -> Option<Winner> {
        let n = place.pixels();
        self.small = how.small;
        shifted(pair.newer, place, [0.0; 2], &mut self.newer, &mut self.lines);
        shifted(pair.older, place, [0.0; 2], &mut self.older, &mut self.lines);
        for ((r, a), b) in self.rest[..n].iter_mut().zip(&self.older).zip(&self.newer) {
            *r = (b - a).abs();
        }
        self.clear_invalid(pair.spans, place);
        let motion = match known {
            Some(motion) => motion,
            None => self.best_motion(pair, place, candidates)?,
        };
        let moved = self.measure(pair, place, Rigid::translation(motion), how.symmetric)?;
        if !how.turn {
            return Some(moved);
        }
        let turned = self.refine_turn(pair, place, &moved).and_then(|rigid| {
            let turned = self.measure(pair, place, rigid, how.symmetric)?;
            (turned.gain > TURN_GAIN * moved.gain).then_some(turned)
        });
        Some(turned.unwrap_or(moved))
    }

    /// Outside of what both frames show there is nothing to explain.
    fn clear_invalid(&mut self, spans: &[Span], place: Place) {
        for (y, line) in self.rest[..place.pixels()].chunks_exact_mut(place.width).enumerate() {
            let (from, to) = valid(spans, place, y, [0.0; 2]);
            line[..from].fill(0.0);
            line[to..].fill(0.0);
        }
    }

    /// How much of the residual goes when the patch moves by `u`.
    fn score(&mut self, pair: LevelPair<'_>, place: Place, u: [f32; 2]) -> f32 {
        let n = place.pixels();
        score(pair.older, (pair.spans, place, u), (&self.rest[..n], &self.newer[..n]), &mut self.lines)
    }

    fn best_motion(
        &mut self,
        pair: LevelPair<'_>,
        place: Place,
        candidates: &[[f32; 2]],
    ) -> Option<[f32; 2]> {
        // The two best, best first.
        let mut best: [Option<(f32, [f32; 2])>; 2] = [None; 2];
        let keep = |best: &mut [Option<(f32, [f32; 2])>; 2], score: f32, u: [f32; 2]| {
            if best[0].is_none_or(|(held, _)| score > held) {
                best[1] = best[0];
                best[0] = Some((score, u));
            } else if best[1].is_none_or(|(held, _)| score > held) {
                best[1] = Some((score, u));
            }
        };
        for &u in candidates.iter().filter(|u| u[0].hypot(u[1]) > LEAST_SPEED) {
            let score = self.score(pair, place, u);
            keep(&mut best, score, u);
        }
        let (_, first) = best[0]?;
        for dy in [-1.0, 0.0, 1.0] {
            for dx in [-1.0, 0.0, 1.0] {
                let u = [first[0] + dx, first[1] + dy];
                if (dx != 0.0 || dy != 0.0) && u[0].hypot(u[1]) > LEAST_SPEED {
                    let score = self.score(pair, place, u);
                    keep(&mut best, score, u);
                }
            }
        }
        let mut winner = best[0]?;
        for (_, start) in best.into_iter().flatten() {
            let refined = self.refine(pair, place, start);
            let score = self.score(pair, place, refined);
            if score > winner.0 {
                winner = (score, refined);
            }
        }
        (winner.0 > 0.0).then_some(winner.1)
    }

    /// Least squares on the pixels that the motion explains better than the background's.
    fn refine(&mut self, pair: LevelPair<'_>, place: Place, start: [f32; 2]) -> [f32; 2] {
        const BOX: [f32; 4] = [1.0 / 7.0; 4];
        let n = place.pixels();
        let mut u = start;
        for _ in 0..STEPS {
            shifted(pair.older, place, u, &mut self.trial, &mut self.lines);
            let greys = (&self.rest[..n], &self.trial[..n], &self.newer[..n]);
            advantage(greys, (pair.spans, place, u), &mut self.better);
            blur(&self.better, place, &BOX, &mut self.blurred, &mut self.lines);
            let scale = self.residual_scale(n);
            let greys = (&self.trial[..n], &self.newer[..n], &self.blurred[..n]);
            let [xx, xy, yy, xr, yr] = least_squares(greys, place, scale);
            let (xx, yy) = (xx + 0.01, yy + 0.01);
            let det = xx * yy - xy * xy;
            let step = [-(yy * xr - xy * yr) / det, -(xx * yr - xy * xr) / det];
            if !step.iter().all(|s| s.is_finite()) {
                return start;
            }
            u = [u[0] + step[0].clamp(-1.0, 1.0) as f32, u[1] + step[1].clamp(-1.0, 1.0) as f32];
            if step[0].abs().max(step[1].abs()) < 0.02 {
                break;
            }
        }
        u
    }

    /// The motion with a turn about where it was `found` without one.
    fn refine_turn(&mut self, pair: LevelPair<'_>, place: Place, found: &Winner) -> Option<Rigid> {
        const BOX: [f32; 4] = [1.0 / 7.0; 4];
        if found.area < LEAST_TURNING {
            return None;
        }
        let n = place.pixels();
        let reach = (found.spread[0] + found.spread[2]).sqrt();
        let mut rigid = Rigid { motion: found.motion, turn: 0.0, centre: found.position };
        for _ in 0..TURN_STEPS {
            rigid.moved(pair.older, place, &mut self.trial, &mut self.lines);
            let greys = (&self.rest[..n], &self.trial[..n], &self.newer[..n]);
            advantage(greys, (pair.spans, place, rigid.motion), &mut self.better);
            blur(&self.better, place, &BOX, &mut self.blurred, &mut self.lines);
            let scale = self.residual_scale(n);
            let greys = (&self.trial[..n], &self.newer[..n], &self.blurred[..n]);
            if rigid.correct(greys, place, scale, reach)? < 0.02 {
                break;
            }
        }
        (rigid.turn.abs() * reach > LEAST_SPEED).then_some(rigid)
    }

    /// Twice the robust deviation of what the motion leaves where it explains something.
    fn residual_scale(&mut self, n: usize) -> f32 {
        self.sorted.clear();
        for i in 0..n {
            if self.blurred[i] > 0.0 {
                self.sorted.push((self.newer[i] - self.trial[i]).abs());
            }
        }
        if self.sorted.is_empty() {
            return 1.0;
        }
        let middle = self.sorted.len() / 2;
        let (_, median, _) = self.sorted.select_nth_unstable_by(middle, f32::total_cmp);
        2.0 * 1.4826 * *median + 0.5
    }

    /// Mask, centroid, area; with `symmetric` the mean of the centroids in both frames.
    fn measure(
        &mut self,
        pair: LevelPair<'_>,
        place: Place,
        rigid: Rigid,
        symmetric: bool,
    ) -> Option<Winner> {
        rigid.moved(pair.older, place, &mut self.trial, &mut self.lines);
        self.find_mask(pair.spans, place, rigid.motion, true);
        let here = self.component(place)?;
        let inverse = rigid.inverse();
        let back = symmetric.then(|| {
            // The same in the older frame, which the newer explains when it moves back.
            inverse.moved(pair.newer, place, &mut self.trial, &mut self.lines);
            self.find_mask(pair.spans, place, inverse.motion, false);
            self.component(place)
        });
        let mut position = here.position;
        if let Some(back) = back.flatten().filter(|back| (0.4..2.5).contains(&(back.area / here.area))) {
            // Uncovered background biases both the same way.
            let came_to = inverse.origin_of(back.position);
            position = std::array::from_fn(|i| (here.position[i] + came_to[i]) / 2.0);
        }
        let was = rigid.origin_of(position);
        let motion = std::array::from_fn(|i| position[i] - was[i]);
        Some(Winner { position, motion, ..here })
    }

    /// `self.blurred`: how much more `trial` explains than the background's motion, of what both leave.
    fn find_mask(&mut self, spans: &[Span], place: Place, u: [f32; 2], newer: bool) {
        let n = place.pixels();
        let greys = if newer { &self.newer } else { &self.older };
        advantage((&self.rest[..n], &self.trial[..n], &greys[..n]), (spans, place, u), &mut self.better);
        for (t, (better, rest)) in self.trial[..n].iter_mut().zip(self.better.iter().zip(&self.rest)) {
            // r0 + r1 = 2 r0 - (r0 - r1); outside of the valid columns both are 0.
            *t = 2.0 * rest - better;
        }
        let kernel: &[f32] = if self.small { &GAUSSIAN_1_5 } else { &GAUSSIAN_2 };
        blur(&self.better, place, kernel, &mut self.blurred, &mut self.lines);
        blur(&self.trial, place, kernel, &mut self.total, &mut self.lines);
        // What leaves little beside what is typical here is the blur's own tail around a target on flat ground.
        let (mut sum, mut squares) = (0.0, 0.0);
        for total in &self.total[..n] {
            sum += total;
            squares += total * total;
        }
        let noise = MASK_NOISE + MASK_TYPICAL * squares / f32::max(sum, 1.0);
        for (z, total) in self.blurred[..n].iter_mut().zip(&self.total) {
            *z /= total + noise;
        }
    }

    /// The component of the mask with the most evidence.
    fn component(&mut self, place: Place) -> Option<Winner> {
        let n = place.pixels();
        self.flood.start(place.width, place.height);
        let mut best = 0.0;
        self.mask.clear();
        for seed in 0..n {
            let z = &self.blurred;
            if z[seed] <= MASK_THRESHOLD {
                continue;
            }
            let component = self.flood.component(seed, |i| z[i] > MASK_THRESHOLD);
            let sum: f32 = component.iter().map(|&i| z[i]).sum();
            if sum > best {
                best = sum;
                self.mask.clear();
                self.mask.extend_from_slice(component);
            }
        }
        if self.mask.len() < LEAST_PIXELS {
            return None;
        }
        let count = self.mask.len() as f32;
        let at = |i: usize| [(i % place.width) as f32, (i / place.width) as f32];
        let mean = |value: &dyn Fn(usize) -> f32| self.mask.iter().map(|&i| value(i)).sum::<f32>() / count;
        let centre = [mean(&|i| at(i)[0]), mean(&|i| at(i)[1])];
        let from_centre = |i: usize| [at(i)[0] - centre[0], at(i)[1] - centre[1]];
        let explained: f32 = self.mask.iter().map(|&i| self.better[i]).sum();
        let rest: f32 = self.mask.iter().map(|&i| self.rest[i]).sum();
        Some(Winner {
            position: [centre[0] + place.x as f32, centre[1] + place.y as f32],
            motion: [0.0; 2],
            area: count,
            explained: explained / rest.max(1e-6),
            gain: explained,
            extent: self.extent(place),
            spread: [
                mean(&|i| from_centre(i)[0].powi(2)),
                mean(&|i| from_centre(i)[0] * from_centre(i)[1]),
                mean(&|i| from_centre(i)[1].powi(2)),
            ],
        })
    }

    fn extent(&self, place: Place) -> [(i32, i32); 2] {
        let over = |value: &dyn Fn(usize) -> usize, origin: i32| {
            let first = self.mask.iter().map(|&i| value(i)).min().unwrap_or(0);
            let last = self.mask.iter().map(|&i| value(i)).max().unwrap_or(0);
            (origin + first as i32, origin + last as i32 + 1)
        };
        [over(&|i| i % place.width, place.x), over(&|i| i / place.width, place.y)]
    }
}

/// Half kernels of unit sum: the Gaussian of sigma 2 px to radius 6, of sigma 1.5 to radius 4.
const GAUSSIAN_2: [f32; 7] = [0.199676, 0.176213, 0.121109, 0.064825, 0.027023, 0.008773, 0.002218];
const GAUSSIAN_1_5: [f32; 5] = [0.26656, 0.21344, 0.10959, 0.036075, 0.0076144];
