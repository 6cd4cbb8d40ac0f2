//! Seeded properties: each compares with a slower method that shares no code with the crate.

use geometry::{ConvexPolygon, ConvexRegion, Grid, MaxPyramid, Raster};
use nalgebra::Point2;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

fn random_points(rng: &mut ChaCha8Rng, n: usize) -> Vec<Point2<f64>> {
    (0..n).map(|_| Point2::new(rng.random_range(-2.0..2.0), rng.random_range(-2.0..2.0))).collect()
}

/// Inside the hull of `points` if no line through p has all points on one side: the largest
/// angular gap between the points, seen from p, is at most a half turn.
fn inside_hull_by_angles(points: &[Point2<f64>], p: Point2<f64>) -> bool {
    let mut angles: Vec<f64> = points.iter().map(|q| (q.y - p.y).atan2(q.x - p.x)).collect();
    angles.sort_by(f64::total_cmp);
    let wrap = angles[0] + std::f64::consts::TAU - angles[angles.len() - 1];
    let gap = angles.windows(2).map(|w| w[1] - w[0]).fold(wrap, f64::max);
    gap <= std::f64::consts::PI
}

#[test]
fn depth_is_positive_exactly_inside_the_hull() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    for _ in 0..2_000 {
        let n = rng.random_range(3..9);
        let points = random_points(&mut rng, n);
        let hull = ConvexPolygon::hull(points.clone()).unwrap();
        for p in random_points(&mut rng, 20) {
            let depth = hull.depth_of(p);
            if depth.abs() > 1e-9 {
                assert_eq!(depth > 0.0, inside_hull_by_angles(&points, p), "{p} {points:?}");
            }
        }
    }
}

#[test]
fn an_intersection_holds_exactly_the_points_of_both() {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    for _ in 0..2_000 {
        let a = ConvexPolygon::hull(random_points(&mut rng, 5)).unwrap();
        let b = ConvexPolygon::hull(random_points(&mut rng, 4)).unwrap();
        let shared = a.intersection(&b);
        for p in random_points(&mut rng, 30) {
            let in_both = a.depth_of(p).min(b.depth_of(p));
            if in_both.abs() < 1e-6 {
                continue;
            }
            let in_shared = match &shared {
                ConvexRegion::Area(polygon) => polygon.depth_of(p) > 0.0,
                ConvexRegion::Point(_) | ConvexRegion::Empty => false,
            };
            assert_eq!(in_shared, in_both > 0.0, "{p}");
        }
    }
}

#[test]
fn depth_inside_never_exceeds_the_deepest_point() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    for _ in 0..500 {
        let hull = ConvexPolygon::hull(random_points(&mut rng, 6)).unwrap();
        let (center, best) = hull.deepest_point();
        assert!((hull.depth_of(center) - best).abs() < 1e-9);
        for p in random_points(&mut rng, 200) {
            assert!(hull.depth_of(p) <= best + 1e-7);
        }
    }
}

#[test]
fn the_pyramid_is_never_lower_than_the_surface_and_exact_on_aligned_blocks() {
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let grid = Grid { origin: Point2::new(-3.0, 1.0), resolution: 0.25, nx: 45, ny: 33 };
    let heights = Raster::from_fn(grid, |_, _| rng.random_range(-1.0_f32..1.0));
    let pyramid = MaxPyramid::new(&heights);
    for _ in 0..3_000 {
        let corner = Point2::new(rng.random_range(-3.0..8.0), rng.random_range(1.0..9.0));
        let far =
            corner + nalgebra::Vector2::new(rng.random_range(0.0..3.0), rng.random_range(0.0..3.0));
        let bound = pyramid.max_over(corner, far);
        for _ in 0..20 {
            let p =
                Point2::new(rng.random_range(corner.x..=far.x), rng.random_range(corner.y..=far.y));
            if let Some((z, _)) = heights.surface_at(p) {
                assert!(z <= bound + 1e-6, "{z} above {bound}");
            }
        }
    }
    let highest = heights.values().iter().copied().fold(f32::NEG_INFINITY, f32::max);
    assert_eq!(pyramid.max_over(grid.origin, grid.far_corner()), f64::from(highest));
}
