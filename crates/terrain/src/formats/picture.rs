//! Pictures to lay over ground (F36): GeoTIFF of bytes, 16-bit or float samples, gray or color, with or without alpha.
//!
//! Coordinates are checked as those of elevation models are: a plane in meters, square pixels, north up. Bytes
//! are taken as they are; of other samples the least and the greatest value of the part that is read become black
//! and white. What is nodata, NaN or transparent stays transparent.

use geometry::Grid;
use nalgebra::Point2;

use super::geotiff::{GeoTiffFile, check_coordinates, grid_of, system_of};
use crate::{ElevationMap, TerrainError};

/// Most texels of a picture.
pub const PICTURE_TEXELS_MAX: usize = 1 << 22;

/// Colors over ground.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// Middles of the texels in the coordinates of the file, row by row from the least y.
    pub grid: Grid,
    /// Red, green, blue and alpha of each texel.
    pub rgba: Vec<[u8; 4]>,
    /// Values that became black and white, where samples are no bytes.
    pub stretch: Option<[f64; 2]>,
    /// Is it gray?
    pub is_gray: bool,
}

/// Refuses a picture that is surely in another reference system than a map; what nothing is said of is not told apart.
pub fn check_system(file: &GeoTiffFile, map: &ElevationMap) -> Result<(), TerrainError> {
    let (Some(map), Some(picture)) = (&map.placement().system, system_of(file)?) else {
        return Ok(());
    };
    let short = |name: &str| name.chars().take(100).collect();
    match picture.differs_from(map) {
        Some(key) => {
            let (picture, map) = (short(picture.name()), short(map.name()));
            Err(TerrainError::PictureOtherSystem { picture, map, key })
        }
        None => Ok(()),
    }
}

/// The part of a picture whose texels have their middles between two corners (m, coordinates of the file).
pub fn read(
    file: &GeoTiffFile,
    low: Point2<f64>,
    high: Point2<f64>,
    texels_max: usize,
) -> Result<Picture, TerrainError> {
    check_coordinates(file)?;
    let kind = SampleKind::of(file)?;
    let whole = grid_of(file)?;
    let (xs, ys) = whole.nodes_within(low, high);
    if xs.is_empty() || ys.is_empty() {
        let far = whole.far_corner();
        let picture = [whole.origin.x, whole.origin.y, far.x, far.y];
        return Err(TerrainError::PictureElsewhere {
            picture,
            map: [low.x, low.y, high.x, high.y],
        });
    }
    let (nx, ny) = (xs.len(), ys.len());
    TerrainError::check_nodes(nx as f64 * ny as f64, texels_max)?;
    let row = whole.ny - ys.start - ny;
    let bands = (0..kind.n_bands)
        .map(|band| kind.band(file, band, [row, xs.start, ny, nx]))
        .collect::<Result<Vec<Vec<f64>>, TerrainError>>()?;
    let grid = Grid { origin: whole.position(xs.start, ys.start), nx, ny, ..whole };
    let n_colors = if kind.n_bands < 3 { 1 } else { 3 };
    let nodata = file.nodata().and_then(|text| text.trim().trim_end_matches('\0').parse().ok());
    let is_known = |i: usize| {
        let is_nodata = |band: &Vec<f64>| nodata == Some(band[i]) || !band[i].is_finite();
        // A color is nodata only if all of it is; NaN is in none.
        !bands[..n_colors].iter().all(is_nodata)
            && bands[..n_colors].iter().all(|b| b[i].is_finite())
    };
    let stretch = (!kind.is_byte()).then(|| {
        let mut ends = [f64::INFINITY, f64::NEG_INFINITY];
        for i in (0..nx * ny).filter(|i| is_known(*i)) {
            for band in &bands[..n_colors] {
                ends = [ends[0].min(band[i]), ends[1].max(band[i])];
            }
        }
        if ends[0] <= ends[1] { ends } else { [0.0, 0.0] }
    });
    let byte = |value: f64| match stretch {
        None => value as u8,
        // Halves of both, so that no difference of large ends overflows.
        Some([low, high]) if high > low => {
            (255.0 * ((0.5 * value - 0.5 * low) / (0.5 * high - 0.5 * low))).round() as u8
        }
        Some(_) => 128,
    };
    let mut rgba = Vec::with_capacity(nx * ny);
    for y in (0..ny).rev() {
        for i in y * nx..(y + 1) * nx {
            let color = [0, 1, 2].map(|c| bands[c.min(n_colors - 1)][i]);
            let alpha = bands.get(n_colors).map_or(255.0, |alpha| kind.alpha(alpha[i]));
            rgba.push(match is_known(i) && alpha >= 1.0 {
                true => [byte(color[0]), byte(color[1]), byte(color[2]), alpha as u8],
                false => [0; 4],
            });
        }
    }
    Ok(Picture { grid, rgba, stretch, is_gray: n_colors == 1 })
}

/// How samples are kept.
struct SampleKind {
    n_bands: usize,
    /// 1 unsigned, 3 float.
    format: u16,
    bits: u16,
}

impl SampleKind {
    fn of(file: &GeoTiffFile) -> Result<SampleKind, TerrainError> {
        let refuse = |what: String| Err(TerrainError::PictureKind { what });
        let base = file.tiff().ifd(file.base_ifd_index()).map_err(geotiff_reader::Error::from)?;
        let formats = base.sample_format().map_err(geotiff_reader::Error::from)?;
        let bits = base.bits_per_sample().map_err(geotiff_reader::Error::from)?;
        let n_bands = file.band_count() as usize;
        if !(1..=4).contains(&n_bands) {
            return refuse(format!(
                "it has {n_bands} bands; give 1 (gray) or 3 (color), or one more for alpha"
            ));
        }
        // 0 and 1: gray, 2: color; others count in ways of their own.
        let photometric = base.photometric_interpretation();
        if !matches!(photometric, None | Some(1 | 2)) {
            let kind = match photometric {
                Some(0) => "white is zero".to_owned(),
                Some(3) => "its values are numbers of a palette".to_owned(),
                Some(6) => "its colors are YCbCr".to_owned(),
                other => format!("its photometric interpretation is {}", other.unwrap_or_default()),
            };
            return refuse(format!(
                "{kind}; convert it to gray or RGB (gdal_translate -expand rgb)"
            ));
        }
        let (format, depth) =
            (formats.first().copied().unwrap_or(1), bits.first().copied().unwrap_or(0));
        let is_same = formats.iter().all(|f| *f == format) && bits.iter().all(|b| *b == depth);
        if !is_same || !matches!((format, depth), (1, 8 | 16) | (3, 32)) {
            let kinds = formats.iter().zip(&bits).take(4).map(|(format, bits)| match format {
                1 => format!("uint{bits}"),
                2 => format!("int{bits}"),
                3 => format!("float{bits}"),
                other => format!("{bits} bits of format {other}"),
            });
            let kinds = kinds.collect::<Vec<_>>().join(", ");
            return refuse(format!("its samples are {kinds}; give uint8, uint16 or float32"));
        }
        Ok(SampleKind { n_bands, format, bits: depth })
    }

    fn is_byte(&self) -> bool {
        self.bits == 8
    }

    /// A window of a band, row by row from the north.
    fn band(
        &self,
        file: &GeoTiffFile,
        band: usize,
        [row, column, rows, columns]: [usize; 4],
    ) -> Result<Vec<f64>, TerrainError> {
        let values: Vec<f64> = match (self.format, self.bits) {
            (1, 8) => {
                let values = file.read_band_window::<u8>(band, row, column, rows, columns)?;
                values.iter().map(|v| f64::from(*v)).collect()
            }
            (1, _) => {
                let values = file.read_band_window::<u16>(band, row, column, rows, columns)?;
                values.iter().map(|v| f64::from(*v)).collect()
            }
            _ => {
                let values = file.read_band_window::<f32>(band, row, column, rows, columns)?;
                values.iter().map(|v| f64::from(*v)).collect()
            }
        };
        if values.len() == rows * columns {
            return Ok(values);
        }
        let reason = format!("{} samples for {columns} x {rows} pixels", values.len());
        Err(TerrainError::TiffUnreadable { reason })
    }

    /// The alpha of a sample, 0 to 255.
    fn alpha(&self, value: f64) -> f64 {
        let most = match (self.format, self.bits) {
            (1, 8) => 255.0,
            (1, _) => 65_535.0,
            // Of floats 1 and more is opaque.
            _ => 1.0,
        };
        (255.0 * value / most).clamp(0.0, 255.0).round()
    }
}
