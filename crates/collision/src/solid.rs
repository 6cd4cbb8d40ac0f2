//! Shapes on the way to parry and back: the one place where the two linear algebras meet.

use std::sync::Arc;

use nalgebra::{Isometry3, Point3, Vector3};
use parry3d_f64::math::{Pose, Vector};
use parry3d_f64::query::{ClosestPoints, closest_points};
use parry3d_f64::shape::{ConvexPolyhedron, Shape as ParryShape, SharedShape};
use parry3d_f64::transformation::try_convex_hull;
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

/// All shapes of the robot, in the order of its links; a mesh as the hulls of its components.
pub(crate) fn parts_of(robot: &Robot) -> Vec<Part> {
    // parry's cylinders and capsules stand along y, ours along z.
    let upright = Isometry3::rotation(Vector3::x() * std::f64::consts::FRAC_PI_2);
    let mut parts = Vec::new();
    for (i, link) in robot.links().iter().enumerate() {
        let id = LinkId(i);
        let body = Body::of(robot, id);
        let is_wheel = robot.legs().iter().any(|leg| leg.wheel_link == id);
        for placed in &link.shapes {
            let mut add = |shape: SharedShape, turn: Isometry3<f64>, form: Form| {
                let link_from_part = placed.link_from_shape * turn;
                let core = form.core();
                parts.push(Part { link: id, body, shape, form, core, link_from_part, is_wheel });
            };
            let as_is = Isometry3::identity();
            match placed.shape {
                Shape::Box { half_extents: h } => {
                    add(SharedShape::cuboid(h.x, h.y, h.z), as_is, Form::Box { half: h });
                }
                Shape::Cylinder { radius, half_length: half } => {
                    let shape = SharedShape::cylinder(half, radius);
                    add(shape, upright, Form::Cylinder { radius, half });
                }
                Shape::Capsule { radius, half_length: half } => {
                    let shape = SharedShape::capsule_y(half, radius);
                    add(shape, upright, Form::Capsule { radius, half });
                }
                Shape::Sphere { radius } => {
                    add(SharedShape::ball(radius), as_is, Form::Sphere { radius });
                }
                Shape::Mesh(ref mesh) => {
                    for points in mesh.components() {
                        let (shape, place, form) = hull_of(points);
                        add(shape, place, form);
                    }
                }
            }
        }
    }
    parts
}

/// The convex hull of a mesh's component about its middle, and where that is on the mesh. Points that
/// lie in no common plane have a hull; should its computation still fail, their axis-parallel box,
/// which holds it, takes its place.
fn hull_of(points: Vec<Point3<f64>>) -> (SharedShape, Isometry3<f64>, Form) {
    let start = (Point3::from([f64::INFINITY; 3]), Point3::from([f64::NEG_INFINITY; 3]));
    let (low, high) = points.iter().fold(start, |(low, high), p| (low.inf(p), high.sup(p)));
    let (half, middle) = ((high - low) * 0.5, nalgebra::center(&low, &high).coords);
    let corners: Vec<Vector> = points.iter().map(|p| to_parry_point(&(p - middle))).collect();
    let hull = try_convex_hull(&corners).ok();
    let solid = hull.and_then(|(points, faces)| ConvexPolyhedron::from_convex_mesh(points, &faces));
    let (shape, form) = match solid {
        Some(solid) => {
            let points = solid.points().iter().map(|p| Point3::new(p.x, p.y, p.z)).collect();
            (SharedShape::new(solid), Form::Hull { points: Arc::new(points) })
        }
        None => (SharedShape::cuboid(half.x, half.y, half.z), Form::Box { half }),
    };
    (shape, Isometry3::from(middle), form)
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
