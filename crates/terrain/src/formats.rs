//! Terrain files: bytes in, maps out, and back.

mod cog;
pub mod geotiff;
mod geotiff_write;
mod height_field;
pub mod mesh;
pub mod obj;
pub mod off;
pub mod pds3;
pub mod picture;
pub mod ply;
pub mod png_heights;

use geometry::{Grid, Raster};
use nalgebra::{Point2, Vector3};

use crate::fusion::{Measurement, RasterizeOptions, Tag, rasterize};
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
    /// Distance of the nodes (m) where the file does not tell: of points, and of a PDS3 image without a
    /// map scale. [`POINT_CELL_M`] for points if `None`.
    pub cell_m: Option<f64>,
}

impl Default for ReadOptions {
    fn default() -> ReadOptions {
        ReadOptions { crop: None, max_nodes: MAX_NODES, cell_m: None }
    }
}

/// Distance of the nodes of a map made of points, where none is given (m).
pub const POINT_CELL_M: f64 = 0.05;
/// Standard deviation of the points of a file that does not tell (m).
const POINT_SIGMA_M: f64 = 0.01;

/// A file that is read piece by piece, so that a window of a large one fits the memory.
pub trait ByteSource {
    /// Its length (bytes).
    fn len(&self) -> u64;
    /// True if it holds nothing.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }
    /// `n` bytes from `offset` on, or why they cannot be had.
    fn read_at(&mut self, offset: u64, n: usize) -> Result<Vec<u8>, String>;
}

impl ByteSource for &[u8] {
    fn len(&self) -> u64 {
        <[u8]>::len(self) as u64
    }

    fn read_at(&mut self, offset: u64, n: usize) -> Result<Vec<u8>, String> {
        let start = usize::try_from(offset).ok().filter(|start| *start <= <[u8]>::len(self));
        let bytes = start.and_then(|start| self[start..].get(..n));
        bytes.map(<[u8]>::to_vec).ok_or_else(|| "ends too early".to_owned())
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

/// Ends of the names of terrain files.
pub const EXTENSIONS: [&str; 8] = ["tif", "tiff", "img", "lbl", "off", "obj", "ply", "png"];

/// As [`read_with`], of a file that needs none beside it.
pub fn read_named(
    file_name: &str,
    bytes: &[u8],
    options: &ReadOptions,
) -> Result<ElevationMap, TerrainError> {
    read_with(file_name, bytes, &mut |_| None, options)
}

/// Reads a terrain file by the extension of its name, one of [`EXTENSIONS`]. `beside` gives the bytes
/// of a file in the same folder: the JSON of a PNG, the image of a detached PDS3 label.
pub fn read_with(
    file_name: &str,
    bytes: &[u8],
    beside: &mut dyn FnMut(&str) -> Option<Vec<u8>>,
    options: &ReadOptions,
) -> Result<ElevationMap, TerrainError> {
    let missing = |companion: &str| TerrainError::CompanionMissing {
        file_name: file_name.to_owned(),
        companion: companion.chars().take(80).collect(),
    };
    let (stem, extension) = file_name.rsplit_once('.').unwrap_or((file_name, ""));
    let map = match extension.to_ascii_lowercase().as_str() {
        "tif" | "tiff" => geotiff::read(bytes, options)?,
        "off" => cropped(off::read(bytes, options.max_nodes)?, options)?,
        "obj" => cropped(obj::read(bytes, options.max_nodes)?, options)?,
        "png" => {
            let companion = format!("{stem}.json");
            let json = beside(&companion).ok_or_else(|| missing(&companion))?;
            png_heights::read(bytes, &json, options)?
        }
        "img" | "lbl" => {
            let image = pds3::read_label(&mut { bytes })?;
            match &image.file {
                Some(name) if !file_name.eq_ignore_ascii_case(name) => {
                    let samples = beside(name).ok_or_else(|| missing(name))?;
                    pds3::read(&image, &mut samples.as_slice(), options)?
                }
                _ => pds3::read(&image, &mut { bytes }, options)?,
            }
        }
        "ply" => cropped(of_points(bytes, options)?, options)?,
        _ => return Err(TerrainError::UnknownFormat { file_name: file_name.to_owned() }),
    };
    Ok(map.with_source(Source::file(file_name)))
}

/// The part of a map that the options ask for.
fn cropped(whole: ElevationMap, options: &ReadOptions) -> Result<ElevationMap, TerrainError> {
    let Some(crop) = options.crop else { return Ok(whole) };
    let grid = whole.grid();
    let from_corner = crop.center_from_corner(grid.nx, grid.ny, grid.resolution);
    whole.cropped(grid.origin + from_corner.coords, crop.width_m)
}

/// The map of a point cloud.
fn of_points(bytes: &[u8], options: &ReadOptions) -> Result<ElevationMap, TerrainError> {
    let points = ply::read_points(bytes, 4 * options.max_nodes)?;
    let resolution_m = options.cell_m.unwrap_or(POINT_CELL_M);
    // At least as many nodes as their extent has, before memory is taken for them.
    let n_along = |axis: usize| {
        let values = || points.iter().map(|p| p[axis]);
        let (low, high) = (values().fold(f64::MAX, f64::min), values().fold(f64::MIN, f64::max));
        ((high - low).max(0.0) / resolution_m).floor() + 1.0
    };
    TerrainError::check_nodes(n_along(0) * n_along(1), options.max_nodes)?;
    let center = points.iter().fold(Vector3::zeros(), |sum, p| sum + p.coords);
    let center = center / points.len().max(1) as f64;
    // Far points are rasterized about their middle, so that no digits are lost.
    let is_far = center.xy().amax() > FAR_XY_M || center.z.abs() > FAR_Z_M;
    let offset = if is_far { center } else { Vector3::zeros() };
    let measurement = |p: &nalgebra::Point3<f64>| Measurement {
        position_m: p - offset,
        height_variance_m2: POINT_SIGMA_M * POINT_SIGMA_M,
        common_variance_m2: 0.0,
        footprint_m: 0.0,
        tag: Tag::Terrain,
    };
    let points: Vec<_> = points.iter().map(measurement).collect();
    let rasterize_options = RasterizeOptions { resolution_m, ..RasterizeOptions::default() };
    let heights = rasterize(&points, &rasterize_options)?.dem.heights();
    TerrainError::check_nodes(heights.grid().len() as f64, options.max_nodes)?;
    Ok(ElevationMap::new(heights, Source::file("points.ply")).with_frame_offset(offset))
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
