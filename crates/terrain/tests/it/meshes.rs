//! Meshes and points, in and out.

use geometry::{Grid, Raster};
use nalgebra::{Point2, Point3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use terrain::formats::mesh::{HeightMesh, write_obj};
use terrain::formats::{ReadOptions, obj, ply, read_named};
use terrain::synthetic::{Recipe, generate};
use terrain::{ElevationMap, Source, TerrainError};

use crate::damage::{damaged, rounds};

const MAX: usize = 1_000_000;

fn bumpy(rng: &mut ChaCha8Rng, nx: usize, ny: usize, holes: f64) -> ElevationMap {
    let grid = Grid { origin: Point2::new(-1.0, 3.0), resolution: 0.25, nx, ny };
    let heights = Raster::from_fn(grid, |ix, iy| {
        let wave = (0.2 * ix as f64).sin() * (0.13 * iy as f64).cos();
        let step = if ix > nx / 2 && iy < ny / 3 { 0.4 } else { 0.0 };
        let z = wave + step + 0.01 * rng.random::<f64>();
        if rng.random::<f64>() < holes { f32::NAN } else { z as f32 }
    });
    ElevationMap::new(heights, Source::file("bumpy"))
}

/// The triangles over a place: their heights there (m).
fn heights_over(mesh: &HeightMesh, p: Point2<f64>) -> Vec<f64> {
    let mut found = Vec::new();
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|i| Point3::from(mesh.vertices[i as usize]));
        let (u, v, w) = (b - a, c - a, p - a.xy());
        let det = u.x * v.y - u.y * v.x;
        assert!(det > 0.0, "counter-clockwise from above");
        let (s, t) = ((w.x * v.y - w.y * v.x) / det, (u.x * w.y - u.y * w.x) / det);
        if s >= -1e-9 && t >= -1e-9 && s + t <= 1.0 + 1e-9 {
            found.push(a.z + s * u.z + t * v.z);
        }
    }
    found
}

#[test]
fn the_whole_mesh_is_the_surface_of_the_map() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let map = bumpy(&mut rng, 30, 24, 0.1);
    let mesh = HeightMesh::whole(&map);
    compare(&map, &mesh, 1e-9, &mut rng, 400);
}

/// The mesh is over the same ground, and no farther from it than `bound`.
fn compare(map: &ElevationMap, mesh: &HeightMesh, bound: f64, rng: &mut ChaCha8Rng, n: usize) {
    let (near, far) = (map.grid().origin, map.grid().far_corner());
    for _ in 0..n {
        let p = Point2::new(
            near.x + (far.x - near.x) * rng.random::<f64>(),
            near.y + (far.y - near.y) * rng.random::<f64>(),
        );
        let found = heights_over(mesh, p);
        match map.height_at(p) {
            None => assert!(found.is_empty(), "no surface over unknown ground at {p}"),
            Some(z) => {
                assert!(!found.is_empty(), "a hole at {p}");
                for height in found {
                    assert!((height - z).abs() <= bound + 1e-9, "{} m off at {p}", height - z);
                }
            }
        }
    }
}

#[test]
fn a_simplified_mesh_keeps_its_bound_everywhere_and_has_no_cracks() {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    for (holes, error_m) in [(0.0, 0.02), (0.0, 0.2), (0.002, 0.05), (0.05, 0.05), (0.0, 0.0)] {
        let (nx, ny) = (rng.random_range(60..150), rng.random_range(60..150));
        let map = bumpy(&mut rng, nx, ny, holes);
        let mesh = HeightMesh::simplified(&map, error_m).unwrap();
        compare(&map, &mesh, error_m, &mut rng, 300);
        // No cracks: an edge belongs to two triangles, or lies at the edge of what is known.
        let mut edges = std::collections::HashMap::new();
        for [a, b, c] in &mesh.triangles {
            for (p, q) in [(a, b), (b, c), (c, a)] {
                *edges.entry((*p.min(q), *p.max(q))).or_insert(0) += 1;
            }
        }
        for ((p, q), n) in edges {
            let [p, q] = [p, q].map(|i| Point3::from(mesh.vertices[i as usize]).xy());
            let (middle, along) = (nalgebra::center(&p, &q), (q - p).normalize());
            let beside = nalgebra::Vector2::new(-along.y, along.x) * 1e-3;
            let is_inner = map.height_at(middle + beside).is_some()
                && map.height_at(middle - beside).is_some();
            assert_eq!(n, if is_inner { 2 } else { 1 }, "edge {p} to {q}");
        }
    }
}

#[test]
fn in_every_cell_a_simplified_mesh_is_within_its_bound_and_a_hole_stays_a_hole() {
    let mut rng = ChaCha8Rng::seed_from_u64(12);
    for (holes, error_m) in [(0.0, 0.03), (0.01, 0.1), (0.05, 0.01)] {
        let map = bumpy(&mut rng, 140, 120, holes);
        let grid = *map.grid();
        let mesh = HeightMesh::simplified(&map, error_m).unwrap();
        // Five places in each cell, off all edges that run along nodes.
        let offsets = [(0.11, 0.13), (0.87, 0.12), (0.47, 0.52), (0.14, 0.85), (0.9, 0.88)];
        let mut covered = std::collections::HashMap::new();
        for triangle in &mesh.triangles {
            let corners = triangle.map(|i| Point3::from(mesh.vertices[i as usize]));
            let [a, b, c] = corners;
            let cell =
                |v: f64, origin: f64| ((v - origin) / grid.resolution).floor().max(0.0) as usize;
            let ends = |v: [f64; 3], origin: f64, n: usize| {
                let low = v.into_iter().fold(f64::MAX, f64::min);
                let high = v.into_iter().fold(f64::MIN, f64::max);
                cell(low, origin)..(cell(high, origin) + 1).min(n - 1)
            };
            for ix in ends(corners.map(|p| p.x), grid.origin.x, grid.nx) {
                for iy in ends(corners.map(|p| p.y), grid.origin.y, grid.ny) {
                    for (k, (u, v)) in offsets.into_iter().enumerate() {
                        let p =
                            grid.position(ix, iy) + nalgebra::Vector2::new(u, v) * grid.resolution;
                        let (e, f, w) = (b - a, c - a, p - a.xy());
                        let det = e.x * f.y - e.y * f.x;
                        let s = (w.x * f.y - w.y * f.x) / det;
                        let t = (e.x * w.y - e.y * w.x) / det;
                        if s < -1e-12 || t < -1e-12 || s + t > 1.0 + 1e-12 {
                            continue;
                        }
                        let z = a.z + s * e.z + t * f.z;
                        let truth = map.height_at(p).unwrap_or_else(|| panic!("{p} is a hole"));
                        assert!((z - truth).abs() <= error_m + 1e-9, "{p}: {z}, not {truth}");
                        *covered.entry((ix, iy, k)).or_insert(0) += 1;
                    }
                }
            }
        }
        let (mut n, mut n_holes) = (0, 0);
        for (ix, iy) in (0..grid.nx - 1).flat_map(|x| (0..grid.ny - 1).map(move |y| (x, y))) {
            for (k, (u, v)) in offsets.into_iter().enumerate() {
                let p = grid.position(ix, iy) + nalgebra::Vector2::new(u, v) * grid.resolution;
                let is_known = map.height_at(p).is_some();
                assert_eq!(covered.contains_key(&(ix, iy, k)), is_known, "{p}");
                n += 1;
                n_holes += usize::from(!is_known);
            }
        }
        assert_eq!(n, 139 * 119 * 5);
        assert_eq!(n_holes > 0, holes > 0.0);
        assert!(mesh.triangles.len() < 2 * 139 * 119);
    }
}

#[test]
fn simplifying_saves_triangles_and_says_the_same_to_a_plane() {
    let plane = ElevationMap::plane(16.0, 0.25).unwrap();
    let mesh = HeightMesh::simplified(&plane, 0.0).unwrap();
    // 128 x 128 cells: four squares of 64, of four triangles each.
    assert_eq!((mesh.triangles.len(), mesh.vertices.len()), (16, 13));
    let ground = generate(&Recipe::boulder_field(), 7).unwrap();
    let whole = HeightMesh::whole(&ground).triangles.len();
    let counts: Vec<usize> = [0.005, 0.03, 0.1]
        .map(|error| HeightMesh::simplified(&ground, error).unwrap().triangles.len())
        .to_vec();
    assert!(counts.is_sorted_by(|a, b| a > b), "{counts:?}");
    assert!(counts[1] < whole / 4, "{counts:?} of {whole}");
    assert!(HeightMesh::simplified(&plane, f64::NAN).is_err());
}

#[test]
fn an_exported_obj_is_read_as_the_same_map() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    for holes in [0.0, 0.08] {
        let map = bumpy(&mut rng, 25, 18, holes);
        let bytes = write_obj(&HeightMesh::whole(&map), &["a\nmap".to_owned()]);
        let again = obj::read(&bytes, MAX).unwrap();
        for iy in 0..18 {
            for ix in 0..25 {
                let p = map.grid().position(ix, iy);
                let z = *map.heights().at(ix, iy);
                let found = again.heights().nearest(p).unwrap_or(f32::NAN);
                // A node whose triangles are all unknown is no part of the surface.
                // One place in each of the six triangles about a node.
                let beside = [
                    (0.1, 0.1),
                    (0.1, -0.05),
                    (0.05, -0.1),
                    (-0.1, 0.05),
                    (-0.05, 0.1),
                    (-0.1, -0.1),
                ];
                let around = beside.map(|(x, y)| map.height_at(Point2::new(p.x + x, p.y + y)));
                if around.iter().any(Option::is_some) && !z.is_nan() {
                    assert!((found - z).abs() < 1e-5, "{found}, expected {z}");
                } else {
                    assert!(found.is_nan(), "{found} at unknown ground");
                }
            }
        }
    }
}

const SQUARE: &str = "# made by hand\nmtllib a.mtl\no ground\nv 1 1 4 0.5 0.5 0.5\nv 0 0 1\nv 1 0 2\n\
                      v 0 1 3\nvn 0 0 1\nvt 0 0\nusemtl soil\ns off\nf 2/1/1 3//1 1 4\n";

#[test]
fn obj_takes_any_order_and_refuses_by_name() {
    let map = obj::read(SQUARE.as_bytes(), MAX).unwrap();
    assert_eq!(map.heights().values(), [1.0, 2.0, 3.0, 4.0]);
    let backward = SQUARE.replace("f 2/1/1 3//1 1 4", "f -3 -2 -4\nf -4 -1 -3");
    assert_eq!(obj::read(backward.as_bytes(), MAX).unwrap().heights(), map.heights());
    let doubled =
        format!("{}v 1 1 4\nf 2 3 5\nf 4 2 5\n", SQUARE.replace("f 2/1/1 3//1 1 4\n", ""));
    assert_eq!(obj::read(doubled.as_bytes(), MAX).unwrap().heights(), map.heights());
    let cases = [
        ("v 1 0 2\n", "v 1 0\n", "line 6: \"\" is not a coordinate"),
        ("v 1 0 2\n", "v 1 0 nan\n", "line 6: a coordinate is NaN"),
        ("v 1 0 2\n", "v 1.1 0 2\n", "not a height field"),
        ("s off", "curv 1 2", "\"curv\" is not an OBJ statement"),
        ("3//1 1 4", "3//1 1 5", "vertex index 5 is out of range (0..4)"),
        ("3//1 1 4", "3//1 1 0", "vertex index 0 is out of range"),
        ("3//1 1 4", "3//1 1 -5", "vertex index 5 is out of range"),
        ("3//1 1 4", "3//1", "a face has 2 corners"),
        ("3//1 1 4", "3//1 x 4", "\"x\" is not a vertex index"),
        ("vn 0 0 1\n", "v 0 0 1.5\n", "1.5 m high"),
    ];
    for (from, to, expected) in cases {
        let text = SQUARE.replace(from, to);
        assert_ne!(text, SQUARE, "{from:?}");
        let refused = obj::read(text.as_bytes(), MAX).expect_err(&text).to_string();
        assert!(refused.contains(expected), "{to:?}: {refused}");
    }
    let sparse = "v 0 0 0\nv 0.001 0 0\nv 0 0.001 0\nv 90 90 0\nf 1 2 3\n";
    let refused = obj::read(sparse.as_bytes(), usize::MAX).unwrap_err();
    assert!(refused.to_string().contains("too few"), "{refused}");
}

fn cloud(format: &str, header: &str, body: &[u8]) -> Vec<u8> {
    let head = format!("ply\nformat {format} 1.0\ncomment by hand\n{header}end_header\n");
    [head.as_bytes(), body].concat()
}

const XYZ: &str = "element vertex 2\nproperty float x\nproperty uchar red\nproperty double z\n\
                   property float y\n";

#[test]
fn points_are_read_from_all_three_encodings() {
    let expected = [Point3::new(1.5, -2.0, 0.25), Point3::new(3.0, 4.0, -5.0)];
    let text = cloud("ascii", XYZ, b"1.5 7 0.25 -2\n3 255 -5\n 4");
    assert_eq!(ply::read_points(&text, 9).unwrap(), expected);
    for is_big in [false, true] {
        let mut body = Vec::new();
        let mut put = |little: &[u8]| {
            let mut bytes = little.to_vec();
            if is_big {
                bytes.reverse();
            }
            body.extend(bytes);
        };
        for p in expected {
            put(&(p.x as f32).to_le_bytes());
            put(&[9]);
            put(&p.z.to_le_bytes());
            put(&(p.y as f32).to_le_bytes());
        }
        let format = if is_big { "binary_big_endian" } else { "binary_little_endian" };
        assert_eq!(ply::read_points(&cloud(format, XYZ, &body), 9).unwrap(), expected);
    }
    // What comes before the vertices, lists too, is passed over; NaN points are left out.
    let before = "element camera 1\nproperty list uchar int ids\nproperty float f\nelement vertex 2\n\
                  property float x\nproperty float y\nproperty float z\nelement face 1\n\
                  property list uchar int vertex_indices\n";
    let text = cloud("ascii", before, b"3 1 2 3 0.5\nnan nan nan\n1 2 3\n3 0 1 1\n");
    assert_eq!(ply::read_points(&text, 9).unwrap(), [Point3::new(1.0, 2.0, 3.0)]);
}

#[test]
fn unusable_points_are_refused_by_name() {
    let good = cloud("ascii", XYZ, b"1 0 2 3\n4 0 5 6\n");
    let cases = [
        (good[..20].to_vec(), "is not followed by end_header"),
        (b"solid\n".to_vec(), "no PLY file"),
        (cloud("ascii", XYZ, b"1.25 0 2 3\n4 0 5"), "vertex 1: is cut off"),
        (cloud("ascii", XYZ, b"1 0 2 inf\n4 0 5 6\n"), "vertex 0: has an infinite coordinate"),
        (
            cloud("ascii", &XYZ.replace("vertex 2", "vertex 99999"), b"1 0 2 3\n"),
            "number of points",
        ),
        (
            cloud("ascii", &XYZ.replace("vertex 2", "vertex 99"), b"1 0 2 3\n"),
            "than the file holds",
        ),
        (cloud("ascii", &XYZ.replace("vertex 2", "vertex -1"), b""), "has no whole number"),
        (cloud("ascii", &XYZ.replace("float y", "float w"), b"1 0 2 3\n"), "no property y"),
        (cloud("ascii", &XYZ.replace("float y", "half y"), b"1 0 2 3\n"), "unknown type"),
        (cloud("binary_middle", XYZ, b""), "unknown format"),
        (cloud("ascii", "element face 0\n", b""), "no element vertex"),
        (cloud("ascii", "property float x\n", b""), "before any element"),
    ];
    for (bytes, expected) in cases {
        let refused = ply::read_points(&bytes, 1000).unwrap_err().to_string();
        assert!(refused.contains(expected), "{refused}, expected {expected:?}");
    }
}

#[test]
fn an_exported_ply_holds_the_mesh_and_its_points_give_the_map_again() {
    let map = bumpy(&mut ChaCha8Rng::seed_from_u64(4), 20, 15, 0.0);
    let bytes = ply::write(&HeightMesh::whole(&map), &["frame".to_owned()]);
    let points = ply::read_points(&bytes, MAX).unwrap();
    assert_eq!(points.len(), 300);
    let options = ReadOptions { cell_m: Some(0.25), ..ReadOptions::default() };
    let again = read_named("a.ply", &bytes, &options).unwrap();
    assert_eq!((again.grid().nx, again.grid().ny), (20, 15));
    for (a, b) in map.heights().values().iter().zip(again.heights().values()) {
        assert!((a - b).abs() < 1e-6);
    }
}

#[test]
fn damaged_meshes_and_clouds_give_an_answer_or_an_error() {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let map = bumpy(&mut rng, 5, 4, 0.0);
    let mesh = HeightMesh::whole(&map);
    let originals = [
        write_obj(&mesh, &[]),
        SQUARE.as_bytes().to_vec(),
        ply::write(&mesh, &[]),
        cloud("ascii", XYZ, b"1.5 7 0.25 -2\n3 255 -5\n 4"),
    ];
    let pieces =
        ["nan", "1e308", "-1", "18446744073709551615", "\n", " ", "list", "f 1 1 1\n", "v "];
    for round in 0..rounds(8000) {
        let good = &originals[round % originals.len()];
        let bytes = damaged(&mut rng, good, usize::MAX, &pieces);
        let options = ReadOptions { max_nodes: 10_000, ..ReadOptions::default() };
        drop(obj::read(&bytes, 10_000));
        drop(ply::read_points(&bytes, 10_000));
        if let Err(refused) = read_named("a.ply", &bytes, &options) {
            assert!(!refused.to_string().is_empty());
        }
    }
    let cut = obj::read(&originals[0][..originals[0].len() - 4], MAX);
    assert!(matches!(cut, Err(TerrainError::MeshFaceCorners { .. })), "{cut:?}");
}

#[test]
fn points_far_apart_are_refused_before_a_map_is_made_of_them() {
    // 100 m x 100 m at 5 cm are 2001 x 2001 nodes.
    let bytes = cloud("ascii", XYZ, b"0 0 0 0\n100 0 1 100\n");
    let options = ReadOptions { max_nodes: 2001 * 2001 - 1, ..ReadOptions::default() };
    let refused = read_named("a.ply", &bytes, &options).unwrap_err();
    assert!(matches!(refused, TerrainError::TooManyNodes { n_nodes: 4_004_001, .. }), "{refused}");
    let options = ReadOptions { cell_m: Some(10.0), max_nodes: 121, ..ReadOptions::default() };
    assert_eq!(read_named("a.ply", &bytes, &options).unwrap().grid().nx, 11);
}
