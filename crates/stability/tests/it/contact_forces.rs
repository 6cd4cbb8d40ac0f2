//! Forces, torques and slip, against linear programs, closed forms and published figures.

use std::f64::consts::TAU;

use geometry::ConvexRegion;
use nalgebra::{Point3, Unit, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use stability::contact_forces::{LegStatics, least_norm, least_torque, slip_margin};
use stability::force_region::{cones, region};
use stability::report::{forces, torque_region};
use stability::{ConeBound, ConeModel, Contact, torque};

use crate::linear::{least_ratio, spread_forces, torque_support};
use crate::slopes::{extent_of, flat_hexagon, level, stance};
use crate::{athlete, contacts, loaded, on_plane};

/// How far forces are from balance and from the true cones, in weights.
fn misfit(contacts: &[Contact], com: &Point3<f64>, weight: f64, forces: &[Vector3<f64>]) -> f64 {
    let mut force = Vector3::new(0.0, 0.0, -weight);
    let mut moment = Vector3::zeros();
    let mut worst: f64 = 0.0;
    for (c, f) in contacts.iter().zip(forces) {
        force += f;
        moment += (c.position - com).cross(f);
        let along = f.dot(&c.normal);
        let across = (f - c.normal.into_inner() * along).norm();
        worst = worst.max(across - c.friction * along).max(-along);
    }
    worst.max(force.amax()).max(moment.amax()) / weight
}

#[test]
fn least_forces_balance_within_the_cones_and_no_others_are_smaller() {
    let mut rng = ChaCha8Rng::seed_from_u64(46);
    let (mut held, mut refused) = (0, 0);
    for case in 0..300 {
        let contacts = stance(&mut rng);
        let com = Point3::new(rng.random_range(-1.0..1.0), rng.random_range(-1.0..1.0), 1.0);
        let cone = ConeModel { edges: 8, bound: ConeBound::Inner };
        let found = region(&cones(&contacts, cone).unwrap(), 1.0).unwrap();
        let depth = found.margin(&com).unwrap_or(f64::NEG_INFINITY);
        if depth.abs() < 1e-3 || (found.capped && depth > 0.0) {
            continue;
        }
        let forces = least_norm(&contacts, &com, 3000.0, cone).unwrap();
        assert_eq!(forces.is_some(), depth > 0.0, "case {case}: {depth}");
        let Some(forces) = forces else {
            refused += 1;
            continue;
        };
        held += 1;
        let off = misfit(&contacts, &com, 3000.0, &forces);
        assert!(off < 1e-9, "case {case}: {off}");
        // Convex: no feasible forces lie on the near side of the least ones' tangent plane. The
        // forces that spare the largest component most are others that hold.
        let other = spread_forces(&contacts, &com);
        let dot: f64 = forces.iter().zip(&other).map(|(f, o)| f.dot(&(o * 3000.0 - f))).sum();
        let size: f64 = forces.iter().map(|f| f.norm_squared()).sum();
        assert!(dot > -1e-6 * size, "case {case}: {dot} of {size}");
    }
    assert!(held > 80 && refused > 50, "{held} {refused}");
}

#[test]
fn a_slope_needs_the_tangent_of_its_inclination_as_friction() {
    let turn = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), 0.3);
    let on_slope = |friction: f64| -> Vec<Contact> {
        flat_hexagon()
            .iter()
            .map(|p| Contact { position: turn * p, normal: turn * Vector3::z_axis(), friction })
            .collect()
    };
    // Cones with many edges, so that the direction of the fall hardly matters.
    let cone = ConeModel { edges: 64, bound: ConeBound::Outer };
    let com = Point3::new(0.0, 0.0, 0.3);
    for friction in [0.7, 0.1] {
        let margin = slip_margin(&on_slope(friction), &com, cone).unwrap().unwrap();
        assert!((margin - (friction - 0.3_f64.tan())).abs() < 1e-3, "{margin}");
    }
    let far = Point3::new(5.0, 0.0, 0.3);
    assert_eq!(slip_margin(&level(&flat_hexagon(), 0.7), &far, cone), Ok(None));
    let still = slip_margin(&level(&flat_hexagon(), 0.7), &com, cone).unwrap().unwrap();
    assert!((still - 0.7).abs() < 1e-9, "level ground needs no friction: {still}");
}

/// The legs of a posture as statics has them, with level contacts of friction 0.7.
fn standing(
    robot: &rover::Robot,
    pose: &str,
    legs: &[usize],
    gravity: f64,
) -> (Vec<LegStatics>, Vec<Contact>, Point3<f64>, f64) {
    let posture = on_plane(robot, pose);
    let feet = contacts(robot, &posture, legs);
    let statics =
        feet.iter().map(|(leg, p)| LegStatics::new(robot, &posture, *leg, p, gravity)).collect();
    let ground = feet.iter().map(|(_, p)| Contact::level(*p, 0.7)).collect();
    (statics, ground, posture.center_of_mass(robot), robot.mass() * gravity)
}

/// The largest share over all joints, those of lifted legs included.
fn ratio(robot: &rover::Robot, pose: &str, legs: &[usize], gravity: f64) -> f64 {
    let (statics, ground, com, weight) = standing(robot, pose, legs, gravity);
    let cone = ConeModel::default();
    let least = least_torque(&statics, &ground, &com, weight, cone);
    let bearing = least.expect("the contacts are sound").expect("forces hold the stance").ratio;
    let hanging = torque::ratios(robot, &on_plane(robot, pose), &[], gravity).ratios;
    let lifted = (0..6).filter(|leg| !legs.contains(leg)).map(|leg| hanging[leg].amax());
    lifted.fold(bearing, f64::max)
}

#[test]
fn least_torques_are_those_of_the_planning_notes() {
    let sets: [&[usize]; 4] = [&[0, 1, 2, 3, 4, 5], &[1, 2, 3, 4, 5], &[0, 2, 4], &[2, 3, 4, 5]];
    let expected = [(athlete(), [0.12, 0.32, 0.44, 0.76]), (loaded(), [0.23, 0.45, 0.66, 1.09])];
    for (robot, ratios) in &expected {
        for (legs, expected) in sets.iter().zip(ratios) {
            let found = ratio(robot, "standing", legs, 9.8);
            assert!((found - expected).abs() < 0.0151, "{found} on {legs:?}, expected {expected}");
        }
    }
    let moon = ratio(&loaded(), "standing", &[2, 3, 4, 5], 1.62);
    assert!(moon < 0.1851, "{moon}");
}

#[test]
fn least_torques_agree_with_a_linear_program_in_forces() {
    let mut rng = ChaCha8Rng::seed_from_u64(47);
    let robot = athlete();
    for case in 0..60 {
        let legs: &[usize] = [&[0, 1, 2, 3, 4, 5][..], &[1, 2, 3, 4, 5], &[0, 2, 4]][case % 3];
        let (statics, mut ground, mut com, weight) = standing(&robot, "bent", legs, 3.71);
        com += Vector3::new(rng.random_range(-0.4..0.4), rng.random_range(-0.4..0.4), 0.0);
        for c in &mut ground {
            let tilt = Vector3::new(rng.random_range(-0.2..0.2), rng.random_range(-0.2..0.2), 1.0);
            c.normal = Unit::new_normalize(tilt);
        }
        let cone = ConeModel::default();
        let found = least_torque(&statics, &ground, &com, weight, cone).unwrap().unwrap();
        let expected = least_ratio(&statics, &ground, &com, weight);
        assert!((found.ratio - expected).abs() < 1e-6, "case {case}: {} {expected}", found.ratio);
        assert!(misfit(&ground, &com, weight, &found.forces) < 1e-8, "case {case}");
    }
    let (statics, ground, _, weight) = standing(&robot, "bent", &[0, 2, 4], 3.71);
    let outside = Point3::new(6.0, 0.0, 1.0);
    let none = least_torque(&statics, &ground, &outside, weight, ConeModel::default());
    assert_eq!(none, Ok(None));
}

#[test]
fn torque_regions_reach_as_far_as_a_dense_sweep_of_linear_programs_says() {
    let mut rng = ChaCha8Rng::seed_from_u64(48);
    let robot = loaded();
    let (mut areas, mut empty, mut narrower) = (0, 0, 0);
    for case in 0..24 {
        let legs: &[usize] =
            [&[0, 1, 2, 3, 4, 5][..], &[1, 2, 3, 4, 5], &[0, 2, 4], &[2, 3, 4, 5]][case % 4];
        let pose = ["bent", "standing"][case / 4 % 2];
        let gravity = [9.81, 3.71, 26.0][case / 8];
        let (statics, mut ground, _, weight) = standing(&robot, pose, legs, gravity);
        for c in &mut ground {
            let tilt = Vector3::new(rng.random_range(-0.3..0.3), rng.random_range(-0.3..0.3), 1.0);
            c.normal = Unit::new_normalize(tilt);
        }
        let cone = ConeModel::default();
        let found = torque_region(&statics, &ground, weight, cone).unwrap();
        let friction = region(&cones(&ground, cone).unwrap(), weight).unwrap();
        for i in 0..72 {
            let (b, a) = (TAU * f64::from(i) / 72.0 + 0.01).sin_cos();
            let Some(expected) = torque_support(&statics, &ground, weight, a, b) else {
                assert_eq!(found.region, ConvexRegion::Empty, "case {case}");
                empty += 1;
                break;
            };
            let reach = extent_of(&found.region, a, b);
            assert!((reach - expected).abs() < 3e-6, "case {case}: {reach} {expected}");
            narrower += usize::from(reach < extent_of(&friction.region, a, b) - 1e-3);
        }
        areas += usize::from(found.region.area().is_some());
    }
    assert!(areas > 12 && empty > 0 && narrower > 100, "{areas} {empty} {narrower}");
}

#[test]
fn a_report_is_torque_safe_where_both_ways_to_share_the_load_are() {
    // Planning notes: on Earth, four feet of which two neighbors are gone pass by the best forces
    // (0.76) and fail by equal springs (1.24).
    let report = |robot: &rover::Robot, pose, legs: &[usize]| {
        let posture = on_plane(robot, pose);
        let feet: Vec<_> = contacts(robot, &posture, legs)
            .into_iter()
            .map(|(leg, p)| (leg, Contact::level(p, 0.7)))
            .collect();
        forces(robot, &posture, &feet, 9.8, ConeModel::default()).unwrap()
    };
    let robot = athlete();
    let gone = report(&robot, "standing", &[2, 3, 4, 5]);
    assert!(gone.least_torque.as_ref().unwrap().ratio < 0.8 && !gone.is_torque_safe());
    let six = report(&robot, "standing", &[0, 1, 2, 3, 4, 5]);
    assert!(six.is_torque_safe(), "{six:?}");
    assert!(six.slip_margin.unwrap() > 0.69 && six.energy.is_ok());
    assert!(six.torque.margin(&six.com).unwrap() > 0.0);
}
