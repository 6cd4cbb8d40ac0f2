//! Points, planes and parts of a map.

use geometry::{Grid, Raster};
use nalgebra::{Point2, Vector3};
use terrain::{ElevationMap, Source, TerrainError};

fn grid(n: usize, resolution: f64) -> Grid {
    let origin = -0.5 * resolution * (n - 1) as f64;
    Grid { origin: Point2::new(origin, origin), resolution, nx: n, ny: n }
}

fn sloping(n: usize, resolution: f64, height: impl Fn(Point2<f64>) -> f64) -> ElevationMap {
    let grid = grid(n, resolution);
    let heights = Raster::from_fn(grid, |ix, iy| height(grid.position(ix, iy)) as f32);
    ElevationMap::new(heights, Source::file("test"))
}

#[test]
fn the_plane_is_flat_at_zero_over_its_extent() {
    let plane = ElevationMap::plane(20.0, 0.5).unwrap();
    for (x, y) in [(0.0, 0.0), (-20.0, 20.0), (19.99, -3.3)] {
        assert_eq!(plane.height_at(Point2::new(x, y)), Some(0.0));
        assert_eq!(plane.normal_at(Point2::new(x, y)).unwrap().into_inner(), Vector3::z());
    }
    assert_eq!(plane.height_at(Point2::new(20.01, 0.0)), None);
    assert_eq!(plane.max_over(Point2::new(-1.0, -1.0), Point2::new(1.0, 1.0)), 0.0);
}

#[test]
fn sizes_without_end_are_refused_before_memory_is_taken() {
    assert!(matches!(ElevationMap::plane(1e8, 1e-4), Err(TerrainError::TooManyNodes { .. })));
    for (half, resolution) in [(f64::NAN, 0.5), (20.0, 0.0), (20.0, -1.0), (0.0, 0.5)] {
        let refused = ElevationMap::plane(half, resolution);
        assert!(matches!(refused, Err(TerrainError::OutOfRange { .. })), "{half} {resolution}");
    }
}

#[test]
fn a_footprint_on_a_slope_gets_the_slopes_plane_whatever_the_resolution() {
    for resolution in [0.05, 0.3, 1.0] {
        let map = sloping(41, resolution, |p| 0.3 * p.x - 0.1 * p.y + 2.0);
        let p = Point2::new(0.13, -0.21);
        let plane = map.footprint_plane(p, 0.75).unwrap();
        let expected = Vector3::new(-0.3, 0.1, 1.0).normalize();
        assert!((plane.height - (0.3 * p.x - 0.1 * p.y + 2.0)).abs() < 1e-6);
        assert!((plane.normal.into_inner() - expected).norm() < 1e-6);
        assert!(plane.roughness < 1e-6 && plane.known_share == 1.0);
    }
}

#[test]
fn a_footprint_keeps_its_roughness_far_from_height_zero() {
    // Nodes at +h and -h like a chess board: the plane is level, the residual is h.
    for lift in [0.0, -4455.0] {
        let grid = grid(20, 0.05);
        let board =
            |ix: usize, iy: usize| if (ix + iy).is_multiple_of(2) { 0.0625 } else { -0.0625 };
        let heights = Raster::from_fn(grid, |ix, iy| (lift + board(ix, iy)) as f32);
        let map = ElevationMap::new(heights, Source::file("board"));
        // 10 x 10 nodes: as many of either color, and level.
        let plane = map.footprint_plane(Point2::origin(), 0.5).unwrap();
        assert!((plane.roughness - 0.0625).abs() < 2e-4, "{}", plane.roughness);
        assert!((plane.height - lift).abs() < 1e-3);
    }
}

#[test]
fn a_footprint_mostly_off_the_map_or_unknown_has_no_plane() {
    let map = sloping(41, 0.05, |_| 0.0);
    assert!(map.footprint_plane(Point2::new(1.0, 0.0), 0.75).is_none(), "half is off the map");
    assert!(map.footprint_plane(Point2::new(0.8, 0.0), 0.75).is_some());
    assert!(map.footprint_plane(Point2::new(f64::NAN, 0.0), 0.75).is_none());
    for far in [
        Point2::new(2.5, 0.0),
        Point2::new(0.0, 2.5),
        Point2::new(-2.5, -9.0),
        Point2::new(9.0, 2.0),
    ] {
        assert!(map.footprint_plane(far, 0.75).is_none(), "all of it is off the map: {far}");
    }
    assert!(map.footprint_plane(Point2::origin(), 0.0).is_none());
    let holed = sloping(41, 0.05, |p| if p.x > 0.06 { f64::NAN } else { 0.0 });
    assert!(holed.footprint_plane(Point2::new(0.05, 0.0), 0.75).is_none());
    let known = holed.footprint_plane(Point2::new(-0.2, 0.0), 0.75).unwrap().known_share;
    // Columns -0.55 to 0.15 are under the foot, known up to 0.05: 13 of 15.
    assert!((known - 13.0 / 15.0).abs() < 1e-12, "{known}");
}

#[test]
fn moving_a_map_moves_the_ground_and_keeps_the_sources_coordinates() {
    let map = sloping(11, 1.0, |p| p.x).with_frame_offset(Vector3::new(100.0, 200.0, 300.0));
    let moved = map.translated(Vector3::new(-10.0, -10.0, 2.0));
    assert_eq!(moved.height_at(Point2::new(-9.0, -10.0)), Some(3.0));
    assert_eq!(moved.frame_offset(), Vector3::new(110.0, 210.0, 298.0));
    assert_eq!(moved.max_over(Point2::new(-6.1, -11.0), Point2::new(-6.0, -10.0)), 7.0);
}

#[test]
fn a_crop_is_the_same_ground() {
    let map = sloping(41, 0.5, |p| p.x * p.y);
    let crop = map.cropped(Point2::new(3.0, -2.0), 4.0).unwrap();
    assert_eq!((crop.grid().nx, crop.grid().ny), (9, 9));
    for (x, y) in [(1.0, -4.0), (3.3, -1.7), (5.0, 0.0)] {
        let p = Point2::new(x, y);
        let off = crop.height_at(p).unwrap() - map.height_at(p).unwrap();
        assert!(off.abs() < 1e-12, "off by {off} at {p}");
    }
    assert_eq!(crop.height_at(Point2::new(5.1, 0.0)), None);
    let outside = map.cropped(Point2::new(30.0, 0.0), 4.0);
    assert!(matches!(outside, Err(TerrainError::CropTooSmall { .. })));
    let endless = map.cropped(Point2::new(0.0, 0.0), f64::NAN);
    assert!(matches!(endless, Err(TerrainError::OutOfRange { field: "crop.width_m", .. })));
}

#[test]
fn resampling_keeps_the_surface_and_its_holes() {
    let map = sloping(21, 0.5, |p| if p.x > 4.0 { f64::NAN } else { p.x * p.x - p.y });
    let fine = map.resampled(0.125).unwrap();
    assert_eq!((fine.grid().nx, fine.grid().ny), (81, 81));
    for iy in 0..81 {
        for ix in 0..81 {
            let here = fine.heights().at(ix, iy);
            match map.height_at(fine.grid().position(ix, iy)) {
                Some(z) => assert!((f64::from(*here) - z).abs() < 1e-5),
                None => assert!(here.is_nan()),
            }
        }
    }
    assert!(matches!(map.resampled(1e-4), Err(TerrainError::TooManyNodes { .. })));
}

#[test]
fn the_version_changes_with_any_height_and_nothing_else() {
    let map = sloping(11, 1.0, |p| p.x);
    let same = sloping(11, 1.0, |p| p.x).with_source(Source::plane());
    assert_eq!(map.version_hash(), same.version_hash());
    assert_eq!(map.version_hash(), map.clone().version_hash());
    let mut versions = vec![map.version_hash()];
    versions.push(map.translated(Vector3::new(1.0, 0.0, 0.0)).version_hash());
    for i in 0..121 {
        let mut heights = map.heights().clone();
        heights.values_mut()[i] += 1e-5;
        versions.push(ElevationMap::new(heights, Source::plane()).version_hash());
    }
    versions.sort_unstable();
    versions.dedup();
    assert_eq!(versions.len(), 123);
}

#[test]
fn infinite_heights_are_unknown() {
    let map = sloping(3, 1.0, |p| if p.x > 0.5 { f64::INFINITY } else { 0.0 });
    assert_eq!(map.height_at(Point2::new(0.5, 0.0)), None);
    assert_eq!(map.max_over(Point2::new(-1.0, -1.0), Point2::new(1.0, 1.0)), 0.0);
}
