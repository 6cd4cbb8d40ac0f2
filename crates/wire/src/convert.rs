//! From the wire to the domain, and back.

use std::collections::BTreeMap;

use nalgebra::{Isometry3, Point3, Translation3, Vector3};
use rover::{Configuration, LegAngles, LegId, ModelError, Robot};

use crate::check::{self, At, RequestError};
use crate::scene::{Payload, PayloadShape, Pose, RoverState};

/// Number of joints of a leg.
const N_JOINTS: usize = 6;

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

/// The six angles of a leg, checked.
pub fn leg_angles(at: &At<'_>, joints_rad: &[f64]) -> Result<LegAngles, RequestError> {
    let Ok(angles) = <[f64; N_JOINTS]>::try_from(joints_rad) else {
        let text = format_args!("has {} angles; a leg has {N_JOINTS} joints", joints_rad.len());
        return Err(RequestError::at("joint_count", at, text));
    };
    for (i, q) in angles.into_iter().enumerate() {
        let bound = [-check::ANGLE_MAX_RAD, check::ANGLE_MAX_RAD];
        check::within(&at.index(i), q, bound, " rad")?;
    }
    Ok(LegAngles::from(angles))
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
        legs.push(leg_angles(&joints.field(&leg.name), angles)?);
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
        joints_rad: by_leg(robot, |leg| configuration.legs[leg.0].iter().copied().collect()),
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
    let shape = at.field("shape");
    let box_size = match payload.shape {
        Some(PayloadShape { box_m }) => Some(check::edges(&shape.field("box_m"), box_m)?.into()),
        None => None,
    };
    Ok(rover::Payload { link: payload.link.clone(), mass, com: com.into(), box_size })
}

/// Why a robot with this scale or these payloads cannot be.
pub fn model_error(at: &At<'_>, error: &ModelError) -> RequestError {
    let code = match error {
        ModelError::Scale { .. } => "out_of_range",
        ModelError::PayloadLink { .. } => "link_unknown",
        ModelError::Payload { .. } => "payload_invalid",
        _ => "robot_invalid",
    };
    RequestError::at(code, at, format_args!("was refused: {error}"))
}
