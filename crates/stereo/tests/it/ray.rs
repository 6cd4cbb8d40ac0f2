//! Rays against marching and sampling.

use geometry::{Grid, Raster};
use nalgebra::{Isometry3, Point2, Point3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rover::{Configuration, Posture, Robot};
use stereo::ray::{RayScene, Target};
use terrain::{ElevationMap, Source};
use testkit::fixture_text;

pub fn athlete() -> Robot {
    let folder = "robots/athlete";
    let toml = fixture_text(&format!("{folder}/robot.toml"));
    Robot::from_folder(&toml, |urdf| Some(fixture_text(&format!("{folder}/{urdf}"))), |_| None)
        .unwrap()
}

/// The robot in its walking stance with its wheels on the plane z = 0, at the world's origin.
pub fn standing(robot: &Robot) -> (Configuration, Posture) {
    let mut configuration = robot.pose("bent").unwrap();
    let posture = Posture::new(robot, &configuration);
    let wheel = posture.wheel(robot, rover::LegId(0));
    let height = wheel.radius - wheel.world_from_wheel.translation.z;
    configuration.world_from_base = Isometry3::translation(0.0, 0.0, height);
    let posture = Posture::new(robot, &configuration);
    (configuration, posture)
}

fn rough(n: usize, cell: f64, holes: f64, rng: &mut ChaCha8Rng) -> ElevationMap {
    let origin = Point2::new(-0.5 * cell * n as f64, -0.3 * cell * n as f64);
    let grid = Grid { origin, resolution: cell, nx: n, ny: n + 3 };
    let heights = Raster::from_fn(grid, |_, _| {
        let hole = rng.random::<f64>() < holes;
        if hole { f32::NAN } else { rng.random_range(-0.4_f32..0.4) }
    });
    ElevationMap::new(heights, Source::file("test"))
}

fn direction(rng: &mut ChaCha8Rng) -> Vector3<f64> {
    loop {
        let v = Vector3::from_fn(|_, _| rng.random_range(-1.0..1.0));
        if v.norm() > 0.1 {
            return v.normalize();
        }
    }
}

#[test]
fn a_ray_meets_the_ground_where_marching_along_it_does() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut n_hits = 0;
    for round in 0..60 {
        let holes = if round % 3 == 0 { 0.15 } else { 0.0 };
        let map = rough(5 + round % 14, 0.3, holes, &mut rng);
        let scene = RayScene::new(Some(&map), None);
        for _ in 0..60 {
            let origin = Point3::from(Vector3::from_fn(|_, _| rng.random_range(-3.0..3.0)));
            let mut d = direction(&mut rng);
            if rng.random::<f64>() < 0.2 {
                // Along an axis, and straight down.
                d = [-Vector3::z(), Vector3::x(), -Vector3::y()][rng.random_range(0..3)];
            }
            let reach = 8.0;
            // Height above the surface changes sign between two steps within one triangle's known part.
            let above = |t: f64| {
                let p = origin + d * t;
                map.height_at(p.xy()).map(|z| p.z - z)
            };
            let n = 16_000;
            let step = reach / f64::from(n);
            let crossing = (0..n).map(|i| f64::from(i) * step).find(
                |t| matches!((above(*t), above(t + step)), (Some(a), Some(b)) if a * b <= 0.0),
            );
            let hit = scene.cast(&origin, &d, reach);
            match (crossing, hit) {
                (Some(t), Some(hit)) => {
                    // Marching may step over a thin ridge; the ray then hits before.
                    assert!(hit.distance < t + step + 1e-9, "{} {t}", hit.distance);
                    assert!(above(hit.distance).is_none_or(|a| a.abs() < 1e-6));
                    assert_eq!(hit.target, Target::Ground);
                    if let Some(normal) = map.normal_at((origin + d * hit.distance).xy()) {
                        // On an edge either triangle's will do.
                        n_hits += usize::from(hit.normal.angle(&normal) < 1e-6);
                    }
                }
                (Some(t), None) => panic!("missed at {t}"),
                (None, Some(hit)) => {
                    let a = above(hit.distance);
                    assert!(a.is_none_or(|a| a.abs() < 1e-6), "{a:?} at {}", hit.distance);
                }
                (None, None) => {}
            }
        }
    }
    assert!(n_hits > 250, "{n_hits}");
}

#[test]
fn a_ray_meets_the_robot_where_its_distance_falls_to_zero() {
    let robot = athlete();
    let (_, posture) = standing(&robot);
    let scene = RayScene::new(None, Some((&robot, &posture)));
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let distance = |p: &Point3<f64>| {
        scene.solids().iter().map(|s| s.distance(p)).fold(f64::INFINITY, f64::min)
    };
    let mut n_hits = 0;
    for _ in 0..1500 {
        let origin = Point3::new(0.0, 0.0, 1.0) + direction(&mut rng) * 6.0;
        let aim = Point3::new(0.0, 0.0, 0.8) + direction(&mut rng) * rng.random_range(0.0..3.0);
        let d = (aim - origin).normalize();
        // Sphere tracing: the distance is a step that passes nothing.
        let mut t = 0.0;
        while t < 12.0 && distance(&(origin + d * t)) > 1e-7 {
            t += distance(&(origin + d * t));
        }
        match scene.cast(&origin, &d, 12.0) {
            Some(hit) => {
                assert!((hit.distance - t).abs() < 1e-3, "{} {t}", hit.distance);
                assert!(hit.normal.dot(&d) < 0.0 && (hit.normal.norm() - 1.0).abs() < 1e-9);
                let Target::Link(link) = hit.target else { panic!("no ground here") };
                let p = origin + d * hit.distance;
                let of_link = scene.solids().iter().filter(|s| s.link == link);
                assert!(of_link.map(|s| s.distance(&p)).fold(1.0, f64::min) < 1e-6);
                n_hits += 1;
            }
            // Grazing rays end short of the surface.
            None => assert!(t >= 12.0 || distance(&(origin + d * t)) > 0.0, "missed at {t}"),
        }
    }
    assert!(n_hits > 300, "{n_hits}");
    let down = scene.cast(&Point3::new(0.0, 0.0, 5.0), &-Vector3::z(), 10.0).unwrap();
    assert!((down.normal - Vector3::z()).norm() < 1e-9, "the deck faces up");
    assert!(!scene.sees(&Point3::new(0.0, 0.0, 5.0), &Point3::origin(), 1e-3));
    assert!(scene.sees(&Point3::new(4.0, 4.0, 5.0), &Point3::new(4.0, 4.0, 0.0), 1e-3));
}
