//! Convex polygons in the plane: hull, intersection, signed depth, deepest point.

use nalgebra::{Point2, Vector2};

/// Two vertices nearer than this (m) are one vertex: the direction of a shorter edge is noise.
const SMALLEST_EDGE: f64 = 1e-9;

/// How far (m) a clipped vertex may lie outside and still count as on the border.
const CLIP_SLACK: f64 = 1e-10;

/// A convex polygon with area, vertices counter-clockwise, no two of them nearer than 1e-9 m.
#[derive(Debug, Clone, PartialEq)]
pub struct ConvexPolygon {
    vertices: Vec<Point2<f64>>,
}

/// What an intersection of convex polygons can leave.
#[derive(Debug, Clone, PartialEq)]
pub enum ConvexRegion {
    /// A polygon with area.
    Area(ConvexPolygon),
    /// A single point (or a segment without area, given by its middle).
    Point(Point2<f64>),
    /// Nothing.
    Empty,
}

impl ConvexRegion {
    /// The polygon, if the region has area.
    pub fn area(&self) -> Option<&ConvexPolygon> {
        match self {
            ConvexRegion::Area(polygon) => Some(polygon),
            ConvexRegion::Point(_) | ConvexRegion::Empty => None,
        }
    }
}

impl ConvexPolygon {
    /// The convex hull of `points` (m), or `None` when they enclose no area.
    pub fn hull(mut points: Vec<Point2<f64>>) -> Option<ConvexPolygon> {
        points.sort_by(|p, q| p.x.total_cmp(&q.x).then(p.y.total_cmp(&q.y)));
        let lower = half_hull(points.iter());
        let upper = half_hull(points.iter().rev());
        let mut ring = lower;
        ring.pop();
        ring.extend(upper);
        ring.pop();
        ConvexPolygon::from_ring(ring)
    }

    /// Drops doubled and collinear vertices; `None` if no area is left.
    fn from_ring(ring: Vec<Point2<f64>>) -> Option<ConvexPolygon> {
        let mut vertices: Vec<Point2<f64>> = Vec::with_capacity(ring.len());
        for p in ring {
            if vertices.last().is_none_or(|q| (p - q).norm() > SMALLEST_EDGE) {
                vertices.push(p);
            }
        }
        while vertices.len() > 1
            && (vertices[0] - vertices[vertices.len() - 1]).norm() <= SMALLEST_EDGE
        {
            vertices.pop();
        }
        let polygon = ConvexPolygon { vertices };
        (polygon.vertices.len() >= 3 && polygon.area() > SMALLEST_EDGE * polygon.perimeter())
            .then_some(polygon)
    }

    /// The vertices (m), counter-clockwise.
    pub fn vertices(&self) -> &[Point2<f64>] {
        &self.vertices
    }

    /// The edges as (from, to) pairs, counter-clockwise.
    pub fn edges(&self) -> impl Iterator<Item = (Point2<f64>, Point2<f64>)> + '_ {
        let n = self.vertices.len();
        (0..n).map(move |i| (self.vertices[i], self.vertices[(i + 1) % n]))
    }

    /// The area (m²).
    pub fn area(&self) -> f64 {
        let Some(&origin) = self.vertices.first() else { return 0.0 };
        0.5 * self.edges().map(|(a, b)| (a - origin).perp(&(b - origin))).sum::<f64>()
    }

    fn perimeter(&self) -> f64 {
        self.edges().map(|(a, b)| (b - a).norm()).sum()
    }

    /// How deep `p` lies inside (m): the distance to the nearest edge line, negative outside.
    ///
    /// Outside, the value is minus the distance to the polygon.
    pub fn depth_of(&self, p: Point2<f64>) -> f64 {
        self.depth_and_edge(p).0
    }

    /// As [`depth_of`](Self::depth_of), with the index of the edge that decides.
    pub fn depth_and_edge(&self, p: Point2<f64>) -> (f64, usize) {
        let mut inside = (f64::INFINITY, 0);
        let mut outside = (f64::INFINITY, 0);
        for (i, (a, b)) in self.edges().enumerate() {
            let along = (b - a).normalize();
            let depth = along.perp(&(p - a));
            if depth < inside.0 {
                inside = (depth, i);
            }
            let distance = distance_to_segment(p, a, b);
            if distance < outside.0 {
                outside = (distance, i);
            }
        }
        if inside.0 >= 0.0 { inside } else { (-outside.0, outside.1) }
    }

    /// What this polygon and `other` share.
    pub fn intersection(&self, other: &ConvexPolygon) -> ConvexRegion {
        ConvexRegion::Area(self.clone()).clipped_by(other)
    }

    /// The point deepest inside and its depth (m): the center of the largest inscribed circle.
    ///
    /// The depth is concave over the plane, so a nested golden-section search finds its maximum;
    /// the result is good to about 1e-9 of the polygon's width.
    pub fn deepest_point(&self) -> (Point2<f64>, f64) {
        let (x0, x1) = extent(self.vertices.iter().map(|v| v.x));
        let (y0, y1) = extent(self.vertices.iter().map(|v| v.y));
        // Inside the hull of the lines' depths, not the distance: it stays concave outside too.
        let depth = |x: f64, y: f64| {
            let p = Point2::new(x, y);
            self.edges()
                .map(|(a, b)| (b - a).normalize().perp(&(p - a)))
                .fold(f64::INFINITY, f64::min)
        };
        let best_y = |x: f64| maximize(y0, y1, |y| depth(x, y)).0;
        let (x, _) = maximize(x0, x1, |x| depth(x, best_y(x)));
        let y = best_y(x);
        (Point2::new(x, y), depth(x, y))
    }
}

impl ConvexRegion {
    /// What this region and `other` share.
    pub fn clipped_by(&self, other: &ConvexPolygon) -> ConvexRegion {
        match self {
            ConvexRegion::Empty => ConvexRegion::Empty,
            ConvexRegion::Point(p) if other.depth_of(*p) >= -CLIP_SLACK.sqrt() => {
                ConvexRegion::Point(*p)
            }
            ConvexRegion::Point(_) => ConvexRegion::Empty,
            ConvexRegion::Area(polygon) => clip(polygon, other),
        }
    }
}

/// Sutherland and Hodgman's clipping of `subject` by each edge line of `clipper`.
fn clip(subject: &ConvexPolygon, clipper: &ConvexPolygon) -> ConvexRegion {
    let mut ring = subject.vertices.clone();
    for (a, b) in clipper.edges() {
        let along = (b - a).normalize();
        let depth = |p: &Point2<f64>| along.perp(&(p - a));
        let mut kept = Vec::with_capacity(ring.len() + 1);
        for (i, p) in ring.iter().enumerate() {
            let q = &ring[(i + 1) % ring.len()];
            let (dp, dq) = (depth(p), depth(q));
            if dp >= -CLIP_SLACK {
                kept.push(*p);
            }
            let crosses =
                (dp > CLIP_SLACK && dq < -CLIP_SLACK) || (dp < -CLIP_SLACK && dq > CLIP_SLACK);
            if crosses {
                kept.push(p + (q - p) * (dp / (dp - dq)));
            }
        }
        ring = kept;
        if ring.is_empty() {
            return ConvexRegion::Empty;
        }
    }
    let middle =
        Point2::from(ring.iter().map(|p| p.coords).sum::<Vector2<f64>>() / ring.len() as f64);
    match ConvexPolygon::from_ring(ring) {
        Some(polygon) => ConvexRegion::Area(polygon),
        None => ConvexRegion::Point(middle),
    }
}

fn half_hull<'a>(points: impl Iterator<Item = &'a Point2<f64>>) -> Vec<Point2<f64>> {
    let mut hull: Vec<Point2<f64>> = Vec::new();
    for p in points {
        while hull.len() >= 2 {
            let (a, b) = (hull[hull.len() - 2], hull[hull.len() - 1]);
            if (b - a).perp(&(p - a)) > 0.0 {
                break;
            }
            hull.pop();
        }
        hull.push(*p);
    }
    hull
}

fn distance_to_segment(p: Point2<f64>, a: Point2<f64>, b: Point2<f64>) -> f64 {
    let ab = b - a;
    let t = ((p - a).dot(&ab) / ab.norm_squared()).clamp(0.0, 1.0);
    (p - (a + ab * t)).norm()
}

fn extent(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), v| (lo.min(v), hi.max(v)))
}

/// Golden-section search for the maximum of a concave `f` on `[lo, hi]`: (argument, value).
fn maximize(mut lo: f64, mut hi: f64, f: impl Fn(f64) -> f64) -> (f64, f64) {
    let golden = 0.5 * (5.0_f64.sqrt() - 1.0);
    let (mut a, mut b) = (hi - golden * (hi - lo), lo + golden * (hi - lo));
    let (mut fa, mut fb) = (f(a), f(b));
    // 45 halvings by the golden ratio shrink the interval to 4e-10 of its length.
    for _ in 0..45 {
        if fa < fb {
            (lo, a, fa) = (a, b, fb);
            b = lo + golden * (hi - lo);
            fb = f(b);
        } else {
            (hi, b, fb) = (b, a, fa);
            a = hi - golden * (hi - lo);
            fa = f(a);
        }
    }
    let middle = 0.5 * (lo + hi);
    (middle, f(middle))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn polygon(points: &[(f64, f64)]) -> ConvexPolygon {
        ConvexPolygon::hull(points.iter().map(|&(x, y)| Point2::new(x, y)).collect()).unwrap()
    }

    fn square() -> ConvexPolygon {
        polygon(&[(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0), (1.0, 1.0), (1.0, 0.0)])
    }

    #[test]
    fn hull_drops_what_lies_inside_or_on_an_edge() {
        assert_eq!(square().vertices().len(), 4);
        assert!((square().area() - 4.0).abs() < 1e-12);
    }

    #[test]
    fn points_on_a_line_have_no_hull() {
        let line = (0..5).map(|i| Point2::new(f64::from(i), 2.0 * f64::from(i))).collect();
        assert_eq!(ConvexPolygon::hull(line), None);
        assert_eq!(ConvexPolygon::hull(vec![]), None);
    }

    #[test]
    fn depth_is_signed_and_true_to_distance_outside() {
        assert!((square().depth_of(Point2::new(0.5, 1.0)) - 0.5).abs() < 1e-12);
        let corner = square().depth_of(Point2::new(3.0, 3.0));
        assert!((corner + 2.0_f64.sqrt()).abs() < 1e-12, "{corner}");
    }

    #[test]
    fn triangles_that_touch_share_a_point() {
        let left = polygon(&[(-1.0, 0.0), (0.0, 0.5), (-1.0, 1.0)]);
        let right = polygon(&[(1.0, 0.0), (0.0, 0.5), (1.0, 1.0)]);
        match left.intersection(&right) {
            ConvexRegion::Point(p) => assert!((p - Point2::new(0.0, 0.5)).norm() < 1e-9),
            other => panic!("{other:?}"),
        }
        let apart = polygon(&[(1.1, 0.0), (0.1, 0.5), (1.1, 1.0)]);
        assert_eq!(left.intersection(&apart), ConvexRegion::Empty);
    }

    #[test]
    fn deepest_point_of_a_right_triangle_is_its_incenter() {
        // Legs 3 and 4: inradius (3 + 4 - 5) / 2 = 1, incenter (1, 1).
        let (p, depth) = polygon(&[(0.0, 0.0), (3.0, 0.0), (0.0, 4.0)]).deepest_point();
        assert!((p - Point2::new(1.0, 1.0)).norm() < 1e-6, "{p}");
        assert!((depth - 1.0).abs() < 1e-8, "{depth}");
    }
}
