//! Wavefront OBJ meshes that are height fields on a regular square grid, z up, in meters.
//!
//! Vertices come in any order and may leave nodes out; faces are triangles or quadrilaterals of one
//! grid square each. Normals, texture coordinates, groups and materials are passed over. What no face
//! uses is unknown.

use super::height_field::{Layout, Squares, not_a_number};
use super::localized;
use crate::{ElevationMap, Source, TerrainError};

/// Statements that say nothing of heights.
const PASSED_OVER: [&str; 12] =
    ["vn", "vt", "vp", "o", "g", "s", "mg", "usemtl", "mtllib", "l", "p", "usemap"];

/// Reads an OBJ mesh; one with more than `max_nodes` vertices or nodes is refused before memory is
/// taken for them.
pub fn read(bytes: &[u8], max_nodes: usize) -> Result<ElevationMap, TerrainError> {
    let text = String::from_utf8_lossy(bytes);
    let lines = || {
        let numbered = text.lines().enumerate();
        numbered.filter_map(|(i, line)| {
            let line = line.split('#').next().unwrap_or("").trim();
            let (word, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
            (!word.is_empty()).then_some((i + 1, word, rest))
        })
    };
    let mut vertices = Vec::new();
    for (line, word, rest) in lines() {
        match word {
            "v" => {
                TerrainError::check_nodes(vertices.len() as f64 + 1.0, max_nodes)?;
                vertices.push(vertex(line, rest)?);
            }
            "f" => {}
            word if PASSED_OVER.contains(&word) => {}
            word => {
                return Err(not_a_number(line, Some(word), "an OBJ statement of a polygon mesh"));
            }
        }
    }
    let layout = Layout::of_places(&vertices, max_nodes)?;
    let mut squares = Squares::new(&layout);
    let mut n_before = 0;
    for (line, word, rest) in lines() {
        match word {
            "v" => n_before += 1,
            "f" => {
                let (corners, n) = face(line, rest, n_before, vertices.len())?;
                squares.add(line, &corners[..n])?;
            }
            _ => {}
        }
    }
    let heights = layout.heights(&vertices, &squares.triangles)?;
    localized(layout.grid, &heights, Source::file("mesh.obj"))
}

/// `x y z`, perhaps with a weight or a color after it.
fn vertex(line: usize, text: &str) -> Result<[f64; 3], TerrainError> {
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
    Ok(vertex)
}

/// Three or four of `v`, `v/vt`, `v//vn` or `v/vt/vn`, from 1, or from -1 backward.
fn face(
    line: usize,
    text: &str,
    n_before: usize,
    n_vertices: usize,
) -> Result<([usize; 4], usize), TerrainError> {
    let n_corners = text.split_whitespace().count();
    if !(3..=4).contains(&n_corners) {
        return Err(TerrainError::MeshFaceCorners { line, n_corners: n_corners as u64 });
    }
    let mut corners = [0; 4];
    for (corner, word) in corners.iter_mut().zip(text.split_whitespace()) {
        let index = word.split('/').next().unwrap_or("");
        let index: i64 =
            index.parse().map_err(|_| not_a_number(line, Some(word), "a vertex index"))?;
        let from_zero = if index < 0 { n_before as i64 + index } else { index - 1 };
        let found = usize::try_from(from_zero).ok().filter(|i| *i < n_vertices);
        let index = index.unsigned_abs();
        *corner = found.ok_or(TerrainError::MeshIndex { line, index, n_vertices })?;
    }
    Ok((corners, n_corners))
}
