//! From the wire to the domain, and back.

use std::collections::BTreeMap;

use nalgebra::{Isometry3, Point3, Translation3, Vector3};
use rover::{
    Configuration, JointRange, Leg, LegAngles, LegId, LinkShape, ModelError, Robot, Shape,
};

use crate::check::{self, At, RequestError};
use crate::scene::{Payload, PlacedShape, Pose, RoverState};

/// Most shapes of a payload, and most joints whose range it cuts.
const PAYLOAD_PARTS_MAX: usize = 100;

/// A pose, checked.
pub fn isometry(at: &At<'_>, pose: &Pose) -> Result<Isometry3<f64>, RequestError> {
    let p = check::position(&at.field("position_m"), pose.position_m)?;
    let q = check::unit_quaternion(&at.field("orientation_xyzw"), pose.orientation_xyzw)?;
    Ok(Isometry3::from_parts(Translation3::from(Vector3::from(p)), q))
}

/// A pose for the wire.
pub fn pose(isometry: &Isometry3<f64>) -> Pose {
    let q = isometry.rotation.quaternion();
    Pose { position_m: isometry.translation.vector.into(), orientation_xyzw: [q.i, q.j, q.k, q.w] }
}

/// A point for the wire.
pub fn point(p: &Point3<f64>) -> [f64; 3] {
    [p.x, p.y, p.z]
}

/// A leg by its name.
pub fn leg(at: &At<'_>, robot: &Robot, name: &str) -> Result<LegId, RequestError> {
    robot.leg_id(name).ok_or_else(|| {
        let known: Vec<&str> = robot.legs().iter().map(|leg| leg.name.as_str()).collect();
        let name: String = name.chars().take(64).collect();
        let text = format_args!(
            "names the leg {name:?}, but the robot {:?} has {}",
            robot.name(),
            known.join(", ")
        );
        RequestError::at("leg_unknown", at, text)
    })
}

/// The angles of a leg, one a joint, checked.
pub fn leg_angles(at: &At<'_>, leg: &Leg, joints_rad: &[f64]) -> Result<LegAngles, RequestError> {
    let (n_angles, n_joints) = (joints_rad.len(), leg.n_joints());
    if n_angles != n_joints {
        let text = format_args!("has {n_angles} angles; the leg {:?} has {n_joints}", leg.name);
        return Err(RequestError::at("joint_count", at, text));
    }
    for (i, q) in joints_rad.iter().enumerate() {
        let bound = [-check::ANGLE_MAX_RAD, check::ANGLE_MAX_RAD];
        check::within(&at.index(i), *q, bound, " rad")?;
    }
    Ok(LegAngles::from_fn(|i, _| joints_rad.get(i).copied().unwrap_or(0.0)))
}

/// What a leg has one of by joint, without the padding.
pub fn by_joint(leg: &Leg, values: &LegAngles) -> Vec<f64> {
    values.iter().copied().take(leg.n_joints()).collect()
}

/// A configuration of `robot`: all of its legs and no other, wheels' spin checked and left out.
pub fn configuration(
    at: &At<'_>,
    robot: &Robot,
    state: &RoverState,
) -> Result<Configuration, RequestError> {
    let world_from_base = isometry(&at.field("base"), &state.base)?;
    let joints = at.field("joints_rad");
    for name in state.joints_rad.keys() {
        leg(&joints.field(name), robot, name)?;
    }
    let mut legs = Vec::with_capacity(robot.legs().len());
    for leg in robot.legs() {
        let Some(angles) = state.joints_rad.get(&leg.name) else {
            let text = format_args!("lacks the leg {:?}; a state gives all legs", leg.name);
            return Err(RequestError::at("leg_missing", &joints, text));
        };
        legs.push(leg_angles(&joints.field(&leg.name), leg, angles)?);
    }
    let wheels = at.field("wheels_rad");
    for (name, spin) in &state.wheels_rad {
        leg(&wheels.field(name), robot, name)?;
        check::finite(&wheels.field(name), *spin)?;
    }
    Ok(Configuration { world_from_base, legs })
}

/// A configuration for the wire.
pub fn rover_state(robot: &Robot, configuration: &Configuration) -> RoverState {
    RoverState {
        base: pose(&configuration.world_from_base),
        joints_rad: by_leg(robot, |leg| by_joint(robot.leg(leg), &configuration.legs[leg.0])),
        wheels_rad: BTreeMap::new(),
    }
}

/// A value for each leg, by name.
pub fn by_leg<T>(robot: &Robot, mut value: impl FnMut(LegId) -> T) -> BTreeMap<String, T> {
    robot.leg_ids().map(|leg| (robot.leg(leg).name.clone(), value(leg))).collect()
}

/// A payload, checked as far as it can be without the robot.
pub fn payload(at: &At<'_>, payload: &Payload) -> Result<rover::Payload, RequestError> {
    let com = check::position(&at.field("com_m"), payload.com_m)?;
    let mass = check::within(&at.field("mass_kg"), payload.mass_kg, [0.0, 1e6], " kg")?;
    let mut shapes = Vec::new();
    if let Some(shape) = payload.shape {
        let edges = check::edges(&at.field("shape").field("box_m"), shape.box_m)?;
        shapes.push(LinkShape {
            link_from_shape: Translation3::from(Vector3::from(com)).into(),
            shape: Shape::Box { half_extents: Vector3::from(edges) * 0.5 },
        });
    }
    let placed = at.field("shapes");
    check::at_most(&placed, payload.shapes.len(), PAYLOAD_PARTS_MAX)?;
    for (i, shape) in payload.shapes.iter().enumerate() {
        shapes.push(placed_shape(&placed.index(i), shape)?);
    }
    let ranges = at.field("limits_rad");
    check::at_most(&ranges, payload.limits_rad.len(), PAYLOAD_PARTS_MAX)?;
    let mut limits = Vec::new();
    for (joint, [lower, upper]) in &payload.limits_rad {
        let at = ranges.field(joint);
        let bound = [-check::ANGLE_MAX_RAD, check::ANGLE_MAX_RAD];
        limits.push(JointRange {
            joint: joint.clone(),
            lower: check::within(&at.index(0), *lower, bound, " rad")?,
            upper: check::within(&at.index(1), *upper, bound, " rad")?,
        });
    }
    Ok(rover::Payload { link: payload.link.clone(), mass, com: com.into(), shapes, limits })
}

/// A shape of a payload: exactly one kind, with its place in the link's frame.
fn placed_shape(at: &At<'_>, placed: &PlacedShape) -> Result<LinkShape, RequestError> {
    let shape = match (placed.box_m, placed.cylinder_m, placed.sphere_m) {
        (Some(edges), None, None) => {
            let edges = check::edges(&at.field("box_m"), edges)?;
            Shape::Box { half_extents: Vector3::from(edges) * 0.5 }
        }
        (None, Some([radius, length]), None) => {
            let [radius, length, _] =
                check::edges(&at.field("cylinder_m"), [radius, length, length])?;
            Shape::Cylinder { radius, half_length: 0.5 * length }
        }
        (None, None, Some(radius)) => {
            let [radius, ..] = check::edges(&at.field("sphere_m"), [radius; 3])?;
            Shape::Sphere { radius }
        }
        _ => {
            let text = "takes exactly one of box_m, cylinder_m and sphere_m";
            return Err(RequestError::at("payload_invalid", at, text));
        }
    };
    let position = check::position(&at.field("position_m"), placed.position_m)?;
    let orientation = placed.orientation_xyzw.unwrap_or([0.0, 0.0, 0.0, 1.0]);
    let turn = check::unit_quaternion(&at.field("orientation_xyzw"), orientation)?;
    let place = Translation3::from(Vector3::from(position));
    Ok(LinkShape { link_from_shape: Isometry3::from_parts(place, turn), shape })
}

/// Why a robot with this scale or these payloads cannot be.
pub fn model_error(at: &At<'_>, error: &ModelError) -> RequestError {
    let code = match error {
        ModelError::Scale { .. } => "out_of_range",
        ModelError::PayloadLink { .. } => "link_unknown",
        ModelError::Payload { .. }
        | ModelError::PayloadShape
        | ModelError::PayloadJoint { .. }
        | ModelError::PayloadLimits { .. } => "payload_invalid",
        _ => "robot_invalid",
    };
    RequestError::at(code, at, format_args!("was refused: {error}"))
}
