//! The energy margin against turning the center of mass about edges by brute force.

use nalgebra::{Point3, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use stability::energy::{TippingEdges, margin};
use stability::support_polygon::regular;

use crate::hexagon;

/// The greatest rise of `com` while it turns from where it is to over the line through `a` and `b`
/// and beyond, looked at in small steps and then smaller ones.
fn rise_by_turning(a: &Point3<f64>, b: &Point3<f64>, com: &Point3<f64>) -> f64 {
    let axis = (b - a).normalize();
    let height =
        |turn: f64| (a + UnitQuaternion::from_scaled_axis(axis * turn) * (com - a)).z - com.z;
    let step = 1e-3;
    // The side of the edge decides which way is outward: turn to where it first rises.
    let outward = if height(step) > height(-step) { step } else { -step };
    let mut best = (0.0, 0.0);
    for i in 0..3_200 {
        let turn = outward * f64::from(i);
        if height(turn) > best.1 {
            best = (turn, height(turn));
        }
    }
    let (mut low, mut high) = (best.0 - step, best.0 + step);
    for _ in 0..80 {
        let (p, q) = (low + (high - low) / 3.0, high - (high - low) / 3.0);
        if height(p) < height(q) { low = p } else { high = q }
    }
    height(0.5 * (low + high))
}

#[test]
fn the_margin_is_the_rise_of_turning_about_the_edges() {
    let mut rng = ChaCha8Rng::seed_from_u64(51);
    let mut compared = 0;
    for case in 0..200 {
        let contacts: Vec<Point3<f64>> = (0..rng.random_range(3..7))
            .map(|_| Point3::from([2.0, 2.0, 0.6].map(|r: f64| rng.random_range(-r..r))))
            .collect();
        let com = Point3::from([0.5, 0.5, 0.4].map(|r: f64| rng.random_range(-r..r)))
            + Vector3::new(0.0, 0.0, 1.5);
        let Ok(hull) = regular(&contacts) else { continue };
        if hull.depth_of(com.xy()) < 0.01 {
            continue;
        }
        let found = margin(&contacts, &com).unwrap();
        for edge in &found.edges {
            let [a, b] = edge.contacts.map(|i| contacts[i]);
            let expected = rise_by_turning(&a, &b, &com);
            assert!((edge.height_m - expected).abs() < 1e-6, "case {case}: {edge:?} {expected}");
            compared += 1;
        }
        let least = found.edges.iter().map(|e| e.height_m).fold(f64::MAX, f64::min);
        assert_eq!(found.height_m, least);
        assert_eq!(found.edges[found.critical].height_m, least);
    }
    assert!(compared > 150, "{compared}");
}

#[test]
fn a_hexagon_as_high_as_wide_has_its_published_margin() {
    // Center of mass 1 m over the middle of feet at 1 m: √(3/4 + 1) - 1 over each edge.
    let flat: Vec<Point3<f64>> = hexagon().iter().map(|p| Point3::new(p.x, p.y, 0.0)).collect();
    let found = margin(&flat, &Point3::new(0.0, 0.0, 1.0)).unwrap();
    assert!((found.height_m - (1.75_f64.sqrt() - 1.0)).abs() < 1e-12);
    assert!((found.height_m - 0.323).abs() < 5e-4);
}

#[test]
fn the_margin_depends_on_the_height_over_the_edge_alone() {
    let com = Point3::new(0.1, 0.2, 1.0);
    let up = Vector3::new(3.0, -5.0, 100.0);
    let lifted: Vec<Point3<f64>> = hexagon().iter().map(|p| p + up).collect();
    let (low, high) = (margin(&hexagon(), &com).unwrap(), margin(&lifted, &(com + up)).unwrap());
    assert!((low.height_m - high.height_m).abs() < 1e-9);
    assert_eq!(low.critical, high.critical);
}

#[test]
fn the_margin_is_zero_at_an_edge_and_negative_beyond() {
    let flat: Vec<Point3<f64>> = hexagon().iter().map(|p| Point3::new(p.x, p.y, 0.0)).collect();
    let edge = 0.75_f64.sqrt();
    // 30° is the middle of the edge between corners 0 and 1.
    let at = |r: f64| {
        let yaw = std::f64::consts::FRAC_PI_6;
        margin(&flat, &Point3::new(r * yaw.cos(), r * yaw.sin(), 1.0)).unwrap().height_m
    };
    assert!(at(edge).abs() < 1e-12);
    assert!(at(edge - 0.01) > 0.0 && at(edge + 0.01) < 0.0);
}

#[test]
fn on_a_slope_the_peak_of_the_surface_is_shifted_uphill() {
    // Uphill is +x; the center of mass at a fixed height over the slope's middle.
    let slope = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), -0.3);
    let contacts: Vec<Point3<f64>> =
        hexagon().iter().map(|p| slope * Point3::new(p.x, p.y, 0.0)).collect();
    let edges = TippingEdges::new(&contacts).unwrap();
    let grid = geometry::Grid {
        origin: nalgebra::Point2::new(-1.0, -1.0),
        resolution: 0.05,
        nx: 41,
        ny: 41,
    };
    let surface = edges.surface(&grid, 1.0);
    let peak = (0..surface.len())
        .filter(|i| surface[*i].is_finite())
        .max_by(|a, b| surface[*a].total_cmp(&surface[*b]))
        .unwrap();
    let place = grid.position(peak % grid.nx, peak / grid.nx);
    assert!(place.x > 0.05 && place.y.abs() < 0.06, "{place}");
    // Outside of the support there is nothing; the slice is the surface along a line.
    assert!(surface[0].is_nan());
    let com = Point3::new(-0.5, 0.0, 1.0);
    let slice = edges.slice(&com, 0.0, 1.0, 21);
    let row: Vec<f64> = (0..21).map(|i| surface[20 * grid.nx + 10 + i]).collect();
    assert!(slice.iter().zip(&row).all(|(a, b)| (a - b).abs() < 1e-9), "{slice:?} {row:?}");
}
