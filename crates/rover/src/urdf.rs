//! From URDF text to links and joints, with every refusal by name.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{Isometry3, Point3, Translation3, Unit, UnitQuaternion, Vector3};

use crate::model::{Joint, JointKind, Link, LinkId, ModelError};
use crate::shape::{LinkShape, Shape};

/// Most links a robot may have.
pub const MAX_LINKS: usize = 2000;

/// Longest URDF text (bytes).
const MAX_BYTES: usize = 1 << 20;

/// The links in topological order (parents first), each but the first with its parent joint.
pub(crate) struct Tree {
    pub links: Vec<Link>,
    pub joints: Vec<Joint>,
}

/// Parses `text`; `has_mesh` tells whether a mesh file of the folder exists.
pub(crate) fn parse(
    text: &str,
    base_link: &str,
    has_mesh: &dyn Fn(&str) -> bool,
) -> Result<Tree, ModelError> {
    if text.len() > MAX_BYTES {
        return Err(ModelError::UrdfTooLarge { bytes: text.len(), limit: MAX_BYTES });
    }
    // No robot needs a document type or entities; both are ways to blow up or to reach files.
    if text.contains("<!") && text.match_indices("<!").any(|(i, _)| !text[i..].starts_with("<!--"))
    {
        return Err(ModelError::DocumentType);
    }
    let n_links = text.matches("<link").count();
    if n_links > MAX_LINKS {
        return Err(ModelError::TooManyLinks { n_links, limit: MAX_LINKS });
    }
    let robot = urdf_rs::read_from_string(text)
        .map_err(|e| ModelError::UrdfSyntax { message: one_line(&e.to_string()) })?;
    build(&robot, base_link, has_mesh)
}

fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ").chars().take(300).collect()
}

fn build(
    robot: &urdf_rs::Robot,
    base_link: &str,
    has_mesh: &dyn Fn(&str) -> bool,
) -> Result<Tree, ModelError> {
    let mut by_name = BTreeMap::new();
    for link in &robot.links {
        if by_name.insert(link.name.as_str(), link).is_some() {
            return Err(ModelError::DuplicateName { kind: "link", name: link.name.clone() });
        }
    }
    if !by_name.contains_key(base_link) {
        return Err(ModelError::UnknownLink { name: base_link.into() });
    }
    let mut joint_names = BTreeSet::new();
    let mut children: BTreeMap<&str, Vec<&urdf_rs::Joint>> = BTreeMap::new();
    let mut parent_of: BTreeMap<&str, &str> = BTreeMap::new();
    for joint in &robot.joints {
        if !joint_names.insert(joint.name.as_str()) {
            return Err(ModelError::DuplicateName { kind: "joint", name: joint.name.clone() });
        }
        for end in [&joint.parent.link, &joint.child.link] {
            if !by_name.contains_key(end.as_str()) {
                return Err(ModelError::UnknownLink { name: end.clone() });
            }
        }
        if parent_of.insert(&joint.child.link, &joint.name).is_some() {
            return Err(ModelError::TwoParents { link: joint.child.link.clone() });
        }
        children.entry(&joint.parent.link).or_default().push(joint);
    }
    if let Some(joint) = parent_of.get(base_link) {
        return Err(ModelError::BaseHasParent { joint: (*joint).into() });
    }

    let mut tree = Tree { links: Vec::new(), joints: Vec::new() };
    tree.links.push(link(by_name[base_link], None, has_mesh)?);
    let mut names = vec![base_link];
    let mut next = 0;
    while next < names.len() {
        let parent = LinkId(next);
        for joint in children.get(names[next]).into_iter().flatten() {
            let child = LinkId(names.len());
            tree.joints.push(self::joint(joint, parent, child)?);
            let id = tree.joints.len() - 1;
            tree.links.push(link(by_name[joint.child.link.as_str()], Some(id), has_mesh)?);
            names.push(&joint.child.link);
        }
        next += 1;
    }
    // Each link has one parent at most, so a link that the base does not reach hangs on a cycle or
    // on a second root.
    if let Some(name) = by_name.keys().find(|name| !names.contains(name)) {
        return Err(ModelError::NotATree { link: (*name).into() });
    }
    Ok(tree)
}

fn finite(what: &str, name: &str, values: &[f64]) -> Result<(), ModelError> {
    match values.iter().find(|v| !v.is_finite()) {
        None => Ok(()),
        Some(value) => {
            Err(ModelError::NotFinite { what: what.into(), name: name.into(), value: *value })
        }
    }
}

fn isometry(pose: &urdf_rs::Pose, name: &str) -> Result<Isometry3<f64>, ModelError> {
    finite("origin", name, &*pose.xyz)?;
    finite("origin", name, &*pose.rpy)?;
    let [x, y, z] = *pose.xyz;
    let [roll, pitch, yaw] = *pose.rpy;
    Ok(Isometry3::from_parts(
        Translation3::new(x, y, z),
        UnitQuaternion::from_euler_angles(roll, pitch, yaw),
    ))
}

fn joint(joint: &urdf_rs::Joint, parent: LinkId, child: LinkId) -> Result<Joint, ModelError> {
    let name = joint.name.as_str();
    finite("axis", name, &*joint.axis.xyz)?;
    let limit = &joint.limit;
    finite("limit", name, &[limit.effort, limit.velocity])?;
    let kind = match joint.joint_type {
        urdf_rs::JointType::Fixed => JointKind::Fixed,
        urdf_rs::JointType::Revolute => JointKind::Revolute,
        urdf_rs::JointType::Continuous => JointKind::Continuous,
        _ => return Err(ModelError::JointKind { joint: name.into() }),
    };
    let axis = Vector3::from(*joint.axis.xyz);
    let axis = match (kind, Unit::try_new(axis, 1e-9)) {
        (_, Some(axis)) => axis,
        (JointKind::Fixed, None) => Vector3::x_axis(),
        (_, None) => return Err(ModelError::NoAxis { joint: name.into() }),
    };
    let (lower, upper) = match kind {
        JointKind::Revolute => {
            finite("limit", name, &[limit.lower, limit.upper])?;
            (limit.lower, limit.upper)
        }
        JointKind::Continuous => (f64::NEG_INFINITY, f64::INFINITY),
        JointKind::Fixed => (0.0, 0.0),
    };
    if lower > upper {
        return Err(ModelError::Limits { joint: name.into(), lower, upper });
    }
    Ok(Joint {
        name: name.into(),
        parent,
        child,
        parent_from_joint: isometry(&joint.origin, name)?,
        axis,
        kind,
        lower,
        upper,
        effort: limit.effort,
    })
}

fn link(
    link: &urdf_rs::Link,
    parent_joint: Option<usize>,
    has_mesh: &dyn Fn(&str) -> bool,
) -> Result<Link, ModelError> {
    let name = link.name.as_str();
    let inertial = &link.inertial;
    finite("mass", name, &[inertial.mass.value])?;
    if inertial.mass.value < 0.0 {
        return Err(ModelError::NegativeMass { link: name.into(), mass: inertial.mass.value });
    }
    let i = &inertial.inertia;
    finite("inertia", name, &[i.ixx, i.ixy, i.ixz, i.iyy, i.iyz, i.izz])?;
    let mut shapes = Vec::new();
    for collision in &link.collision {
        shapes.push(LinkShape {
            link_from_shape: isometry(&collision.origin, name)?,
            shape: shape(&collision.geometry, name, has_mesh)?,
        });
    }
    for visual in &link.visual {
        isometry(&visual.origin, name)?;
        shape(&visual.geometry, name, has_mesh)?;
    }
    Ok(Link {
        name: name.into(),
        parent_joint,
        mass: inertial.mass.value,
        com: Point3::from(isometry(&inertial.origin, name)?.translation.vector),
        shapes,
    })
}

fn shape(
    geometry: &urdf_rs::Geometry,
    link: &str,
    has_mesh: &dyn Fn(&str) -> bool,
) -> Result<Shape, ModelError> {
    let shape = match geometry {
        urdf_rs::Geometry::Box { size } => Shape::Box { half_extents: Vector3::from(**size) * 0.5 },
        urdf_rs::Geometry::Cylinder { radius, length } => {
            Shape::Cylinder { radius: *radius, half_length: 0.5 * length }
        }
        urdf_rs::Geometry::Capsule { radius, length } => {
            Shape::Capsule { radius: *radius, half_length: 0.5 * length }
        }
        urdf_rs::Geometry::Sphere { radius } => Shape::Sphere { radius: *radius },
        urdf_rs::Geometry::Mesh { filename, .. } => {
            let known = has_mesh(filename);
            let (link, file) = (link.into(), filename.chars().take(200).collect());
            return Err(if known {
                ModelError::MeshShape { link, file }
            } else {
                ModelError::MissingMesh { link, file }
            });
        }
    };
    let sizes = shape.sizes();
    finite("shape", link, &sizes)?;
    if sizes.iter().any(|s| *s < 0.0) || sizes[0] == 0.0 {
        return Err(ModelError::ShapeSize { link: link.into() });
    }
    Ok(shape)
}
