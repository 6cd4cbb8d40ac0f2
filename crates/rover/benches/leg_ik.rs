//! Closed-form leg IK, all branches; budget: 1 µs a call.

use criterion::{Criterion, criterion_group, criterion_main};
use nalgebra::Isometry3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rover::{Configuration, LegAngles, LegId, Posture, Robot};

fn load() -> Robot {
    let folder = "robots/athlete/";
    Robot::from_folder(
        &testkit::fixture_text(&format!("{folder}robot.toml")),
        |file| Some(testkit::fixture_text(&format!("{folder}{file}"))),
        |_| None,
    )
    .expect("the fixture loads")
}

fn benches(c: &mut Criterion) {
    let robot = load();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let base = Configuration {
        world_from_base: Isometry3::identity(),
        legs: vec![LegAngles::zeros(); robot.legs().len()],
    };
    let posture = Posture::new(&robot, &base);
    let leg = robot.leg(LegId(0));
    let targets: Vec<Isometry3<f64>> = (0..1000)
        .map(|_| {
            let q = LegAngles::from_fn(|i, _| rng.random_range(leg.lower[i]..leg.upper[i]));
            posture.with_leg(&robot, LegId(0), &q).wheel(&robot, LegId(0)).world_from_wheel
        })
        .collect();
    let mut i = 0;
    c.bench_function("leg_ik/all branches of one wheel pose", |b| {
        b.iter(|| {
            i = (i + 1) % targets.len();
            leg.ik.solve(leg, &targets[i])
        });
    });
    c.bench_function("leg_ik/forward kinematics of one leg (baseline)", |b| {
        let mut moved = posture.clone();
        let q = LegAngles::from_element(0.3);
        b.iter(|| moved.move_leg(&robot, LegId(0), &q));
    });
}

criterion_group!(leg_ik, benches);
criterion_main!(leg_ik);
