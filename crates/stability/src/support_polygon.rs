//! Support polygons of a stance, and the margin by which the rover is stable on them.
//!
//! A statically stable rover stays up while its center of mass, seen along gravity, lies inside
//! its support polygon. Two are in use (FootFall, AIAA SPACE 2008, sec. II.D; F39, F40):
//!
//! - the *regular* polygon: the convex hull of the contacts;
//! - the *conservative* polygon (CSP): what is left of it should any one leg slip, that is, the
//!   intersection of the hulls of all contacts but one.
//!
//! Contacts count as point contacts with enough friction to hold. Everything is in the gravity
//! frame `g` (z up), in meters; heights of contacts do not enter.

use geometry::{ConvexPolygon, ConvexRegion};
use nalgebra::{Point2, Point3, Vector2};

/// How far (m) a vertex may lie outside a half plane and still count as on its border.
const CUT_SLACK: f64 = 1e-10;

/// Why contacts enclose no support polygon. Always bad input, never a bug.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum SupportError {
    /// Fewer than three contacts.
    #[error("a support polygon needs 3 or more contacts, got {n_contacts}")]
    TooFewContacts {
        /// How many there are.
        n_contacts: usize,
    },
    /// All contacts on one line (or in one place).
    #[error("the contacts are collinear seen along gravity, so they enclose no area")]
    CollinearContacts,
    /// A coordinate that is not a number, or infinite.
    #[error("contact {contact} (counted from 0) has a coordinate that is not finite")]
    NotFinite {
        /// Index of the contact.
        contact: usize,
    },
}

/// The absolute stability margin (F41) and the edge that limits it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Margin {
    /// How far the center of mass may still move, seen along gravity, before it crosses the
    /// nearest edge (m). Negative outside: minus the distance to the polygon.
    pub depth_m: f64,
    /// Index of the nearest edge among [`ConvexPolygon::edges`].
    pub edge: usize,
    /// Indices of the two contacts on whose line that edge lies, smaller first: the rover would
    /// tip about the line through them. For the regular polygon they are the edge's ends.
    pub contacts: [usize; 2],
}

/// The regular support polygon of 3 or more contacts, in any order.
pub fn regular(contacts_in_g: &[Point3<f64>]) -> Result<ConvexPolygon, SupportError> {
    let footprint = footprint(contacts_in_g)?;
    ConvexPolygon::hull(footprint).ok_or(SupportError::CollinearContacts)
}

/// The conservative support polygon: the points that no loss of a single contact uncovers.
///
/// An area needs 5 or more contacts. 4 contacts leave one point, whatever they are: where the
/// diagonals of their quadrilateral meet, or the contact that lies in the triangle of the other
/// three (Radon's theorem: the leave-one-out hulls of d + 2 points in d dimensions share exactly
/// the Radon point). 3 contacts leave nothing. A segment, which 5 or more contacts leave only if
/// three or more of them lie on a line, counts as its middle point.
pub fn conservative(contacts_in_g: &[Point3<f64>]) -> Result<ConvexRegion, SupportError> {
    let hull = regular(contacts_in_g)?;
    match contacts_in_g {
        [] | [_] | [_, _] | [_, _, _] => Ok(ConvexRegion::Empty),
        [a, b, c, d] => Ok(ConvexRegion::Point(radon_point([a.xy(), b.xy(), c.xy(), d.xy()]))),
        _ => Ok(leave_one_out(contacts_in_g, &hull)),
    }
}

/// The absolute stability margin (m, F41) of `com_in_g` over `support`, which is the regular or
/// the conservative polygon of these contacts.
pub fn margin(
    support: &ConvexPolygon,
    contacts_in_g: &[Point3<f64>],
    com_in_g: &Point3<f64>,
) -> Margin {
    let (depth_m, edge) = support.depth_and_edge(com_in_g.xy());
    let ends = support.edges().nth(edge).expect("the index is one of its edges");
    Margin { depth_m, edge, contacts: contacts_of_edge(contacts_in_g, ends) }
}

/// Distance of the center of mass to what the conservative region is: the margin (m) for an area,
/// minus the distance for a point, `None` for an empty region.
pub fn margin_of_region(region: &ConvexRegion, com_in_g: &Point3<f64>) -> Option<f64> {
    match region {
        ConvexRegion::Area(polygon) => Some(polygon.depth_of(com_in_g.xy())),
        ConvexRegion::Point(p) => Some(-(com_in_g.xy() - p).norm()),
        ConvexRegion::Empty => None,
    }
}

/// The contacts seen along gravity, once they are known to be numbers and 3 or more.
fn footprint(contacts_in_g: &[Point3<f64>]) -> Result<Vec<Point2<f64>>, SupportError> {
    if let Some(contact) =
        contacts_in_g.iter().position(|p| !p.coords.iter().all(|v| v.is_finite()))
    {
        return Err(SupportError::NotFinite { contact });
    }
    let n_contacts = contacts_in_g.len();
    if n_contacts < 3 {
        return Err(SupportError::TooFewContacts { n_contacts });
    }
    Ok(contacts_in_g.iter().map(Point3::xy).collect())
}

/// The point that every leave-one-out hull of four points (not all on a line) holds.
///
/// Four points in the plane have one affine dependency Σ λᵢ pᵢ = 0, Σ λᵢ = 0; the point is the
/// mean of those with λᵢ > 0, weighted by λᵢ. λᵢ is, up to sign, the area of the triangle of the
/// other three.
fn radon_point(p: [Point2<f64>; 4]) -> Point2<f64> {
    let area = |a: usize, b: usize, c: usize| (p[b] - p[a]).perp(&(p[c] - p[a]));
    let weights = [area(1, 2, 3), -area(0, 2, 3), area(0, 1, 3), -area(0, 1, 2)];
    let mut total = 0.0;
    let mut offset = Vector2::zeros();
    for (weight, q) in weights.iter().zip(&p).filter(|(weight, _)| **weight > 0.0) {
        total += weight;
        offset += (q - p[0]) * *weight;
    }
    p[0] + offset / total
}

/// One side of a line: where `inward` · (p - `on_line`) is not negative.
pub(crate) struct HalfPlane {
    on_line: Point2<f64>,
    inward: Vector2<f64>,
}

impl HalfPlane {
    /// Left of the line from `a` to `b`.
    pub(crate) fn left_of(a: Point2<f64>, b: Point2<f64>) -> HalfPlane {
        let along = (b - a).normalize();
        HalfPlane { on_line: a, inward: Vector2::new(-along.y, along.x) }
    }

    fn depth(&self, p: Point2<f64>) -> f64 {
        self.inward.dot(&(p - self.on_line))
    }
}

/// The intersection of the hulls of all contacts but one, by cutting `hull` with their edges.
///
/// A ring of vertices may shrink to a segment or a point on the way and is cut further as such,
/// so that what is left is right also where contacts lie on lines.
fn leave_one_out(contacts_in_g: &[Point3<f64>], hull: &ConvexPolygon) -> ConvexRegion {
    let mut ring = hull.vertices().to_vec();
    let mut others: Vec<Point2<f64>> = Vec::with_capacity(contacts_in_g.len());
    for lost in contacts_in_g {
        // The loss of a contact that is no vertex leaves the hull as it is.
        if !hull.vertices().contains(&lost.xy()) {
            continue;
        }
        others.clear();
        others.extend(contacts_in_g.iter().filter(|c| !std::ptr::eq(*c, lost)).map(Point3::xy));
        for half_plane in half_planes(&others) {
            ring = cut(&ring, &half_plane, CUT_SLACK);
        }
    }
    region_of_ring(ring)
}

/// What a ring of vertices encloses; a segment counts as its middle.
pub(crate) fn region_of_ring(ring: Vec<Point2<f64>>) -> ConvexRegion {
    if ring.is_empty() {
        return ConvexRegion::Empty;
    }
    let middle = ring.iter().map(|p| p.coords).sum::<Vector2<f64>>() / ring.len() as f64;
    match ConvexPolygon::hull(ring) {
        Some(polygon) => ConvexRegion::Area(polygon),
        None => ConvexRegion::Point(middle.into()),
    }
}

/// The half planes whose intersection is the hull of `points`: of a segment too.
fn half_planes(points: &[Point2<f64>]) -> Vec<HalfPlane> {
    if let Some(hull) = ConvexPolygon::hull(points.to_vec()) {
        return hull.edges().map(|(a, b)| HalfPlane::left_of(a, b)).collect();
    }
    let order = |p: &&Point2<f64>, q: &&Point2<f64>| p.x.total_cmp(&q.x).then(p.y.total_cmp(&q.y));
    let (Some(a), Some(b)) = (points.iter().min_by(order), points.iter().max_by(order)) else {
        return Vec::new();
    };
    let Some(along) = (b - a).try_normalize(0.0) else { return Vec::new() };
    vec![
        HalfPlane::left_of(*a, *b),
        HalfPlane::left_of(*b, *a),
        HalfPlane { on_line: *a, inward: along },
        HalfPlane { on_line: *b, inward: -along },
    ]
}

/// Sutherland and Hodgman's cut of a ring by one half plane; a ring may be a segment or a point.
/// What is no more than `slack` (m) outside counts as on the border.
pub(crate) fn cut(ring: &[Point2<f64>], half_plane: &HalfPlane, slack: f64) -> Vec<Point2<f64>> {
    let mut kept = Vec::with_capacity(ring.len() + 1);
    for (i, p) in ring.iter().enumerate() {
        let q = &ring[(i + 1) % ring.len()];
        let (dp, dq) = (half_plane.depth(*p), half_plane.depth(*q));
        if dp >= -slack {
            kept.push(*p);
        }
        if dp.min(dq) < -slack && dp.max(dq) > slack {
            kept.push(p + (q - p) * (dp / (dp - dq)));
        }
    }
    kept
}

/// The two contacts whose line lies nearest to both ends of an edge, smaller index first.
fn contacts_of_edge(
    contacts_in_g: &[Point3<f64>],
    (start, end): (Point2<f64>, Point2<f64>),
) -> [usize; 2] {
    let mut best = ([0, 0], f64::INFINITY);
    for (i, a) in contacts_in_g.iter().enumerate() {
        for (j, b) in contacts_in_g.iter().enumerate().skip(i + 1) {
            let ends = [a.xy(), b.xy()];
            // Every point of the edge lies between the two contacts, so distances to the segment
            // tell them from other contacts on the same line that do not span the edge. Of those
            // that span it (three and more on a line) the nearest to the edge's ends count.
            let miss = distance_to_segment(start, ends).max(distance_to_segment(end, ends));
            let excess = (ends[1] - ends[0]).norm() - (end - start).norm();
            let score = miss + 1e-6 * excess.max(0.0);
            if score < best.1 {
                best = ([i, j], score);
            }
        }
    }
    best.0
}

fn distance_to_segment(p: Point2<f64>, [a, b]: [Point2<f64>; 2]) -> f64 {
    let along = b - a;
    let length_2 = along.norm_squared();
    let t = if length_2 > 0.0 { ((p - a).dot(&along) / length_2).clamp(0.0, 1.0) } else { 0.0 };
    (p - (a + along * t)).norm()
}
