//! The fast layers against going through every window, on random ground with holes.

use geometry::{Grid, Raster};
use nalgebra::{Matrix3, Point2, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use terrain::traversability::{Limits, explain_cell, traversability};
use terrain::{ElevationMap, Source};

/// Random walks of height, with single holes and a missing rectangle.
fn rough_map(rng: &mut ChaCha8Rng, nx: usize, ny: usize, lift: f64) -> ElevationMap {
    let resolution = 0.02 + 0.1 * rng.random::<f64>();
    let grid = Grid { origin: Point2::new(-3.0, 7.0), resolution, nx, ny };
    let wave: Vec<[f64; 4]> = (0..6).map(|_| std::array::from_fn(|_| rng.random())).collect();
    let gap = (rng.random_range(0..nx), rng.random_range(0..ny));
    let heights = Raster::from_fn(grid, |ix, iy| {
        let (x, y) = (ix as f64, iy as f64);
        let sum = wave.iter().map(|w| 0.2 * w[0] * (w[1] * x + w[2] * y + 6.0 * w[3]).sin());
        let noise = 0.03 * rng.random::<f64>();
        let in_gap = ix >= gap.0 && ix < gap.0 + 9 && iy >= gap.1 && iy < gap.1 + 12;
        let is_hole = in_gap || rng.random::<f64>() < 0.05;
        if is_hole { f32::NAN } else { (lift + sum.sum::<f64>() + noise) as f32 }
    });
    ElevationMap::new(heights, Source::file("random"))
}

/// Plane, residual, step and shares of one window, straight from their definition: the normal
/// equations in meters, the residual from each point's own distance.
struct Oracle {
    slope: f64,
    roughness: f64,
    step: Option<f64>,
    share: f64,
    least_quadrant: f64,
    det: f64,
}

fn oracle(map: &ElevationMap, ix: usize, iy: usize, w: i64) -> Option<Oracle> {
    let grid = map.grid();
    let height = |x: i64, y: i64| {
        let inside = x >= 0 && y >= 0 && x < grid.nx as i64 && y < grid.ny as i64;
        let z = if inside { *map.heights().at(x as usize, y as usize) } else { f32::NAN };
        (!z.is_nan()).then_some(f64::from(z))
    };
    let half = w / 2;
    let (cx, cy) = (ix as i64, iy as i64);
    let mut points = Vec::new();
    let mut quadrants = [0; 4];
    let mut step: Option<f64> = None;
    for dy in -half..=half {
        for dx in -half..=half {
            if let Some(z) = height(cx + dx, cy + dy) {
                let (x, y) = (dx as f64 * grid.resolution, dy as f64 * grid.resolution);
                points.push(Vector3::new(x, y, z));
                if dx != 0 && dy != 0 {
                    quadrants[usize::from(dx > 0) + 2 * usize::from(dy > 0)] += 1;
                }
            }
            let mut around = Vec::new();
            for ny in -1..=1 {
                for nx in -1..=1 {
                    if let Some(z) = height(cx + dx + nx, cy + dy + ny) {
                        around.push(z);
                    }
                }
            }
            let n_neighbors = around.len() - usize::from(height(cx + dx, cy + dy).is_some());
            if n_neighbors >= 2 {
                let high = around.iter().copied().fold(f64::MIN, f64::max);
                let low = around.iter().copied().fold(f64::MAX, f64::min);
                step = Some(step.map_or(high - low, |s: f64| s.max(high - low)));
            }
        }
    }
    if points.len() < 3 {
        return None;
    }
    let n = points.len() as f64;
    let mean = points.iter().sum::<Vector3<f64>>() / n;
    let mut normal = Matrix3::zeros();
    let mut right = Vector3::zeros();
    for p in &points {
        let row = Vector3::new(p.x, p.y, 1.0);
        normal += row * row.transpose();
        right += row * (p.z - mean.z);
    }
    let d = points.iter().map(|p| p - mean);
    let (cxx, cyy, cxy) = d.fold((0.0, 0.0, 0.0), |(xx, yy, xy), d| {
        (xx + d.x * d.x / n, yy + d.y * d.y / n, xy + d.x * d.y / n)
    });
    let det = (cxx * cyy - cxy * cxy) / grid.resolution.powi(4);
    let plane = normal.lu().solve(&right)?;
    let scale = 1.0 + plane.x * plane.x + plane.y * plane.y;
    let residual = points
        .iter()
        .map(|p| (p.z - mean.z - plane.x * p.x - plane.y * p.y - plane.z).powi(2) / scale);
    Some(Oracle {
        slope: (scale - 1.0).sqrt().atan(),
        roughness: (residual.sum::<f64>() / n).sqrt(),
        step: step.map(|s| (s - 2.0 * grid.resolution * (plane.x.abs() + plane.y.abs())).max(0.0)),
        share: n / (w * w) as f64,
        least_quadrant: f64::from(quadrants.into_iter().min().unwrap()) / (half * half) as f64,
        det,
    })
}

#[track_caller]
fn check_same(found: f32, expected: Option<f64>, tolerance: f64, what: &str) {
    match expected {
        None => assert!(found.is_nan(), "{what}: {found}, expected none"),
        Some(expected) => assert!(
            (f64::from(found) - expected).abs() <= tolerance,
            "{what}: {found}, expected {expected}"
        ),
    }
}

#[test]
fn the_fast_layers_equal_least_squares_in_every_window() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let limits = Limits::default();
    for (nx, ny, w, lift) in [
        (40, 33, 9, 0.0),
        (31, 52, 15, -4455.0),
        (300, 30, 11, 0.0),
        (24, 290, 13, 1e3),
        (20, 20, 31, 0.0),
    ] {
        let map = rough_map(&mut rng, nx, ny, lift);
        let c = map.grid().resolution;
        let layers = traversability(&map, c * w as f64, &limits).unwrap();
        assert_eq!(layers.window, w as usize);
        let det_min = 1e-3 * ((w * w) as f64 / 12.0).powi(2);
        for iy in 0..ny {
            for ix in 0..nx {
                let truth = oracle(&map, ix, iy, w);
                let fit = truth.as_ref().filter(|t| t.det >= det_min);
                let what = |name: &str| format!("{name} at {ix}, {iy} of {nx} x {ny}, w {w}");
                check_same(
                    *layers.slope_rad.at(ix, iy),
                    fit.map(|t| t.slope),
                    1e-5,
                    &what("slope"),
                );
                check_same(
                    *layers.roughness_m.at(ix, iy),
                    fit.map(|t| t.roughness),
                    1e-6,
                    &what("roughness"),
                );
                let step = fit.and_then(|t| t.step);
                check_same(*layers.step_m.at(ix, iy), step, 1e-5, &what("step"));
                let is_known =
                    fit.is_some_and(|t| t.share >= 0.6 - 1e-9 && t.least_quadrant >= 0.3 - 1e-9);
                let goodness = fit.filter(|_| is_known).map(|t| {
                    let ramp = |lo: f64, hi: f64, v: f64| ((hi - v) / (hi - lo)).clamp(0.0, 1.0);
                    ramp(5.0, 20.0, t.slope.to_degrees())
                        .min(ramp(0.01, 0.05, t.roughness))
                        .min(ramp(0.04, 0.13, t.step.unwrap()))
                });
                check_same(*layers.goodness.at(ix, iy), goodness, 1e-4, &what("goodness"));
                let class = *layers.class.at(ix, iy);
                match goodness {
                    None => assert_eq!(class, 0),
                    Some(g) if (g - 0.2).abs() < 1e-4 || (g - 0.6).abs() < 1e-4 => {}
                    Some(g) => assert_eq!(
                        class,
                        if g < 0.2 {
                            1
                        } else if g < 0.6 {
                            2
                        } else {
                            3
                        }
                    ),
                }
                if let Some(t) = truth {
                    check_same(*layers.certainty.at(ix, iy), Some(t.share), 1e-6, "certainty");
                }
            }
        }
    }
}

#[test]
fn an_explained_cell_agrees_with_the_layers() {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let limits = Limits::default();
    for footprint_cells in [5.0, 15.0] {
        let map = rough_map(&mut rng, 40, 40, 0.0);
        let footprint = footprint_cells * map.grid().resolution;
        let layers = traversability(&map, footprint, &limits).unwrap();
        let grid = *layers.class.grid();
        for _ in 0..300 {
            let (ix, iy) = (rng.random_range(0..grid.nx), rng.random_range(0..grid.ny));
            let p = grid.position(ix, iy);
            let cell = explain_cell(&map, p, footprint, &limits).unwrap().unwrap();
            assert_eq!((cell.position, cell.window), (p, layers.window));
            check_same(*layers.slope_rad.at(ix, iy), cell.slope_rad, 1e-5, "slope");
            check_same(*layers.roughness_m.at(ix, iy), cell.roughness_m, 1e-6, "roughness");
            check_same(*layers.step_m.at(ix, iy), cell.step_m, 1e-5, "step");
            check_same(*layers.goodness.at(ix, iy), cell.goodness, 1e-4, "goodness");
            check_same(*layers.certainty.at(ix, iy), Some(cell.certainty), 1e-6, "certainty");
        }
    }
}

#[test]
fn removing_cells_never_raises_certainty_nor_makes_unknown_known() {
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let limits = Limits::default();
    for _ in 0..10 {
        let map = rough_map(&mut rng, 50, 40, 0.0);
        let footprint = 15.0 * map.grid().resolution;
        let mut heights = map.heights().clone();
        for z in heights.values_mut() {
            if rng.random::<f64>() < 0.2 {
                *z = f32::NAN;
            }
        }
        let before = traversability(&map, footprint, &limits).unwrap();
        let fewer = ElevationMap::new(heights, Source::file("fewer"));
        let after = traversability(&fewer, footprint, &limits).unwrap();
        for (b, a) in before.certainty.values().iter().zip(after.certainty.values()) {
            assert!(a <= b);
        }
        for (b, a) in before.class.values().iter().zip(after.class.values()) {
            assert!(*b != 0 || *a == 0);
        }
    }
}

#[test]
fn footprint_planes_equal_least_squares() {
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    for _ in 0..20 {
        let map = rough_map(&mut rng, 40, 40, 0.0);
        for _ in 0..50 {
            let (ix, iy) = (rng.random_range(0..40), rng.random_range(0..40));
            let w = 2 * rng.random_range(1..8) + 1;
            // Half a cell beyond the outermost nodes on each side: the same nodes as the window.
            let width = map.grid().resolution * w as f64;
            let found = map.footprint_plane(map.grid().position(ix, iy), width);
            let truth = oracle(&map, ix, iy, w);
            let det_min = 1e-3 * ((w * w) as f64 / 12.0).powi(2);
            let truth = truth.filter(|t| t.share >= 0.6 && t.det >= det_min);
            let Some(truth) = truth else {
                assert!(found.is_none());
                continue;
            };
            let found = found.unwrap();
            assert!((found.normal.z.acos() - truth.slope).abs() < 1e-6);
            assert!((found.roughness - truth.roughness).abs() < 1e-9);
            assert!((found.known_share - truth.share).abs() < 1e-12);
        }
    }
}
