//! OFF meshes (ASCII) that are height fields on a regular square grid.
//!
//! Vertices come in rows or in columns, either way round; faces are triangles or quadrilaterals of
//! one grid square each. The map splits each square along its own diagonal, whichever the mesh
//! uses. A vertex that no face uses is unknown.

use geometry::Grid;
use nalgebra::Point2;

use super::localized;
use crate::{ElevationMap, Source, TerrainError};

/// How far a vertex may lie from its node, in cells: files are printed with 6 digits.
const TOLERANCE: f64 = 1e-3;

/// Reads an OFF mesh; one with more than `max_nodes` vertices is refused before memory is taken
/// for them. Lengths are taken as meters, z as up.
pub fn read(bytes: &[u8], max_nodes: usize) -> Result<ElevationMap, TerrainError> {
    let text = String::from_utf8_lossy(bytes);
    let mut lines = Lines::new(&text);
    let (n_vertices, n_faces) = header(&mut lines, bytes.len(), max_nodes)?;
    let vertices = vertices(&mut lines, n_vertices)?;
    let layout = Layout::of(&vertices)?;
    let faces = faces(&mut lines, n_faces, &layout)?;
    let heights = layout.heights(&vertices, &faces)?;
    localized(layout.grid, &heights, Source::file("mesh.off"))
}

/// The lines that hold something, without comments, numbered from 1.
struct Lines<'a> {
    lines: std::iter::Enumerate<std::str::Lines<'a>>,
}

impl<'a> Lines<'a> {
    fn new(text: &'a str) -> Lines<'a> {
        Lines { lines: text.lines().enumerate() }
    }

    fn next(&mut self) -> Option<(usize, &'a str)> {
        self.lines.by_ref().find_map(|(i, line)| {
            let line = line.split('#').next().unwrap_or("").trim();
            (!line.is_empty()).then_some((i + 1, line))
        })
    }
}

/// Numbers of vertices and faces, both possible for a file of that length.
fn header(
    lines: &mut Lines,
    n_bytes: usize,
    max_nodes: usize,
) -> Result<(usize, usize), TerrainError> {
    let bad = |(line, found): (usize, &str)| {
        let found = found.chars().take(40).collect();
        TerrainError::OffHeader { line, found }
    };
    let first = lines.next().ok_or_else(|| bad((1, "")))?;
    let (mut line, rest) = first.1.split_once(char::is_whitespace).unwrap_or((first.1, ""));
    if line != "OFF" {
        return Err(bad(first));
    }
    let mut number = first.0;
    line = rest.trim();
    if line.is_empty() {
        (number, line) = lines.next().ok_or_else(|| bad((first.0 + 1, "")))?;
    }
    let counts: Vec<u64> = line
        .split_whitespace()
        .map(|word| word.parse().map_err(|_| bad((number, line))))
        .collect::<Result<_, _>>()?;
    // The number of edges is often left out, and never used.
    let [n_vertices, n_faces] = *counts.get(..2).ok_or_else(|| bad((number, line)))? else {
        return Err(bad((number, line)));
    };
    TerrainError::check_nodes(n_vertices as f64, max_nodes)?;
    // `0 0 0` and `3 0 1 2` are the shortest lines.
    for (what, expected, shortest) in [("vertices", n_vertices, 6), ("faces", n_faces, 8)] {
        let found = (n_bytes as u64 + 1) / shortest;
        if expected > found {
            return Err(TerrainError::OffTruncated { what, expected, found });
        }
    }
    Ok((n_vertices as usize, n_faces as usize))
}

fn vertices(lines: &mut Lines, n_vertices: usize) -> Result<Vec<[f64; 3]>, TerrainError> {
    let mut vertices = Vec::with_capacity(n_vertices);
    while vertices.len() < n_vertices {
        let Some((line, text)) = lines.next() else {
            return Err(TerrainError::OffTruncated {
                what: "vertices",
                expected: n_vertices as u64,
                found: vertices.len() as u64,
            });
        };
        let mut words = text.split_whitespace();
        let mut vertex = [0.0; 3];
        for value in &mut vertex {
            let word = words.next();
            let number: Option<f64> = word.and_then(|w| w.parse().ok());
            *value = number.ok_or_else(|| not_a_number(line, word, "a coordinate"))?;
            if !value.is_finite() {
                return Err(TerrainError::OffNotFinite { line, value: *value });
            }
        }
        if let Some(word) = words.next() {
            return Err(not_a_number(line, Some(word), "the end of a vertex of 3 coordinates"));
        }
        vertices.push(vertex);
    }
    Ok(vertices)
}

fn not_a_number(line: usize, word: Option<&str>, expected: &'static str) -> TerrainError {
    let found = word.unwrap_or("").chars().take(40).collect();
    TerrainError::OffNumber { line, found, expected }
}

/// Which vertex is which node.
struct Layout {
    grid: Grid,
    /// Vertices from one to the next along the direction that comes first in the file.
    run: usize,
    /// True if that direction is x.
    x_first: bool,
    /// True if x (y) falls in the order of the file.
    is_falling: [bool; 2],
}

impl Layout {
    fn of(vertices: &[[f64; 3]]) -> Result<Layout, TerrainError> {
        let n = vertices.len();
        let refuse = |reason: String| Err(TerrainError::OffNotAGrid { reason });
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
        let resolution = 0.5 * (dx.abs() + dy.abs());
        if !resolution.is_finite() || (dx.abs() - dy.abs()).abs() > TOLERANCE * resolution {
            return refuse(format!("cells are {} x {}, not square", dx.abs(), dy.abs()));
        }
        TerrainError::check(
            "off cell size (m)",
            resolution,
            [1e-6, 1e6],
            "cells of 1e-6 to 1e6 m",
        )?;
        for (i, v) in vertices.iter().enumerate() {
            let (along, across) = ((i % run) as f64, (i / run) as f64);
            let (ix, iy) = if x_first { (along, across) } else { (across, along) };
            let off = (v[0] - first[0] - dx * ix).abs().max((v[1] - first[1] - dy * iy).abs());
            if off > TOLERANCE * resolution {
                return refuse(format!("vertex {i} at ({}, {}) is off its node", v[0], v[1]));
            }
        }
        let origin = Point2::new(first[0].min(last[0]), first[1].min(last[1]));
        let grid = Grid { origin, resolution, nx: n_of[0], ny: n_of[1] };
        Ok(Layout { grid, run, x_first, is_falling: [dx < 0.0, dy < 0.0] })
    }

    /// The node of a vertex.
    fn node(&self, vertex: usize) -> [usize; 2] {
        let (along, across) = (vertex % self.run, vertex / self.run);
        let [ix, iy] = if self.x_first { [along, across] } else { [across, along] };
        let turn = |i: usize, n: usize, is_falling: bool| if is_falling { n - 1 - i } else { i };
        [turn(ix, self.grid.nx, self.is_falling[0]), turn(iy, self.grid.ny, self.is_falling[1])]
    }

    /// Heights by node (m), NaN where no face has it. `faces` as of [`faces`].
    fn heights(&self, vertices: &[[f64; 3]], faces: &[u8]) -> Result<Vec<f64>, TerrainError> {
        let grid = &self.grid;
        let mut heights = vec![f64::NAN; grid.len()];
        let uses =
            |ix: usize, iy: usize, corner: usize| faces[grid.index(ix, iy)] & !LACKS[corner] != 0;
        for (i, vertex) in vertices.iter().enumerate() {
            let [ix, iy] = self.node(i);
            let is_used = uses(ix, iy, 0)
                || (ix > 0 && uses(ix - 1, iy, 1))
                || (iy > 0 && uses(ix, iy - 1, 2))
                || (ix > 0 && iy > 0 && uses(ix - 1, iy - 1, 3));
            if is_used {
                heights[grid.index(ix, iy)] = vertex[2];
            }
        }
        for iy in 0..grid.ny - 1 {
            for ix in 0..grid.nx - 1 {
                let corners = [(0, 0), (1, 0), (0, 1), (1, 1)];
                let is_known =
                    corners.iter().all(|(x, y)| !heights[grid.index(ix + x, iy + y)].is_nan());
                if is_known && !is_covered(faces[grid.index(ix, iy)]) {
                    return Err(TerrainError::OffHole { ix, iy });
                }
            }
        }
        Ok(heights)
    }
}

/// A square's triangles, a bit each, by the corner it lacks: (0, 0), (1, 0), (0, 1) or (1, 1).
const LACKS: [u8; 4] = [1, 2, 4, 8];

/// True if the triangles leave no part of their square open.
fn is_covered(triangles: u8) -> bool {
    let has = |pair: u8| triangles & pair == pair;
    has(LACKS[0] | LACKS[3]) || has(LACKS[1] | LACKS[2])
}

/// For each square (by the index of its lower left node), its triangles.
fn faces(lines: &mut Lines, n_faces: usize, layout: &Layout) -> Result<Vec<u8>, TerrainError> {
    let grid = &layout.grid;
    let n_vertices = grid.len();
    let mut squares = vec![0_u8; n_vertices];
    for found in 0..n_faces {
        let Some((line, text)) = lines.next() else {
            let (expected, found) = (n_faces as u64, found as u64);
            return Err(TerrainError::OffTruncated { what: "faces", expected, found });
        };
        let mut words = text.split_whitespace();
        let mut integer = |expected| -> Result<u64, TerrainError> {
            let word = words.next();
            word.and_then(|w| w.parse().ok()).ok_or_else(|| not_a_number(line, word, expected))
        };
        let n_corners = integer("a number of corners")?;
        if !(3..=4).contains(&n_corners) {
            return Err(TerrainError::OffFaceCorners { line, n_corners });
        }
        let mut nodes = [[0; 2]; 4];
        for node in &mut nodes[..n_corners as usize] {
            let index = integer("a vertex index")?;
            if index >= n_vertices as u64 {
                return Err(TerrainError::OffIndex { line, index, n_vertices });
            }
            *node = layout.node(index as usize);
        }
        // What follows on the line is the face's color.
        let nodes = &nodes[..n_corners as usize];
        let least = |axis: usize| nodes.iter().map(|node| node[axis]).min().unwrap_or(0);
        let (ix, iy) = (least(0), least(1));
        let mut corners = 0_u8;
        for [x, y] in nodes {
            let (dx, dy) = (x - ix, y - iy);
            if dx > 1 || dy > 1 {
                let reason = format!("the face on line {line} spans more than one square");
                return Err(TerrainError::OffNotAGrid { reason });
            }
            corners |= LACKS[dx + 2 * dy];
        }
        if u64::from(corners.count_ones()) != n_corners {
            let reason = format!("the face on line {line} uses a vertex twice");
            return Err(TerrainError::OffNotAGrid { reason });
        }
        // A quadrilateral counts as its two triangles on our diagonal.
        let triangles = if n_corners == 4 { LACKS[0] | LACKS[3] } else { !corners & 15 };
        squares[grid.index(ix, iy)] |= triangles;
    }
    Ok(squares)
}
