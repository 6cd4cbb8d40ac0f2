//! Regions, margins and forces under friction against linear programs of another author.

use std::f64::consts::TAU;

use geometry::ConvexRegion;
use microlp::{ComparisonOp, Error, OptimizationDirection, Problem, Variable};
use nalgebra::{Isometry3, Point2, Point3, Rotation3, Unit, UnitQuaternion, Vector2, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use stability::contact_forces::{LegStatics, least_norm, least_torque, slip_margin};
use stability::force_region::{FORCE_CAP, cones, conservative, region};
use stability::report::{forces, torque_region};
use stability::robust::{self, Uncertainty};
use stability::{ConeBound, ConeModel, Contact, ContactError, ForceSet, support_polygon, torque};

use crate::{athlete, contacts, hexagon, loaded, on_plane};

/// Edges of a cone, written down once more: towards the middle of the stance first.
fn edges(contact: &Contact, all: &[Contact], n: usize) -> Vec<Vector3<f64>> {
    let middle = all.iter().map(|c| c.position.coords).sum::<Vector3<f64>>() / all.len() as f64;
    let normal = contact.normal.into_inner();
    let towards = middle - contact.position.coords;
    let first = (towards - normal * towards.dot(&normal)).normalize();
    (0..n)
        .map(|i| {
            let turn = Rotation3::from_axis_angle(&contact.normal, TAU * i as f64 / n as f64);
            (normal + turn * first * contact.friction).normalize()
        })
        .collect()
}

/// Farthest center of mass (m) in direction (a, b) that forces within the cones hold; `None` if
/// there is none.
fn support(contacts: &[Contact], n_edges: usize, a: f64, b: f64) -> Option<f64> {
    let mut problem = Problem::new(OptimizationDirection::Maximize);
    let free = (f64::NEG_INFINITY, f64::INFINITY);
    let (x, y) = (problem.add_var(a, free), problem.add_var(b, free));
    let mut rows: [Vec<(Variable, f64)>; 7] = Default::default();
    for contact in contacts {
        for f in edges(contact, contacts, n_edges) {
            let share = problem.add_var(0.0, (0.0, f64::INFINITY));
            let moment = contact.position.coords.cross(&f);
            let parts = [f.x, f.y, f.z, moment.z, moment.x, moment.y, 1.0];
            rows.iter_mut().zip(parts).for_each(|(row, part)| row.push((share, part)));
        }
    }
    // The weight 1 at (x, y) has the moment (-y, x, 0).
    rows[4].push((y, -1.0));
    rows[5].push((x, 1.0));
    for (row, sum) in rows.iter().zip([0.0, 0.0, 1.0, 0.0, 0.0, 0.0]) {
        problem.add_constraint(row, ComparisonOp::Eq, sum);
    }
    problem.add_constraint(&rows[6], ComparisonOp::Le, FORCE_CAP);
    match problem.solve() {
        Ok(outcome) => Some(outcome.into_solution().expect("no limit is set").objective()),
        Err(Error::Infeasible) => None,
        Err(other) => panic!("{other:?}"),
    }
}

fn extent_of(region: &ConvexRegion, a: f64, b: f64) -> f64 {
    let along = Vector2::new(a, b);
    match region {
        ConvexRegion::Area(polygon) => {
            polygon.vertices().iter().map(|v| v.coords.dot(&along)).fold(f64::MIN, f64::max)
        }
        ConvexRegion::Point(p) => p.coords.dot(&along),
        ConvexRegion::Empty => f64::NEG_INFINITY,
    }
}

/// A stance of 3 to 7 feet about the origin; steep ground and little friction among them.
fn stance(rng: &mut ChaCha8Rng) -> Vec<Contact> {
    let n = rng.random_range(3..=7);
    let steepest = [0.1, 0.6, 1.4][rng.random_range(0..3)];
    let slippery = [0.0, 0.2, 0.7][rng.random_range(0..3)];
    (0..n)
        .map(|i| {
            let yaw = TAU * (i as f64 + rng.random_range(-0.3..0.3)) / n as f64;
            let radius = rng.random_range(1.0..3.0);
            let height = rng.random_range(-0.8..0.8);
            let (tilt, fall) = (rng.random_range(0.0..steepest), rng.random_range(0.0..TAU));
            Contact {
                position: Point3::new(radius * yaw.cos(), radius * yaw.sin(), height),
                normal: Unit::new_normalize(Vector3::new(
                    f64::sin(tilt) * f64::cos(fall),
                    f64::sin(tilt) * f64::sin(fall),
                    f64::cos(tilt),
                )),
                friction: slippery + rng.random_range(0.0..0.2),
            }
        })
        .collect()
}

#[test]
fn regions_reach_as_far_as_linear_programs_say_in_every_direction() {
    let mut rng = ChaCha8Rng::seed_from_u64(41);
    let (mut areas, mut empty, mut capped) = (0, 0, 0);
    for case in 0..1_500 {
        let contacts = stance(&mut rng);
        let n_edges = [3, 4, 8, 12][case % 4];
        let cone = ConeModel { edges: n_edges, bound: ConeBound::Inner };
        let found = region(&cones(&contacts, cone).unwrap(), 1.0).unwrap();
        let radius = contacts.iter().map(|c| c.position.coords.norm()).fold(0.0, f64::max);
        for i in 0..24 {
            let (b, a) = (TAU * f64::from(i) / 24.0 + 0.01).sin_cos();
            let Some(expected) = support(&contacts, n_edges, a, b) else {
                assert_eq!(found.region, ConvexRegion::Empty, "case {case}");
                assert!(found.emptiness.is_some());
                break;
            };
            let reach = extent_of(&found.region, a, b);
            let size = radius.max(expected.abs());
            assert!((reach - expected).abs() < 1e-6 * size, "case {case}: {reach} {expected}");
        }
        areas += usize::from(found.region.area().is_some());
        empty += usize::from(found.region == ConvexRegion::Empty);
        capped += usize::from(found.capped);
    }
    assert!(areas > 700 && empty > 100 && capped > 10, "{areas} {empty} {capped}");
}

fn level(points: &[Point3<f64>], friction: f64) -> Vec<Contact> {
    points.iter().map(|p| Contact::level(*p, friction)).collect()
}

fn flat_hexagon() -> Vec<Point3<f64>> {
    hexagon().iter().map(|p| Point3::new(p.x, p.y, 0.0)).collect()
}

fn region_with(contacts: &[Contact]) -> stability::ForceRegion {
    region(&cones(contacts, ConeModel::default()).unwrap(), 1.0).unwrap()
}

#[test]
fn on_level_ground_the_region_is_the_hull_of_the_feet() {
    for friction in [0.0, 0.01, 0.7] {
        let found = region_with(&level(&flat_hexagon(), friction));
        let area = found.region.area().unwrap();
        assert!((area.area() - 1.5 * 3.0_f64.sqrt()).abs() < 1e-9, "{}", area.area());
        for p in flat_hexagon() {
            assert!(area.depth_of(p.xy()).abs() < 1e-9);
        }
        assert!(!found.capped);
        // Each edge is borne by the two feet at its ends.
        assert!(found.bearing.iter().all(|who| who.len() == 2), "{:?}", found.bearing);
    }
}

#[test]
fn on_a_slope_that_holds_the_region_is_the_level_outline_of_the_feet() {
    let tilt = 0.5_f64;
    let turn = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), tilt);
    let sloped: Vec<Contact> = flat_hexagon()
        .iter()
        .map(|p| Contact { position: turn * p, normal: turn * Vector3::z_axis(), friction: 0.7 })
        .collect();
    let feet: Vec<Point3<f64>> = sloped.iter().map(|c| c.position).collect();
    let hull = support_polygon::regular(&feet).unwrap();
    let found = region_with(&sloped);
    let area = found.region.area().unwrap();
    assert!((area.area() - hull.area()).abs() < 1e-9, "{} {}", area.area(), hull.area());
}

#[test]
fn ground_steeper_than_its_friction_holds_nothing_and_slides() {
    for over in [1e-3, 0.1] {
        let tilt = 0.7_f64.atan() + over;
        let normal = Unit::new_normalize(Vector3::new(tilt.sin(), 0.0, tilt.cos()));
        let steep: Vec<Contact> = flat_hexagon()
            .iter()
            .map(|p| Contact { position: *p, normal, friction: 0.7 })
            .collect();
        let found = region_with(&steep);
        assert_eq!(found.region, ConvexRegion::Empty);
        assert_eq!(found.emptiness, Some(stability::force_region::Emptiness::Slides));
        assert_eq!(found.margin(&Point3::origin()), None);
    }
}

#[test]
fn the_conservative_region_is_what_every_loss_leaves() {
    let all = |n: usize| cones(&level(&flat_hexagon()[..n], 0.7), ConeModel::default()).unwrap();
    let six = conservative(&all(6), 1.0).unwrap();
    assert!((six.region.area().unwrap().area() - 0.5 * 3.0_f64.sqrt()).abs() < 1e-8);
    assert!((six.margin(&Point3::origin()).unwrap() - 0.5).abs() < 1e-8);
    let four = conservative(&all(4), 1.0).unwrap();
    let ConvexRegion::Point(p) = four.region else { panic!("{:?}", four.region) };
    assert!(four.margin(&Point3::new(p.x, p.y, 0.0)).unwrap().abs() < 1e-9);
    assert!((p - diagonals_meet(&flat_hexagon()[..4])).norm() < 1e-6, "{p}");
    let three = conservative(&all(3), 1.0).unwrap();
    assert_eq!(three.region, ConvexRegion::Empty);
}

/// Where the lines from corner 0 to 2 and from 1 to 3 meet.
fn diagonals_meet(c: &[Point3<f64>]) -> Point2<f64> {
    let (d, e) = ((c[2] - c[0]).xy(), (c[3] - c[1]).xy());
    let t = (c[1] - c[0]).xy().perp(&e) / d.perp(&e);
    c[0].xy() + d * t
}

#[test]
fn conservative_regions_are_held_by_linear_programs_after_every_loss() {
    let mut rng = ChaCha8Rng::seed_from_u64(42);
    let mut areas = 0;
    for case in 0..150 {
        let contacts = stance(&mut rng);
        let sets = cones(&contacts, ConeModel { edges: 4, bound: ConeBound::Inner }).unwrap();
        let Some(area) = conservative(&sets, 1.0).unwrap().region.area().cloned() else { continue };
        areas += 1;
        // Cones keep their orientation when a foot is lost, so the sets are compared themselves.
        for lost in 0..contacts.len() {
            let mut others = sets.clone();
            others.remove(lost);
            let rest = region(&others, 1.0).unwrap();
            for v in area.vertices() {
                assert!(rest.region.area().unwrap().depth_of(*v) > -1e-7, "case {case}");
            }
        }
    }
    assert!(areas > 40, "{areas}");
}

#[test]
fn a_region_between_inner_and_outer_cones_narrows_with_their_edges() {
    let mut rng = ChaCha8Rng::seed_from_u64(43);
    let mut compared = 0;
    for _ in 0..100 {
        let contacts = stance(&mut rng);
        let area = |edges, bound| {
            let sets = cones(&contacts, ConeModel { edges, bound }).unwrap();
            let found = region(&sets, 1.0).unwrap();
            (!found.capped).then(|| found.region.area().map_or(0.0, |polygon| polygon.area()))
        };
        let bounds = [
            area(4, ConeBound::Inner),
            area(8, ConeBound::Inner),
            area(64, ConeBound::Inner),
            area(64, ConeBound::Outer),
            area(8, ConeBound::Outer),
        ];
        let Some(areas) = bounds.into_iter().collect::<Option<Vec<f64>>>() else { continue };
        assert!(areas.windows(2).all(|w| w[0] <= w[1] + 1e-7), "{areas:?}");
        assert!(areas[3] < 1.05 * areas[2] + 1e-3, "{areas:?}");
        compared += 1;
    }
    assert!(compared > 50, "{compared}");
}

#[test]
fn rays_and_half_spaces_are_one_cone() {
    let mut rng = ChaCha8Rng::seed_from_u64(44);
    for bound in [ConeBound::Inner, ConeBound::Outer] {
        let cone = ConeModel { edges: 6, bound };
        for contact in stance(&mut rng) {
            let center = Point3::new(0.3, 0.1, 0.0);
            let (rays, sides) = (cone.rays(&contact, &center), cone.half_spaces(&contact, &center));
            for side in &sides {
                let products: Vec<f64> = rays.iter().map(|ray| ray.dot(side)).collect();
                // Each half space holds all edges and has two of them on its border.
                assert!(products.iter().all(|p| *p > -1e-12), "{products:?}");
                assert_eq!(products.iter().filter(|p| p.abs() < 1e-12).count(), 2);
            }
            // Inner edges lie on the true cone; outer half spaces touch it.
            let slope = |f: &Vector3<f64>| {
                let along = f.dot(&contact.normal);
                (f - contact.normal.into_inner() * along).norm() / along
            };
            match bound {
                ConeBound::Inner => assert!((slope(&rays[0]) - contact.friction).abs() < 1e-9),
                ConeBound::Outer => {
                    let middle = rays[0].normalize() + rays[1].normalize();
                    assert!((slope(&middle) - contact.friction).abs() < 1e-9);
                }
            }
        }
    }
}

#[test]
fn turned_moved_and_relabeled_stances_have_the_same_region() {
    let mut rng = ChaCha8Rng::seed_from_u64(45);
    for _ in 0..100 {
        let contacts = stance(&mut rng);
        let motion = Isometry3::new(
            Vector3::new(rng.random_range(-50.0..50.0), 7.0, -3.0),
            Vector3::new(0.0, 0.0, rng.random_range(-3.0..3.0)),
        );
        let mut moved: Vec<Contact> = contacts
            .iter()
            .map(|c| Contact {
                position: motion * c.position,
                normal: motion.rotation * c.normal,
                ..*c
            })
            .collect();
        moved.reverse();
        let (before, after) = (region_with(&contacts), region_with(&moved));
        assert_eq!(before.emptiness, after.emptiness);
        for i in 0..12 {
            let along = Vector3::new((f64::from(i)).cos(), (f64::from(i)).sin(), 0.0);
            let turned = motion * along;
            let reach = extent_of(&before.region, along.x, along.y);
            let expected = extent_of(&after.region, turned.x, turned.y)
                - motion.translation.vector.dot(&turned);
            let same = reach == expected || (reach - expected).abs() < 1e-6 * (1.0 + reach.abs());
            assert!(same, "{reach} {expected}");
        }
    }
}

#[test]
fn a_tether_holds_what_slides_until_it_tears() {
    // On a slope of 0.3 rad with friction 0.05, feet slide; a rope along the slope needs
    // sin 0.3 - 0.05 cos 0.3 of the weight.
    let turn = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), 0.3);
    let (normal, uphill) = (turn * Vector3::z_axis(), turn * -Vector3::x_axis());
    let feet: Vec<Contact> = flat_hexagon()
        .iter()
        .map(|p| Contact { position: turn * p, normal, friction: 0.05 })
        .collect();
    let cone = ConeModel { edges: 64, bound: ConeBound::Outer };
    let tied = |tension: f64| {
        let mut sets = cones(&feet, cone).unwrap();
        let anchor = Point3::from(normal.into_inner() * 0.2);
        sets.push(ForceSet::tether(anchor, uphill, tension * 2000.0));
        sets
    };
    let needed = 0.3_f64.sin() - 0.05 * 0.3_f64.cos();
    assert_eq!(region(&tied(0.98 * needed), 2000.0).unwrap().region, ConvexRegion::Empty);
    let taut = region(&tied(1.02 * needed), 2000.0).unwrap();
    assert!(taut.region.area().is_some(), "{taut:?}");
    // Losing the rope is one of the losses.
    assert_eq!(conservative(&tied(1.0), 2000.0).unwrap().region, ConvexRegion::Empty);
}

#[test]
fn strange_contacts_have_answers_by_name() {
    let cone = ConeModel::default();
    let at = |x: f64, y: f64| Contact::level(Point3::new(x, y, 0.0), 0.5);
    assert_eq!(cones(&[], cone), Err(ContactError::NoContacts));
    let many = vec![at(0.0, 0.0); 1_000_000];
    assert_eq!(cones(&many, cone), Err(ContactError::TooManyContacts { n_contacts: 1_000_000 }));
    let bad = ConeModel { edges: 2, ..cone };
    assert_eq!(cones(&[at(0.0, 0.0)], bad), Err(ContactError::BadCone { edges: 2 }));
    let rough = Contact { friction: -0.1, ..at(0.0, 0.0) };
    assert_eq!(cones(&[rough], cone), Err(ContactError::BadFriction { contact: 0 }));
    let nowhere = at(f64::NAN, 0.0);
    assert_eq!(cones(&[at(0.0, 0.0), nowhere], cone), Err(ContactError::NotFinite { contact: 1 }));
    // Coincident: the one point; on a line: a segment, which counts as its middle.
    let one = region_with(&[at(1.0, 2.0); 6]);
    assert!(
        matches!(one.region, ConvexRegion::Point(p) if (p - Point2::new(1.0, 2.0)).norm() < 1e-7)
    );
    let line = region_with(&[at(0.0, 0.0), at(1.0, 0.0), at(4.0, 0.0)]);
    assert!(matches!(line.region, ConvexRegion::Point(p) if p.y.abs() < 1e-7), "{line:?}");
    // Walls that face each other hold anything near, and the answer says so.
    let wall = |x: f64, n: f64| Contact {
        position: Point3::new(x, 0.0, 0.0),
        normal: Unit::new_normalize(Vector3::new(n, 0.0, 0.0)),
        friction: 0.5,
    };
    let chimney = region_with(&[wall(-1.0, 1.0), wall(1.0, -1.0)]);
    assert!(chimney.capped && chimney.emptiness.is_none(), "{chimney:?}");
    let flat = region(&cones(&[at(0.0, 0.0)], cone).unwrap(), 0.0);
    assert_eq!(flat, Err(ContactError::BadWeight));
}

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

/// Forces of least largest share of a cone's edge, in weights, from a linear program.
fn spread_forces(contacts: &[Contact], com: &Point3<f64>) -> Vec<Vector3<f64>> {
    let mut problem = Problem::new(OptimizationDirection::Minimize);
    let most = problem.add_var(1.0, (0.0, f64::INFINITY));
    let mut rows: [Vec<(Variable, f64)>; 6] = Default::default();
    let mut parts = Vec::new();
    for (i, contact) in contacts.iter().enumerate() {
        for f in edges(contact, contacts, 8) {
            let share = problem.add_var(0.0, (0.0, f64::INFINITY));
            let moment = (contact.position - com).cross(&f);
            let wrench = [f.x, f.y, f.z, moment.x, moment.y, moment.z];
            rows.iter_mut().zip(wrench).for_each(|(row, part)| row.push((share, part)));
            problem.add_constraint(&[(share, 1.0), (most, -1.0)], ComparisonOp::Le, 0.0);
            parts.push((i, share, f));
        }
    }
    for (row, sum) in rows.iter().zip([0.0, 0.0, 1.0, 0.0, 0.0, 0.0]) {
        problem.add_constraint(row, ComparisonOp::Eq, sum);
    }
    let solution = problem.solve().unwrap().into_solution().unwrap();
    let mut forces = vec![Vector3::zeros(); contacts.len()];
    parts.iter().for_each(|(i, share, f)| forces[*i] += f * solution.var_value(*share));
    forces
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
    let bearing = least_torque(&statics, &ground, &com, weight, cone).unwrap().unwrap().ratio;
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

/// The least largest share of a torque limit, by a linear program in forces.
fn least_ratio(legs: &[LegStatics], ground: &[Contact], com: &Point3<f64>, weight: f64) -> f64 {
    let mut problem = Problem::new(OptimizationDirection::Minimize);
    let t = problem.add_var(1.0, (0.0, f64::INFINITY));
    let mut rows: [Vec<(Variable, f64)>; 6] = Default::default();
    for (leg, contact) in legs.iter().zip(ground) {
        let shares: Vec<(Variable, Vector3<f64>)> = edges(contact, ground, 8)
            .into_iter()
            .map(|f| (problem.add_var(0.0, (0.0, f64::INFINITY)), f))
            .collect();
        for (share, f) in &shares {
            let moment = (contact.position - com).cross(f);
            let wrench = [f.x, f.y, f.z, moment.x, moment.y, moment.z];
            rows.iter_mut().zip(wrench).for_each(|(row, part)| row.push((*share, part)));
        }
        for joint in 0..leg.own.len() {
            let limit = leg.limits[joint];
            for sign in [1.0, -1.0] {
                let mut row: Vec<(Variable, f64)> = vec![(t, -1.0)];
                for (share, f) in &shares {
                    let torque = leg.torques(&(f * weight))[joint] - leg.own[joint];
                    row.push((*share, sign * torque / limit));
                }
                let own = sign * leg.own[joint] / limit;
                problem.add_constraint(&row, ComparisonOp::Le, -own);
            }
        }
    }
    for (row, sum) in rows.iter().zip([0.0, 0.0, 1.0, 0.0, 0.0, 0.0]) {
        problem.add_constraint(row, ComparisonOp::Eq, sum);
    }
    problem.solve().unwrap().into_solution().unwrap().objective()
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

/// Farthest center of mass (m) in direction (a, b) that friction and joint torques hold.
fn torque_support(
    legs: &[LegStatics],
    ground: &[Contact],
    weight: f64,
    a: f64,
    b: f64,
) -> Option<f64> {
    let mut problem = Problem::new(OptimizationDirection::Maximize);
    let free = (f64::NEG_INFINITY, f64::INFINITY);
    let (x, y) = (problem.add_var(a, free), problem.add_var(b, free));
    let mut rows: [Vec<(Variable, f64)>; 6] = Default::default();
    for (leg, contact) in legs.iter().zip(ground) {
        let shares: Vec<(Variable, Vector3<f64>)> = edges(contact, ground, 8)
            .into_iter()
            .map(|f| (problem.add_var(0.0, (0.0, f64::INFINITY)), f))
            .collect();
        for (share, f) in &shares {
            let moment = contact.position.coords.cross(f);
            let wrench = [f.x, f.y, f.z, moment.x, moment.y, moment.z];
            rows.iter_mut().zip(wrench).for_each(|(row, part)| row.push((*share, part)));
        }
        for joint in 0..leg.own.len() {
            let limit = leg.limits[joint];
            let row: Vec<(Variable, f64)> = shares
                .iter()
                .map(|(share, f)| (*share, (leg.torques(&(f * weight)) - leg.own)[joint] / limit))
                .collect();
            let own = leg.own[joint] / limit;
            problem.add_constraint(&row, ComparisonOp::Le, 1.0 - own);
            problem.add_constraint(&row, ComparisonOp::Ge, -1.0 - own);
        }
    }
    rows[3].push((y, -1.0));
    rows[4].push((x, 1.0));
    for (row, sum) in rows.iter().zip([0.0, 0.0, 1.0, 0.0, 0.0, 0.0]) {
        problem.add_constraint(row, ComparisonOp::Eq, sum);
    }
    match problem.solve() {
        Ok(outcome) => Some(outcome.into_solution().expect("no limit is set").objective()),
        Err(Error::Infeasible) => None,
        Err(other) => panic!("{other:?}"),
    }
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
        let gravity = [9.81, 3.71, 60.0][case / 8];
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

#[test]
fn robust_margins_hold_for_every_contact_within_the_uncertainty() {
    let mut rng = ChaCha8Rng::seed_from_u64(49);
    let cone = ConeModel { edges: 16, bound: ConeBound::Inner };
    let (mut held, mut refused) = (0, 0);
    for _ in 0..30 {
        let contacts = stance(&mut rng);
        let com = Point3::new(0.1, 0.0, 1.0);
        let doubt = Uncertainty { height_m: 0.05, normal_rad: 0.05, friction: 0.05 };
        let least = robust::margins(&contacts, &com, &doubt, cone).unwrap();
        let Some(friction_m) = least.friction_m else {
            refused += 1;
            continue;
        };
        held += 1;
        for _ in 0..20 {
            let mut share = |size: f64| size * rng.random_range(-1.0..1.0);
            let varied: Vec<Contact> = contacts
                .iter()
                .map(|c| {
                    let across = c.normal.cross(&Vector3::new(share(1.0), share(1.0), share(1.0)));
                    let turn = UnitQuaternion::new(across.normalize() * share(0.05));
                    Contact {
                        position: c.position + Vector3::z() * share(0.05),
                        normal: turn * c.normal,
                        friction: (c.friction + share(0.05)).max(0.0),
                    }
                })
                .collect();
            // Against outer cones, for the linearized ones turn with the normal.
            let outer = ConeModel { edges: 16, bound: ConeBound::Outer };
            let real = region(&cones(&varied, outer).unwrap(), 1.0).unwrap();
            let margin = real.margin(&com).unwrap();
            assert!(margin >= friction_m - 1e-6, "{margin} {friction_m}");
            let feet: Vec<Point3<f64>> = varied.iter().map(|c| c.position).collect();
            let energy = stability::energy::margin(&feet, &com).unwrap().height_m;
            assert!(energy >= least.energy_m.unwrap() - 5e-3, "{energy} {least:?}");
        }
    }
    assert!(held > 8 && refused > 3, "{held} {refused}");
}
