//! OFF meshes good and bad, and files damaged at random: an answer or an error, never a panic.

use nalgebra::Point2;
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use terrain::formats::{ReadOptions, geotiff, off};
use terrain::{ElevationMap, TerrainError};

use crate::damage::{damaged, rounds};
use crate::tiff::Tiff;

const MAX: usize = 1_000_000;

/// 3 x 2 nodes 0.5 m apart, rows along x; heights 0 to 5.
const ROWS: &str = "OFF\n6 4 0\n0 0 0\n0.5 0 1\n1 0 2\n0 0.5 3\n0.5 0.5 4\n1 0.5 5\n\
                    3 0 1 3\n3 1 4 3\n3 1 2 4\n3 2 5 4\n";

fn read(text: &str) -> Result<ElevationMap, TerrainError> {
    off::read(text.as_bytes(), MAX)
}

#[test]
fn the_order_of_vertices_and_the_diagonal_do_not_matter() {
    // By columns; with falling x and y; with the other diagonals; with comments and quadrilaterals.
    let meshes = [
        ROWS,
        "OFF\n6 4 0\n0 0 0\n0 .5 3\n.5 0 1\n.5 .5 4\n1 0 2\n1 .5 5\n\
         3 0 2 1\n3 2 3 1\n3 2 4 3\n3 4 5 3\n",
        "OFF 6 4 0\n1 .5 5\n.5 .5 4\n0 .5 3\n1 0 2\n.5 0 1\n0 0 0\n\
         3 0 1 3\n3 1 4 3\n3 1 2 4\n3 2 5 4\n",
        "OFF\n6 4\n0 0 0\n.5 0 1\n1 0 2\n0 .5 3\n.5 .5 4\n1 .5 5\n\
         3 0 1 4\n3 0 4 3\n3 1 2 5\n3 1 5 4\n",
        "# a comment\n\nOFF # more\r\n6 2 0\r\n0 0 0\r\n.5 0 1\r\n1 0 2\r\n0 .5 3\r\n\
         .5 .5 4 # here\r\n1 .5 5\r\n4 0 1 4 3 255 0 0\r\n4 1 2 5 4\r\n",
    ];
    for mesh in meshes {
        let map = read(mesh).expect(mesh);
        assert_eq!((map.grid().nx, map.grid().ny, map.grid().resolution), (3, 2, 0.5));
        assert_eq!(map.grid().origin, Point2::origin());
        assert_eq!(map.heights().values(), [0.0, 1.0, 2.0, 3.0, 4.0, 5.0], "{mesh}");
    }
}

#[test]
fn a_vertex_without_faces_is_unknown() {
    let map = read(&ROWS.replace("6 4 0", "6 3 0").replace("3 2 5 4\n", "")).unwrap();
    assert!(map.heights().at(2, 1).is_nan());
    assert_eq!(map.height_at(Point2::new(0.6, 0.1)).map(|z| z > 0.0), Some(true));
    assert_eq!(map.height_at(Point2::new(0.95, 0.45)), None);
}

#[test]
fn unusable_meshes_are_refused_by_name() {
    let cases = [
        ("", "off line 1: expected `OFF`"),
        ("PLY\n", "expected `OFF`"),
        ("COFF\n1 1 1\n", "expected `OFF`"),
        ("OFF\n", "expected `OFF` and the counts"),
        ("OFF\n6\n", "expected `OFF` and the counts"),
        ("OFF\nx y z\n", "expected `OFF` and the counts"),
        ("OFF\n-6 4 0\n", "expected `OFF` and the counts"),
        ("OFF\n0 0 0\n", "0 vertices are fewer than 2 x 2"),
        ("OFF\n999999 4 0\n0 0 0\n", "of 999999 vertices: it is truncated"),
        ("OFF\n1000001 4 0\n", "1000001 nodes, more than the 1000000"),
        ("OFF\n18446744073709551615 4 0\n", "more than the 1000000"),
        ("OFF\n4 18446744073709551615 0\n", "faces: it is truncated"),
        ("OFF\n6 4 0\n0 0 0\n1 0 0\n", "vertices: it is truncated"),
    ];
    for (text, expected) in cases {
        let refused = read(text).expect_err(text).to_string();
        assert!(refused.contains(expected), "{text:?}: {refused}");
    }
    let changes = [
        ("1 0 2\n", "1 0\n", "line 5: \"\" is not a coordinate"),
        ("1 0 2\n", "1 zero 2\n", "line 5: \"zero\" is not a coordinate"),
        ("1 0 2\n", "1 0 2 9\n", "line 5: \"9\" is not the end"),
        ("1 0 2\n", "1 0 nan\n", "line 5: a coordinate is NaN"),
        ("1 0 2\n", "1 0 -inf\n", "line 5: a coordinate is -inf"),
        ("1 0 2\n", "1 0.1 2\n", "vertex 2 at (1, 0.1) is off its node"),
        ("1 0 2\n", "1.001 0 2\n", "vertex 2 at (1.001, 0) is off its node"),
        ("0.5 0 1\n", "0 0 1\n", "not a height field"),
        ("3 2 5 4\n", "3 2 6 4\n", "line 12: vertex index 6 is out of range (0..6)"),
        ("3 2 5 4\n", "3 2 5 3\n", "spans more than one square"),
        ("3 2 5 4\n", "3 2 5 5\n", "uses a vertex twice"),
        ("3 2 5 4\n", "2 2 5\n", "a face has 2 corners"),
        ("3 2 5 4\n", "5 2 5 4 1 0\n", "a face has 5 corners"),
        ("3 2 5 4\n", "3 2 5\n", "line 12: \"\" is not a vertex index"),
        ("3 2 5 4\n", "3 2 5 -4\n", "\"-4\" is not a vertex index"),
        ("3 2 5 4\n", "", "after 3 of 4 faces"),
        ("3 0 1 3\n3 1 4 3\n", "3 0 1 3\n3 0 1 3\n", "hole at square (0, 0)"),
    ];
    for (from, to, expected) in changes {
        let text = ROWS.replace(from, to);
        assert_ne!(text, ROWS, "{from:?}");
        let refused = read(&text).expect_err(&text).to_string();
        assert!(refused.contains(expected), "{to:?}: {refused}");
    }
    let oblong = ROWS.replace("0.5 3", "0.6 3").replace("0.5 4", "0.6 4").replace("0.5 5", "0.6 5");
    assert!(read(&oblong).unwrap_err().to_string().contains("not square"));
    assert_eq!(read(&ROWS.replace("4 0\n", "0 0\n")).unwrap_err(), TerrainError::NoKnownHeight);
    assert!(off::read(b"\xff\xfe\x00", MAX).is_err());
}

#[test]
fn damaged_meshes_give_a_map_or_an_error() {
    let mut rng = ChaCha8Rng::seed_from_u64(17);
    let pieces =
        ["nan", "1e308", "-1", "18446744073709551615", "#", "OFF", "\n", " ", "3 0 0 0", "1e-320"];
    let mut n_good = 0;
    let n = rounds(6000);
    for _ in 0..n {
        let bytes = damaged(&mut rng, ROWS.as_bytes(), usize::MAX, &pieces);
        n_good += usize::from(off::read(&bytes, MAX).is_ok());
    }
    assert!(2 * n_good < n, "most damage is seen: {n_good} of {n} read");
}

#[test]
fn a_mesh_cut_anywhere_before_its_last_number_is_refused() {
    for len in 0..ROWS.len() - 2 {
        assert!(read(&ROWS[..len]).is_err(), "{len}");
    }
}

#[test]
fn damaged_geotiffs_give_a_map_or_an_error() {
    let mut rng = ChaCha8Rng::seed_from_u64(19);
    let rows: Vec<f32> = (0..64).map(|i| i as f32 * 0.1).collect();
    let mut tiff = Tiff::new(8, &rows);
    tiff.nodata = Some("-9999");
    let good = tiff.bytes();
    assert!(geotiff::read(&good, &ReadOptions::default()).is_ok());
    let options = ReadOptions { max_nodes: MAX, ..ReadOptions::default() };
    let tags_at = 8 + 4 * rows.len();
    for i in 0..rounds(3000) {
        let mut bytes = good.clone();
        for _ in 0..rng.random_range(1..4) {
            // Two of three hits go to the tags, where damage matters.
            let from = if i % 3 == 0 { 0 } else { tags_at };
            let at = rng.random_range(from..bytes.len());
            match rng.random_range(0..8) {
                0 => bytes.truncate(at.max(1)),
                1 => bytes[at] ^= 1 << rng.random_range(0..8),
                _ => bytes[at] = rng.next_u32() as u8,
            }
            if bytes.len() <= tags_at {
                break;
            }
        }
        drop(geotiff::read(&bytes, &options));
    }
    for len in 0..good.len() {
        drop(geotiff::read(&good[..len], &options));
    }
    let mut noise = vec![0; 4096];
    for _ in 0..100 {
        rng.fill_bytes(&mut noise);
        noise[..4].copy_from_slice(b"II\x2a\0");
        drop(geotiff::read(&noise, &options));
        let cut = geotiff::read(&noise[..rng.random_range(0..64)], &options);
        assert!(matches!(cut, Err(TerrainError::TiffUnreadable { .. })), "{cut:?}");
    }
}
