//! One whole step over level ground with a rock, and its transit alone.
//!
//! Baseline: the final check of the finished step, which is part of the whole.

use std::sync::Arc;

use collision::{Obstacle, Scene};
use criterion::{Criterion, criterion_group, criterion_main};
use motion::{Planner, StepRequest, Target, Unwatched, plan_step};
use nalgebra::{Isometry3, Point3, Vector3};
use rover::{LegId, Posture, Robot};
use terrain::ElevationMap;

fn benches(c: &mut Criterion) {
    let folder = "robots/athlete/";
    let robot = Robot::from_folder(
        &testkit::fixture_text(&format!("{folder}robot.toml")),
        |file| Some(testkit::fixture_text(&format!("{folder}{file}"))),
        |_| None,
    );
    let robot = Arc::new(robot.expect("the fixture loads"));
    let mut start = robot.pose("bent").expect("the fixture has the pose");
    let low = Posture::new(&robot, &start).wheel(&robot, LegId(0)).lowest_point(&Vector3::z_axis());
    start.world_from_base.translation.z = -low.z;
    let rock = Obstacle::Box {
        world_from_box: Isometry3::translation(low.x, low.y + 0.45, 0.3),
        half_extents: Vector3::new(0.3, 0.08, 0.3),
    };
    let map = ElevationMap::plane(20.0, 0.25).expect("a plane is a map");
    let scene = Scene::new(robot.clone(), map, &[rock]).expect("a box is a good obstacle");
    let target = Target::Ground(Point3::new(low.x, low.y + 0.95, 0.0));
    let mut request = StepRequest::new(LegId(0), target, 1.0);
    let mut seed = 0;
    let mut group = c.benchmark_group("step");
    group.sample_size(10);
    for (name, planner) in
        [("around a rock, automatic", Planner::Auto), ("around a rock, SBL", Planner::Sbl)]
    {
        request.planner = planner;
        group.bench_function(name, |b| {
            b.iter(|| {
                seed += 1;
                request.seed = seed;
                plan_step(&scene, &start, 1.62, &request, &mut Unwatched)
            });
        });
    }
    request.target = Target::Ground(Point3::new(low.x, low.y + 0.02, 0.0));
    group.bench_function("two centimeters aside (baseline)", |b| {
        b.iter(|| plan_step(&scene, &start, 1.62, &request, &mut Unwatched));
    });
    group.finish();
}

criterion_group!(step, benches);
criterion_main!(step);
