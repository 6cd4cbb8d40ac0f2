//! A window of a GeoTIFF that would not fit the memory as a whole.

use nalgebra::Point2;
use terrain::TerrainError;
use terrain::formats::{Crop, CropCenter, ReadOptions, geotiff};

const N: u32 = 16_384;

/// N x N pixels of 0.5 m whose rows are all one and the same row of the file: heights 0.25 column.
fn tiff() -> Vec<u8> {
    let n_entries = 13_u32;
    let row_at = 8_u32;
    let ifd_at = row_at + 4 * N;
    let mut data_at = ifd_at + 2 + 12 * n_entries + 4;
    let mut data = Vec::new();
    let mut entries = Vec::new();
    let mut entry = |tag: u16, kind: u16, count: u32, value: Vec<u8>| {
        entries.extend(tag.to_le_bytes());
        entries.extend(kind.to_le_bytes());
        entries.extend(count.to_le_bytes());
        if value.len() <= 4 {
            entries.extend(value.iter().copied().chain([0; 4]).take(4));
        } else {
            entries.extend(data_at.to_le_bytes());
            data_at += value.len() as u32;
            data.extend(value);
        }
    };
    let longs = |value: u32| value.to_le_bytes().repeat(N as usize);
    let doubles = |values: &[f64]| values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
    let shorts = |values: &[u16]| values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
    entry(256, 4, 1, N.to_le_bytes().to_vec());
    entry(257, 4, 1, N.to_le_bytes().to_vec());
    entry(258, 3, 1, shorts(&[32]));
    entry(259, 3, 1, shorts(&[1]));
    entry(262, 3, 1, shorts(&[1]));
    entry(273, 4, N, longs(row_at));
    entry(277, 3, 1, shorts(&[1]));
    entry(278, 3, 1, shorts(&[1]));
    entry(279, 4, N, longs(4 * N));
    entry(339, 3, 1, shorts(&[3]));
    entry(33550, 12, 3, doubles(&[0.5, 0.5, 0.0]));
    entry(33922, 12, 6, doubles(&[0.0, 0.0, 0.0, -1000.25, 7192.25, 0.0]));
    entry(34735, 3, 12, shorts(&[1, 1, 0, 2, 1024, 0, 1, 1, 3076, 0, 1, 9001]));
    let mut bytes = b"II\x2a\0".to_vec();
    bytes.extend(ifd_at.to_le_bytes());
    bytes.extend((0..N).flat_map(|i| (0.25 * i as f32).to_le_bytes()));
    bytes.extend((n_entries as u16).to_le_bytes());
    bytes.extend(entries);
    bytes.extend([0; 4]);
    bytes.extend(data);
    bytes
}

#[test]
fn a_window_of_a_large_geotiff_is_read_without_the_rest() {
    let bytes = tiff();
    assert!(bytes.len() < 1 << 20, "a gigabyte of pixels in {} bytes", bytes.len());
    let center = CropCenter::Meters(Point2::new(1050.0, 2000.0));
    let crop = Some(Crop { center, width_m: 100.0 });
    let options = ReadOptions { crop, max_nodes: 50_000, ..ReadOptions::default() };
    let map = geotiff::read(&bytes, &options).unwrap();
    assert_eq!((map.grid().nx, map.grid().ny, map.grid().resolution), (201, 201, 0.5));
    // 1000 m from the first pixel's center, at x = -1000 m.
    assert!((map.grid().origin.x + map.frame_offset().x).abs() < 1e-9, "{:?}", map.grid());
    for (ix, column) in [(0, 2000), (100, 2100), (200, 2200)] {
        let z = f64::from(*map.heights().at(ix, 77)) + map.frame_offset().z;
        assert!((z - 0.25 * f64::from(column)).abs() < 1e-6, "{z}");
    }
    let whole = geotiff::read(&bytes, &ReadOptions::default());
    assert!(matches!(whole, Err(TerrainError::TooManyNodes { n_nodes: 268_435_456, .. })));
}
