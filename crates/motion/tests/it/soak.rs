//! Many generated requests, hostile ones among them: no panic, a known outcome, bounded work, and
//! plans that hold what a plan promises. `FOOTFALL_SOAK` says how many; `make soak` asks for 10^5.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

use collision::{LegChecker, Obstacle, Scene};
use motion::trial::Kind;
use motion::{
    Buffers, EdgeRule, Outcome, Phase, Planner, StepAnswer, StepRequest, Stopped, Target, Watch,
    plan_step, trial,
};
use nalgebra::{Isometry3, Point3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rover::{Configuration, JointRange, LegAngles, LegId, Payload, Posture, Robot};
use stability::rule::Preference;
use terrain::ElevationMap;

use crate::{loaded, robot_of};

/// Requests in an ordinary run.
const ORDINARY: u64 = 1_000;

/// Most configurations that any request here may look at: its budgets are small.
const MOST_CHECKED: u64 = 400_000;

fn n_requests() -> u64 {
    std::env::var("FOOTFALL_SOAK").ok().and_then(|n| n.parse().ok()).unwrap_or(ORDINARY)
}

/// Robots of all kinds and scales; a few with tools that cut their joints' ranges to little.
fn robots() -> Vec<Arc<Robot>> {
    let mut robots = vec![loaded()];
    for scale in [0.001, 0.1, 10.0, 1000.0] {
        robots.push(Arc::new(loaded().scaled(scale).unwrap()));
    }
    for name in ["hexapod", "quadruped", "slider"] {
        let robot = robot_of(name);
        robots.push(Arc::new(robot.scaled(7.0).unwrap()));
        robots.push(Arc::new(robot));
    }
    let bent = loaded().pose("bent").unwrap().legs[0];
    for spread in [0.0, 0.2] {
        let leg = loaded().leg(LegId(0)).clone();
        let cut = |(i, joint): (usize, &usize)| JointRange {
            joint: loaded().joints()[*joint].name.clone(),
            lower: (bent[i] - spread).max(leg.lower[i]),
            upper: (bent[i] + spread).min(leg.upper[i]),
        };
        let limits = leg.joints.iter().enumerate().map(cut).collect();
        let tool = Payload {
            link: "chassis".into(),
            mass: 1.0,
            com: Point3::origin(),
            shapes: Vec::new(),
            limits,
        };
        // A range that leaves nothing may be refused: that is an answer too.
        robots.extend(loaded().with_payloads(&[tool]).map(Arc::new));
    }
    robots
}

/// Stops after so many questions.
struct After(Option<u64>);

impl Watch for After {
    fn stopped(&mut self) -> Option<Stopped> {
        let left = self.0.as_mut()?;
        *left = left.saturating_sub(1);
        (*left == 0).then_some(Stopped::Deadline)
    }
}

struct Case {
    scene: Scene,
    start: Configuration,
    gravity: f64,
    request: StepRequest,
    watch: After,
}

/// Draws requests; most are sane but for one or two things.
struct Source {
    rng: ChaCha8Rng,
    robots: Vec<Arc<Robot>>,
    fields: Vec<ElevationMap>,
}

impl Source {
    fn one_in(&mut self, n: u32) -> bool {
        self.rng.random_range(0..n) == 0
    }

    fn pick<T: Copy>(&mut self, of: &[T]) -> T {
        of[self.rng.random_range(0..of.len())]
    }

    /// A number that no one would send on purpose.
    fn wild(&mut self) -> f64 {
        let wild = [
            f64::NAN,
            f64::INFINITY,
            f64::NEG_INFINITY,
            1e308,
            -1e308,
            0.0,
            -0.0,
            -1.0,
            1e-300,
            1e9,
            5.0,
        ];
        self.pick(&wild)
    }

    /// Mostly the value, now and then a wild one.
    fn perhaps_wild(&mut self, value: f64) -> f64 {
        if self.one_in(25) { self.wild() } else { value }
    }

    fn case(&mut self) -> Case {
        let robot = self.robots[self.rng.random_range(0..self.robots.len())].clone();
        let size = robot.scale() * if robot.name() == "athlete" { 1.0 } else { 0.15 };
        let (map, start) = self.ground(&robot, size);
        let leg = LegId(self.rng.random_range(0..robot.legs().len()));
        let wheel = Posture::new(&robot, &start).wheel(&robot, leg);
        let low = wheel.lowest_point(&Vector3::z_axis());
        let target = self.target(&robot, leg, &start, low, size);
        let rocks = self.rocks(low, size);
        // What a scene refuses is not there.
        let scene = Scene::new(robot.clone(), map.clone(), &rocks)
            .or_else(|_| Scene::new(robot.clone(), map, &[]))
            .unwrap();
        let request = self.request(leg, target, size);
        let deadline = match self.rng.random_range(0..10) {
            0 => Some(1),
            1 => Some(self.rng.random_range(2..400)),
            _ => None,
        };
        let gravity = self.pick(&[1.62, 9.81, 3.71, 0.01, 100.0]);
        Case { scene, start, gravity, request, watch: After(deadline) }
    }

    /// Ground, and the robot on it, near its edge, in it or above it.
    fn ground(&mut self, robot: &Robot, size: f64) -> (ElevationMap, Configuration) {
        let poses: Vec<String> = robot.poses().iter().map(|(name, _)| name.clone()).collect();
        let mut start = robot.pose(&poses[self.rng.random_range(0..poses.len())]).unwrap();
        let low = Posture::new(robot, &start).wheel(robot, LegId(0));
        start.world_from_base.translation.z -= low.lowest_point(&Vector3::z_axis()).z;
        let map = if robot.scale() == 1.0 && self.one_in(4) {
            let field = self.rng.random_range(0..self.fields.len());
            self.fields[field].clone()
        } else {
            ElevationMap::plane(16.0 * size, 0.4 * size).unwrap()
        };
        match self.rng.random_range(0..16) {
            0 => start.world_from_base.translation.z -= 0.3 * size,
            1 => start.world_from_base.translation.z += 0.5 * size,
            2 => start.world_from_base.translation.x += 6.0 * size,
            3 => start.world_from_base.translation.x += 100.0 * size,
            4 => {
                let leg = self.rng.random_range(0..start.legs.len());
                start.legs[leg] = self.any_angles(robot, LegId(leg), 1.0);
            }
            _ => {}
        }
        (map, start)
    }

    /// Angles within the limits, or beyond them by a factor.
    fn any_angles(&mut self, robot: &Robot, leg: LegId, beyond: f64) -> LegAngles {
        let leg = robot.leg(leg);
        LegAngles::from_fn(|i, _| {
            let middle = 0.5 * (leg.lower[i] + leg.upper[i]);
            middle + beyond * (leg.upper[i] - middle) * self.rng.random_range(-1.0..=1.0)
        })
    }

    fn target(
        &mut self,
        robot: &Robot,
        leg: LegId,
        start: &Configuration,
        low: Point3<f64>,
        size: f64,
    ) -> Target {
        let aside = |rng: &mut ChaCha8Rng, far: f64| rng.random_range(-far..far) * size;
        match self.rng.random_range(0..12) {
            0 => {
                let beyond = self.pick(&[1.0, 1.0, 1.5]);
                let mut angles = self.any_angles(robot, leg, beyond);
                if self.one_in(20) {
                    angles[0] = self.wild();
                }
                Target::Angles(angles)
            }
            1 => Target::Angles(start.legs[leg.0]),
            2 => {
                let [x, y, z] = std::array::from_fn(|_| self.wild());
                Target::Ground(Point3::new(x, y, z))
            }
            3 => Target::Ground(low + Vector3::new(0.0, 0.0, -3.0 * size)),
            4 => Target::Ground(low + Vector3::x() * aside(&mut self.rng, 20.0)),
            _ => {
                let far = self.pick(&[0.3, 0.7, 1.2]);
                let [x, y] = std::array::from_fn(|_| aside(&mut self.rng, far));
                Target::Ground(low + Vector3::new(x, y, 0.0))
            }
        }
    }

    fn rocks(&mut self, low: Point3<f64>, size: f64) -> Vec<Obstacle> {
        let n = self.pick(&[0, 0, 1, 2, 5, 30]);
        (0..n)
            .map(|_| {
                let at = low
                    + Vector3::from_fn(|i, _| {
                        size * self.rng.random_range(-1.2..1.2) * if i == 2 { 0.2 } else { 1.0 }
                    });
                let mut half = Vector3::from_fn(|_, _| size * self.rng.random_range(0.02..0.25));
                if self.one_in(30) {
                    half[self.rng.random_range(0..3)] = self.wild();
                }
                if self.one_in(3) {
                    return self.mesh(at, half);
                }
                let world_from_box =
                    Isometry3::new(at.coords, Vector3::z() * self.rng.random_range(-3.0..3.0));
                Obstacle::Box { world_from_box, half_extents: half }
            })
            .collect()
    }

    /// A tetrahedron: closed, or open, inside out, or flat.
    fn mesh(&mut self, at: Point3<f64>, half: Vector3<f64>) -> Obstacle {
        let corner = |x: f64, y: f64, z: f64| at + Vector3::new(x * half.x, y * half.y, z * half.z);
        let mut vertices = vec![
            corner(-1.0, -1.0, -1.0),
            corner(1.0, -1.0, -1.0),
            corner(0.0, 1.0, -1.0),
            corner(0.0, 0.0, 1.0),
        ];
        let mut triangles = vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];
        match self.rng.random_range(0..8) {
            0 => triangles.truncate(3),
            1 => triangles.iter_mut().for_each(|t| t.swap(0, 1)),
            2 => vertices.iter_mut().for_each(|v| v.z = at.z),
            3 => vertices.iter_mut().for_each(|v| *v = at),
            4 => triangles[0] = [0, 0, 1],
            5 => triangles[0] = [0, 2, 9],
            _ => {}
        }
        Obstacle::Mesh { vertices, triangles }
    }

    fn request(&mut self, leg: LegId, target: Target, size: f64) -> StepRequest {
        let mut request = StepRequest::new(leg, target, size);
        let planners =
            [Planner::Auto, Planner::AStar, Planner::Sbl, Planner::RrtConnect, Planner::Line];
        request.planner = self.pick(&planners);
        request.seed = self.rng.random();
        let lift = size * self.pick(&[0.2, 0.2, 0.2, 0.0, 0.05, 1.0, 50.0]);
        request.lift = self.perhaps_wild(lift);
        if self.one_in(4) {
            let kept = size * self.pick(&[0.0, 0.01, 0.1, 10.0]);
            request.environment_tolerance = Some(self.perhaps_wild(kept));
            request.pair_tolerance = Some(self.perhaps_wild(kept));
        }
        if self.one_in(4) {
            let mut buffer = || size * self.pick(&[0.0, 0.0, 0.05, 20.0]);
            let [terrain_lift, obstacle, inflation] = [buffer(), buffer(), buffer()];
            request.buffers = Buffers {
                terrain_lift: self.perhaps_wild(terrain_lift),
                obstacle: self.perhaps_wild(obstacle),
                inflation: self.perhaps_wild(inflation),
            };
        }
        request.transit_only = matches!(target, Target::Angles(_)) && self.one_in(2);
        if self.one_in(8) {
            request.preference = self.pick(&[Preference::Conservative, Preference::Friction]);
            request.friction = self.pick(&[0.7, 0.7, 0.1, 0.0, -1.0, f64::NAN]);
        }
        if self.one_in(4) {
            request.edges = EdgeRule::Sampled(self.pick(&[0.01, 0.05, 0.1]));
        }
        let cell = size * self.pick(&[0.2, 0.2, 0.1, 1.0]);
        request.cell = self.perhaps_wild(cell);
        // A search for a shift of the body is by far the dearest part.
        request.may_shift = self.one_in(24);
        request.preload = self.one_in(2);
        request.drive_hold = self.one_in(8);
        request.sbl.max_milestones = self.pick(&[2, 30, 100]);
        request.smooth.max_checked = self.pick(&[0, 20, 100, 300]);
        request.smooth.max_edges = self.pick(&[0, 5, 100]);
        request
    }
}

/// What every answer must be, and every plan keep.
fn check(case: &Case, answer: &StepAnswer) {
    let (robot, request) = (case.scene.robot(), &case.request);
    assert!(answer.statistics.n_checked <= MOST_CHECKED, "{:?}", answer.statistics);
    assert!(!answer.reason.is_empty(), "{:?}", answer.outcome);
    if matches!(answer.outcome, Outcome::Deadline) {
        assert!(case.watch.0 == Some(0), "there was no deadline");
    }
    assert_ne!(answer.outcome, Outcome::Cancelled);
    let has_path = matches!(answer.outcome, Outcome::Found | Outcome::Refused);
    assert_eq!(has_path, !answer.waypoints.is_empty(), "{:?}", answer.outcome);
    if answer.outcome != Outcome::Found {
        return;
    }
    assert!(answer.findings.iter().all(|finding| finding.ok));
    let leg = robot.leg(request.leg);
    let first = &answer.waypoints[0];
    let off = (first.angles - case.start.legs[request.leg.0]).amax();
    assert!(off < 1e-6, "the first waypoint is {off} rad off the start");
    for w in answer.waypoints.windows(2) {
        assert!(w[1].time >= w[0].time, "time goes back: {} {}", w[0].time, w[1].time);
    }
    for w in &answer.waypoints {
        assert!(w.angles >= leg.lower.add_scalar(-1e-6) && w.angles <= leg.upper.add_scalar(1e-6));
    }
    let last = &answer.waypoints[answer.waypoints.len() - 1];
    let stance = answer.waypoints.iter().rev().find_map(|w| w.stance.as_ref());
    let standing = Posture::new(robot, stance.unwrap_or(&case.start));
    match request.target {
        // The load presses the wheel down a little.
        Target::Angles(goal) if !request.preload || request.transit_only => {
            assert!((last.angles - goal).amax() < 1e-6);
        }
        Target::Angles(_) => {}
        Target::Ground(goal) => {
            let contact = answer.footfall.unwrap().contact;
            let off = (contact.xy() - goal.xy()).norm();
            assert!(off <= 1.5 * leg.wheel.radius, "the footfall is {off} m off its place");
        }
    }
    // The transit touches nothing: a coarse look by whole postures.
    let checker = LegChecker::new(&case.scene, &standing, request.leg, Some(0.0), Some(0.0));
    let transit = answer.waypoints.windows(2).filter(|w| w[1].phase == Phase::Transit);
    for w in transit.take(20) {
        for i in 0..=4 {
            let q = w[0].angles + (w[1].angles - w[0].angles) * (f64::from(i) / 4.0);
            let touched = checker.collision(&standing.with_leg(robot, request.leg, &q), None);
            assert_eq!(touched, None);
        }
    }
}

#[test]
fn no_request_brings_the_planner_down_and_every_plan_keeps_its_promises() {
    let fields = (0..3)
        .map(|seed| {
            let trial = trial::draw(&loaded(), 1.62, Kind::Cluttered, seed).unwrap();
            trial.scene.map().clone()
        })
        .collect();
    let mut source = Source { rng: ChaCha8Rng::seed_from_u64(0), robots: robots(), fields };
    let mut outcomes = std::collections::BTreeMap::new();
    let mut failed = Vec::new();
    for n in 0..n_requests() {
        // Each request can be made again alone, by its number.
        source.rng = ChaCha8Rng::seed_from_u64(n);
        let tried = AssertUnwindSafe(|| {
            let mut case = source.case();
            let Case { scene, start, gravity, request, watch } = &mut case;
            let answer = plan_step(scene, start, *gravity, request, watch);
            check(&case, &answer);
            answer.outcome.word()
        });
        match catch_unwind(tried) {
            Ok(word) => *outcomes.entry(word).or_insert(0_u64) += 1,
            Err(_) => {
                eprintln!("request {n}");
                failed.push(n);
            }
        }
    }
    eprintln!("{outcomes:?}");
    assert!(failed.is_empty(), "requests {failed:?}: see the panics above");
    if n_requests() >= ORDINARY {
        assert!(outcomes.len() >= 7, "too few kinds of answers: {outcomes:?}");
    }
}
