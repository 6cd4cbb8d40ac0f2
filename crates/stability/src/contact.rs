//! Contacts, and the forces that they can give: friction cones, tethers, joints with limited torque.
//!
//! Frame `g` (z up), meters, newtons.

use std::f64::consts::{PI, TAU};

use nalgebra::{Point3, Unit, Vector3};

/// Most contacts of one stance.
pub const MAX_CONTACTS: usize = 64;
/// Most edges of a linearized friction cone.
pub const MAX_CONE_EDGES: usize = 64;

/// Why contacts cannot be worked with. Always bad input, never a bug.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum ContactError {
    /// Nothing stands.
    #[error("there is no contact")]
    NoContacts,
    /// A contact that is not there.
    #[error("there is no contact {contact} (counted from 0) among {n_contacts}")]
    NoContact {
        /// The contact asked for.
        contact: usize,
        /// How many there are.
        n_contacts: usize,
    },
    /// More than [`MAX_CONTACTS`].
    #[error("{n_contacts} contacts are more than the {MAX_CONTACTS} that a stance may have")]
    TooManyContacts {
        /// How many there are.
        n_contacts: usize,
    },
    /// A coordinate that is not a number, or infinite.
    #[error("contact {contact} (counted from 0) has a coordinate that is not finite")]
    NotFinite {
        /// Index of the contact.
        contact: usize,
    },
    /// A friction coefficient that is negative or not a number.
    #[error("contact {contact} (counted from 0) has a friction coefficient that is not 0 or more")]
    BadFriction {
        /// Index of the contact.
        contact: usize,
    },
    /// A friction cone needs 3 to [`MAX_CONE_EDGES`] edges.
    #[error("a friction cone has 3 to {MAX_CONE_EDGES} edges, not {edges}")]
    BadCone {
        /// How many were asked for.
        edges: usize,
    },
    /// A weight that is not above zero.
    #[error("the weight is not a number above zero")]
    BadWeight,
}

/// A foot on the ground.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    /// Where it touches (m).
    pub position: Point3<f64>,
    /// The ground's normal.
    pub normal: Unit<Vector3<f64>>,
    /// Coefficient of friction μ, 0 or more.
    pub friction: f64,
}

impl Contact {
    /// A foot on level ground.
    pub fn level(position: Point3<f64>, friction: f64) -> Contact {
        Contact { position, normal: Vector3::z_axis(), friction }
    }
}

/// On which side of the true cone its linearized form lies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ConeBound {
    /// Rays on the cone: every force is possible, some are left out.
    #[default]
    Inner,
    /// Half spaces that touch the cone: no force is left out, some are not possible.
    Outer,
}

/// How friction cones are linearized (H8).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ConeModel {
    /// Number of edges, or of half spaces, 3 or more.
    pub edges: usize,
    /// Which side of the true cone.
    pub bound: ConeBound,
}

impl Default for ConeModel {
    fn default() -> ConeModel {
        ConeModel { edges: 8, bound: ConeBound::Inner }
    }
}

impl ConeModel {
    /// The edges of the linearized cone of a contact, in order about the normal, of length 1 along
    /// it. `center` is that of the stance: cones are turned towards it.
    pub fn rays(&self, contact: &Contact, center: &Point3<f64>) -> Vec<Vector3<f64>> {
        let normal = contact.normal.into_inner();
        if contact.friction == 0.0 {
            return vec![normal];
        }
        let (a, b) = tangents(contact, center);
        let n = self.edges as f64;
        let slope = match self.bound {
            ConeBound::Inner => contact.friction,
            ConeBound::Outer => contact.friction / (PI / n).cos(),
        };
        (0..self.edges)
            .map(|i| {
                let (sin, cos) = (TAU * i as f64 / n).sin_cos();
                normal + (a * cos + b * sin) * slope
            })
            .collect()
    }

    /// The same linearized cone as half spaces: its forces are those with no negative product with
    /// any of these.
    pub fn half_spaces(&self, contact: &Contact, center: &Point3<f64>) -> Vec<Vector3<f64>> {
        let (a, b) = tangents(contact, center);
        let n = self.edges as f64;
        let slope = match self.bound {
            ConeBound::Inner => contact.friction * (PI / n).cos(),
            ConeBound::Outer => contact.friction,
        };
        (0..self.edges)
            .map(|i| {
                let (sin, cos) = (TAU * (i as f64 + 0.5) / n).sin_cos();
                contact.normal.into_inner() * slope - (a * cos + b * sin)
            })
            .collect()
    }

    pub(crate) fn check(&self) -> Result<(), ContactError> {
        let edges = self.edges;
        if (3..=MAX_CONE_EDGES).contains(&edges) {
            Ok(())
        } else {
            Err(ContactError::BadCone { edges })
        }
    }
}

/// Two directions at right angles to a contact's normal and to each other, the first towards the
/// middle of the stance: so cones turn with the stance, and an answer does not depend on how the
/// world's x axis lies.
fn tangents(contact: &Contact, center: &Point3<f64>) -> (Vector3<f64>, Vector3<f64>) {
    let normal = contact.normal.into_inner();
    let within = |v: Vector3<f64>| v - normal * normal.dot(&v);
    let inward = within(center - contact.position);
    let a = [inward, within(Vector3::x()), within(Vector3::y())]
        .into_iter()
        .find_map(|v| v.try_normalize(1e-9))
        .unwrap_or_else(Vector3::z);
    (a, normal.cross(&a))
}

/// The middle of the contacts (m).
pub(crate) fn center(positions: impl ExactSizeIterator<Item = Point3<f64>>) -> Point3<f64> {
    let n = positions.len().max(1) as f64;
    Point3::from(positions.map(|p| p.coords).sum::<Vector3<f64>>() / n)
}

/// Whether contacts can be worked with at all.
pub(crate) fn check(contacts: &[Contact]) -> Result<(), ContactError> {
    let n_contacts = contacts.len();
    if n_contacts == 0 {
        return Err(ContactError::NoContacts);
    }
    if n_contacts > MAX_CONTACTS {
        return Err(ContactError::TooManyContacts { n_contacts });
    }
    for (contact, c) in contacts.iter().enumerate() {
        let coordinates = c.position.coords.iter().chain(c.normal.iter());
        if !coordinates.copied().all(f64::is_finite) {
            return Err(ContactError::NotFinite { contact });
        }
        if !(c.friction.is_finite() && c.friction >= 0.0) {
            return Err(ContactError::BadFriction { contact });
        }
    }
    Ok(())
}
