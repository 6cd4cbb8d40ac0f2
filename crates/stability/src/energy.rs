//! Energy stability: the work that it takes to tip the rover over an edge of its support (A28).
//!
//! To tip, the center of mass must be raised to the top of its circle about the line through two
//! feet. With r from the foot of the perpendicular on that line to the center of mass, and the line
//! inclined by Φ, it rises by |r| cos Φ - r_z, so the work is m g (|r| cos Φ - r_z): equations (1)
//! and (2) of Ambler gait generation (1993), with the height of the center of mass *relative* to
//! the line. Edges are those of the horizontal hull, at the heights of their feet.
//!
//! A center of mass beyond an edge is past the top already; what it has lost counts as negative, so
//! that the margin passes through zero at the edge.
//!
//! Frame `g` (z up), meters. Margins are heights (m); times the weight (N) they are joules.

use geometry::ConvexPolygon;
use nalgebra::{Point2, Point3, Unit, Vector2};

use crate::settlement::contact_at;
use crate::support_polygon::{SupportError, regular};

/// The energy margins of a stance.
#[derive(Debug, Clone, PartialEq)]
pub struct EnergyMargin {
    /// The least of the edges' heights (m).
    pub height_m: f64,
    /// The edge that has it, among `edges`.
    pub critical: usize,
    /// All edges of the regular support polygon, counter-clockwise.
    pub edges: Vec<EnergyEdge>,
}

/// Tipping over the line through two feet.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EnergyEdge {
    /// Indices of the two contacts.
    pub contacts: [usize; 2],
    /// By how much the center of mass must rise (m); negative beyond the edge.
    pub height_m: f64,
}

/// The edges about which a stance may tip, prepared for many centers of mass.
#[derive(Debug, Clone, PartialEq)]
pub struct TippingEdges {
    hull: ConvexPolygon,
    lines: Vec<Line>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Line {
    contacts: [usize; 2],
    from: Point3<f64>,
    along: Unit<nalgebra::Vector3<f64>>,
    /// cos Φ.
    level: f64,
    inward: Vector2<f64>,
}

impl TippingEdges {
    /// The edges of the regular support polygon of 3 or more contacts.
    pub fn new(contacts_in_g: &[Point3<f64>]) -> Result<TippingEdges, SupportError> {
        let hull = regular(contacts_in_g)?;
        let index = |p: Point3<f64>| contacts_in_g.iter().position(|c| *c == p).unwrap_or(0);
        let lines = hull
            .edges()
            .map(|(a, b)| {
                let (a, b) = (contact_at(contacts_in_g, a), contact_at(contacts_in_g, b));
                let flat = b.xy() - a.xy();
                let inward = Vector2::new(-flat.y, flat.x).normalize();
                Line {
                    contacts: [index(a), index(b)],
                    from: a,
                    along: Unit::new_normalize(b - a),
                    level: flat.norm() / (b - a).norm(),
                    inward,
                }
            })
            .collect();
        Ok(TippingEdges { hull, lines })
    }

    /// The regular support polygon (m).
    pub fn polygon(&self) -> &ConvexPolygon {
        &self.hull
    }

    /// The heights (m) by which a center of mass must rise to tip over each edge.
    fn heights<'a>(&'a self, com: &'a Point3<f64>) -> impl Iterator<Item = EnergyEdge> + 'a {
        self.lines.iter().map(move |line| {
            let from_foot = com - line.from;
            let r = from_foot - line.along.into_inner() * line.along.dot(&from_foot);
            let rise = (r.norm() * line.level - r.z).max(0.0);
            let beyond = line.inward.dot(&from_foot.xy()) < 0.0;
            let height_m = if beyond { -rise } else { rise };
            EnergyEdge { contacts: line.contacts, height_m }
        })
    }

    /// The margin of one center of mass (m).
    pub fn margin(&self, com: &Point3<f64>) -> EnergyMargin {
        let edges: Vec<EnergyEdge> = self.heights(com).collect();
        let critical = (0..edges.len())
            .min_by(|a, b| edges[*a].height_m.total_cmp(&edges[*b].height_m))
            .expect("a polygon has edges");
        EnergyMargin { height_m: edges[critical].height_m, critical, edges }
    }

    /// The least height (m) of one center of mass, without the edges.
    pub fn height(&self, com: &Point3<f64>) -> f64 {
        self.heights(com).map(|edge| edge.height_m).fold(f64::INFINITY, f64::min)
    }

    /// The surface of margins (m) over centers of mass at height `z` (m), at the nodes of a grid,
    /// row by row along x (A29 to A31); NaN outside of the support polygon.
    pub fn surface(&self, grid: &geometry::Grid, z: f64) -> Vec<f64> {
        let cells = (0..grid.ny).flat_map(|iy| (0..grid.nx).map(move |ix| (ix, iy)));
        cells
            .map(|(ix, iy)| {
                let height = self.height(&at_height(grid.position(ix, iy), z));
                if height >= 0.0 { height } else { f64::NAN }
            })
            .collect()
    }

    /// The margins (m) of a center of mass that moves from `com` along a level `heading`: `n`
    /// values at distances 0 to `length` (m) (A32).
    pub fn slice(&self, com: &Point3<f64>, heading: f64, length: f64, n: usize) -> Vec<f64> {
        let along = Vector2::new(heading.cos(), heading.sin()) * length;
        let share = |i: usize| i as f64 / (n.max(2) - 1) as f64;
        (0..n).map(|i| self.height(&at_height(com.xy() + along * share(i), com.z))).collect()
    }
}

/// The energy margin of a stance (A28).
pub fn margin(
    contacts_in_g: &[Point3<f64>],
    com_in_g: &Point3<f64>,
) -> Result<EnergyMargin, SupportError> {
    Ok(TippingEdges::new(contacts_in_g)?.margin(com_in_g))
}

fn at_height(p: Point2<f64>, z: f64) -> Point3<f64> {
    Point3::new(p.x, p.y, z)
}
