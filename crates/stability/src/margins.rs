//! All margins over fixed contacts, prepared for asking them for many centers of mass.
//!
//! What a stance has of regions and edges depends on its contacts alone; per center of mass only
//! distances are left. The values are those of [`crate::rule`] and [`crate::energy`]. Frame `g`
//! (z up), meters.

use geometry::{ConvexPolygon, ConvexRegion};
use nalgebra::Point3;

use crate::contact::{ConeModel, Contact};
use crate::energy::TippingEdges;
use crate::force_region::{self, ForceRegion};
use crate::support_polygon::{self, Margin};

/// Polygons, regions and edges of fixed contacts.
#[derive(Debug, Clone, PartialEq)]
pub struct StanceMargins {
    contacts: Vec<Point3<f64>>,
    regular: Option<ConvexPolygon>,
    conservative: Option<ConvexRegion>,
    friction: Option<ForceRegion>,
    edges: Option<TippingEdges>,
}

/// What a center of mass has to spare, each `None` where there is nothing to have a margin over.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Margins {
    /// In the regular support polygon, with the contacts of the nearest edge.
    pub regular: Option<Margin>,
    /// In the conservative region (m); for a point minus the distance to it.
    pub conservative_m: Option<f64>,
    /// In the region that friction holds (m).
    pub friction_m: Option<f64>,
    /// By how much the center of mass must rise to tip over the weakest edge (m).
    pub energy_m: Option<f64>,
}

impl StanceMargins {
    /// Of these contacts; what cannot be had of them has no margins.
    pub fn new(contacts: &[Contact], cone: ConeModel) -> StanceMargins {
        let points: Vec<Point3<f64>> = contacts.iter().map(|c| c.position).collect();
        let cones = force_region::cones(contacts, cone);
        StanceMargins {
            regular: support_polygon::regular(&points).ok(),
            conservative: support_polygon::conservative(&points).ok(),
            friction: cones.and_then(|cones| force_region::region(&cones, 1.0)).ok(),
            edges: TippingEdges::new(&points).ok(),
            contacts: points,
        }
    }

    /// Of a center of mass (m).
    pub fn at(&self, com: &Point3<f64>) -> Margins {
        let regular = self.regular.as_ref();
        let conservative = self.conservative.as_ref();
        Margins {
            regular: regular.map(|hull| support_polygon::margin(hull, &self.contacts, com)),
            conservative_m: conservative
                .and_then(|region| support_polygon::margin_of_region(region, com)),
            friction_m: self.friction.as_ref().and_then(|friction| friction.margin(com)),
            energy_m: self.edges.as_ref().map(|edges| edges.height(com)),
        }
    }
}
