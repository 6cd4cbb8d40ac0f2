//! The wheel against the ground: closed forms on planes, point clouds on rough ground.

use collision::{contact_center, wheel_ground};
use geometry::{Grid, Raster};
use nalgebra::{Isometry3, Point2, Point3, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rover::WheelPose;
use terrain::{ElevationMap, Source};

use crate::plane;

fn wheel(center: Vector3<f64>, turn: Vector3<f64>) -> WheelPose {
    WheelPose {
        world_from_wheel: Isometry3::from_parts(
            center.into(),
            UnitQuaternion::from_scaled_axis(turn),
        ),
        radius: 0.264,
        width: 0.24,
        ball: false,
    }
}

#[test]
fn on_level_ground_the_gap_is_height_less_radius() {
    let level = wheel(Vector3::new(0.13, 0.27, 0.5), Vector3::new(0.0, 0.0, 1.1));
    let ground = wheel_ground(&level, &plane(), |_| true);
    let gap = ground.nearest.unwrap();
    assert!((gap.gap - (0.5 - 0.264)).abs() < 1e-9, "{gap:?}");
    assert!(!ground.unknown);
}

#[test]
fn a_cambered_wheel_is_lower_on_its_edge() {
    let g: f64 = 0.25;
    let tilted = wheel(Vector3::new(0.0, 0.0, 1.0), Vector3::new(g, 0.0, 0.0));
    let gap = wheel_ground(&tilted, &plane(), |_| true).nearest.unwrap();
    assert!((gap.gap - (1.0 - 0.264 * g.cos() - 0.12 * g.sin())).abs() < 1e-9, "{gap:?}");
}

#[test]
fn unknown_ground_below_the_wheel_is_told() {
    let edge = wheel(Vector3::new(19.9, 0.0, 0.3), Vector3::zeros());
    assert!(wheel_ground(&edge, &plane(), |_| true).unknown);
    let off = wheel(Vector3::new(40.0, 0.0, 0.3), Vector3::zeros());
    let ground = wheel_ground(&off, &plane(), |_| true);
    assert!(ground.unknown && ground.nearest.is_none());
}

/// Every point of the wheel's skin on a fine lattice against the surface: an upper bound of the
/// gap that comes near it.
fn gap_by_cloud(wheel: &WheelPose, map: &ElevationMap) -> f64 {
    let (n_around, n_across, n_in) = (720, 80, 40);
    let mut least = f64::INFINITY;
    let mut try_point = |x: f64, y: f64, z: f64| {
        let p = wheel.world_from_wheel * nalgebra::Point3::new(x, y, z);
        if let Some(ground) = map.height_at(p.xy()) {
            least = least.min(p.z - ground);
        }
    };
    for i in 0..n_around {
        let (s, c) = (std::f64::consts::TAU * f64::from(i) / f64::from(n_around)).sin_cos();
        for j in 0..=n_across {
            let y = wheel.width * (f64::from(j) / f64::from(n_across) - 0.5);
            try_point(wheel.radius * c, y, wheel.radius * s);
        }
        for k in 0..n_in {
            let r = wheel.radius * f64::from(k) / f64::from(n_in);
            for side in [-0.5, 0.5] {
                try_point(r * c, side * wheel.width, r * s);
            }
        }
    }
    least
}

#[test]
fn on_rough_ground_the_gap_is_that_of_a_dense_cloud() {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    for resolution in [0.05, 0.15, 0.4] {
        let n = (4.0 / resolution) as usize;
        let grid = Grid { origin: Point2::new(-2.0, -2.0), resolution, nx: n, ny: n };
        let rough = 0.3 * resolution as f32;
        let heights = Raster::from_fn(grid, |_, _| rng.random_range(-rough..rough));
        let map = ElevationMap::new(heights, Source::file("test"));
        for _ in 0..25 {
            let center = Vector3::from_fn(|_, _| rng.random_range(-1.0..1.0));
            let turn = Vector3::from_fn(|_, _| rng.random_range(-0.5..0.5));
            let wheel = wheel(center, turn);
            let gap = wheel_ground(&wheel, &map, |_| true).nearest.unwrap().gap;
            let cloud = gap_by_cloud(&wheel, &map);
            // The cloud's spacing of about 3 mm on slopes up to 0.6 misses the lowest by 2 mm.
            assert!(gap <= cloud + 1e-9, "{gap} above the cloud's {cloud}");
            assert!(gap > cloud - 4e-3, "{gap} far below the cloud's {cloud}");
        }
    }
}

/// Height of a solid wheel's (or ball's) lower side above `p`: the vertical line cut to the solid in the
/// wheel's own frame.
fn lower_side(wheel: &WheelPose, p: Point2<f64>) -> Option<f64> {
    let line = |z: f64| wheel.world_from_wheel.inverse_transform_point(&Point3::new(p.x, p.y, z));
    let (start, way) = (line(0.0), line(1.0) - line(0.0));
    // Roots of |start + z way|² = radius², of all coordinates or of those across the axle.
    let (from, along) = match wheel.ball {
        true => (start.coords, way),
        false => (Vector3::new(start.x, 0.0, start.z), Vector3::new(way.x, 0.0, way.z)),
    };
    let (a, b, c) =
        (along.dot(&along), from.dot(&along), from.dot(&from) - wheel.radius * wheel.radius);
    let (mut low, mut high) = (f64::NEG_INFINITY, f64::INFINITY);
    if a > 1e-20 {
        let root = (b * b - a * c).sqrt();
        (low, high) = ((-b - root) / a, (-b + root) / a);
    }
    if low.is_nan() || (a <= 1e-20 && c > 0.0) {
        return None;
    }
    if !wheel.ball {
        let sides = [-0.5, 0.5].map(|side| (side * wheel.width - start.y) / way.y);
        low = low.max(sides[0].min(sides[1]));
        high = high.min(sides[0].max(sides[1]));
    }
    (low <= high).then_some(low)
}

/// The smallest gap along all edges of the map by dense sampling and golden section.
fn gap_along_edges(wheel: &WheelPose, map: &ElevationMap) -> f64 {
    let grid = map.grid();
    let node = |ix, iy| (grid.position(ix, iy), f64::from(*map.heights().at(ix, iy)));
    let mut least = f64::INFINITY;
    let far = wheel.radius.hypot(wheel.width) + grid.resolution;
    for iy in 0..grid.ny - 1 {
        for ix in 0..grid.nx - 1 {
            if (grid.position(ix, iy) - wheel.center().xy()).norm() > far + grid.resolution {
                continue;
            }
            let ends = [(ix, iy), (ix + 1, iy), (ix, iy + 1)].map(|(ix, iy)| node(ix, iy));
            for [(a, za), (b, zb)] in [[ends[0], ends[1]], [ends[0], ends[2]], [ends[1], ends[2]]] {
                let gap = |t: f64| {
                    let lower = lower_side(wheel, a + (b - a) * t)?;
                    Some(lower - (za + (zb - za) * t))
                };
                let or_far = |t: f64| gap(t).unwrap_or(f64::INFINITY);
                let n = 200;
                let best = (0..=n).map(|i| i as f64 / n as f64).filter(|t| gap(*t).is_some());
                let Some(t) = best.min_by(|a, b| or_far(*a).total_cmp(&or_far(*b))) else {
                    continue;
                };
                let step = 1.0 / n as f64;
                let (mut low, mut high) = ((t - step).max(0.0), (t + step).min(1.0));
                for _ in 0..50 {
                    let third = (high - low) / 3.0;
                    let (g, h) = (or_far(low + third), or_far(high - third));
                    // Beside the wheel is on the far side of the best sample.
                    let upper_goes = g < h || (h.is_infinite() && (g.is_finite() || high > t));
                    if upper_goes && !(g.is_infinite() && low + third < t) {
                        high -= third;
                    } else {
                        low += third;
                    }
                }
                least = least.min(or_far(t)).min(or_far(0.5 * (low + high)));
            }
        }
    }
    least
}

#[test]
fn on_rough_ground_no_edge_is_nearer_than_the_gap_and_where_one_decides_it_is_that_near() {
    let mut rng = ChaCha8Rng::seed_from_u64(9);
    let mut decided = 0;
    for resolution in [0.05, 0.13, 0.4] {
        let n = (3.0 / resolution) as usize;
        let grid = Grid { origin: Point2::new(-1.5, -1.5), resolution, nx: n, ny: n };
        let rough = 0.4 * resolution as f32;
        let heights = Raster::from_fn(grid, |_, _| rng.random_range(-rough..rough));
        let map = ElevationMap::new(heights, Source::file("test"));
        for i in 0..45 {
            let center = Vector3::from_fn(|_, _| rng.random_range(-0.5..0.5));
            // Axles nearly level, leaning by anything, and upright; balls too.
            let lean = [0.02, 1.0, 3.0][i % 3];
            let turn = match i {
                0..3 => Vector3::x() * [0.0, 0.5, 1.0][i] * std::f64::consts::PI,
                _ => Vector3::from_fn(|_, _| rng.random_range(-lean..lean)),
            };
            let wheel = WheelPose { ball: i % 9 == 8, ..wheel(center, turn) };
            let gap = wheel_ground(&wheel, &map, |_| true).nearest.unwrap().gap;
            let edges = gap_along_edges(&wheel, &map);
            assert!(gap <= edges + 1e-8, "{wheel:?}: {gap}, an edge {edges}");
            decided += usize::from(gap > edges - 1e-8);
        }
    }
    // Within a triangle only its own lowest point can be nearer.
    assert!(decided > 60, "{decided}");
}

#[test]
fn lifting_the_wheel_lifts_the_gap() {
    let mut rng = ChaCha8Rng::seed_from_u64(6);
    let grid = Grid { origin: Point2::new(-2.0, -2.0), resolution: 0.1, nx: 40, ny: 40 };
    let map = ElevationMap::new(
        Raster::from_fn(grid, |_, _| rng.random_range(-0.1_f32..0.1)),
        Source::file("test"),
    );
    for _ in 0..50 {
        let turn = Vector3::from_fn(|_, _| rng.random_range(-0.4..0.4));
        let low = wheel(Vector3::new(0.1, 0.2, 0.3), turn);
        let high = wheel(Vector3::new(0.1, 0.2, 0.8), turn);
        let gap = |w| wheel_ground(&w, &map, |_| true).nearest.unwrap().gap;
        assert!((gap(high) - gap(low) - 0.5).abs() < 1e-5);
    }
}

#[test]
fn a_wheel_with_camber_stands_on_its_rim() {
    for g in [0.03_f64, 0.1, 0.3] {
        let tilted = wheel(Vector3::new(0.1, 0.2, 0.3), Vector3::new(g, 0.0, 0.0));
        let gap = wheel_ground(&tilted, &plane(), |_| true).nearest.unwrap();
        let contact = contact_center(&tilted, &plane(), &gap);
        // The lower rim: half a width along the axle, and the radius leans inward by sin g.
        let aside = 0.2 - 0.12 * g.cos() + 0.264 * g.sin();
        assert!((contact.y - aside).abs() < 1e-6, "{contact} {aside}");
    }
}

#[test]
fn a_level_wheel_touches_in_the_middle_of_its_width_even_if_it_hovers_or_the_ground_is_rough() {
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    for _ in 0..100 {
        let grid = Grid { origin: Point2::new(-2.0, -2.0), resolution: 0.1, nx: 41, ny: 41 };
        let rough = Raster::from_fn(grid, |_, _| rng.random_range(0.0..2e-4_f32));
        let map = ElevationMap::new(rough, Source::file("test"));
        let yaw = rng.random_range(-3.0..3.0);
        let hover = rng.random_range(0.0..0.01);
        let center = Vector3::new(rng.random_range(-0.5..0.5), 0.2, 0.264 + hover);
        let wheel = wheel(center, Vector3::new(0.0, 0.0, yaw));
        let gap = wheel_ground(&wheel, &map, |_| true).nearest.unwrap();
        let contact = contact_center(&wheel, &map, &gap);
        // The ground's plane leans by less than 2 mrad: 0.5 mm at the wheel's radius.
        assert!((contact.xy().coords - center.xy()).norm() < 2e-3, "{contact} {center}");
    }
}
