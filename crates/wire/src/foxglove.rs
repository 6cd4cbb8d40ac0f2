//! What 3-D viewers draw: poses of all links, joints, and the scene of the stance, as messages of
//! the Foxglove schemas in protobuf.
//!
//! All of it follows from [`RoverTelemetry`] and [`StabilityDerived`], so a live rover and a replay are
//! drawn the same. Frames: every link is a child of `world`.

mod camera;

use nalgebra::{Isometry3, UnitQuaternion, Vector3 as Vec3};
use prost::Message;
use prost_types::{Duration, Timestamp as ProtoTimestamp};
use rover::{Posture, Robot};

use crate::check::{At, RequestError};
use crate::convert;
use crate::live::{PolygonAnswer, RoverTelemetry, StabilityDerived};
use crate::time::Timestamp;

pub use camera::{
    CALIBRATION_SCHEMA, CameraMessages, CameraTopics, IMAGE_SCHEMA, PLACE_SCHEMA, camera_messages,
    png_of,
};

/// The generated types.
#[allow(missing_docs)]
pub mod schema {
    include!(concat!(env!("OUT_DIR"), "/foxglove.rs"));
}

use schema::line_primitive::Type as LineType;
use schema::{
    ArrowPrimitive, Color, FrameTransform, FrameTransforms, JointState, JointStates, LinePrimitive,
    Point3, Pose, Quaternion, SceneEntity, SceneUpdate, SpherePrimitive, Vector3,
};

/// The descriptors of all types, as a `FileDescriptorSet`: the schema that travels with the messages.
pub const DESCRIPTORS: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/foxglove.descriptors"));

/// A topic of this module, and the name of its schema.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Topic {
    /// Its name.
    pub name: &'static str,
    /// Its schema.
    pub schema_name: &'static str,
}

/// Poses of all links in `world`.
pub const TRANSFORMS: Topic = Topic { name: "/tf", schema_name: "foxglove.FrameTransforms" };
/// Joint angles and torques.
pub const JOINTS: Topic = Topic { name: "/joints", schema_name: "foxglove.JointStates" };
/// Forces of the ground on the wheels.
pub const FORCES: Topic = Topic { name: "/scene/forces", schema_name: "foxglove.SceneUpdate" };
/// Support polygons and center of mass.
pub const STANCE: Topic = Topic { name: "/scene/stance", schema_name: "foxglove.SceneUpdate" };

/// What is drawn is taken away when nothing new has come for so long (s).
const LIFETIME_S: i64 = 3;
/// An arrow of this length (m) is the weight that one of six feet bears.
const ARROW_M: f64 = 0.6;
/// Polygons lie this far above the lowest contact (m), so that level ground does not hide them.
const ABOVE_GROUND_M: f64 = 0.02;

const WHITE: Color = Color { r: 0.92, g: 0.94, b: 0.96, a: 1.0 };
const BLUE: Color = Color { r: 0.33, g: 0.62, b: 0.95, a: 1.0 };
const AMBER: Color = Color { r: 0.95, g: 0.70, b: 0.25, a: 1.0 };

/// The poses of all links, encoded.
///
/// # Errors
/// Where the frame is not one of this robot, with the field that tells.
pub fn transforms(
    robot: &Robot,
    frame: &RoverTelemetry,
    time: Timestamp,
) -> Result<Vec<u8>, RequestError> {
    let configuration = convert::configuration(&At::root("state"), robot, &frame.state)?;
    let posture = Posture::new(robot, &configuration);
    let transform = |(index, link): (usize, &rover::Link)| {
        let world_from_link = posture.link(rover::LinkId(index));
        FrameTransform {
            timestamp: Some(timestamp(time)),
            parent_frame_id: "world".into(),
            child_frame_id: link.name.clone(),
            translation: Some(vector(&world_from_link.translation.vector)),
            rotation: Some(quaternion(&world_from_link.rotation)),
        }
    };
    let transforms = robot.links().iter().enumerate().map(transform).collect();
    Ok(FrameTransforms { transforms }.encode_to_vec())
}

/// Angles and torques of all joints of the legs, encoded.
pub fn joints(robot: &Robot, frame: &RoverTelemetry, time: Timestamp) -> Vec<u8> {
    let mut joints = JointState { timestamp: Some(timestamp(time)), ..JointState::default() };
    for leg in robot.legs() {
        let of_leg = |values: Option<&Vec<f64>>| values.cloned().unwrap_or_default();
        let angles = of_leg(frame.state.joints_rad.get(&leg.name));
        let torques = of_leg(frame.joint_torques_nm.get(&leg.name));
        for (i, joint) in leg.joints.iter().enumerate() {
            joints.name.push(robot.joints()[*joint].name.clone());
            joints.position.push(angles.get(i).copied().unwrap_or(f64::NAN));
            joints.effort.push(torques.get(i).copied().unwrap_or(f64::NAN));
        }
    }
    JointStates { timestamp: joints.timestamp, joints: vec![joints] }.encode_to_vec()
}

/// The forces of the ground on the wheels, encoded: arrows that point where the force does.
pub fn forces(robot: &Robot, frame: &RoverTelemetry, time: Timestamp) -> Vec<u8> {
    let sum: f64 = frame.wheel_forces_n.values().map(|force| force[2]).sum();
    let bearing = sum.abs().max(1.0) / robot.legs().len().max(1) as f64;
    let arrows = frame.wheel_forces_n.iter().filter_map(|(leg, force)| {
        let contact = frame.contact_points_m.get(leg)?;
        arrow(Vec3::from(*contact), Vec3::from(*force) * (ARROW_M / bearing))
    });
    let entity = SceneEntity { arrows: arrows.collect(), ..entity("forces", time) };
    SceneUpdate { entities: vec![entity] }.encode_to_vec()
}

/// Support polygons and the center of mass, encoded. `ground_m` is the height at which to draw the
/// polygons: see [`ground_height`].
pub fn stance(derived: &StabilityDerived, ground_m: f64, time: Timestamp) -> Vec<u8> {
    let z = ground_m + ABOVE_GROUND_M;
    let friction = derived.forces.as_ref().and_then(|forces| forces.friction.region.as_ref());
    let polygons = [
        (derived.regular.as_ref(), WHITE),
        (derived.conservative.as_ref(), BLUE),
        (friction, AMBER),
    ];
    let outline = |(polygon, color): (Option<&PolygonAnswer>, Color)| {
        let points = polygon?.polygon_m.iter().map(|p| Point3 { x: p[0], y: p[1], z });
        Some(line(LineType::LineLoop, points.collect(), color))
    };
    let [x, y, com_z] = derived.com_m;
    let plumb = vec![Point3 { x, y, z: com_z }, Point3 { x, y, z }];
    let mut lines: Vec<_> = polygons.into_iter().filter_map(outline).collect();
    lines.push(line(LineType::LineStrip, plumb, WHITE));
    let com = SpherePrimitive {
        pose: Some(pose(&Isometry3::translation(x, y, com_z))),
        size: Some(Vector3 { x: 0.12, y: 0.12, z: 0.12 }),
        color: Some(WHITE),
    };
    let entity = SceneEntity { lines, spheres: vec![com], ..entity("stance", time) };
    SceneUpdate { entities: vec![entity] }.encode_to_vec()
}

/// The height of the lowest contact of a frame (m); that of the base where nothing stands.
pub fn ground_height(frame: &RoverTelemetry) -> f64 {
    let standing = frame
        .contact_points_m
        .iter()
        .filter(|(leg, _)| frame.contacts.get(leg.as_str()).copied().unwrap_or(false));
    let lowest = standing.map(|(_, point)| point[2]).fold(f64::INFINITY, f64::min);
    if lowest.is_finite() { lowest } else { frame.state.base.position_m[2] }
}

fn entity(id: &str, time: Timestamp) -> SceneEntity {
    SceneEntity {
        timestamp: Some(timestamp(time)),
        frame_id: "world".into(),
        id: id.into(),
        lifetime: Some(Duration { seconds: LIFETIME_S, nanos: 0 }),
        ..SceneEntity::default()
    }
}

fn line(kind: LineType, points: Vec<Point3>, color: Color) -> LinePrimitive {
    LinePrimitive {
        r#type: kind.into(),
        pose: Some(pose(&Isometry3::identity())),
        thickness: 2.0,
        scale_invariant: true,
        points,
        color: Some(color),
    }
}

/// An arrow along `along` (m); none where that is too short to be seen.
fn arrow(from: Vec3<f64>, along: Vec3<f64>) -> Option<ArrowPrimitive> {
    let length = along.norm();
    if length.is_nan() || length < 0.01 {
        return None;
    }
    let rotation = UnitQuaternion::rotation_between(&Vec3::x(), &along)
        .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vec3::z_axis(), std::f64::consts::PI));
    let head = 0.1_f64.min(length / 2.0);
    Some(ArrowPrimitive {
        pose: Some(pose(&Isometry3::from_parts(from.into(), rotation))),
        shaft_length: length - head,
        shaft_diameter: 0.03,
        head_length: head,
        head_diameter: 0.07,
        color: Some(BLUE),
    })
}

fn timestamp(time: Timestamp) -> ProtoTimestamp {
    const NANOS: u64 = 1_000_000_000;
    // Both fit: 64 bits of nanoseconds are 1.8e10 seconds.
    ProtoTimestamp { seconds: (time.0 / NANOS) as i64, nanos: (time.0 % NANOS) as i32 }
}

fn pose(isometry: &Isometry3<f64>) -> Pose {
    Pose {
        position: Some(vector(&isometry.translation.vector)),
        orientation: Some(quaternion(&isometry.rotation)),
    }
}

fn vector(v: &Vec3<f64>) -> Vector3 {
    Vector3 { x: v.x, y: v.y, z: v.z }
}

fn quaternion(q: &UnitQuaternion<f64>) -> Quaternion {
    Quaternion { x: q.i, y: q.j, z: q.k, w: q.w }
}
