//! Seeded scenes in which planners are tried and compared (F82): a standing robot, the leg that is
//! to step, and a place for its wheel, in five kinds of surroundings.
//!
//! All lengths are shares of a leg's *size*: half the distance from its first joint to its wheel,
//! so that every robot gets scenes of its own measure. Scenes in which no planner could do anything
//! are drawn again: those where the robot touches something from the start, where the wheel cannot
//! be put down, or where it cannot be lifted off or brought in from above. What is left is a matter
//! of finding a way.

use std::sync::Arc;

use collision::{Obstacle, Scene, survey, touchdowns};
use nalgebra::{Isometry3, Point2, Point3, Rotation2, UnitQuaternion, Vector2, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rover::{Configuration, LegId, Posture, Robot};
use terrain::ElevationMap;
use terrain::synthetic::{self, Recipe};

use crate::answer::{Outcome, Planner, StepRequest, Target};
use crate::step::plan_step;
use crate::watch::Unwatched;

/// Kind of surroundings.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// Level ground, nothing on it.
    Open,
    /// A rock between start and goal.
    Rock,
    /// Two rocks that leave a narrow gap between start and goal.
    Gap,
    /// A step toward the inside of the chassis, on level ground.
    Inward,
    /// A boulder field with more rocks about start and goal.
    Cluttered,
}

impl Kind {
    /// All kinds.
    pub const ALL: [Kind; 5] = [Kind::Open, Kind::Rock, Kind::Gap, Kind::Inward, Kind::Cluttered];

    /// The name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Kind::Open => "open ground",
            Kind::Rock => "rock between",
            Kind::Gap => "narrow gap",
            Kind::Inward => "step inward",
            Kind::Cluttered => "cluttered",
        }
    }
}

/// A scene and the step wanted in it.
pub struct Trial {
    /// Robot, ground and rocks.
    pub scene: Scene,
    /// Where the robot stands.
    pub start: Configuration,
    /// Gravity (m/s²).
    pub gravity: f64,
    /// The leg that steps.
    pub leg: LegId,
    /// The ground it is to step on, in `world` (m).
    pub target: Point3<f64>,
}

impl Trial {
    /// The request for the step, with the defaults.
    pub fn request(&self, planner: Planner) -> StepRequest {
        let target = Target::Ground(self.target);
        StepRequest { planner, ..StepRequest::new(self.leg, target, self.scene.robot().scale()) }
    }

    /// Is it a matter of finding a way? Not if lifting off or putting down fails.
    fn is_fair(&self) -> bool {
        let answer = plan_step(
            &self.scene,
            &self.start,
            self.gravity,
            &self.request(Planner::Line),
            &mut Unwatched,
        );
        matches!(answer.outcome, Outcome::Found | Outcome::NoPath | Outcome::Refused)
    }
}

/// Draws before a kind of scene is given up for a robot.
const DRAWS: u32 = 400;

/// Pose that a robot stands in where it has it, else its first one.
const POSE: &str = "bent";

/// Draws a scene: the same for the same robot, gravity (m/s²), kind and seed. `None` where the robot
/// has no pose to stand in, or no such step in a few hundred draws.
pub fn draw(robot: &Arc<Robot>, gravity: f64, kind: Kind, seed: u64) -> Option<Trial> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(kind as u64);
    let pose = robot.pose(POSE).or_else(|| robot.pose(&robot.poses().first()?.0))?;
    let (map, start) = match kind {
        Kind::Cluttered => {
            let field = synthetic::generate(&Recipe::boulder_field(), seed).ok()?;
            let start = seated(robot, &field, pose)?;
            (field, start)
        }
        Kind::Open | Kind::Rock | Kind::Gap | Kind::Inward => {
            let size = size_of(&Posture::new(robot, &pose), robot, LegId(0));
            (ElevationMap::plane(24.0 * size, 0.3 * size).ok()?, level(robot, pose))
        }
    };
    let standing = Standing { robot, gravity, map, start };
    (0..DRAWS).filter_map(|_| standing.draw(kind, &mut rng)).find(Trial::is_fair)
}

/// A robot on its ground.
struct Standing<'a> {
    robot: &'a Arc<Robot>,
    gravity: f64,
    map: ElevationMap,
    start: Configuration,
}

impl Standing<'_> {
    /// One draw of leg, target and rocks; `None` if something touches from the start.
    fn draw(&self, kind: Kind, rng: &mut ChaCha8Rng) -> Option<Trial> {
        let legs: Vec<LegId> = self.robot.leg_ids().collect();
        let leg = legs[rng.random_range(0..legs.len())];
        let posture = Posture::new(self.robot, &self.start);
        let size = size_of(&posture, self.robot, leg);
        let wheel = posture.wheel(self.robot, leg);
        let from = wheel.lowest_point(&Vector3::z_axis()).xy();
        let any_heading = rng.random_range(-std::f64::consts::PI..std::f64::consts::PI);
        let base = self.start.world_from_base.translation.vector.xy();
        let inward = (base - from.coords).y.atan2((base - from.coords).x);
        let (heading, steps) = match kind {
            Kind::Open | Kind::Cluttered => (any_heading, [0.4, 1.2]),
            Kind::Rock | Kind::Gap => (any_heading, [0.9, 1.5]),
            Kind::Inward => (inward + any_heading / 6.0, [0.4, 1.1]),
        };
        let length = size * rng.random_range(steps[0]..steps[1]);
        let step = Step { from, heading, length, size, wheel: wheel.radius };
        let rocks = step.rocks(kind, &self.map, rng)?;
        let to = step.at(1.0, 0.0);
        let target = Point3::new(to.x, to.y, self.map.height_at(to)?);
        let scene = Scene::new(self.robot.clone(), self.map.clone(), &rocks).ok()?;
        let seen = survey(&scene, &posture);
        let stands = seen.self_collision().is_none()
            && seen.terrain_collision().is_none()
            && seen.standing.len() == legs.len();
        let (start, gravity) = (self.start.clone(), self.gravity);
        stands.then_some(Trial { scene, start, gravity, leg, target })
    }
}

/// A step over the ground.
struct Step {
    from: Point2<f64>,
    /// Direction of the step from the x axis (rad).
    heading: f64,
    length: f64,
    size: f64,
    /// Radius of the wheel (m).
    wheel: f64,
}

impl Step {
    /// The point at a share of the step, this far (m) to the left.
    fn at(&self, share: f64, aside: f64) -> Point2<f64> {
        self.from + Rotation2::new(self.heading) * Vector2::new(share * self.length, aside)
    }

    fn rocks(&self, kind: Kind, map: &ElevationMap, rng: &mut ChaCha8Rng) -> Option<Vec<Obstacle>> {
        let size = self.size;
        match kind {
            Kind::Open | Kind::Inward => Some(Vec::new()),
            Kind::Rock => {
                let aside = size * rng.random_range(-0.15..0.15);
                let at = self.at(rng.random_range(0.4..0.6), aside);
                let half = [[0.06, 0.14], [0.2, 0.4], [0.15, 0.4]];
                let turn = self.heading + rng.random_range(-0.3..0.3);
                Some(vec![rock(map, at, turn, half.map(|[a, b]| size * rng.random_range(a..b)))?])
            }
            Kind::Gap => {
                let gap = 2.0 * self.wheel + size * rng.random_range(0.05..0.2);
                let share = rng.random_range(0.4..0.6);
                let thick = size * rng.random_range(0.06..0.14);
                let pair = [-1.0, 1.0].map(|side| {
                    let half = [0.3, 0.5].map(|least| size * (least + rng.random_range(0.0..0.2)));
                    let at = self.at(share, side * (0.5 * gap + half[0]));
                    rock(map, at, self.heading, [thick, half[0], half[1]])
                });
                pair.into_iter().collect()
            }
            Kind::Cluttered => {
                let n = rng.random_range(6..12);
                let placed = (0..n).map(|_| {
                    let half = [[0.05, 0.12], [0.05, 0.12], [0.15, 0.45]]
                        .map(|[a, b]| size * rng.random_range(a..b));
                    let aside = size * rng.random_range(-0.6..0.6);
                    let at = self.at(rng.random_range(-0.2..1.2), aside);
                    rock(map, at, rng.random_range(0.0..3.0), half)
                });
                placed.collect()
            }
        }
    }
}

/// A rock of these half edges (m) on the ground, a third of it in the ground; `None` off the map.
fn rock(map: &ElevationMap, at: Point2<f64>, turn: f64, half: [f64; 3]) -> Option<Obstacle> {
    let z = map.height_at(at)? + half[2] / 3.0;
    let turned = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), turn);
    let world_from_box = Isometry3::from_parts(Vector3::new(at.x, at.y, z).into(), turned);
    Some(Obstacle::Box { world_from_box, half_extents: half.into() })
}

/// Half the distance from a leg's first joint to its wheel (m).
fn size_of(posture: &Posture, robot: &Robot, leg: LegId) -> f64 {
    let hip = posture.link(robot.leg(leg).links[0]).translation.vector;
    0.5 * (posture.wheel(robot, leg).center().coords - hip).norm()
}

/// The robot with its wheels on the plane z = 0.
fn level(robot: &Robot, mut pose: Configuration) -> Configuration {
    let posture = Posture::new(robot, &pose);
    let low = posture.wheel(robot, LegId(0)).lowest_point(&Vector3::z_axis());
    pose.world_from_base.translation.z -= low.z;
    pose
}

/// The robot over the middle of the map, each wheel put down on its own ground below.
fn seated(robot: &Arc<Robot>, map: &ElevationMap, pose: Configuration) -> Option<Configuration> {
    let scene = Scene::new(robot.clone(), map.clone(), &[]).ok()?;
    let size = size_of(&Posture::new(robot, &pose), robot, LegId(0));
    let mut seated = level(robot, pose);
    seated.world_from_base.translation.z += map.height_at(Point2::origin())? + 0.05 * size;
    for leg in robot.leg_ids() {
        let posture = Posture::new(robot, &seated);
        let below = posture.wheel(robot, leg).lowest_point(&Vector3::z_axis()).xy();
        let ways = touchdowns(&scene, &posture, leg, below, &seated.legs[leg.0], 1).ok()?;
        seated.legs[leg.0] = ways.first()?.angles;
    }
    Some(seated)
}
