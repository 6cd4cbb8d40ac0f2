//! Meshes: what is read from them, and what is refused.

use nalgebra::{Point3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rover::{MESH_BYTES_MAX, MESH_COMPONENTS_MAX, Mesh, MeshError};

const ONE: Vector3<f64> = Vector3::new(1.0, 1.0, 1.0);

/// Corners of the cube's triangles, edge 2 m about `center`, some of them wound inward.
fn cube(center: [f32; 3]) -> Vec<[[f32; 3]; 3]> {
    let corner =
        |i: usize| [0, 1, 2].map(|axis| center[axis] + if i >> axis & 1 == 1 { 1.0 } else { -1.0 });
    let faces =
        [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]];
    faces
        .iter()
        .flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]].map(|t| t.map(|i| corner(*i))))
        .collect()
}

fn binary_stl(triangles: &[[[f32; 3]; 3]]) -> Vec<u8> {
    let mut bytes = b"solid by its header, binary by its length".to_vec();
    bytes.resize(80, b' ');
    bytes.extend((triangles.len() as u32).to_le_bytes());
    for triangle in triangles {
        bytes.extend([0; 12]);
        bytes.extend(triangle.iter().flatten().flat_map(|v| v.to_le_bytes()));
        bytes.extend([0; 2]);
    }
    bytes
}

fn ascii_stl(triangles: &[[[f32; 3]; 3]]) -> Vec<u8> {
    let mut text = String::from("solid cube\n");
    for triangle in triangles {
        text += "facet normal 0 0 0\nouter loop\n";
        for [x, y, z] in triangle {
            text += &format!("vertex {x} {y} {z}\n");
        }
        text += "endloop\nendfacet\n";
    }
    (text + "endsolid cube\n").into_bytes()
}

fn obj(triangles: &[[[f32; 3]; 3]]) -> Vec<u8> {
    let vertices = triangles.iter().flatten().map(|[x, y, z]| format!("v {x} {y} {z}\n"));
    let faces =
        (0..triangles.len()).map(|i| format!("f {} {} {}\n", 3 * i + 1, 3 * i + 2, 3 * i + 3));
    vertices.chain(faces).collect::<String>().into_bytes()
}

fn sorted(points: &[Point3<f64>]) -> Vec<[i64; 3]> {
    let mut points: Vec<[i64; 3]> =
        points.iter().map(|p| [p.x, p.y, p.z].map(|v| (v * 1e6).round() as i64)).collect();
    points.sort_unstable();
    points
}

#[test]
fn the_three_formats_give_the_same_cube_of_eight_vertices() {
    let cube = cube([0.0; 3]);
    let stl = Mesh::parse("a/cube.STL", &binary_stl(&cube), &ONE).unwrap();
    assert_eq!((stl.vertices().len(), stl.triangles().len()), (8, 12));
    assert_eq!(stl.components().count(), 1);
    for (path, bytes) in [("cube.stl", ascii_stl(&cube)), ("cube.obj", obj(&cube))] {
        let mesh = Mesh::parse(path, &bytes, &ONE).unwrap();
        assert_eq!(sorted(mesh.vertices()), sorted(stl.vertices()), "{path}");
        assert_eq!(mesh.triangles().len(), 12);
    }
    let shrunk =
        Mesh::parse("c.stl", &binary_stl(&cube), &Vector3::new(0.001, -0.001, 0.5)).unwrap();
    let size = shrunk.vertices().iter().map(|v| v.coords.abs()).reduce(|a, b| a.sup(&b)).unwrap();
    assert!((size - Vector3::new(0.001, 0.001, 0.5)).norm() < 1e-12);
}

#[test]
fn what_is_not_connected_is_a_component_of_its_own() {
    let two = [cube([0.0; 3]), cube([5.0, 0.0, 0.0])].concat();
    let mesh = Mesh::parse("two.stl", &binary_stl(&two), &ONE).unwrap();
    assert_eq!(mesh.components().map(|c| c.len()).collect::<Vec<_>>(), [8, 8]);
    let many: Vec<_> =
        (0..=MESH_COMPONENTS_MAX).flat_map(|i| cube([5.0 * i as f32, 0.0, 0.0])).collect();
    let error = Mesh::parse("many.stl", &binary_stl(&many), &ONE).unwrap_err();
    assert_eq!(error, MeshError::TooManyComponents { limit: MESH_COMPONENTS_MAX });
}

#[test]
fn degenerate_meshes_are_refused_by_name() {
    let parse = |triangles: &[[[f32; 3]; 3]]| Mesh::parse("m.stl", &binary_stl(triangles), &ONE);
    assert_eq!(parse(&[]), Err(MeshError::Empty));
    let spot = [[1.0, 2.0, 3.0]; 3];
    assert_eq!(parse(&[spot, spot]), Err(MeshError::Empty));
    let needle = [[0.0; 3], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]];
    assert!(matches!(parse(&[needle]), Err(MeshError::Flat { .. })));
    let plate = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let other = [[1.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    assert!(matches!(parse(&[plate, other]), Err(MeshError::Flat { .. })));
    let mut with_decal = cube([0.0; 3]);
    with_decal.push(plate.map(|[x, y, _]| [x + 9.0, y, 0.0]));
    assert!(matches!(parse(&with_decal), Err(MeshError::Flat { .. })));
    for wrong in [f32::NAN, f32::INFINITY, 1e9] {
        let mut bad = cube([0.0; 3]);
        bad[3][1][2] = wrong;
        assert!(matches!(parse(&bad), Err(MeshError::Coordinate { .. })), "{wrong}");
    }
    let cube = binary_stl(&cube([0.0; 3]));
    let scale = |s: f64| Mesh::parse("m.stl", &cube, &Vector3::new(1.0, s, 1.0));
    assert_eq!(scale(0.0), Err(MeshError::Scale { value: 0.0 }));
    assert!(matches!(scale(f64::NAN), Err(MeshError::Scale { .. })));
    assert_eq!(Mesh::parse("m.dae", &cube, &ONE), Err(MeshError::Format));
    assert_eq!(Mesh::parse("stl", &cube, &ONE), Err(MeshError::Format));
    assert!(matches!(Mesh::parse("m.stl", &cube[..100], &ONE), Err(MeshError::Syntax { .. })));
    let text = Mesh::parse("m.obj", b"v 0 0 0\nf 1 2 3\n", &ONE);
    assert!(matches!(text, Err(MeshError::Syntax { .. })));
    let large = vec![0; MESH_BYTES_MAX + 1];
    assert!(matches!(Mesh::parse("m.stl", &large, &ONE), Err(MeshError::TooLarge { .. })));
}

#[test]
fn an_open_and_inverted_mesh_is_fine() {
    let mut open = cube([0.0; 3]);
    open.truncate(7);
    open.iter_mut().for_each(|t| t.reverse());
    assert_eq!(Mesh::parse("m.stl", &binary_stl(&open), &ONE).unwrap().components().count(), 1);
}

#[test]
fn no_mutation_of_a_mesh_makes_it_panic() {
    let cube = cube([0.0; 3]);
    let seeds = [
        ("m.stl", binary_stl(&cube)),
        ("m.stl", ascii_stl(&cube)),
        ("m.obj", obj(&cube)),
        ("m.obj", testkit::fixture_text("robots/quadruped/meshes/trunk.obj").into_bytes()),
    ];
    let words: [&[u8]; 8] = [
        b"f 1//2 -1/1",
        b"nan",
        b"-99999999999",
        b"\n",
        b"/",
        b"vertex",
        b"\xff\xff\xff\x7f",
        b"f -1 -2 -3 -4 -5\n",
    ];
    let mut rng = ChaCha8Rng::seed_from_u64(21);
    let mut read = 0;
    for i in 0..10_000 {
        let (path, bytes) = &seeds[i % seeds.len()];
        let mut bytes = bytes.clone();
        for _ in 0..rng.random_range(1..6) {
            let at = rng.random_range(0..bytes.len());
            match rng.random_range(0..4) {
                0 => bytes[at] = rng.random(),
                1 => bytes.truncate(at.max(1)),
                2 => drop(
                    bytes.drain(at..(at + rng.random_range(0..40)).min(bytes.len() - 1).max(at)),
                ),
                _ => {
                    let word = words[rng.random_range(0..words.len())];
                    bytes.splice(at..at, word.iter().copied());
                }
            }
        }
        read += usize::from(Mesh::parse(path, &bytes, &ONE).is_ok());
    }
    assert!(read > 500, "only {read} of 10 000 were still meshes: no evidence");
}
