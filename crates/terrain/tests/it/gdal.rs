//! What we write and read, held against GDAL where it is installed.

use std::path::{Path, PathBuf};
use std::process::Command;

use geometry::{Grid, Raster};
use nalgebra::Point2;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use terrain::formats::{geotiff, pds3};
use terrain::{ElevationMap, Placement};
use testkit::{is_installed, shared_data_path};

/// A folder of this test's own.
pub fn folder(name: &str) -> PathBuf {
    let path = std::env::temp_dir().join(format!("footfall-gdal-{name}-{}", std::process::id()));
    std::fs::create_dir_all(&path).unwrap();
    path
}

pub fn run(program: &str, arguments: &[&str]) -> String {
    let output = Command::new(program).args(arguments).output().unwrap();
    assert!(output.status.success(), "{program}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

/// A band as GDAL reads it, converted to 64-bit floats, line by line from the top.
pub fn gdal_band(file: &Path, band: usize, folder: &Path) -> Vec<f64> {
    let raw = folder.join(format!("band{band}.raw"));
    let (file, out) = (file.to_str().unwrap(), raw.to_str().unwrap());
    let band = band.to_string();
    run("gdal_translate", &["-q", "-of", "ENVI", "-ot", "Float64", "-b", &band, file, out]);
    let bytes = std::fs::read(raw).unwrap();
    bytes.chunks_exact(8).map(|b| f64::from_le_bytes(b.try_into().unwrap())).collect()
}

#[test]
fn gdal_reads_our_layers_value_for_value_as_a_cloud_optimized_file() {
    if !is_installed("gdal_reads_our_layers", "gdalinfo") {
        return;
    }
    let folder = folder("layers");
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    for (nx, ny) in [(700, 530), (256, 256), (3, 2), (257, 90)] {
        let grid = Grid { origin: Point2::new(-3.5, 12.25), resolution: 0.05, nx, ny };
        let mut layer = || {
            Raster::from_fn(grid, |_, _| {
                if rng.random::<f64>() < 0.1 {
                    f32::NAN
                } else {
                    100.0 * rng.random::<f32>() - 50.0
                }
            })
        };
        let (heights, sigma) = (layer(), layer());
        let class = Raster::from_fn(grid, |ix, iy| ((ix / 7 + iy / 5) % 4) as f32);
        let layers = [("height_m", &heights), ("sigma of height, m²", &sigma), ("class", &class)];
        let file = folder.join("layers.tif");
        std::fs::write(
            &file,
            geotiff::write_layers(&grid, &layers, &Placement::default()).unwrap(),
        )
        .unwrap();
        let info = run("gdalinfo", &["-json", file.to_str().unwrap()]);
        let info: serde_json::Value = serde_json::from_str(&info).unwrap();
        assert_eq!(info["metadata"]["IMAGE_STRUCTURE"]["LAYOUT"], "COG", "{info}");
        let transform = info["geoTransform"].as_array().unwrap();
        let expected = [-3.525, 0.05, 0.0, 12.25 + 0.05 * (ny as f64 - 0.5), 0.0, -0.05];
        for (found, expected) in transform.iter().zip(expected) {
            assert!((found.as_f64().unwrap() - expected).abs() < 1e-9, "{transform:?}");
        }
        for (k, (name, layer)) in layers.iter().enumerate() {
            let band = &info["bands"][k];
            assert_eq!(band["description"], *name);
            let n_overviews = band["overviews"].as_array().map_or(0, Vec::len);
            let halvings = (nx.max(ny) as f64 / 256.0).log2().ceil().max(0.0) as usize;
            assert_eq!(n_overviews, halvings, "{nx} x {ny}");
            let found = gdal_band(&file, k + 1, &folder);
            let north_up = layer.values().chunks_exact(nx).rev().flatten();
            for (a, b) in found.iter().zip(north_up) {
                assert!(*a == f64::from(*b) || (a.is_nan() && b.is_nan()), "{a}, written {b}");
            }
        }
    }
    std::fs::remove_dir_all(folder).unwrap();
}

/// What GDAL says of a file.
fn gdal_info(file: &Path) -> serde_json::Value {
    serde_json::from_str(&run("gdalinfo", &["-json", file.to_str().unwrap()])).unwrap()
}

#[test]
fn the_reference_system_of_a_map_goes_through_us_as_gdal_wrote_it() {
    if !is_installed("reference_systems", "gdal_translate") {
        return;
    }
    let folder = folder("systems");
    let [from, to, ours] = ["from.tif", "to.tif", "ours.tif"].map(|name| folder.join(name));
    let grid = Grid { origin: Point2::new(0.5, 0.5), resolution: 2.5, nx: 300, ny: 280 };
    let heights = Raster::from_fn(grid, |ix, iy| (10 * iy + ix) as f32 / 8.0 - 4600.0);
    let local = geotiff::write_layers(&grid, &[("height_m", &heights)], &Placement::default());
    std::fs::write(&from, local.unwrap()).unwrap();
    let mut names = Vec::new();
    let mut systems = Vec::new();
    for srs in [
        "+proj=eqc +lat_ts=0 +lat_0=0 +lon_0=0 +x_0=0 +y_0=0 +R=1737400 +units=m +no_defs",
        "+proj=eqc +lat_ts=5 +lat_0=0 +lon_0=180 +x_0=0 +y_0=0 +R=3396190 +units=m +no_defs",
        "+proj=stere +lat_0=-90 +lon_0=0 +k=1 +x_0=0 +y_0=0 +a=3396190 +b=3376200 +units=m +no_defs",
        "+proj=sinu +lon_0=137 +x_0=0 +y_0=0 +R=3396190 +units=m +no_defs",
        "EPSG:32633",
    ] {
        let corner = ["-a_ullr", "-30000", "-1999300", "-29250", "-2000000"];
        let mut arguments = vec!["-q", "-a_srs", srs];
        arguments.extend(corner);
        arguments.extend([from.to_str().unwrap(), to.to_str().unwrap()]);
        run("gdal_translate", &arguments);
        let read = geotiff::read(&std::fs::read(&to).unwrap(), &Default::default()).unwrap();
        // Over whatever is done to a map its frame stays known.
        let shifted = read.translated(nalgebra::Vector3::new(3.0, -4.0, 50.0));
        let kept =
            shifted.cropped(Point2::origin() + nalgebra::Vector2::new(3.0, -4.0), 400.0).unwrap();
        let info = gdal_info(&to);
        for (map, is_whole) in [(&shifted, true), (&kept, false)] {
            let (layers, place) = ([("height_m", map.heights())], map.placement());
            std::fs::write(&ours, geotiff::write_layers(map.grid(), &layers, place).unwrap())
                .unwrap();
            let found = gdal_info(&ours);
            assert_eq!(found["coordinateSystem"]["wkt"], info["coordinateSystem"]["wkt"], "{srs}");
            if is_whole {
                for (a, b) in corners(&found).iter().zip(corners(&info)) {
                    assert!((a - b).abs() < 1e-6, "{srs}: {a}, not {b}");
                }
                let (a, b) = (gdal_band(&ours, 1, &folder), gdal_band(&to, 1, &folder));
                // Float32 of 5000 m, twice.
                assert!(a.iter().zip(&b).all(|(a, b)| (a - b).abs() < 2e-3), "{srs}");
            }
            // And we read what we wrote.
            let again = geotiff::read(&std::fs::read(&ours).unwrap(), &Default::default()).unwrap();
            assert_eq!(again.placement().system, map.placement().system, "{srs}");
        }
        // The part lies where it did: the height of a place of the source in both.
        let at = |file: &Path| {
            let file = file.to_str().unwrap();
            run("gdallocationinfo", &["-valonly", "-geoloc", file, "-29600", "-1999700"])
        };
        let [a, b] = [at(&ours), at(&to)].map(|z| z.trim().parse::<f64>().unwrap());
        assert!((a - b).abs() < 2e-3, "{srs}: {a}, not {b}");
        let system = read.placement().system.clone().unwrap();
        names.push(system.name().to_owned());
        systems.push(system);
        // A picture and classes of it have it too.
        let bytes = vec![7; kept.grid().len()];
        let picture =
            geotiff::write_picture(kept.grid(), &bytes, &bytes, kept.placement()).unwrap();
        let classes = Raster::new(*kept.grid(), bytes).unwrap();
        let classes =
            geotiff::write_classes(&classes, "class", &[[0; 3]; 8], kept.placement()).unwrap();
        for file in [picture, classes] {
            std::fs::write(&ours, file).unwrap();
            let found = gdal_info(&ours);
            assert_eq!(found["coordinateSystem"]["wkt"], info["coordinateSystem"]["wkt"], "{srs}");
            let inside =
                corners(&found).iter().zip(corners(&info)).all(|(a, b)| (a - b).abs() < 500.0);
            assert!(inside, "{srs}");
        }
    }
    for (i, a) in systems.iter().enumerate() {
        for (k, b) in systems.iter().enumerate() {
            assert_eq!(a.differs_from(b).is_none(), i == k || open(i, k), "{i}, {k}");
        }
    }
    assert!(names.iter().all(|name| !name.is_empty()), "{names:?}");
    // A map of no system is in no system.
    let plain = geotiff::read(&std::fs::read(&from).unwrap(), &Default::default()).unwrap();
    assert_eq!(plain.placement().system, None);
    assert_eq!(ElevationMap::plane(2.0, 0.5).unwrap().placement(), &Placement::default());
    std::fs::remove_dir_all(folder).unwrap();
}

/// May two of the systems not be told apart? The last is a code alone, which may stand for any of the others.
fn open(i: usize, k: usize) -> bool {
    i == 4 || k == 4
}

fn corners(info: &serde_json::Value) -> Vec<f64> {
    let corner = |name: &str| info["cornerCoordinates"][name].as_array().unwrap().clone();
    let all = ["upperLeft", "lowerRight"].into_iter().flat_map(corner);
    all.map(|v| v.as_f64().unwrap()).collect()
}

#[test]
fn pds3_samples_are_those_that_gdal_reads() {
    if !is_installed("pds3_samples", "gdal_translate") {
        return;
    }
    let folder = folder("pds3");
    let samples = ["pds3_1band.IMG", "pds3_1band_float.IMG", "pds3_3bands.IMG"];
    for name in samples {
        let Some(path) = shared_data_path("pds3", &format!("pds3_samples/{name}")) else { return };
        let bytes = std::fs::read(&path).unwrap();
        let mut source = bytes.as_slice();
        let image = pds3::read_label(&mut source).unwrap();
        for band in 0..image.bands {
            let ours = image.samples(&mut source, band, 0..image.ny, 0..image.nx).unwrap();
            assert_eq!(ours, gdal_band(&path, band + 1, &folder), "{name}, band {band}");
        }
    }
    std::fs::remove_dir_all(folder).unwrap();
}

#[test]
fn a_pds3_map_lies_where_gdal_puts_it() {
    if !is_installed("pds3_map", "gdalinfo") {
        return;
    }
    let folder = folder("pds3map");
    let label = "PDS_VERSION_ID = PDS3\r\nRECORD_TYPE = FIXED_LENGTH\r\nRECORD_BYTES = 512\r\n\
        FILE_RECORDS = 4\r\nLABEL_RECORDS = 3\r\n^IMAGE = 4\r\nOBJECT = IMAGE\r\nLINES = 5\r\n\
        LINE_SAMPLES = 6\r\nSAMPLE_TYPE = PC_REAL\r\nSAMPLE_BITS = 32\r\nEND_OBJECT = IMAGE\r\n\
        OBJECT = IMAGE_MAP_PROJECTION\r\nMAP_PROJECTION_TYPE = \"EQUIRECTANGULAR\"\r\n\
        A_AXIS_RADIUS = 1737.4 <KM>\r\nB_AXIS_RADIUS = 1737.4 <KM>\r\nC_AXIS_RADIUS = 1737.4 <KM>\r\n\
        CENTER_LATITUDE = 0.0 <DEG>\r\nCENTER_LONGITUDE = 0.0 <DEG>\r\nMAP_SCALE = 2.0 <METERS/PIXEL>\r\n\
        LINE_PROJECTION_OFFSET = 100.0 <PIXEL>\r\nSAMPLE_PROJECTION_OFFSET = -30.0 <PIXEL>\r\n\
        END_OBJECT = IMAGE_MAP_PROJECTION\r\nEND\r\n";
    let mut bytes = label.as_bytes().to_vec();
    bytes.resize(3 * 512, b' ');
    bytes.extend((0..30).flat_map(|i| (i as f32).to_le_bytes()));
    bytes.resize(4 * 512, 0);
    let file = folder.join("map.img");
    std::fs::write(&file, &bytes).unwrap();
    let info = run("gdalinfo", &["-json", file.to_str().unwrap()]);
    let info: serde_json::Value = serde_json::from_str(&info).unwrap();
    let corner: Vec<f64> =
        info["geoTransform"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
    let mut source = bytes.as_slice();
    let image = pds3::read_label(&mut source).unwrap();
    let map = pds3::read(&image, &mut source, &Default::default()).unwrap();
    let upper_left = map.grid().position(0, 4);
    assert_eq!(corner[1], map.grid().resolution);
    // GDAL tells the pixel's corner, we its center.
    assert!((corner[0] + 1.0 - upper_left.x).abs() < 1e-9, "{corner:?}, {upper_left}");
    assert!((corner[3] - 1.0 - upper_left.y).abs() < 1e-9, "{corner:?}, {upper_left}");
    std::fs::remove_dir_all(folder).unwrap();
}

#[test]
fn planetary_planes_that_gdal_writes_are_read_where_they_lie_and_degrees_are_refused() {
    if !is_installed("planetary_planes", "gdal_translate") {
        return;
    }
    let folder = folder("planets");
    let grid = Grid { origin: Point2::new(0.5, 0.5), resolution: 1.0, nx: 8, ny: 6 };
    let heights = Raster::from_fn(grid, |ix, iy| (10 * iy + ix) as f32);
    let (from, to) = (folder.join("from.tif"), folder.join("to.tif"));
    std::fs::write(
        &from,
        geotiff::write_layers(&grid, &[("height_m", &heights)], &Placement::default()).unwrap(),
    )
    .unwrap();
    let translate = |srs: &str, corners: [&str; 4]| {
        let mut arguments = vec!["-q", "-a_srs", srs, "-a_ullr"];
        arguments.extend(corners);
        arguments.extend([from.to_str().unwrap(), to.to_str().unwrap()]);
        run("gdal_translate", &arguments);
        geotiff::read(&std::fs::read(&to).unwrap(), &Default::default())
    };
    let far = ["-30000", "-1999994", "-29992", "-2000000"];
    for srs in [
        // Moon and Mars as spheres: equirectangular, and stereographic about the poles.
        "+proj=eqc +lat_ts=0 +lat_0=0 +lon_0=0 +x_0=0 +y_0=0 +R=1737400 +units=m +no_defs",
        "+proj=stere +lat_0=-90 +lon_0=0 +k=1 +x_0=0 +y_0=0 +R=1737400 +units=m +no_defs",
        "+proj=stere +lat_0=90 +lon_0=0 +k=1 +x_0=0 +y_0=0 +R=1737400 +units=m +no_defs",
        "+proj=eqc +lat_ts=5 +lat_0=0 +lon_0=180 +x_0=0 +y_0=0 +R=3396190 +units=m +no_defs",
        "+proj=stere +lat_0=-90 +lon_0=0 +k=1 +x_0=0 +y_0=0 +a=3396190 +b=3376200 +units=m +no_defs",
    ] {
        let map = translate(srs, far).unwrap_or_else(|e| panic!("{srs}: {e}"));
        assert_eq!((map.grid().nx, map.grid().ny, map.grid().resolution), (8, 6, 1.0), "{srs}");
        // The middle of the lower left pixel in the coordinates of the file, and its height.
        let corner = map.grid().origin + map.frame_offset().xy();
        assert!((corner - Point2::new(-29999.5, -1999999.5)).norm() < 1e-6, "{srs}: {corner}");
        let z = f64::from(*map.heights().at(3, 2)) + map.frame_offset().z;
        assert!((z - 23.0).abs() < 1e-5, "{srs}: {z}");
    }
    for srs in ["+proj=longlat +R=1737400 +no_defs", "+proj=longlat +a=3396190 +b=3376200 +no_defs"]
    {
        let refused = translate(srs, ["10.0", "-5.0", "10.008", "-5.006"]).unwrap_err().to_string();
        assert!(refused.contains("degrees") && refused.contains("project it"), "{srs}: {refused}");
    }
    let feet = "+proj=eqc +lat_ts=0 +lat_0=0 +lon_0=0 +R=1737400 +units=us-ft +no_defs";
    let refused = translate(feet, far).unwrap_err().to_string();
    assert!(refused.contains("linear"), "{refused}");
    std::fs::remove_dir_all(folder).unwrap();
}
