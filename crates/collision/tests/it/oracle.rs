//! The plain check that the quick one is held against: every pair, exact shapes, parry alone.
//!
//! Nothing of the checker's own geometry, kinematics or tables is used: links are placed by
//! [`Posture`], the ground is a triangle mesh, and which pairs count is written out here.

use std::sync::Arc;

use collision::{Allowance, ContactZone, Keep, Obstacle, Scene};
use nalgebra::{Isometry3, Point2, Point3, UnitQuaternion, Vector2, Vector3};
use parry3d_f64::math::{Pose, Vector};
use parry3d_f64::query::{ClosestPoints, Ray, RayCast, closest_points, contact};
use parry3d_f64::shape::{SharedShape, TriMesh};
use rover::{LegAngles, LegId, LinkId, Posture, Robot, Shape};
use terrain::ElevationMap;

/// How far off parry's own distances of curved shapes may be (m).
pub const PARRYS: f64 = 3e-5;

/// No pair of links has to keep more (m); quick for most pairs.
const MOST_REQUIRED: f64 = 0.2;

/// An obstacle with the convex solids that it is made of.
#[derive(Clone)]
pub struct Thing {
    pub obstacle: Obstacle,
    pub solids: Vec<(Isometry3<f64>, SharedShape)>,
}

/// All that surrounds the robot, for the checker and for the oracle.
#[derive(Clone)]
pub struct World {
    pub scene: Scene,
    pub things: Vec<Thing>,
    ground: Arc<TriMesh>,
}

impl World {
    pub fn new(robot: Arc<Robot>, map: ElevationMap, things: Vec<Thing>) -> World {
        let obstacles: Vec<Obstacle> = things.iter().map(|t| t.obstacle.clone()).collect();
        let ground = Arc::new(mesh_of(&map));
        World { scene: Scene::new(robot, map, &obstacles).unwrap(), things, ground }
    }

    pub fn robot(&self) -> &Arc<Robot> {
        self.scene.robot()
    }
}

/// The known ground: each square is cut from its corner at +x to its corner at +y.
fn mesh_of(map: &ElevationMap) -> TriMesh {
    let (grid, heights) = (map.grid(), map.heights());
    let mut points = Vec::new();
    for iy in 0..grid.ny {
        for ix in 0..grid.nx {
            let (p, z) = (grid.position(ix, iy), f64::from(*heights.at(ix, iy)));
            points.push(Vector::new(p.x, p.y, if z.is_finite() { z } else { 0.0 }));
        }
    }
    let mut triangles = Vec::new();
    for iy in 0..grid.ny - 1 {
        for ix in 0..grid.nx - 1 {
            let node = |dx: usize, dy: usize| (grid.index(ix + dx, iy + dy)) as u32;
            let (right, up) = (node(1, 0), node(0, 1));
            for triangle in [[node(0, 0), right, up], [node(1, 1), up, right]] {
                if triangle.iter().all(|i| heights.values()[*i as usize].is_finite()) {
                    triangles.push(triangle);
                }
            }
        }
    }
    TriMesh::new(points, triangles).unwrap()
}

/// A shape of a link.
struct Piece {
    link: LinkId,
    /// Leg and place from the hip; none for the chassis.
    body: Option<(LegId, usize)>,
    is_wheel: bool,
    link_from_piece: Isometry3<f64>,
    shape: SharedShape,
    /// Radius about the shape's own origin.
    bound: f64,
}

/// What is known of unknown ground below the robot.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Unknown {
    /// None within the clearances.
    No,
    /// Near, but not surely below it.
    Perhaps,
    /// Below it, or beside the map.
    Surely,
}

/// What the leg is near to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum What {
    Nothing,
    Ground,
    Thing(usize),
    Link(LinkId),
}

/// Least distance less what must be kept.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Found {
    /// Negative where nearer than allowed, by the depth where things overlap (m).
    pub spare: f64,
    pub between: (LinkId, What),
    pub unknown: Unknown,
}

pub struct Oracle<'w> {
    world: &'w World,
    leg: LegId,
    keep: Keep,
    moving: Vec<Piece>,
    fixed: Vec<(Piece, Isometry3<f64>)>,
    posture: Posture,
    /// How far any point of the leg can get when one joint turns by 1 rad, by joint (m).
    pub levers: LegAngles,
}

impl<'w> Oracle<'w> {
    pub fn new(world: &'w World, posture: &Posture, leg: LegId, keep: Keep) -> Oracle<'w> {
        let robot = world.robot();
        let (mut moving, mut fixed) = (Vec::new(), Vec::new());
        for piece in pieces_of(robot) {
            if piece.body.is_some_and(|(l, _)| l == leg) {
                moving.push(piece);
            } else {
                let at = posture.link(piece.link) * piece.link_from_piece;
                fixed.push((piece, at));
            }
        }
        let levers = levers(robot, leg, &moving);
        Oracle { world, leg, keep, moving, fixed, posture: posture.clone(), levers }
    }

    /// What is nearest beyond its clearance, up to `horizon` (m) of it.
    pub fn look(&self, angles: &LegAngles, allowance: Allowance, horizon: f64) -> Found {
        let robot = self.world.robot();
        let mut posture = self.posture.clone();
        posture.move_leg(robot, self.leg, angles);
        let at: Vec<Isometry3<f64>> =
            self.moving.iter().map(|p| posture.link(p.link) * p.link_from_piece).collect();
        let wheel = posture.wheel(robot, self.leg).center();
        let nothing = (robot.leg(self.leg).wheel_link, What::Nothing);
        let mut found = Found { spare: horizon, between: nothing, unknown: Unknown::No };
        for (i, piece) in self.moving.iter().enumerate() {
            self.look_at_environment(piece, &at[i], &wheel, allowance, &mut found);
            let own = self.moving.iter().zip(&at).skip(i + 1);
            for (other, other_at) in own.chain(self.fixed.iter().map(|(p, at)| (p, at))) {
                let between = (at[i].translation.vector - other_at.translation.vector).norm();
                let gap = between - piece.bound - other.bound;
                if gap >= MOST_REQUIRED + found.spare {
                    continue;
                }
                let Some(required) = self.pair_required(piece, other) else { continue };
                let limit = required + found.spare;
                if gap >= limit {
                    continue;
                }
                let signed =
                    signed_distance((&at[i], &piece.shape), (other_at, &other.shape), limit);
                found.meet(signed - required, (piece.link, What::Link(other.link)));
            }
        }
        found
    }

    fn look_at_environment(
        &self,
        piece: &Piece,
        at: &Isometry3<f64>,
        wheel: &Point3<f64>,
        allowance: Allowance,
        found: &mut Found,
    ) {
        let is_foot = piece.body.is_some_and(|(_, place)| place == 5);
        let zone = allowance.zone.filter(|zone| is_foot && in_zone(wheel, zone));
        let own = self.world.robot().tolerances().environment;
        let environment = self.keep.environment.unwrap_or(own) + self.keep.inflation;
        let raised = if allowance.buffered { self.keep.terrain_lift } else { 0.0 };
        // One of these must hold: the clearance, and by how much the ground is raised.
        let mut rules = vec![(environment, raised)];
        let radius = self.world.robot().stance().contact_radius;
        let over = |p: &Point2<f64>| (wheel.xy() - p).norm() <= radius;
        let at_home = is_foot && self.keep.footfalls.iter().any(over);
        if at_home {
            rules.push((environment, 0.0));
        }
        if let Some(zone) = zone {
            let sunk = if piece.is_wheel { -1.25 * zone.ground_tolerance } else { 0.0 };
            rules.push((0.0, sunk));
        }
        let best = |&(required, lift): &(f64, f64)| {
            let mut lowered = *at;
            lowered.translation.vector.z -= lift;
            self.ground_distance(piece, &lowered, required + found.spare) - required
        };
        let spare = rules.iter().map(best).fold(f64::NEG_INFINITY, f64::max);
        found.meet(spare, (piece.link, What::Ground));
        found.unknown = found.unknown.max(self.unknown_below(piece, at, environment));

        let buffer = if allowance.buffered && !at_home { self.keep.obstacle_buffer } else { 0.0 };
        let required = if zone.is_some() { 0.0 } else { environment + buffer };
        for (index, thing) in self.world.things.iter().enumerate() {
            for (pose, shape) in &thing.solids {
                let limit = required + found.spare;
                let sphere = shape.compute_bounding_sphere(&Pose::from(*pose));
                let center = at.translation.vector;
                let between = (Vector::new(center.x, center.y, center.z) - sphere.center).length();
                if between - piece.bound - sphere.radius >= limit {
                    continue;
                }
                let signed = signed_distance((at, &piece.shape), (pose, shape), limit);
                found.meet(signed - required, (piece.link, What::Thing(index)));
            }
        }
    }

    /// Signed distance from the solid ground (m), `limit` if greater: far below is -1.
    fn ground_distance(&self, piece: &Piece, at: &Isometry3<f64>, limit: f64) -> f64 {
        let center = at.translation.vector;
        let up = Ray::new(Vector::new(center.x, center.y, center.z), Vector::new(0.0, 0.0, 1.0));
        let ground = &*self.world.ground;
        if ground.intersects_ray(&Pose::IDENTITY, &up, 1e3) {
            return -1.0;
        }
        let still = Isometry3::identity();
        signed_distance_of(&(at, &*piece.shape.0), &(&still, ground), limit)
    }

    /// Is unknown ground, or the map's edge, below the piece: surely if below a point of it; not if
    /// nowhere within `beside` (m) of it.
    fn unknown_below(&self, piece: &Piece, at: &Isometry3<f64>, beside: f64) -> Unknown {
        let map = self.world.scene.map();
        let (grid, far) = (map.grid(), map.grid().far_corner());
        let aabb = piece.shape.compute_aabb(&Pose::from(*at));
        let (lo, hi) =
            (Point2::new(aabb.mins.x, aabb.mins.y), Point2::new(aabb.maxs.x, aabb.maxs.y));
        let beyond = |by: f64| {
            lo.x - by < grid.origin.x
                || lo.y - by < grid.origin.y
                || hi.x + by > far.x
                || hi.y + by > far.y
        };
        let rounding = 1e-6;
        if beyond(-rounding) {
            return Unknown::Surely;
        }
        let mut unknown = if beyond(beside + rounding) { Unknown::Perhaps } else { Unknown::No };
        if map.holes().is_none() {
            return unknown;
        }
        let beside = Vector2::repeat(beside + rounding + grid.resolution);
        let (xs, ys) = grid.nodes_within(lo - beside, hi + beside);
        let hole = |(ix, iy): (usize, usize)| !map.heights().at(ix, iy).is_finite();
        if ys.flat_map(|iy| xs.clone().map(move |ix| (ix, iy))).any(hole) {
            unknown = Unknown::Perhaps;
        }
        let center: Point3<f64> = at.translation.vector.into();
        if map.height_at(center.xy()).is_none() {
            return Unknown::Surely;
        }
        unknown
    }

    fn pair_required(&self, a: &Piece, b: &Piece) -> Option<f64> {
        let t = self.world.robot().tolerances();
        let required = match (a.body, b.body) {
            (None, None) => None,
            // The chassis: not against the hip that it carries, little against the thigh, much
            // against wheel and fork.
            (None, Some((_, place))) | (Some((_, place)), None) => {
                [None, Some(t.base_thigh), Some(t.pair), Some(t.pair), Some(t.pair)]
                    .get(place)
                    .copied()
                    .unwrap_or(Some(t.base_wheel))
            }
            (Some((leg, _)), Some((other, _))) if leg != other => Some(t.leg_leg),
            // Of one leg only those with two or more bodies between them.
            (Some((_, 0)), Some((_, 3..=5))) | (Some((_, 3..=5)), Some((_, 0))) => {
                Some(t.within_leg)
            }
            (Some((_, 1)), Some((_, 4 | 5))) | (Some((_, 4 | 5)), Some((_, 1))) => {
                Some(t.within_leg)
            }
            (Some((_, 2)), Some((_, 5))) | (Some((_, 5)), Some((_, 2))) => Some(t.within_leg),
            _ => None,
        };
        let required =
            required.map(|required| self.keep.pairs.unwrap_or(required) + self.keep.inflation);
        assert!(required <= Some(MOST_REQUIRED));
        required
    }

    /// Least spare over the joint-linear motion from `a` to `b` looked at every 0.0005 rad, and where
    /// it is (share of the way).
    ///
    /// It ends where something surely touches. Steps on which nothing can come nearer than what has
    /// been found, by how far the leg can get meanwhile, are passed over; not so where the rules
    /// change on the way.
    pub fn least_on_the_way(
        &self,
        a: &LegAngles,
        b: &LegAngles,
        allowance: Allowance,
        horizon: f64,
    ) -> (f64, Found) {
        let way = (b - a).abs();
        let n = (way.max() / 5e-4).ceil().max(1.0);
        let changing =
            allowance.zone.is_some() || (allowance.buffered && !self.keep.footfalls.is_empty());
        let holes = self.world.scene.map().holes().is_some();
        let step = self.levers.dot(&way) / n;
        let mut least: Option<(f64, Found)> = None;
        let mut unknown = Unknown::No;
        let mut i = 0.0;
        while i <= n {
            let share: f64 = i / n;
            let found = self.look(&(a * (1.0 - share) + b * share), allowance, horizon);
            unknown = unknown.max(found.unknown);
            if least.is_none_or(|(_, l)| found.spare < l.spare) {
                least = Some((share, found));
            }
            if found.spare < -PARRYS {
                break; // it touches, no matter how deep
            }
            let to_beat = least.map_or(0.0, |(_, l)| l.spare);
            let free = ((found.spare - to_beat) / step).floor();
            let sure = changing || holes || found.unknown > Unknown::No || !free.is_finite();
            let skip = if sure { 1.0 } else { free.max(1.0) };
            i = if i < n { (i + skip).min(n) } else { n + 1.0 };
        }
        let (share, mut found) = least.unwrap();
        found.unknown = unknown;
        (share, found)
    }
}

impl Found {
    fn meet(&mut self, spare: f64, between: (LinkId, What)) {
        if spare < self.spare {
            self.spare = spare;
            self.between = between;
        }
    }
}

fn in_zone(wheel: &Point3<f64>, zone: &ContactZone) -> bool {
    (wheel.xy() - zone.center.xy()).norm() <= zone.radius && wheel.z - zone.center.z <= zone.height
}

fn pieces_of(robot: &Robot) -> Vec<Piece> {
    // parry's cylinders and capsules stand along y, the robot's along z.
    let upright = UnitQuaternion::rotation_between(&Vector3::y(), &Vector3::z()).unwrap();
    let mut pieces = Vec::new();
    for (i, link) in robot.links().iter().enumerate() {
        let id = LinkId(i);
        let name = |leg: LegId| &robot.leg(leg).name;
        // By name: "leg3_..." is of leg 3.
        let leg = robot.leg_ids().find(|leg| link.name.starts_with(&format!("{}_", name(*leg))));
        let order =
            ["hip_yaw", "hip_pitch", "knee_pitch", "knee_roll", "ankle_pitch", "ankle_roll"];
        let body = leg.map(|leg| {
            let place = order.iter().position(|joint| link.name.contains(joint));
            (leg, place.unwrap_or(5))
        });
        for placed in &link.shapes {
            let (shape, turn) = match placed.shape {
                Shape::Box { half_extents: h } => {
                    (SharedShape::cuboid(h.x, h.y, h.z), UnitQuaternion::identity())
                }
                Shape::Cylinder { radius, half_length } => {
                    (SharedShape::cylinder(half_length, radius), upright)
                }
                Shape::Capsule { radius, half_length } => {
                    (SharedShape::capsule_y(half_length, radius), upright)
                }
                Shape::Sphere { radius } => (SharedShape::ball(radius), UnitQuaternion::identity()),
                Shape::Mesh(_) => panic!("the robot of these tests has no meshes"),
            };
            let sphere = shape.compute_local_bounding_sphere();
            pieces.push(Piece {
                link: id,
                body,
                is_wheel: link.name.ends_with("wheel_link"),
                link_from_piece: placed.link_from_shape * turn,
                bound: sphere.center.length() + sphere.radius,
                shape,
            });
        }
    }
    pieces
}

/// The stretched leg from each joint on, its shapes' farthest point included.
fn levers(robot: &Robot, leg: LegId, moving: &[Piece]) -> LegAngles {
    let model = robot.leg(leg);
    let wheel = model.wheel.carrier_from_wheel.translation.vector.norm();
    let extent = |place: usize| {
        let of_place = moving.iter().filter(|p| p.body.is_some_and(|(_, at)| at == place));
        let own = of_place.map(|p| {
            let offset = if p.is_wheel { wheel } else { 0.0 };
            offset + p.link_from_piece.translation.vector.norm() + p.bound
        });
        own.fold(0.0, f64::max)
    };
    let mut beyond = 0.0_f64;
    let mut levers = LegAngles::zeros();
    for place in (0..6).rev() {
        beyond = beyond.max(extent(place));
        levers[place] = beyond;
        beyond += robot.joints()[model.joints[place]].parent_from_joint.translation.vector.norm();
    }
    levers
}

fn signed_distance(
    (at, shape): (&Isometry3<f64>, &SharedShape),
    (other_at, other): (&Isometry3<f64>, &SharedShape),
    limit: f64,
) -> f64 {
    signed_distance_of(&(at, &*shape.0), &(other_at, &*other.0), limit)
}

/// Distance of two shapes, `limit` if greater; where they overlap, how deep (negative, as far as
/// parry knows it, else zero).
fn signed_distance_of(
    (at, shape): &(&Isometry3<f64>, &dyn parry3d_f64::shape::Shape),
    (other_at, other): &(&Isometry3<f64>, &dyn parry3d_f64::shape::Shape),
    limit: f64,
) -> f64 {
    let [pose, other_pose] = [at, other_at].map(|at| Pose::from(**at));
    match closest_points(&pose, *shape, &other_pose, *other, limit.max(0.0)) {
        Ok(ClosestPoints::Disjoint) => limit,
        Ok(ClosestPoints::WithinMargin(p, q)) => (q - p).length().min(limit),
        Ok(ClosestPoints::Intersecting) => {
            // parry's depth fails now and then in one order of the two, seldom in both.
            let depth = contact(&pose, *shape, &other_pose, *other, 0.0);
            let depth = depth.ok().flatten();
            let other_way = || contact(&other_pose, *other, &pose, *shape, 0.0).ok().flatten();
            depth.or_else(other_way).map_or(0.0, |contact| contact.dist.min(0.0))
        }
        Err(_) => panic!("parry knows these shapes"),
    }
}
