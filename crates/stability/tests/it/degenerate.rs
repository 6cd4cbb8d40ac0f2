//! Input that encloses nothing, or is no number.

use geometry::ConvexRegion;
use nalgebra::{Point2, Point3};
use stability::support_polygon::{conservative, regular};
use stability::{SupportError, settlement, spring_share};

use crate::{hexagon, preloaded_share};

fn flat(points: &[(f64, f64)]) -> Vec<Point3<f64>> {
    points.iter().map(|&(x, y)| Point3::new(x, y, 0.0)).collect()
}

#[track_caller]
fn check_refused(contacts: &[Point3<f64>], expected: SupportError) {
    let com = Point3::origin();
    assert_eq!(regular(contacts), Err(expected));
    assert_eq!(conservative(contacts), Err(expected));
    assert_eq!(settlement::worst(contacts, &com, 0.1), None);
    assert_eq!(spring_share(contacts, &com, 1.0), None);
}

#[test]
fn contacts_that_enclose_no_area_are_refused() {
    check_refused(&[], SupportError::TooFewContacts { n_contacts: 0 });
    check_refused(&hexagon()[..2], SupportError::TooFewContacts { n_contacts: 2 });
    let line = flat(&[(0.0, 0.0), (1.0, 1.0), (2.0, 2.0), (3.0, 3.0), (4.0, 4.0)]);
    check_refused(&line, SupportError::CollinearContacts);
    check_refused(&[Point3::new(1.0, 2.0, 3.0); 6], SupportError::CollinearContacts);
    let upright = [0.0, 1.0, 2.0].map(|z| Point3::new(1.0, 1.0, z));
    check_refused(&upright, SupportError::CollinearContacts);
}

#[test]
fn coordinates_that_are_no_numbers_are_refused_by_their_contact() {
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        for axis in 0..3 {
            let mut contacts = hexagon();
            contacts[4][axis] = bad;
            check_refused(&contacts, SupportError::NotFinite { contact: 4 });
        }
    }
}

#[test]
fn a_center_of_mass_or_settlement_that_is_no_number_has_no_answer() {
    let com = Point3::new(0.0, f64::NAN, 0.0);
    assert_eq!(settlement::worst(&hexagon(), &com, 0.1), None);
    assert_eq!(spring_share(&hexagon(), &com, 1.0), None);
    assert_eq!(settlement::worst(&hexagon(), &Point3::origin(), f64::NAN), None);
    assert_eq!(spring_share(&hexagon(), &Point3::origin(), f64::NAN), None);
}

#[test]
fn a_center_of_mass_outside_is_carried_by_nothing_and_has_a_negative_margin() {
    let com = Point3::new(3.0, 0.0, 1.0);
    assert_eq!(spring_share(&hexagon(), &com, 1.0), None);
    assert!(settlement::worst(&hexagon(), &com, 0.1).unwrap().margin_m < 0.0);
}

#[test]
fn two_feet_carry_what_lies_on_their_edge_and_one_what_lies_over_it() {
    let square = flat(&[(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0)]);
    let close = |loads: Vec<f64>, expected: [f64; 4]| {
        assert!(loads.iter().zip(expected).all(|(f, e)| (f - e).abs() < 1e-9), "{loads:?}");
    };
    close(spring_share(&square, &Point3::new(0.5, 0.0, 1.0), 4.0).unwrap(), [3.0, 1.0, 0.0, 0.0]);
    close(spring_share(&square, &Point3::new(2.0, 2.0, 1.0), 4.0).unwrap(), [0.0, 0.0, 4.0, 0.0]);
}

#[test]
fn three_of_four_feet_on_a_line_leave_the_middle_one() {
    // A segment from the line's middle foot to the fourth survives the loss of either end; only
    // its foot on the line survives the loss of the fourth too.
    let feet = flat(&[(0.0, 0.0), (1.0, 0.0), (3.0, 0.0), (1.0, 2.0)]);
    assert_eq!(conservative(&feet), Ok(ConvexRegion::Point(Point2::new(1.0, 0.0))));
}

#[test]
fn four_of_five_feet_on_a_line_leave_a_segment_given_by_its_middle() {
    // Whichever is lost, the hull holds the line from the second to the third of the four.
    let feet = flat(&[(0.0, 0.0), (1.0, 0.0), (2.0, 0.0), (5.0, 0.0), (1.0, 2.0)]);
    match conservative(&feet).unwrap() {
        ConvexRegion::Point(p) => assert!((p - Point2::new(1.5, 0.0)).norm() < 1e-9, "{p}"),
        other => panic!("{other:?}"),
    }
}

#[test]
fn two_feet_in_one_place_survive_the_loss_of_either() {
    let feet = flat(&[(0.0, 0.0), (0.0, 0.0), (2.0, 0.0), (0.0, 2.0)]);
    assert_eq!(conservative(&feet), Ok(ConvexRegion::Point(Point2::origin())));
}

#[test]
fn stances_far_from_the_origin_keep_their_region() {
    let far = nalgebra::Vector3::new(12_345.0, -67_890.0, 100.0);
    let contacts: Vec<_> = hexagon().iter().map(|p| p + far).collect();
    let region = conservative(&contacts).unwrap();
    assert!((region.area().unwrap().area() - 0.5 * 3.0_f64.sqrt()).abs() < 1e-6);
    let com = Point3::origin() + far;
    let loads = spring_share(&contacts, &com, 6.0).unwrap();
    assert!(loads.iter().all(|f| (f - 1.0).abs() < 1e-9), "{loads:?}");
}

#[test]
fn preloads_that_are_none_give_no_loads() {
    let com = Point3::new(0.0, 0.0, 1.0);
    let share = |weight, preload: &[f64]| preloaded_share(&hexagon(), &com, weight, preload);
    assert_eq!(share(1.0, &[0.0; 5]), None);
    assert_eq!(share(1.0, &[0.0, 0.0, f64::NAN, 0.0, 0.0, 0.0]), None);
    assert_eq!(share(0.0, &[1.0; 6]), None);
    assert_eq!(share(0.0, &[0.0; 6]), Some(vec![0.0; 6]));
    assert_eq!(share(6.0, &[0.0; 6]), spring_share(&hexagon(), &com, 6.0));
}
