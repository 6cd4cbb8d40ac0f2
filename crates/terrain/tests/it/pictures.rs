//! Pictures over ground: what GDAL reads of ours, and what we read of others.

use geometry::{Grid, Raster};
use nalgebra::Point2;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use terrain::formats::geotiff::{GeoTiffFile, write_classes, write_picture};
use terrain::formats::picture::{self, Picture};
use terrain::{Placement, TerrainError};
use testkit::is_installed;

use crate::gdal::{folder, gdal_band, run};
use crate::tiff::Tiff;

/// A file of 4 x 3 pixels of 2 m, upper left corner at (100, 200): middles at x 101 to 107, y 195 to 199.
fn tiff(bands: u16, format: (u16, u16), pixels: Vec<u8>) -> Tiff {
    Tiff { bands, format, pixels, height: 3, ..Tiff::new(4, &[0.0; 12]) }
}

fn read(tiff: &Tiff, low: [f64; 2], high: [f64; 2]) -> Result<Picture, TerrainError> {
    let file = GeoTiffFile::from_bytes(tiff.bytes())?;
    picture::read(&file, low.into(), high.into(), 1000)
}

fn all(tiff: &Tiff) -> Result<Picture, TerrainError> {
    read(tiff, [0.0, 0.0], [1000.0, 1000.0])
}

#[test]
fn bytes_are_taken_as_they_are_at_their_place() {
    let gray = tiff(1, (1, 8), (0..12).map(|i| 20 * i).collect());
    let whole = all(&gray).unwrap();
    assert_eq!(
        whole.grid,
        Grid { origin: Point2::new(101.0, 195.0), resolution: 2.0, nx: 4, ny: 3 }
    );
    assert!(whole.is_gray && whole.stretch.is_none());
    // The last row of the file is that of the least y.
    assert_eq!(whole.rgba[..2], [[160, 160, 160, 255], [180, 180, 180, 255]]);
    assert_eq!(whole.rgba[11], [60, 60, 60, 255]);
    let part = read(&gray, [102.9, 196.0], [105.1, 198.0]).unwrap();
    assert_eq!(part.grid.origin, Point2::new(103.0, 197.0));
    assert_eq!((part.grid.nx, part.grid.ny), (2, 1));
    assert_eq!(part.rgba, [[100, 100, 100, 255], [120, 120, 120, 255]]);
    let color: Vec<u8> = (0..12).flat_map(|i| [i, 100 + i, 200 + i]).collect();
    let color = all(&tiff(3, (1, 8), color)).unwrap();
    assert!(!color.is_gray);
    assert_eq!(color.rgba[0], [8, 108, 208, 255]);
    let clear: Vec<u8> = (0..12).flat_map(|i| [i, 100 + i, 200 + i, 20 * i]).collect();
    let clear = all(&tiff(4, (1, 8), clear)).unwrap();
    assert_eq!(clear.rgba[0], [8, 108, 208, 160]);
    assert_eq!(clear.rgba[8], [0; 4], "what is transparent has no color");
}

#[test]
fn other_samples_are_stretched_and_nodata_stays_transparent() {
    let values: [f32; 12] = [-9999.0, 2.0, f32::NAN, 4.0, 0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 10.0];
    let mut floats = tiff(1, (3, 32), values.iter().flat_map(|v| v.to_le_bytes()).collect());
    floats.nodata = Some("-9999");
    let picture = all(&floats).unwrap();
    assert_eq!(picture.stretch, Some([0.0, 10.0]));
    assert_eq!(picture.rgba[8], [0; 4], "nodata");
    assert_eq!(picture.rgba[10], [0; 4], "NaN");
    // 4, 5, 6, 10 of 10: 102, 127.5, 153, 255.
    let row: Vec<u8> = picture.rgba[..4].iter().map(|texel| texel[0]).collect();
    assert_eq!(row, [102, 128, 153, 255]);
    let ends = [f32::MIN, f32::MAX];
    let wide: Vec<u8> = (0..12).flat_map(|i| ends[i % 2].to_le_bytes()).collect();
    let wide = all(&tiff(1, (3, 32), wide)).unwrap();
    assert_eq!([wide.rgba[0][0], wide.rgba[1][0]], [0, 255]);
    let shorts: Vec<u8> = (0..12_u16).flat_map(|i| (1000 + 100 * i).to_le_bytes()).collect();
    let shorts = all(&tiff(1, (1, 16), shorts)).unwrap();
    assert_eq!(shorts.stretch, Some([1000.0, 2100.0]));
    let flat = all(&tiff(1, (1, 16), [7, 0].repeat(12))).unwrap();
    assert!(flat.rgba.iter().all(|texel| *texel == [128, 128, 128, 255]));
}

#[test]
fn what_is_no_picture_of_this_ground_is_refused_by_name() {
    let good = || tiff(1, (1, 8), vec![9; 12]);
    let refused = |tiff: &Tiff| all(tiff).unwrap_err().to_string();
    let elsewhere = read(&good(), [0.0, 0.0], [50.0, 50.0]).unwrap_err();
    assert!(matches!(elsewhere, TerrainError::PictureElsewhere { .. }), "{elsewhere}");
    assert!(elsewhere.to_string().contains("(101.0, 195.0)"), "{elsewhere}");
    let mut degrees = good();
    degrees.keys = vec![(1024, 2), (1025, 1), (2048, 4326)];
    assert!(refused(&degrees).contains("degrees"));
    let mut feet = good();
    feet.keys = vec![(1024, 1), (1025, 1), (3076, 9002)];
    assert!(refused(&feet).contains("9002"));
    assert!(refused(&tiff(5, (1, 8), vec![9; 60])).contains("5 bands"));
    assert!(refused(&tiff(1, (2, 16), vec![9; 24])).contains("int16"));
    assert!(refused(&tiff(1, (3, 64), vec![0; 96])).contains("float64"));
    let mut turned = good();
    (turned.pixel_scale, turned.tie_point) = (None, None);
    let (c, s) = (2.0, 0.5);
    turned.transformation =
        Some(vec![c, s, 0.0, 100.0, s, -c, 0.0, 200.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]);
    assert!(matches!(all(&turned), Err(TerrainError::TiffRotated { .. })));
    let file = GeoTiffFile::from_bytes(good().bytes()).unwrap();
    let many = picture::read(&file, Point2::origin(), Point2::new(1e3, 1e3), 11);
    assert!(matches!(many, Err(TerrainError::TooManyNodes { n_nodes: 12, .. })));
}

#[test]
fn gdal_reads_our_pictures_and_classes_value_for_value() {
    if !is_installed("gdal_reads_our_pictures", "gdalinfo") {
        return;
    }
    let folder = folder("pictures");
    let file = folder.join("a.tif");
    let name = file.to_str().unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    for (nx, ny) in [(600, 310), (256, 256), (1, 1), (257, 30)] {
        let grid = Grid { origin: Point2::new(-3.0, 7.5), resolution: 0.02, nx, ny };
        let alpha: Vec<u8> =
            (0..nx * ny).map(|_| if rng.random::<f64>() < 0.3 { 0 } else { 255 }).collect();
        let gray: Vec<u8> = alpha.iter().map(|a| if *a == 0 { 0 } else { rng.random() }).collect();
        std::fs::write(&file, write_picture(&grid, &gray, &alpha, &Placement::default()).unwrap())
            .unwrap();
        let info: serde_json::Value =
            serde_json::from_str(&run("gdalinfo", &["-json", name])).unwrap();
        assert_eq!(info["metadata"]["IMAGE_STRUCTURE"]["LAYOUT"], "COG", "{info}");
        assert_eq!(info["bands"][0]["type"], "Byte");
        assert_eq!(info["bands"][0]["colorInterpretation"], "Gray");
        assert_eq!(info["bands"][1]["colorInterpretation"], "Alpha");
        let transform = info["geoTransform"].as_array().unwrap();
        let expected = [-3.01, 0.02, 0.0, 7.5 + 0.02 * (ny as f64 - 0.5), 0.0, -0.02];
        for (found, expected) in transform.iter().zip(expected) {
            assert!((found.as_f64().unwrap() - expected).abs() < 1e-9, "{transform:?}");
        }
        for (band, values) in [(1, &gray), (2, &alpha)] {
            let found = gdal_band(&file, band, &folder);
            let north_up = values.chunks_exact(nx).rev().flatten().map(|v| f64::from(*v));
            assert!(found.into_iter().eq(north_up), "band {band} of {nx} x {ny}");
        }
        // We read it as well.
        let bytes = std::fs::read(&file).unwrap();
        let far = grid.far_corner() + nalgebra::Vector2::repeat(1e-6);
        let near = grid.origin - nalgebra::Vector2::repeat(1e-6);
        if nx > 1 {
            let ours = GeoTiffFile::from_bytes(bytes).unwrap();
            let again = picture::read(&ours, near, far, 1 << 20).unwrap();
            let same = |(texel, (g, a)): (&[u8; 4], (&u8, &u8))| *texel == [*g, *g, *g, *a];
            assert!(again.rgba.iter().zip(gray.iter().zip(&alpha)).all(same));
        }
        let classes = Raster::from_fn(grid, |ix, iy| ((ix / 5 + iy / 3) % 4) as u8);
        let colors = [[0; 3], [200, 66, 52], [217, 178, 74], [79, 174, 138]];
        std::fs::write(
            &file,
            write_classes(&classes, "class", &colors, &Placement::default()).unwrap(),
        )
        .unwrap();
        let info: serde_json::Value =
            serde_json::from_str(&run("gdalinfo", &["-json", name])).unwrap();
        assert_eq!(info["metadata"]["IMAGE_STRUCTURE"]["LAYOUT"], "COG", "{info}");
        let band = &info["bands"][0];
        assert_eq!(
            (&band["type"], &band["colorInterpretation"]),
            (&"Byte".into(), &"Palette".into())
        );
        assert_eq!(band["noDataValue"].as_f64(), Some(0.0));
        let entries = &band["colorTable"]["entries"];
        assert_eq!(entries[1], serde_json::json!([200, 66, 52, 255]));
        let found = gdal_band(&file, 1, &folder);
        let north_up = classes.values().chunks_exact(nx).rev().flatten().map(|v| f64::from(*v));
        assert!(found.into_iter().eq(north_up), "classes of {nx} x {ny}");
        // What GDAL takes for a palette is refused as an overlay, in words.
        if nx > 1 {
            let ours = GeoTiffFile::open(&file).unwrap();
            let refused = picture::read(&ours, near, far, 1 << 20).unwrap_err().to_string();
            assert!(refused.contains("palette"), "{refused}");
        }
    }
    std::fs::remove_dir_all(folder).unwrap();
}
