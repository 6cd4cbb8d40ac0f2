//! Layers of a map as one GeoTIFF.

use std::io::Cursor;

use geometry::{Grid, Raster};
use tiff_core::{
    ColorMap, Compression, ExtraSample, PhotometricInterpretation, PlanarConfiguration, Predictor,
    Tag, TagValue,
};
use tiff_writer::{ImageBuilder, TiffWriteSample, TiffWriter, WriteOptions};

use super::cog;
use crate::{Placement, TerrainError};

const TAG_PIXEL_SCALE: u16 = 33550;
const TAG_TIEPOINT: u16 = 33922;
const TAG_GEO_KEYS: u16 = 34735;
const TAG_GEO_DOUBLES: u16 = 34736;
const TAG_GEO_ASCII: u16 = 34737;
const TAG_GDAL_METADATA: u16 = 42112;
const TAG_GDAL_NODATA: u16 = 42113;
/// Pixels a side of a block.
const BLOCK: usize = 256;

impl From<tiff_writer::Error> for TerrainError {
    fn from(e: tiff_writer::Error) -> TerrainError {
        TerrainError::TiffWrite { reason: e.to_string() }
    }
}

/// The layers as the float32 bands of one cloud-optimized GeoTIFF (tiles of 256 x 256, deflate, a plane
/// per band, north up, NaN = nodata), each described by its name in GDAL's metadata tag.
///
/// The pixels' centers are the nodes of `grid`. Where `placement` has a reference system they are in its coordinates, and
/// heights (a layer called `height_m`) are the source's, rounded to float32. Without one they are in an
/// engineering system of meters without a place on any planet: local `world` coordinates. Overviews halve the pixels until one tile holds them: the
/// mean of four, of which two are known at least; of a layer called `class` the least, 0 (unknown)
/// included.
pub fn write_layers(
    grid: &Grid,
    layers: &[(&str, &Raster<f32>)],
    placement: &Placement,
) -> Result<Vec<u8>, TerrainError> {
    let refuse = |reason: String| Err(TerrainError::TiffWrite { reason });
    if layers.is_empty() || layers.len() > 1000 {
        return refuse(format!("{} layers given, 1 to 1000 fit", layers.len()));
    }
    if grid.is_empty() || grid.nx > 1 << 30 || grid.ny > 1 << 30 {
        return refuse(format!("a grid of {} x {} nodes does not fit", grid.nx, grid.ny));
    }
    if let Some((name, _)) = layers.iter().find(|(_, layer)| layer.grid() != grid) {
        return refuse(format!("layer {name:?} lies on another grid"));
    }
    if let Some((name, _)) = layers.iter().find(|(name, _)| name.contains(['&', '<', '>', '\0'])) {
        return refuse(format!("layer name {name:?} holds one of & < >"));
    }
    let mut levels = vec![Level::of(grid, layers, placement)];
    while levels[levels.len() - 1].nx.max(levels[levels.len() - 1].ny) > BLOCK {
        let next = levels[levels.len() - 1].halved(layers);
        levels.push(next);
    }
    let names: Vec<&str> = layers.iter().map(|(name, _)| *name).collect();
    let kind = Kind {
        photometric: PhotometricInterpretation::MinIsBlack,
        extra: vec![ExtraSample::Unspecified; layers.len() - 1],
        color_map: None,
        predictor: Predictor::FloatingPoint,
        nodata: Some("nan"),
    };
    let mut tags = tags(grid, &names, placement);
    tags.push(Tag::new(TAG_GDAL_NODATA, TagValue::Ascii("nan".to_owned())));
    write_levels(&levels, f32::NAN, &kind, &tags)
}

/// Gray texels with their alpha (0 = unknown, 255 = known) as the two bands of one cloud-optimized GeoTIFF of bytes,
/// row by row from the least y, as [`write_layers`] else. Overviews have the mean of the known of four.
pub fn write_picture(
    grid: &Grid,
    gray: &[u8],
    alpha: &[u8],
    placement: &Placement,
) -> Result<Vec<u8>, TerrainError> {
    check_bytes(grid, gray)?;
    check_bytes(grid, alpha)?;
    let kind = Kind {
        photometric: PhotometricInterpretation::MinIsBlack,
        extra: vec![ExtraSample::UnassociatedAlpha],
        color_map: None,
        predictor: Predictor::Horizontal,
        nodata: None,
    };
    let first =
        Level { nx: grid.nx, ny: grid.ny, bands: vec![turned(grid, gray), turned(grid, alpha)] };
    let levels = halvings(first, |bands, four| {
        let known = four.iter().filter(|i| bands[1][**i] > 0);
        let n = known.clone().count() as u32;
        let sum: u32 = known.map(|i| u32::from(bands[0][*i])).sum();
        (sum + n / 2).checked_div(n).map_or(vec![0, 0], |mean| vec![mean as u8, 255])
    });
    write_levels(&levels, 0, &kind, &tags(grid, &["gray", "alpha"], placement))
}

/// Classes as one cloud-optimized GeoTIFF of bytes with a color for each, 0 (unknown) being nodata. Overviews have
/// the least of four.
pub fn write_classes(
    classes: &Raster<u8>,
    name: &str,
    colors: &[[u8; 3]],
    placement: &Placement,
) -> Result<Vec<u8>, TerrainError> {
    let grid = classes.grid();
    check_bytes(grid, classes.values())?;
    let color = |i: usize, c: usize| colors.get(i).map_or(0, |color| 257 * u16::from(color[c]));
    let channel = |c: usize| (0..256).map(|i| color(i, c)).collect::<Vec<u16>>();
    let kind = Kind {
        photometric: PhotometricInterpretation::Palette,
        extra: Vec::new(),
        color_map: Some([channel(0), channel(1), channel(2)]),
        predictor: Predictor::None,
        nodata: Some("0"),
    };
    let first = Level { nx: grid.nx, ny: grid.ny, bands: vec![turned(grid, classes.values())] };
    let levels =
        halvings(first, |bands, four| vec![four.iter().map(|i| bands[0][*i]).min().unwrap_or(0)]);
    let mut tags = tags(grid, &[name], placement);
    tags.push(Tag::new(TAG_GDAL_NODATA, TagValue::Ascii("0".to_owned())));
    write_levels(&levels, 0, &kind, &tags)
}

fn check_bytes(grid: &Grid, values: &[u8]) -> Result<(), TerrainError> {
    if grid.is_empty() || grid.nx > 1 << 30 || grid.ny > 1 << 30 || values.len() != grid.len() {
        let (nx, ny, n) = (grid.nx, grid.ny, values.len());
        let reason = format!("{n} bytes do not fit a grid of {nx} x {ny} texels");
        return Err(TerrainError::TiffWrite { reason });
    }
    Ok(())
}

/// The same rows from the north.
fn turned(grid: &Grid, values: &[u8]) -> Vec<u8> {
    values.chunks_exact(grid.nx).rev().flatten().copied().collect()
}

/// What the bands are to a reader.
struct Kind {
    photometric: PhotometricInterpretation,
    extra: Vec<ExtraSample>,
    color_map: Option<[Vec<u16>; 3]>,
    predictor: Predictor,
    nodata: Option<&'static str>,
}

/// All levels as one file, directories first; `fill` is what lies beyond the edge.
fn write_levels<T: TiffWriteSample + Copy>(
    levels: &[Level<T>],
    fill: T,
    kind: &Kind,
    tags: &[Tag],
) -> Result<Vec<u8>, TerrainError> {
    let mut writer = TiffWriter::new(Cursor::new(Vec::new()), WriteOptions::default())?;
    let mut handles = Vec::new();
    for (i, level) in levels.iter().enumerate() {
        let mut image = ImageBuilder::new(level.nx as u32, level.ny as u32)
            .sample_type::<T>()
            .samples_per_pixel(level.bands.len() as u16)
            .planar_configuration(PlanarConfiguration::Planar)
            .photometric(kind.photometric)
            .extra_samples(kind.extra.clone())
            .compression(Compression::Deflate)
            .predictor(kind.predictor)
            .tiles(BLOCK as u32, BLOCK as u32);
        if let Some([red, green, blue]) = &kind.color_map {
            let colors = ColorMap::new(red.clone(), green.clone(), blue.clone());
            image = image.color_map(colors.map_err(|reason| TerrainError::TiffWrite { reason })?);
        }
        if i == 0 {
            for tag in tags {
                image = image.tag(tag.clone());
            }
        } else {
            image = image.overview();
        }
        if let Some(nodata) = kind.nodata.filter(|_| i > 0) {
            image = image.tag(Tag::new(TAG_GDAL_NODATA, TagValue::Ascii(nodata.to_owned())));
        }
        handles.push(writer.add_image(image)?);
    }
    // The coarsest first, as readers ask for it first.
    for (level, handle) in levels.iter().zip(&handles).rev() {
        let (across, down) = (level.nx.div_ceil(BLOCK), level.ny.div_ceil(BLOCK));
        let mut index = 0;
        for band in &level.bands {
            for (row, column) in (0..down).flat_map(|y| (0..across).map(move |x| (y, x))) {
                writer.write_block(handle, index, &level.block(band, column, row, fill))?;
                index += 1;
            }
        }
    }
    cog::directories_first(writer.finish()?.into_inner())
}

/// The bands at one size, row by row from the north.
struct Level<T> {
    nx: usize,
    ny: usize,
    bands: Vec<Vec<T>>,
}

/// A level of bytes and its halvings until one tile holds it: `mix` gives the values of all bands from the places of
/// up to four.
fn halvings(first: Level<u8>, mix: impl Fn(&[Vec<u8>], &[usize]) -> Vec<u8>) -> Vec<Level<u8>> {
    let mut levels = vec![first];
    while levels[levels.len() - 1].nx.max(levels[levels.len() - 1].ny) > BLOCK {
        let last = &levels[levels.len() - 1];
        let (nx, ny) = (last.nx.div_ceil(2), last.ny.div_ceil(2));
        let mut bands = vec![Vec::with_capacity(nx * ny); last.bands.len()];
        for (y, x) in (0..ny).flat_map(|y| (0..nx).map(move |x| (y, x))) {
            let four = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(dx, dy)| (2 * x + dx, 2 * y + dy));
            let inside = four.into_iter().filter(|(x, y)| *x < last.nx && *y < last.ny);
            let four: Vec<usize> = inside.map(|(x, y)| y * last.nx + x).collect();
            for (band, value) in bands.iter_mut().zip(mix(&last.bands, &four)) {
                band.push(value);
            }
        }
        levels.push(Level { nx, ny, bands });
    }
    levels
}

impl<T: Copy> Level<T> {
    /// A tile of a band; what lies beyond is `fill`.
    fn block(&self, band: &[T], column: usize, row: usize, fill: T) -> Vec<T> {
        let mut block = vec![fill; BLOCK * BLOCK];
        let width = BLOCK.min(self.nx - column * BLOCK);
        for (y, to) in block.chunks_exact_mut(BLOCK).enumerate().take(self.ny - row * BLOCK) {
            let from = (row * BLOCK + y) * self.nx + column * BLOCK;
            to[..width].copy_from_slice(&band[from..from + width]);
        }
        block
    }
}

impl Level<f32> {
    fn of(grid: &Grid, layers: &[(&str, &Raster<f32>)], placement: &Placement) -> Level<f32> {
        let lift = if placement.system.is_some() { placement.offset.z } else { 0.0 };
        let north_up = |(name, layer): &(&str, &Raster<f32>)| {
            let values = layer.values().chunks_exact(grid.nx).rev().flatten();
            match *name {
                "height_m" if lift != 0.0 => {
                    values.map(|z| (f64::from(*z) + lift) as f32).collect()
                }
                _ => values.copied().collect(),
            }
        };
        Level { nx: grid.nx, ny: grid.ny, bands: layers.iter().map(north_up).collect() }
    }

    fn halved(&self, layers: &[(&str, &Raster<f32>)]) -> Level<f32> {
        let (nx, ny) = (self.nx.div_ceil(2), self.ny.div_ceil(2));
        let halve = |(band, (name, _)): (&Vec<f32>, &(&str, &Raster<f32>))| {
            let mut out = Vec::with_capacity(nx * ny);
            for (y, x) in (0..ny).flat_map(|y| (0..nx).map(move |x| (y, x))) {
                let four = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(dx, dy)| {
                    let (x, y) = (2 * x + dx, 2 * y + dy);
                    if x < self.nx && y < self.ny { band[y * self.nx + x] } else { f32::NAN }
                });
                let known = four.into_iter().filter(|z| !z.is_nan());
                let n = known.clone().count();
                out.push(match *name {
                    _ if n == 0 => f32::NAN,
                    "class" => known.fold(f32::INFINITY, f32::min),
                    _ if n < 2 => f32::NAN,
                    _ => (known.map(f64::from).sum::<f64>() / n as f64) as f32,
                });
            }
            out
        };
        Level { nx, ny, bands: self.bands.iter().zip(layers).map(halve).collect() }
    }
}

/// Where the pixels lie, and what the bands are.
fn tags(grid: &Grid, names: &[&str], placement: &Placement) -> Vec<Tag> {
    let c = grid.resolution;
    let system = placement.system.as_deref();
    let origin = system.map_or(grid.origin, |_| grid.origin + placement.offset.xy());
    let top_left = [origin.x - 0.5 * c, origin.y + c * (grid.ny as f64 - 0.5)];
    let citation = "FootFall local frame: x, y in meters, z up|";
    let citation_len = citation.len() as u16;
    // Version 1.1.0 and four keys of 4 numbers: id, where its value is (0 = here), count, value.
    #[rustfmt::skip]
    let geo_keys = vec![
        1, 1, 0, 4,
        1024, 0, 1, 32767, // model type: user-defined
        1025, 0, 1, 1, // raster type: pixel is area
        1026, TAG_GEO_ASCII, citation_len, 0,
        3076, 0, 1, 9001, // linear unit: meter
    ];
    let mut metadata = "<GDALMetadata>\n".to_owned();
    for (band, name) in names.iter().enumerate() {
        metadata += &format!(
            "  <Item name=\"DESCRIPTION\" sample=\"{band}\" role=\"description\">{name}</Item>\n"
        );
    }
    metadata += "</GDALMetadata>\n";
    let local = (&geo_keys[..], &[][..], citation);
    let (geo_keys, doubles, ascii) = system.map_or(local, |system| system.tags());
    let mut tags = vec![
        Tag::new(TAG_PIXEL_SCALE, TagValue::Double(vec![c, c, 0.0])),
        Tag::new(
            TAG_TIEPOINT,
            TagValue::Double(vec![0.0, 0.0, 0.0, top_left[0], top_left[1], 0.0]),
        ),
        Tag::new(TAG_GEO_KEYS, TagValue::Short(geo_keys.to_vec())),
        Tag::new(TAG_GDAL_METADATA, TagValue::Ascii(metadata)),
    ];
    if !doubles.is_empty() {
        tags.push(Tag::new(TAG_GEO_DOUBLES, TagValue::Double(doubles.to_vec())));
    }
    if !ascii.is_empty() {
        tags.push(Tag::new(TAG_GEO_ASCII, TagValue::Ascii(ascii.to_owned())));
    }
    tags
}
