//! The whole robot in one posture: what overlaps, what is nearer than its tolerance.

use std::collections::BTreeMap;

use nalgebra::{Point3, Unit, Vector3};
use rover::{Frame, LegId, LinkId, Posture};

use crate::checker::Touch;
use crate::form::{Placed, apart};
use crate::ground::{GroundNear, Kernel, near_ground};
use crate::look::near_solid;
use crate::pairs::pair_tolerance;
use crate::scene::Scene;
use crate::solid::{Near, Part, near, pose_of};
use crate::wheel::{BEYOND_CONTACT, PATCH_WIDTHS, WheelGround, contact_center, wheel_ground};

/// Two things and their distance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PairDistance {
    /// What is near what.
    pub touch: Touch,
    /// Distance (m), zero where they overlap.
    pub distance: f64,
    /// Distance that planned motion keeps (m).
    pub tolerance: f64,
}

/// A posture looked at from all sides.
#[derive(Debug, Clone, PartialEq)]
pub struct Survey {
    /// Pairs of links nearer than their tolerance, nearest first (one entry a pair of links).
    pub links: Vec<PairDistance>,
    /// Links nearer to ground or obstacles than the tolerance, nearest first; a standing wheel's
    /// touch within its contact radius does not count.
    pub environment: Vec<PairDistance>,
    /// Each leg's wheel over the ground.
    pub wheels: Vec<WheelGround>,
    /// Which wheels stand: within the ground tolerance of the ground.
    pub standing: Vec<LegId>,
}

/// What is nearer than its tolerance already may come nearer by a tenth while the body is shifted.
const AS_NEAR: f64 = 0.9;

impl Survey {
    /// The clearance (m) that a shift of the body from this posture keeps: `tolerance`, or less where
    /// the two are nearer than that already.
    pub fn kept(&self, touch: Touch, tolerance: f64) -> f64 {
        let pairs = self.links.iter().chain(&self.environment);
        let before = pairs.filter(|pair| pair.touch == touch).map(|pair| AS_NEAR * pair.distance);
        before.fold(tolerance, f64::min)
    }

    /// The pair of links that overlaps, if any.
    pub fn self_collision(&self) -> Option<&PairDistance> {
        self.links.first().filter(|pair| pair.distance <= 0.0)
    }

    /// The link that overlaps ground or an obstacle, if any.
    pub fn terrain_collision(&self) -> Option<&PairDistance> {
        self.environment.first().filter(|pair| pair.distance <= 0.0)
    }

    /// The standing legs with their points of contact in `world` (m).
    pub fn contacts(&self, scene: &Scene, posture: &Posture) -> Vec<(LegId, Point3<f64>)> {
        let contact = |leg: &LegId| {
            let gap = self.wheels[leg.0].nearest?;
            let wheel = posture.wheel(scene.robot(), *leg);
            Some((*leg, contact_center(&wheel, scene.map(), &gap)))
        };
        self.standing.iter().filter_map(contact).collect()
    }
}

/// The ground's normal under a foot that touches at `p` (m): that of the plane of the patch about
/// it; up where too little is known.
pub fn ground_normal(scene: &Scene, leg: LegId, p: &Point3<f64>) -> Unit<Vector3<f64>> {
    let width = PATCH_WIDTHS * scene.robot().leg(leg).wheel.width;
    let plane = scene.map().footprint_plane(p.xy(), width).map(|plane| plane.normal);
    plane.or_else(|| scene.map().normal_at(p.xy())).unwrap_or(Vector3::z_axis())
}

/// Looks at the whole robot in one posture. Unknown ground hides what lies below it: it is not a
/// collision here, and the wheels over it say so.
pub fn survey(scene: &Scene, posture: &Posture) -> Survey {
    let robot = scene.robot();
    let rules = robot.stance();
    let wheels: Vec<WheelGround> = robot
        .leg_ids()
        .map(|leg| wheel_ground(&posture.wheel(robot, leg), scene.map(), |_| true))
        .collect();
    let standing: Vec<LegId> = robot
        .leg_ids()
        .filter(|leg| wheels[leg.0].nearest.is_some_and(|g| g.gap.abs() <= rules.ground_tolerance))
        .collect();

    let placed: Vec<Placed> = scene
        .parts
        .iter()
        .map(|part| {
            let frame = Frame::from(&(posture.link(part.link) * part.link_from_part));
            Placed::new(frame, &part.core)
        })
        .collect();
    let mut links: BTreeMap<(LinkId, LinkId), PairDistance> = BTreeMap::new();
    for (i, a) in scene.parts.iter().enumerate() {
        for (j, b) in scene.parts.iter().enumerate().skip(i + 1) {
            let Some(tolerance) = pair_tolerance(robot, a.body, b.body) else { continue };
            let reach = tolerance.max(1e-9);
            let Some(near) = parts_near([a, b], [&placed[i], &placed[j]], reach) else { continue };
            let touch = Touch::Links(a.link, b.link);
            let entry = PairDistance { touch, distance: near.distance, tolerance };
            links
                .entry((a.link, b.link))
                .and_modify(|e| e.distance = e.distance.min(near.distance))
                .or_insert(entry);
        }
    }

    let tolerance = robot.tolerances().environment;
    let mut environment = Vec::new();
    for (part, placed) in scene.parts.iter().zip(&placed) {
        let leg = robot.leg_ids().find(|leg| robot.leg(*leg).wheel_link == part.link);
        let stands = leg.filter(|leg| standing.contains(leg));
        for (touch, near) in environment_of(scene, part, placed, tolerance.max(1e-9)) {
            if let (Some(leg), Touch::Ground(_), true) = (stands, touch, part.is_wheel) {
                if !touches_beyond_contact(scene, posture, leg, &wheels[leg.0]) {
                    continue;
                }
                environment.push(PairDistance { touch, distance: 0.0, tolerance });
                continue;
            }
            environment.push(PairDistance { touch, distance: near.distance, tolerance });
        }
    }
    let mut links: Vec<PairDistance> = links.into_values().collect();
    links.sort_by(|a, b| a.distance.total_cmp(&b.distance));
    environment.sort_by(|a, b| a.distance.total_cmp(&b.distance));
    Survey { links, environment, wheels, standing }
}

/// A standing wheel touches only around its contact; elsewhere it must be clear of the ground.
fn touches_beyond_contact(
    scene: &Scene,
    posture: &Posture,
    leg: LegId,
    ground: &WheelGround,
) -> bool {
    let Some(gap) = ground.nearest else { return false };
    let rules = scene.robot().stance();
    let wheel = posture.wheel(scene.robot(), leg);
    let contact = contact_center(&wheel, scene.map(), &gap);
    let far = |p: nalgebra::Point2<f64>| (p - contact.xy()).norm() > rules.contact_radius;
    let beyond = wheel_ground(&wheel, scene.map(), far);
    beyond.nearest.is_some_and(|g| g.gap < -BEYOND_CONTACT * rules.ground_tolerance)
}

/// Ground and obstacles nearer than `reach` (m) to a part.
fn environment_of(scene: &Scene, part: &Part, placed: &Placed, reach: f64) -> Vec<(Touch, Near)> {
    let mut found = Vec::new();
    if let GroundNear::Near(near) = near_ground(scene, part, placed, reach, reach, Kernel::Exact) {
        found.push((Touch::Ground(part.link), near));
    }
    for (index, solid) in scene.solids.iter().enumerate() {
        if apart(placed, &part.form, &solid.placed, &solid.form, reach) {
            continue;
        }
        if let Some(near) = near_solid(placed, part, solid, reach) {
            found.push((Touch::Obstacle(part.link, index), near));
        }
    }
    found
}

/// The distance of two parts if less than `reach` (m).
fn parts_near([a, b]: [&Part; 2], [at_a, at_b]: [&Placed; 2], reach: f64) -> Option<Near> {
    if apart(at_a, &a.form, at_b, &b.form, reach) {
        return None;
    }
    let [pose_a, pose_b] = [at_a, at_b].map(|at| pose_of(&at.frame));
    near(&pose_a, &*a.shape.0, &pose_b, &*b.shape.0, reach)
}
