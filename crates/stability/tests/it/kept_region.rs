//! Regions kept while contacts move, against the same regions anew.

use std::f64::consts::TAU;

use nalgebra::{Point3, Unit, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use stability::force_region::{Emptiness, cones, region};
use stability::{ConeModel, Contact, ContactError, ForceRegion, ForceSet, KeptRegion};

use crate::linear::support;
use crate::slopes::{extent_of, flat_hexagon, level, stance};

/// A contact moved a little, far or by its normal alone.
fn moved(rng: &mut ChaCha8Rng, contact: &Contact) -> Contact {
    let reach = [0.0, 0.02, 0.3, 1.5][rng.random_range(0..4)];
    let mut side = |size: f64| size * rng.random_range(-1.0..1.0);
    let position = contact.position + Vector3::new(side(reach), side(reach), side(0.3 * reach));
    let normal = contact.normal.into_inner() + Vector3::new(side(0.3), side(0.3), 0.0);
    Contact { position, normal: Unit::new_normalize(normal), ..*contact }
}

fn assert_same(found: &ForceRegion, expected: &ForceRegion, size: f64, what: &str) {
    assert_eq!(found.emptiness, expected.emptiness, "{what}");
    assert_eq!(found.capped, expected.capped, "{what}");
    assert_eq!(found.region.area().is_some(), expected.region.area().is_some(), "{what}");
    for i in 0..48 {
        let (b, a) = (TAU * f64::from(i) / 48.0 + 0.003).sin_cos();
        let reach = extent_of(&found.region, a, b);
        let anew = extent_of(&expected.region, a, b);
        let same = reach == anew || (reach - anew).abs() <= 1e-9 * size.max(anew.abs());
        assert!(same, "{what}: {reach} {anew}");
    }
    if let Some(area) = found.region.area() {
        assert_eq!(found.bearing.len(), area.edges().count(), "{what}");
    }
}

#[test]
fn a_region_whose_contacts_move_stays_that_of_all_anew() {
    let mut rng = ChaCha8Rng::seed_from_u64(81);
    let cone = ConeModel::default();
    let (mut areas, mut empty, mut same_bearing) = (0, 0, 0);
    for case in 0..200 {
        let mut contacts = stance(&mut rng);
        let middle = Point3::origin();
        let set = |c: &Contact| ForceSet::cone(c, &middle, cone);
        let mut kept = KeptRegion::new(contacts.iter().map(set).collect()).unwrap();
        for step in 0..20 {
            let i = rng.random_range(0..contacts.len());
            contacts[i] = moved(&mut rng, &contacts[i]);
            kept.moved(i, set(&contacts[i])).unwrap();
            let anew = region(kept.sets(), 1.0).unwrap();
            let size = contacts.iter().map(|c| c.position.coords.norm()).fold(1.0, f64::max);
            assert_same(kept.region(), &anew, size, &format!("case {case}, step {step}"));
            areas += usize::from(anew.region.area().is_some());
            empty += usize::from(anew.emptiness.is_some());
            let com = Point3::new(0.1, -0.2, 1.0);
            same_bearing += usize::from(kept.region().critical(&com) == anew.critical(&com));
        }
    }
    assert!(areas > 2_000 && empty > 300, "{areas} {empty}");
    // Where edges meet or forces tie, either may be told.
    assert!(same_bearing > 3_900, "{same_bearing}");
}

#[test]
fn level_feet_that_move_one_by_one_keep_their_hull() {
    // All balances but one follow from the others, and every force ties.
    let mut rng = ChaCha8Rng::seed_from_u64(82);
    for friction in [0.0, 0.6] {
        let mut contacts = level(&flat_hexagon(), friction);
        let cone = ConeModel::default();
        let mut kept = KeptRegion::new(cones(&contacts, cone).unwrap()).unwrap();
        for step in 0..300 {
            let i = step % 6;
            let mut side = || rng.random_range(-0.4..0.4);
            let at = flat_hexagon()[i] + Vector3::new(side(), side(), 0.0);
            contacts[i] = Contact::level(at, friction);
            kept.moved(i, ForceSet::cone(&contacts[i], &Point3::origin(), cone)).unwrap();
            let feet: Vec<Point3<f64>> = contacts.iter().map(|c| c.position).collect();
            let hull = stability::support_polygon::regular(&feet).unwrap();
            let area = kept.region().region.area().unwrap().area();
            assert!((area - hull.area()).abs() < 1e-9, "{area} {}", hull.area());
        }
    }
}

#[test]
fn after_a_hundred_moves_linear_programs_say_the_same() {
    let mut rng = ChaCha8Rng::seed_from_u64(83);
    let cone = ConeModel::default();
    for _ in 0..30 {
        let mut contacts = stance(&mut rng);
        let mut kept = KeptRegion::new(cones(&contacts, cone).unwrap()).unwrap();
        for _ in 0..100 {
            let i = rng.random_range(0..contacts.len());
            let next = moved(&mut rng, &contacts[i]);
            let position = Point3::from(next.position.coords.cap_magnitude(3.0));
            contacts[i] = Contact { position, ..next };
            kept.moved(i, ForceSet::cone(&contacts[i], &Point3::origin(), cone)).unwrap();
        }
        // The oracle turns its cones to the middle of the stance: so do these, one by one.
        let exact = cones(&contacts, cone).unwrap();
        for (i, set) in exact.into_iter().enumerate() {
            kept.moved(i, set).unwrap();
        }
        for i in 0..12 {
            let (b, a) = (TAU * f64::from(i) / 12.0 + 0.01).sin_cos();
            let reach = extent_of(&kept.region().region, a, b);
            match support(&contacts, 8, a, b) {
                Some(expected) => {
                    assert!((reach - expected).abs() < 1e-6 * expected.abs().max(3.0), "{reach}");
                }
                None => assert_eq!(reach, f64::NEG_INFINITY),
            }
        }
    }
}

#[test]
fn moves_that_cannot_be_are_named_and_change_nothing() {
    let contacts = level(&flat_hexagon(), 0.5);
    let sets = cones(&contacts, ConeModel::default()).unwrap();
    let mut kept = KeptRegion::new(sets.clone()).unwrap();
    let before = kept.region().clone();
    let none = kept.moved(6, sets[0].clone()).unwrap_err();
    assert_eq!(none, ContactError::NoContact { contact: 6, n_contacts: 6 });
    let nowhere = ForceSet { position: Point3::new(f64::NAN, 0.0, 0.0), ..sets[0].clone() };
    assert_eq!(kept.moved(2, nowhere).unwrap_err(), ContactError::NotFinite { contact: 2 });
    assert_eq!(*kept.region(), before);
    assert_eq!(KeptRegion::new(Vec::new()).unwrap_err(), ContactError::NoContacts);
    // A foot that becomes a rope, that stands far off, or on ice, is worked with.
    let rope = ForceSet::tether(Point3::new(0.0, 0.0, 1.0), -Vector3::z_axis(), 0.2);
    for set in [rope, ForceSet { position: Point3::new(90.0, 0.0, 0.0), ..sets[0].clone() }] {
        let found = kept.moved(0, set).unwrap().clone();
        let anew = region(kept.sets(), 1.0).unwrap();
        assert_same(&found, &anew, 100.0, "far");
    }
    let steep = Unit::new_normalize(Vector3::new(1.0, 0.0, 0.1));
    let mut kept = KeptRegion::new(cones(&contacts[..1], ConeModel::default()).unwrap()).unwrap();
    let wall = Contact { position: Point3::origin(), normal: steep, friction: 0.1 };
    let wall = ForceSet::cone(&wall, &Point3::origin(), ConeModel::default());
    assert_eq!(kept.moved(0, wall).unwrap().emptiness, Some(Emptiness::Slides));
}
