//! Meshes that are height fields on a regular square grid: which vertex is which node, and which
//! squares the faces cover.

use geometry::Grid;
use nalgebra::Point2;

use crate::TerrainError;

/// How far a vertex may lie from its node, in cells: files are printed with 6 digits.
const TOLERANCE: f64 = 1e-3;

pub(super) fn not_a_number(
    line: usize,
    word: Option<&str>,
    expected: &'static str,
) -> TerrainError {
    let found = word.unwrap_or("").chars().take(40).collect();
    TerrainError::MeshNumber { line, found, expected }
}

/// Which vertex is which node.
pub(super) struct Layout {
    pub grid: Grid,
    /// Column and row of each vertex.
    pub nodes: Vec<[u32; 2]>,
}

impl Layout {
    /// Vertices that come in rows or in columns, either way round, one for each node.
    pub fn of_rows(vertices: &[[f64; 3]]) -> Result<Layout, TerrainError> {
        let n = vertices.len();
        let refuse = |reason: String| Err(TerrainError::MeshNotAGrid { reason });
        if n < 4 {
            return refuse(format!("{n} vertices are fewer than 2 x 2"));
        }
        let (first, second, last) = (vertices[0], vertices[1], vertices[n - 1]);
        let x_first = (second[0] - first[0]).abs() > (second[1] - first[1]).abs();
        let (fast, slow) = if x_first { (0, 1) } else { (1, 0) };
        let cell = (second[fast] - first[fast]).abs();
        let run = vertices.iter().position(|v| (v[slow] - first[slow]).abs() > 0.5 * cell);
        let run = run.unwrap_or(n);
        if run < 2 || run == n || !n.is_multiple_of(run) {
            return refuse(format!("{n} vertices do not fill rows of {run}"));
        }
        let n_of = if x_first { [run, n / run] } else { [n / run, run] };
        let spacing = |axis: usize| (last[axis] - first[axis]) / (n_of[axis] - 1) as f64;
        let (dx, dy) = (spacing(0), spacing(1));
        let resolution = square(dx.abs(), dy.abs())?;
        let turn = |i: usize, n: usize, d: f64| (if d < 0.0 { n - 1 - i } else { i }) as u32;
        let mut nodes = Vec::with_capacity(n);
        for (i, v) in vertices.iter().enumerate() {
            let (along, across) = (i % run, i / run);
            let (ix, iy) = if x_first { (along, across) } else { (across, along) };
            let off_x = (v[0] - first[0] - dx * ix as f64).abs();
            let off_y = (v[1] - first[1] - dy * iy as f64).abs();
            if off_x.max(off_y) > TOLERANCE * resolution {
                return refuse(format!("vertex {i} at ({}, {}) is off its node", v[0], v[1]));
            }
            nodes.push([turn(ix, n_of[0], dx), turn(iy, n_of[1], dy)]);
        }
        let origin = Point2::new(first[0].min(last[0]), first[1].min(last[1]));
        Ok(Layout { grid: Grid { origin, resolution, nx: n_of[0], ny: n_of[1] }, nodes })
    }

    /// Vertices in any order, with nodes left out or given several times. A grid of more than
    /// `max_nodes` nodes is refused before memory is taken for it.
    pub fn of_places(vertices: &[[f64; 3]], max_nodes: usize) -> Result<Layout, TerrainError> {
        let refuse = |reason: String| Err(TerrainError::MeshNotAGrid { reason });
        if vertices.len() < 3 {
            return refuse(format!("{} vertices hold no surface", vertices.len()));
        }
        let axis = |axis: usize| -> (f64, f64, f64) {
            let mut values: Vec<f64> = vertices.iter().map(|v| v[axis]).collect();
            values.sort_by(f64::total_cmp);
            let (low, high) = (values[0], values[values.len() - 1]);
            // Values of one column or row differ by printed digits; the next is much farther.
            let least = 1e-6 * (high - low);
            let gaps = values.windows(2).map(|pair| pair[1] - pair[0]);
            let gap = gaps.filter(|gap| *gap > least).fold(f64::INFINITY, f64::min);
            (low, high, gap)
        };
        let ((x0, x1, gap_x), (y0, y1, gap_y)) = (axis(0), axis(1));
        let count = |low: f64, high: f64, gap: f64| ((high - low) / gap).round().max(0.0) + 1.0;
        let (nx, ny) = (count(x0, x1, gap_x), count(y0, y1, gap_y));
        if !(nx >= 2.0 && ny >= 2.0) {
            return refuse("the vertices lie on a line".into());
        }
        TerrainError::check_nodes(nx * ny, max_nodes)?;
        // A few vertices far apart would take the memory of a whole map.
        if nx * ny > 64.0 * vertices.len() as f64 + 4096.0 {
            let n = vertices.len();
            return refuse(format!("{n} vertices are too few for {nx} x {ny} nodes"));
        }
        let resolution = square((x1 - x0) / (nx - 1.0), (y1 - y0) / (ny - 1.0))?;
        let grid =
            Grid { origin: Point2::new(x0, y0), resolution, nx: nx as usize, ny: ny as usize };
        let mut nodes = Vec::with_capacity(vertices.len());
        for (i, v) in vertices.iter().enumerate() {
            let (u, w) = ((v[0] - x0) / resolution, (v[1] - y0) / resolution);
            let off = (u - u.round()).abs().max((w - w.round()).abs());
            if off > TOLERANCE || u.round() >= nx || w.round() >= ny {
                return refuse(format!("vertex {i} at ({}, {}) is off its node", v[0], v[1]));
            }
            nodes.push([u.round() as u32, w.round() as u32]);
        }
        Ok(Layout { grid, nodes })
    }

    /// Heights by node (m), NaN where no face has it. `squares` as of [`Squares`].
    pub fn heights(&self, vertices: &[[f64; 3]], squares: &[u8]) -> Result<Vec<f64>, TerrainError> {
        let grid = &self.grid;
        let mut heights = vec![f64::NAN; grid.len()];
        let uses =
            |ix: usize, iy: usize, corner: usize| squares[grid.index(ix, iy)] & !LACKS[corner] != 0;
        for (i, (vertex, node)) in vertices.iter().zip(&self.nodes).enumerate() {
            let [ix, iy] = node.map(|n| n as usize);
            let is_used = uses(ix, iy, 0)
                || (ix > 0 && uses(ix - 1, iy, 1))
                || (iy > 0 && uses(ix, iy - 1, 2))
                || (ix > 0 && iy > 0 && uses(ix - 1, iy - 1, 3));
            let height = &mut heights[grid.index(ix, iy)];
            if (*height - vertex[2]).abs() > TOLERANCE * grid.resolution {
                let reason = format!(
                    "vertex {i} is {} m high, another one at ({}, {}) {height} m",
                    vertex[2], vertex[0], vertex[1]
                );
                return Err(TerrainError::MeshNotAGrid { reason });
            }
            if is_used {
                *height = vertex[2];
            }
        }
        for iy in 0..grid.ny - 1 {
            for ix in 0..grid.nx - 1 {
                let corners = [(0, 0), (1, 0), (0, 1), (1, 1)];
                let is_known =
                    corners.iter().all(|(x, y)| !heights[grid.index(ix + x, iy + y)].is_nan());
                if is_known && !is_covered(squares[grid.index(ix, iy)]) {
                    return Err(TerrainError::MeshHole { ix, iy });
                }
            }
        }
        Ok(heights)
    }
}

/// The side of cells that are to be square.
fn square(dx: f64, dy: f64) -> Result<f64, TerrainError> {
    let resolution = 0.5 * (dx + dy);
    if !resolution.is_finite() || (dx - dy).abs() > TOLERANCE * resolution {
        let reason = format!("cells are {dx} x {dy}, not square");
        return Err(TerrainError::MeshNotAGrid { reason });
    }
    let expected = "cells of 1e-6 to 1e6 m";
    TerrainError::check("mesh cell size (m)", resolution, [1e-6, 1e6], expected)
}

/// A square's triangles, a bit each, by the corner it lacks: (0, 0), (1, 0), (0, 1) or (1, 1).
const LACKS: [u8; 4] = [1, 2, 4, 8];

/// True if the triangles leave no part of their square open.
fn is_covered(triangles: u8) -> bool {
    let has = |pair: u8| triangles & pair == pair;
    has(LACKS[0] | LACKS[3]) || has(LACKS[1] | LACKS[2])
}

/// What the faces cover: for each square, by the index of its lower left node, its triangles.
pub(super) struct Squares<'a> {
    layout: &'a Layout,
    pub triangles: Vec<u8>,
}

impl Squares<'_> {
    pub fn new(layout: &Layout) -> Squares<'_> {
        Squares { layout, triangles: vec![0; layout.grid.len()] }
    }

    /// Adds the face on a line, of three or four vertices that are there.
    pub fn add(&mut self, line: usize, vertices: &[usize]) -> Result<(), TerrainError> {
        let nodes = || vertices.iter().map(|vertex| self.layout.nodes[*vertex]);
        let least = |axis: usize| nodes().map(|node| node[axis]).min().unwrap_or(0);
        let (ix, iy) = (least(0), least(1));
        let mut corners = 0_u8;
        for [x, y] in nodes() {
            let (dx, dy) = (x - ix, y - iy);
            if dx > 1 || dy > 1 {
                let reason = format!("the face on line {line} spans more than one square");
                return Err(TerrainError::MeshNotAGrid { reason });
            }
            corners |= LACKS[(dx + 2 * dy) as usize];
        }
        if corners.count_ones() as usize != vertices.len() {
            let reason = format!("the face on line {line} uses a vertex twice");
            return Err(TerrainError::MeshNotAGrid { reason });
        }
        // A quadrilateral counts as its two triangles on our diagonal.
        let triangles = if vertices.len() == 4 { LACKS[0] | LACKS[3] } else { !corners & 15 };
        self.triangles[self.layout.grid.index(ix as usize, iy as usize)] |= triangles;
        Ok(())
    }
}
