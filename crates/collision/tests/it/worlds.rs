//! Worlds that are hard on a check: spikes, thin boxes, rocks, holes.

use std::sync::Arc;

use collision::Obstacle;
use geometry::{Grid, Raster};
use nalgebra::{Isometry3, Point2, Point3, UnitQuaternion, Vector3};
use parry3d_f64::math::Vector;
use parry3d_f64::shape::SharedShape;
use rand::{Rng, RngExt};
use rover::{Configuration, LegAngles, LegId, Posture, Robot};
use terrain::{ElevationMap, Source};

use crate::oracle::Thing;

/// Joint angles: half of them uniform within the limits, half within 0.5 rad of the bent pose.
pub fn load(robot: &Robot, leg: LegId, index: usize, rng: &mut impl Rng) -> LegAngles {
    let model = robot.leg(leg);
    let bent = robot.pose("bent").unwrap().legs[leg.0];
    LegAngles::from_fn(|j, _| {
        if index.is_multiple_of(2) {
            rng.random_range(model.lower[j]..model.upper[j])
        } else {
            bent[j] + rng.random_range(-0.5..0.5)
        }
    })
}

/// All wheels on z = 0 in the bent pose.
pub fn standing(robot: &Robot) -> Configuration {
    let mut configuration = robot.pose("bent").unwrap();
    let posture = Posture::new(robot, &configuration);
    let low = posture.wheel(robot, LegId(0)).lowest_point(&Vector3::z_axis());
    configuration.world_from_base.translation.z = -low.z;
    configuration
}

/// A box, turned anyhow.
pub fn block(at: Vector3<f64>, turn: Vector3<f64>, half: Vector3<f64>) -> Thing {
    let world_from_box = Isometry3::from_parts(at.into(), UnitQuaternion::from_scaled_axis(turn));
    Thing {
        obstacle: Obstacle::Box { world_from_box, half_extents: half },
        solids: vec![(world_from_box, SharedShape::cuboid(half.x, half.y, half.z))],
    }
}

/// Thin boxes: plates and rods, 1 cm thick, anyhow about the leg at `leg`.
pub fn thin_boxes(n: usize, around: Vector3<f64>, rng: &mut impl Rng) -> Vec<Thing> {
    let mut any = |most: f64| Vector3::from_fn(|_, _| rng.random_range(-most..most));
    (0..n)
        .map(|i| {
            let (at, turn, size) = (around + any(1.2), any(1.5), any(0.3).abs());
            let rod = i % 2 == 0;
            let half = Vector3::new(size.x + 0.1, if rod { 0.005 } else { size.y + 0.05 }, 0.005);
            block(at, turn, half)
        })
        .collect()
}

/// A rock: the closed mesh of an octahedron stretched and turned anyhow, as mesh and as solid.
pub fn rock(at: Vector3<f64>, size: f64, rng: &mut impl Rng) -> Thing {
    let mut corner = |axis: Vector3<f64>| {
        let off = Vector3::from_fn(|_, _| rng.random_range(-0.2..0.2));
        Point3::from(at + (axis + off) * size)
    };
    let (x, y, z) = (Vector3::x(), Vector3::y(), Vector3::z());
    let vertices: Vec<Point3<f64>> = [x, -x, y, -y, z, -z].into_iter().map(&mut corner).collect();
    // Any three axes that follow each other by the right hand, once in each octant.
    let triangles = vec![
        [0, 2, 4],
        [2, 1, 4],
        [1, 3, 4],
        [3, 0, 4],
        [2, 0, 5],
        [1, 2, 5],
        [3, 1, 5],
        [0, 3, 5],
    ];
    // An octahedron whose corners were moved is four tetrahedra about its long diagonal.
    let around = [0, 2, 1, 3];
    let solids = (0..4)
        .map(|i| {
            let corners = [4, 5, around[i], around[(i + 1) % 4]];
            let points: Vec<Vector> = corners
                .iter()
                .map(|c| Vector::new(vertices[*c].x, vertices[*c].y, vertices[*c].z))
                .collect();
            (Isometry3::identity(), SharedShape::convex_hull(&points).unwrap())
        })
        .collect();
    Thing { obstacle: Obstacle::Mesh { vertices, triangles }, solids }
}

/// Level ground at 1 cm with `n` peaks of a single node, 0.05 to 0.8 m high, over a rectangle.
pub fn spikes(min: Point2<f64>, max: Point2<f64>, n: usize, rng: &mut impl Rng) -> ElevationMap {
    let resolution = 0.01;
    let count = |extent: f64| (extent / resolution).round() as usize + 1;
    let (nx, ny) = (count(max.x - min.x), count(max.y - min.y));
    let mut heights = Raster::from_fn(Grid { origin: min, resolution, nx, ny }, |_, _| 0.0_f32);
    for _ in 0..n {
        let at = heights.grid().index(rng.random_range(0..nx), rng.random_range(0..ny));
        heights.values_mut()[at] = rng.random_range(0.05..0.8);
    }
    ElevationMap::new(heights, Source::file("test"))
}

/// Level ground at 5 cm, with `n` unknown discs of up to 0.3 m.
pub fn holes(half_extent: f64, n: usize, rng: &mut impl Rng) -> ElevationMap {
    let resolution = 0.05;
    let count = (2.0 * half_extent / resolution) as usize + 1;
    let origin = Point2::new(-half_extent, -half_extent);
    let mut any = || rng.random_range(-half_extent..half_extent);
    let discs: Vec<(Point2<f64>, f64)> =
        (0..n).map(|_| (Point2::new(any(), any()), any().abs() * 0.3 / half_extent)).collect();
    let grid = Grid { origin, resolution, nx: count, ny: count };
    let heights = Raster::from_fn(grid, |ix, iy| {
        let p = grid.position(ix, iy);
        if discs.iter().any(|(c, r)| (p - c).norm() < *r) { f32::NAN } else { 0.0 }
    });
    ElevationMap::new(heights, Source::file("test"))
}

/// The robot with a box below its chassis.
pub fn with_payload(robot: &Arc<Robot>) -> Arc<Robot> {
    let (com, size) = (Point3::new(0.0, 0.0, -0.5), Vector3::new(0.9, 0.9, 0.5));
    let payload = rover::Payload::boxed(&robot.links()[0].name, 300.0, com, size);
    Arc::new(robot.with_payloads(&[payload]).unwrap())
}
