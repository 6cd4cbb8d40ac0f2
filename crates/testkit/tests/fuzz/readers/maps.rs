//! Files of ground: heights, meshes, points.

use std::process::Command;

use geometry::{Grid, Raster};
use nalgebra::Point2;
use terrain::formats::mesh::{HeightMesh, write_obj};
use terrain::formats::{ReadOptions, geotiff, obj, picture, ply, read_with};
use terrain::{ElevationMap, Placement, Source, TerrainError};

use super::answered;
use crate::mutate::{Kind, Seed};
use crate::run::{Answer, Reader};

/// Most nodes that are asked for.
const NODES_MAX: usize = 10_000;
/// A gigabyte of pixels can stand in a strip of a kilobyte: the decoder's own bound, with its copies.
const TIFF_MEMORY_MAX: usize = 900 << 20;
const MEMORY_MAX: usize = 64 << 20;
const SECONDS_MAX: f64 = 5.0;

pub fn readers() -> Vec<Reader> {
    vec![
        Reader {
            name: "geotiff",
            seeds: geotiffs(),
            read: Box::new(|_, bytes| map(read("a.tif", bytes, &[]))),
            memory_max: TIFF_MEMORY_MAX,
            seconds_max: SECONDS_MAX,
        },
        reader("off", offs(), |_, bytes| map(read("a.off", bytes, &[]))),
        reader("obj", objs(), |_, bytes| {
            drop(obj::read(bytes, 4));
            map(read("a.obj", bytes, &[]))
        }),
        reader("ply", plys(), |_, bytes| {
            drop(ply::read_points(bytes, 4));
            map(read("a.ply", bytes, &[]))
        }),
        reader("pds3", pds3s(), |i, bytes| {
            let samples = pds3_samples();
            match i {
                0 | 1 => map(read("a.img", bytes, &[])),
                _ => map(read("a.lbl", bytes, &[("DEM.IMG", &samples)])),
            }
        }),
        png_reader(),
        overlay_reader(),
    ]
}

fn reader(
    name: &'static str,
    seeds: Vec<Seed>,
    read: impl Fn(usize, &[u8]) -> Answer + 'static,
) -> Reader {
    let (memory_max, seconds_max) = (MEMORY_MAX, SECONDS_MAX);
    Reader { name, seeds, read: Box::new(read), memory_max, seconds_max }
}

fn read(name: &str, bytes: &[u8], beside: &[(&str, &[u8])]) -> Result<ElevationMap, TerrainError> {
    let options = ReadOptions { max_nodes: NODES_MAX, ..ReadOptions::default() };
    let mut find =
        |wanted: &str| beside.iter().find(|(n, _)| *n == wanted).map(|(_, b)| b.to_vec());
    read_with(name, bytes, &mut find, &options)
}

/// What was read is a map that may be used: within the bound, no infinite height, sound lengths.
fn map(result: Result<ElevationMap, TerrainError>) -> Answer {
    if let Ok(map) = &result {
        let grid = map.grid();
        let is_sound = grid.len() <= NODES_MAX
            && grid.resolution > 0.0
            && [grid.resolution, grid.origin.x, grid.origin.y].iter().all(|v| v.is_finite())
            && map.frame_offset().iter().all(|v| v.is_finite())
            && map.heights().values().iter().all(|z| !z.is_infinite());
        if !is_sound {
            return Err(format!("it read an unusable map of {grid:?}"));
        }
    }
    answered(&result)
}

/// Pictures over the ground of [`ground`].
fn overlay_reader() -> Reader {
    let grid = Grid { origin: Point2::new(-1.0, 3.0), resolution: 0.1, nx: 50, ny: 40 };
    let gray: Vec<u8> = (0..grid.len()).map(|i| (i * i / 31) as u8).collect();
    let alpha: Vec<u8> = (0..grid.len()).map(|i| if i % 7 == 0 { 0 } else { 255 }).collect();
    let ours = geotiff::write_picture(&grid, &gray, &alpha, &Placement::default()).unwrap();
    let kinds: [&[&str]; 5] = [
        &["-b", "1", "-b", "1", "-b", "1", "-colorinterp", "red,green,blue"],
        &["-b", "1", "-b", "1", "-b", "1", "-b", "2", "-co", "COMPRESS=LZW", "-co", "TILED=YES"],
        &[
            "-b",
            "1",
            "-ot",
            "UInt16",
            "-a_nodata",
            "0",
            "-co",
            "COMPRESS=DEFLATE",
            "-co",
            "PREDICTOR=2",
        ],
        &["-b", "1", "-ot", "Float32", "-co", "COMPRESS=PACKBITS"],
        &["-co", "INTERLEAVE=PIXEL", "-co", "BIGTIFF=YES"],
    ];
    let read = |bytes: &[u8]| {
        let limits = geotiff::GeoTiffOpenOptions::default();
        let file = geotiff::GeoTiffFile::from_bytes_with_options(bytes.to_vec(), limits)?;
        let (low, high) = (Point2::new(0.0, 4.0), Point2::new(3.0, 6.0));
        picture::read(&file, low, high, NODES_MAX)
    };
    let seeds = as_gdal_writes("picture", ours, &kinds, |bytes| read(bytes).is_ok());
    Reader {
        name: "overlay",
        seeds,
        read: Box::new(move |_, bytes| {
            let picture = read(bytes);
            let is_whole = |p: &picture::Picture| {
                p.rgba.len() == p.grid.len()
                    && p.grid.len() <= NODES_MAX
                    && p.stretch.iter().flatten().all(|v| v.is_finite())
            };
            if picture.as_ref().is_ok_and(|p| !is_whole(p)) {
                return Err("it read an unusable picture".to_owned());
            }
            answered(&picture)
        }),
        memory_max: TIFF_MEMORY_MAX,
        seconds_max: SECONDS_MAX,
    }
}

fn ground() -> ElevationMap {
    ground_with(f32::NAN)
}

/// Ground with one odd node.
fn ground_with(odd: f32) -> ElevationMap {
    let grid = Grid { origin: Point2::new(-1.0, 3.0), resolution: 0.25, nx: 20, ny: 17 };
    let heights = Raster::from_fn(grid, |ix, iy| {
        let z = (0.3 * ix as f64).sin() * (0.2 * iy as f64).cos();
        if (ix, iy) == (3, 3) { odd } else { z as f32 }
    });
    ElevationMap::new(heights, Source::file("ground"))
}

fn geotiffs() -> Vec<Seed> {
    let map = ground();
    let ours =
        geotiff::write_layers(map.grid(), &[("height_m", map.heights())], map.placement()).unwrap();
    let kinds: [&[&str]; 10] = [
        &["-co", "COMPRESS=NONE"],
        &["-co", "COMPRESS=LZW", "-co", "PREDICTOR=3"],
        &["-co", "COMPRESS=PACKBITS"],
        &["-co", "COMPRESS=DEFLATE", "-co", "PREDICTOR=2", "-ot", "Int16"],
        &[
            "-co",
            "COMPRESS=ZSTD",
            "-co",
            "TILED=YES",
            "-co",
            "BLOCKXSIZE=16",
            "-co",
            "BLOCKYSIZE=16",
        ],
        &["-co", "COMPRESS=LERC"],
        &["-co", "COMPRESS=LERC_ZSTD"],
        &["-co", "ENDIANNESS=BIG"],
        &["-co", "BIGTIFF=YES", "-co", "COMPRESS=LZW"],
        &["-ot", "Float64", "-a_srs", "+proj=eqc +lat_ts=0 +lon_0=0 +R=1737400 +units=m"],
    ];
    as_gdal_writes("heights", ours, &kinds, |bytes| read("a.tif", bytes, &[]).is_ok())
}

/// A file of ours, and the same as GDAL writes it with each of these options where it is installed, as far as it can
/// be read: not each compression is.
fn as_gdal_writes(
    what: &str,
    ours: Vec<u8>,
    kinds: &[&[&str]],
    is_read: impl Fn(&[u8]) -> bool,
) -> Vec<Seed> {
    let mut seeds = vec![Seed::new("ours", Kind::Tiff, ours.clone())];
    if !testkit::is_installed("fuzz of GDAL's GeoTIFF", "gdal_translate") {
        return seeds;
    }
    let folder = std::env::temp_dir().join(format!("footfall-fuzz-{what}-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let (from, to) = (folder.join("from.tif"), folder.join("to.tif"));
    std::fs::write(&from, ours).unwrap();
    for options in kinds {
        let mut translate = Command::new("gdal_translate");
        translate.arg("-q").args(*options).args([&from, &to]);
        if translate.output().is_ok_and(|output| output.status.success()) {
            let bytes = std::fs::read(&to).unwrap();
            if is_read(&bytes) {
                seeds.push(Seed::new(&options.join(" "), Kind::Tiff, bytes));
            }
        }
    }
    std::fs::remove_dir_all(folder).unwrap();
    seeds
}

fn offs() -> Vec<Seed> {
    let map = ground_with(0.5);
    let grid = *map.grid();
    let (nx, ny) = (grid.nx, grid.ny);
    let mut text = format!("OFF\n{} {} 0\n", grid.len(), 2 * (nx - 1) * (ny - 1));
    for (i, z) in map.heights().values().iter().enumerate() {
        let p = grid.position(i % nx, i / nx);
        text += &format!("{} {} {z}\n", p.x, p.y);
    }
    for (x, y) in (0..ny - 1).flat_map(|y| (0..nx - 1).map(move |x| (x, y))) {
        let a = grid.index(x, y);
        let (b, c, d) = (a + 1, a + nx, a + nx + 1);
        text += &format!("3 {a} {b} {c}\n3 {b} {d} {c}\n");
    }
    let small = "# a comment\n\nOFF # more\r\n6 2 0\r\n0 0 0\r\n.5 0 1\r\n1 0 2\r\n0 .5 3\r\n\
         .5 .5 4 # here\r\n1 .5 5\r\n4 0 1 4 3 255 0 0\r\n4 1 2 5 4\r\n";
    vec![Seed::new("a surface", Kind::Text, text), Seed::new("squares", Kind::Text, small)]
}

fn objs() -> Vec<Seed> {
    let ours = write_obj(&HeightMesh::whole(&ground_with(0.5)), &["ours".to_owned()]);
    let square = "o ground\nv 0 0 1\nv 1 0 2 0.5 0.5 0.5\nv 0 1 3\nv 1 1 4\nvt 0 0\nvn 0 0 1\n\
        g a\ns off\nf 1/1/1 2/1/1 4//1 3\n";
    vec![Seed::new("ours", Kind::Text, ours), Seed::new("a square", Kind::Text, square)]
}

fn plys() -> Vec<Seed> {
    let ours = ply::write(&HeightMesh::whole(&ground()), &["ours".to_owned()]);
    let head = |format: &str| {
        format!(
            "ply\nformat {format} 1.0\ncomment c\nelement other 1\nproperty list uchar int a\n\
             element vertex 3\nproperty double x\nproperty uchar red\nproperty float y\n\
             property short z\nend_header\n"
        )
    };
    let ascii = head("ascii") + "2 5 6\n1.5 7 0.25 -2\n3 255 -5\n 4\n1 1 1 1\n";
    let body = |big: bool| {
        let mut bytes = vec![2];
        for value in [5_i32, 6] {
            bytes.extend(if big { value.to_be_bytes() } else { value.to_le_bytes() });
        }
        for (x, y, z) in [(1.5_f64, 0.25_f32, -2_i16), (3.0, -5.0, 4), (1.0, 1.0, 1)] {
            bytes.extend(if big { x.to_be_bytes() } else { x.to_le_bytes() });
            bytes.push(7);
            bytes.extend(if big { y.to_be_bytes() } else { y.to_le_bytes() });
            bytes.extend(if big { z.to_be_bytes() } else { z.to_le_bytes() });
        }
        bytes
    };
    let little = [head("binary_little_endian").into_bytes(), body(false)].concat();
    let big = [head("binary_big_endian").into_bytes(), body(true)].concat();
    vec![
        Seed::new("ours", Kind::Binary, ours.clone()),
        Seed::new("our header", Kind::Text, ours),
        Seed::new("text", Kind::Text, ascii),
        Seed::new("little", Kind::Text, little),
        Seed::new("big", Kind::Binary, big),
    ]
}

const LABEL: &str = "PDS_VERSION_ID = PDS3\r\n/* a comment = 1 */\r\nRECORD_TYPE = FIXED_LENGTH\r\n\
RECORD_BYTES = 16\r\n^IMAGE = 65\r\nOBJECT = IMAGE_MAP_PROJECTION\r\n  MAP_SCALE = 2.0 <METERS/PIXEL>\r\n\
  LINE_PROJECTION_OFFSET = 1.0\r\n  SAMPLE_PROJECTION_OFFSET = -5.0\r\nEND_OBJECT = IMAGE_MAP_PROJECTION\r\n\
OBJECT = IMAGE\r\n  LINES = 3\r\n  LINE_SAMPLES = 4\r\n  LINE_PREFIX_BYTES = 0\r\n  SAMPLE_TYPE = IEEE_REAL\r\n\
  SAMPLE_BITS = 32\r\n  NOTE = \"two\r\nlines\"\r\n  SCALING_FACTOR = 0.5\r\n  OFFSET = 100.0\r\n\
  MISSING_CONSTANT = 16#FF7FFFFB#\r\nEND_OBJECT = IMAGE\r\nEND\r\n";

fn pds3_samples() -> Vec<u8> {
    let mut bytes = vec![b' '; 1024];
    bytes.extend((0..12).flat_map(|i| (i as f32).to_be_bytes()));
    bytes
}

fn pds3s() -> Vec<Seed> {
    let mut whole = pds3_samples();
    whole[..LABEL.len()].copy_from_slice(LABEL.as_bytes());
    let integers = LABEL.replace("IEEE_REAL", "LSB_INTEGER").replace("BITS = 32", "BITS = 16");
    let integers = integers.replace("16#FF7FFFFB#", "-7");
    let mut second = pds3_samples();
    second[..integers.len()].copy_from_slice(integers.as_bytes());
    let detached = LABEL.replace("^IMAGE = 65", "^IMAGE = (\"DEM.IMG\", 65)");
    vec![
        Seed::new("floats", Kind::Text, whole),
        Seed::new("integers", Kind::Binary, second),
        Seed::new("a label", Kind::Text, detached),
    ]
}

const JSON: &str =
    r#"{"cell_m": 0.5, "height_offset_m": -3.0, "height_scale_m": 0.25, "nodata": 7}"#;

fn png_reader() -> Reader {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, 30, 20);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Sixteen);
    let pixels: Vec<u8> = (0..600_u16).flat_map(|v| (37 * v).to_be_bytes()).collect();
    encoder.write_header().unwrap().write_image_data(&pixels).unwrap();
    let good = bytes.clone();
    let seeds = vec![Seed::new("image", Kind::Png, bytes), Seed::new("JSON", Kind::Text, JSON)];
    reader("png heights", seeds, move |i, bytes| match i {
        0 => map(read("a.png", bytes, &[("a.json", JSON.as_bytes())])),
        _ => map(read("a.png", &good, &[("a.json", bytes)])),
    })
}
