//! Shapes of links.

use nalgebra::{Isometry3, Vector3};

/// A convex solid about its own origin; axes along z where there is one.
#[derive(Debug, Clone, Copy, PartialEq)]
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
}

impl Shape {
    /// The same shape, `factor` times as large.
    pub fn scaled(&self, factor: f64) -> Shape {
        match *self {
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
        match *self {
            Shape::Box { half_extents } => half_extents.norm(),
            Shape::Cylinder { radius, half_length } => radius.hypot(half_length),
            Shape::Capsule { radius, half_length } => radius + half_length,
            Shape::Sphere { radius } => radius,
        }
    }

    /// Its sizes (m), for checks and hashes.
    pub(crate) fn sizes(&self) -> [f64; 3] {
        match *self {
            Shape::Box { half_extents } => half_extents.into(),
            Shape::Cylinder { radius, half_length } => [radius, half_length, 0.0],
            Shape::Capsule { radius, half_length } => [radius, half_length, 1.0],
            Shape::Sphere { radius } => [radius, 0.0, 0.0],
        }
    }
}

/// A shape placed on a link.
#[derive(Debug, Clone, Copy, PartialEq)]
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
