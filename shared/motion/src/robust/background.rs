//! The background's motion: from large translations down to hundredths of a pixel, level by level, the light
//! corrected on the way; then all levels of the older frame as the newer would show the background.

use super::fit::{mean_residual, moments, residual_scale};
use super::model::GlobalMotion;
use super::warp::{warp, warp_bands};
use super::{RobustEngine, smallest};
use crate::pyramid::LEVELS;

/// Gauss-Newton steps on the finest level, the one above it, the coarsest.
const STEPS: [usize; LEVELS] = [1, 3, 4];

impl RobustEngine {
    /// The background's motion; `None` where none fits.
    pub(super) fn fit(&mut self) -> Option<GlobalMotion> {
        let still = GlobalMotion::still(self.pair.size.0, self.pair.size.1);
        let pixel = f64::from(2u32 << (self.coarsest + self.pair.newer.thumbnails.len()));
        let older = smallest(&self.pair.older, self.coarsest);
        let newer = smallest(&self.pair.newer, self.coarsest);
        let starts =
            if self.parameters.search { self.search.candidates(older, newer) } else { [Some((0, 0)), None] };
        let mut best: Option<(f64, GlobalMotion)> = None;
        for (u, v) in starts.into_iter().flatten() {
            let start = still.translated(f64::from(u) * pixel, f64::from(v) * pixel);
            let Some(motion) = self.fit_level(start, self.coarsest) else { continue };
            self.warp_level(&motion, self.coarsest, true);
            let k = self.coarsest;
            let residual = mean_residual(&self.warped[k], &self.pair.newer.levels[k], &self.spans[k]);
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
            if k == 0 && self.coarsest > 0 {
                // What remains is small and a sample of the finest level tells it.
                let gain = (&mut self.gain, self.parameters.light);
                let older = &self.pair.older.levels[k];
                warp_bands(older, &motion, gain, k, &mut self.warped[k], &mut self.spans[k]);
            } else {
                self.warp_level(&motion, k, true);
            }
            let (older, newer, spans) = (&self.warped[k], &self.pair.newer.levels[k], &self.spans[k]);
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
        let limit = self.pair.size.0.max(self.pair.size.1) as f64;
        motion.is_finite() && motion.coefficients.iter().all(|a| a.abs() < limit)
    }

    fn measure_gain(&mut self, motion: &GlobalMotion) {
        if self.parameters.light {
            let last = LEVELS - 1;
            self.warp_level(motion, last, false);
            self.gain.measure(&self.warped[last], &self.pair.newer.levels[last], &self.spans[last]);
        }
    }

    fn warp_level(&mut self, motion: &GlobalMotion, k: usize, light: bool) {
        let gain = (&mut self.gain, light && self.parameters.light);
        warp(&self.pair.older.levels[k], motion, gain, k, &mut self.warped[k], &mut self.spans[k]);
    }

    /// All levels of the older frame as the newer would show the background.
    pub(super) fn compensate(&mut self, motion: &GlobalMotion) {
        self.measure_gain(motion);
        for k in 0..LEVELS {
            self.warp_level(motion, k, true);
        }
    }
}
