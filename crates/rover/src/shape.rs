//! Shapes of links.

use std::sync::Arc;

use nalgebra::{Isometry3, Vector3};

use crate::mesh::Mesh;

/// A solid about its own origin; axes along z where there is one.
#[derive(Debug, Clone, PartialEq)]
pub enum Shape {
    /// A box by its half edges (m).
    Box {
        /// Half of each edge (m).
        half_extents: Vector3<f64>,
    },
    /// A cylinder about z.
    Cylinder {
        /// Radius (m).
        radius: f64,
        /// Half of its length (m).
        half_length: f64,
    },
    /// A cylinder about z with half spheres on both ends.
    Capsule {
        /// Radius (m).
        radius: f64,
        /// Half of the length of the cylinder between the half spheres (m).
        half_length: f64,
    },
    /// A sphere.
    Sphere {
        /// Radius (m).
        radius: f64,
    },
    /// A mesh, which counts as the convex hulls of its connected components.
    Mesh(Arc<Mesh>),
}

impl Shape {
    /// The same shape, `factor` times as large.
    pub fn scaled(&self, factor: f64) -> Shape {
        match *self {
            Shape::Mesh(ref mesh) => Shape::Mesh(Arc::new(mesh.scaled(factor))),
            Shape::Box { half_extents } => Shape::Box { half_extents: half_extents * factor },
            Shape::Cylinder { radius, half_length } => {
                Shape::Cylinder { radius: radius * factor, half_length: half_length * factor }
            }
            Shape::Capsule { radius, half_length } => {
                Shape::Capsule { radius: radius * factor, half_length: half_length * factor }
            }
            Shape::Sphere { radius } => Shape::Sphere { radius: radius * factor },
        }
    }

    /// Radius of the sphere about its origin that holds it (m).
    pub fn bounding_radius(&self) -> f64 {
        match self {
            Shape::Box { half_extents } => half_extents.norm(),
            Shape::Cylinder { radius, half_length } => radius.hypot(*half_length),
            Shape::Capsule { radius, half_length } => radius + half_length,
            Shape::Sphere { radius } => *radius,
            Shape::Mesh(mesh) => {
                mesh.vertices().iter().map(|v| v.coords.norm()).fold(0.0, f64::max)
            }
        }
    }

    /// True if all of its sizes are finite and above zero; a capsule may be a sphere.
    pub fn is_proper(&self) -> bool {
        let above = |size: f64| size.is_finite() && size > 0.0;
        match self {
            Shape::Box { half_extents } => half_extents.iter().all(|h| above(*h)),
            Shape::Cylinder { radius, half_length } => above(*radius) && above(*half_length),
            Shape::Capsule { radius, half_length } => {
                above(*radius) && half_length.is_finite() && *half_length >= 0.0
            }
            Shape::Sphere { radius } => above(*radius),
            Shape::Mesh(_) => true, // checked where it is read
        }
    }

    /// Kind and sizes (m), for hashes.
    pub(crate) fn numbers(&self) -> Vec<f64> {
        match self {
            Shape::Box { half_extents: h } => vec![1.0, h.x, h.y, h.z],
            Shape::Cylinder { radius, half_length } => vec![2.0, *radius, *half_length],
            Shape::Capsule { radius, half_length } => vec![3.0, *radius, *half_length],
            Shape::Sphere { radius } => vec![4.0, *radius],
            Shape::Mesh(mesh) => {
                let points = mesh.vertices().iter().flat_map(|v| [v.x, v.y, v.z]);
                let corners = mesh.triangles().iter().flatten().map(|i| f64::from(*i));
                [5.0].into_iter().chain(points).chain(corners).collect()
            }
        }
    }
}

/// A shape placed on a link.
#[derive(Debug, Clone, PartialEq)]
pub struct LinkShape {
    /// Where the shape is in the link's frame.
    pub link_from_shape: Isometry3<f64>,
    /// The shape.
    pub shape: Shape,
}

impl LinkShape {
    pub(crate) fn scaled(&self, factor: f64) -> LinkShape {
        LinkShape {
            link_from_shape: scaled_isometry(&self.link_from_shape, factor),
            shape: self.shape.scaled(factor),
        }
    }
}

/// The isometry with its translation times `factor`.
pub(crate) fn scaled_isometry(isometry: &Isometry3<f64>, factor: f64) -> Isometry3<f64> {
    Isometry3::from_parts((isometry.translation.vector * factor).into(), isometry.rotation)
}
