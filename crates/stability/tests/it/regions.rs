//! Regions that friction holds, against linear programs and closed forms.

use std::f64::consts::TAU;

use geometry::ConvexRegion;
use nalgebra::{Isometry3, Point2, Point3, Unit, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use stability::force_region::{cones, conservative, region};
use stability::robust::{self, Uncertainty};
use stability::{ConeBound, ConeModel, Contact, ContactError, ForceSet, support_polygon};

use crate::linear::support;
use crate::slopes::{extent_of, flat_hexagon, level, region_with, stance};

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
