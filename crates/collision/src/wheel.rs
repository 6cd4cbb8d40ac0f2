//! A wheel against the height field, without parry: the vertical gap between the two.
//!
//! The wheel is a solid cylinder and the ground is solid below a surface of triangles, so the
//! wheel is inside the ground exactly where its lower side lies below the surface at the same
//! (x, y). The smallest vertical gap tells all: positive above, zero touching, negative inside;
//! and lifting the wheel by d raises it by d.

use nalgebra::{Point2, Point3, Unit, Vector3};
use rover::WheelPose;
use terrain::ElevationMap;

/// Golden-section steps along a grid edge: 20 shrink the bracket to 7e-5 of its length, and the
/// gap is quadratic about its minimum.
const REFINEMENTS: usize = 20;

/// Share of the ground tolerance by which a standing wheel may be in the ground beyond its contact
/// radius: the corners of a wheel that has sunk in by the whole tolerance.
pub(crate) const BEYOND_CONTACT: f64 = 0.25;

/// The smallest vertical gap and where it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WheelGap {
    /// Height of the wheel's lower side above the ground (m), negative inside the ground.
    pub gap: f64,
    /// The point of ground there.
    pub ground: Point3<f64>,
}

/// A wheel over the ground.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WheelGround {
    /// Smallest gap over the known ground below the wheel; none where nothing is known.
    pub nearest: Option<WheelGap>,
    /// True if part of the ground below the wheel is unknown or outside the map.
    pub unknown: bool,
}

/// The vertical gap between a wheel and the ground, over the points for which `keep` holds.
///
/// Exact on planes to rounding; on rough ground good to about 1e-6 m, by nodes, by the lowest
/// point against each triangle, and by search along the edges of the grid.
pub fn wheel_ground(
    wheel: &WheelPose,
    map: &ElevationMap,
    keep: impl Fn(Point2<f64>) -> bool,
) -> WheelGround {
    let mut search = Search { wheel: Cylinder::new(wheel), map, keep, best: None, unknown: false };
    let (min, max) = search.wheel.footprint();
    search.lattice(min, max);
    search.cells(wheel, min, max);
    WheelGround { nearest: search.best, unknown: search.unknown }
}

/// The middle of a wheel's contact: of the line along which it touches ground that is level across
/// its width, else the point of touch itself.
pub fn contact_center(wheel: &WheelPose, map: &ElevationMap, gap: &WheelGap) -> Point3<f64> {
    let normal = map.normal_at(gap.ground.xy()).unwrap_or(Vector3::z_axis());
    let low = wheel.lowest_point(&normal);
    let on_line = (low - gap.ground).norm() <= 0.5 * wheel.width + 1e-6;
    if on_line { low } else { gap.ground }
}

fn wheel_is_level(wheel: &WheelPose, normal: &Unit<Vector3<f64>>) -> bool {
    wheel.camber(normal) <= 1e-6
}

/// The wheel as a cylinder in `world`.
struct Cylinder {
    center: Point3<f64>,
    axle: Unit<Vector3<f64>>,
    radius: f64,
    half_width: f64,
}

impl Cylinder {
    fn new(wheel: &WheelPose) -> Cylinder {
        Cylinder {
            center: wheel.center(),
            axle: wheel.axle(),
            radius: wheel.radius,
            half_width: 0.5 * wheel.width,
        }
    }

    fn footprint(&self) -> (Point2<f64>, Point2<f64>) {
        let half = |a: f64| self.radius * (1.0 - a * a).max(0.0).sqrt() + self.half_width * a.abs();
        let (hx, hy) = (half(self.axle.x), half(self.axle.y));
        let c = self.center;
        (Point2::new(c.x - hx, c.y - hy), Point2::new(c.x + hx, c.y + hy))
    }

    /// The lowest z of the cylinder on the vertical line through `p`, if it meets it.
    fn lower_side(&self, p: Point2<f64>) -> Option<f64> {
        let a = &self.axle;
        let (dx, dy) = (p.x - self.center.x, p.y - self.center.y);
        // Along the line, s = height above the center: distance from the axle² is quadratic in s,
        // place along the axle is linear.
        let along = dx * a.x + dy * a.y;
        let square = 1.0 - a.z * a.z;
        let (mut lo, mut hi) = (f64::NEG_INFINITY, f64::INFINITY);
        let outside = dx * dx + dy * dy - along * along - self.radius * self.radius;
        if square > 1e-12 {
            let half_linear = -along * a.z;
            let discriminant = half_linear * half_linear - square * outside;
            if discriminant < 0.0 {
                return None;
            }
            let root = discriminant.sqrt();
            (lo, hi) = ((-half_linear - root) / square, (-half_linear + root) / square);
        } else if outside > 0.0 {
            return None;
        }
        if a.z.abs() > 1e-12 {
            let ends = [(-self.half_width - along) / a.z, (self.half_width - along) / a.z];
            lo = lo.max(ends[0].min(ends[1]));
            hi = hi.min(ends[0].max(ends[1]));
        } else if along.abs() > self.half_width + 1e-12 {
            return None;
        }
        (lo <= hi).then_some(self.center.z + lo)
    }
}

struct Search<'a, F> {
    wheel: Cylinder,
    map: &'a ElevationMap,
    keep: F,
    best: Option<WheelGap>,
    unknown: bool,
}

impl<F: Fn(Point2<f64>) -> bool> Search<'_, F> {
    /// Gap at one point, also kept as the best if it is.
    fn try_point(&mut self, p: Point2<f64>) -> Option<f64> {
        let lower = self.wheel.lower_side(p)?;
        self.try_height(p, lower)
    }

    /// As [`try_point`](Self::try_point) for a point of the wheel whose height is known: points on
    /// its rim are beside it by rounding as often as not.
    fn try_height(&mut self, p: Point2<f64>, lower: f64) -> Option<f64> {
        if !(self.keep)(p) {
            return None;
        }
        let Some(ground) = self.map.height_at(p) else {
            self.unknown = true;
            return None;
        };
        let gap = lower - ground;
        if self.best.is_none_or(|best| gap < best.gap) {
            self.best = Some(WheelGap { gap, ground: Point3::new(p.x, p.y, ground) });
        }
        Some(gap)
    }

    /// Points a sixth of the radius apart: they find unknown ground and the outside of regions.
    fn lattice(&mut self, min: Point2<f64>, max: Point2<f64>) {
        let step = self.wheel.radius.min(2.0 * self.wheel.half_width) / 6.0;
        let n = |lo: f64, hi: f64| (((hi - lo) / step).ceil() as usize).clamp(2, 60);
        let (nx, ny) = (n(min.x, max.x), n(min.y, max.y));
        for iy in 0..=ny {
            for ix in 0..=nx {
                self.try_point(Point2::new(
                    min.x + (max.x - min.x) * ix as f64 / nx as f64,
                    min.y + (max.y - min.y) * iy as f64 / ny as f64,
                ));
            }
        }
    }

    fn cells(&mut self, pose: &WheelPose, min: Point2<f64>, max: Point2<f64>) {
        let grid = *self.map.grid();
        let pad = grid.resolution;
        let (xs, ys) = grid.nodes_within(
            Point2::new(min.x - pad, min.y - pad),
            Point2::new(max.x + pad, max.y + pad),
        );
        let mut edges = Vec::new();
        for iy in ys.clone() {
            for ix in xs.clone() {
                let here = grid.position(ix, iy);
                self.try_point(here);
                let (right, up) = (ix + 1 < grid.nx, iy + 1 < grid.ny);
                if right {
                    edges.push((here, grid.position(ix + 1, iy)));
                }
                if up {
                    edges.push((here, grid.position(ix, iy + 1)));
                }
                if right && up {
                    edges.push((grid.position(ix + 1, iy), grid.position(ix, iy + 1)));
                    for (u, v) in [(0.25, 0.25), (0.75, 0.75)] {
                        self.try_support(
                            pose,
                            here + Vector3::new(u, v, 0.0).xy() * pad,
                            here,
                            pad,
                        );
                    }
                }
            }
        }
        for (a, b) in edges {
            self.try_edge(a, b);
        }
    }

    /// The wheel's lowest points against the plane of the triangle that holds `inside`.
    fn try_support(
        &mut self,
        pose: &WheelPose,
        inside: Point2<f64>,
        corner: Point2<f64>,
        side: f64,
    ) {
        let Some(normal) = self.map.normal_at(inside) else { return };
        let lowest = pose.lowest_point(&normal);
        let along = self.wheel.axle.into_inner() * self.wheel.half_width;
        // With a level axle the whole line touches; its ends may lie over other triangles.
        let level = wheel_is_level(pose, &normal);
        let points = [lowest, lowest + along, lowest - along];
        for p in &points[..if level { 3 } else { 1 }] {
            let d = p.xy() - corner;
            let inside_cell = d.x >= 0.0 && d.y >= 0.0 && d.x <= side && d.y <= side;
            if inside_cell {
                self.try_height(p.xy(), p.z);
            }
        }
    }

    fn try_edge(&mut self, a: Point2<f64>, b: Point2<f64>) {
        let length = (b - a).norm();
        let n = ((length / self.wheel.half_width * 4.0).ceil() as usize).clamp(4, 400);
        let at = |t: f64| a + (b - a) * t;
        let mut coarse: Option<(f64, f64)> = None;
        for i in 0..n {
            let t = (i as f64 + 0.5) / n as f64;
            if let Some(gap) = self.try_point(at(t))
                && coarse.is_none_or(|(_, best)| gap < best)
            {
                coarse = Some((t, gap));
            }
        }
        let Some((t, gap)) = coarse else { return };
        let slack = length / n as f64;
        if self.best.is_some_and(|best| gap > best.gap + 2.0 * slack) {
            return;
        }
        let golden = 0.618_033_988_749_894_9;
        let (mut lo, mut hi) = ((t - 1.0 / n as f64).max(0.0), (t + 1.0 / n as f64).min(1.0));
        for _ in 0..REFINEMENTS {
            let (t1, t2) = (hi - golden * (hi - lo), lo + golden * (hi - lo));
            match (self.try_point(at(t1)), self.try_point(at(t2))) {
                (Some(g1), Some(g2)) if g1 < g2 => hi = t2,
                (Some(_), Some(_)) => lo = t1,
                (Some(_), None) => hi = t2,
                (None, Some(_)) => lo = t1,
                // Both beside the wheel: the part below it is where the coarse best was.
                (None, None) if t < t1 => hi = t1,
                (None, None) if t > t2 => lo = t2,
                (None, None) => (lo, hi) = (t1, t2),
            }
        }
    }
}
