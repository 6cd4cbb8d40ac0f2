//! Meshes of links: STL and OBJ, their connected components, and what makes them unusable.

use std::collections::HashMap;

use nalgebra::{Point3, Vector3};

/// Largest mesh file (bytes).
pub const MESH_BYTES_MAX: usize = 16 << 20;

/// Most triangles of a mesh.
pub const MESH_TRIANGLES_MAX: usize = 200_000;

/// Most connected components of a mesh: each is a convex solid of its own.
pub const MESH_COMPONENTS_MAX: usize = 256;

/// Largest coordinate of a vertex (m).
const COORDINATE_MAX: f64 = 1e4;

/// Vertices nearer than this are one, as a share of the mesh's size: far below what any tool
/// writes apart, far above the rounding of 32-bit coordinates.
const MERGE: f64 = 1e-6;

/// A component flatter than this share of its own size encloses nothing.
const FLAT: f64 = 1e-5;

/// Why a mesh was refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // each variant is its message
pub enum MeshError {
    #[error("is neither .stl nor .obj")]
    Format,
    #[error("has {bytes} bytes; the limit is {limit}")]
    TooLarge { bytes: usize, limit: usize },
    #[error("cannot be read: {message}")]
    Syntax { message: String },
    #[error("holds no triangle, or none with an area")]
    Empty,
    #[error("has more than {limit} triangles")]
    TooManyTriangles { limit: usize },
    #[error("has a vertex coordinate of {value}; it must be finite and at most {COORDINATE_MAX} m")]
    Coordinate { value: f64 },
    #[error("has the scale {value}; it must be finite and not zero")]
    Scale { value: f64 },
    #[error("has more than {limit} connected components")]
    TooManyComponents { limit: usize },
    #[error(
        "has a component without volume at {at}: all of its points lie in one plane, on one line or in one place"
    )]
    Flat { at: Point3<f64> },
}

/// Triangles, with vertices in the same place merged and triangles without area left out.
#[derive(Debug, Clone, PartialEq)]
pub struct Mesh {
    vertices: Vec<Point3<f64>>,
    triangles: Vec<[u32; 3]>,
    /// By vertex: its component, counted from zero.
    components: Vec<u32>,
    n_components: u32,
}

impl Mesh {
    /// Reads a mesh file, binary or ASCII STL or OBJ by the ending of `path`, each coordinate times
    /// that of `scale` (as `<mesh scale>` has it).
    ///
    /// Open and inverted surfaces are fine: a component counts as its convex hull.
    pub fn parse(path: &str, bytes: &[u8], scale: &Vector3<f64>) -> Result<Mesh, MeshError> {
        if bytes.len() > MESH_BYTES_MAX {
            return Err(MeshError::TooLarge { bytes: bytes.len(), limit: MESH_BYTES_MAX });
        }
        if let Some(value) = scale.iter().find(|s| !(s.is_finite() && **s != 0.0)) {
            return Err(MeshError::Scale { value: *value });
        }
        let ending = path.rsplit_once('.').map(|(_, ending)| ending.to_ascii_lowercase());
        let corners = match ending.as_deref() {
            Some("stl") => stl(bytes)?,
            Some("obj") => obj(bytes)?,
            _ => return Err(MeshError::Format),
        };
        let scaled = |p: &Point3<f64>| Point3::from(p.coords.component_mul(scale));
        Mesh::from_corners(&corners.iter().map(|t| t.each_ref().map(scaled)).collect::<Vec<_>>())
    }

    /// The mesh of triangles given by their corners (m).
    fn from_corners(corners: &[[Point3<f64>; 3]]) -> Result<Mesh, MeshError> {
        let proper = |v: &&f64| v.abs() <= COORDINATE_MAX; // not so for NaN
        let mut numbers = corners.iter().flatten().flat_map(|p| p.coords.iter());
        if let Some(value) = numbers.find(|v| !proper(v)) {
            return Err(MeshError::Coordinate { value: *value });
        }
        let (vertices, triangles) = merged(corners);
        if triangles.is_empty() {
            return Err(MeshError::Empty);
        }
        let components = components(vertices.len(), &triangles);
        let n_components = components.iter().max().map_or(0, |last| last + 1);
        if n_components as usize > MESH_COMPONENTS_MAX {
            return Err(MeshError::TooManyComponents { limit: MESH_COMPONENTS_MAX });
        }
        let mesh = Mesh { vertices, triangles, components, n_components };
        if let Some(flat) = mesh.components().find(|points| !has_volume(points)) {
            return Err(MeshError::Flat { at: flat[0] });
        }
        Ok(mesh)
    }

    /// Vertices (m), in the frame of the shape.
    pub fn vertices(&self) -> &[Point3<f64>] {
        &self.vertices
    }

    /// Indices of the vertices, three a triangle.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// The vertices of each connected component; every one encloses some volume.
    pub fn components(&self) -> impl Iterator<Item = Vec<Point3<f64>>> + '_ {
        let mut components = vec![Vec::new(); self.n_components as usize];
        for (vertex, component) in self.vertices.iter().zip(&self.components) {
            components[*component as usize].push(*vertex);
        }
        components.into_iter()
    }

    pub(crate) fn scaled(&self, factor: f64) -> Mesh {
        let vertices = self.vertices.iter().map(|v| v * factor).collect();
        Mesh { vertices, ..self.clone() }
    }
}

fn stl(bytes: &[u8]) -> Result<Vec<[Point3<f64>; 3]>, MeshError> {
    // A binary file may say "solid" like an ASCII one; its length tells it apart.
    let count = bytes.get(80..84).and_then(|b| b.try_into().ok()).map(u32::from_le_bytes);
    let is_binary = count.is_some_and(|n| bytes.len() as u64 == 84 + 50 * u64::from(n));
    let mut own;
    let mut bytes = bytes;
    if is_binary {
        own = bytes.to_vec();
        own[..80].fill(0);
        bytes = &own;
    }
    let failed = |e: std::io::Error| MeshError::Syntax { message: short(&e.to_string()) };
    let mut cursor = std::io::Cursor::new(bytes);
    let mut corners = Vec::new();
    for triangle in stl_io::create_stl_reader(&mut cursor).map_err(failed)? {
        let triangle = triangle.map_err(failed)?;
        if corners.len() == MESH_TRIANGLES_MAX {
            return Err(MeshError::TooManyTriangles { limit: MESH_TRIANGLES_MAX });
        }
        corners.push(triangle.vertices.map(|v| Point3::from(v.0.map(f64::from))));
    }
    Ok(corners)
}

fn obj(bytes: &[u8]) -> Result<Vec<[Point3<f64>; 3]>, MeshError> {
    let options = tobj::LoadOptions {
        triangulate: true,
        ignore_points: true,
        ignore_lines: true,
        ..tobj::LoadOptions::default()
    };
    // Materials are in other files and matter to nobody here.
    let no_materials = |_: &std::path::Path| Ok(Default::default());
    let (models, _) = tobj::load_obj_buf(&mut &*bytes, &options, no_materials)
        .map_err(|e| MeshError::Syntax { message: short(&e.to_string()) })?;
    let mut corners = Vec::new();
    for model in &models {
        let at = |i: &u32| {
            let first = 3 * *i as usize;
            let p: [f64; 3] = model.mesh.positions.get(first..first + 3)?.try_into().ok()?;
            Some(Point3::from(p))
        };
        for triangle in model.mesh.indices.chunks_exact(3) {
            let [Some(a), Some(b), Some(c)] =
                [at(&triangle[0]), at(&triangle[1]), at(&triangle[2])]
            else {
                let message = "a face names a vertex that is not there".into();
                return Err(MeshError::Syntax { message });
            };
            if corners.len() == MESH_TRIANGLES_MAX {
                return Err(MeshError::TooManyTriangles { limit: MESH_TRIANGLES_MAX });
            }
            corners.push([a, b, c]);
        }
    }
    Ok(corners)
}

fn short(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ").chars().take(200).collect()
}

/// Size of the axis-parallel box around points (m).
fn extent<'a>(points: impl Iterator<Item = &'a Point3<f64>>) -> f64 {
    let start = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
    let (low, high) =
        points.fold(start, |(low, high), p| (low.inf(&p.coords), high.sup(&p.coords)));
    (high - low).norm()
}

/// Vertices in the same place as one; triangles that then have two corners in one place are left
/// out, and so are vertices of no triangle.
fn merged(corners: &[[Point3<f64>; 3]]) -> (Vec<Point3<f64>>, Vec<[u32; 3]>) {
    let radius = (MERGE * extent(corners.iter().flatten())).max(f64::MIN_POSITIVE);
    // Cells four times as wide as what is merged: few vertices have to look into a second one.
    let cell = |v: f64| (v / (4.0 * radius)).floor() as i64;
    let mut vertices: Vec<Point3<f64>> = Vec::new();
    let mut by_cell: HashMap<[i64; 3], Vec<u32>> = HashMap::new();
    let mut index = |p: &Point3<f64>| {
        let (low, high) =
            ([p.x, p.y, p.z].map(|v| cell(v - radius)), [p.x, p.y, p.z].map(|v| cell(v + radius)));
        for x in low[0]..=high[0] {
            for y in low[1]..=high[1] {
                for z in low[2]..=high[2] {
                    let near = by_cell.get(&[x, y, z]).into_iter().flatten();
                    let same = |i: &&u32| (vertices[**i as usize] - p).norm() <= radius;
                    if let Some(i) = near.into_iter().find(same) {
                        return *i;
                    }
                }
            }
        }
        let i = vertices.len() as u32;
        by_cell.entry([p.x, p.y, p.z].map(cell)).or_default().push(i);
        vertices.push(*p);
        i
    };
    let mut triangles = Vec::with_capacity(corners.len());
    for corners in corners {
        let [a, b, c] = corners.each_ref().map(&mut index);
        if a != b && b != c && c != a {
            triangles.push([a, b, c]);
        }
    }
    in_use(&vertices, triangles)
}

/// Triangles with the vertices that they use, in the same order.
fn in_use(
    vertices: &[Point3<f64>],
    mut triangles: Vec<[u32; 3]>,
) -> (Vec<Point3<f64>>, Vec<[u32; 3]>) {
    let mut used = vec![false; vertices.len()];
    triangles.iter().flatten().for_each(|i| used[*i as usize] = true);
    let mut kept = Vec::new();
    let mut number = vec![0; vertices.len()];
    for (i, vertex) in vertices.iter().enumerate().filter(|(i, _)| used[*i]) {
        number[i] = kept.len() as u32;
        kept.push(*vertex);
    }
    triangles.iter_mut().flatten().for_each(|i| *i = number[*i as usize]);
    (kept, triangles)
}

/// By vertex, the number of the component that it is connected to by triangles.
fn components(n_vertices: usize, triangles: &[[u32; 3]]) -> Vec<u32> {
    let mut parent: Vec<u32> = (0..n_vertices as u32).collect();
    fn root(parent: &mut [u32], mut i: u32) -> u32 {
        while parent[i as usize] != i {
            parent[i as usize] = parent[parent[i as usize] as usize];
            i = parent[i as usize];
        }
        i
    }
    for [a, b, c] in triangles {
        for other in [b, c] {
            let (one, other) = (root(&mut parent, *a), root(&mut parent, *other));
            parent[one.max(other) as usize] = one.min(other);
        }
    }
    let mut numbers = HashMap::new();
    (0..n_vertices as u32)
        .map(|i| {
            let root = root(&mut parent, i);
            let next = numbers.len() as u32;
            *numbers.entry(root).or_insert(next)
        })
        .collect()
}

/// True if the points lie in no common plane: the thickness across the widest triangle counts.
fn has_volume(points: &[Point3<f64>]) -> bool {
    let size = extent(points.iter());
    let farthest = |distance: &dyn Fn(&Point3<f64>) -> f64| {
        let far = points.iter().max_by(|a, b| distance(a).total_cmp(&distance(b)));
        far.map(|p| (*p, distance(p)))
    };
    let Some(first) = points.first() else { return false };
    let Some((second, length)) = farthest(&|p| (p - first).norm()) else { return false };
    if length <= FLAT * size || size <= 0.0 {
        return false;
    }
    let along = (second - first) / length;
    let Some((third, width)) = farthest(&|p| (p - first).cross(&along).norm()) else {
        return false;
    };
    let across = (third - first).cross(&along);
    let normal = across / across.norm();
    let Some((_, thickness)) = farthest(&|p| (p - first).dot(&normal).abs()) else { return false };
    width > FLAT * size && thickness > FLAT * size
}
