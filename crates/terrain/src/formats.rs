//! Terrain files: bytes in, maps out, and back.

pub mod geotiff;
mod geotiff_write;
pub mod off;

use geometry::{Grid, Raster};
use nalgebra::{Point2, Vector3};

use crate::{ElevationMap, MAX_NODES, Source, TerrainError};

/// Horizontal coordinates beyond this (m) are moved to a local frame.
const FAR_XY_M: f64 = 10_000.0;
/// Heights beyond this (m) are moved to a local frame.
const FAR_Z_M: f64 = 1_000.0;
/// No ground is this high or low (m).
const HEIGHT_MAX_M: f64 = 1e7;

/// What to read of a file.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReadOptions {
    /// The part to read; all of it if `None`.
    pub crop: Option<Crop>,
    /// A file with more nodes (after the crop) is refused before memory is taken for them.
    pub max_nodes: usize,
}

impl Default for ReadOptions {
    fn default() -> ReadOptions {
        ReadOptions { crop: None, max_nodes: MAX_NODES }
    }
}

/// A square part of a file.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Crop {
    /// Its center.
    pub center: CropCenter,
    /// Its side (m).
    pub width_m: f64,
}

/// The center of a crop, from the lower left (least x, least y) node of the file.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum CropCenter {
    /// As shares, 0 to 1, of the way to the upper right node.
    Fraction(Point2<f64>),
    /// In meters.
    Meters(Point2<f64>),
}

impl Crop {
    /// Its center, from the first node (m), of a grid of nodes `resolution` (m) apart.
    fn center_from_corner(&self, nx: usize, ny: usize, resolution: f64) -> Point2<f64> {
        match self.center {
            CropCenter::Meters(p) => p,
            CropCenter::Fraction(f) => Point2::new(
                f.x * resolution * nx.saturating_sub(1) as f64,
                f.y * resolution * ny.saturating_sub(1) as f64,
            ),
        }
    }
}

/// Reads a terrain file by the extension of its name: `.tif`, `.tiff` or `.off`.
pub fn read_named(
    file_name: &str,
    bytes: &[u8],
    options: &ReadOptions,
) -> Result<ElevationMap, TerrainError> {
    let extension = file_name.rsplit_once('.').map(|(_, end)| end.to_ascii_lowercase());
    let map = match extension.as_deref() {
        Some("tif" | "tiff") => geotiff::read(bytes, options)?,
        Some("off") => {
            let whole = off::read(bytes, options.max_nodes)?;
            match options.crop {
                Some(crop) => {
                    let grid = whole.grid();
                    let from_corner = crop.center_from_corner(grid.nx, grid.ny, grid.resolution);
                    whole.cropped(grid.origin + from_corner.coords, crop.width_m)?
                }
                None => whole,
            }
        }
        _ => return Err(TerrainError::UnknownFormat { file_name: file_name.to_owned() }),
    };
    Ok(map.with_source(Source::file(file_name)))
}

/// The map of a file's heights (m, NaN = unknown, row-major), in a local frame if they are far
/// from the origin: then its origin is under the center of the map, at the height of the ground
/// there (the median height if that is unknown).
fn localized(
    mut grid: Grid,
    heights: &[f64],
    source: Source,
) -> Result<ElevationMap, TerrainError> {
    let known = || heights.iter().copied().filter(|z| !z.is_nan());
    let Some((lo, hi)) = known().fold(None, |range: Option<(f64, f64)>, z| {
        Some(range.map_or((z, z), |(lo, hi)| (lo.min(z), hi.max(z))))
    }) else {
        return Err(TerrainError::NoKnownHeight);
    };
    for z_m in [lo, hi] {
        if z_m.abs() > HEIGHT_MAX_M {
            return Err(TerrainError::HeightOutOfRange { z_m });
        }
    }
    let far = grid.far_corner();
    let is_far = [grid.origin.x, grid.origin.y, far.x, far.y].iter().any(|v| v.abs() > FAR_XY_M)
        || lo.abs().max(hi.abs()) > FAR_Z_M;
    let mut offset = Vector3::zeros();
    if is_far {
        let center = nalgebra::center(&grid.origin, &far);
        let at_center = heights[grid.index(grid.nx / 2, grid.ny / 2)];
        let z = if at_center.is_nan() { median(known().collect()) } else { at_center };
        offset = Vector3::new(center.x, center.y, z);
        // From the extent, not from far coordinates, so that no digits are lost.
        grid.origin = Point2::new(
            -0.5 * grid.resolution * (grid.nx - 1) as f64,
            -0.5 * grid.resolution * (grid.ny - 1) as f64,
        );
    }
    let values = heights.iter().map(|z| (z - offset.z) as f32).collect();
    let heights = Raster::new(grid, values).expect("one height per node of the grid");
    Ok(ElevationMap::new(heights, source).with_frame_offset(offset))
}

/// The median of at least one height.
fn median(mut heights: Vec<f64>) -> f64 {
    let middle = heights.len() / 2;
    *heights.select_nth_unstable_by(middle, f64::total_cmp).1
}
