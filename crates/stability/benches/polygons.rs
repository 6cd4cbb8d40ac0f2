//! Polygons, settlement, loads and the prepared rule of 6 contacts.

use criterion::{Criterion, criterion_group, criterion_main};
use nalgebra::Point3;
use rover::StanceRules;
use stability::loads::{LegSpring, SpringError, StanceSprings};
use stability::{Preference, StanceGuard, loads, settlement, support_polygon};

/// Six contacts near the corners of a hexagon of 2.2 m radius, on uneven ground.
fn contacts() -> Vec<Point3<f64>> {
    (0..6_u32)
        .map(|i| {
            let yaw = std::f64::consts::TAU * f64::from(i) / 6.0 + 0.05 * f64::from(i % 2);
            let radius = 2.2 + 0.1 * f64::from(i % 3);
            Point3::new(radius * yaw.cos(), radius * yaw.sin(), 0.1 * f64::from(i % 4))
        })
        .collect()
}

fn benches(c: &mut Criterion) {
    let contacts = contacts();
    let com = Point3::new(0.1, -0.05, 1.2);
    c.bench_function("stability/regular polygon of 6 contacts", |b| {
        b.iter(|| support_polygon::regular(&contacts));
    });
    c.bench_function("stability/regular + conservative polygon of 6 contacts", |b| {
        b.iter(|| (support_polygon::regular(&contacts), support_polygon::conservative(&contacts)));
    });
    c.bench_function("stability/worst settlement of 6 contacts", |b| {
        b.iter(|| settlement::worst(&contacts, &com, 0.1));
    });
    let rules = StanceRules {
        leg_stiffness: 15_000.0,
        margin: 0.15,
        settlement: 0.1,
        ground_tolerance: 0.02,
        contact_radius: 0.15,
        contact_height: 0.05,
        camber_limit: 0.35,
    };
    let guard = StanceGuard::new(&contacts, &rules, Preference::Regular);
    c.bench_function("stability/the prepared rule over 6 contacts, one center of mass", |b| {
        b.iter(|| guard.as_ref().map(|guard| guard.spare(std::hint::black_box(&com))));
    });
    c.bench_function("stability/spring loads of 6 contacts", |b| {
        b.iter(|| loads::spring_share(&contacts, &com, 1000.0));
    });
    let springs: Vec<LegSpring> = (0..6_u32)
        .map(|i| LegSpring { stiffness_n_m: 12_000.0 + 900.0 * f64::from(i), pressed_m: 0.0 })
        .collect();
    let error = SpringError { stiffness: 0.2, height_m: 0.003 };
    c.bench_function("stability/loads of 6 contacts with all errors, from the start", |b| {
        b.iter(|| loads::load_band(&contacts, &com, 1000.0, &springs, &error));
    });
    let springs = StanceSprings::new(&contacts, 1000.0, &springs, &error);
    c.bench_function("stability/the same prepared, one center of mass", |b| {
        b.iter(|| springs.as_ref().map(|s| s.band(std::hint::black_box(&com))));
    });
}

criterion_group!(polygons, benches);
criterion_main!(polygons);
