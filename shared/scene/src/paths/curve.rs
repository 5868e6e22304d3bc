//! The description of a path, and its closed curves by arc length.

use std::f64::consts::{FRAC_PI_2, TAU};
use std::fmt;

use serde::{Deserialize, Serialize};

use super::{lemniscate, polygon};

/// A rectangle on the table, base frame, metres.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Arena {
    /// Corner of least x and y.
    pub least: [f64; 2],
    /// Corner of largest x and y.
    pub most: [f64; 2],
}

impl Arena {
    /// Whether the point lies in it.
    pub fn contains(&self, point: [f64; 2]) -> bool {
        (0..2).all(|i| point[i] >= self.least[i] && point[i] <= self.most[i])
    }

    /// Its middle.
    pub fn centre(&self) -> [f64; 2] {
        [0, 1].map(|i| 0.5 * (self.least[i] + self.most[i]))
    }
}

/// A path on the table with the speed along it. Positions in the base frame, metres.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Path {
    /// A circle.
    Circle {
        /// Centre.
        centre: [f64; 2],
        /// Radius, metres.
        radius_m: f64,
        /// Speed, metres per second.
        speed_m_per_s: f64,
        /// Direction, seen from above.
        clockwise: bool,
        /// Direction from the centre to the first position, from the x axis, radians.
        start_phase_rad: f64,
    },
    /// Bernoulli's lemniscate along x. Its curvature at the ends is three over its half width.
    FigureEight {
        /// The crossing, where it starts.
        centre: [f64; 2],
        /// From the crossing to each end, metres.
        half_width_m: f64,
        /// Speed, metres per second.
        speed_m_per_s: f64,
    },
    /// A closed polygon with rounded corners; it starts where the arc at the first corner ends.
    Waypoints {
        /// Corners, at least three, none repeated.
        corners: Vec<[f64; 2]>,
        /// Radius of the arcs, metres.
        corner_radius_m: f64,
        /// Speed, metres per second.
        speed_m_per_s: f64,
    },
    /// A walk whose curvature is random, within a rectangle; it starts in its middle.
    RandomWalk {
        /// Where the walk stays; at least 0.3 m each way, so that it can turn.
        arena: Arena,
        /// Speed, metres per second.
        speed_m_per_s: f64,
    },
}

/// A point of a curve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct CurvePoint {
    pub(crate) position: [f64; 2],
    /// Direction of travel from the x axis, radians.
    pub(crate) heading: f64,
    /// Positive to the left, one over metres.
    pub(crate) curvature: f64,
}

/// A path that cannot be driven.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PathError {
    /// A number is out of its range.
    OutOfRange {
        /// Which.
        name: &'static str,
        /// Its value.
        value: f64,
        /// Its least value; it must be finite as well.
        least: f64,
    },
    /// Fewer than three corners.
    TooFewCorners {
        /// How many.
        corners: usize,
    },
    /// The arcs at both ends of a side are longer than the side.
    SideTooShort {
        /// Number of the corner at the side's end.
        corner: usize,
    },
}

impl fmt::Display for PathError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::OutOfRange { name, value, least } => {
                write!(f, "{name} is {value}, it must be at least {least}")
            }
            Self::TooFewCorners { corners } => write!(f, "a polygon needs three corners, this has {corners}"),
            Self::SideTooShort { corner } => {
                write!(
                    f,
                    "the side before corner {corner} is too short for its arcs: take a smaller corner_radius_m"
                )
            }
        }
    }
}

impl std::error::Error for PathError {}

/// Least side of an arena, metres: a full turn at the walk's tightest, and some room.
const LEAST_ARENA_M: f64 = 0.3;

impl Path {
    /// A square of the given side around `centre`, its corners rounded with 0.06 m (or a quarter of the side, if that
    /// is less), counter-clockwise.
    pub fn square(centre: [f64; 2], side_m: f64, speed_m_per_s: f64) -> Self {
        let half = 0.5 * side_m;
        let corners = [(1.0, -1.0), (1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0)]
            .map(|(x, y)| [centre[0] + x * half, centre[1] + y * half]);
        Path::Waypoints {
            corners: corners.to_vec(),
            corner_radius_m: 0.06f64.min(0.25 * side_m),
            speed_m_per_s,
        }
    }

    /// Speed where no profile says otherwise, metres per second.
    pub fn speed_m_per_s(&self) -> f64 {
        match self {
            Path::Circle { speed_m_per_s, .. }
            | Path::FigureEight { speed_m_per_s, .. }
            | Path::Waypoints { speed_m_per_s, .. }
            | Path::RandomWalk { speed_m_per_s, .. } => *speed_m_per_s,
        }
    }

    /// Checks that the path can be driven.
    ///
    /// # Errors
    /// The first reason why not.
    pub fn check(&self) -> Result<(), PathError> {
        at_least("speed_m_per_s", self.speed_m_per_s(), 0.0)?;
        match self {
            Path::Circle { centre, radius_m, start_phase_rad, .. } => {
                finite("centre", centre)?;
                finite("start_phase_rad", &[*start_phase_rad])?;
                at_least("radius_m", *radius_m, 1e-3)
            }
            Path::FigureEight { centre, half_width_m, .. } => {
                finite("centre", centre)?;
                at_least("half_width_m", *half_width_m, 1e-3)
            }
            Path::Waypoints { corners, corner_radius_m, .. } => {
                corners.iter().try_for_each(|corner| finite("a corner", corner))?;
                at_least("corner_radius_m", *corner_radius_m, 1e-3)?;
                polygon::check(corners, *corner_radius_m)
            }
            Path::RandomWalk { arena, .. } => {
                finite("arena", &[arena.least, arena.most].concat())?;
                (0..2).try_for_each(|i| {
                    at_least("side of the arena", arena.most[i] - arena.least[i], LEAST_ARENA_M)
                })
            }
        }
    }

    /// The point after `arc_m` metres of way from the start; `None` for a random walk, which has no closed form.
    pub(crate) fn point(&self, arc_m: f64) -> Option<CurvePoint> {
        match self {
            Path::Circle { centre, radius_m, clockwise, start_phase_rad, .. } => {
                let sense = if *clockwise { -1.0 } else { 1.0 };
                let turned = (arc_m / radius_m).rem_euclid(TAU);
                let phase = start_phase_rad + sense * turned;
                Some(CurvePoint {
                    position: [
                        centre[0] + radius_m * libm::cos(phase),
                        centre[1] + radius_m * libm::sin(phase),
                    ],
                    heading: phase + sense * FRAC_PI_2,
                    curvature: sense / radius_m,
                })
            }
            Path::FigureEight { centre, half_width_m, .. } => {
                Some(lemniscate::point(*centre, *half_width_m, arc_m))
            }
            Path::Waypoints { corners, corner_radius_m, .. } => {
                Some(polygon::point(corners, *corner_radius_m, arc_m))
            }
            Path::RandomWalk { .. } => None,
        }
    }
}

/// The same direction within -π to π.
pub(crate) fn wrapped(angle: f64) -> f64 {
    libm::remainder(angle, TAU)
}

fn at_least(name: &'static str, value: f64, least: f64) -> Result<(), PathError> {
    if value >= least && value.is_finite() {
        Ok(())
    } else {
        Err(PathError::OutOfRange { name, value, least })
    }
}

fn finite(name: &'static str, values: &[f64]) -> Result<(), PathError> {
    values.iter().try_for_each(|&value| at_least(name, value, f64::MIN))
}
