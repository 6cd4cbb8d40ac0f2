//! PDS3 images (`.IMG` with its label attached, or `.LBL` beside it) of heights in meters.
//!
//! The label is ODL: `KEY = VALUE <UNIT>`, objects and groups nested (PDS Standards Reference 3.8,
//! chapter 12). Read are integer samples of 8, 16 and 32 bits and IEEE reals of 32 and 64, either byte
//! order, with prefix and suffix bytes, bands, scaling, offset and missing constants; a window of lines
//! and samples is read without the rest. What else a label may ask for is refused by name.

mod label;

use geometry::Grid;
use nalgebra::Point2;

use super::geotiff::Part;
use super::{ByteSource, ReadOptions, localized};
use crate::{ElevationMap, Source, TerrainError};
use label::Label;

/// Longest label (bytes).
const LABEL_MAX: u64 = 1 << 20;
/// Most lines, samples and bands that a label may tell of.
const COUNT_MAX: u64 = 1 << 24;

/// Where the samples of a label lie, and how they are stored.
#[derive(Debug, Clone, PartialEq)]
pub struct Image {
    /// Samples of a line.
    pub nx: usize,
    /// Lines.
    pub ny: usize,
    /// Bands.
    pub bands: usize,
    /// The file that holds them, where it is not that of the label.
    pub file: Option<String>,
    start: u64,
    sample: Sample,
    storage: Storage,
    prefix: u64,
    suffix: u64,
    scale: f64,
    offset: f64,
    missing: Vec<f64>,
    /// Size of a pixel (m), and the map's origin in samples and lines from the first pixel's center.
    map: Option<(f64, [f64; 2])>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Sample {
    bytes: u64,
    kind: Kind,
    is_big_endian: bool,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Kind {
    Signed,
    Unsigned,
    Real,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Storage {
    BandSequential,
    LineInterleaved,
    SampleInterleaved,
}

/// Reads the label at the beginning of a file.
pub fn read_label(source: &mut dyn ByteSource) -> Result<Image, TerrainError> {
    let n = source.len().min(LABEL_MAX) as usize;
    let bytes = source.read_at(0, n).map_err(|reason| refuse("file", reason))?;
    Image::of(&Label::parse(&String::from_utf8_lossy(&bytes))?)
}

/// Reads the heights of an image whose label was read. `source` is the file that holds the samples.
/// A label without a map scale takes its pixels' size from `options.cell_m`.
pub fn read(
    image: &Image,
    source: &mut dyn ByteSource,
    options: &ReadOptions,
) -> Result<ElevationMap, TerrainError> {
    if image.bands != 1 {
        let text =
            format!("is {}: extract the band of heights into a file of its own", image.bands);
        return Err(refuse("BANDS", text));
    }
    let (cell, zero) = match (image.map, options.cell_m) {
        (Some(map), _) => map,
        (None, Some(cell)) => (cell, [0.0, image.ny as f64 - 1.0]),
        (None, None) => {
            return Err(refuse(
                "MAP_SCALE",
                "is not given: tell the size of a pixel, cell_m".into(),
            ));
        }
    };
    TerrainError::check("MAP_SCALE (m)", cell, [1e-6, 1e6], "a pixel of 1e-6 to 1e6 m")?;
    let (nx, ny) = (image.nx, image.ny);
    if nx < 2 || ny < 2 {
        return Err(TerrainError::TooFewNodes { nx, ny });
    }
    let origin = Point2::new(-zero[0] * cell, (zero[1] - (ny as f64 - 1.0)) * cell);
    for value in [origin.x, origin.y] {
        TerrainError::check("projection offset (m)", value, [-1e12, 1e12], "a finite place")?;
    }
    let whole = Grid { origin, resolution: cell, nx, ny };
    let part = match options.crop {
        Some(crop) => Part::of(&whole, crop)?,
        None => Part { x0: 0, y0: 0, nx, ny },
    };
    TerrainError::check_nodes(part.nx as f64 * part.ny as f64, options.max_nodes)?;
    let lines = ny - part.y0 - part.ny..ny - part.y0;
    let north_up = image.samples(source, 0, lines, part.x0..part.x0 + part.nx)?;
    let heights: Vec<f64> = north_up.chunks_exact(part.nx).rev().flatten().copied().collect();
    let origin = whole.position(part.x0, part.y0);
    let grid = Grid { origin, nx: part.nx, ny: part.ny, ..whole };
    localized(grid, &heights, Source::file("pds3"))
}

/// What a label says, for messages.
fn short(text: &str) -> String {
    text.chars().take(40).collect()
}

fn refuse(key: &str, reason: String) -> TerrainError {
    TerrainError::Pds3Label { key: short(key), reason }
}

impl Image {
    fn of(label: &Label) -> Result<Image, TerrainError> {
        let count = |key: &str, default: Option<u64>| -> Result<u64, TerrainError> {
            match label.integer("IMAGE", key)?.or(default) {
                Some(n) if n <= COUNT_MAX => Ok(n),
                Some(n) => Err(refuse(key, format!("is {n}, more than the {COUNT_MAX} allowed"))),
                None => Err(refuse(key, "is missing".into())),
            }
        };
        let (nx, ny) = (count("LINE_SAMPLES", None)?, count("LINES", None)?);
        let bands = count("BANDS", Some(1))?;
        if nx == 0 || ny == 0 || bands == 0 {
            return Err(refuse("LINES", "LINE_SAMPLES and BANDS are to be 1 or more".into()));
        }
        if let Some(coding) = label.text("IMAGE", "ENCODING_TYPE").filter(|text| *text != "N/A") {
            return Err(refuse(
                "ENCODING_TYPE",
                format!("is {}: decompress the image", short(coding)),
            ));
        }
        let storage = match label.text("IMAGE", "BAND_STORAGE_TYPE") {
            None | Some("BAND_SEQUENTIAL" | "BAND SEQUENTIAL") => Storage::BandSequential,
            Some("LINE_INTERLEAVED" | "LINE INTERLEAVED") => Storage::LineInterleaved,
            Some("SAMPLE_INTERLEAVED" | "SAMPLE INTERLEAVED") => Storage::SampleInterleaved,
            Some(other) => {
                return Err(refuse(
                    "BAND_STORAGE_TYPE",
                    format!("is {}, which is unknown", short(other)),
                ));
            }
        };
        if let Some(unit) = label.text("IMAGE", "UNIT")
            && !["M", "METER", "METERS"].contains(&unit.to_ascii_uppercase().as_str())
        {
            return Err(refuse(
                "UNIT",
                format!("is {}: convert the heights to meters", short(unit)),
            ));
        }
        let sample = sample(label)?;
        let missing = ["MISSING_CONSTANT", "MISSING", "INVALID_CONSTANT", "CORE_NULL"];
        let missing = missing.into_iter().filter_map(|key| label.text("IMAGE", key));
        let missing = missing.map(|text| constant(text, sample)).collect::<Result<_, _>>()?;
        let (file, start) = label.pointer("IMAGE")?;
        let number =
            |key, default| label.number("IMAGE", key).map(|value| value.unwrap_or(default));
        Ok(Image {
            nx: nx as usize,
            ny: ny as usize,
            bands: bands as usize,
            file,
            start,
            sample,
            storage,
            prefix: count("LINE_PREFIX_BYTES", Some(0))?,
            suffix: count("LINE_SUFFIX_BYTES", Some(0))?,
            scale: number("SCALING_FACTOR", 1.0)?,
            offset: number("OFFSET", 0.0)?,
            missing,
            map: map_of(label)?,
        })
    }

    /// The values of a window of a band, line by line from the top (scaled; NaN where missing).
    pub fn samples(
        &self,
        source: &mut dyn ByteSource,
        band: usize,
        lines: std::ops::Range<usize>,
        columns: std::ops::Range<usize>,
    ) -> Result<Vec<f64>, TerrainError> {
        let fits = band < self.bands && lines.end <= self.ny && columns.end <= self.nx;
        if !fits || lines.is_empty() || columns.is_empty() {
            return Err(refuse("IMAGE", "has no such window".into()));
        }
        // Products of numbers up to 2^24 and 8 bytes: 2^75 at most, so in u128.
        let (nx, ny, bands) = (self.nx as u128, self.ny as u128, self.bands as u128);
        let size = u128::from(self.sample.bytes);
        let margins = u128::from(self.prefix) + u128::from(self.suffix);
        let (per_line, per_sample) = match self.storage {
            Storage::SampleInterleaved => (nx * bands * size + margins, bands * size),
            _ => (nx * size + margins, size),
        };
        let n_rows = match self.storage {
            Storage::SampleInterleaved => ny,
            _ => ny * bands,
        };
        let needed = u128::from(self.start) + n_rows * per_line;
        if needed > u128::from(source.len()) {
            let needed = u64::try_from(needed).unwrap_or(u64::MAX);
            return Err(TerrainError::Pds3Truncated { n_bytes: source.len(), needed });
        }
        let mut values = Vec::with_capacity(lines.len() * columns.len());
        for line in lines {
            let row = match self.storage {
                Storage::BandSequential => band * self.ny + line,
                Storage::LineInterleaved => line * self.bands + band,
                Storage::SampleInterleaved => line,
            };
            let first = columns.start as u128 * per_sample
                + if per_sample > size { band as u128 * size } else { 0 };
            let at =
                u128::from(self.start) + row as u128 * per_line + u128::from(self.prefix) + first;
            let length = (columns.len() - 1) as u128 * per_sample + size;
            let bytes = source.read_at(at as u64, length as usize);
            let bytes = bytes.map_err(|reason| refuse("IMAGE", reason))?;
            let samples = bytes.chunks(per_sample as usize);
            values.extend(samples.map(|bytes| self.value(&bytes[..size as usize])));
        }
        Ok(values)
    }

    fn value(&self, bytes: &[u8]) -> f64 {
        let raw = self.sample.decode(bytes);
        if !raw.is_finite() || self.missing.contains(&raw) {
            return f64::NAN;
        }
        raw * self.scale + self.offset
    }
}

impl Sample {
    fn decode(self, bytes: &[u8]) -> f64 {
        let mut big = [0; 8];
        let start = 8 - bytes.len();
        big[start..].copy_from_slice(bytes);
        if !self.is_big_endian {
            big[start..].reverse();
        }
        let bits = u64::from_be_bytes(big);
        match (self.kind, self.bytes) {
            (Kind::Real, 4) => f64::from(f32::from_bits(bits as u32)),
            (Kind::Real, _) => f64::from_bits(bits),
            (Kind::Unsigned, _) => bits as f64,
            // The sign bit to the top, and back.
            (Kind::Signed, bytes) => ((bits << (64 - 8 * bytes)) as i64 >> (64 - 8 * bytes)) as f64,
        }
    }
}

/// Type and size of the samples.
fn sample(label: &Label) -> Result<Sample, TerrainError> {
    let Some(name) = label.text("IMAGE", "SAMPLE_TYPE") else {
        return Err(refuse("SAMPLE_TYPE", "is missing".into()));
    };
    let (kind, is_big_endian) = match name {
        "MSB_INTEGER" | "MSB_SIGNED_INTEGER" | "SUN_INTEGER" | "MAC_INTEGER" | "INTEGER" => {
            (Kind::Signed, true)
        }
        "LSB_INTEGER" | "LSB_SIGNED_INTEGER" | "PC_INTEGER" | "VAX_INTEGER" => {
            (Kind::Signed, false)
        }
        "MSB_UNSIGNED_INTEGER"
        | "SUN_UNSIGNED_INTEGER"
        | "MAC_UNSIGNED_INTEGER"
        | "UNSIGNED_INTEGER" => (Kind::Unsigned, true),
        "LSB_UNSIGNED_INTEGER" | "PC_UNSIGNED_INTEGER" | "VAX_UNSIGNED_INTEGER" => {
            (Kind::Unsigned, false)
        }
        "IEEE_REAL" | "FLOAT" | "REAL" | "SUN_REAL" | "MAC_REAL" => (Kind::Real, true),
        "PC_REAL" => (Kind::Real, false),
        other => {
            let text = format!("is {}: convert the samples to IEEE_REAL or integers", short(other));
            return Err(refuse("SAMPLE_TYPE", text));
        }
    };
    let bits = label.integer("IMAGE", "SAMPLE_BITS")?;
    let bytes = match (kind, bits) {
        (Kind::Real, Some(bits @ (32 | 64))) => bits / 8,
        (Kind::Signed | Kind::Unsigned, Some(bits @ (8 | 16 | 32))) => bits / 8,
        (_, bits) => {
            let bits = bits.map_or_else(|| "missing".into(), |n| n.to_string());
            let text = format!("is {bits}: {name} has 8, 16 or 32 bits, reals 32 or 64");
            return Err(refuse("SAMPLE_BITS", text));
        }
    };
    Ok(Sample { bytes, kind, is_big_endian })
}

/// A missing constant: a number, or the bits of one in another base, `16#FF7FFFFB#`.
fn constant(text: &str, sample: Sample) -> Result<f64, TerrainError> {
    let bad = || refuse("MISSING_CONSTANT", format!("{:?} is no number", short(text)));
    let Some((base, rest)) = text.split_once('#') else {
        let value: f64 = text.parse().map_err(|_| bad())?;
        // As it would be stored.
        let is_single = (sample.kind, sample.bytes) == (Kind::Real, 4);
        return Ok(if is_single { f64::from(value as f32) } else { value });
    };
    let base: u32 = base.parse().ok().filter(|b| (2..=36).contains(b)).ok_or_else(bad)?;
    let bits = u64::from_str_radix(rest.trim_end_matches('#'), base).map_err(|_| bad())?;
    let bytes = bits.to_be_bytes();
    let is_big_endian = true;
    Ok(Sample { is_big_endian, ..sample }.decode(&bytes[8 - sample.bytes as usize..]))
}

/// Size of a pixel (m) and where the map's origin is, if the label tells.
fn map_of(label: &Label) -> Result<Option<(f64, [f64; 2])>, TerrainError> {
    const OBJECT: &str = "IMAGE_MAP_PROJECTION";
    let Some(scale) = label.number(OBJECT, "MAP_SCALE")? else { return Ok(None) };
    let unit = label.unit(OBJECT, "MAP_SCALE").unwrap_or("").to_ascii_uppercase();
    let factor = match unit.as_str() {
        "METERS/PIXEL" | "METER/PIXEL" | "M/PIXEL" | "M/PIX" | "METERS/PIX" => 1.0,
        "KM/PIXEL" | "KM/PIX" | "KILOMETERS/PIXEL" => 1000.0,
        _ => {
            let unit = short(&unit);
            let text = format!("has the unit {unit:?}: give it in METERS/PIXEL or KM/PIXEL");
            return Err(refuse("MAP_SCALE", text));
        }
    };
    let offset = |key| label.number(OBJECT, key).map(|value| value.unwrap_or(0.0));
    let zero = [offset("SAMPLE_PROJECTION_OFFSET")?, offset("LINE_PROJECTION_OFFSET")?];
    Ok(Some((scale * factor, zero)))
}
