//! PDS3 images and 16-bit PNG.

use nalgebra::Point2;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use terrain::formats::{ByteSource, Crop, CropCenter, ReadOptions, pds3, png_heights, read_with};
use terrain::{ElevationMap, TerrainError};
use testkit::shared_data;

use crate::damage::{damaged, rounds};

/// 3 lines of 4 samples, heights 0.5 * (10 line + sample) + 100, the first of the last line missing.
const LABEL: &str = "PDS_VERSION_ID = PDS3\r\n/* a comment = 1 */\r\nRECORD_TYPE = FIXED_LENGTH\r\n\
RECORD_BYTES = 16\r\n^IMAGE = 65\r\nOBJECT = IMAGE_MAP_PROJECTION\r\n  MAP_SCALE = 2.0 <METERS/PIXEL>\r\n\
  LINE_PROJECTION_OFFSET = 1.0\r\n  SAMPLE_PROJECTION_OFFSET = -5.0\r\nEND_OBJECT = IMAGE_MAP_PROJECTION\r\n\
OBJECT = IMAGE\r\n  LINES = 3\r\n  LINE_SAMPLES = 4\r\n  SAMPLE_TYPE = IEEE_REAL\r\n  SAMPLE_BITS = 32\r\n\
  NOTE = \"two\r\nlines\"\r\n  SCALING_FACTOR = 0.5\r\n  OFFSET = 100.0\r\n\
  MISSING_CONSTANT = 16#FF7FFFFB#\r\nEND_OBJECT = IMAGE\r\nEND\r\n";

fn image(label: &str) -> Vec<u8> {
    let mut bytes = label.as_bytes().to_vec();
    assert!(bytes.len() <= 1024);
    bytes.resize(1024, b' ');
    for line in 0..3 {
        for sample in 0..4 {
            let missing = f32::from_bits(0xFF7F_FFFB);
            let value = (10 * line + sample) as f32;
            bytes.extend(if (line, sample) == (2, 0) { missing } else { value }.to_be_bytes());
        }
    }
    bytes
}

fn read(bytes: &[u8], options: &ReadOptions) -> Result<ElevationMap, TerrainError> {
    read_with("a.img", bytes, &mut |_| None, options)
}

#[test]
fn a_label_places_and_scales_its_image() {
    let map = read(&image(LABEL), &ReadOptions::default()).unwrap();
    assert_eq!((map.grid().nx, map.grid().ny, map.grid().resolution), (4, 3, 2.0));
    // The first pixel's center is 5 samples right of the origin and 1 line above it.
    assert_eq!(map.grid().origin, Point2::new(10.0, -2.0));
    assert_eq!(map.height_at(Point2::new(10.0, 2.0)), Some(100.0));
    assert_eq!(map.height_at(Point2::new(16.0, 0.0)), Some(106.5));
    assert!(map.heights().at(0, 0).is_nan());
    assert_eq!(map.height_at(Point2::new(16.0, -2.0)), Some(111.5));
    let crop = Crop { center: CropCenter::Meters(Point2::new(5.0, 3.0)), width_m: 2.0 };
    let part = read(&image(LABEL), &ReadOptions { crop: Some(crop), ..ReadOptions::default() });
    let part = part.unwrap();
    assert_eq!(part.heights().values(), [106.0, 106.5, 101.0, 101.5]);
    assert_eq!(part.grid().origin, Point2::new(14.0, 0.0));
}

/// A source that tells how much was read of it.
struct Counted<'a> {
    bytes: &'a [u8],
    len: u64,
    n_read: usize,
}

impl ByteSource for Counted<'_> {
    fn len(&self) -> u64 {
        self.len
    }

    fn read_at(&mut self, offset: u64, n: usize) -> Result<Vec<u8>, String> {
        self.n_read += n;
        let held = |i: usize| self.bytes.get(offset as usize + i).copied().unwrap_or(0);
        Ok((0..n).map(held).collect())
    }
}

#[test]
fn of_a_large_image_only_the_window_is_read() {
    let large = LABEL
        .replace("LINES = 3", "LINES = 16384")
        .replace("LINE_SAMPLES = 4", "LINE_SAMPLES = 16384");
    let bytes = image(&large.replace("MAP_SCALE = 2.0", "MAP_SCALE = 1.0"));
    let mut source = Counted { bytes: &bytes, len: 1024 + 4 * 16384 * 16384, n_read: 0 };
    let label = pds3::read_label(&mut source).unwrap();
    let crop = Crop { center: CropCenter::Fraction(Point2::new(0.5, 0.5)), width_m: 100.0 };
    source.n_read = 0;
    let options = ReadOptions { crop: Some(crop), ..ReadOptions::default() };
    let map = pds3::read(&label, &mut source, &options).unwrap();
    assert_eq!((map.grid().nx, map.grid().ny), (100, 100));
    assert_eq!(source.n_read, 4 * 100 * 100);
    let whole = pds3::read(&label, &mut source, &ReadOptions::default());
    assert!(matches!(whole, Err(TerrainError::TooManyNodes { .. })));
}

#[test]
fn all_sample_types_and_storages_are_decoded() {
    let header = |kind: &str, bits: usize, more: &str| {
        let text = format!(
            "PDS_VERSION_ID = PDS3\n^IMAGE = 1025 <BYTES>\nOBJECT = IMAGE\nLINES = 2\nLINE_SAMPLES = 3\n\
             SAMPLE_TYPE = {kind}\nSAMPLE_BITS = {bits}\n{more}\nEND_OBJECT\nEND\n"
        );
        let mut bytes = text.into_bytes();
        bytes.resize(1024, 0);
        bytes
    };
    let values: [i64; 6] = [0, 1, -2, 100, -128, 127];
    type Encode = fn(i64) -> Vec<u8>;
    let kinds: [(&str, usize, Encode); 9] = [
        ("MSB_INTEGER", 16, |v| (v as i16).to_be_bytes().to_vec()),
        ("LSB_INTEGER", 16, |v| (v as i16).to_le_bytes().to_vec()),
        ("MSB_INTEGER", 8, |v| (v as i8).to_be_bytes().to_vec()),
        ("SUN_INTEGER", 32, |v| (v as i32).to_be_bytes().to_vec()),
        ("PC_INTEGER", 32, |v| (v as i32).to_le_bytes().to_vec()),
        ("IEEE_REAL", 32, |v| (v as f32).to_be_bytes().to_vec()),
        ("PC_REAL", 32, |v| (v as f32).to_le_bytes().to_vec()),
        ("IEEE_REAL", 64, |v| (v as f64).to_be_bytes().to_vec()),
        ("PC_REAL", 64, |v| (v as f64).to_le_bytes().to_vec()),
    ];
    let expected: Vec<f64> = values.iter().map(|v| *v as f64).collect();
    for (kind, bits, encode) in kinds {
        let mut bytes = header(kind, bits, "");
        bytes.extend(values.iter().flat_map(|v| encode(*v)));
        let mut source = bytes.as_slice();
        let image = pds3::read_label(&mut source).unwrap();
        assert_eq!(image.samples(&mut source, 0, 0..2, 0..3).unwrap(), expected, "{kind} {bits}");
        let one = image.samples(&mut source, 0, 1..2, 1..3).unwrap();
        assert_eq!(one, expected[4..], "a window of {kind} {bits}");
    }
    let mut bytes = header("UNSIGNED_INTEGER", 16, "LINE_PREFIX_BYTES = 3\nLINE_SUFFIX_BYTES = 1");
    for line in [[1_u16, 2, 65535], [4, 5, 6]] {
        bytes.extend([9; 3]);
        bytes.extend(line.iter().flat_map(|v| v.to_be_bytes()));
        bytes.push(9);
    }
    let mut source = bytes.as_slice();
    let image = pds3::read_label(&mut source).unwrap();
    let found = image.samples(&mut source, 0, 0..2, 0..3).unwrap();
    assert_eq!(found, [1.0, 2.0, 65535.0, 4.0, 5.0, 6.0]);
    // Band b, line l, sample s is 100 b + 10 l + s; 2 bands.
    let value = |b: usize, l: usize, s: usize| (100 * b + 10 * l + s) as u8;
    let order = |storage: &str| -> Vec<u8> {
        let mut out = Vec::new();
        for i in 0..12 {
            let (b, l, s) = match storage {
                "BAND_SEQUENTIAL" => (i / 6, i / 3 % 2, i % 3),
                "LINE_INTERLEAVED" => (i / 3 % 2, i / 6, i % 3),
                _ => (i % 2, i / 6, i / 2 % 3),
            };
            out.push(value(b, l, s));
        }
        out
    };
    for storage in ["BAND_SEQUENTIAL", "LINE_INTERLEAVED", "SAMPLE_INTERLEAVED"] {
        let more = format!("BANDS = 2\nBAND_STORAGE_TYPE = {storage}");
        let mut bytes = header("UNSIGNED_INTEGER", 8, &more);
        bytes.extend(order(storage));
        let mut source = bytes.as_slice();
        let image = pds3::read_label(&mut source).unwrap();
        let found = image.samples(&mut source, 1, 0..2, 1..3).unwrap();
        assert_eq!(found, [101.0, 102.0, 111.0, 112.0], "{storage}");
    }
}

#[test]
fn unusable_labels_are_refused_by_name() {
    let cases = [
        ("PDS_VERSION_ID = PDS3", "FORMAT = \"x\"", ""),
        ("^IMAGE = 65", "^TABLE = 65", "^IMAGE is missing"),
        ("^IMAGE = 65", "^IMAGE = 0", "^IMAGE is \"0\", no place"),
        ("^IMAGE = 65", "^IMAGE = 18446744073709551615", "no place"),
        ("^IMAGE = 65", "^IMAGE = 66", "truncated"),
        ("RECORD_BYTES = 16\r\n", "", "RECORD_BYTES is missing"),
        ("LINES = 3", "LINES = 0", "LINES"),
        ("LINES = 3", "LINES = -3", "LINES is \"-3\", not a whole number"),
        ("LINES = 3", "LINES = 99999999999", "more than the 16777216 allowed"),
        ("LINES = 3", "LINES = 4096", "truncated"),
        ("IEEE_REAL", "VAX_REAL", "SAMPLE_TYPE is VAX_REAL"),
        ("SAMPLE_BITS = 32", "SAMPLE_BITS = 24", "SAMPLE_BITS is 24"),
        ("SAMPLE_BITS = 32", "BANDS = 2\nSAMPLE_BITS = 32", "BANDS is 2"),
        ("SAMPLE_BITS = 32", "SAMPLE_BITS = 32\nUNIT = KILOMETER", "convert the heights"),
        ("SAMPLE_BITS = 32", "SAMPLE_BITS = 32\nENCODING_TYPE = GIF", "decompress"),
        ("<METERS/PIXEL>", "<DEGREES/PIXEL>", "has the unit \"DEGREES/PIXEL\""),
        ("<METERS/PIXEL>", "", "has the unit \"\""),
        ("MAP_SCALE = 2.0 <METERS/PIXEL>", "X = 1", "MAP_SCALE is not given"),
        ("MAP_SCALE = 2.0", "MAP_SCALE = 1e99", "MAP_SCALE"),
        ("16#FF7FFFFB#", "16#XYZ#", "is no number"),
        ("OFFSET = 100.0", "OFFSET = nan", "not a finite number"),
        ("lines\"", "lines", "not closed"),
    ];
    for (from, to, expected) in cases {
        let text = LABEL.replace(from, to);
        assert_ne!(text, LABEL, "{from:?}");
        let mut bytes = image(&text);
        if from == "PDS_VERSION_ID = PDS3" {
            bytes.truncate(30);
        }
        let refused = read(&bytes, &ReadOptions::default()).expect_err(to).to_string();
        assert!(refused.contains(expected), "{to:?}: {refused}");
    }
    // A unit that is not closed is no reason for a message of pages.
    let text = LABEL.replace("<METERS/PIXEL>", &format!("<{}", "M".repeat(200)));
    let refused = read(&image(&text), &ReadOptions::default()).unwrap_err().to_string();
    assert!(refused.len() < 300, "{refused}");
    let unscaled = LABEL.replace("MAP_SCALE = 2.0 <METERS/PIXEL>", "X = 1");
    let options = ReadOptions { cell_m: Some(0.5), ..ReadOptions::default() };
    assert_eq!(read(&image(&unscaled), &options).unwrap().grid().resolution, 0.5);
}

#[test]
fn a_detached_label_finds_its_image_and_says_which_is_missing() {
    let label = LABEL.replace("^IMAGE = 65", "^IMAGE = (\"DEM.IMG\", 65)");
    let samples = image(LABEL);
    let mut beside = |name: &str| (name == "DEM.IMG").then(|| samples.clone());
    let options = ReadOptions::default();
    let map = read_with("dem.lbl", label.as_bytes(), &mut beside, &options).unwrap();
    assert_eq!(map.height_at(Point2::new(10.0, 2.0)), Some(100.0));
    let missing = read_with("dem.lbl", label.as_bytes(), &mut |_| None, &options).unwrap_err();
    let expected =
        TerrainError::CompanionMissing { file_name: "dem.lbl".into(), companion: "DEM.IMG".into() };
    assert_eq!(missing, expected);
}

#[test]
fn the_sample_images_have_the_statistics_that_their_labels_state() {
    for (name, max, mean) in
        [("pds3_1band.IMG", 99.0, 49.5), ("pds3_1band_float.IMG", 148.5, 74.25)]
    {
        let Some(bytes) = shared_data("pds3", &format!("pds3_samples/{name}")) else { return };
        let mut source = bytes.as_slice();
        let image = pds3::read_label(&mut source).unwrap();
        let values = image.samples(&mut source, 0, 0..10, 0..10).unwrap();
        let sum: f64 = values.iter().sum();
        let high = values.iter().copied().fold(f64::MIN, f64::max);
        assert_eq!((values[0], high, sum / 100.0), (0.0, max, mean), "{name}");
    }
    let Some(bytes) = shared_data("pds3", "pds3_samples/pds3_3bands.IMG") else { return };
    let mut source = bytes.as_slice();
    let image = pds3::read_label(&mut source).unwrap();
    assert_eq!(image.bands, 3);
    // As GDAL 3.6.2 reads it (the file's pointer is off, which both follow): band 1 from 1 to 19777, the
    // others from 0 to 99.
    for (band, low, high, mean) in
        [(0, 1.0, 19777.0, 892.4), (1, 0.0, 99.0, 49.5), (2, 0.0, 99.0, 49.5)]
    {
        let values = image.samples(&mut source, band, 0..10, 0..10).unwrap();
        let ends = values.iter().fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(*v), h.max(*v)));
        assert_eq!(ends, (low, high), "band {band}");
        assert!((values.iter().sum::<f64>() / 100.0 - mean).abs() < 1e-9);
    }
}

const JSON: &str =
    r#"{"cell_m": 0.5, "height_offset_m": -3.0, "height_scale_m": 0.25, "nodata": 7}"#;

fn encoded(color: png::ColorType, depth: png::BitDepth, pixels: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, 3, 2);
    encoder.set_color(color);
    encoder.set_depth(depth);
    encoder.write_header().unwrap().write_image_data(pixels).unwrap();
    bytes
}

#[test]
fn sixteen_bits_of_gray_are_heights() {
    let pixels: Vec<u8> =
        [0_u16, 4, 7, 65535, 8, 12].iter().flat_map(|v| v.to_be_bytes()).collect();
    let bytes = encoded(png::ColorType::Grayscale, png::BitDepth::Sixteen, &pixels);
    let options = ReadOptions::default();
    let map = png_heights::read(&bytes, JSON.as_bytes(), &options).unwrap();
    assert_eq!((map.grid().nx, map.grid().ny, map.grid().resolution), (3, 2, 0.5));
    // 65535 / 4 - 3 m is beyond 1 km: the map is in a local frame.
    let z = |ix: usize, iy: usize| f64::from(*map.heights().at(ix, iy)) + map.frame_offset().z;
    assert_eq!([z(0, 1), z(1, 1), z(1, 0), z(2, 0)], [-3.0, -2.0, -1.0, 0.0]);
    assert!((z(0, 0) - 16380.75).abs() < 1e-2 && z(2, 1).is_nan());
    let mut beside = |name: &str| (name == "a.b.json").then(|| JSON.as_bytes().to_vec());
    assert!(read_with("a.b.png", &bytes, &mut beside, &options).is_ok());
    let refused = read_with("a.png", &bytes, &mut beside, &options).unwrap_err();
    assert!(refused.to_string().contains("needs \"a.json\" beside it"), "{refused}");
    let eight = encoded(png::ColorType::Grayscale, png::BitDepth::Eight, &[0; 6]);
    let color = encoded(png::ColorType::Rgb, png::BitDepth::Sixteen, &[0; 36]);
    for bad in [&eight, &color] {
        let refused = png_heights::read(bad, JSON.as_bytes(), &options).unwrap_err();
        assert!(refused.to_string().contains("16 bits of gray"), "{refused}");
    }
    let cases = [
        ("0.5", "0", "cell_m"),
        ("-3.0", "1e99", "height_offset_m"),
        ("\"nodata\"", "\"no_data\"", "unknown field"),
        ("7", "-7", "JSON"),
        ("0.25", "null", "JSON"),
    ];
    for (from, to, expected) in cases {
        let json = JSON.replace(from, to);
        let refused = png_heights::read(&bytes, json.as_bytes(), &options).unwrap_err();
        assert!(refused.to_string().contains(expected), "{refused}");
    }
    let small = ReadOptions { max_nodes: 5, ..options };
    let refused = png_heights::read(&bytes, JSON.as_bytes(), &small);
    assert!(matches!(refused, Err(TerrainError::TooManyNodes { .. })));
}

#[test]
fn damaged_images_give_a_map_or_an_error() {
    let mut rng = ChaCha8Rng::seed_from_u64(6);
    let pixels: Vec<u8> = (0..12).collect();
    let png = encoded(png::ColorType::Grayscale, png::BitDepth::Sixteen, &pixels);
    let originals = [image(LABEL), png, JSON.as_bytes().to_vec()];
    let pieces = [
        "=",
        "(",
        "\"",
        "END_OBJECT\n",
        "OBJECT = A\n",
        "<",
        "16#",
        "/*",
        "\n",
        "99999999999999999999",
    ];
    let options = ReadOptions { max_nodes: 10_000, ..ReadOptions::default() };
    for round in 0..rounds(9000) {
        let kind = round % 3;
        // Where damage matters: in the label.
        let within = if kind == 0 { 600 } else { usize::MAX };
        let bytes = damaged(&mut rng, &originals[kind], within, &pieces);
        drop(match kind {
            0 => read_with("a.img", &bytes, &mut |_| None, &options),
            1 => png_heights::read(&bytes, JSON.as_bytes(), &options),
            _ => png_heights::read(&originals[1], &bytes, &options),
        });
    }
    for kind in [0, 1] {
        for len in 0..originals[kind].len() {
            let cut = &originals[kind][..len];
            let answer = match kind {
                0 => read(cut, &options),
                _ => png_heights::read(cut, JSON.as_bytes(), &options),
            };
            // The last bytes of a PNG are its end mark.
            assert!(
                answer.is_err() || (kind == 1 && len + 16 > originals[1].len()),
                "{kind} {len}"
            );
        }
    }
}
