//! Layers of a map as one GeoTIFF.

use std::io::Cursor;

use geometry::{Grid, Raster};
use tiff_core::{Compression, ExtraSample, PlanarConfiguration, Predictor, Tag, TagValue};
use tiff_writer::{ImageBuilder, TiffWriter, WriteOptions};

use crate::TerrainError;

const TAG_PIXEL_SCALE: u16 = 33550;
const TAG_TIEPOINT: u16 = 33922;
const TAG_GEO_KEYS: u16 = 34735;
const TAG_GEO_ASCII: u16 = 34737;
const TAG_GDAL_METADATA: u16 = 42112;
const TAG_GDAL_NODATA: u16 = 42113;
/// Rows of one strip.
const STRIP: usize = 64;

impl From<tiff_writer::Error> for TerrainError {
    fn from(e: tiff_writer::Error) -> TerrainError {
        TerrainError::TiffWrite { reason: e.to_string() }
    }
}

/// The layers as the float32 bands of one GeoTIFF (deflate, a plane per band, north up, NaN =
/// nodata), each described by its name in GDAL's metadata tag.
///
/// The pixels' centers are the nodes of `grid`, in an engineering system of meters without a place
/// on any planet: local `world` coordinates.
pub fn write_layers(grid: &Grid, layers: &[(&str, &Raster<f32>)]) -> Result<Vec<u8>, TerrainError> {
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
    let mut image = ImageBuilder::new(grid.nx as u32, grid.ny as u32)
        .sample_type::<f32>()
        .samples_per_pixel(layers.len() as u16)
        .planar_configuration(PlanarConfiguration::Planar)
        .extra_samples(vec![ExtraSample::Unspecified; layers.len() - 1])
        .compression(Compression::Deflate)
        .predictor(Predictor::FloatingPoint)
        .strips(STRIP as u32);
    for tag in tags(grid, layers) {
        image = image.tag(tag);
    }
    let mut writer = TiffWriter::new(Cursor::new(Vec::new()), WriteOptions::default())?;
    let handle = writer.add_image(image)?;
    let mut strip = Vec::with_capacity(STRIP * grid.nx);
    let mut index = 0;
    for (_, layer) in layers {
        for row in (0..grid.ny).step_by(STRIP) {
            strip.clear();
            for row in row..(row + STRIP).min(grid.ny) {
                let start = grid.index(0, grid.ny - 1 - row);
                strip.extend_from_slice(&layer.values()[start..start + grid.nx]);
            }
            writer.write_block(&handle, index, &strip)?;
            index += 1;
        }
    }
    Ok(writer.finish()?.into_inner())
}

/// Where the pixels lie, and what the bands are.
fn tags(grid: &Grid, layers: &[(&str, &Raster<f32>)]) -> Vec<Tag> {
    let c = grid.resolution;
    let top_left = [grid.origin.x - 0.5 * c, grid.origin.y + c * (grid.ny as f64 - 0.5)];
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
    for (band, (name, _)) in layers.iter().enumerate() {
        let name = name.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;");
        metadata += &format!(
            "  <Item name=\"DESCRIPTION\" sample=\"{band}\" role=\"description\">{name}</Item>\n"
        );
    }
    metadata += "</GDALMetadata>\n";
    vec![
        Tag::new(TAG_PIXEL_SCALE, TagValue::Double(vec![c, c, 0.0])),
        Tag::new(
            TAG_TIEPOINT,
            TagValue::Double(vec![0.0, 0.0, 0.0, top_left[0], top_left[1], 0.0]),
        ),
        Tag::new(TAG_GEO_KEYS, TagValue::Short(geo_keys)),
        Tag::new(TAG_GEO_ASCII, TagValue::Ascii(citation.to_owned())),
        Tag::new(TAG_GDAL_METADATA, TagValue::Ascii(metadata)),
        Tag::new(TAG_GDAL_NODATA, TagValue::Ascii("nan".to_owned())),
    ]
}
