//! The wheel against the ground: closed forms on planes, point clouds on rough ground.

use collision::{contact_center, wheel_ground};
use geometry::{Grid, Raster};
use nalgebra::{Isometry3, Point2, UnitQuaternion, Vector3};
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
