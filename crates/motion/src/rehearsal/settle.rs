//! Where one foot's settlement brings a rigid rover: see [`stability::settlement`], which tells the worst
//! foot alone.

use geometry::ConvexPolygon;
use nalgebra::{Isometry3, Point2, Point3, Unit, UnitQuaternion};
use stability::support_polygon::regular;

/// What is left.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Settled {
    /// Depth of the center of mass in the hull of all feet then (m); negative infinity without a hull.
    pub margin: f64,
    /// The other feet do not carry the center of mass: it rocks onto the foot that has settled.
    pub rocks: bool,
}

/// What is left when `foot` goes down by `settlement` (m) with the center of mass at `com`.
pub(super) fn settled(
    contacts: &[Point3<f64>],
    foot: usize,
    com: &Point3<f64>,
    settlement: f64,
) -> Settled {
    let mut others = contacts.to_vec();
    let sinking = others.remove(foot);
    let depth = |contacts: &[Point3<f64>], com: &Point3<f64>| {
        regular(contacts).map_or(f64::NEG_INFINITY, |hull| hull.depth_of(com.xy()))
    };
    let hull = regular(&others).ok();
    if hull.as_ref().is_some_and(|hull| hull.depth_of(com.xy()) >= 0.0) {
        return Settled { margin: depth(contacts, com), rocks: false };
    }
    let lines = match &hull {
        Some(hull) => tipping_lines(hull, &others, com.xy()),
        None => outermost(&others).into_iter().collect(),
    };
    let margin = lines
        .iter()
        .filter_map(|line| turn_about(line, &sinking, settlement))
        .map(|turn| {
            let feet: Vec<Point3<f64>> = contacts.iter().map(|p| turn * p).collect();
            depth(&feet, &(turn * com))
        })
        .fold(f64::NEG_INFINITY, f64::max);
    Settled { margin, rocks: true }
}

/// Edges of the others' hull that the center of mass is outside of.
fn tipping_lines(
    hull: &ConvexPolygon,
    others: &[Point3<f64>],
    com: Point2<f64>,
) -> Vec<[Point3<f64>; 2]> {
    let contact = |vertex: Point2<f64>| others.iter().find(|p| p.xy() == vertex).copied();
    hull.edges()
        .filter(|(a, b)| (b - a).perp(&(com - a)) < 0.0)
        .filter_map(|(a, b)| Some([contact(a)?, contact(b)?]))
        .collect()
}

/// The two feet farthest apart of feet on one line.
fn outermost(feet: &[Point3<f64>]) -> Option<[Point3<f64>; 2]> {
    let order = |p: &&Point3<f64>, q: &&Point3<f64>| p.x.total_cmp(&q.x).then(p.y.total_cmp(&q.y));
    Some([*feet.iter().min_by(order)?, *feet.iter().max_by(order)?])
}

/// The smallest turn about a line that lowers `foot` by `by` (m), or as far as it goes.
fn turn_about(line: &[Point3<f64>; 2], foot: &Point3<f64>, by: f64) -> Option<Isometry3<f64>> {
    let axis = Unit::try_new(line[1] - line[0], 1e-9)?;
    let arm = foot - line[0];
    let across = arm - axis.into_inner() * axis.dot(&arm);
    let tangent = axis.cross(&across);
    // Height after a turn by t: across.z cos t + tangent.z sin t = swing cos(t - top).
    let swing = across.z.hypot(tangent.z);
    let top = tangent.z.atan2(across.z);
    let reach = ((across.z - by) / swing).clamp(-1.0, 1.0).acos();
    let angle = if (top - reach).abs() <= (top + reach).abs() { top - reach } else { top + reach };
    let rotation = UnitQuaternion::from_axis_angle(&axis, angle);
    let fixed = line[0].coords;
    Some(Isometry3::from_parts((fixed - rotation * fixed).into(), rotation))
}
