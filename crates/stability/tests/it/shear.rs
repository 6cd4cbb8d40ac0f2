//! What contacts give to accelerations, against closed forms and another author's linear programs.

use std::f64::consts::TAU;

use crate::linear;
use microlp::{ComparisonOp, OptimizationDirection, Problem, Variable};
use nalgebra::{Point3, Unit, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use stability::{ConeBound, ConeModel, Contact, Footholds, Wrench};

const FINE: ConeModel = ConeModel { edges: 64, bound: ConeBound::Inner };

fn wrench(force: Vector3<f64>, moment: Vector3<f64>) -> Wrench {
    Wrench { force, moment }
}

/// A level regular hexagon of this radius (m).
fn hexagon(radius: f64, friction: f64) -> Vec<Contact> {
    let at = |k: u32| {
        let azimuth = TAU * f64::from(k) / 6.0;
        Point3::new(radius * azimuth.cos(), radius * azimuth.sin(), 0.0)
    };
    (0..6).map(|k| Contact::level(at(k), friction)).collect()
}

#[test]
fn level_feet_give_the_friction_sideways_and_that_times_their_radius_as_a_twist() {
    let (radius, friction) = (2.0, 0.3);
    let feet = Footholds::new(&hexagon(radius, friction), FINE).unwrap();
    let com = Point3::origin();
    let (zero, x, z) = (Vector3::zeros(), Vector3::x(), Vector3::z());
    // A cone of 64 edges gives up to 1 - cos(π / 64) less.
    let near = |found: f64, expected: f64| {
        assert!(found <= expected + 1e-9 && found > 0.998 * expected, "{found} of {expected}");
    };
    near(feet.most(&com, &wrench(x, zero)), friction);
    near(feet.most(&com, &wrench(x * 5.0, zero)), friction / 5.0);
    near(feet.most(&com, &wrench(zero, z)), friction * radius);
    near(feet.most(&com, &wrench(zero, -z)), friction * radius);
    // Sinking with g no foot bears anything.
    near(feet.most(&com, &wrench(-z, zero)), 1.0);
    // Up, the cap on all forces is what ends it: rays of length 1 along the cone or steeper.
    let up = feet.most(&com, &wrench(z, zero));
    assert!(up > 90.0 && up < 99.0 + 1e-9, "{up}");
    // Above the ground the same force tips as well: at height h beyond x = radius cos 30° / h.
    let high = feet.most(&Point3::new(0.0, 0.0, 10.0), &wrench(Vector3::y(), zero));
    near(high, radius * 30_f64.to_radians().cos() / 10.0);
}

#[test]
fn without_friction_there_is_no_force_sideways_and_nothing_asked_for_has_no_end() {
    let feet = Footholds::new(&hexagon(2.0, 0.0), FINE).unwrap();
    let (com, zero) = (Point3::origin(), Vector3::zeros());
    assert_eq!(feet.most(&com, &wrench(Vector3::x(), zero)), 0.0);
    assert_eq!(feet.most(&com, &wrench(zero, Vector3::z())), 0.0);
    assert!((feet.most(&com, &wrench(-Vector3::z(), zero)) - 1.0).abs() < 1e-6);
    assert_eq!(feet.most(&com, &wrench(zero, zero)), f64::INFINITY);
    assert_eq!(feet.most(&com, &wrench(Vector3::x() * f64::NAN, zero)), 0.0);
    // Beyond the feet it tips at rest.
    assert_eq!(feet.most(&Point3::new(3.0, 0.0, 1.0), &wrench(-Vector3::x(), zero)), 0.0);
    assert!(Footholds::new(&[], FINE).is_none());
}

/// The same by a solver of another author over the given rays; `None` if nothing is held.
fn oracle(
    contacts: &[Contact],
    rays: &[Vec<Vector3<f64>>],
    com: &Point3<f64>,
    more: &Wrench,
) -> Option<f64> {
    let mut problem = Problem::new(OptimizationDirection::Maximize);
    let mut rows: [Vec<(Variable, f64)>; 6] = Default::default();
    let mut cap = Vec::new();
    for (contact, rays) in contacts.iter().zip(rays) {
        for ray in rays {
            let f = *ray;
            let moment = (contact.position - com).cross(&f);
            let share = problem.add_var(0.0, (0.0, f64::INFINITY));
            let parts = [f.x, f.y, f.z, moment.x, moment.y, moment.z];
            rows.iter_mut().zip(parts).for_each(|(row, part)| row.push((share, part)));
            cap.push((share, 1.0));
        }
    }
    let t = problem.add_var(1.0, (0.0, 1e3));
    let taken = more.force.iter().chain(more.moment.iter());
    rows.iter_mut().zip(taken).for_each(|(row, part)| row.push((t, -part)));
    for (row, sum) in rows.iter().zip([0.0, 0.0, 1.0, 0.0, 0.0, 0.0]) {
        problem.add_constraint(row, ComparisonOp::Eq, sum);
    }
    problem.add_constraint(&cap, ComparisonOp::Le, 100.0);
    match problem.solve() {
        Ok(outcome) => Some(outcome.into_solution().expect("no limit is set").objective()),
        Err(_) => None,
    }
}

#[test]
fn random_stances_give_what_another_solver_says() {
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let mut n_held = 0;
    for case in 0..300 {
        let n = rng.random_range(3..=6);
        let mut number = |size: f64| rng.random_range(-size..size);
        let mut contacts = Vec::new();
        for _ in 0..n {
            let position = Point3::new(number(2.0), number(2.0), number(0.3));
            let normal = Vector3::new(number(0.4), number(0.4), 1.0);
            let friction = 0.4 + number(0.4);
            contacts.push(Contact { position, normal: Unit::new_normalize(normal), friction });
        }
        let middle = contacts.iter().map(|c| c.position.coords).sum::<Vector3<f64>>() / n as f64;
        let com = Point3::from(middle) + Vector3::new(number(0.3), number(0.3), 1.0);
        let mut vector = |size: f64| Vector3::new(number(size), number(size), number(size));
        let more = wrench(vector(1.0), vector(1.0));
        let cone = ConeModel::default();
        let rays: Vec<_> = contacts.iter().map(|c| linear::edges(c, &contacts, 8)).collect();
        // What is not held at rest may yet be held in motion: that does not count.
        let nothing = wrench(Vector3::zeros(), Vector3::zeros());
        let at_rest = oracle(&contacts, &rays, &com, &nothing).is_some();
        let moving = oracle(&contacts, &rays, &com, &more).unwrap_or(0.0);
        let expected = if at_rest { moving } else { 0.0 };
        let found = Footholds::new(&contacts, cone).unwrap().most(&com, &more);
        assert!((found - expected).abs() < 1e-6 * (1.0 + expected), "{case}: {found} {expected}");
        n_held += usize::from(found > 0.0);
    }
    assert!((100..300).contains(&n_held), "{n_held}");
}
