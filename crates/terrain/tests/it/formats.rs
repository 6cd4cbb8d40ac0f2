//! Files that are good, and files that are refused by name.

use geometry::{Grid, Raster};
use geotiff_reader::GeoTiffFile;
use nalgebra::{Point2, Vector3};
use terrain::formats::{Crop, CropCenter, ReadOptions, geotiff, off, read_named};
use terrain::{ElevationMap, Placement, SourceKind, TerrainError};

use crate::tiff::Tiff;

/// 3 columns, 2 rows; the northern row is 1, 2, 3.
fn small() -> Tiff {
    Tiff::new(3, &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
}

fn read(tiff: &Tiff) -> Result<ElevationMap, TerrainError> {
    geotiff::read(&tiff.bytes(), &ReadOptions::default())
}

#[test]
fn a_geotiffs_values_lie_at_its_pixel_centers_with_north_up() {
    let map = read(&small()).unwrap();
    // Upper left corner (100, 200), pixels of 2 m: the lower left pixel's center is (101, 197).
    assert_eq!(
        *map.grid(),
        Grid { origin: Point2::new(101.0, 197.0), resolution: 2.0, nx: 3, ny: 2 }
    );
    assert_eq!(map.heights().values(), [4.0, 5.0, 6.0, 1.0, 2.0, 3.0]);
    assert_eq!(map.frame_offset(), Vector3::zeros());
}

#[test]
fn pixel_is_point_means_that_the_tie_point_is_a_pixels_center() {
    let mut tiff = small();
    tiff.keys[1] = (1025, 2);
    assert_eq!(read(&tiff).unwrap().grid().origin, Point2::new(100.0, 198.0));
}

#[test]
fn a_transformation_matrix_does_as_well_as_a_scale_and_a_tie_point() {
    let mut tiff = small();
    (tiff.pixel_scale, tiff.tie_point) = (None, None);
    let mut matrix = vec![0.0; 16];
    (matrix[0], matrix[3], matrix[5], matrix[7], matrix[15]) = (2.0, 100.0, -2.0, 200.0, 1.0);
    tiff.transformation = Some(matrix.clone());
    assert_eq!(read(&tiff).unwrap().grid().origin, Point2::new(101.0, 197.0));
    matrix[1] = 0.1;
    tiff.transformation = Some(matrix);
    assert!(matches!(read(&tiff), Err(TerrainError::TiffRotated { .. })));
}

#[test]
fn nodata_is_unknown_whether_a_number_or_nan() {
    for (nodata, value) in
        [("-9999", -9999.0), ("nan", f32::NAN), ("-3.4028234663852886e+38", f32::MIN)]
    {
        let mut tiff = Tiff::new(3, &[1.0, value, 3.0, 4.0, 5.0, 6.0]);
        tiff.nodata = Some(nodata);
        let map = read(&tiff).unwrap();
        assert!(map.heights().at(1, 1).is_nan(), "{nodata}");
        assert_eq!(map.heights().values().iter().filter(|z| z.is_nan()).count(), 1);
    }
}

#[test]
fn int16_and_float64_heights_are_read_too() {
    let mut tiff = small();
    tiff.format = (2, 16);
    tiff.nodata = Some("-32768");
    let values = [1_i16, 2, 3, -32768, 5, 6];
    tiff.pixels = values.iter().flat_map(|z| z.to_le_bytes()).collect();
    let map = read(&tiff).unwrap();
    assert!(map.heights().at(0, 0).is_nan());
    assert_eq!(map.heights().values()[1..], [5.0, 6.0, 1.0, 2.0, 3.0]);

    tiff.format = (3, 64);
    tiff.nodata = None;
    let values = [1.5_f64, 2.0, 3.0, 4.0, 5.0, 6.0];
    tiff.pixels = values.iter().flat_map(|z| z.to_le_bytes()).collect();
    assert_eq!(*read(&tiff).unwrap().heights().at(0, 1), 1.5);
}

#[test]
fn far_maps_are_moved_to_a_local_frame_around_their_center() {
    let mut tiff = Tiff::new(
        3,
        &[-4455.25, -4455.0, -4455.0, -4455.0, -4454.5, -4455.0, -4455.0, -4455.0, -4454.0],
    );
    tiff.tie_point = Some(vec![0.0, 0.0, 0.0, 8_142_406.0, -276_455.0, 0.0]);
    let map = read(&tiff).unwrap();
    assert_eq!(map.frame_offset(), Vector3::new(8_142_409.0, -276_458.0, -4454.5));
    assert_eq!(map.grid().origin, Point2::new(-2.0, -2.0));
    assert_eq!(*map.heights().at(0, 2), -0.75);
    assert_eq!(map.height_at(Point2::origin()), Some(0.0));

    // Height alone is reason enough; where the center is unknown the median is level zero.
    let mut tiff =
        Tiff::new(3, &[1500.0, 1501.0, 1500.0, 1502.0, f32::NAN, 1499.0, 1501.0, 1501.0, 1503.0]);
    tiff.nodata = Some("nan");
    assert_eq!(read(&tiff).unwrap().frame_offset(), Vector3::new(103.0, 197.0, 1501.0));
}

#[test]
fn a_crop_reads_that_part_alone_even_of_a_file_that_is_too_large() {
    let rows: Vec<f32> = (0..100).map(|i| i as f32).collect();
    let bytes = Tiff::new(10, &rows).bytes();
    let center = CropCenter::Meters(Point2::new(4.0, 2.0));
    let crop = Some(Crop { center, width_m: 4.0 });
    let map = geotiff::read(&bytes, &ReadOptions { crop, max_nodes: 9, ..ReadOptions::default() })
        .unwrap();
    // Nodes 1..=3 of each row, from the lowest row (90 ..) up.
    assert_eq!(map.heights().values(), [91., 92., 93., 81., 82., 83., 71., 72., 73.]);
    assert_eq!(map.grid().origin, Point2::new(103.0, 181.0));

    let center = CropCenter::Fraction(Point2::new(1.0, 1.0));
    let crop = Some(Crop { center, width_m: 2.0 });
    let corner =
        geotiff::read(&bytes, &ReadOptions { crop, max_nodes: 9, ..ReadOptions::default() });
    assert!(matches!(corner, Err(TerrainError::CropTooSmall { nx: 1, ny: 1, .. })), "{corner:?}");

    let whole = geotiff::read(&bytes, &ReadOptions { max_nodes: 99, ..ReadOptions::default() });
    assert_eq!(whole.unwrap_err(), TerrainError::TooManyNodes { n_nodes: 100, max_nodes: 99 });
}

#[test]
fn unusable_geotiffs_are_refused_by_name() {
    type Change = fn(&mut Tiff);
    let cases: [(&str, Change, &str); 17] = [
        ("degrees", |t| t.keys = vec![(1024, 2), (1025, 1)], "geographic"),
        ("geocentric", |t| t.keys[0] = (1024, 3), "geocentric"),
        ("feet", |t| t.keys[3] = (3076, 9002), "linear unit code 9002"),
        ("vertical feet", |t| t.keys.push((4099, 9003)), "vertical unit code 9003"),
        ("own unit", |t| t.keys[3] = (3076, 32767), "linear unit code 32767"),
        ("no scale", |t| t.pixel_scale = None, "no pixel scale"),
        ("no tie", |t| t.tie_point = None, "no tie point"),
        ("zero scale", |t| t.pixel_scale = Some(vec![0.0, 0.0, 0.0]), "geotiff"),
        ("nan scale", |t| t.pixel_scale = Some(vec![f64::NAN, 2.0, 0.0]), "geotiff"),
        ("infinite scale", |t| t.pixel_scale = Some(vec![f64::INFINITY; 3]), "geotiff"),
        ("nan tie", |t| t.tie_point = Some(vec![0., 0., 0., f64::NAN, 0., 0.]), "geotiff"),
        ("oblong", |t| t.pixel_scale = Some(vec![2.0, 2.1, 0.0]), "pixels are 2 x 2.1 m"),
        ("bands", |t| (t.bands, t.width) = (3, 1), "3 bands"),
        ("bytes", |t| t.format = (1, 8), "samples are uint8"),
        ("all nodata", |t| t.pixels = f32::NAN.to_le_bytes().repeat(6), "known height"),
        ("no nodata", |t| t.pixels[..4].copy_from_slice(&f32::MIN.to_le_bytes()), "nodata value"),
        (
            "scaled",
            |t| {
                t.gdal_metadata = Some(
                    "<GDALMetadata><Item name=\"SCALE\" sample=\"0\" role=\"scale\">0.1</Item>\
                     </GDALMetadata>",
                )
            },
            "scale \"0.1\"",
        ),
    ];
    for (name, change, expected) in cases {
        let mut tiff = small();
        change(&mut tiff);
        let refused = read(&tiff).expect_err(name).to_string();
        assert!(refused.contains(expected), "{name}: {refused}");
    }
}

#[test]
fn a_geotiff_that_claims_more_pixels_than_allowed_is_refused_before_they_are_decoded() {
    let mut tiff = small();
    (tiff.width, tiff.height) = (60_000, 60_000);
    let n_nodes = 3_600_000_000;
    let expected = TerrainError::TooManyNodes { n_nodes, max_nodes: 64_000_000 };
    assert_eq!(read(&tiff).unwrap_err(), expected);
    (tiff.width, tiff.height) = (7_000, 7_000);
    assert!(matches!(read(&tiff), Err(TerrainError::TiffUnreadable { .. })), "24 bytes of data");
}

#[test]
fn written_layers_come_back_with_their_names_and_places() {
    let grid = Grid { origin: Point2::new(-3.5, 12.25), resolution: 0.25, nx: 150, ny: 131 };
    let first = Raster::from_fn(grid, |ix, iy| (ix as f32).sin() * iy as f32);
    let second = Raster::from_fn(grid, |ix, iy| if ix == iy { f32::NAN } else { ix as f32 });
    let bytes = geotiff::write_layers(
        &grid,
        &[("height_m", &first), ("sigma_m", &second)],
        &Placement::default(),
    )
    .unwrap();
    let file = GeoTiffFile::from_bytes(bytes.clone()).unwrap();
    assert_eq!((file.band_count(), file.width(), file.height()), (2, 150, 131));
    // The center of the upper left pixel is the last row's first node.
    let top_left = file.pixel_to_geo(0.5, 0.5).unwrap();
    assert_eq!(top_left, (-3.5, 12.25 + 0.25 * 130.0));
    assert_eq!(file.nodata(), Some("nan"));
    for (band, layer) in [&first, &second].into_iter().enumerate() {
        let values = file.read_band::<f32>(band).unwrap();
        for iy in 0..131 {
            for ix in 0..150 {
                let (found, expected) = (values[[130 - iy, ix]], *layer.at(ix, iy));
                assert_eq!(found.to_bits(), expected.to_bits());
            }
        }
    }
    let metadata = file.tiff().ifd(0).unwrap().tag(42112).unwrap().value.as_str().unwrap();
    assert!(metadata.contains("sample=\"0\" role=\"description\">height_m<"), "{metadata}");
    assert!(metadata.contains("sample=\"1\" role=\"description\">sigma_m<"));
    let bands = geotiff::read(&bytes, &ReadOptions::default()).unwrap_err();
    assert_eq!(bands, TerrainError::TiffBands { n_bands: 2 });
}

#[test]
fn a_written_height_layer_is_read_as_the_same_map() {
    let grid = Grid { origin: Point2::new(-1.0, -2.0), resolution: 0.1, nx: 33, ny: 70 };
    let heights = Raster::from_fn(grid, |ix, iy| (ix * iy) as f32 * 0.001);
    let bytes =
        geotiff::write_layers(&grid, &[("height_m", &heights)], &Placement::default()).unwrap();
    let map = read_named("Map.TIF", &bytes, &ReadOptions::default()).unwrap();
    assert_eq!(map.heights().values(), heights.values());
    assert!((map.grid().origin - grid.origin).norm() < 1e-12);
    assert_eq!(map.source().kind, SourceKind::File { name: "Map.TIF".into() });
    assert!(!map.source().synthetic_detail);
}

#[test]
fn layers_of_another_grid_or_none_at_all_are_not_written() {
    let grid = Grid { origin: Point2::origin(), resolution: 1.0, nx: 3, ny: 3 };
    let other = Raster::from_fn(Grid { nx: 4, ..grid }, |_, _| 0.0);
    let own = Raster::from_fn(grid, |_, _| 0.0);
    // GDAL cuts such a name off, however it is escaped.
    for layers in [&[][..], &[("a", &other)], &[("a < b & c", &own)]] {
        let refused = geotiff::write_layers(&grid, layers, &Placement::default());
        assert!(matches!(refused, Err(TerrainError::TiffWrite { .. })), "{refused:?}");
    }
}

#[test]
fn other_files_are_refused_with_the_names_of_those_that_are_read() {
    for name in ["dem.xyz", "tif", "", "dem.tif.zip"] {
        let refused = read_named(name, b"", &ReadOptions::default()).unwrap_err();
        assert_eq!(refused, TerrainError::UnknownFormat { file_name: name.into() });
        assert!(refused.to_string().contains("use .tif, .img, .lbl, .off, .obj, .ply or .png"));
    }
}

#[test]
fn an_off_crop_is_in_meters_from_its_corner() {
    let mut text = "OFF\n25 16 0\n".to_owned();
    (0..25).for_each(|i| text += &format!("{} {} {i}\n", i % 5 + 7, i / 5 + 7));
    for i in 0..16 {
        let a = i % 4 + 5 * (i / 4);
        text += &format!("4 {a} {} {} {}\n", a + 1, a + 6, a + 5);
    }
    let center = CropCenter::Meters(Point2::new(1.0, 2.0));
    let crop = Some(Crop { center, width_m: 2.0 });
    let map = read_named(
        "a.off",
        text.as_bytes(),
        &ReadOptions { crop, max_nodes: 99, ..ReadOptions::default() },
    )
    .unwrap();
    assert_eq!(map.grid().origin, Point2::new(7.0, 8.0));
    assert_eq!(map.heights().values(), [5., 6., 7., 10., 11., 12., 15., 16., 17.]);
    assert!(off::read(text.as_bytes(), 24).is_err());
}
