//! The surface of a map as triangles: whole, or simplified within a bound.
//!
//! The whole mesh has the two triangles of each square, split along the map's own diagonal: it *is* the
//! surface. The simplified one covers the same ground by squares of 1, 2, 4 … cells, as large as the
//! bound allows; a square's triangles are a fan about its center that has every vertex of its neighbors,
//! so that there are no cracks. The bound is verified, not estimated: two piecewise linear surfaces
//! differ most where their edges meet or end, and all these places are compared.

use std::collections::HashMap;

use geometry::{Grid, Raster};
use nalgebra::Point2;

use crate::{ElevationMap, TerrainError};

/// Largest side of a square (cells).
const SIDE_MAX: usize = 64;

/// Triangles, counter-clockwise from above.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct HeightMesh {
    /// Positions (m).
    pub vertices: Vec<[f64; 3]>,
    /// Indices of vertices.
    pub triangles: Vec<[u32; 3]>,
}

impl HeightMesh {
    /// The surface of a map, as it is.
    pub fn whole(map: &ElevationMap) -> HeightMesh {
        let mut builder = Builder::new(map.heights());
        let grid = *map.grid();
        for iy in 0..grid.ny.saturating_sub(1) {
            for ix in 0..grid.nx.saturating_sub(1) {
                builder.cell(ix, iy);
            }
        }
        builder.mesh
    }

    /// A mesh of fewer triangles over the same ground, nowhere farther than `error_m` (m) above or
    /// below the surface of the map.
    pub fn simplified(map: &ElevationMap, error_m: f64) -> Result<HeightMesh, TerrainError> {
        TerrainError::check("error_m", error_m, [0.0, 1e6], "a length of 0 m or more")?;
        let mut cover = Cover::new(map.heights(), error_m);
        // Smaller neighbors bring vertices that a square was not checked with.
        while cover.split_what_is_off() {}
        Ok(cover.mesh())
    }
}

/// A mesh as OBJ; `comments` go first, a line each.
pub fn write_obj(mesh: &HeightMesh, comments: &[String]) -> Vec<u8> {
    use std::fmt::Write;
    let mut text = String::with_capacity(40 * mesh.vertices.len() + 24 * mesh.triangles.len());
    for comment in comments {
        text += &format!("# {}\n", comment.replace(['\n', '\r'], " "));
    }
    // Writing to a string does not fail.
    for [x, y, z] in &mesh.vertices {
        let _ = writeln!(text, "v {x} {y} {z}");
    }
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|i| i + 1);
        let _ = writeln!(text, "f {a} {b} {c}");
    }
    text.into_bytes()
}

struct Builder<'a> {
    heights: &'a Raster<f32>,
    mesh: HeightMesh,
    ids: HashMap<usize, u32>,
}

impl Builder<'_> {
    fn new(heights: &Raster<f32>) -> Builder<'_> {
        Builder { heights, mesh: HeightMesh::default(), ids: HashMap::new() }
    }

    fn vertex(&mut self, [ix, iy]: [usize; 2]) -> u32 {
        let grid = self.heights.grid();
        let (p, z) = (grid.position(ix, iy), *self.heights.at(ix, iy));
        let mesh = &mut self.mesh;
        *self.ids.entry(grid.index(ix, iy)).or_insert_with(|| {
            mesh.vertices.push([p.x, p.y, f64::from(z)]);
            mesh.vertices.len() as u32 - 1
        })
    }

    fn triangle(&mut self, corners: [[usize; 2]; 3]) {
        let triangle = corners.map(|corner| self.vertex(corner));
        self.mesh.triangles.push(triangle);
    }

    /// The triangles of one cell that are known.
    fn cell(&mut self, ix: usize, iy: usize) {
        let known = |x: usize, y: usize| !self.heights.at(ix + x, iy + y).is_nan();
        if !(known(1, 0) && known(0, 1)) {
            return;
        }
        let (lower, upper) = (known(0, 0), known(1, 1));
        if lower {
            self.triangle([[ix, iy], [ix + 1, iy], [ix, iy + 1]]);
        }
        if upper {
            self.triangle([[ix + 1, iy], [ix + 1, iy + 1], [ix, iy + 1]]);
        }
    }
}

/// Squares that cover the map. The map is cut into blocks of [`SIDE_MAX`] cells from its first node on.
struct Cover<'a> {
    heights: &'a Raster<f32>,
    error: f64,
    /// For each cell the side of the square that it is in (cells).
    side: Vec<u8>,
    /// Cells along x and y.
    n: [usize; 2],
}

impl Cover<'_> {
    fn new(heights: &Raster<f32>, error: f64) -> Cover<'_> {
        let grid = heights.grid();
        let n = [grid.nx.saturating_sub(1), grid.ny.saturating_sub(1)];
        let mut cover = Cover { heights, error, side: vec![1; n[0] * n[1]], n };
        for y in (0..n[1]).step_by(SIDE_MAX) {
            for x in (0..n[0]).step_by(SIDE_MAX) {
                cover.divide([x, y], SIDE_MAX);
            }
        }
        cover
    }

    /// Covers a square by the largest squares that are known and within the bound by themselves.
    fn divide(&mut self, [x, y]: [usize; 2], side: usize) {
        if x >= self.n[0] || y >= self.n[1] {
            return;
        }
        if side > 1 && !self.is_whole([x, y], side) {
            let half = side / 2;
            for (dx, dy) in [(0, 0), (half, 0), (0, half), (half, half)] {
                self.divide([x + dx, y + dy], half);
            }
            return;
        }
        self.mark([x, y], side);
        if side > 1 && !self.is_within([x, y], side) {
            let half = side / 2;
            for (dx, dy) in [(0, 0), (half, 0), (0, half), (half, half)] {
                self.divide([x + dx, y + dy], half);
            }
        }
    }

    fn mark(&mut self, [x, y]: [usize; 2], side: usize) {
        for iy in y..y + side {
            self.side[iy * self.n[0] + x..][..side].fill(side as u8);
        }
    }

    /// True if the square is on the map and all of its nodes are known.
    fn is_whole(&self, [x, y]: [usize; 2], side: usize) -> bool {
        x + side <= self.n[0]
            && y + side <= self.n[1]
            && (y..=y + side).all(|iy| {
                let row = self.heights.grid().index(x, iy);
                self.heights.values()[row..=row + side].iter().all(|z| !z.is_nan())
            })
    }

    /// The squares, by their first cell.
    fn squares(&self) -> Vec<([usize; 2], usize)> {
        let mut squares = Vec::new();
        for y in 0..self.n[1] {
            for x in 0..self.n[0] {
                let side = usize::from(self.side[y * self.n[0] + x]);
                if x.is_multiple_of(side) && y.is_multiple_of(side) {
                    squares.push(([x, y], side));
                }
            }
        }
        squares
    }

    fn split_what_is_off(&mut self) -> bool {
        let squares = self.squares();
        let off: Vec<_> = squares
            .into_iter()
            .filter(|(at, side)| *side > 1 && !self.is_within(*at, *side))
            .collect();
        for ([x, y], side) in &off {
            let half = side / 2;
            for (dx, dy) in [(0, 0), (half, 0), (0, half), (half, half)] {
                self.divide([x + dx, y + dy], half);
            }
        }
        !off.is_empty()
    }

    /// The vertices around a square, counter-clockwise: its corners, and those of its neighbors.
    fn outline(&self, [x, y]: [usize; 2], side: usize) -> Vec<[usize; 2]> {
        // A node on an edge is a vertex where the cells across it do not belong to one square.
        let across = |cx: Option<usize>, cy: Option<usize>| {
            let (cx, cy) = (cx?, cy?);
            (cx < self.n[0] && cy < self.n[1]).then(|| usize::from(self.side[cy * self.n[0] + cx]))
        };
        let splits = |side_across: Option<usize>, i: usize| {
            side_across.is_some_and(|n| n < side && i.is_multiple_of(n))
        };
        let mut outline = vec![[x, y]];
        let (below, above) = (y.checked_sub(1), Some(y + side));
        let (left, right) = (x.checked_sub(1), Some(x + side));
        for i in 1..side {
            if splits(across(Some(x + i), below), i) {
                outline.push([x + i, y]);
            }
        }
        outline.push([x + side, y]);
        for i in 1..side {
            if splits(across(right, Some(y + i)), i) {
                outline.push([x + side, y + i]);
            }
        }
        outline.push([x + side, y + side]);
        for i in (1..side).rev() {
            if splits(across(Some(x + i), above), i) {
                outline.push([x + i, y + side]);
            }
        }
        outline.push([x, y + side]);
        for i in (1..side).rev() {
            if splits(across(left, Some(y + i)), i) {
                outline.push([x, y + i]);
            }
        }
        outline
    }

    /// The triangles of a square of two or more cells.
    fn fan(&self, [x, y]: [usize; 2], side: usize) -> Vec<[[usize; 2]; 3]> {
        let outline = self.outline([x, y], side);
        let center = [x + side / 2, y + side / 2];
        let next = outline.iter().cycle().skip(1);
        outline.iter().zip(next).map(|(a, b)| [center, *a, *b]).collect()
    }

    /// True if the triangles of a square are nowhere farther off than the bound.
    fn is_within(&self, at: [usize; 2], side: usize) -> bool {
        self.fan(at, side).into_iter().all(|triangle| self.is_triangle_within(triangle))
    }

    fn is_triangle_within(&self, corners: [[usize; 2]; 3]) -> bool {
        // In cells from the first corner, a node.
        let z = |[ix, iy]: [usize; 2]| f64::from(*self.heights.at(ix, iy));
        let offset = |p: [usize; 2], axis: usize| p[axis] as f64 - corners[0][axis] as f64;
        let [(ux, uy), (vx, vy)] = [corners[1], corners[2]].map(|p| (offset(p, 0), offset(p, 1)));
        let det = ux * vy - uy * vx;
        let (uz, vz) = (z(corners[1]) - z(corners[0]), z(corners[2]) - z(corners[0]));
        let (a, b) = ((uz * vy - vz * uy) / det, (vz * ux - uz * vx) / det);
        let plane = |x: f64, y: f64| {
            let (dx, dy) = (x - corners[0][0] as f64, y - corners[0][1] as f64);
            z(corners[0]) + a * dx + b * dy
        };
        let is_near = |x: f64, y: f64| {
            let ground = self.surface(x, y);
            (ground - plane(x, y)).abs() <= self.error
        };
        let ends = |axis: usize| {
            let along = corners.map(|p| p[axis]);
            (along.into_iter().min().unwrap_or(0), along.into_iter().max().unwrap_or(0))
        };
        let ((x0, x1), (y0, y1)) = (ends(0), ends(1));
        // The nodes within, an edge included.
        let inside = |x: usize, y: usize| {
            let (dx, dy) = (offset([x, y], 0), offset([x, y], 1));
            let (s, t) = ((dx * vy - dy * vx) / det, (ux * dy - uy * dx) / det);
            s >= -1e-12 && t >= -1e-12 && s + t <= 1.0 + 1e-12
        };
        for y in y0..=y1 {
            for x in x0..=x1 {
                if inside(x, y) && !is_near(x as f64, y as f64) {
                    return false;
                }
            }
        }
        // Where the edges cross the lines of the grid and its diagonals.
        (0..3).all(|k| {
            let [p, q] = [corners[k], corners[(k + 1) % 3]].map(|p| p.map(|v| v as f64));
            let lines = [|p: [f64; 2]| p[0], |p: [f64; 2]| p[1], |p: [f64; 2]| p[0] + p[1]];
            lines.into_iter().all(|line| {
                let (from, to) = (line(p), line(q));
                let (low, high) = (from.min(to) as i64, from.max(to) as i64);
                (low + 1..high).all(|level| {
                    let t = (level as f64 - from) / (to - from);
                    is_near(p[0] + t * (q[0] - p[0]), p[1] + t * (q[1] - p[1]))
                })
            })
        })
    }

    /// Height of the map's surface at a place in cells (m).
    fn surface(&self, x: f64, y: f64) -> f64 {
        let (ix, iy) = ((x as usize).min(self.n[0] - 1), (y as usize).min(self.n[1] - 1));
        let (u, v) = (x - ix as f64, y - iy as f64);
        let z = |dx: usize, dy: usize| f64::from(*self.heights.at(ix + dx, iy + dy));
        if u + v <= 1.0 {
            z(0, 0) + u * (z(1, 0) - z(0, 0)) + v * (z(0, 1) - z(0, 0))
        } else {
            z(1, 1) + (1.0 - u) * (z(0, 1) - z(1, 1)) + (1.0 - v) * (z(1, 0) - z(1, 1))
        }
    }

    fn mesh(&self) -> HeightMesh {
        let mut builder = Builder::new(self.heights);
        for (at, side) in self.squares() {
            if side == 1 {
                builder.cell(at[0], at[1]);
                continue;
            }
            for triangle in self.fan(at, side) {
                builder.triangle(triangle);
            }
        }
        builder.mesh
    }
}

/// Where a mesh's grid lies, in words for its comments.
pub fn frame_text(grid: &Grid, offset: nalgebra::Vector3<f64>) -> String {
    let Point2 { coords, .. } = grid.origin;
    format!(
        "local frame in meters, z up; first node at ({}, {}); add ({}, {}, {}) for the source's coordinates",
        coords.x, coords.y, offset.x, offset.y, offset.z
    )
}
