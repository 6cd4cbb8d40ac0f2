//! The margin rule over fixed contacts, prepared so that asking it for a center of mass is cheap.
//!
//! For fixed contacts every part of the rule of [`crate::rule`] is piecewise linear in the center
//! of mass c. The regular margin is the least of the distances to the edge lines. If foot k sinks
//! and c lies outside of edge e of the other feet's hull, the rover turns about e by an angle that
//! depends on the contacts alone ([`crate::settlement`]); so the margin then is the least of a few
//! linear functions of c, whose gradients have length 1. Written out for one foot k, with dₑ the
//! depth of c inside of edge e and gₑ the margin after turning about e, c survives where
//!
//! - A = minₑ max(dₑ, gₑ) ≥ 0: whichever edge c is outside of, turning about it ends well; or
//! - B = maxₑ min(-dₑ, gₑ) ≥ 0: there is an edge that c is outside of, and about it it ends well.
//!
//! The rule asks for "A or B". Its own margin jumps where c crosses an edge of the other feet's
//! hull, for there the rover begins to rock. max(A, B) does not: each of dₑ and gₑ changes by no
//! more than c moves, and least and greatest keep that. It has the sign of the rule's margin and,
//! where not negative, never exceeds it. Edges that are also edges of the hull of all feet are left
//! out, for c has no regular margin outside of them.
//!
//! Everything is in the gravity frame `g` (z up), in meters. No I/O, no clock.

use geometry::{ConvexPolygon, ConvexRegion};
use nalgebra::{Isometry3, Point2, Point3, Vector3};
use rover::StanceRules;

use crate::contact::{ConeModel, Contact};
use crate::force_region::{self, ForceRegion};
use crate::rule::Preference;
use crate::settlement::{contact_at, outermost, tip};
use crate::shear::Footholds;
use crate::support_polygon::{self, regular};

/// Taken off every answer (m), so that rounding never makes a rule hold that does not.
const ROUNDING: f64 = 1e-12;

/// A linear function of the center of mass, its gradient of length 1 or 0.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Plane {
    gradient: Vector3<f64>,
    offset: f64,
}

impl Plane {
    const NEVER: Plane = Plane { gradient: Vector3::new(0.0, 0.0, 0.0), offset: f64::NEG_INFINITY };

    /// Distance to the left of the edge from `a` to `b`, seen along gravity, after `turn`.
    fn left_of((a, b): (Point2<f64>, Point2<f64>), turn: &Isometry3<f64>) -> Plane {
        let along = (b - a).normalize();
        let inward = Vector3::new(-along.y, along.x, 0.0);
        let offset = inward.dot(&(turn.translation.vector - Vector3::new(a.x, a.y, 0.0)));
        Plane { gradient: turn.rotation.inverse() * inward, offset }
    }

    fn lowered(self, by: f64) -> Plane {
        Plane { offset: self.offset - by, ..self }
    }

    fn at(&self, com: &Point3<f64>) -> f64 {
        let g = &self.gradient;
        g.x * com.x + g.y * com.y + (g.z * com.z + self.offset)
    }
}

/// An edge of the hull of all feet but one about which the rover may turn.
#[derive(Debug, Clone, PartialEq)]
struct Edge {
    /// dₑ.
    inside: Plane,
    /// gₑ is the least of these.
    tipped: Vec<Plane>,
}

/// The margin rule over fixed contacts. An answer costs some ten nanoseconds a foot at most.
#[derive(Debug, Clone, PartialEq)]
pub struct StanceGuard {
    contacts: Vec<Point3<f64>>,
    /// All of these must be zero or more.
    always: Vec<Plane>,
    /// Edges to turn about, by settling foot; feet without such edges are left out.
    feet: Vec<Vec<Edge>>,
    /// A region that is a point, where nothing can be met.
    point: Option<Point2<f64>>,
    /// The contacts with their friction, where it counts.
    footholds: Option<Footholds>,
}

impl StanceGuard {
    /// Prepares the rule for the feet that stand on `contacts` (m).
    ///
    /// `None` if they enclose no support polygon, or a length in `rules` is not a number, or
    /// friction is asked for, which points do not have: see [`over`](Self::over). A negative m1 or
    /// settlement counts as zero.
    pub fn new(
        contacts: &[Point3<f64>],
        rules: &StanceRules,
        preference: Preference,
    ) -> Option<StanceGuard> {
        let hull = regular(contacts).ok()?;
        let (margin, settlement) = (rules.margin.max(0.0), rules.settlement.max(0.0));
        if !(rules.margin + rules.settlement).is_finite() || preference == Preference::Friction {
            return None;
        }
        let mut guard = StanceGuard {
            contacts: contacts.to_vec(),
            always: planes_of(&hull, &Isometry3::identity(), margin),
            feet: Vec::new(),
            point: None,
            footholds: None,
        };
        if preference == Preference::Conservative {
            match support_polygon::conservative(contacts).ok()? {
                ConvexRegion::Area(area) => {
                    guard.always.extend(planes_of(&area, &Isometry3::identity(), 0.0));
                }
                ConvexRegion::Point(point) => guard.point = Some(point),
                ConvexRegion::Empty => guard.always.push(Plane::NEVER),
            }
        }
        for settling in 0..contacts.len() {
            guard.add_settlement(&hull, settling, settlement);
        }
        Some(guard)
    }

    /// Prepares the rule, whichever is preferred, for feet whose ground is known.
    ///
    /// `None` as for [`new`](Self::new), or for contacts that cannot be worked with.
    pub fn over(
        contacts: &[Contact],
        rules: &StanceRules,
        preference: Preference,
    ) -> Option<StanceGuard> {
        let points: Vec<Point3<f64>> = contacts.iter().map(|c| c.position).collect();
        if preference != Preference::Friction {
            return StanceGuard::new(&points, rules, preference);
        }
        let ForceRegion { region, .. } = friction_region(contacts)?;
        let regular = StanceGuard::new(&points, rules, Preference::Regular)?;
        let footholds = Footholds::new(contacts, ConeModel::default());
        Some(StanceGuard { footholds, ..regular.within(&region, rules.margin) })
    }

    /// The same rule, which also asks that the center of mass is `margin` (m) or deeper within
    /// `region`, that of these contacts' friction.
    #[must_use]
    pub fn within(mut self, region: &ConvexRegion, margin: f64) -> StanceGuard {
        match region {
            ConvexRegion::Area(area) => {
                self.always.extend(planes_of(area, &Isometry3::identity(), margin.max(0.0)));
            }
            ConvexRegion::Point(point) => self.point = Some(*point),
            ConvexRegion::Empty => self.always.push(Plane::NEVER),
        }
        self
    }

    fn add_settlement(&mut self, hull: &ConvexPolygon, settling: usize, settlement: f64) {
        let mut others = self.contacts.clone();
        let foot = others.remove(settling);
        let tipped = |line| tipped_planes(&self.contacts, line, &foot, settlement);
        let Ok(rest) = regular(&others) else {
            let (a, b) = outermost(&others);
            let planes = tipped([a, b]);
            self.always.extend(planes);
            return;
        };
        let shared = |edge: &(Point2<f64>, Point2<f64>)| hull.edges().any(|other| other == *edge);
        let edges: Vec<Edge> = rest
            .edges()
            .filter(|edge| !shared(edge))
            .map(|edge| Edge {
                inside: Plane::left_of(edge, &Isometry3::identity()),
                tipped: tipped([contact_at(&others, edge.0), contact_at(&others, edge.1)]),
            })
            .collect();
        if !edges.is_empty() {
            self.feet.push(edges);
        }
    }

    /// The contacts (m), in the order given.
    pub fn contacts(&self) -> &[Point3<f64>] {
        &self.contacts
    }

    /// The contacts with their friction; none where the rule does not ask for it.
    pub fn footholds(&self) -> Option<&Footholds> {
        self.footholds.as_ref()
    }

    /// What is to spare (m) of the rule with the center of mass at `com`; the rule holds where this
    /// is zero or more (to 1e-12 m), and then no part of it has less to spare.
    ///
    /// Changes by no more than `com` moves (in space, for height enters when a foot settles): the
    /// rule holds wherever the center of mass is within this distance. Where the rule fails, no
    /// more than a measure of how much is missing. Negative infinity where no center of mass would
    /// do, or `com` is not a number.
    pub fn spare(&self, com: &Point3<f64>) -> f64 {
        if !(com.x + com.y + com.z).is_finite() {
            return f64::NEG_INFINITY;
        }
        let mut spare = least(&self.always, com);
        for edges in &self.feet {
            spare = spare.min(survives(edges, com));
        }
        if let Some(point) = self.point {
            // A point has no inside: even a center of mass over it has nothing to spare.
            spare = spare.min(-(com.xy() - point).norm());
        }
        spare - ROUNDING
    }

    /// A lower bound of [`spare`](Self::spare) for every center of mass within `radius` (m) of
    /// `com`.
    pub fn spare_about(&self, com: &Point3<f64>, radius: f64) -> f64 {
        if radius.is_nan() { f64::NEG_INFINITY } else { self.spare(com) - radius.max(0.0) }
    }
}

/// The region of these contacts' friction as the rule takes it; `None` for contacts that cannot be
/// worked with.
fn friction_region(contacts: &[Contact]) -> Option<ForceRegion> {
    let cones = force_region::cones(contacts, ConeModel::default()).ok()?;
    force_region::region(&cones, 1.0).ok()
}

/// max(A, B) of the file's header.
fn survives(edges: &[Edge], com: &Point3<f64>) -> f64 {
    let (mut every, mut some) = (f64::INFINITY, f64::NEG_INFINITY);
    for edge in edges {
        let (inside, tipped) = (edge.inside.at(com), least(&edge.tipped, com));
        every = every.min(inside.max(tipped));
        // A center of mass on the line is not outside of it.
        some = some.max((-inside - ROUNDING).min(tipped));
    }
    every.max(some)
}

fn least(planes: &[Plane], com: &Point3<f64>) -> f64 {
    // Nothing here is NaN, so this comparison does for `f64::min`, which costs twice as much.
    let lower = |least: f64, value: f64| if value < least { value } else { least };
    planes.iter().map(|plane| plane.at(com)).fold(f64::INFINITY, lower)
}

fn planes_of(hull: &ConvexPolygon, turn: &Isometry3<f64>, margin: f64) -> Vec<Plane> {
    hull.edges().map(|edge| Plane::left_of(edge, turn).lowered(margin)).collect()
}

/// The margin in the hull of all feet once the rover has turned about `line` until `foot` has gone
/// down by `settlement` (m), as functions of the center of mass before.
fn tipped_planes(
    contacts: &[Point3<f64>],
    line: [Point3<f64>; 2],
    foot: &Point3<f64>,
    settlement: f64,
) -> Vec<Plane> {
    let Some(turn) = tip(line, foot, settlement) else { return vec![Plane::NEVER] };
    let feet: Vec<Point3<f64>> = contacts.iter().map(|p| turn * p).collect();
    match regular(&feet) {
        Ok(hull) => planes_of(&hull, &turn, 0.0),
        Err(_) => vec![Plane::NEVER],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rules(margin: f64, settlement: f64) -> StanceRules {
        StanceRules {
            margin,
            settlement,
            ground_tolerance: 0.02,
            contact_radius: 0.15,
            contact_height: 0.05,
            camber_limit: 0.35,
            leg_stiffness: 15_000.0,
        }
    }

    fn hexagon() -> Vec<Point3<f64>> {
        (0..6)
            .map(|k| f64::from(k) * std::f64::consts::FRAC_PI_3)
            .map(|yaw| Point3::new(2.0 * yaw.cos(), 2.0 * yaw.sin(), 0.0))
            .collect()
    }

    #[test]
    fn a_centered_hexagon_has_its_apothem_less_m1_or_what_turning_leaves() {
        // Seen from the center, the short diagonals are 1 m away and the edges 2 cos 30°.
        let guard = StanceGuard::new(&hexagon(), &rules(0.9, 0.0), Preference::Regular).unwrap();
        let spare = guard.spare(&Point3::new(0.0, 0.0, 1.0));
        assert!((spare - (3.0_f64.sqrt() - 0.9)).abs() < 1e-9, "{spare}");
    }

    #[test]
    fn a_center_of_mass_that_is_not_a_number_has_nothing_to_spare() {
        let guard = StanceGuard::new(&hexagon(), &rules(0.1, 0.1), Preference::Regular).unwrap();
        assert_eq!(guard.spare(&Point3::new(f64::NAN, 0.0, 1.0)), f64::NEG_INFINITY);
        assert_eq!(guard.spare_about(&Point3::origin(), f64::NAN), f64::NEG_INFINITY);
        assert!(StanceGuard::new(&hexagon(), &rules(0.1, f64::NAN), Preference::Regular).is_none());
        assert!(StanceGuard::new(&hexagon()[..2], &rules(0.1, 0.1), Preference::Regular).is_none());
    }

    #[test]
    fn four_feet_never_survive_a_loss() {
        let square = [(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)]
            .map(|(x, y)| Point3::new(x, y, 0.0));
        let guard = StanceGuard::new(&square, &rules(0.1, 0.01), Preference::Conservative).unwrap();
        assert!(guard.spare(&Point3::new(0.0, 0.0, 0.5)) < 0.0);
        assert!(guard.spare(&Point3::new(0.0, 0.3, 0.5)) <= -0.3);
        let triangle = StanceGuard::new(&square[..3], &rules(0.1, 0.01), Preference::Conservative);
        assert_eq!(triangle.unwrap().spare(&Point3::new(-0.3, 0.3, 0.5)), f64::NEG_INFINITY);
    }
}
