//! A random walk: constant speed, curvature an Ornstein-Uhlenbeck process, turned back at the arena's border.

use serde::{Deserialize, Serialize};

use super::curve::{Arena, wrapped};
use crate::random::Random;

/// How long the curvature remembers itself, seconds.
const TIME_CONSTANT_S: f64 = 1.5;
/// Standard deviation of the curvature, one over metres.
const CURVATURE_SD_PER_M: f64 = 4.0;
/// Largest curvature, one over metres.
const MAX_CURVATURE_PER_M: f64 = 8.0;
/// The walk turns back when the point so far ahead leaves the arena, metres: the radius of the tightest turn and a
/// little.
const LOOK_AHEAD_M: f64 = 0.13;

/// State of a walk.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Walk {
    pub(super) position: [f64; 2],
    pub(super) heading: f64,
    curvature: OrnsteinUhlenbeck,
    /// Side to which it turns back, while it does.
    turning: Option<f64>,
}

impl Walk {
    /// Starts in the middle of `arena` in a random direction.
    pub(super) fn new(arena: &Arena, random: &mut Random) -> Self {
        let heading = wrapped(std::f64::consts::TAU * random.unit());
        let mut curvature = OrnsteinUhlenbeck::default();
        curvature.start(CURVATURE_SD_PER_M, random);
        Self { position: arena.centre(), heading, curvature, turning: None }
    }

    /// Walks for `dt_s` seconds at `speed` metres per second.
    pub(super) fn advance(&mut self, arena: &Arena, speed: f64, dt_s: f64, random: &mut Random) {
        self.curvature.advance(CURVATURE_SD_PER_M, TIME_CONSTANT_S, dt_s, random);
        let curvature = match self.side_of_return(arena) {
            Some(side) => side * MAX_CURVATURE_PER_M,
            None => self.curvature.value.clamp(-MAX_CURVATURE_PER_M, MAX_CURVATURE_PER_M),
        };
        let middle = self.heading + 0.5 * curvature * speed * dt_s;
        self.position[0] += speed * dt_s * libm::cos(middle);
        self.position[1] += speed * dt_s * libm::sin(middle);
        self.heading = wrapped(self.heading + curvature * speed * dt_s);
        self.reflect(arena);
    }

    /// The side to which the walk must turn to stay in the arena, until the way ahead is free.
    fn side_of_return(&mut self, arena: &Arena) -> Option<f64> {
        let (c, s) = (libm::cos(self.heading), libm::sin(self.heading));
        let ahead = [self.position[0] + LOOK_AHEAD_M * c, self.position[1] + LOOK_AHEAD_M * s];
        if arena.contains(ahead) {
            self.turning = None;
        } else if self.turning.is_none() {
            let centre = arena.centre();
            let to_left = c * (centre[1] - self.position[1]) - s * (centre[0] - self.position[0]);
            self.turning = Some(if to_left < 0.0 { -1.0 } else { 1.0 });
        }
        self.turning
    }

    /// What the turn does not achieve in a corner, a reflection does.
    fn reflect(&mut self, arena: &Arena) {
        let mut direction = [libm::cos(self.heading), libm::sin(self.heading)];
        let mut reflected = false;
        for ((x, d), (least, most)) in
            self.position.iter_mut().zip(&mut direction).zip(arena.least.into_iter().zip(arena.most))
        {
            let outward = (*x > most && *d > 0.0) || (*x < least && *d < 0.0);
            *x = x.clamp(least, most);
            if outward {
                *d = -*d;
                reflected = true;
            }
        }
        if reflected {
            self.heading = libm::atan2(direction[1], direction[0]);
        }
    }
}

/// A random process with a given deviation that forgets itself exponentially, stepped exactly.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct OrnsteinUhlenbeck {
    pub(super) value: f64,
}

impl OrnsteinUhlenbeck {
    /// Draws from the stationary distribution.
    pub(super) fn start(&mut self, sd: f64, random: &mut Random) {
        self.value = sd * random.gaussian();
    }

    /// Advances by `dt_s` seconds; the law does not depend on the step.
    pub(super) fn advance(&mut self, sd: f64, time_constant_s: f64, dt_s: f64, random: &mut Random) {
        let kept = libm::exp(-dt_s / time_constant_s);
        self.value = self.value * kept + sd * (1.0 - kept * kept).sqrt() * random.gaussian();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn walk_stays_in_its_arena_and_sees_most_of_it() {
        let arena = Arena { least: [0.4, -0.3], most: [0.85, 0.3] };
        for seed in 0..4 {
            let mut random = Random::new(seed, 0);
            let mut walk = Walk::new(&arena, &mut random);
            let mut cells = [[false; 4]; 3];
            for _ in 0..300_000 {
                walk.advance(&arena, 0.1, 0.001, &mut random);
                let [x, y] = walk.position;
                assert!(arena.contains(walk.position), "seed {seed} at {x}, {y}");
                cells[(((x - 0.4) / 0.15) as usize).min(2)][(((y + 0.3) / 0.15) as usize).min(3)] = true;
            }
            assert!(cells.iter().flatten().filter(|&&seen| seen).count() >= 10, "seed {seed}: {cells:?}");
        }
    }

    #[test]
    fn process_has_its_deviation_and_memory() {
        let mut random = Random::new(1, 0);
        let mut process = OrnsteinUhlenbeck::default();
        process.start(2.0, &mut random);
        let values: Vec<f64> = (0..400_000)
            .map(|_| {
                process.advance(2.0, 0.5, 0.01, &mut random);
                process.value
            })
            .collect();
        let variance = values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64;
        let lagged = values.windows(51).map(|w| w[0] * w[50]).sum::<f64>() / values.len() as f64;
        assert!((variance.sqrt() - 2.0).abs() < 0.06, "sd {}", variance.sqrt());
        assert!((lagged / variance - (-1.0f64).exp()).abs() < 0.05, "memory {}", lagged / variance);
    }
}
