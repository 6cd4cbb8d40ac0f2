//! Steps: around a rock on level ground, and over seeded scenes of all kinds.
//!
//! Baselines: for shifts of the body the exact survey every 0.01 rad; in `step` the final check of a step of two centimeters, which is part of every step;
//! over the seeded scenes SBL as published, whose edges are looked at every 0.01 rad and whose
//! smoothing ends when a round wins less than 25 % (F67, F78). One run takes all scenes, so that no
//! single one decides; a rate is steps a second.

use std::sync::Arc;
use std::time::{Duration, Instant};

use collision::{Obstacle, Scene};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use motion::smooth::SmoothOptions;
use motion::trial::{Kind, Trial, draw};
use motion::{
    BodyClear, CertifiedBody, EdgeRule, Planner, SampledBody, Stage, StepRequest, Target,
    Unwatched, Watch, plan_step,
};
use nalgebra::{Isometry3, Point3, Vector3};
use rover::{LegId, Payload, Posture, Robot};
use terrain::ElevationMap;

const MOON: f64 = 1.62;

/// Scenes of each kind.
const SCENES: u64 = 4;

fn athlete() -> Robot {
    let folder = "robots/athlete/";
    let robot = Robot::from_folder(
        &testkit::fixture_text(&format!("{folder}robot.toml")),
        |file| Some(testkit::fixture_text(&format!("{folder}{file}"))),
        |_| None,
    );
    robot.expect("the fixture loads")
}

/// Takes the time until the first path is found.
struct FirstPath {
    begun: Instant,
    took: Option<Duration>,
}

impl Watch for FirstPath {
    fn entered(&mut self, stage: Stage) {
        if stage == Stage::Smoothing && self.took.is_none() {
            self.took = Some(self.begun.elapsed());
        }
    }
}

/// How long a request takes until its first path, or until its end.
#[allow(clippy::disallowed_methods)] // a stage within a call is timed where it is entered
fn time(trial: &Trial, request: &StepRequest, whole: bool) -> Duration {
    let mut watch = FirstPath { begun: Instant::now(), took: None };
    std::hint::black_box(plan_step(&trial.scene, &trial.start, MOON, request, &mut watch));
    let all = watch.begun.elapsed();
    if whole { all } else { watch.took.unwrap_or(all) }
}

/// The request as published.
fn published(trial: &Trial) -> StepRequest {
    let smooth = SmoothOptions {
        stop_reduction: 0.25,
        max_rounds: 100,
        max_edges: 100_000,
        max_checked: u64::MAX,
        max_taut_rounds: 0,
    };
    StepRequest { edges: EdgeRule::Sampled(0.01), smooth, ..trial.request(Planner::Sbl) }
}

fn over_seeded_scenes(c: &mut Criterion) {
    let (com, edges) = (Point3::new(0.0, 0.0, 0.25), Vector3::new(1.2, 1.2, 0.5));
    let payload = Payload::boxed("chassis", 300.0, com, edges);
    let robot = Arc::new(athlete().with_payloads(&[payload]).expect("the chassis carries it"));
    let all = Kind::ALL.into_iter().flat_map(|kind| (0..SCENES).map(move |seed| (kind, seed)));
    let trials: Vec<Trial> =
        all.filter_map(|(kind, seed)| draw(&robot, MOON, kind, seed)).collect();
    type Way<'w> = (&'w str, &'w dyn Fn(&Trial) -> StepRequest);
    let ways: [Way; 3] = [
        ("automatic", &|trial| trial.request(Planner::Auto)),
        ("SBL", &|trial| trial.request(Planner::Sbl)),
        ("SBL as published (baseline)", &published),
    ];
    let mut seed = 0;
    for (name, whole) in [("first path of a step", false), ("whole step", true)] {
        let mut group = c.benchmark_group(name);
        group.sample_size(10).throughput(Throughput::Elements(trials.len() as u64));
        for (way, request) in ways {
            let requests: Vec<StepRequest> = trials.iter().map(request).collect();
            group.bench_function(format!("mixed scenes, {way}"), |b| {
                b.iter_custom(|n| {
                    let all = (0..n).map(|_| {
                        seed += 1;
                        let steps = trials.iter().zip(&requests);
                        let of = |(trial, request): (&Trial, &StepRequest)| {
                            time(trial, &StepRequest { seed, ..request.clone() }, whole)
                        };
                        steps.map(of).sum::<Duration>()
                    });
                    all.sum()
                });
            });
        }
        group.finish();
    }
}

fn around_a_rock(c: &mut Criterion) {
    let robot = Arc::new(athlete());
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
                plan_step(&scene, &start, MOON, &request, &mut Unwatched)
            });
        });
    }
    request.target = Target::Ground(Point3::new(low.x, low.y + 0.02, 0.0));
    group.bench_function("two centimeters aside (baseline)", |b| {
        b.iter(|| plan_step(&scene, &start, MOON, &request, &mut Unwatched));
    });
    group.finish();
}

/// A level shift of 0.15 m in eight pieces beside a rock, whether it is free; and one configuration.
fn shift_of_the_body(c: &mut Criterion) {
    let robot = Arc::new(athlete());
    let mut start = robot.pose("bent").expect("the fixture has the pose");
    let low = Posture::new(&robot, &start).wheel(&robot, LegId(0)).lowest_point(&Vector3::z_axis());
    start.world_from_base.translation.z = -low.z;
    let rock = Obstacle::Box {
        world_from_box: Isometry3::translation(0.0, 1.75, 0.6),
        half_extents: Vector3::new(0.3, 0.1, 0.6),
    };
    let map = ElevationMap::plane(20.0, 0.25).expect("a plane is a map");
    let scene = Scene::new(robot.clone(), map, &[rock]).expect("a box is a good obstacle");
    let legs: Vec<LegId> = robot.leg_ids().collect();
    let planted = Posture::new(&robot, &start);
    let knot = |i: u32| {
        let mut knot = start.clone();
        knot.world_from_base.translation.y += 0.15 * f64::from(i) / 8.0;
        let there = Posture::new(&robot, &knot);
        for leg in &legs {
            let wheel = planted.wheel(&robot, *leg).world_from_wheel;
            let all = there.inverse_kinematics(&robot, *leg, &wheel).expect("the legs reach");
            let change = |q: &rover::LegAngles| (q - start.legs[leg.0]).amax();
            let nearest =
                all.iter().map(|s| s.angles).min_by(|a, b| change(a).total_cmp(&change(b)));
            knot.legs[leg.0] = nearest.expect("there is a branch");
        }
        knot
    };
    let knots: Vec<_> = (0..=8).map(knot).collect();
    let mut group = c.benchmark_group("shift of the body");
    let mut certified = CertifiedBody::new(&scene, &start, &legs);
    let mut sampled = SampledBody::new(&scene, &start, &legs);
    let bodies: [(&str, &mut dyn BodyClear); 2] =
        [("certified", &mut certified), ("sampled at 0.01 rad (baseline)", &mut sampled)];
    for (name, body) in bodies {
        group.bench_function(format!("0.15 m beside a rock, {name}"), |b| {
            b.iter(|| knots.windows(2).try_for_each(|w| body.piece(&w[0], &w[1])).expect("free"));
        });
        group.bench_function(format!("one configuration, {name}"), |b| {
            b.iter(|| body.piece(&knots[4], &knots[4]).expect("free"));
        });
    }
    group.finish();
}

criterion_group!(step, around_a_rock, shift_of_the_body, over_seeded_scenes);
criterion_main!(step);
