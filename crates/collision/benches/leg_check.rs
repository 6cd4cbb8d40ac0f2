//! One moving leg against ground, one boulder and the rest of the robot: a configuration, an edge.
//!
//! Load of the budget: the robot stands bent on 32 768 triangles of fractal terrain (the published
//! one where the shared data is, else one of our own); half of the configurations are uniform within
//! the limits, half within 0.5 rad of the pose; edges of 0.3 rad start at the free ones. The baseline
//! is what is usually done: meshes of all shapes, one query of parry a pair behind a test of boxes,
//! and edges as samples 0.01 rad apart. It answers less: what is below the ground or inside the
//! boulder is free to it, and so is what lies between two samples.

use std::sync::Arc;

use collision::{Allowance, Body, Certifier, LegChecker, Obstacle, Scene};
use criterion::{Criterion, criterion_group, criterion_main};
use nalgebra::{Isometry3, Point2, UnitQuaternion, Vector3};
use parry3d_f64::bounding_volume::{Aabb, BoundingVolume};
use parry3d_f64::math::Pose;
use parry3d_f64::query::{ClosestPoints, closest_points};
use parry3d_f64::shape::{Capsule, Cuboid, Cylinder, Shape as ParryShape, TriMesh};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rover::{Configuration, LegAngles, LegId, LinkId, Posture, Robot, Shape};
use terrain::formats::{ReadOptions, read_named};
use terrain::synthetic::{Recipe, generate};
use terrain::{ElevationMap, Source};

/// Sampling of the plain check (rad).
const RESOLUTION: f64 = 0.01;

/// Corners of a round shape's mesh around its axis.
const AROUND: u32 = 20;

fn athlete() -> Arc<Robot> {
    let folder = "robots/athlete/";
    let robot = Robot::from_folder(
        &testkit::fixture_text(&format!("{folder}robot.toml")),
        |file| Some(testkit::fixture_text(&format!("{folder}{file}"))),
        |_| None,
    );
    Arc::new(robot.expect("the fixture loads"))
}

/// 129 x 129 nodes over some 20 m.
fn terrain() -> ElevationMap {
    let name = "fractal_terrain_1.off";
    if let Some(bytes) = testkit::shared_data("leg_check", &format!("klampt_terrains/{name}")) {
        return read_named(name, &bytes, &ReadOptions::default()).expect("the file is a mesh");
    }
    let resolution_m = 20.0 / 128.0;
    let recipe = Recipe { width_m: 20.0, height_m: 20.0, resolution_m, ..Recipe::boulder_field() };
    generate(&recipe, 7).expect("the recipe is good").with_source(Source::file(name))
}

/// The bent pose over the middle of the map, the lowest wheel just on the ground.
fn standing(robot: &Robot, map: &ElevationMap) -> Configuration {
    let mut base = robot.pose("bent").expect("the fixture has the pose");
    let (low, high) = (map.grid().origin, map.grid().far_corner());
    let middle = nalgebra::center(&low, &high);
    base.world_from_base.translation.vector = Vector3::new(middle.x, middle.y, 0.0);
    let posture = Posture::new(robot, &base);
    let height = robot.leg_ids().map(|leg| {
        let below = posture.wheel(robot, leg).lowest_point(&Vector3::z_axis());
        map.height_at(below.xy()).expect("the map is larger than the robot") - below.z
    });
    base.world_from_base.translation.z = height.fold(f64::NEG_INFINITY, f64::max);
    base
}

/// The usual check: meshes, parry's distance for each pair.
struct Plain<'a> {
    robot: &'a Robot,
    leg: LegId,
    posture: Posture,
    moving: Vec<MeshPart>,
    fixed: Vec<(MeshPart, Placed)>,
    ground: (TriMesh, Placed),
    boulder: (TriMesh, Placed),
}

/// Where a mesh is, and the box around it.
struct Placed {
    pose: Pose,
    aabb: Aabb,
}

impl Placed {
    fn new(mesh: &TriMesh, pose: Pose) -> Placed {
        Placed { pose, aabb: mesh.compute_aabb(&pose) }
    }
}

struct MeshPart {
    link: LinkId,
    body: Body,
    link_from_part: Isometry3<f64>,
    mesh: TriMesh,
}

impl<'a> Plain<'a> {
    fn new(
        robot: &'a Robot,
        posture: &Posture,
        leg: LegId,
        map: &ElevationMap,
        (world_from_box, half): (Isometry3<f64>, Vector3<f64>),
    ) -> Plain<'a> {
        let (mut moving, mut fixed) = (Vec::new(), Vec::new());
        for (i, link) in robot.links().iter().enumerate() {
            let (link_id, body) = (LinkId(i), Body::of(robot, LinkId(i)));
            for placed in &link.shapes {
                let (mesh, turn) = mesh_of(&placed.shape);
                let link_from_part = placed.link_from_shape * turn;
                let part = MeshPart { link: link_id, body, link_from_part, mesh };
                if matches!(body, Body::Leg { leg: of, .. } if of == leg) {
                    moving.push(part);
                } else {
                    let pose = Pose::from(posture.link(link_id) * link_from_part);
                    let at = Placed::new(&part.mesh, pose);
                    fixed.push((part, at));
                }
            }
        }
        moving.reverse(); // the wheel meets things first
        let (points, triangles) = Cuboid::new(half.into()).to_trimesh();
        let boulder = TriMesh::new(points, triangles).expect("a box has a mesh");
        let ground = ground_of(map);
        let placed = |mesh: TriMesh, pose| {
            let at = Placed::new(&mesh, pose);
            (mesh, at)
        };
        Plain {
            robot,
            leg,
            posture: posture.clone(),
            moving,
            fixed,
            ground: placed(ground, Pose::IDENTITY),
            boulder: placed(boulder, Pose::from(world_from_box)),
        }
    }

    fn is_free(&mut self, angles: &LegAngles) -> bool {
        self.posture.move_leg(self.robot, self.leg, angles);
        let place = |m: &MeshPart| {
            Placed::new(&m.mesh, Pose::from(self.posture.link(m.link) * m.link_from_part))
        };
        let at: Vec<Placed> = self.moving.iter().map(place).collect();
        let environment = self.robot.tolerances().environment;
        !self.moving.iter().enumerate().any(|(i, part)| {
            [&self.ground, &self.boulder]
                .iter()
                .any(|(mesh, pose)| nearer(part, &at[i], mesh, pose, environment))
                || self.near_links(part, &at[i], self.fixed.iter().map(|(f, pose)| (f, pose)))
                || self.near_links(part, &at[i], self.moving.iter().zip(&at).skip(i + 1))
        })
    }

    fn near_links<'p>(
        &self,
        part: &MeshPart,
        at: &Placed,
        mut others: impl Iterator<Item = (&'p MeshPart, &'p Placed)>,
    ) -> bool {
        others.any(|(other, pose)| {
            self.tolerance(part.body, other.body)
                .is_some_and(|required| nearer(part, at, &other.mesh, pose, required))
        })
    }

    /// Clearance of a pair (m); none for bodies that share a joint or lie across one.
    fn tolerance(&self, a: Body, b: Body) -> Option<f64> {
        let t = self.robot.tolerances();
        match (a.min(b), a.max(b)) {
            (Body::Base, Body::Leg { place, .. }) => match place {
                0 => None,
                1 => Some(t.base_thigh),
                5 => Some(t.base_wheel),
                _ => Some(t.pair),
            },
            (Body::Leg { leg, place }, Body::Leg { leg: other, place: far }) => {
                if leg == other {
                    (place.abs_diff(far) > 2).then_some(t.within_leg)
                } else {
                    Some(t.leg_leg)
                }
            }
            _ => None,
        }
    }

    fn is_edge_free(&mut self, from: &LegAngles, to: &LegAngles) -> bool {
        let n = ((to - from).amax() / RESOLUTION).ceil() as u32;
        (0..=n).all(|i| self.is_free(&from.lerp(to, f64::from(i) / f64::from(n))))
    }
}

/// Is a part nearer to a mesh than `required` (m)?
fn nearer(part: &MeshPart, at: &Placed, mesh: &TriMesh, other: &Placed, required: f64) -> bool {
    at.aabb.loosened(required).intersects(&other.aabb)
        && !matches!(
            closest_points(&at.pose, &part.mesh, &other.pose, mesh, required),
            Ok(ClosestPoints::Disjoint)
        )
}

fn mesh_of(shape: &Shape) -> (TriMesh, UnitQuaternion<f64>) {
    // parry's cylinders and capsules stand along y, the robot's along z.
    let upright = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::FRAC_PI_2);
    let ((points, triangles), turn) = match *shape {
        Shape::Box { half_extents } => {
            (Cuboid::new(half_extents.into()).to_trimesh(), UnitQuaternion::identity())
        }
        Shape::Cylinder { radius, half_length } => {
            (Cylinder::new(half_length, radius).to_trimesh(AROUND), upright)
        }
        Shape::Capsule { radius, half_length } => {
            (Capsule::new_y(half_length, radius).to_trimesh(AROUND, AROUND / 2), upright)
        }
        Shape::Sphere { .. } | Shape::Mesh(_) => panic!("the robot of this bench has none"),
    };
    (TriMesh::new(points, triangles).expect("a solid has a mesh"), turn)
}

fn ground_of(map: &ElevationMap) -> TriMesh {
    let (grid, heights) = (map.grid(), map.heights());
    let nodes = (0..grid.ny).flat_map(|iy| (0..grid.nx).map(move |ix| (ix, iy)));
    let point = |(ix, iy)| {
        let p: Point2<f64> = grid.position(ix, iy);
        Vector3::new(p.x, p.y, f64::from(*heights.at(ix, iy))).into()
    };
    let squares = (0..grid.ny - 1).flat_map(|iy| (0..grid.nx - 1).map(move |ix| (ix, iy)));
    let halves = |(ix, iy)| {
        let node = |dx, dy| grid.index(ix + dx, iy + dy) as u32;
        [[node(0, 0), node(1, 0), node(0, 1)], [node(1, 1), node(0, 1), node(1, 0)]]
    };
    TriMesh::new(nodes.map(point).collect(), squares.flat_map(halves).collect())
        .expect("the map has squares")
}

/// An edge of 0.3 rad: each joint one way or the other.
fn edge_from(angles: &LegAngles, index: usize) -> LegAngles {
    angles + LegAngles::from_fn(|j, _| if (index >> j) & 1 == 0 { 0.3 } else { -0.3 })
}

fn benches(c: &mut Criterion) {
    let robot = athlete();
    let map = terrain();
    let base = standing(&robot, &map);
    let posture = Posture::new(&robot, &base);
    let leg = LegId(0);
    let model = robot.leg(leg);
    let mut at = posture.wheel(&robot, leg).center();
    at.y += 0.7;
    at.z = map.height_at(at.xy()).expect("the map is larger than the robot") + 0.2;
    let boulder = (Isometry3::from(at.coords), Vector3::repeat(0.3));
    let obstacle = Obstacle::Box { world_from_box: boulder.0, half_extents: boulder.1 };
    let scene = Scene::new(robot.clone(), map.clone(), &[obstacle]).expect("a box is an obstacle");

    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let configurations: Vec<LegAngles> = (0..1000)
        .map(|i| {
            if i % 2 == 0 {
                LegAngles::from_fn(|j, _| rng.random_range(model.lower[j]..model.upper[j]))
            } else {
                base.legs[0] + LegAngles::from_fn(|_, _| rng.random_range(-0.5..0.5))
            }
        })
        .collect();
    let checker = LegChecker::new(&scene, &posture, leg, None, None);
    let mut certifier = Certifier::new(&checker);
    let mut plain = Plain::new(&robot, &posture, leg, &map, boulder);
    let any = Allowance::default();
    let free: Vec<LegAngles> =
        configurations.iter().filter(|q| certifier.violation(q, any).is_none()).copied().collect();
    let agreed = configurations
        .iter()
        .filter(|q| certifier.violation(q, any).is_none() == plain.is_free(q))
        .count();
    let before = certifier.n_looked();
    let edges = free.iter().enumerate().map(|(i, q)| (*q, edge_from(q, i)));
    let certified = edges.clone().filter(|(a, b)| certifier.certify(a, b, any).is_free()).count();
    eprintln!(
        "{} of {} configurations free, {agreed} so by meshes too; {certified} edges certified, by \
         {:.1} pieces each",
        free.len(),
        configurations.len(),
        (certifier.n_looked() - before) as f64 / free.len() as f64
    );
    let sampled = edges.filter(|(a, b)| plain.is_edge_free(a, b)).count();
    eprintln!("{sampled} edges free by samples");

    let mut i = 0;
    c.bench_function("leg_check/one configuration with tolerances", |b| {
        b.iter(|| {
            i = (i + 1) % configurations.len();
            certifier.violation(&configurations[i], any)
        });
    });
    c.bench_function("leg_check/one configuration, free", |b| {
        b.iter(|| {
            i = (i + 1) % free.len();
            certifier.violation(&free[i], any)
        });
    });
    c.bench_function("leg_check/plain check of meshes (baseline)", |b| {
        b.iter(|| {
            i = (i + 1) % configurations.len();
            plain.is_free(&configurations[i])
        });
    });
    c.bench_function("leg_edge/certified, 0.3 rad", |b| {
        b.iter(|| {
            i = (i + 1) % free.len();
            certifier.certify(&free[i], &edge_from(&free[i], i), any)
        });
    });
    c.bench_function("leg_edge/plain check of meshes every 0.01 rad (baseline)", |b| {
        b.iter(|| {
            i = (i + 1) % free.len();
            plain.is_edge_free(&free[i], &edge_from(&free[i], i))
        });
    });
}

criterion_group!(leg_check, benches);
criterion_main!(leg_check);
