//! Closed forms: what regular hexagons of feet leave, and what a settling foot does.

use geometry::ConvexRegion;
use nalgebra::{Point2, Point3};
use stability::support_polygon::{conservative, margin, regular};
use stability::{settlement, spring_share};

use crate::{hexagon, preloaded_share, without};

#[track_caller]
fn check(what: &str, value: f64, expected: f64) {
    assert!((value - expected).abs() < 1e-9, "{what} is {value}, expected {expected}");
}

fn center() -> Point3<f64> {
    Point3::new(0.0, 0.0, 1.0)
}

#[test]
fn a_hexagon_has_its_apothem_as_margin_whatever_the_terrain() {
    let support = regular(&hexagon()).unwrap();
    check("area (m²)", support.area(), 1.5 * 3.0_f64.sqrt());
    check("margin (m)", margin(&support, &hexagon(), &center()).depth_m, 0.75_f64.sqrt());
}

#[test]
fn losing_any_leg_of_a_hexagon_leaves_a_third_of_it_and_half_its_radius() {
    let region = conservative(&hexagon()).unwrap();
    let csp = region.area().unwrap();
    check("area (m²)", csp.area(), 0.5 * 3.0_f64.sqrt());
    check("margin (m)", margin(csp, &hexagon(), &center()).depth_m, 0.5);
}

#[test]
fn five_feet_of_a_hexagon_leave_two_fifteenths_with_the_center_on_the_border() {
    let feet = without(&[0]);
    let region = conservative(&feet).unwrap();
    let csp = region.area().unwrap();
    check("share of the hull", csp.area() / regular(&feet).unwrap().area(), 2.0 / 15.0);
    check("margin (m)", margin(csp, &feet, &center()).depth_m, 0.0);
    // The largest circle touches the two diagonals through the center and the edge far from the
    // lost leg: at distance d from the center d sin 60° = 1/2 - d, so d = 2 - √3.
    let (deepest, depth) = csp.deepest_point();
    assert!((deepest - Point2::new(3.0_f64.sqrt() - 2.0, 0.0)).norm() < 1e-6, "{deepest}");
    check("best margin (m)", depth, 3.0_f64.sqrt() - 1.5);
}

#[test]
fn the_five_foot_regions_together_cover_the_six_foot_region() {
    // Ambler's subsuming polygon and FootFall's intersection agree on the hexagon (A26, F40).
    let whole = conservative(&hexagon()).unwrap();
    let parts: Vec<ConvexRegion> = (0..6).map(|k| conservative(&without(&[k])).unwrap()).collect();
    for ix in -20..=20 {
        for iy in -20..=20 {
            let p = Point2::new(0.0331 * f64::from(ix), 0.0317 * f64::from(iy));
            let in_whole = whole.area().unwrap().depth_of(p);
            let in_parts =
                parts.iter().map(|r| r.area().unwrap().depth_of(p)).fold(f64::MIN, f64::max);
            if in_whole.abs() > 1e-6 && in_parts.abs() > 1e-6 {
                assert_eq!(in_whole > 0.0, in_parts > 0.0, "{p}: {in_whole} {in_parts}");
            }
        }
    }
}

#[test]
fn four_feet_leave_where_their_diagonals_meet() {
    // Feet at 0°, 60°, 180°, 300°: the diagonals are y = 0 and x = 1/2.
    let feet: Vec<_> = [0, 1, 3, 5].map(|k| hexagon()[k]).into();
    match conservative(&feet).unwrap() {
        ConvexRegion::Point(p) => assert!((p - Point2::new(0.5, 0.0)).norm() < 1e-12, "{p}"),
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_foot_within_the_triangle_of_three_others_is_all_that_they_leave() {
    let inner = Point3::new(0.1, 0.2, 0.0);
    let feet = [hexagon()[0], inner, hexagon()[2], hexagon()[4]];
    match conservative(&feet).unwrap() {
        ConvexRegion::Point(p) => assert!((p - inner.xy()).norm() < 1e-12, "{p}"),
        other => panic!("{other:?}"),
    }
}

#[test]
fn three_feet_leave_nothing() {
    assert_eq!(conservative(&without(&[1, 3, 5])), Ok(ConvexRegion::Empty));
}

#[test]
fn the_margin_names_the_feet_it_would_tip_over() {
    let com = Point3::new(0.0, 0.3, 1.0);
    let support = regular(&hexagon()).unwrap();
    let found = margin(&support, &hexagon(), &com);
    assert_eq!(found.contacts, [1, 2], "the feet at 60° and 120°");
    check("margin (m)", found.depth_m, 0.75_f64.sqrt() - 0.3);
    // An edge of the conservative polygon lies on the line of two feet that are not neighbors.
    let region = conservative(&hexagon()).unwrap();
    let found = margin(region.area().unwrap(), &hexagon(), &Point3::new(0.1, 0.0, 0.0));
    assert_eq!(found.contacts, [1, 5], "the feet at 60° and 300°");
    check("margin (m)", found.depth_m, 0.4);
}

#[test]
fn a_settling_foot_of_six_moves_nothing() {
    let worst = settlement::worst(&hexagon(), &center(), 0.3).unwrap();
    check("margin (m)", worst.margin_m, 0.75_f64.sqrt());
}

/// A tripod of 1 m radius on level ground with its center of mass `height` (m) over the middle:
/// the margin left when one foot settles by `settlement` (m).
///
/// The line of the two other feet is 3/2 from the foot and 1/2 from the center. With the turn
/// sin t = s / (3/2) the foot comes to 3/2 cos t and the center of mass to cos t / 2 + h sin t.
fn tripod_settled(height: f64, settlement: f64) -> f64 {
    let turn = (settlement / 1.5).asin();
    let foot = 1.5 * turn.cos();
    let com = 0.5 * turn.cos() + height * turn.sin();
    let half_apex = (0.75_f64.sqrt() / foot).atan();
    com.min((foot - com) * half_apex.sin())
}

#[test]
fn a_tripod_tips_about_the_line_of_its_two_other_feet() {
    let feet: Vec<_> = [0, 2, 4].map(|k| Point3::new(hexagon()[k].x, hexagon()[k].y, 0.0)).into();
    for (height, depth) in [(1.0, 0.0), (1.0, 0.2), (0.4, 0.5), (2.0, 0.3)] {
        let com = Point3::new(0.0, 0.0, height);
        let worst = settlement::worst(&feet, &com, depth).unwrap();
        check("margin (m)", worst.margin_m, tripod_settled(height, depth));
    }
}

#[test]
fn a_high_tripod_tips_over_its_settled_foot() {
    // The center of mass passes the foot when h tan t > 1.
    let feet: Vec<_> = [0, 2, 4].map(|k| Point3::new(hexagon()[k].x, hexagon()[k].y, 0.0)).into();
    let critical = 1.5 * (1.0_f64 / 3.0).atan().sin();
    let left =
        |depth| settlement::worst(&feet, &Point3::new(0.0, 0.0, 3.0), depth).unwrap().margin_m;
    assert!(left(critical - 1e-3) > 0.0 && left(critical + 1e-3) < 0.0);
    check("margin at the critical depth (m)", left(critical), 0.0);
}

#[test]
fn a_settlement_deeper_than_the_foot_can_swing_leaves_nothing() {
    let feet: Vec<_> = [0, 2, 4].map(|k| hexagon()[k]).into();
    let worst = settlement::worst(&feet, &center(), 10.0).unwrap();
    assert!(worst.margin_m < 0.0, "{worst:?}");
}

#[test]
fn five_equal_springs_of_a_hexagon_carry_five_three_two_three_five() {
    let loads = spring_share(&without(&[0]), &center(), 18.0).unwrap();
    for (load, expected) in loads.iter().zip([5.0, 3.0, 2.0, 3.0, 5.0]) {
        check("load (N)", *load, expected);
    }
}

#[test]
fn a_pressed_foot_of_a_hexagon_keeps_half_of_its_preload_and_relieves_its_neighbors() {
    // The rover yields by the share 1/6 + 1/3 cos(60° k) of the preload at the k-th foot from it.
    let preload = [6.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    let loads = preloaded_share(&hexagon(), &center(), 60.0, &preload).unwrap();
    for (load, expected) in loads.iter().zip([13.0, 8.0, 10.0, 11.0, 10.0, 8.0]) {
        check("load (N)", *load, expected);
    }
    // One that hangs too high carries nothing: the other five share by their own rule.
    let preload = [-30.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    let loads = preloaded_share(&hexagon(), &center(), 18.0, &preload).unwrap();
    for (load, expected) in loads.iter().zip([0.0, 5.0, 3.0, 2.0, 3.0, 5.0]) {
        check("load (N)", *load, expected);
    }
}

#[test]
fn three_feet_carry_by_the_law_of_levers() {
    let feet = [Point3::origin(), Point3::new(4.0, 0.0, 1.0), Point3::new(0.0, 2.0, -1.0)];
    let loads = spring_share(&feet, &Point3::new(1.0, 0.5, 3.0), 100.0).unwrap();
    for (load, expected) in loads.iter().zip([50.0, 25.0, 25.0]) {
        check("load (N)", *load, expected);
    }
}

#[test]
fn a_spring_that_would_pull_carries_nothing() {
    // A square of feet with the center of mass beside one of them: the opposite foot lifts, and
    // the others carry by levers.
    let corner = |x: f64, y: f64| Point3::new(x, y, 0.0);
    let feet = [corner(1.0, 1.0), corner(-1.0, 1.0), corner(-1.0, -1.0), corner(1.0, -1.0)];
    let loads = spring_share(&feet, &Point3::new(0.8, 0.8, 1.0), 10.0).unwrap();
    for (load, expected) in loads.iter().zip([8.0, 1.0, 0.0, 1.0]) {
        check("load (N)", *load, expected);
    }
}
