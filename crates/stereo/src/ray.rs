//! Rays against the ground and the posed robot.
//!
//! The ground is the triangulated surface of an elevation map, found by going down a pyramid of highest
//! squares along the ray; what is unknown is not hit. The robot is the shapes of its links; a mesh is
//! hit at its triangles.

mod ground;
mod solid;

use nalgebra::{Point3, Vector3};
use rover::{LinkId, Posture, Robot};
use terrain::ElevationMap;

pub use solid::Solid;

/// What a ray hits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Target {
    /// The ground.
    Ground,
    /// A link of the robot.
    Link(LinkId),
}

/// Where a ray hits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Length along the ray (m).
    pub distance: f64,
    /// Outward normal of what is hit.
    pub normal: Vector3<f64>,
    /// What is hit.
    pub target: Target,
}

/// Ground and robot in one frame, prepared for rays.
#[derive(Debug, Clone)]
pub struct RayScene {
    ground: Option<ground::GroundRays>,
    solids: Vec<Solid>,
}

impl RayScene {
    /// Ground and robot, either of which may be absent. Frame `world`.
    pub fn new(map: Option<&ElevationMap>, robot: Option<(&Robot, &Posture)>) -> RayScene {
        let solids = robot.map(|(robot, posture)| solid::solids_of(robot, posture));
        RayScene { ground: map.map(ground::GroundRays::new), solids: solids.unwrap_or_default() }
    }

    /// The shapes of the robot.
    pub fn solids(&self) -> &[Solid] {
        &self.solids
    }

    /// The first thing along a ray of unit direction within `reach` (m).
    pub fn cast(&self, origin: &Point3<f64>, direction: &Vector3<f64>, reach: f64) -> Option<Hit> {
        let mut best: Option<Hit> = None;
        let mut limit = reach;
        for solid in &self.solids {
            if let Some((distance, normal)) = solid.hit(origin, direction, limit) {
                limit = distance;
                best = Some(Hit { distance, normal, target: Target::Link(solid.link) });
            }
        }
        let ground = self.ground.as_ref().and_then(|ground| ground.hit(origin, direction, limit));
        match ground {
            Some((distance, normal)) => Some(Hit { distance, normal, target: Target::Ground }),
            None => best,
        }
    }

    /// True if anything lies along the ray within `reach` (m).
    pub fn is_blocked(&self, origin: &Point3<f64>, direction: &Vector3<f64>, reach: f64) -> bool {
        self.solids.iter().any(|solid| solid.hit(origin, direction, reach).is_some())
            || self.ground.as_ref().is_some_and(|g| g.hit(origin, direction, reach).is_some())
    }

    /// True if nothing lies between two points, but for `slack` (m) before the second.
    pub fn sees(&self, from: &Point3<f64>, to: &Point3<f64>, slack: f64) -> bool {
        let way = to - from;
        let length = way.norm();
        length <= slack || !self.is_blocked(from, &(way / length), length - slack)
    }
}
