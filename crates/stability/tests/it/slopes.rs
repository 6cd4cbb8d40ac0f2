//! Stances on steep and slippery ground, and how far regions reach.

use std::f64::consts::TAU;

use geometry::ConvexRegion;
use nalgebra::{Point3, Unit, Vector2, Vector3};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use stability::force_region::{cones, region};
use stability::{ConeModel, Contact};

use crate::hexagon;

pub fn extent_of(region: &ConvexRegion, a: f64, b: f64) -> f64 {
    let along = Vector2::new(a, b);
    match region {
        ConvexRegion::Area(polygon) => {
            polygon.vertices().iter().map(|v| v.coords.dot(&along)).fold(f64::MIN, f64::max)
        }
        ConvexRegion::Point(p) => p.coords.dot(&along),
        ConvexRegion::Empty => f64::NEG_INFINITY,
    }
}

/// A stance of 3 to 7 feet about the origin; steep ground and little friction among them.
pub fn stance(rng: &mut ChaCha8Rng) -> Vec<Contact> {
    let n = rng.random_range(3..=7);
    let steepest = [0.1, 0.6, 1.4][rng.random_range(0..3)];
    let slippery = [0.0, 0.2, 0.7][rng.random_range(0..3)];
    (0..n)
        .map(|i| {
            let yaw = TAU * (i as f64 + rng.random_range(-0.3..0.3)) / n as f64;
            let radius = rng.random_range(1.0..3.0);
            let height = rng.random_range(-0.8..0.8);
            let (tilt, fall) = (rng.random_range(0.0..steepest), rng.random_range(0.0..TAU));
            Contact {
                position: Point3::new(radius * yaw.cos(), radius * yaw.sin(), height),
                normal: Unit::new_normalize(Vector3::new(
                    f64::sin(tilt) * f64::cos(fall),
                    f64::sin(tilt) * f64::sin(fall),
                    f64::cos(tilt),
                )),
                friction: slippery + rng.random_range(0.0..0.2),
            }
        })
        .collect()
}

pub fn level(points: &[Point3<f64>], friction: f64) -> Vec<Contact> {
    points.iter().map(|p| Contact::level(*p, friction)).collect()
}

pub fn flat_hexagon() -> Vec<Point3<f64>> {
    hexagon().iter().map(|p| Point3::new(p.x, p.y, 0.0)).collect()
}

pub fn region_with(contacts: &[Contact]) -> stability::ForceRegion {
    let sets = cones(contacts, ConeModel::default()).expect("the contacts are sound");
    region(&sets, 1.0).expect("the sets are sound")
}
