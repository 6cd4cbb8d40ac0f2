//! Margins prepared for many centers of mass are those of the assessment.

use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rover::{Configuration, LegId, Posture};
use stability::{ConeModel, Contact, StanceMargins, assess_with_friction, energy};

use crate::athlete;
use crate::slopes::stance;

#[test]
fn prepared_margins_are_those_of_the_full_assessment() {
    let robot = athlete();
    let cone = ConeModel::default();
    let mut rng = ChaCha8Rng::seed_from_u64(71);
    let (mut none, mut held) = (0, 0);
    for _ in 0..300 {
        let mut contacts = stance(&mut rng);
        contacts.truncate(6);
        let legs = (0..6).map(LegId).zip(contacts.iter().copied());
        let standing: Vec<(LegId, Contact)> = legs.collect();
        let prepared = StanceMargins::new(&contacts, cone);
        let points: Vec<Point3<f64>> = contacts.iter().map(|c| c.position).collect();
        for _ in 0..4 {
            let mut side = || rng.random_range(-1.0..1.0);
            let tilt = UnitQuaternion::from_euler_angles(0.2 * side(), 0.2 * side(), side());
            let place = Vector3::new(side(), side(), 1.6);
            let world_from_base = Isometry3::from_parts(place.into(), tilt);
            let at = Configuration { world_from_base, ..robot.pose("bent").unwrap() };
            let posture = Posture::new(&robot, &at);
            let report = assess_with_friction(&robot, &posture, &standing, 1.62, cone).unwrap();
            let margins = prepared.at(&report.com);
            let regular = report.regular.as_ref().ok().map(|r| r.margin);
            assert_eq!(margins.regular, regular);
            assert_eq!(margins.conservative_m, report.conservative.and_then(|c| c.margin_m));
            let friction = report.friction.unwrap().margin(&report.com);
            assert_eq!(margins.friction_m, friction);
            let energy = energy::margin(&points, &report.com).ok().map(|e| e.height_m);
            assert_eq!(margins.energy_m, energy);
            none += usize::from(friction.is_none());
            held += usize::from(friction.is_some_and(|m| m > 0.0));
        }
    }
    assert!(none > 50 && held > 100, "{none} {held}");
}

#[test]
fn what_is_no_stance_has_no_margins() {
    let cone = ConeModel::default();
    let at = |x: f64, friction: f64| Contact::level(Point3::new(x, 0.0, 0.0), friction);
    for contacts in [vec![], vec![at(f64::NAN, 0.5); 4], vec![at(0.0, -1.0), at(1.0, 0.1)]] {
        let margins = StanceMargins::new(&contacts, cone).at(&Point3::origin());
        assert_eq!(margins.regular, None);
        assert_eq!(margins.friction_m, None);
        assert_eq!(margins.energy_m, None);
    }
}
