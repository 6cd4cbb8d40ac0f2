//! OFF meshes (ASCII) that are height fields on a regular square grid.
//!
//! Vertices come in rows or in columns, either way round; faces are triangles or quadrilaterals of
//! one grid square each. The map splits each square along its own diagonal, whichever the mesh
//! uses. A vertex that no face uses is unknown.

use super::height_field::{Layout, Squares, not_a_number};
use super::localized;
use crate::{ElevationMap, Source, TerrainError};

/// Reads an OFF mesh; one with more than `max_nodes` vertices is refused before memory is taken
/// for them. Lengths are taken as meters, z as up.
pub fn read(bytes: &[u8], max_nodes: usize) -> Result<ElevationMap, TerrainError> {
    let text = String::from_utf8_lossy(bytes);
    let mut lines = Lines::new(&text);
    let (n_vertices, n_faces) = header(&mut lines, bytes.len(), max_nodes)?;
    let vertices = vertices(&mut lines, n_vertices)?;
    let layout = Layout::of_rows(&vertices)?;
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
        let mut vertex = [0.0_f64; 3];
        for value in &mut vertex {
            let word = words.next();
            let number: Option<f64> = word.and_then(|w| w.parse().ok());
            *value = number.ok_or_else(|| not_a_number(line, word, "a coordinate"))?;
            if !value.is_finite() {
                return Err(TerrainError::MeshNotFinite { line, value: *value });
            }
        }
        if let Some(word) = words.next() {
            return Err(not_a_number(line, Some(word), "the end of a vertex of 3 coordinates"));
        }
        vertices.push(vertex);
    }
    Ok(vertices)
}

/// For each square (by the index of its lower left node), its triangles.
fn faces(lines: &mut Lines, n_faces: usize, layout: &Layout) -> Result<Vec<u8>, TerrainError> {
    let n_vertices = layout.nodes.len();
    let mut squares = Squares::new(layout);
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
            return Err(TerrainError::MeshFaceCorners { line, n_corners });
        }
        let mut corners = [0; 4];
        for corner in &mut corners[..n_corners as usize] {
            let index = integer("a vertex index")?;
            if index >= n_vertices as u64 {
                return Err(TerrainError::MeshIndex { line, index, n_vertices });
            }
            *corner = index as usize;
        }
        // What follows on the line is the face's color.
        squares.add(line, &corners[..n_corners as usize])?;
    }
    Ok(squares.triangles)
}
