//! Reachability over a boulder field, the rover standing on it; budget at 2 cm cells on two cores: 50 ms for
//! one leg, 250 ms for six.
//!
//! The load, one leg of `athlete` in its bent stance, cells of 2 cm; level ground (boulders):
//! 35 500 lie within the circle of the leg's length; 24 040 (23 860) are within reach of the wrist, for which
//! the budget says about 13 000; 23 900 (23 660) have joint angles within the limits; 23 120 (22 860) do
//! not collide where they stand; 23 120 (22 340) reach the waypoint above; 22 250 (18 900) are free there:
//! reachable. All of them are stable.
//!
//! "One boulder" is the ground of the budget's loads.
//!
//! "Again" is what it costs to bring an answer up to date: where half a meter square of ground has changed beside
//! the leg, and where what has changed is out of its reach, so that only the stance is looked at.
//!
//! Baseline: the straightforward way, in which every cell has all its touch-downs, a full assessment of
//! the stance and the plain checks for each of them; 14 cm cells, for it takes long. Rates are cells
//! within the leg's length, so that the table's ratios are of the time a cell on one thread or two.

use std::sync::Arc;

use collision::{Allowance, ContactZone, LegChecker, Obstacle, Scene, survey, touchdowns};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use nalgebra::{Isometry3, Point2, Point3, Translation3, Vector3};
use reachability::{Area, ReachOptions, explain, reach, reach_again, reach_legs};
use rover::{Configuration, LegAngles, LegId, Posture, Robot};
use stability::rule;

const LEG: LegId = LegId(0);
const GRAVITY: f64 = 1.62;
const LIFT: f64 = 0.2;

fn athlete() -> Arc<Robot> {
    let folder = "robots/athlete/";
    let robot = Robot::from_folder(
        &testkit::fixture_text(&format!("{folder}robot.toml")),
        |file| Some(testkit::fixture_text(&format!("{folder}{file}"))),
        |_| None,
    );
    Arc::new(robot.expect("the fixture loads"))
}

/// The bent pose with every wheel on the ground.
fn seated(scene: &Scene) -> Configuration {
    let robot = scene.robot();
    let mut start = robot.pose("bent").expect("the fixture has the pose");
    let wheel = |start: &Configuration, leg| Posture::new(robot, start).wheel(robot, leg);
    let low = wheel(&start, LEG).lowest_point(&Vector3::z_axis()).z;
    let places: Vec<Point2<f64>> =
        robot.leg_ids().map(|leg| wheel(&start, leg).center().xy()).collect();
    let heights = places.iter().map(|p| scene.map().height_at(*p).expect("on the map"));
    start.world_from_base.translation.z = heights.sum::<f64>() / places.len() as f64 - low;
    let posture = Posture::new(robot, &start);
    for (leg, p) in robot.leg_ids().zip(places) {
        let ways = touchdowns(scene, &posture, leg, p, &start.legs[leg.0], 1);
        start.legs[leg.0] = ways.expect("the ground is even enough")[0].angles;
    }
    start
}

/// The ground of the budget's loads: 32 768 triangles over 20 m, and a boulder beside the wheel of the leg.
fn one_boulder(robot: Arc<Robot>) -> Scene {
    let resolution_m = 20.0 / 128.0;
    let recipe = terrain::synthetic::Recipe {
        width_m: 20.0,
        height_m: 20.0,
        resolution_m,
        ..terrain::synthetic::Recipe::boulder_field()
    };
    let map = terrain::synthetic::generate(&recipe, 7).expect("the recipe is good");
    let stands = robot.pose("bent").expect("the fixture has the pose");
    let mut at = Posture::new(&robot, &stands).wheel(&robot, LEG).center();
    at.y += 0.7;
    at.z = map.height_at(at.xy()).expect("on the map") + 0.2;
    let world_from_box = Isometry3::from(at.coords);
    let boulder = Obstacle::Box { world_from_box, half_extents: Vector3::repeat(0.3) };
    Scene::new(robot, map, &[boulder]).expect("a box is an obstacle")
}

/// Number of reachable cells by trying all that there is, one after the other.
fn straightforward(scene: &Scene, start: &Configuration, resolution: f64) -> usize {
    let robot = scene.robot();
    let posture = Posture::new(robot, start);
    let mut standing = survey(scene, &posture).contacts(scene, &posture);
    standing.retain(|(leg, _)| *leg != LEG);
    let checker = LegChecker::new(scene, &posture, LEG, None, None);
    let places = places(scene, start, LEG, resolution);
    let near = &start.legs[LEG.0];
    let is_reachable = |p: &Point2<f64>| {
        let ways = touchdowns(scene, &posture, LEG, *p, near, usize::MAX).unwrap_or_default();
        ways.iter().any(|way| {
            let rules = robot.stance();
            let moved = posture.with_leg(robot, LEG, &way.angles);
            let report = rule::assess(robot, &moved, &standing, GRAVITY);
            let zone = ContactZone {
                contact: way.contact,
                center: Point3::from(way.wheel.world_from_wheel.translation.vector),
                radius: rules.contact_radius,
                height: rules.contact_height,
                ground_tolerance: rules.ground_tolerance,
            };
            let above = Translation3::new(0.0, 0.0, LIFT) * way.wheel.world_from_wheel;
            let from = |q: &LegAngles| (q - way.angles).amax();
            let raised = posture.inverse_kinematics(robot, LEG, &above).ok().and_then(|all| {
                let within = all.iter().filter(|s| s.within_limits).map(|s| s.angles);
                within.min_by(|a, b| from(a).total_cmp(&from(b)))
            });
            rule::verdict(&report, rules, rule::Preference::Regular).ok
                && checker.violation(&moved, Some(&zone)).is_none()
                && raised.is_some_and(|q| checker.violation_at(&q, Allowance::default()).is_none())
        })
    };
    places.iter().filter(|p| is_reachable(p)).count()
}

/// The middles of the cells within a leg's length.
fn places(scene: &Scene, start: &Configuration, leg: LegId, resolution: f64) -> Vec<Point2<f64>> {
    let model = scene.robot().leg(leg);
    let posture = Posture::new(scene.robot(), start);
    let hip = posture.link(model.links[0]).translation.vector.xy();
    let n = (model.ik.reach() / resolution).ceil() as i64;
    let cells = (-n..=n).flat_map(|iy| (-n..=n).map(move |ix| Vector3::new(ix, iy, 0).xy()));
    let places = cells.map(|c| Point2::from(hip + c.map(|v| v as f64) * resolution));
    places.filter(|p| (p.coords - hip).norm() <= model.ik.reach()).collect()
}

fn benches(c: &mut Criterion) {
    let map = terrain::synthetic::generate(&terrain::synthetic::Recipe::boulder_field(), 7)
        .expect("the recipe is good");
    let level = terrain::ElevationMap::plane(12.0, 0.05).expect("a plane");
    let scene = Scene::new(athlete(), map, &[]).expect("a scene without obstacles");
    let level = Scene::new(scene.robot().clone(), level, &[]).expect("a scene without obstacles");
    let start = seated(&scene);
    let level_start = seated(&level);
    let legs: Vec<LegId> = scene.robot().leg_ids().collect();
    let options =
        ReachOptions { resolution: 0.02, lift: LIFT, workers: 2, ..ReachOptions::default() };
    let mut group = c.benchmark_group("reach");
    group.sample_size(10);
    let boulder = one_boulder(scene.robot().clone());
    let boulder_start = seated(&boulder);
    let grounds = [
        ("", &scene, &start),
        (", level ground", &level, &level_start),
        (", one boulder", &boulder, &boulder_start),
    ];
    for (ground, scene, start) in grounds {
        for (name, legs) in [("one leg", &legs[..1]), ("six legs", &legs[..])] {
            let cells = legs.iter().map(|leg| places(scene, start, *leg, 0.02).len() as u64);
            group.throughput(Throughput::Elements(cells.sum()));
            for (threads, workers) in [("one thread", 1), ("two threads", 2)] {
                if (legs.len(), workers) == (6, 1) {
                    continue; // six times the first
                }
                let options = ReachOptions { workers, ..options };
                group.bench_function(format!("{name}{ground}, 2 cm cells, {threads}"), |b| {
                    b.iter(|| reach_legs(scene, start, GRAVITY, legs, &options, &|| false));
                });
            }
        }
    }
    let before = reach(&scene, &start, GRAVITY, LEG, &options, &|| false).expect("not stopped");
    let near = Area { min: Point2::new(2.6, 0.5), max: Point2::new(3.1, 1.0) };
    let far = Area { min: Point2::new(-4.0, -0.5), max: Point2::new(-3.5, 0.0) };
    for (name, changed) in
        [("half a meter square changed", near), ("ground out of reach changed", far)]
    {
        group.throughput(Throughput::Elements(places(&scene, &start, LEG, 0.02).len() as u64));
        group.bench_function(format!("again: one leg, {name}, 2 cm cells, two threads"), |b| {
            b.iter(|| {
                let never = || false;
                reach_again(&before, &changed, &scene, &start, GRAVITY, LEG, &options, &never)
            });
        });
    }
    let coarse = ReachOptions { resolution: 0.14, workers: 1, ..options };
    group.throughput(Throughput::Elements(places(&scene, &start, LEG, 0.14).len() as u64));
    group.bench_function("one leg, 14 cm cells, one thread", |b| {
        b.iter(|| reach(&scene, &start, GRAVITY, LEG, &coarse, &|| false));
    });
    group.bench_function("one leg, 14 cm cells, one thread (baseline)", |b| {
        b.iter(|| straightforward(&scene, &start, 0.14));
    });
    group.finish();
    c.bench_function("explain/one refused cell, with mends", |b| {
        let p = Point2::new(3.4, 0.2);
        b.iter(|| explain(&scene, &start, GRAVITY, LEG, p, &options));
    });
}

criterion_group!(group, benches);
criterion_main!(group);
