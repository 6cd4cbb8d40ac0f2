//! One moving leg against the ground, the obstacles and the rest of the robot.

use nalgebra::{Isometry3, Point2, Point3};
use parry3d_f64::math::Pose;
use parry3d_f64::shape::Triangle;
use rover::{LegId, LinkId, Posture};

use crate::pairs::{Body, pair_tolerance};
use crate::scene::{Scene, Solid, aabb_of};
use crate::solid::{Near, Part, near, to_parry_point, to_pose};
use crate::wheel::{BEYOND_CONTACT, wheel_ground};

/// What touches what.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Touch {
    /// Two links of the robot.
    Links(LinkId, LinkId),
    /// A link and the ground.
    Ground(LinkId),
    /// A link and an obstacle, by its index.
    Obstacle(LinkId, usize),
    /// A link over ground that nobody has seen, or outside the map.
    UnknownGround(LinkId),
}

/// Two things nearer than they may be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Violation {
    /// What touches what.
    pub touch: Touch,
    /// Distance (m), zero where they overlap.
    pub distance: f64,
    /// Distance that must be kept (m).
    pub required: f64,
    /// Where, in `world`.
    pub place: Point3<f64>,
}

/// Where the moving wheel may touch the ground: about its start or its goal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactZone {
    /// The point of contact when the wheel stands.
    pub contact: Point3<f64>,
    /// Center of the wheel when it stands.
    pub center: Point3<f64>,
    /// Horizontal radius within which ground may be touched (m).
    pub radius: f64,
    /// The zone ends when the wheel is higher than this above where it stands (m).
    pub height: f64,
    /// How deep a standing wheel may be in the ground (m).
    pub ground_tolerance: f64,
}

/// Nearest distances of the moving leg.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Clearance {
    /// To another link, less what that pair must keep (m); the pair and the plain distance.
    pub links: Option<Violation>,
    /// To ground or obstacles; touching inside a contact zone does not count.
    pub environment: Option<Violation>,
}

/// One leg that moves while the rest of the robot stands: the rest is placed once.
pub struct LegChecker<'a> {
    scene: &'a Scene,
    leg: LegId,
    moving: Vec<&'a Part>,
    fixed: Vec<Placed<'a>>,
    environment_tolerance: f64,
    pair_tolerance: Option<f64>,
}

struct Placed<'a> {
    part: &'a Part,
    pose: Pose,
    center: Point3<f64>,
}

impl<'a> Placed<'a> {
    fn new(part: &'a Part, posture: &Posture) -> Placed<'a> {
        let world_from_part: Isometry3<f64> = posture.link(part.link) * part.link_from_part;
        Placed {
            part,
            pose: to_pose(&world_from_part),
            center: world_from_part.translation.vector.into(),
        }
    }
}

impl<'a> LegChecker<'a> {
    /// Prepares checks of `leg` in `scene` with the rest of the robot as in `posture`.
    ///
    /// `environment` and `pairs` (m) override the robot's own tolerances.
    pub fn new(
        scene: &'a Scene,
        posture: &Posture,
        leg: LegId,
        environment: Option<f64>,
        pairs: Option<f64>,
    ) -> LegChecker<'a> {
        let moves = |part: &&Part| matches!(part.body, Body::Leg { leg: l, .. } if l == leg);
        let (moving, fixed): (Vec<&Part>, Vec<&Part>) = scene.parts.iter().partition(moves);
        LegChecker {
            scene,
            leg,
            moving,
            fixed: fixed.into_iter().map(|part| Placed::new(part, posture)).collect(),
            environment_tolerance: environment.unwrap_or(scene.robot().tolerances().environment),
            pair_tolerance: pairs,
        }
    }

    /// The moving leg.
    pub fn leg(&self) -> LegId {
        self.leg
    }

    /// The first thing nearer than it may be with the leg as in `posture`; `None` if all is free.
    pub fn violation(&self, posture: &Posture, zone: Option<&ContactZone>) -> Option<Violation> {
        self.scan(posture, zone, |required| required, true).into_iter().next()
    }

    /// As [`violation`](Self::violation), but only what overlaps: distance zero.
    pub fn collision(&self, posture: &Posture, zone: Option<&ContactZone>) -> Option<Violation> {
        self.scan(posture, zone, |_| 1e-9, true).into_iter().next()
    }

    /// Nearest distances within `reach` (m) beyond the tolerances.
    pub fn clearance(
        &self,
        posture: &Posture,
        zone: Option<&ContactZone>,
        reach: f64,
    ) -> Clearance {
        let all = self.scan(posture, zone, |required| required + reach, false);
        let spare = |v: &Violation| v.distance - v.required;
        let least = |links: bool| {
            all.iter()
                .filter(|v| matches!(v.touch, Touch::Links(..)) == links)
                .min_by(|a, b| spare(a).total_cmp(&spare(b)))
                .copied()
        };
        Clearance { links: least(true), environment: least(false) }
    }

    /// All pairs nearer than `limit(required)`, the first one only where `first` is set.
    fn scan(
        &self,
        posture: &Posture,
        zone: Option<&ContactZone>,
        limit: impl Fn(f64) -> f64,
        first: bool,
    ) -> Vec<Violation> {
        let moving: Vec<Placed> =
            self.moving.iter().map(|part| Placed::new(part, posture)).collect();
        let wheel = posture.wheel(self.scene.robot(), self.leg);
        let center = wheel.center();
        let zone = zone.filter(|z| {
            (center.xy() - z.center.xy()).norm() <= z.radius && center.z <= z.center.z + z.height
        });
        let mut found = Vec::new();
        // From the wheel inward: the wheel meets things first.
        for (i, placed) in moving.iter().enumerate().rev() {
            let in_zone = zone.filter(|_| placed.part.body.is_outermost(self.scene.robot()));
            let required = if in_zone.is_some() { 0.0 } else { self.environment_tolerance };
            match in_zone {
                Some(zone) if placed.part.is_wheel => {
                    found.extend(wheel_in_zone(self.scene, &wheel, placed.part.link, zone));
                }
                _ => {
                    let reach = limit(required).max(1e-9);
                    found.extend(self.ground(placed, required, reach));
                }
            }
            for (index, solid) in self.scene.solids.iter().enumerate() {
                let reach = limit(required).max(1e-9);
                if let Some(near) = near_solid(placed, solid, reach) {
                    let touch = Touch::Obstacle(placed.part.link, index);
                    found.push(violation(touch, near, required));
                }
            }
            if first && !found.is_empty() {
                return found;
            }
            for other in self.fixed.iter().chain(&moving[..i]) {
                found.extend(self.pair(placed, other, &limit));
                if first && !found.is_empty() {
                    return found;
                }
            }
        }
        found
    }

    fn pair(&self, a: &Placed, b: &Placed, limit: &impl Fn(f64) -> f64) -> Option<Violation> {
        let required = pair_tolerance(self.scene.robot(), a.part.body, b.part.body)?;
        let required = self.pair_tolerance.unwrap_or(required);
        let reach = limit(required).max(1e-9);
        let apart = (a.center - b.center).norm() - a.part.radius - b.part.radius;
        if apart >= reach {
            return None;
        }
        let near = near(&a.pose, &*a.part.shape.0, &b.pose, &*b.part.shape.0, reach)?;
        Some(violation(Touch::Links(a.part.link, b.part.link), near, required))
    }

    fn ground(&self, placed: &Placed, required: f64, reach: f64) -> Option<Violation> {
        match near_ground(self.scene, placed.part, &placed.pose, &placed.center, reach) {
            GroundNear::Clear => None,
            GroundNear::Unknown(place) => Some(Violation {
                touch: Touch::UnknownGround(placed.part.link),
                distance: 0.0,
                required,
                place,
            }),
            GroundNear::Near(near) => {
                Some(violation(Touch::Ground(placed.part.link), near, required))
            }
        }
    }
}

fn violation(touch: Touch, near: Near, required: f64) -> Violation {
    Violation { touch, distance: near.distance, required, place: near.place }
}

/// Inside its contact zone the wheel may touch within the zone's radius, as deep as a standing
/// wheel may be; elsewhere it must be clear of the ground.
fn wheel_in_zone(
    scene: &Scene,
    wheel: &rover::WheelPose,
    link: LinkId,
    zone: &ContactZone,
) -> Option<Violation> {
    let inside = |p: Point2<f64>| (p - zone.contact.xy()).norm() <= zone.radius;
    let near = wheel_ground(wheel, scene.map(), inside);
    let far = wheel_ground(wheel, scene.map(), |p| !inside(p));
    let center = wheel.center();
    if near.unknown || far.unknown {
        let touch = Touch::UnknownGround(link);
        return Some(Violation { touch, distance: 0.0, required: 0.0, place: center });
    }
    let deep = near.nearest.filter(|g| g.gap < -zone.ground_tolerance);
    let beyond = far.nearest.filter(|g| g.gap < -BEYOND_CONTACT * zone.ground_tolerance);
    deep.or(beyond).map(|gap| Violation {
        touch: Touch::Ground(link),
        distance: 0.0,
        required: 0.0,
        place: gap.ground,
    })
}

pub(crate) enum GroundNear {
    /// Farther than asked.
    Clear,
    /// Over ground that nobody has seen, at this place.
    Unknown(Point3<f64>),
    /// Nearer than asked.
    Near(Near),
}

/// The distance of a part from the solid ground, if less than `reach` (m).
pub(crate) fn near_ground(
    scene: &Scene,
    part: &Part,
    pose: &Pose,
    center: &Point3<f64>,
    reach: f64,
) -> GroundNear {
    let map = scene.map();
    let grid = map.grid();
    let aabb = part.shape.compute_aabb(pose);
    let min = Point2::new(aabb.mins.x - reach, aabb.mins.y - reach);
    let max = Point2::new(aabb.maxs.x + reach, aabb.maxs.y + reach);
    let far = grid.far_corner();
    let outside = aabb.mins.x < grid.origin.x
        || aabb.mins.y < grid.origin.y
        || aabb.maxs.x > far.x
        || aabb.maxs.y > far.y;
    if outside || over_a_hole(scene, min, max) {
        return GroundNear::Unknown(*center);
    }
    if map.max_over(min, max) < aabb.mins.z - reach {
        return GroundNear::Clear;
    }
    if map.height_at(center.xy()).is_some_and(|ground| ground >= center.z) {
        return GroundNear::Near(Near { distance: 0.0, place: *center });
    }
    let mut nearest: Option<Near> = None;
    let mut limit = reach;
    let world = Pose::IDENTITY;
    for_each_triangle(map, min, max, |corners| {
        let top = corners[0].z.max(corners[1].z).max(corners[2].z);
        if top < aabb.mins.z - limit {
            return true;
        }
        let [a, b, c] = corners.map(|p| to_parry_point(&p));
        let triangle = Triangle::new(a, b, c);
        if let Some(hit) = near(pose, &*part.shape.0, &world, &triangle, limit) {
            limit = hit.distance;
            nearest = Some(hit);
        }
        limit > 0.0
    });
    nearest.map_or(GroundNear::Clear, GroundNear::Near)
}

/// Does the rectangle touch a square of the map with an unknown corner? The pyramid is quick but
/// sees farther than the rectangle, so its yes is looked at node by node.
fn over_a_hole(scene: &Scene, min: Point2<f64>, max: Point2<f64>) -> bool {
    if !scene.holes.as_ref().is_some_and(|holes| holes.max_over(min, max) > 0.0) {
        return false;
    }
    let heights = scene.map().heights();
    let pad = nalgebra::Vector2::repeat(heights.grid().resolution);
    let (xs, ys) = heights.grid().nodes_within(min - pad, max + pad);
    ys.into_iter().any(|iy| xs.clone().any(|ix| heights.at(ix, iy).is_nan()))
}

/// Calls `visit` with each known triangle of the squares that the rectangle touches, until it
/// answers false.
fn for_each_triangle(
    map: &terrain::ElevationMap,
    min: Point2<f64>,
    max: Point2<f64>,
    mut visit: impl FnMut([Point3<f64>; 3]) -> bool,
) {
    let grid = map.grid();
    let pad = grid.resolution;
    let (xs, ys) = grid
        .nodes_within(Point2::new(min.x - pad, min.y - pad), Point2::new(max.x + pad, max.y + pad));
    let node = |ix: usize, iy: usize| {
        let p = grid.position(ix, iy);
        Point3::new(p.x, p.y, f64::from(*map.heights().at(ix, iy)))
    };
    for iy in ys.start..ys.end.saturating_sub(1) {
        for ix in xs.start..xs.end.saturating_sub(1) {
            let (b, c) = (node(ix + 1, iy), node(ix, iy + 1));
            for a in [node(ix, iy), node(ix + 1, iy + 1)] {
                let known = a.z.is_finite() && b.z.is_finite() && c.z.is_finite();
                if known && !visit([a, b, c]) {
                    return;
                }
            }
        }
    }
}

fn near_solid(placed: &Placed, solid: &Solid, reach: f64) -> Option<Near> {
    let pose = to_pose(&solid.world_from_solid);
    let (lo, hi) = aabb_of(&solid.shape, &solid.world_from_solid);
    let c = placed.center;
    let r = placed.part.radius + reach;
    let apart = (0..3).any(|i| c[i] + r < lo[i] || c[i] - r > hi[i]);
    if apart {
        return None;
    }
    // A mesh is a surface to parry: a part wholly inside it would touch nothing.
    if solid.mesh && solid.shape.contains_point(&pose, to_parry_point(&c)) {
        return Some(Near { distance: 0.0, place: c });
    }
    near(&placed.pose, &*placed.part.shape.0, &pose, &*solid.shape.0, reach)
}

/// As the checker does it, for a part of any body: used by the survey.
pub(crate) fn environment_of(
    scene: &Scene,
    part: &Part,
    posture: &Posture,
    reach: f64,
) -> Vec<(Touch, Near)> {
    let placed = Placed::new(part, posture);
    let mut found = Vec::new();
    if let GroundNear::Near(near) = near_ground(scene, part, &placed.pose, &placed.center, reach) {
        found.push((Touch::Ground(part.link), near));
    }
    for (index, solid) in scene.solids.iter().enumerate() {
        if let Some(near) = near_solid(&placed, solid, reach) {
            found.push((Touch::Obstacle(part.link, index), near));
        }
    }
    found
}

/// The distance of two parts if less than `reach` (m).
pub(crate) fn parts_near(a: &Part, b: &Part, posture: &Posture, reach: f64) -> Option<Near> {
    let (a, b) = (Placed::new(a, posture), Placed::new(b, posture));
    let apart = (a.center - b.center).norm() - a.part.radius - b.part.radius;
    if apart >= reach {
        return None;
    }
    near(&a.pose, &*a.part.shape.0, &b.pose, &*b.part.shape.0, reach)
}
