//! Regions, energy and torques of six contacts, beside linear programs of a stock solver that do
//! the same: a region by its reach in 24 directions, the least largest torque in forces.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use microlp::{ComparisonOp, OptimizationDirection, Problem, Variable};
use nalgebra::{Isometry3, Point3, Unit, Vector3};
use rover::{Configuration, LegId, Posture, Robot};
use stability::contact_forces::{LegStatics, least_torque};
use stability::force_region::{cones, conservative, region};
use stability::{
    ConeModel, Contact, ContactError, ForceSet, KeptRegion, energy, report, support_polygon,
};

/// Six contacts near the corners of a hexagon of 2.2 m radius, on uneven ground.
fn contacts() -> Vec<Contact> {
    (0..6_u32)
        .map(|i| {
            let k = f64::from(i);
            let yaw = std::f64::consts::TAU * k / 6.0 + 0.05 * f64::from(i % 2);
            let radius = 2.2 + 0.1 * f64::from(i % 3);
            let normal = Vector3::new(0.15 * (2.0 * k).sin(), 0.15 * (3.0 * k).cos(), 1.0);
            Contact {
                position: Point3::new(
                    radius * yaw.cos(),
                    radius * yaw.sin(),
                    0.1 * f64::from(i % 4),
                ),
                normal: Unit::new_normalize(normal),
                friction: 0.7,
            }
        })
        .collect()
}

type Edge = (usize, Vector3<f64>, Vector3<f64>);

/// Contact, point and direction of all edges of all cones.
fn edges(contacts: &[Contact]) -> Vec<Edge> {
    let cone = ConeModel::default();
    let all = |(i, c): (usize, &Contact)| {
        let rays = cone.rays(c, &Point3::origin());
        rays.into_iter().map(|f| (i, c.position.coords, f.normalize())).collect::<Vec<_>>()
    };
    contacts.iter().enumerate().flat_map(all).collect()
}

fn reach_by_stock_solver(edges: &[Edge], a: f64, b: f64) -> f64 {
    let mut problem = Problem::new(OptimizationDirection::Maximize);
    let mut rows: [Vec<(Variable, f64)>; 4] = Default::default();
    for (_, p, f) in edges {
        let moment = p.cross(f);
        let share = problem.add_var(b * moment.x - a * moment.y, (0.0, f64::INFINITY));
        let parts = [f.x, f.y, f.z, moment.z];
        rows.iter_mut().zip(parts).for_each(|(row, part)| row.push((share, part)));
    }
    for (row, sum) in rows.iter().zip([0.0, 0.0, 1.0, 0.0]) {
        problem.add_constraint(row, ComparisonOp::Eq, sum);
    }
    problem.solve().ok().and_then(|o| o.into_solution().ok()).map_or(f64::NAN, |s| s.objective())
}

fn torque_by_stock_solver(
    legs: &[LegStatics],
    edges: &[Edge],
    com: &Point3<f64>,
    weight: f64,
) -> f64 {
    let mut problem = Problem::new(OptimizationDirection::Minimize);
    let most = problem.add_var(1.0, (0.0, f64::INFINITY));
    let mut rows: [Vec<(Variable, f64)>; 6] = Default::default();
    let mut shares = Vec::new();
    for (leg, p, f) in edges {
        let share = problem.add_var(0.0, (0.0, f64::INFINITY));
        let moment = (p - com.coords).cross(f);
        let parts = [f.x, f.y, f.z, moment.x, moment.y, moment.z];
        rows.iter_mut().zip(parts).for_each(|(row, part)| row.push((share, part)));
        shares.push((*leg, share, *f));
    }
    for (i, leg) in legs.iter().enumerate() {
        for joint in 0..leg.own.len() {
            for sign in [1.0, -1.0] {
                let mut row = vec![(most, -1.0)];
                row.extend(shares.iter().filter(|(of, _, _)| *of == i).map(|(_, share, f)| {
                    let torque: f64 = (0..3).map(|k| leg.per_force[k][joint] * f[k]).sum();
                    (*share, sign * torque * weight / leg.limits[joint])
                }));
                let own = sign * leg.own[joint] / leg.limits[joint];
                problem.add_constraint(&row, ComparisonOp::Le, -own);
            }
        }
    }
    for (row, sum) in rows.iter().zip([0.0, 0.0, 1.0, 0.0, 0.0, 0.0]) {
        problem.add_constraint(row, ComparisonOp::Eq, sum);
    }
    problem.solve().ok().and_then(|o| o.into_solution().ok()).map_or(f64::NAN, |s| s.objective())
}

/// The friction region while one foot goes to and fro: the same sets, kept and anew.
fn one_foot_moved(c: &mut Criterion) {
    let contacts = contacts();
    let cone = ConeModel::default();
    let mut group = c.benchmark_group("friction region with one foot moved");
    let sum = contacts.iter().map(|c| c.position.coords).sum::<Vector3<f64>>();
    let middle = Point3::from(sum / 6.0);
    let set = |c: &Contact| ForceSet::cone(c, &middle, cone);
    let ends = [0.0, 0.15].map(|shift| {
        let position = contacts[2].position + Vector3::new(shift, -0.5 * shift, 0.2 * shift);
        set(&Contact { position, ..contacts[2] })
    });
    let mut sets: Vec<ForceSet> = contacts.iter().map(set).collect();
    let mut turns = ends.iter().cycle();
    group.bench_function("all anew (baseline)", |b| {
        b.iter(|| {
            sets[2] = turns.next().cloned().unwrap_or_else(|| ends[0].clone());
            region(black_box(&sets), 1.0)
        });
    });
    let mut kept = KeptRegion::new(sets.clone()).expect("the contacts are sound");
    group.bench_function("kept", |b| {
        b.iter(|| {
            let set = turns.next().cloned().unwrap_or_else(|| ends[0].clone());
            black_box(&mut kept).moved(2, set).map(|found| found.bearing.len())
        });
    });
    group.finish();
}

fn polygons(c: &mut Criterion) {
    let contacts = contacts();
    let points: Vec<Point3<f64>> = contacts.iter().map(|c| c.position).collect();
    let com = Point3::new(0.1, -0.05, 1.2);
    let cone = ConeModel::default();
    let mut group = c.benchmark_group("polygons of six contacts");
    group.bench_function("regular, conservative, friction, and energy margin", |b| {
        b.iter(|| -> Result<_, ContactError> {
            let contacts = black_box(&contacts);
            let friction = region(&cones(contacts, cone)?, 1.0)?;
            let regular = support_polygon::regular(&points);
            let conservative = support_polygon::conservative(&points);
            Ok((regular, conservative, friction, energy::margin(&points, &com)))
        });
    });
    group.bench_function("friction region", |b| {
        b.iter(|| region(&cones(black_box(&contacts), cone)?, 1.0));
    });
    group.bench_function("friction region that survives any loss", |b| {
        b.iter(|| conservative(&cones(black_box(&contacts), cone)?, 1.0));
    });
    let edges = edges(&contacts);
    group.bench_function("friction, 24 directions by a stock solver (baseline)", |b| {
        b.iter(|| {
            let at = |i: u32| (std::f64::consts::TAU * f64::from(i) / 24.0).sin_cos();
            (0..24).map(|i| reach_by_stock_solver(&edges, at(i).1, at(i).0)).sum::<f64>()
        });
    });
    group.finish();
}

/// The robot that ships, bent, level, on the legs named.
fn stance(legs: &[usize]) -> (Robot, Posture, Vec<(LegId, Contact)>) {
    let folder = "robots/athlete/";
    let robot = Robot::from_folder(
        &testkit::fixture_text(&format!("{folder}robot.toml")),
        |file| Some(testkit::fixture_text(&format!("{folder}{file}"))),
        |_| None,
    )
    .expect("the fixture loads");
    let at_origin = robot.pose("bent").expect("the fixture has it");
    let lift = -Posture::new(&robot, &at_origin)
        .wheel(&robot, LegId(0))
        .lowest_point(&Vector3::z_axis())
        .z;
    let world_from_base = Isometry3::translation(0.0, 0.0, lift);
    let posture = Posture::new(&robot, &Configuration { world_from_base, ..at_origin });
    let feet = legs
        .iter()
        .map(|leg| {
            let touch = posture.wheel(&robot, LegId(*leg)).lowest_point(&Vector3::z_axis());
            (LegId(*leg), Contact::level(touch, 0.7))
        })
        .collect();
    (robot, posture, feet)
}

fn torques(c: &mut Criterion) {
    let (robot, posture, feet) = stance(&[1, 2, 3, 4, 5]);
    let gravity = 9.81;
    let legs: Vec<LegStatics> = feet
        .iter()
        .map(|(leg, c)| LegStatics::new(&robot, &posture, *leg, &c.position, gravity))
        .collect();
    let contacts: Vec<Contact> = feet.iter().map(|(_, c)| *c).collect();
    let (com, weight) = (posture.center_of_mass(&robot), robot.mass() * gravity);
    let cone = ConeModel::default();
    let mut group = c.benchmark_group("torques of a stance on five legs");
    group.bench_function("least largest torque", |b| {
        b.iter(|| least_torque(black_box(&legs), &contacts, &com, weight, cone));
    });
    group.bench_function("torque region", |b| {
        b.iter(|| report::torque_region(black_box(&legs), &contacts, weight, cone));
    });
    group.bench_function("the whole report", |b| {
        b.iter(|| report::forces(&robot, black_box(&posture), &feet, gravity, cone));
    });
    let edges = edges(&contacts);
    group.bench_function("least largest torque by a stock solver (baseline)", |b| {
        b.iter(|| torque_by_stock_solver(black_box(&legs), &edges, &com, weight));
    });
    group.finish();
}

criterion_group!(forces, polygons, one_foot_moved, torques);
criterion_main!(forces);
