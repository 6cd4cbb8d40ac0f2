//! What is left of the margin when the ground gives way under one foot.
//!
//! The margin rule of a step asks, beside the regular margin, that the rover survives a settlement
//! of any one standing foot by a stated depth s ("Margin rule of a step" in the design; H5, F83).
//! The rover is rigid here. When foot k sinks, one of two things happens:
//!
//! - the center of mass lies over the hull of the other feet: they carry it and nothing moves;
//!   foot k still catches the rover should it tip that way;
//! - else the rover tips about the line through two of the other feet until foot k has gone down
//!   by s and carries again, and the center of mass has moved with it.
//!
//! Either way what is left is the regular margin then: how far the center of mass may still move,
//! seen along gravity, before the rover falls, that is, its depth in the hull of all feet where
//! they now are. Rocking from one set of feet to another and back is not falling.
//!
//! The line is that edge of the others' hull with the center of mass outside of it whose triangle
//! with foot k holds it: all other feet rise on their side of that line. Everything is in the
//! gravity frame `g` (z up), in meters. The turn is exact, not for small angles, and the line may
//! slope. What the other feet would touch while they rise does not enter.

use nalgebra::{Isometry3, Point2, Point3, Unit, UnitQuaternion};

use crate::support_polygon::regular;

/// The foot whose settlement is worst, and what is left then.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settlement {
    /// Index of the contact that settles.
    pub contact: usize,
    /// Depth of the center of mass in the hull of all feet after the settlement (m); negative if the
    /// rover falls, negative infinity if no polygon is left.
    pub margin_m: f64,
}

/// The worst of the settlements of any one contact by `settlement_m` (m).
///
/// `None` if the contacts enclose no support polygon, or `settlement_m` or the center of mass is
/// not a number; a negative settlement counts as none.
pub fn worst(
    contacts_in_g: &[Point3<f64>],
    com_in_g: &Point3<f64>,
    settlement_m: f64,
) -> Option<Settlement> {
    regular(contacts_in_g).ok()?;
    if !settlement_m.is_finite() || !com_in_g.coords.iter().all(|v| v.is_finite()) {
        return None;
    }
    (0..contacts_in_g.len())
        .map(|contact| Settlement {
            contact,
            margin_m: of_contact(contacts_in_g, contact, com_in_g, settlement_m.max(0.0)),
        })
        .min_by(|a, b| a.margin_m.total_cmp(&b.margin_m))
}

/// The margin (m) that is left when one contact settles by `settlement_m` (m, not negative).
///
/// The contacts must enclose a support polygon; see [`worst`].
fn of_contact(
    contacts_in_g: &[Point3<f64>],
    settling: usize,
    com_in_g: &Point3<f64>,
    settlement_m: f64,
) -> f64 {
    let others: Vec<Point3<f64>> =
        contacts_in_g.iter().enumerate().filter(|(i, _)| *i != settling).map(|(_, p)| *p).collect();
    let foot = &contacts_in_g[settling];
    let com = com_in_g.xy();
    let Ok(hull) = regular(&others) else {
        // Two other feet, or all on one line: the rover tips about the line through the outermost.
        let (a, b) = outermost(&others);
        return tipped_margin([a, b], contacts_in_g, foot, com_in_g, settlement_m);
    };
    if hull.depth_of(com) >= 0.0 {
        return depth_in_hull(contacts_in_g, com_in_g);
    }
    hull.edges()
        .filter(|(a, b)| (b - a).perp(&(com - a)) < 0.0)
        .map(|(a, b)| {
            let line = [contact_at(&others, a), contact_at(&others, b)];
            tipped_margin(line, contacts_in_g, foot, com_in_g, settlement_m)
        })
        .fold(f64::NEG_INFINITY, f64::max)
}

fn depth_in_hull(contacts: &[Point3<f64>], com: &Point3<f64>) -> f64 {
    regular(contacts).map_or(f64::NEG_INFINITY, |hull| hull.depth_of(com.xy()))
}

/// The margin (m) after the rover has turned about the line through `line` until `foot` has gone
/// down by `settlement_m` (m).
fn tipped_margin(
    line: [Point3<f64>; 2],
    contacts: &[Point3<f64>],
    foot: &Point3<f64>,
    com: &Point3<f64>,
    settlement_m: f64,
) -> f64 {
    let Some(turn) = tip(line, foot, settlement_m) else { return f64::NEG_INFINITY };
    let feet: Vec<Point3<f64>> = contacts.iter().map(|p| turn * p).collect();
    depth_in_hull(&feet, &(turn * com))
}

/// The motion of the rover that turns about the line through `line` until `foot` has gone down by
/// `settlement_m` (m); `None` if the line has no direction.
pub(crate) fn tip(
    line: [Point3<f64>; 2],
    foot: &Point3<f64>,
    settlement_m: f64,
) -> Option<Isometry3<f64>> {
    let axis = Unit::try_new(line[1] - line[0], 1e-9)?;
    let arm = foot - line[0];
    let radial = arm - axis.into_inner() * axis.dot(&arm);
    let tangent = axis.cross(&radial);
    // Height over the line of the foot after a turn by t: radial.z cos t + tangent.z sin t, that
    // is, swing cos(t - top). The foot is lowered past t = 0 away from the top of its circle.
    let swing = radial.z.hypot(tangent.z);
    let top = tangent.z.atan2(radial.z);
    let lowered = ((radial.z - settlement_m) / swing).clamp(-1.0, 1.0).acos();
    let turn = UnitQuaternion::from_axis_angle(&axis, top - lowered.copysign(top));
    let fixed = line[0].coords;
    Some(Isometry3::from_parts((fixed - turn * fixed).into(), turn))
}

/// The contact seen at `vertex`; of two above each other the first.
pub(crate) fn contact_at(contacts: &[Point3<f64>], vertex: Point2<f64>) -> Point3<f64> {
    *contacts.iter().find(|c| c.xy() == vertex).expect("vertices of a hull are contacts")
}

/// The two contacts furthest apart seen along gravity.
pub(crate) fn outermost(contacts: &[Point3<f64>]) -> (Point3<f64>, Point3<f64>) {
    let order = |p: &&Point3<f64>, q: &&Point3<f64>| p.x.total_cmp(&q.x).then(p.y.total_cmp(&q.y));
    let first = contacts.iter().min_by(order).expect("two or more other feet");
    let last = contacts.iter().max_by(order).expect("two or more other feet");
    (*first, *last)
}
