//! A closed polygon with rounded corners, by arc length.

use super::curve::{CurvePoint, PathError};

/// A corner's arc.
struct Corner {
    /// From where the arc starts to the corner, and from there to its end, metres.
    tangent_m: f64,
    /// Turn, positive to the left, radians.
    turn_rad: f64,
    /// Direction before the corner, radians.
    heading: f64,
    /// Length of the side before the corner, from corner to corner, metres.
    side_m: f64,
}

impl Corner {
    fn new(corners: &[[f64; 2]], i: usize, radius_m: f64) -> Self {
        let n = corners.len();
        let (before, here, after) = (corners[(i + n - 1) % n], corners[i], corners[(i + 1) % n]);
        let a = [here[0] - before[0], here[1] - before[1]];
        let b = [after[0] - here[0], after[1] - here[1]];
        let turn_rad = libm::atan2(a[0] * b[1] - a[1] * b[0], a[0] * b[0] + a[1] * b[1]);
        Self {
            tangent_m: radius_m * libm::tan(0.5 * turn_rad.abs()),
            turn_rad,
            heading: libm::atan2(a[1], a[0]),
            side_m: libm::hypot(a[0], a[1]),
        }
    }
}

/// Whether the arcs fit on the sides.
pub(super) fn check(corners: &[[f64; 2]], radius_m: f64) -> Result<(), PathError> {
    let n = corners.len();
    if n < 3 {
        return Err(PathError::TooFewCorners { corners: n });
    }
    for i in 0..n {
        let before = Corner::new(corners, (i + n - 1) % n, radius_m);
        let here = Corner::new(corners, i, radius_m);
        let fits = here.side_m > 0.0 && before.tangent_m + here.tangent_m <= here.side_m;
        if !fits {
            return Err(PathError::SideTooShort { corner: i });
        }
    }
    Ok(())
}

/// The point `arc_m` metres after the end of the first corner's arc.
pub(super) fn point(corners: &[[f64; 2]], radius_m: f64, arc_m: f64) -> CurvePoint {
    let n = corners.len();
    let length: f64 = (0..n)
        .map(|i| {
            let corner = Corner::new(corners, i, radius_m);
            corner.side_m - 2.0 * corner.tangent_m + radius_m * corner.turn_rad.abs()
        })
        .sum();
    let mut left = arc_m.rem_euclid(length);
    let mut before = Corner::new(corners, 0, radius_m);
    for i in (1..n).chain([0]) {
        let corner = Corner::new(corners, i, radius_m);
        let (c, s) = (libm::cos(corner.heading), libm::sin(corner.heading));
        let straight = corner.side_m - before.tangent_m - corner.tangent_m;
        let from_corner = |distance: f64| [corners[i][0] - distance * c, corners[i][1] - distance * s];
        if left < straight {
            let position = from_corner(corner.tangent_m + straight - left);
            return CurvePoint { position, heading: corner.heading, curvature: 0.0 };
        }
        left -= straight;
        let arc = radius_m * corner.turn_rad.abs();
        let is_last = i == 0;
        if left < arc || is_last {
            let start = from_corner(corner.tangent_m);
            let side = corner.turn_rad.signum();
            let heading = corner.heading + side * left / radius_m;
            let position = [
                start[0] + side * radius_m * (libm::sin(heading) - s),
                start[1] - side * radius_m * (libm::cos(heading) - c),
            ];
            return CurvePoint { position, heading, curvature: side / radius_m };
        }
        left -= arc;
        before = corner;
    }
    unreachable!("the last corner's arc returns")
}

#[cfg(test)]
mod tests {
    use super::super::curve::{Path, wrapped};
    use super::*;

    const L_SHAPE: [[f64; 2]; 6] = [[0.0, 0.0], [0.6, 0.0], [0.6, 0.3], [0.3, 0.3], [0.3, 0.7], [0.0, 0.6]];

    #[test]
    fn curve_is_closed_smooth_and_measured_by_its_arc() {
        let h = 1e-5;
        for i in 0..4000 {
            let s = 0.000_3 + f64::from(i) * 0.001;
            let (a, b) = (point(&L_SHAPE, 0.05, s - h), point(&L_SHAPE, 0.05, s + h));
            let d = [0, 1].map(|k| (b.position[k] - a.position[k]) / (2.0 * h));
            assert!((libm::hypot(d[0], d[1]) - 1.0).abs() < 1e-6, "at {s}: {d:?}");
            let along = libm::atan2(d[1], d[0]);
            assert!(wrapped(along - point(&L_SHAPE, 0.05, s).heading).abs() < 1e-3, "at {s}");
        }
    }

    #[test]
    fn square_has_its_side_and_goes_counter_clockwise() {
        let Path::Waypoints { corners, corner_radius_m, .. } = Path::square([0.6, 0.0], 0.4, 0.1) else {
            panic!("a square is a polygon")
        };
        let points: Vec<_> =
            (0..1000).map(|i| point(&corners, corner_radius_m, f64::from(i) * 0.0016)).collect();
        let most = points.iter().map(|p| p.position[0]).fold(f64::MIN, f64::max);
        let least = points.iter().map(|p| p.position[0]).fold(f64::MAX, f64::min);
        assert!((most - 0.8).abs() < 1e-9 && (least - 0.4).abs() < 1e-9, "x from {least} to {most}");
        assert!(points.iter().all(|p| p.curvature >= 0.0));
    }

    #[test]
    fn arcs_that_do_not_fit_are_refused() {
        assert_eq!(check(&L_SHAPE, 0.05), Ok(()));
        assert_eq!(check(&L_SHAPE, 0.2), Err(PathError::SideTooShort { corner: 2 }));
        assert_eq!(check(&L_SHAPE[..2], 0.05), Err(PathError::TooFewCorners { corners: 2 }));
    }
}
