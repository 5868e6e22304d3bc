//! Masses and drives of the arm, and the torque that holds it against gravity.

use nalgebra::{Isometry3, Point3, Vector3};
use pursuit_kinematics::{Arm, JOINTS};
use serde::{Deserialize, Serialize};

/// Acceleration of gravity along -z of the base frame, m/s².
pub const GRAVITY_M_PER_S2: f64 = 9.81;

/// Mass of one link.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LinkMass {
    /// kg.
    pub mass_kg: f64,
    /// Centre of mass in the link's DH frame, m.
    pub centre_m: [f64; 3],
    /// Principal moments about the centre of mass along the axes of the link's DH frame, kg m².
    pub inertia_kg_m2: [f64; 3],
}

/// One joint's drive: motor, gear and position controller, seen from the joint.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Drive {
    /// Rotor inertia times gear ratio squared, kg m².
    pub armature_kg_m2: f64,
    /// Viscous friction, N m s/rad.
    pub viscous_nm_s_per_rad: f64,
    /// Coulomb friction, N m.
    pub coulomb_nm: f64,
    /// Highest torque, N m.
    pub max_torque_nm: f64,
    /// Gain on the position error, N m/rad.
    pub stiffness_nm_per_rad: f64,
    /// Gain on the velocity error, N m s/rad.
    pub damping_nm_s_per_rad: f64,
    /// Deceleration of the drive's own stop when its cycles run out, rad/s².
    pub stop_rad_per_s2: f64,
}

const fn mass(mass_kg: f64, centre_m: [f64; 3], inertia_kg_m2: [f64; 3]) -> LinkMass {
    LinkMass { mass_kg, centre_m, inertia_kg_m2 }
}

const fn drive(friction: [f64; 3], max_torque_nm: f64, gains: [f64; 2], stop_rad_per_s2: f64) -> Drive {
    Drive {
        armature_kg_m2: friction[0],
        viscous_nm_s_per_rad: friction[1],
        coulomb_nm: friction[2],
        max_torque_nm,
        stiffness_nm_per_rad: gains[0],
        damping_nm_s_per_rad: gains[1],
        stop_rad_per_s2,
    }
}

/// Masses of the PUMA 560 as published; link 1 is the base column, link 6 carries a 0.3 kg camera.
///
/// Deviations: the published I_yy of link 3 (0.086) breaks the triangle inequality, 0.078 is used; the
/// centre of link 6 is published from the wrist, here from the flange frame 0.05625 m beyond.
pub const PUMA_MASSES: [LinkMass; JOINTS] = [
    mass(13.0, [0.0, -0.2, 0.0], [0.35, 0.35, 0.35]),
    mass(17.4, [-0.3638, 0.006, 0.2275], [0.13, 0.524, 0.539]),
    mass(4.8, [-0.0203, -0.0141, 0.070], [0.066, 0.078, 0.0125]),
    mass(0.82, [0.0, 0.019, 0.0], [1.8e-3, 1.3e-3, 1.8e-3]),
    mass(0.34, [0.0, 0.0, 0.0], [0.3e-3, 0.4e-3, 0.3e-3]),
    mass(0.39, [0.0, 0.0, 0.0689 - 0.05625], [0.6e-3, 0.6e-3, 0.2e-3]),
];

/// Drives of the PUMA 560: armature, viscous and Coulomb friction from the published motor table;
/// gains for 8 Hz (joints 1 to 3) and 12 Hz (4 to 6), critically damped at the middle pose. The stops of
/// joints 3 and 5 are as much faster as the coupling makes them.
pub const PUMA_DRIVES: [Drive; JOINTS] = [
    drive([0.784, 5.80, 26.0], 97.6, [9228.0, 367.0], 8.0),
    drive([2.325, 9.50, 10.6], 186.4, [11059.0, 440.0], 8.0),
    drive([0.577, 3.98, 6.36], 89.4, [2543.0, 101.0], 24.0),
    drive([0.191, 0.412, 1.07], 24.2, [1099.0, 29.0], 24.0),
    drive([0.171, 0.427, 0.854], 20.1, [987.0, 26.0], 24.0),
    drive([0.194, 0.216, 0.554], 21.3, [1104.0, 29.0], 24.0),
];

/// Torques, N m, that hold the arm at rest at `position_rad` against gravity: the feed-forward.
pub fn gravity_torque_nm(
    arm: &Arm,
    masses: &[LinkMass; JOINTS],
    position_rad: &[f64; JOINTS],
) -> [f64; JOINTS] {
    let base_from_links = arm.base_from_links(position_rad);
    let mut torque = [0.0; JOINTS];
    // From the tip: weight and its moment about the base origin of all links from joint i outward.
    let mut weight_n = 0.0;
    let mut moment_nm = Vector3::zeros();
    for i in (0..JOINTS).rev() {
        let link_weight = masses[i].mass_kg * GRAVITY_M_PER_S2;
        let centre = base_from_links[i] * Point3::from(masses[i].centre_m);
        weight_n += link_weight;
        moment_nm += centre.coords.cross(&Vector3::new(0.0, 0.0, -link_weight));
        let base_from_joint = if i == 0 { Isometry3::identity() } else { base_from_links[i - 1] };
        let axis = base_from_joint.rotation * Vector3::z();
        let about_joint =
            moment_nm - base_from_joint.translation.vector.cross(&Vector3::new(0.0, 0.0, -weight_n));
        torque[i] = -axis.dot(&about_joint);
    }
    torque
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Potential energy of the arm, J: the oracle.
    fn potential_j(position_rad: &[f64; JOINTS]) -> f64 {
        let frames = Arm::puma_like().base_from_links(position_rad);
        frames
            .iter()
            .zip(PUMA_MASSES)
            .map(|(frame, link)| link.mass_kg * GRAVITY_M_PER_S2 * (frame * Point3::from(link.centre_m)).z)
            .sum()
    }

    #[test]
    fn the_holding_torque_is_the_slope_of_the_potential() {
        let pose = [0.3, 0.77, -3.3, 0.4, -0.58, 0.2];
        let torque = gravity_torque_nm(&Arm::puma_like(), &PUMA_MASSES, &pose);
        for joint in 0..JOINTS {
            let (mut more, mut less) = (pose, pose);
            more[joint] += 1e-5;
            less[joint] -= 1e-5;
            let slope = (potential_j(&more) - potential_j(&less)) / 2e-5;
            assert!((torque[joint] - slope).abs() < 1e-6, "joint {}: {} {slope}", joint + 1, torque[joint]);
        }
        assert!(torque[1].abs() > 1.0, "{torque:?}");
    }

    #[test]
    fn every_link_has_a_possible_inertia() {
        for [x, y, z] in PUMA_MASSES.map(|link| link.inertia_kg_m2) {
            assert!(x + y >= z && y + z >= x && z + x >= y);
        }
    }
}
