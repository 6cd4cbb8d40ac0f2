//! What surrounds and makes up the robot, prepared for checking.

use std::sync::Arc;

use nalgebra::{Isometry3, Point3, Vector3};
use parry3d_f64::shape::{SharedShape, TriMesh, TriMeshFlags};
use rover::{Frame, Robot};
use terrain::ElevationMap;

use crate::form::{Form, Placed};
use crate::solid::{Part, parts_of, to_parry_point};

/// Something solid that is not ground.
#[derive(Debug, Clone, PartialEq)]
pub enum Obstacle {
    /// A box.
    Box {
        /// Pose of its center.
        world_from_box: Isometry3<f64>,
        /// Half of each edge (m).
        half_extents: Vector3<f64>,
    },
    /// A closed triangle mesh in `world`, its triangles outward by the right-hand rule.
    Mesh {
        /// Vertices (m).
        vertices: Vec<Point3<f64>>,
        /// Indices, three a triangle.
        triangles: Vec<[u32; 3]>,
    },
}

/// Why a scene was refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // each variant is its message
pub enum SceneError {
    #[error("obstacle {index}: edge {value} m of the box must be finite and above zero")]
    BoxSize { index: usize, value: f64 },
    #[error("obstacle {index}: a coordinate is not finite")]
    NotFinite { index: usize },
    #[error("obstacle {index}: triangle {triangle} names a vertex that is not there")]
    VertexIndex { index: usize, triangle: usize },
    #[error(
        "obstacle {index}: the mesh is not closed or not consistently oriented; give outward triangles of a closed surface"
    )]
    MeshNotClosed { index: usize },
}

/// An obstacle as parry wants it.
#[derive(Clone)]
pub(crate) struct Solid {
    pub shape: SharedShape,
    pub world_from_solid: Isometry3<f64>,
    pub mesh: bool,
    /// A box that holds it, and where: the obstacle itself if it is a box.
    pub form: Form,
    pub placed: Placed,
}

impl Solid {
    fn new(shape: SharedShape, world_from_solid: Isometry3<f64>, mesh: bool) -> Solid {
        // In the solid's own frame, so that the box of a box is the box.
        let (lo, hi) = aabb_of(&shape, &Isometry3::identity());
        let form = Form::Box { half: (hi - lo) * 0.5 };
        let world_from_box = world_from_solid * Isometry3::from(nalgebra::center(&lo, &hi).coords);
        let placed = Placed::new(Frame::from(&world_from_box), &form.core());
        Solid { shape, world_from_solid, mesh, form, placed }
    }
}

/// Robot, map and obstacles, prepared once and then shared by every check.
#[derive(Clone)]
pub struct Scene {
    robot: Arc<Robot>,
    map: ElevationMap,
    cover: ElevationMap,
    pub(crate) parts: Arc<Vec<Part>>,
    pub(crate) solids: Arc<Vec<Solid>>,
}

impl Scene {
    /// Prepares a scene.
    pub fn new(
        robot: Arc<Robot>,
        map: ElevationMap,
        obstacles: &[Obstacle],
    ) -> Result<Scene, SceneError> {
        let solids = obstacles
            .iter()
            .enumerate()
            .map(|(index, obstacle)| solid_of(index, obstacle))
            .collect::<Result<_, _>>()?;
        let parts = Arc::new(parts_of(&robot));
        Ok(Scene { robot, cover: map.clone(), map, parts, solids: Arc::new(solids) })
    }

    /// The same with a surface to keep clear of in place of the map's, which stays what wheels stand on. It is to be
    /// the map's where that is known ([`terrain::cover`]); what it does not know either stays unknown.
    #[must_use]
    pub fn with_cover(self, cover: ElevationMap) -> Scene {
        Scene { cover, ..self }
    }

    /// The robot.
    pub fn robot(&self) -> &Arc<Robot> {
        &self.robot
    }

    /// The ground.
    pub fn map(&self) -> &ElevationMap {
        &self.map
    }

    /// The surface to keep clear of: the ground, and how high it is taken to be where nobody has seen it.
    pub fn cover(&self) -> &ElevationMap {
        &self.cover
    }

    /// Number of obstacles.
    pub fn n_obstacles(&self) -> usize {
        self.solids.len()
    }
}

fn solid_of(index: usize, obstacle: &Obstacle) -> Result<Solid, SceneError> {
    match obstacle {
        Obstacle::Box { world_from_box, half_extents } => {
            if let Some(half) = half_extents.iter().find(|h| !(h.is_finite() && **h > 0.0)) {
                return Err(SceneError::BoxSize { index, value: 2.0 * half });
            }
            if !world_from_box.translation.vector.iter().all(|v| v.is_finite()) {
                return Err(SceneError::NotFinite { index });
            }
            let shape = SharedShape::cuboid(half_extents.x, half_extents.y, half_extents.z);
            Ok(Solid::new(shape, *world_from_box, false))
        }
        Obstacle::Mesh { vertices, triangles } => {
            if vertices.iter().any(|v| !v.coords.iter().all(|c| c.is_finite())) {
                return Err(SceneError::NotFinite { index });
            }
            let wrong = |t: &[u32; 3]| t.iter().any(|i| *i as usize >= vertices.len());
            if let Some(triangle) = triangles.iter().position(wrong) {
                return Err(SceneError::VertexIndex { index, triangle });
            }
            if !is_closed(triangles) {
                return Err(SceneError::MeshNotClosed { index });
            }
            let points = vertices.iter().map(to_parry_point).collect();
            let mesh = TriMesh::with_flags(points, triangles.clone(), TriMeshFlags::ORIENTED)
                .map_err(|_| SceneError::MeshNotClosed { index })?;
            Ok(Solid::new(SharedShape::new(mesh), Isometry3::identity(), true))
        }
    }
}

/// A mesh is closed and oriented if each directed edge is met by its opposite exactly once.
fn is_closed(triangles: &[[u32; 3]]) -> bool {
    let mut edges = std::collections::BTreeSet::new();
    for &[a, b, c] in triangles {
        for edge in [(a, b), (b, c), (c, a)] {
            if edge.0 == edge.1 || !edges.insert(edge) {
                return false;
            }
        }
    }
    !edges.is_empty() && edges.iter().all(|&(a, b)| edges.contains(&(b, a)))
}

/// The axis-parallel box (lowest and highest corner) that holds a placed shape.
fn aabb_of(shape: &SharedShape, pose: &Isometry3<f64>) -> (Point3<f64>, Point3<f64>) {
    let aabb = shape.compute_aabb(&crate::solid::to_pose(pose));
    let point = |v: parry3d_f64::math::Vector| Point3::new(v.x, v.y, v.z);
    (point(aabb.mins), point(aabb.maxs))
}
