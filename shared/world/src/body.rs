//! The rapier side: arm, table and vehicle as bodies, and the arm's drives as motors.

use crate::drives::{Drive, GRAVITY_M_PER_S2, LinkMass};
use nalgebra::{Isometry3, Matrix3, Vector3};
use pursuit_kinematics::{Arm, JOINTS};
use rapier3d::prelude::*;
use serde::{Deserialize, Serialize};

/// Contacts are found this far ahead, m (rapier's own 20 mm lets them start 14 mm early).
const PREDICTION_M: f32 = 0.002;
/// Penetration that is not corrected, m.
const ALLOWED_ERROR_M: f32 = 0.0005;
/// Half edges of the vehicle, m: 0.15 x 0.10 x 0.06.
const VEHICLE_HALF_M: [f32; 3] = [0.075, 0.05, 0.03];
/// Half edges of the table, m; its top is the plane z = 0.
const TABLE_HALF_M: [f32; 3] = [2.0, 2.0, 0.05];
/// A vehicle that moves further than this in one step was put there, not driven, m.
const PUT_M: f32 = 0.05;

const ARM: Group = Group::GROUP_1;
const SCENE: Group = Group::GROUP_2;

/// Where the vehicle stands on the table, base frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct VehiclePose {
    /// m.
    pub x_m: f64,
    /// m.
    pub y_m: f64,
    /// Angle from the x axis of the base frame, rad.
    pub heading_rad: f64,
}

impl VehiclePose {
    /// Out of everybody's way, for scenes without a vehicle.
    pub const PARKED: VehiclePose = VehiclePose { x_m: -10.0, y_m: 0.0, heading_rad: 0.0 };
}

/// All bodies and the handles to them.
#[derive(Serialize, Deserialize)]
pub(crate) struct Bodies {
    physics: PhysicsWorld,
    links: [RigidBodyHandle; JOINTS],
    joints: [MultibodyJointHandle; JOINTS],
    vehicle: RigidBodyHandle,
}

/// What the bodies are built from.
pub(crate) struct Build<'a> {
    pub(crate) arm: &'a Arm,
    pub(crate) masses: &'a [LinkMass; JOINTS],
    pub(crate) drives: &'a [Drive; JOINTS],
    pub(crate) start_rad: &'a [f64; JOINTS],
    pub(crate) step_s: f64,
    pub(crate) substeps: usize,
}

impl Bodies {
    pub(crate) fn new(build: &Build) -> Bodies {
        let mut physics = PhysicsWorld::new();
        physics.gravity = Vector::new(0.0, 0.0, -GRAVITY_M_PER_S2 as f32);
        let settings = &mut physics.integration_parameters;
        settings.dt = build.step_s as f32;
        // These are true substeps: the mass matrix is evaluated anew in each.
        settings.num_solver_iterations = build.substeps;
        settings.num_internal_pgs_iterations = 1;
        settings.normalized_prediction_distance = PREDICTION_M;
        settings.normalized_allowed_linear_error = ALLOWED_ERROR_M;
        settings.max_ccd_substeps = 0;
        let table = RigidBodyBuilder::fixed().translation(Vector::new(0.0, 0.0, -TABLE_HALF_M[2]));
        physics.insert(table, scene_collider(TABLE_HALF_M));
        let vehicle = RigidBodyBuilder::kinematic_position_based().pose(vehicle_pose(&VehiclePose::PARKED));
        let (vehicle, _) = physics.insert(vehicle, scene_collider(VEHICLE_HALF_M));
        let (links, joints) = insert_arm(&mut physics, build);
        Bodies { physics, links, joints, vehicle }
    }

    /// Joint positions (rad, unwrapped) and velocities (rad/s).
    pub(crate) fn joint_state(&self) -> ([f64; JOINTS], [f64; JOINTS]) {
        let mut position = [0.0; JOINTS];
        let mut velocity = [0.0; JOINTS];
        for (i, handle) in self.joints.iter().enumerate() {
            let link = self.physics.multibody_joints.get(*handle);
            let Some((multibody, link)) = link.and_then(|(body, id)| Some((body, body.link(id)?))) else {
                panic!("the arm's joints are never removed");
            };
            // Coordinate 3 of a joint is the angle about its x axis.
            position[i] = f64::from(link.joint().coords()[3]);
            velocity[i] = f64::from(multibody.joint_velocity(link)[0]);
        }
        (position, velocity)
    }

    /// Sets what the drives aim at in the next step: position (rad), velocity (rad/s) and the gravity
    /// feed-forward (N m), which counts against the drive's highest torque.
    pub(crate) fn drive(
        &mut self,
        drives: &[Drive; JOINTS],
        position: &[f64; JOINTS],
        velocity: &[f64; JOINTS],
        feed_forward_nm: &[f64; JOINTS],
    ) {
        for handle in self.links {
            self.physics.bodies[handle].reset_torques(false);
        }
        for i in 0..JOINTS {
            let left_nm = (drives[i].max_torque_nm - feed_forward_nm[i].abs()).max(0.0);
            let motor = &mut joint_data(&mut self.physics, self.joints[i]).motors[JointAxis::AngX as usize];
            motor.target_pos = position[i] as f32;
            motor.target_vel = velocity[i] as f32;
            motor.max_force = left_nm as f32;
            // A joint torque acts on the child and, reversed, on the parent.
            let child = &mut self.physics.bodies[self.links[i]];
            let torque = child.rotation() * Vector::new(0.0, 0.0, 1.0) * feed_forward_nm[i] as f32;
            child.add_torque(torque, true);
            if i > 0 {
                self.physics.bodies[self.links[i - 1]].add_torque(-torque, true);
            }
        }
    }

    /// Moves the vehicle to where it is at the end of the next step.
    pub(crate) fn place_vehicle(&mut self, pose: &VehiclePose) {
        let vehicle = &mut self.physics.bodies[self.vehicle];
        let pose = vehicle_pose(pose);
        if (vehicle.position().translation - pose.translation).length() > PUT_M {
            vehicle.set_position(pose, true);
        }
        vehicle.set_next_kinematic_position(pose);
    }

    /// One step; `false` when rapier had to disable a body because its state was not finite.
    pub(crate) fn step(&mut self) -> bool {
        self.physics.step();
        self.physics.quarantine().is_empty()
    }

    /// Whether the arm touches the table or the vehicle.
    pub(crate) fn touching(&self) -> bool {
        self.physics.contact_pairs().any(|pair| pair.has_any_active_contact())
    }

    /// Bits of all body poses, in a fixed order.
    pub(crate) fn pose_bits(&self) -> impl Iterator<Item = u32> + '_ {
        self.links.iter().chain([&self.vehicle]).flat_map(|handle| {
            let pose = self.physics.bodies[*handle].position();
            let (t, r) = (pose.translation, pose.rotation);
            [t.x, t.y, t.z, r.x, r.y, r.z, r.w].map(f32::to_bits)
        })
    }
}

/// Inserts the six links as one multibody on a fixed base. A link's body frame is its joint's frame: z
/// along the joint axis, turned by the joint angle.
fn insert_arm(
    physics: &mut PhysicsWorld,
    build: &Build,
) -> ([RigidBodyHandle; JOINTS], [MultibodyJointHandle; JOINTS]) {
    let base = physics.insert_body(RigidBodyBuilder::fixed());
    // rapier's revolute axis is x.
    let turned = Pose::from_parts(Vector::ZERO, Rotation::from_rotation_y(-std::f32::consts::FRAC_PI_2));
    let mut parent = base;
    let mut parent_from_joint = Isometry3::identity();
    let mut links = [base; JOINTS];
    let joints = std::array::from_fn(|i| {
        let link = &build.arm.links[i];
        let body = RigidBodyBuilder::dynamic()
            .additional_mass_properties(mass_properties(&link.joint_from_link(), &build.masses[i]))
            .can_sleep(false);
        let child = physics.insert_body(body);
        if let Some(collider) = link_collider(build.arm, i) {
            physics.insert_collider(collider, Some(child));
        }
        let [low, high] = link.position_limits_rad.map(|limit| limit as f32);
        let drive = &build.drives[i];
        let joint = GenericJointBuilder::new(JointAxesMask::LOCKED_REVOLUTE_AXES)
            .local_frame1(pose(&parent_from_joint) * turned)
            .local_frame2(turned)
            .contacts_enabled(false)
            .limits(JointAxis::AngX, [low, high])
            .motor_model(JointAxis::AngX, MotorModel::ForceBased)
            .set_motor(
                JointAxis::AngX,
                build.start_rad[i] as f32,
                0.0,
                drive.stiffness_nm_per_rad as f32,
                drive.damping_nm_s_per_rad as f32,
            )
            .motor_max_force(JointAxis::AngX, drive.max_torque_nm as f32);
        let Some(handle) = physics.multibody_joints.insert(parent, child, joint.build(), true) else {
            panic!("a serial chain has no loops");
        };
        links[i] = child;
        parent = child;
        parent_from_joint = link.joint_from_link();
        handle
    });
    settle(physics, &joints, build);
    (links, joints)
}

/// Puts the joints to their start: insertion sets them to 0, and the fixed base counts as six free
/// coordinates until the first forward kinematics.
fn settle(physics: &mut PhysicsWorld, joints: &[MultibodyJointHandle; JOINTS], build: &Build) {
    for (handle, start) in joints.iter().zip(build.start_rad) {
        if let Some((multibody, id)) = physics.multibody_joints.get_mut(*handle)
            && let Some(link) = multibody.link_mut(id)
        {
            link.joint.apply_displacement(&[*start as f32]);
        }
    }
    let Some((multibody, _)) = physics.multibody_joints.get_mut(joints[0]) else {
        panic!("the arm has just been inserted");
    };
    multibody.set_self_contacts_enabled(false);
    multibody.forward_kinematics(&physics.bodies, true);
    multibody.update_rigid_bodies(&mut physics.bodies, true);
    assert_eq!(multibody.ndofs(), JOINTS, "the base must be fixed after forward kinematics");
    for (i, drive) in build.drives.iter().enumerate() {
        multibody.armature_mut()[i] = drive.armature_kg_m2 as f32;
        multibody.damping_mut()[i] = drive.viscous_nm_s_per_rad as f32;
        multibody.frictions_mut()[i] = drive.coulomb_nm as f32;
    }
}

fn joint_data(physics: &mut PhysicsWorld, handle: MultibodyJointHandle) -> &mut GenericJoint {
    let link = physics.multibody_joints.get_mut(handle).and_then(|(body, id)| body.link_mut(id));
    match link {
        Some(link) => &mut link.joint.data,
        None => panic!("the arm's joints are never removed"),
    }
}

/// Upper arm, forearm and camera can touch the table and the vehicle; nothing else of the arm can.
fn link_collider(arm: &Arm, index: usize) -> Option<ColliderBuilder> {
    let along = |x: f64, z: f64| Vector::new(x as f32, 0.0, z as f32);
    let (end, radius_m) = match index {
        1 => (along(arm.links[1].a_m, 0.0), 0.07),
        3 => (along(0.0, arm.links[3].d_m), 0.05),
        5 => (along(0.0, arm.wrist_to_camera_m()), 0.035),
        _ => return None,
    };
    let collider = ColliderBuilder::capsule_from_endpoints(Vector::ZERO, end, radius_m)
        .density(0.0)
        .collision_groups(InteractionGroups::new(ARM, SCENE, InteractionTestMode::And));
    Some(collider)
}

fn scene_collider(half_m: [f32; 3]) -> ColliderBuilder {
    ColliderBuilder::cuboid(half_m[0], half_m[1], half_m[2]).collision_groups(InteractionGroups::new(
        SCENE,
        ARM,
        InteractionTestMode::And,
    ))
}

/// Mass properties of a link in its body (joint) frame.
fn mass_properties(joint_from_link: &Isometry3<f64>, mass: &LinkMass) -> MassProperties {
    let centre = joint_from_link * nalgebra::Point3::from(mass.centre_m);
    let turn = joint_from_link.rotation.to_rotation_matrix();
    let inertia = turn.matrix()
        * Matrix3::from_diagonal(&Vector3::from(mass.inertia_kg_m2))
        * turn.matrix().transpose();
    let column = |c: usize| vector(&inertia.column(c).into_owned());
    let inertia = rapier3d::math::Matrix::from_cols(column(0), column(1), column(2));
    MassProperties::with_inertia_matrix(vector(&centre.coords), mass.mass_kg as f32, inertia)
}

fn vehicle_pose(pose: &VehiclePose) -> Pose {
    let centre = Vector::new(pose.x_m as f32, pose.y_m as f32, VEHICLE_HALF_M[2]);
    Pose::from_parts(centre, Rotation::from_rotation_z(pose.heading_rad as f32))
}

fn pose(isometry: &Isometry3<f64>) -> Pose {
    let q = isometry.rotation.quaternion();
    let rotation = Rotation::from_xyzw(q.i as f32, q.j as f32, q.k as f32, q.w as f32).normalize();
    Pose::from_parts(vector(&isometry.translation.vector), rotation)
}

fn vector(v: &Vector3<f64>) -> Vector {
    Vector::new(v.x as f32, v.y as f32, v.z as f32)
}
