//! One configuration of a moving leg against ground, one boulder and the rest of the robot.
//!
//! Load of the budget: half of the configurations uniform within the limits, half within 0.5 rad
//! of the pose. The baseline is forward kinematics of the same leg.

use std::sync::Arc;

use collision::{Allowance, Certifier, LegChecker, Obstacle, Scene};
use criterion::{Criterion, criterion_group, criterion_main};
use nalgebra::{Isometry3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rover::{LegAngles, LegId, Posture, Robot};

fn benches(c: &mut Criterion) {
    let folder = "robots/athlete/";
    let robot = Robot::from_folder(
        &testkit::fixture_text(&format!("{folder}robot.toml")),
        |file| Some(testkit::fixture_text(&format!("{folder}{file}"))),
        |_| None,
    );
    let robot = Arc::new(robot.expect("the fixture loads"));
    let map = terrain::synthetic::generate(&terrain::synthetic::Recipe::boulder_field(), 7)
        .expect("the recipe is good");
    let rock = Obstacle::Box {
        world_from_box: Isometry3::translation(2.6, 0.4, 0.3),
        half_extents: Vector3::new(0.3, 0.3, 0.3),
    };
    let scene = Scene::new(robot.clone(), map, &[rock]).expect("a box is a good obstacle");
    let mut base = robot.pose("bent").expect("the fixture has the pose");
    base.world_from_base.translation.z = 1.8;
    let posture = Posture::new(&robot, &base);
    let leg = LegId(0);
    let model = robot.leg(leg);
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let configurations: Vec<LegAngles> = (0..1000)
        .map(|i| {
            if i % 2 == 0 {
                LegAngles::from_fn(|j, _| rng.random_range(model.lower[j]..model.upper[j]))
            } else {
                base.legs[0] + LegAngles::from_fn(|_, _| rng.random_range(-0.5..0.5))
            }
        })
        .collect();
    let checker = LegChecker::new(&scene, &posture, leg, None, None);
    let mut moved = posture.clone();
    let mut i = 0;
    c.bench_function("leg_check/one configuration with tolerances", |b| {
        b.iter(|| {
            i = (i + 1) % configurations.len();
            checker.violation_at(&configurations[i], Allowance::default())
        });
    });
    let mut certifier = Certifier::new(&checker);
    let free: Vec<LegAngles> = configurations
        .iter()
        .filter(|q| checker.violation_at(q, Allowance::default()).is_none())
        .copied()
        .collect();
    eprintln!("{} of {} free", free.len(), configurations.len());
    let mut looked = 0;
    let mut edges = 0;
    c.bench_function("leg_check/one edge of 0.3 rad certified", |b| {
        b.iter(|| {
            i = (i + 1) % free.len();
            let q = free[i];
            let step = LegAngles::from_fn(|j, _| if (i >> j) & 1 == 0 { 0.3 } else { -0.3 });
            let before = certifier.n_looked();
            let answer = certifier.certify(&q, &(q + step), Allowance::default());
            looked += certifier.n_looked() - before;
            edges += 1;
            answer
        });
    });
    eprintln!("{} pieces an edge", looked as f64 / edges as f64);
    c.bench_function("leg_check/forward kinematics of the leg (baseline)", |b| {
        b.iter(|| {
            i = (i + 1) % configurations.len();
            moved.move_leg(&robot, leg, &configurations[i]);
        });
    });
}

criterion_group!(leg_check, benches);
criterion_main!(leg_check);
