//! Friction as the preference of a step: beside the regular rule, m1 also within what friction holds.
//!
//! The verdict is held against linear programs of another author's solver, along the whole path and
//! with normals from the formula of the ground.

use std::f64::consts::TAU;
use std::sync::Arc;

use collision::{Scene, survey, touchdowns};
use geometry::{Grid, Raster};
use microlp::{ComparisonOp, OptimizationDirection, Problem, Variable};
use motion::{
    AdviceOptions, Answer, Outcome, Phase, StepAnswer, StepRequest, Target, TimedPath, TimingError,
    TimingLimits, Unwatched, Wish, advise, base_between, plan_step, time_leg_path,
};
use nalgebra::{Isometry3, Point2, Point3, Rotation3, UnitQuaternion, Vector2, Vector3};
use rover::{Configuration, LegAngles, LegId, LinkId, Posture, Robot};
use stability::{Contact, Preference, StanceGuard};
use terrain::{ElevationMap, Source};

use crate::{loaded, standing};

const MOON: f64 = 1.62;

/// Edges of the cones of the oracle: nearly round, so that it holds whatever a cone of eight edges
/// does.
const EDGES: usize = 64;

/// Level ground but for a round facet that slopes outward, as seen from the middle of the stance.
#[derive(Clone, Copy)]
struct Facet {
    center: Point2<f64>,
    /// Slope along the way out (rise over run, negative where it falls).
    slope: f64,
}

impl Facet {
    const RADIUS: f64 = 0.6;

    fn holds(&self, p: Point2<f64>) -> bool {
        (p - self.center).norm() <= Facet::RADIUS
    }

    fn gradient(&self, p: Point2<f64>) -> Vector2<f64> {
        if self.holds(p) { self.center.coords.normalize() * self.slope } else { Vector2::zeros() }
    }

    fn height(&self, p: Point2<f64>) -> f64 {
        self.gradient(p).dot(&(p - self.center))
    }

    fn normal(&self, p: Point2<f64>) -> Vector3<f64> {
        let g = self.gradient(p);
        Vector3::new(-g.x, -g.y, 1.0).normalize()
    }
}

fn map_of(height: impl Fn(Point2<f64>) -> f64) -> ElevationMap {
    let grid = Grid { origin: Point2::new(-8.0, -8.0), resolution: 0.1, nx: 161, ny: 161 };
    let heights: Vec<f32> = (0..grid.ny)
        .flat_map(|j| (0..grid.nx).map(move |i| (i, j)))
        .map(|(i, j)| height(Point2::new(-8.0 + 0.1 * i as f64, -8.0 + 0.1 * j as f64)) as f32)
        .collect();
    ElevationMap::new(Raster::new(grid, heights).unwrap(), Source::plane())
}

/// The rover on level ground, the foot of its first leg on a facet of this slope; `turn` about
/// gravity and a way turn and move the whole scene.
fn on_a_facet(slope: f64) -> (Scene, Configuration, Facet) {
    let robot = loaded();
    let start = standing(&robot);
    let foot =
        Posture::new(&robot, &start).wheel(&robot, LegId(0)).lowest_point(&Vector3::z_axis());
    let facet = Facet { center: foot.xy(), slope };
    let scene = Scene::new(robot.clone(), map_of(|p| facet.height(p)), &[]).unwrap();
    let posture = Posture::new(&robot, &start);
    let down = touchdowns(&scene, &posture, LegId(0), facet.center, &start.legs[0], 1).unwrap();
    let start = start.with_leg(LegId(0), down[0].angles);
    (scene, start, facet)
}

fn step(
    scene: &Scene,
    start: &Configuration,
    leg: LegId,
    change: impl Fn(&mut StepRequest),
) -> StepAnswer {
    let robot = scene.robot();
    let from = Posture::new(robot, start).wheel(robot, leg).lowest_point(&Vector3::z_axis());
    let mut request =
        StepRequest::new(leg, Target::Ground(from + Vector3::new(0.1, 0.1, 0.0)), 1.0);
    request.preload = false;
    change(&mut request);
    plan_step(scene, start, MOON, &request, &mut Unwatched)
}

fn on_friction(friction: f64, may_shift: bool) -> impl Fn(&mut StepRequest) {
    move |r| {
        r.preference = Preference::Friction;
        r.friction = friction;
        r.may_shift = may_shift;
    }
}

/// Do forces within these cones hold a center of mass at (x, y)?
fn is_held(feet: &[(Point3<f64>, Vector3<f64>)], friction: f64, at: Point2<f64>) -> bool {
    let about = Point3::new(at.x, at.y, 0.0);
    gives(feet, friction, &about, [0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
}

/// Do forces within these cones sum up to this force and this moment about a point?
fn gives(
    feet: &[(Point3<f64>, Vector3<f64>)],
    friction: f64,
    about: &Point3<f64>,
    sums: [f64; 6],
) -> bool {
    let mut problem = Problem::new(OptimizationDirection::Minimize);
    let mut rows: [Vec<(Variable, f64)>; 6] = Default::default();
    for (p, normal) in feet {
        let across = normal.cross(&Vector3::new(0.3, 0.9, 0.1)).normalize();
        for i in 0..EDGES {
            let axis = nalgebra::Unit::new_normalize(*normal);
            let turn = Rotation3::from_axis_angle(&axis, TAU * i as f64 / EDGES as f64);
            let f = normal + turn * across * friction;
            let moment = (p - about).cross(&f);
            let share = problem.add_var(1.0, (0.0, f64::INFINITY));
            let parts = [f.x, f.y, f.z, moment.x, moment.y, moment.z];
            rows.iter_mut().zip(parts).for_each(|(row, part)| row.push((share, part)));
        }
    }
    for (row, sum) in rows.iter().zip(sums) {
        problem.add_constraint(row, ComparisonOp::Eq, sum);
    }
    problem.solve().is_ok()
}

/// Is the center of mass held wherever it is moved to by `margin` (m), in 12 directions?
fn is_held_within(
    feet: &[(Point3<f64>, Vector3<f64>)],
    friction: f64,
    com: &Point3<f64>,
    margin: f64,
) -> bool {
    (0..12).all(|i| {
        let (y, x) = (TAU * f64::from(i) / 12.0).sin_cos();
        is_held(feet, friction, com.xy() + Vector2::new(x, y) * margin)
    })
}

/// Feet with normals from the formula of the ground.
fn feet(
    scene: &Scene,
    at: &Configuration,
    normal: &impl Fn(Point2<f64>) -> Vector3<f64>,
    lifted: Option<LegId>,
) -> Vec<(Point3<f64>, Vector3<f64>)> {
    let posture = Posture::new(scene.robot(), at);
    let contacts = survey(scene, &posture).contacts(scene, &posture);
    let stays = contacts.into_iter().filter(|(leg, _)| Some(*leg) != lifted);
    stays.map(|(_, p)| (p, normal(p.xy()))).collect()
}

fn com(robot: &Robot, at: &Configuration) -> Point3<f64> {
    Posture::new(robot, at).center_of_mass(robot)
}

/// The whole rover along a step, by phase.
fn along(
    scene: &Scene,
    start: &Configuration,
    leg: LegId,
    answer: &StepAnswer,
) -> Vec<(Phase, Configuration)> {
    let robot = scene.robot();
    let legs: Vec<LegId> = robot.leg_ids().collect();
    let mut here = start.clone();
    let mut all = Vec::new();
    for w in answer.waypoints.windows(2) {
        let n = 4;
        for i in 0..=n {
            let t = f64::from(i) / f64::from(n);
            let at = match &w[1].stance {
                Some(stance) => base_between(robot, &here, stance, &legs, t),
                None => here.with_leg(leg, w[0].angles.lerp(&w[1].angles, t)),
            };
            all.push((w[1].phase, at));
        }
        here = match &w[1].stance {
            Some(stance) => stance.clone(),
            None => here.with_leg(leg, w[1].angles),
        };
    }
    all
}

#[test]
fn a_foot_on_a_slippery_facet_counts_for_the_polygon_but_not_for_friction() {
    // Hardly any load on the facet can be kept from sliding by the others.
    let (leg, friction) = (LegId(1), 0.02);
    let (scene, start, facet) = on_a_facet(-0.6);
    let robot = scene.robot();
    let margin = robot.stance().margin;
    let normal = |p: Point2<f64>| facet.normal(p);
    let holds = |at: &Configuration, lifted: Option<LegId>| {
        is_held_within(
            &feet(&scene, at, &normal, lifted),
            friction,
            &com(robot, at),
            0.999 * margin,
        )
    };
    // The polygon is content without a shift of the body.
    let regular = step(&scene, &start, leg, |r| r.may_shift = false);
    assert_eq!(regular.outcome, Outcome::Found, "{}", regular.reason);
    // Another solver refutes that friction has m1 there, and so does the plan.
    assert!(!holds(&start, Some(leg)));
    let refused = step(&scene, &start, leg, on_friction(friction, false));
    assert_eq!(refused.outcome, Outcome::Unstable, "{}", refused.reason);
    assert!(refused.reason.contains("friction margin"), "{}", refused.reason);
    let missing = refused.constraint.unwrap();
    assert_eq!(missing.name, "stability");
    assert!(missing.missing.unwrap() > 0.0);
    // A shift of the body makes good for it, and all along the way friction holds m1.
    let found = step(&scene, &start, leg, on_friction(friction, true));
    assert_eq!(found.outcome, Outcome::Found, "{}", found.reason);
    assert!(found.findings.iter().all(|f| f.ok));
    let way = along(&scene, &start, leg, &found);
    assert!(way.iter().filter(|(phase, _)| *phase == Phase::Shift).count() > 4);
    for (phase, at) in &way {
        let lifted = (*phase != Phase::Shift).then_some(leg);
        assert!(holds(at, lifted), "{phase:?}");
    }
    // With more friction nothing has to move, even where the facet alone would slide.
    for friction in [0.3, 0.9] {
        let rough = step(&scene, &start, leg, on_friction(friction, false));
        assert_eq!(rough.outcome, Outcome::Found, "{}", rough.reason);
    }
}

/// The rover on a plane that rises by `slope` along x, turned by `yaw` and moved.
fn on_a_slope(slope: f64, yaw: f64) -> (Scene, Configuration) {
    let robot: Arc<Robot> = loaded();
    let mut start = standing(&robot);
    let uphill = Vector2::new(f64::cos(yaw), f64::sin(yaw));
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw)
        * UnitQuaternion::from_axis_angle(&Vector3::y_axis(), -slope.atan());
    start.world_from_base =
        Isometry3::from_parts(nalgebra::Translation3::identity(), turn) * start.world_from_base;
    let map = map_of(|p| slope * uphill.dot(&p.coords));
    (Scene::new(robot, map, &[]).unwrap(), start)
}

#[test]
fn a_slope_steeper_than_its_friction_is_refused_whichever_way_it_faces() {
    for yaw in [0.0, 0.25 * TAU, 1.0, -2.0] {
        let (scene, start) = on_a_slope(0.25, yaw);
        let go = |change: &dyn Fn(&mut StepRequest)| step(&scene, &start, LegId(2), change);
        let regular = go(&|r| r.may_shift = true);
        assert_eq!(regular.outcome, Outcome::Found, "{}", regular.reason);
        let slippery = go(&on_friction(0.2, true));
        assert_eq!(slippery.outcome, Outcome::Unstable, "{}", slippery.reason);
        assert!(slippery.reason.contains("too steep for its friction"), "{}", slippery.reason);
        let rough = go(&on_friction(0.5, true));
        assert_eq!(rough.outcome, Outcome::Found, "{}", rough.reason);
        let normal = Vector3::new(-0.25 * yaw.cos(), -0.25 * yaw.sin(), 1.0).normalize();
        let feet = feet(&scene, &start, &|_| normal, Some(LegId(2)));
        assert!(!is_held(&feet, 0.24, com(scene.robot(), &start).xy()));
    }
}

#[test]
fn on_level_ground_friction_asks_for_no_more_than_the_regular_rule() {
    let robot = loaded();
    let start = standing(&robot);
    let scene = Scene::new(robot, ElevationMap::plane(20.0, 0.25).unwrap(), &[]).unwrap();
    for leg in scene.robot().leg_ids() {
        let regular = step(&scene, &start, leg, |_| {});
        let friction = step(&scene, &start, leg, on_friction(0.05, true));
        assert_eq!(regular.outcome, friction.outcome, "{}", friction.reason);
        let angles = |a: &StepAnswer| a.waypoints.iter().map(|w| w.angles).collect::<Vec<_>>();
        let (a, b) = (angles(&regular), angles(&friction));
        assert_eq!(a.len(), b.len());
        assert!(a.iter().zip(&b).all(|(a, b)| (a - b).amax() < 1e-9));
    }
}

#[test]
fn friction_that_is_no_number_is_refused_in_words() {
    let (scene, start) = on_a_slope(0.0, 0.0);
    for friction in [f64::NAN, -1.0, f64::INFINITY] {
        let answer = step(&scene, &start, LegId(1), on_friction(friction, true));
        assert_eq!(answer.outcome, Outcome::Unstable, "{}", answer.reason);
        assert!(answer.reason.contains("friction"), "{}", answer.reason);
    }
}

#[test]
fn the_adviser_moves_the_chassis_until_friction_has_what_is_wished_for() {
    let (leg, friction) = (LegId(1), 0.02);
    let (scene, start, facet) = on_a_facet(-0.6);
    let robot = scene.robot();
    let options =
        AdviceOptions { fold: false, replace: false, friction, ..AdviceOptions::default() };
    let ask =
        |wish: &Wish| advise(&scene, &start, MOON, leg, wish, &options, &mut Unwatched).unwrap();
    // The regular rule holds where the rover is, friction's does not.
    assert_eq!(ask(&Wish::default()).answer, Answer::AlreadyMet);
    let wished = 0.2;
    let advice = ask(&Wish { friction: Some(wished), ..Wish::default() });
    assert!(advice.before.friction.unwrap() < 0.15, "{:?}", advice.before);
    let Answer::Proposals(proposals) = &advice.answer else { panic!("{:?}", advice.answer) };
    let end = &proposals[0].end;
    assert!(proposals[0].after.friction.unwrap() >= wished - 1e-9);
    let normal = |p: Point2<f64>| facet.normal(p);
    let staying = feet(&scene, end, &normal, Some(leg));
    assert!(is_held_within(&staying, friction, &com(robot, end), 0.999 * wished));
    // What no pose gives is answered by what stands in the way.
    let far = ask(&Wish { friction: Some(3.0), ..Wish::default() });
    let Answer::Best { missing, .. } = far.answer else { panic!("{:?}", far.answer) };
    assert!(missing > 1.0, "{missing}");
}

/// Force (in weights) and moment about the center of mass that a path of a leg asks of the ground at a
/// time, by differences of postures; and that center.
fn asked(
    robot: &Robot,
    posture: &Posture,
    (path, knots): (&TimedPath, &[LegAngles]),
    t: f64,
) -> (Point3<f64>, [f64; 6]) {
    let tick = 2e-3;
    let [before, here, after] = [t - tick, t, t + tick].map(|t| {
        let (piece, share) = path.at(t).unwrap();
        let there = posture.with_leg(robot, LegId(0), &knots[piece].lerp(&knots[piece + 1], share));
        let links = robot.links().iter().enumerate();
        links.map(|(i, link)| there.link(LinkId(i)) * link.com).collect::<Vec<Point3<f64>>>()
    });
    let mass = |i: usize| robot.links()[i].mass / robot.mass();
    let com = (0..here.len()).map(|i| here[i].coords * mass(i)).sum::<Vector3<f64>>();
    let (mut force, mut moment) = (Vector3::z(), Vector3::zeros());
    for i in 0..here.len() {
        let a = (after[i].coords + before[i].coords - here[i].coords * 2.0) / (tick * tick);
        force += a * (mass(i) / MOON);
        moment += (here[i].coords - com).cross(&(a * (mass(i) / MOON)));
    }
    (com.into(), [force.x, force.y, force.z, moment.x, moment.y, moment.z])
}

#[test]
fn on_slippery_ground_a_fast_swing_is_timed_so_that_no_foot_slips() {
    let robot = loaded();
    let start = standing(&robot);
    let posture = Posture::new(&robot, &start);
    let q = start.legs[0];
    let turned = |yaw: f64, pitch: f64| q + LegAngles::new(yaw, pitch, 0.1, 0.0, 0.2, 0.1);
    let knots = [q, turned(0.0, -0.5), turned(0.8, -0.5), turned(-0.4, -0.5)];
    let friction = 0.03;
    let touch = |leg: &LegId| posture.wheel(&robot, *leg).lowest_point(&Vector3::z_axis());
    let feet: Vec<(Point3<f64>, Vector3<f64>)> =
        robot.leg_ids().skip(1).map(|leg| (touch(&leg), Vector3::z())).collect();
    let contacts: Vec<Contact> = feet.iter().map(|(p, _)| Contact::level(*p, friction)).collect();
    let rules = robot.stance();
    let guard = StanceGuard::over(&contacts, rules, Preference::Friction).unwrap();
    let points: Vec<Point3<f64>> = feet.iter().map(|(p, _)| *p).collect();
    // Level ground: friction's region is the hull, and but for the shear both rules are the same.
    let regular = StanceGuard::new(&points, rules, Preference::Regular).unwrap();
    let limits = TimingLimits { joint_speed: 2.0, joint_acceleration: 4.0 };
    let timed = |guard: &StanceGuard| {
        time_leg_path(&robot, &posture, LegId(0), &knots, Some(guard), MOON, &limits).unwrap()
    };
    let slips = |path: &TimedPath| {
        let n = 60;
        (0..n)
            .filter(|i| {
                let t = path.duration() * (f64::from(*i) + 0.5) / f64::from(n);
                let (com, sums) = asked(&robot, &posture, (path, &knots), t);
                !gives(&feet, friction, &com, sums)
            })
            .count()
    };
    let (kept, fast) = (timed(&guard), timed(&regular));
    assert!(kept.pieces.iter().all(|piece| piece.held_back));
    assert_eq!(slips(&kept), 0);
    assert!(slips(&fast) > 10, "{}", slips(&fast));
    // It is not slower than it has to be: a quarter faster some foot slips.
    let mut hurried = kept.clone();
    let mut start = 0.0;
    for piece in &mut hurried.pieces {
        (piece.start, piece.duration) = (start, piece.duration / 1.25);
        (piece.speed, piece.acceleration) = (piece.speed * 1.25, piece.acceleration * 1.5625);
        start = piece.end();
    }
    assert!(slips(&hurried) > 0);
    // Where friction holds much more, the margin alone decides.
    let rough: Vec<Contact> = feet.iter().map(|(p, _)| Contact::level(*p, 2.0)).collect();
    let rough = StanceGuard::over(&rough, rules, Preference::Friction).unwrap();
    assert!((timed(&rough).duration() - fast.duration()).abs() < 1e-9);
}

#[test]
fn without_friction_no_swing_is_timed_however_slow() {
    let robot = loaded();
    let start = standing(&robot);
    let posture = Posture::new(&robot, &start);
    let touch = |leg: LegId| posture.wheel(&robot, leg).lowest_point(&Vector3::z_axis());
    let contacts: Vec<Contact> =
        robot.leg_ids().skip(1).map(|leg| Contact::level(touch(leg), 0.0)).collect();
    let guard = StanceGuard::over(&contacts, robot.stance(), Preference::Friction).unwrap();
    let q = start.legs[0];
    let knots = [q, q + LegAngles::new(0.4, -0.5, 0.1, 0.0, 0.0, 0.0)];
    let limits = TimingLimits::of(&robot);
    let timed = time_leg_path(&robot, &posture, LegId(0), &knots, Some(&guard), MOON, &limits);
    assert_eq!(timed, Err(TimingError::Slips { piece: 0 }));
}
