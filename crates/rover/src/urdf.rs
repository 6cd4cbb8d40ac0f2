//! From URDF text to links and joints, with every refusal by name.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use nalgebra::{Isometry3, Point3, Translation3, Unit, UnitQuaternion, Vector3};

use crate::mesh::Mesh;
use crate::model::{Joint, JointKind, Link, LinkId, ModelError};
use crate::shape::{LinkShape, Shape};

/// Most links a robot may have.
pub const MAX_LINKS: usize = 2000;

/// Longest URDF text (bytes).
const MAX_BYTES: usize = 1 << 20;

/// Most bytes of all meshes of a robot, each counted as often as it is used.
const MESHES_BYTES_MAX: usize = 64 << 20;

/// The links in topological order (parents first), each but the first with its parent joint.
pub(crate) struct Tree {
    pub links: Vec<Link>,
    pub joints: Vec<Joint>,
    /// Contents of the mesh files in the order of their use.
    pub mesh_files: Vec<Vec<u8>>,
}

/// The mesh files of a robot's folder, and those that were read.
struct Files<'a> {
    mesh: &'a dyn Fn(&str) -> Option<Vec<u8>>,
    read: Vec<Vec<u8>>,
}

/// Parses `text`; `mesh` gives the content of a mesh file of the folder.
pub(crate) fn parse(
    text: &str,
    base_link: &str,
    mesh: &dyn Fn(&str) -> Option<Vec<u8>>,
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
    build(&robot, base_link, &mut Files { mesh, read: Vec::new() })
}

fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ").chars().take(300).collect()
}

fn build(
    robot: &urdf_rs::Robot,
    base_link: &str,
    files: &mut Files<'_>,
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

    let mut tree = Tree { links: Vec::new(), joints: Vec::new(), mesh_files: Vec::new() };
    tree.links.push(link(by_name[base_link], None, files)?);
    let mut names = vec![base_link];
    let mut next = 0;
    while next < names.len() {
        let parent = LinkId(next);
        for joint in children.get(names[next]).into_iter().flatten() {
            let child = LinkId(names.len());
            tree.joints.push(self::joint(joint, parent, child)?);
            let id = tree.joints.len() - 1;
            tree.links.push(link(by_name[joint.child.link.as_str()], Some(id), files)?);
            names.push(&joint.child.link);
        }
        next += 1;
    }
    // Each link has one parent at most, so a link that the base does not reach hangs on a cycle or
    // on a second root.
    if let Some(name) = by_name.keys().find(|name| !names.contains(name)) {
        return Err(ModelError::NotATree { link: (*name).into() });
    }
    tree.mesh_files = std::mem::take(&mut files.read);
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
        urdf_rs::JointType::Prismatic => JointKind::Prismatic,
        _ => return Err(ModelError::JointKind { joint: name.into() }),
    };
    let axis = Vector3::from(*joint.axis.xyz);
    let axis = match (kind, Unit::try_new(axis, 1e-9)) {
        (_, Some(axis)) => axis,
        (JointKind::Fixed, None) => Vector3::x_axis(),
        (_, None) => return Err(ModelError::NoAxis { joint: name.into() }),
    };
    let (lower, upper) = match kind {
        JointKind::Revolute | JointKind::Prismatic => {
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
    files: &mut Files<'_>,
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
            shape: shape(&collision.geometry, name, files)?,
        });
    }
    for visual in &link.visual {
        isometry(&visual.origin, name)?;
        // What is drawn touches nothing: meshes for display are not read.
        if !matches!(visual.geometry, urdf_rs::Geometry::Mesh { .. }) {
            shape(&visual.geometry, name, files)?;
        }
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
    files: &mut Files<'_>,
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
        urdf_rs::Geometry::Mesh { filename, scale } => {
            let scale = scale.as_ref().map_or(Vector3::repeat(1.0), |s| Vector3::from(**s));
            return mesh(filename, &scale, link, files);
        }
    };
    if !shape.is_proper() {
        return Err(ModelError::ShapeSize { link: link.into() });
    }
    Ok(shape)
}

fn mesh(
    filename: &str,
    scale: &Vector3<f64>,
    link: &str,
    files: &mut Files<'_>,
) -> Result<Shape, ModelError> {
    let (link, file) = (|| link.to_owned(), || filename.chars().take(200).collect::<String>());
    let path = mesh_path(filename).ok_or_else(|| {
        let (link, file) = (link(), file());
        ModelError::MeshPath { link, file }
    })?;
    let bytes = (files.mesh)(path).ok_or_else(|| {
        let (link, file) = (link(), file());
        ModelError::MissingMesh { link, file }
    })?;
    let n_bytes = files.read.iter().map(Vec::len).sum::<usize>() + bytes.len();
    if n_bytes > MESHES_BYTES_MAX {
        return Err(ModelError::MeshesTooLarge { bytes: n_bytes, limit: MESHES_BYTES_MAX });
    }
    let mesh = Mesh::parse(path, &bytes, scale).map_err(|reason| {
        let (link, file) = (link(), file());
        ModelError::Mesh { link, file, reason }
    })?;
    files.read.push(bytes);
    Ok(Shape::Mesh(Arc::new(mesh)))
}

/// The path of a mesh inside the robot's folder: `package://NAME/` stands for the folder. None for
/// what could lead out of it.
fn mesh_path(filename: &str) -> Option<&str> {
    let path = match filename.strip_prefix("package://") {
        Some(rest) => rest.split_once('/')?.1,
        None => filename.strip_prefix("./").unwrap_or(filename),
    };
    let plain = |part: &str| !part.is_empty() && part != "." && part != "..";
    let inside = !path.contains(['\\', '\0', ':']) && path.split('/').all(plain);
    inside.then_some(path)
}
