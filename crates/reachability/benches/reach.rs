//! Reachability of one leg over a boulder field; budget: 50 ms at 2 cm cells on two cores.
//!
//! Baseline: the touch-down candidates of one cell, which every cell needs.

use std::sync::Arc;

use collision::{Scene, touchdowns};
use criterion::{Criterion, criterion_group, criterion_main};
use nalgebra::{Point2, Vector3};
use reachability::{ReachOptions, reach};
use rover::{LegId, Posture, Robot};
use stability::rule::Preference;

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
    let mut start = robot.pose("bent").expect("the fixture has the pose");
    let low = Posture::new(&robot, &start).wheel(&robot, LegId(0)).lowest_point(&Vector3::z_axis());
    start.world_from_base.translation.z = -low.z;
    let scene = Scene::new(robot.clone(), map, &[]).expect("a scene without obstacles");
    let posture = Posture::new(&robot, &start);
    let mut group = c.benchmark_group("reach");
    group.sample_size(10);
    group.bench_function("one leg, 10 cm cells, two threads", |b| {
        let preference = Preference::Regular;
        let options = ReachOptions { resolution: 0.1, lift: 0.2, preference, workers: 2 };
        b.iter(|| reach(&scene, &start, 1.62, LegId(0), &options, &|| false));
    });
    group.bench_function("touch-downs of one cell (baseline)", |b| {
        b.iter(|| {
            let p = Point2::new(2.3, 0.2);
            touchdowns(&scene, &posture, LegId(0), p, &start.legs[0], 6)
        });
    });
    group.finish();
}

criterion_group!(group, benches);
criterion_main!(group);
