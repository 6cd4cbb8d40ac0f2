//! Shapes on the way to parry and back: the one place where the two linear algebras meet.

use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use parry3d_f64::math::{Pose, Vector};
use parry3d_f64::query::{ClosestPoints, closest_points};
use parry3d_f64::shape::{Shape as ParryShape, SharedShape};
use rover::{Frame, LinkId, Robot, Shape};

use crate::form::{Core, Form};
use crate::pairs::Body;

/// A shape of a link as parry wants it.
#[derive(Clone)]
pub(crate) struct Part {
    pub link: LinkId,
    pub body: Body,
    pub shape: SharedShape,
    /// The same for quick tests.
    pub form: Form,
    pub core: Core,
    pub link_from_part: Isometry3<f64>,
    /// True for the wheel itself, which may touch the ground.
    pub is_wheel: bool,
}

/// All shapes of the robot, in the order of its links.
pub(crate) fn parts_of(robot: &Robot) -> Vec<Part> {
    // parry's cylinders and capsules stand along y, ours along z.
    let upright = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::FRAC_PI_2);
    let mut parts = Vec::new();
    for (i, link) in robot.links().iter().enumerate() {
        let id = LinkId(i);
        let body = Body::of(robot, id);
        let is_wheel = robot.legs().iter().any(|leg| leg.wheel_link == id);
        for placed in &link.shapes {
            let (shape, turn, form) = match placed.shape {
                Shape::Box { half_extents: h } => {
                    let shape = SharedShape::cuboid(h.x, h.y, h.z);
                    (shape, UnitQuaternion::identity(), Form::Box { half: h })
                }
                Shape::Cylinder { radius, half_length: half } => {
                    let shape = SharedShape::cylinder(half, radius);
                    (shape, upright, Form::Cylinder { radius, half })
                }
                Shape::Capsule { radius, half_length: half } => {
                    let shape = SharedShape::capsule_y(half, radius);
                    (shape, upright, Form::Capsule { radius, half })
                }
                Shape::Sphere { radius } => {
                    let shape = SharedShape::ball(radius);
                    (shape, UnitQuaternion::identity(), Form::Sphere { radius })
                }
            };
            let link_from_part = placed.link_from_shape * turn;
            let core = form.core();
            parts.push(Part { link: id, body, shape, form, core, link_from_part, is_wheel });
        }
    }
    parts
}

/// The edge to parry: glam poses from nalgebra ones.
pub(crate) fn to_pose(isometry: &Isometry3<f64>) -> Pose {
    Pose::from(*isometry)
}

pub(crate) fn pose_of(frame: &Frame) -> Pose {
    to_pose(&frame.to_isometry())
}

pub(crate) fn to_parry_point(p: &Point3<f64>) -> Vector {
    Vector::new(p.x, p.y, p.z)
}

/// How near two convex solids are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Near {
    /// Distance (m), zero if they overlap.
    pub distance: f64,
    /// The point on the second solid nearest to the first; on overlap the first one's origin.
    pub place: Point3<f64>,
}

/// The distance of two solids if it is less than `limit` (m).
pub(crate) fn near(
    pose_a: &Pose,
    a: &dyn ParryShape,
    pose_b: &Pose,
    b: &dyn ParryShape,
    limit: f64,
) -> Option<Near> {
    let origin = pose_a.translation;
    match closest_points(pose_a, a, pose_b, b, limit) {
        Ok(ClosestPoints::Disjoint) => None,
        Ok(ClosestPoints::WithinMargin(p, q)) => {
            let distance = (q - p).length();
            (distance < limit).then_some(Near { distance, place: Point3::new(q.x, q.y, q.z) })
        }
        // A pair that parry cannot answer counts as touching: the safe side.
        Ok(ClosestPoints::Intersecting) | Err(_) => {
            Some(Near { distance: 0.0, place: Point3::new(origin.x, origin.y, origin.z) })
        }
    }
}
