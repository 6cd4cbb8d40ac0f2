//! GeoTIFF elevation models: one band of heights in meters, on square, north-up pixels.
//!
//! A pixel's value belongs to its center, whether the file says "pixel is area" or "pixel is
//! point"; rows are turned so that y grows upward. User-defined coordinate systems, as of other
//! planets, are fine as long as they are a plane in meters, and are kept with the map; a missing unit counts as meters.
//! Nothing is guessed beyond that: whatever else a file may ask for is refused by name.

use std::sync::Arc;

use geometry::Grid;
use geotiff_reader::crs::ModelType;
use geotiff_reader::geokeys::{PROJ_LINEAR_UNITS, VERTICAL_UNITS};
pub use geotiff_reader::{GeoTiffFile, GeoTiffOpenOptions};
use nalgebra::Point2;
use tiff_core::TagValue;

pub use super::geotiff_write::{write_classes, write_layers, write_picture};
use super::{Crop, ReadOptions, localized};
use crate::{ElevationMap, Placement, ReferenceSystem, Source, TerrainError};

/// EPSG code of the meter.
const METER: u16 = 9001;
const USER_DEFINED: u16 = 32767;
/// GeoKey of the size of a user-defined linear unit (m).
const PROJ_LINEAR_UNIT_SIZE: u16 = 3077;
const TAG_PIXEL_SCALE: u16 = 33550;
const TAG_TIEPOINT: u16 = 33922;
const TAG_TRANSFORMATION: u16 = 34264;
const TAG_GEO_KEYS: u16 = 34735;
const TAG_GEO_DOUBLES: u16 = 34736;
const TAG_GEO_ASCII: u16 = 34737;
const TAG_GDAL_METADATA: u16 = 42112;
/// How far from square pixels may be, relative.
const SQUARE_TOLERANCE: f64 = 1e-6;

impl From<geotiff_reader::Error> for TerrainError {
    fn from(e: geotiff_reader::Error) -> TerrainError {
        TerrainError::TiffUnreadable { reason: e.to_string() }
    }
}

/// Reads the heights of a GeoTIFF. Coordinates beyond 10 km or heights beyond 1 km are moved to a
/// local frame, whose offset the map keeps.
pub fn read(bytes: &[u8], options: &ReadOptions) -> Result<ElevationMap, TerrainError> {
    let limits = limits(options);
    read_open(&GeoTiffFile::from_bytes_with_options(bytes.to_vec(), limits)?, options)
}

/// The decoder's limits for a part of a file.
pub fn limits(options: &ReadOptions) -> GeoTiffOpenOptions {
    GeoTiffOpenOptions {
        // A crop may still need one whole strip of a large file.
        decode_output_bytes: options.max_nodes.saturating_mul(8).max(1 << 28),
        ..GeoTiffOpenOptions::default()
    }
}

/// As [`read`], of an open file: of a large one only the blocks of the asked part are read.
pub fn read_open(file: &GeoTiffFile, options: &ReadOptions) -> Result<ElevationMap, TerrainError> {
    check_coordinates(file)?;
    check_plain_heights(file)?;
    let whole = grid_of(file)?;
    let window = match options.crop {
        Some(crop) => Part::of(&whole, crop)?,
        None => Part { x0: 0, y0: 0, nx: whole.nx, ny: whole.ny },
    };
    TerrainError::check_nodes(window.nx as f64 * window.ny as f64, options.max_nodes)?;
    let heights = heights(file, &window, whole.ny)?;
    let origin = whole.position(window.x0, window.y0);
    let grid = Grid { origin, nx: window.nx, ny: window.ny, ..whole };
    let map = localized(grid, &heights, Source::file("geotiff"))?;
    let system = system_of(file)?.map(Arc::new);
    let offset = map.frame_offset();
    Ok(map.with_placement(Placement { offset, system }))
}

/// The reference system that a file names; none where it names none, or none in a plane.
pub(super) fn system_of(file: &GeoTiffFile) -> Result<Option<ReferenceSystem>, TerrainError> {
    let base = file.tiff().ifd(file.base_ifd_index()).map_err(geotiff_reader::Error::from)?;
    let directory = base.tag(TAG_GEO_KEYS).and_then(|tag| match &tag.value {
        TagValue::Short(keys) => Some(keys.clone()),
        _ => None,
    });
    let doubles = base.tag(TAG_GEO_DOUBLES).and_then(|tag| tag.value.as_f64_vec());
    let ascii = base.tag(TAG_GEO_ASCII).and_then(|tag| tag.value.as_str());
    let text = ascii.unwrap_or_default().trim_end_matches('\0');
    Ok(directory.and_then(|keys| ReferenceSystem::new(&keys, &doubles.unwrap_or_default(), text)))
}

/// A rectangle of nodes, y upward.
pub(super) struct Part {
    pub x0: usize,
    pub y0: usize,
    pub nx: usize,
    pub ny: usize,
}

impl Part {
    pub fn of(whole: &Grid, crop: Crop) -> Result<Part, TerrainError> {
        TerrainError::check("crop.width_m", crop.width_m, [1e-6, 1e9], "a width over 0")?;
        let corner = Grid { origin: Point2::origin(), ..*whole };
        let center = crop.center_from_corner(whole.nx, whole.ny, whole.resolution);
        for value in [center.x, center.y] {
            TerrainError::check("crop.center", value, [-1e12, 1e12], "a finite position")?;
        }
        let half = nalgebra::Vector2::repeat(0.5 * crop.width_m + 1e-9 * whole.resolution);
        let (xs, ys) = corner.nodes_within(center - half, center + half);
        if xs.len() < 2 || ys.len() < 2 {
            return Err(TerrainError::CropTooSmall {
                x_m: center.x,
                y_m: center.y,
                width_m: crop.width_m,
                nx: xs.len(),
                ny: ys.len(),
            });
        }
        Ok(Part { x0: xs.start, y0: ys.start, nx: xs.len(), ny: ys.len() })
    }
}

/// Refuses whatever is not a plane in meters.
pub(super) fn check_coordinates(file: &GeoTiffFile) -> Result<(), TerrainError> {
    let kind = match file.crs().model_type_enum() {
        ModelType::Geographic => Some("geographic (degrees)"),
        ModelType::Geocentric => Some("geocentric"),
        _ => None,
    };
    if let Some(kind) = kind {
        return Err(TerrainError::TiffNotProjected { kind });
    }
    let keys = file.geokeys();
    for (axis, id) in [("linear", PROJ_LINEAR_UNITS), ("vertical", VERTICAL_UNITS)] {
        let Some(code) = keys.get_short(id) else { continue };
        let size = keys.get_double(PROJ_LINEAR_UNIT_SIZE);
        let is_own_meter = axis == "linear" && code == USER_DEFINED && size == Some(&[1.0]);
        if code != METER && !is_own_meter {
            return Err(TerrainError::TiffUnit { axis, code });
        }
    }
    Ok(())
}

/// Refuses several bands and bands with a scale or an offset.
fn check_plain_heights(file: &GeoTiffFile) -> Result<(), TerrainError> {
    if file.band_count() != 1 {
        return Err(TerrainError::TiffBands { n_bands: file.band_count() });
    }
    let base = file.tiff().ifd(file.base_ifd_index()).map_err(geotiff_reader::Error::from)?;
    let Some(metadata) = base.tag(TAG_GDAL_METADATA).and_then(|tag| tag.value.as_str()) else {
        return Ok(());
    };
    for item in metadata.split("<Item").skip(1) {
        let (attributes, rest) = item.split_once('>').unwrap_or((item, ""));
        let text = rest.split('<').next().unwrap_or("").trim();
        for (what, plain) in [("scale", 1.0), ("offset", 0.0)] {
            let is_it = attributes.contains(&format!("role=\"{what}\""));
            if is_it && text.parse() != Ok(plain) {
                return Err(TerrainError::TiffScaled { what, value: text.to_owned() });
            }
        }
    }
    Ok(())
}

/// The grid of the pixel centers in the file's own coordinates, y upward.
pub(super) fn grid_of(file: &GeoTiffFile) -> Result<Grid, TerrainError> {
    let base = file.tiff().ifd(file.base_ifd_index()).map_err(geotiff_reader::Error::from)?;
    let scale = base.tag(TAG_PIXEL_SCALE).and_then(|tag| tag.value.as_f64_vec());
    let matrix = base.tag(TAG_TRANSFORMATION).and_then(|tag| tag.value.as_f64_vec());
    let tie = base.tag(TAG_TIEPOINT).and_then(|tag| tag.value.as_f64_vec());
    for (tag, values) in [("pixel scale", &scale), ("transformation", &matrix), ("tie point", &tie)]
    {
        if values.iter().flatten().any(|v| !v.is_finite()) {
            return Err(TerrainError::TiffNoTransform { tag: finite(tag) });
        }
    }
    let tag = if scale.is_none() { "pixel scale" } else { "tie point" };
    let Some(transform) = file.transform() else {
        return Err(TerrainError::TiffNoTransform { tag });
    };
    let (width_m, height_m) = (transform.pixel_width, -transform.pixel_height);
    if transform.skew_x != 0.0 || transform.skew_y != 0.0 {
        let (skew_x, skew_y) = (transform.skew_x, transform.skew_y);
        return Err(TerrainError::TiffRotated { skew_x, skew_y });
    }
    let is_square = (width_m - height_m).abs() <= SQUARE_TOLERANCE * width_m;
    if !(width_m > 0.0 && is_square && (1e-6..=1e6).contains(&width_m)) {
        return Err(TerrainError::TiffPixelSize { width_m, height_m });
    }
    let (nx, ny) = (file.width() as usize, file.height() as usize);
    if nx < 2 || ny < 2 {
        return Err(TerrainError::TooFewNodes { nx, ny });
    }
    let (x, y) = transform.pixel_to_geo(0.5, ny as f64 - 0.5);
    for value in [x, y] {
        TerrainError::check("geotiff tie point", value, [-1e12, 1e12], "a finite position (m)")?;
    }
    Ok(Grid { origin: Point2::new(x, y), resolution: width_m, nx, ny })
}

fn finite(tag: &str) -> &'static str {
    match tag {
        "pixel scale" => "finite pixel scale",
        "tie point" => "finite tie point",
        _ => "finite transformation",
    }
}

/// The heights of a part (m, NaN = unknown), row-major, y upward.
fn heights(file: &GeoTiffFile, part: &Part, n_rows: usize) -> Result<Vec<f64>, TerrainError> {
    let base = file.tiff().ifd(file.base_ifd_index()).map_err(geotiff_reader::Error::from)?;
    let format = base.sample_format().map_err(geotiff_reader::Error::from)?;
    let bits = base.bits_per_sample().map_err(geotiff_reader::Error::from)?;
    let row = n_rows - part.y0 - part.ny;
    let (rows, columns) = (part.ny, part.nx);
    let nodata = file.nodata().and_then(|text| text.trim().trim_end_matches('\0').parse().ok());
    let clean = |z: f64, nodata: Option<f64>| {
        if !z.is_finite() || nodata == Some(z) { f64::NAN } else { z }
    };
    let north_up: Vec<f64> = match (format.first(), bits.first()) {
        (Some(3), Some(32)) => {
            let nodata = nodata.map(|v: f64| f64::from(v as f32));
            let values = file.read_window::<f32>(row, part.x0, rows, columns)?;
            values.iter().map(|z| clean(f64::from(*z), nodata)).collect()
        }
        (Some(3), Some(64)) => {
            let values = file.read_window::<f64>(row, part.x0, rows, columns)?;
            values.iter().map(|z| clean(*z, nodata)).collect()
        }
        (Some(2), Some(16)) => {
            let values = file.read_window::<i16>(row, part.x0, rows, columns)?;
            values.iter().map(|z| clean(f64::from(*z), nodata)).collect()
        }
        (format, bits) => {
            let kind = match format {
                Some(1) => "uint",
                Some(2) => "int",
                Some(3) => "float",
                _ => "of unknown type, bits ",
            };
            let sample_type = format!("{kind}{}", bits.copied().unwrap_or(0));
            return Err(TerrainError::TiffSampleType { sample_type });
        }
    };
    if north_up.len() != rows * columns {
        let reason = format!("{} samples for {columns} x {rows} pixels", north_up.len());
        return Err(TerrainError::TiffUnreadable { reason });
    }
    Ok(north_up.chunks_exact(columns).rev().flatten().copied().collect())
}
