//! Robot folders: `robot.toml` with its rig, URDF, meshes.

use nalgebra::Vector3;
use rover::{Mesh, Robot};
use stereo::rig::Rig;
use testkit::{fixture_text, project_dir};

use super::answered;
use crate::mutate::{Kind, Seed};
use crate::run::{Answer, Reader};

const MEMORY_MAX: usize = 128 << 20;
const SECONDS_MAX: f64 = 5.0;

const OBJ: &str = "o a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvn 0 0 1\nf 1 3 2\nf 1//1 2//1 4//1\n\
    f -4 -1 -2\nf 2 3 4\n";
const STL: &str = "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n\
    endloop\nendfacet\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 0 1\n\
    endloop\nendfacet\nendsolid a\n";

pub fn readers() -> Vec<Reader> {
    let names = ["athlete/athlete", "quadruped/quadruped", "slider/slider"];
    let folders: Vec<(String, String)> = names
        .iter()
        .map(|name| {
            let folder = name.split('/').next().unwrap_or_default();
            let toml = fixture_text(&format!("robots/{folder}/robot.toml"));
            (toml, fixture_text(&format!("robots/{name}.urdf")))
        })
        .collect();
    let text = |text: &String| Seed::new("folder", Kind::Text, text.as_str());
    let tomls = folders.iter().map(|(toml, _)| text(toml)).collect();
    let urdfs = folders.iter().map(|(_, urdf)| text(urdf)).collect();
    let kept = folders.clone();
    let meshes = vec![
        Seed::new("obj", Kind::Text, OBJ),
        Seed::new("stl", Kind::Text, STL),
        Seed::new("binary stl", Kind::Binary, binary_stl()),
    ];
    vec![
        reader("robot.toml", tomls, move |i, text| robot(text, &kept[i].1, true)),
        reader("urdf", urdfs, move |i, text| robot(&folders[i].0, text, false)),
        Reader {
            name: "robot mesh",
            seeds: meshes,
            read: Box::new(|i, bytes| {
                let path = if i == 0 { "a.obj" } else { "a.stl" };
                answered(&Mesh::parse(path, bytes, &Vector3::new(1.0, 1.0, 1.0)))
            }),
            memory_max: MEMORY_MAX,
            seconds_max: SECONDS_MAX,
        },
    ]
}

fn reader(
    name: &'static str,
    seeds: Vec<Seed>,
    read: impl Fn(usize, &str) -> Answer + 'static,
) -> Reader {
    let read = move |i: usize, bytes: &[u8]| read(i, &String::from_utf8_lossy(bytes));
    let (memory_max, seconds_max) = (MEMORY_MAX, SECONDS_MAX);
    Reader { name, seeds, read: Box::new(read), memory_max, seconds_max }
}

fn robot(toml: &str, urdf: &str, with_rig: bool) -> Answer {
    let meshes = project_dir().join("fixtures/robots/quadruped");
    let mesh = |path: &str| {
        // As a server would have it: what leads out of the folder is not asked for.
        assert!(!path.starts_with('/') && !path.split('/').any(|part| part == ".."), "{path}");
        std::fs::read(meshes.join(path)).ok()
    };
    let robot = Robot::from_folder(toml, |_| Some(urdf.to_owned()), mesh);
    if let Ok(robot) = &robot {
        let mass = robot.mass();
        if !(mass.is_finite() && mass > 0.0) {
            return Err(format!("its robot has a mass of {mass}"));
        }
        if with_rig {
            answered(&Rig::from_toml(toml, robot))?;
        }
    }
    answered(&robot)
}

fn binary_stl() -> Vec<u8> {
    let corners = [[0.0_f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let mut bytes = vec![b' '; 80];
    bytes.extend(4_u32.to_le_bytes());
    for face in [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]] {
        bytes.extend([0; 12]);
        bytes.extend(face.iter().flat_map(|i| corners[*i]).flat_map(f32::to_le_bytes));
        bytes.extend([0; 2]);
    }
    bytes
}
