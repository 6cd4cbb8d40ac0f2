//! A wheel or ball foot against the height field, without parry: the vertical gap of the two.
//!
//! The wheel is a solid cylinder (a foot a ball) and the ground is solid below a surface of triangles, so the
//! wheel is inside the ground exactly where its lower side lies below the surface at the same
//! (x, y). The smallest vertical gap tells all: positive above, zero touching, negative inside;
//! and lifting the wheel by d raises it by d.

mod edge;
mod underside;

use std::ops::Range;

use nalgebra::{Point2, Point3, Unit, Vector3};
use rover::WheelPose;
use terrain::ElevationMap;

use self::underside::Underside;

/// Golden-section steps along a grid edge where not all of it counts: 20 shrink the bracket to 7e-5 of
/// its length, and the gap is quadratic about its minimum.
const REFINEMENTS: usize = 20;

/// Squares of a row whose bounds are looked at together.
const RUN: usize = 32;

/// What a gap along an edge may be smaller than the one found (m): well below what the search along
/// it would tell apart.
const SETTLED: f64 = 1e-8;

/// Share of the ground tolerance by which a standing wheel may be in the ground beyond its contact
/// radius: the corners of a wheel that has sunk in by the whole tolerance.
pub(crate) const BEYOND_CONTACT: f64 = 0.25;

/// Difference of gaps, as a share of the wheel's radius, below which points are equally near:
/// 1 mm for the wheel of `athlete`.
const EQUALLY_NEAR: f64 = 0.004;

/// As [`EQUALLY_NEAR`] for a wheel whose axle is level with the ground's patch: 1 cm of roughness is
/// pressed down or taken by the tyre before the wheel would stand on its rim.
const ROUGHNESS_TAKEN: f64 = 0.04;

/// Camber up to which an axle counts as level with the ground's patch (rad).
const LEVEL_ENOUGH: f64 = 0.02;

/// Side of the patch of ground whose plane counts, in wheel widths.
pub(crate) const PATCH_WIDTHS: f64 = 1.25;

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
/// Exact to rounding on known ground: by the lowest point against each triangle and by closed forms along
/// the edges of the grid. Where only part of an edge counts it is searched, good to about 1e-6 m.
pub fn wheel_ground(
    wheel: &WheelPose,
    map: &ElevationMap,
    keep: impl Fn(Point2<f64>) -> bool,
) -> WheelGround {
    wheel_ground_near(wheel, map, None, keep)
}

/// As [`wheel_ground`], looking first at a point that a wheel much like it was nearest to: the answer is
/// the same to 1e-8 m and comes sooner.
pub(crate) fn wheel_ground_near(
    wheel: &WheelPose,
    map: &ElevationMap,
    near: Option<Point2<f64>>,
    keep: impl Fn(Point2<f64>) -> bool,
) -> WheelGround {
    let mut search = Search { wheel: Cylinder::new(wheel), map, keep, best: None, unknown: false };
    if let Some(near) = near
        && map.height_at(near).is_some()
    {
        search.try_point(near);
    }
    let (min, max) = search.wheel.footprint();
    // Coarse grids leave few nodes below the wheel: look between them too.
    if 3.0 * map.grid().resolution > wheel.radius.min(wheel.width) {
        search.lattice(min, max);
    }
    search.cells(min, max);
    WheelGround { nearest: search.best, unknown: search.unknown }
}

/// The middle of a wheel's contact: the middle of its width at the bottom, where that is as near
/// to the ground as any other point, else the nearest point of ground itself.
///
/// A wheel with a level axle touches level ground along a line; without this, rounding (or a
/// hundredth of a millimeter of roughness) would pick one of its ends.
pub fn contact_center(wheel: &WheelPose, map: &ElevationMap, gap: &WheelGap) -> Point3<f64> {
    contact_center_on(wheel, map, gap, patch_normal(wheel, map))
}

/// The normal of the patch of ground below a wheel's center, where enough of it is known.
pub(crate) fn patch_normal(wheel: &WheelPose, map: &ElevationMap) -> Option<Unit<Vector3<f64>>> {
    let plane = map.footprint_plane(wheel.center().xy(), PATCH_WIDTHS * wheel.width);
    plane.map(|plane| plane.normal)
}

/// As [`contact_center`] on a patch of which the normal is given.
pub(crate) fn contact_center_on(
    wheel: &WheelPose,
    map: &ElevationMap,
    gap: &WheelGap,
    patch: Option<Unit<Vector3<f64>>>,
) -> Point3<f64> {
    let normal = patch.or_else(|| map.normal_at(gap.ground.xy())).unwrap_or(Vector3::z_axis());
    if wheel.ball {
        return gap.ground; // a ball touches in a point
    }
    let axle = wheel.axle().into_inner();
    let across = normal.into_inner() - axle * normal.dot(&axle);
    let Some(across) = Unit::try_new(across, 1e-9) else { return gap.ground };
    let middle = wheel.lowest_point(&across);
    let level = wheel.camber(&normal) <= LEVEL_ENOUGH;
    let slack = wheel.radius * if level { ROUGHNESS_TAKEN } else { EQUALLY_NEAR };
    let as_near =
        map.height_at(middle.xy()).is_some_and(|ground| middle.z - ground <= gap.gap + slack);
    if as_near { middle } else { gap.ground }
}

/// The wheel as a cylinder, or the foot as a ball, in `world`.
struct Cylinder {
    ball: bool,
    center: Point3<f64>,
    axle: Unit<Vector3<f64>>,
    radius: f64,
    half_width: f64,
}

impl Cylinder {
    fn new(wheel: &WheelPose) -> Cylinder {
        Cylinder {
            ball: wheel.ball,
            center: wheel.center(),
            axle: wheel.axle(),
            radius: wheel.radius,
            half_width: 0.5 * wheel.width,
        }
    }

    /// Is the axle in the plane with this normal?
    fn is_level(&self, normal: &Unit<Vector3<f64>>) -> bool {
        !self.ball && self.axle.dot(normal).abs() <= 1e-6
    }

    /// The point that lies deepest against `normal`, as [`WheelPose::lowest_point`].
    fn lowest_point(&self, normal: &Unit<Vector3<f64>>) -> Point3<f64> {
        if self.ball {
            return self.center - normal.into_inner() * self.radius;
        }
        let along = normal.dot(&self.axle);
        let radial = normal.into_inner() - self.axle.into_inner() * along;
        let mut point = self.center;
        if let Some(radial) = radial.try_normalize(1e-6) {
            point -= radial * self.radius;
        }
        if !self.is_level(normal) {
            point -= self.axle.into_inner() * (along.signum() * self.half_width);
        }
        point
    }

    fn footprint(&self) -> (Point2<f64>, Point2<f64>) {
        if self.ball {
            let (c, r) = (self.center.xy(), nalgebra::Vector2::repeat(self.radius));
            return (c - r, c + r);
        }
        let half = |a: f64| self.radius * (1.0 - a * a).max(0.0).sqrt() + self.half_width * a.abs();
        let (hx, hy) = (half(self.axle.x), half(self.axle.y));
        let c = self.center;
        (Point2::new(c.x - hx, c.y - hy), Point2::new(c.x + hx, c.y + hy))
    }

    /// The lowest z of the solid on the vertical line through `p`, if it meets it.
    fn lower_side(&self, p: Point2<f64>) -> Option<f64> {
        if self.ball {
            let square = self.radius * self.radius - (p - self.center.xy()).norm_squared();
            return (square >= 0.0).then(|| self.center.z - square.sqrt());
        }
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

/// The place of the least bound.
fn lowest_of(open: &[(f64, usize, usize)]) -> Option<usize> {
    let mut least = open.first()?.0;
    let mut place = 0;
    for (at, (bound, ..)) in open.iter().enumerate() {
        if *bound < least {
            (least, place) = (*bound, at);
        }
    }
    Some(place)
}

/// The highest of four known heights.
fn highest_of(heights: &[f64; 4]) -> f64 {
    let higher = |a: f64, b: f64| if b > a { b } else { a };
    higher(higher(heights[0], heights[1]), higher(heights[2], heights[3]))
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
        self.try_over(p, lower, ground)
    }

    /// As [`try_height`](Self::try_height) over ground of known height.
    fn try_over(&mut self, p: Point2<f64>, lower: f64, ground: f64) -> Option<f64> {
        if !(self.keep)(p) {
            return None;
        }
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

    fn cells(&mut self, min: Point2<f64>, max: Point2<f64>) {
        let grid = *self.map.grid();
        let pad = nalgebra::Vector2::repeat(grid.resolution);
        let far = grid.far_corner();
        let beyond_map =
            min.x < grid.origin.x || min.y < grid.origin.y || max.x > far.x || max.y > far.y;
        if beyond_map {
            self.lattice(min, max); // finds out whether any of it that counts hangs over the edge
        }
        let (xs, ys) = grid.nodes_within(min - pad, max + pad);
        let lowest = self.wheel.lowest_point(&Vector3::z_axis()).z;
        let under = Underside::new(&self.wheel, lowest, grid.resolution);
        // The bottom first: it is nearly always about as near as any, and then most squares need no
        // look.
        self.try_point(self.wheel.center.xy());
        let mut open: Vec<(f64, usize, usize)> = Vec::with_capacity(32);
        let squares = |nodes: Range<usize>| nodes.start..nodes.end.saturating_sub(1);
        let (columns, rows) = (squares(xs), squares(ys));
        // What is unknown must be met, and is nowhere high.
        let known = self.map.holes().is_none();
        let heights = self.map.heights().values();
        let may_be = |bound: f64| self.best.is_none_or(|best| bound < best.gap - SETTLED);
        let mut beside = self.wheel.radius;
        if known {
            let top = self.map.max_over(min, max);
            if !may_be(lowest - top) {
                return;
            }
            if let Some(best) = self.best {
                beside = under.aside_of(top, best.gap - SETTLED);
            }
        }
        let mut bounds = [0.0; RUN];
        for iy in rows {
            let (from, to) = under.columns(grid.position(0, iy), beside);
            let from = columns.start.max(from.clamp(0.0, grid.nx as f64) as usize);
            let to = columns.end.min(to.clamp(0.0, grid.nx as f64) as usize);
            for start in (from..to).step_by(RUN) {
                let run = start..to.min(start + RUN);
                let row = |iy: usize| &heights[grid.index(start, iy)..][..run.len() + 1];
                let corner = grid.position(start, iy);
                let bounds = &mut bounds[..run.len()];
                under.over_row(corner, [row(iy), row(iy + 1)], bounds);
                for (ix, bound) in run.zip(bounds) {
                    // A bound that is no number is of ground that is not known.
                    if may_be(*bound) || (!known && bound.is_nan()) {
                        let bound = self.bound_over(&under, ix, iy);
                        if may_be(bound) {
                            open.push((bound, ix, iy));
                        }
                    }
                }
            }
        }
        // The most promising first: it nearly always has the nearest point of all.
        while let Some(next) = lowest_of(&open) {
            let (bound, ix, iy) = open.swap_remove(next);
            if self.best.is_some_and(|best| bound >= best.gap) {
                break;
            }
            if let Some(best) = self.best {
                // Squares about the nearest point so far: most share that point, and have none nearer.
                let (corner, heights) = (grid.position(ix, iy), self.corners(ix, iy));
                let bound = under.over_square_from(best.ground.xy(), corner, heights);
                if bound >= best.gap - SETTLED {
                    continue;
                }
            }
            self.try_square(&under, ix, iy);
            if let Some(best) = self.best {
                open.retain(|(bound, ..)| *bound < best.gap);
            }
        }
    }

    /// A gap that is no larger than any over a square of the grid; negative infinity where it is not
    /// known.
    fn bound_over(&self, under: &Underside, ix: usize, iy: usize) -> f64 {
        let heights = self.corners(ix, iy);
        if heights.iter().sum::<f64>().is_nan() {
            return f64::NEG_INFINITY;
        }
        let bound = under.lowest - highest_of(&heights);
        bound.max(under.over_square(self.map.grid().position(ix, iy), heights))
    }

    /// Heights at the corners of a square: at its start, along x, along y, opposite.
    fn corners(&self, ix: usize, iy: usize) -> [f64; 4] {
        let z = |dx, dy| f64::from(*self.map.heights().at(ix + dx, iy + dy));
        [z(0, 0), z(1, 0), z(0, 1), z(1, 1)]
    }

    fn try_square(&mut self, under: &Underside, ix: usize, iy: usize) {
        let heights = self.corners(ix, iy);
        let nodes = [(ix, iy), (ix + 1, iy), (ix, iy + 1), (ix + 1, iy + 1)];
        let places = nodes.map(|(ix, iy)| self.map.grid().position(ix, iy));
        if heights.iter().any(|z| z.is_nan()) {
            places.iter().for_each(|p| {
                self.try_point(*p);
            });
        }
        self.try_supports(under, ix, iy);
        // The edges on the far sides are those of the squares beyond, which are looked at if they may be
        // nearer.
        for [a, b] in [[1, 2], [0, 1], [0, 2]] {
            self.try_edge([places[a], places[b]], [heights[a], heights[b]], under);
        }
    }

    /// The wheel's lowest points against the planes of the two triangles of a square.
    fn try_supports(&mut self, under: &Underside, ix: usize, iy: usize) {
        let grid = self.map.grid();
        let (corner, side) = (grid.position(ix, iy), grid.resolution);
        let [z00, z10, z01, z11] = self.corners(ix, iy);
        let lower = Vector3::new(z00 - z10, z00 - z01, side);
        let upper = Vector3::new(z01 - z11, z10 - z11, side);
        for (normal, corner_z) in [(lower, z00), (upper, z11)] {
            let top = highest_of(&[corner_z, z10, z01, corner_z]);
            let beaten = |best: WheelGap| under.lowest - top >= best.gap;
            if !normal.iter().all(|v| v.is_finite()) || self.best.is_some_and(beaten) {
                continue;
            }
            let normal = Unit::new_normalize(normal);
            let lowest = self.wheel.lowest_point(&normal);
            let along = self.wheel.axle.into_inner() * self.wheel.half_width;
            // With a level axle the whole line touches; its ends may lie over other triangles.
            let points = [lowest, lowest + along, lowest - along];
            for p in &points[..if self.wheel.is_level(&normal) { 3 } else { 1 }] {
                let d = p.xy() - corner;
                if d.x >= 0.0 && d.y >= 0.0 && d.x <= side && d.y <= side {
                    self.try_height(p.xy(), p.z);
                }
            }
        }
    }

    /// Tries where the wheel's round is nearest to an edge over known ground; true if nothing along it
    /// can be nearer than the nearest so far.
    fn is_settled(
        &mut self,
        [a, b]: [Point2<f64>; 2],
        [za, zb]: [f64; 2],
        under: &Underside,
    ) -> bool {
        let (Some(level), false) = (&under.level, (za + zb).is_nan()) else { return false };
        let Some(line) = under.over_edge(level, a, b) else { return true };
        let rise = zb - za;
        let beaten = |search: &Self, t: f64, slack: f64| {
            search.best.is_some_and(|best| line.bound(t, za, rise) >= best.gap - slack)
        };
        if beaten(self, 0.5 * (line.ends[0] + line.ends[1]), 0.0) {
            return true;
        }
        let t = line.nearest(rise);
        let p = a + (b - a) * t;
        if let Some(lower) = self.wheel.lower_side(p) {
            self.try_over(p, lower, za + rise * t);
        }
        beaten(self, t, SETTLED)
    }

    /// The smallest gap along an edge of the grid.
    fn try_edge(&mut self, [a, b]: [Point2<f64>; 2], heights: [f64; 2], under: &Underside) {
        let beaten = |best: WheelGap| heights.iter().all(|z| under.lowest - z >= best.gap);
        if self.best.is_some_and(beaten) {
            return;
        }
        if self.is_settled([a, b], heights, under) {
            return;
        }
        let [za, rise] = [heights[0], heights[1] - heights[0]];
        if !rise.is_nan() {
            let gap = |c: &edge::Candidate| c.height - (za + rise * c.share);
            let all = edge::candidates(&self.wheel, a, b, rise);
            let Some(nearest) = all.iter().min_by(|c, d| gap(c).total_cmp(&gap(d))) else { return };
            let p = a + (b - a) * nearest.share;
            if self.best.is_some_and(|best| gap(nearest) >= best.gap)
                || self.try_over(p, nearest.height, za + rise * nearest.share).is_some()
            {
                return;
            }
        }
        self.search_edge([a, b]);
    }

    /// The smallest gap along an edge of which not all counts, or is known, by search.
    fn search_edge(&mut self, [a, b]: [Point2<f64>; 2]) {
        let at = |t: f64| a + (b - a) * t;
        self.try_point(a);
        self.try_point(b);
        let length = (b - a).norm();
        let n = ((length / self.wheel.half_width * 4.0).ceil() as usize).clamp(4, 400);
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
        let inner = |lo: f64, hi: f64| (hi - golden * (hi - lo), lo + golden * (hi - lo));
        let (mut t1, mut t2) = inner(lo, hi);
        let (mut g1, mut g2) = (self.try_point(at(t1)), self.try_point(at(t2)));
        for _ in 0..REFINEMENTS {
            let leaves_upper = match (g1, g2) {
                (Some(g1), Some(g2)) => g1 < g2,
                (Some(_), None) => true,
                (None, Some(_)) => false,
                // Both beside the wheel: the part below it is where the coarse best was.
                (None, None) if t < t1 => true,
                (None, None) if t > t2 => false,
                (None, None) => {
                    (lo, hi) = (t1, t2);
                    (t1, t2) = inner(lo, hi);
                    (g1, g2) = (self.try_point(at(t1)), self.try_point(at(t2)));
                    continue;
                }
            };
            // By the golden section one of the two points serves again.
            if leaves_upper {
                (hi, t2, g2) = (t2, t1, g1);
                t1 = inner(lo, hi).0;
                g1 = self.try_point(at(t1));
            } else {
                (lo, t1, g1) = (t1, t2, g2);
                t2 = inner(lo, hi).1;
                g2 = self.try_point(at(t2));
            }
        }
    }
}
