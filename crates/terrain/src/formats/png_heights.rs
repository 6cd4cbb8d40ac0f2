//! 16-bit gray PNG with a JSON beside it: `{cell_m, height_offset_m, height_scale_m, nodata}`.
//!
//! The height of a pixel is `height_offset_m + height_scale_m · value`; rows go from north to south, and
//! the lower left pixel's center is the origin. `nodata` is the value of unknown pixels, or absent.

use std::io::Cursor;

use geometry::Grid;
use nalgebra::Point2;
use png::{BitDepth, ColorType};

use super::{ReadOptions, cropped, localized};
use crate::{ElevationMap, Source, TerrainError};

/// Longest JSON (bytes).
const JSON_MAX: usize = 1 << 16;

/// What the JSON says.
#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct Sidecar {
    cell_m: f64,
    height_offset_m: f64,
    height_scale_m: f64,
    #[serde(default)]
    nodata: Option<u16>,
}

/// Reads heights from the bytes of the PNG and of its JSON.
pub fn read(png: &[u8], json: &[u8], options: &ReadOptions) -> Result<ElevationMap, TerrainError> {
    let refuse = |reason: String| TerrainError::Png { reason };
    if json.len() > JSON_MAX {
        return Err(refuse(format!("its JSON has {} bytes, {JSON_MAX} are allowed", json.len())));
    }
    let sidecar: Sidecar = serde_json::from_slice(json).map_err(|error| {
        let wanted = "{cell_m, height_offset_m, height_scale_m, nodata}";
        refuse(format!("its JSON is not {wanted}: {error}"))
    })?;
    let check = TerrainError::check;
    check("cell_m", sidecar.cell_m, [1e-6, 1e6], "a length from 1e-6 to 1e6 m")?;
    check("height_offset_m", sidecar.height_offset_m, [-1e7, 1e7], "a height within 1e7 m")?;
    check("height_scale_m", sidecar.height_scale_m, [-1e3, 1e3], "a factor within 1000 m")?;
    let limits = png::Limits { bytes: options.max_nodes.saturating_mul(4).max(1 << 20) };
    let mut decoder = png::Decoder::new_with_limits(Cursor::new(png), limits);
    decoder.set_transformations(png::Transformations::IDENTITY);
    let bad = |error: png::DecodingError| refuse(format!("cannot be read: {error}"));
    let mut reader = decoder.read_info().map_err(bad)?;
    let info = reader.info();
    let (nx, ny) = (info.width as usize, info.height as usize);
    if (info.color_type, info.bit_depth) != (ColorType::Grayscale, BitDepth::Sixteen) {
        let (color, depth) = (info.color_type, info.bit_depth);
        let text = format!("has {depth:?} bits of {color:?}: give 16 bits of gray");
        return Err(refuse(text));
    }
    TerrainError::check_nodes(nx as f64 * ny as f64, options.max_nodes)?;
    if nx < 2 || ny < 2 {
        return Err(TerrainError::TooFewNodes { nx, ny });
    }
    let mut pixels = vec![0; 2 * nx * ny];
    reader.next_frame(&mut pixels).map_err(bad)?;
    let height = |pixel: &[u8]| {
        let value = u16::from_be_bytes([pixel[0], pixel[1]]);
        let z = sidecar.height_offset_m + sidecar.height_scale_m * f64::from(value);
        if sidecar.nodata == Some(value) { f64::NAN } else { z }
    };
    let rows = pixels.chunks_exact(2 * nx).rev();
    let heights: Vec<f64> = rows.flat_map(|row| row.chunks_exact(2).map(height)).collect();
    let grid = Grid { origin: Point2::origin(), resolution: sidecar.cell_m, nx, ny };
    cropped(localized(grid, &heights, Source::file("heights.png"))?, options)
}
