//! From stereo pairs to a new version of the map, against the ground that the rover stands on.

use base64::Engine;
use rover::Posture;
use serde_json::{Value, json};
use stereo::ray::RayScene;
use terrain::ElevationMap;
use wire::check::At;

use crate::support::Ground;

/// The map of a version, as it is served.
fn map_of(ground: &Ground, version: &Value) -> ElevationMap {
    ground.app().store.get(&At::root("v"), version.as_str().unwrap()).unwrap().map.clone()
}

async fn current(ground: &Ground) -> Value {
    ground.get("/api/v1/terrain/versions").await.json()["current"].take()
}

/// Reconstructs; gives the answer of the ended job.
async fn reconstruct(ground: &Ground, request: &Value) -> Value {
    let report = ground.job(&ground.post("terrain/reconstructions", request).await).await;
    assert_eq!(report["state"], "done", "{report}");
    ground.get(report["result"].as_str().unwrap()).await.json()
}

#[tokio::test]
async fn the_map_that_two_pairs_see_is_the_ground_without_the_robot() {
    let ground = Ground::start().await;
    let truth = map_of(&ground, &current(&ground).await);
    let wish = json!({
        "cameras": ["haz1", "nav1"], "scale": 0.5, "seed": 7, "keep_prior": false
    });
    let answer = reconstruct(&ground, &wish).await;
    let version = current(&ground).await;
    assert_eq!(answer["terrain_version"], version);
    assert_eq!(answer["pairs"].as_array().unwrap().len(), 2);
    let seen = map_of(&ground, &version);

    // Where the robot is, by the distance to its solids.
    let robot = ground.app().live.robot().clone();
    let posture = Posture::new(&robot, &ground.app().live.configuration().unwrap());
    let scene = RayScene::new(None, Some((&robot, &posture)));
    let (mut n, mut squares, mut n_off, mut n_below, mut raised) = (0_usize, 0.0, 0, 0, 0.0_f64);
    let grid = *seen.grid();
    for iy in 0..grid.ny {
        for ix in 0..grid.nx {
            let (p, z) = (grid.position(ix, iy), *seen.heights().at(ix, iy));
            let Some(expected) = truth.height_at(p).filter(|_| !z.is_nan()) else { continue };
            let miss = f64::from(z) - expected;
            (n, squares, n_off) =
                (n + 1, squares + miss * miss, n_off + usize::from(miss.abs() > 0.2));
            // Under a wheel or a leg: a solid of the robot is straight above.
            let from = nalgebra::Point3::new(p.x, p.y, expected - 0.02);
            if scene.is_blocked(&from, &nalgebra::Vector3::z(), 4.0) {
                n_below += 1;
                raised = raised.max(miss);
            }
        }
    }
    let rms = (squares / n as f64).sqrt();
    assert!(n > 4000, "{n}");
    assert!(rms < 0.05 && n_off * 200 < n, "rms {rms} m, {n_off} of {n} off by 20 cm");
    assert!(n_below > 50 && raised < 0.10, "{n_below} {raised}");
    for pair in answer["pairs"].as_array().unwrap() {
        assert!(pair["terrain_points"].as_u64().unwrap() > 1000, "{pair}");
    }
    let robot_points = |i: usize| answer["pairs"][i]["robot_points"].as_u64().unwrap();
    assert!(robot_points(0) > 100, "a HazCam sees legs");
    let new_cells = answer["new_cells"].as_u64().unwrap() as usize;
    assert!(new_cells >= n, "{new_cells} {n}");

    // A cell tells who saw it, and when.
    let cell = |version: Value, [x, y]: [f64; 2]| {
        let version = version.as_str().unwrap().to_owned();
        format!("/api/v1/terrain/{version}/cell?x_m={x}&y_m={y}")
    };
    let known = (0..grid.len()).filter(|i| !seen.heights().values()[*i].is_nan());
    let places: Vec<_> = known.map(|i| grid.position(i % grid.nx, i / grid.nx)).collect();
    let inside: Vec<_> = places.iter().filter(|p| seen.height_at(**p).is_some()).collect();
    for p in inside.iter().step_by(inside.len() / 20) {
        let told = ground.get(&cell(version.clone(), [p.x, p.y])).await.json();
        let camera = told["seen"]["camera"].as_str().unwrap();
        assert!(["haz1", "nav1"].contains(&camera), "{told}");
        assert_eq!(told["seen"]["capture_time"], answer["capture_time"]);
        assert!(told["seen"]["prior"] == false && told["seen"]["hidden"] == false, "{told}");
        assert!((0.0..0.1).contains(&told["seen"]["sigma_m"].as_f64().unwrap()), "{told}");
    }

    // Seen again, the map is fitted to what is known and no worse.
    let wish_again = json!({ "cameras": ["haz1", "nav1"], "seed": 9, "keep_prior": false });
    let again = reconstruct(&ground, &wish_again).await;
    assert_ne!(again["terrain_version"], version);
    assert!(again["pairs"].as_array().unwrap().iter().all(|pair| pair["fit_refused"] == false));
    let blended = map_of(&ground, &again["terrain_version"]);
    let (mut n_both, mut before, mut after) = (0.0, 0.0, 0.0);
    for p in &places {
        let nearest = |map: &ElevationMap| map.heights().nearest(*p).filter(|z| !z.is_nan());
        let (Some(a), Some(b)) = (nearest(&seen), nearest(&blended)) else { continue };
        let Some(expected) = truth.height_at(*p) else { continue };
        n_both += 1.0;
        before += (f64::from(a) - expected).powi(2);
        after += (f64::from(b) - expected).powi(2);
    }
    let [before, after] = [before, after].map(|sum: f64| (sum / n_both).sqrt());
    assert!(n_both > 0.9 * places.len() as f64 && after < 1.05 * before, "{before} {after}");
    let other_cells = json!({ "cameras": ["haz1"], "resolution_m": 0.1 });
    let refused = ground.post("terrain/reconstructions", &other_cells).await;
    assert_eq!(refused.json()["error"]["details"]["field"], "resolution_m");

    // The same in another session is the same map, byte for byte; another seed is another one.
    let other = Ground::start().await;
    assert_eq!(reconstruct(&other, &wish).await["terrain_version"], version);
    let seeded = json!({ "cameras": ["haz1"], "scale": 0.25, "seed": 8, "anew": true });
    let seeded = reconstruct(&other, &seeded).await;
    assert_ne!(seeded["terrain_version"], version);

    // With the map from before, whatever is not seen is as it was, and told to be from there.
    let corner = truth.grid().origin;
    let told = other.get(&cell(seeded["terrain_version"].clone(), [corner.x, corner.y])).await;
    assert_eq!(told.json()["seen"]["prior"], true, "{}", told.json());
    let kept = map_of(&other, &seeded["terrain_version"]);
    assert_eq!(kept.grid(), truth.grid());
    let known = |map: &ElevationMap| map.heights().values().iter().filter(|z| !z.is_nan()).count();
    let same = truth.heights().values().iter().zip(kept.heights().values());
    let n_same = same.filter(|(a, b)| a.to_bits() == b.to_bits()).count();
    assert!(known(&kept) * 100 > known(&truth) * 99, "{} of {}", known(&kept), known(&truth));
    assert!(n_same * 2 > known(&truth) && n_same < known(&truth), "{n_same} unchanged");
}

#[tokio::test]
async fn one_at_a_time_which_can_be_cancelled_and_changes_nothing_then() {
    let ground = Ground::start().await;
    let before = current(&ground).await;
    let names = ["nav1", "nav2", "nav3", "nav4", "nav5", "nav6"];
    let large = json!({ "cameras": names, "scale": 1.0 });
    let accepted = ground.post("terrain/reconstructions", &large).await;
    assert_eq!(accepted.status, 202, "{}", accepted.json());
    let second = ground.post("terrain/reconstructions", &json!({ "cameras": ["nav1"] })).await;
    assert_eq!((second.status.as_u16(), second.code().as_str()), (429, "busy"));
    let path = format!("/api/v1/jobs/{}", accepted.json()["id"].as_str().unwrap());
    let begun = || async {
        let report = ground.get(&path).await.json();
        report.pointer("/pairs/0/stage") == Some(&json!("on_the_way"))
    };
    ground.until("the first pieces", begun).await;
    assert_eq!(ground.call("DELETE", &path, None).await.status, 200);
    let ended = ground.job(&accepted).await;
    assert_eq!(ended["state"], "cancelled", "{ended}");
    assert_eq!(current(&ground).await, before);
    let id = accepted.json()["id"].as_str().unwrap().to_owned();
    let answer = ground.get(&format!("/api/v1/terrain/reconstructions/{id}")).await;
    assert_eq!(answer.code(), "reconstruction_unknown");
}

#[tokio::test]
async fn the_pairs_and_what_they_would_see_are_told_before() {
    let ground = Ground::start().await;
    let cameras = ground.get("/api/v1/rover/cameras").await.json();
    assert_eq!(cameras["cameras"].as_array().unwrap().len(), 9);
    let nav1 = &cameras["cameras"][0];
    assert_eq!((&nav1["name"], &nav1["kind"]), (&json!("nav1"), &json!("navcam")));
    assert_eq!(nav1["raw_bytes"], 2 * 1024 * 768);
    assert!((nav1["baseline_m"].as_f64().unwrap() - 0.25).abs() < 1e-9);
    assert_eq!(nav1["downlink_s"], Value::Null);
    let link = json!({
        "up_delay_s": 0.02, "down_delay_s": 0.02, "down": { "rate_bps": 1_000_000.0 }
    });
    assert_eq!(ground.call("PUT", "/api/v1/link", Some(&link)).await.status, 200);
    let limited = ground.get("/api/v1/rover/cameras").await.json();
    let seconds = limited["cameras"][0]["downlink_s"].as_f64().unwrap();
    assert!((seconds - 12.582_912).abs() < 1e-9, "2 x 1024 x 768 bytes at 1 Mbit/s: {seconds}");

    let wish = json!({ "cameras": ["nav1", "haz1", "nav1"], "resolution_m": 0.2 });
    let answer = ground.post("rover/cameras/coverage", &wish).await.json();
    let size = [0, 1].map(|i| answer["size"][i].as_u64().unwrap() as usize);
    let mask = answer["mask_base64"].as_str().unwrap();
    let mask = base64::engine::general_purpose::STANDARD.decode(mask).unwrap();
    assert_eq!(mask.len(), 2 * size[0] * size[1]);
    let mask: Vec<u16> = mask.chunks(2).map(|b| u16::from_le_bytes([b[0], b[1]])).collect();
    assert_eq!(answer["cameras"].as_array().unwrap().len(), 2, "each once");
    for (bit, pair) in answer["cameras"].as_array().unwrap().iter().enumerate() {
        let n = mask.iter().filter(|cell| *cell >> bit & 1 == 1).count();
        assert_eq!(pair["bit"], bit);
        assert!(n > 20 && (pair["area_m2"].as_f64().unwrap() - 0.04 * n as f64).abs() < 1e-6);
    }
    // NavCam 1 looks to 30°: what it sees lies there, seen from the robot's middle.
    let base = ground.frame().await["state"]["base"]["position_m"].take();
    let [bx, by] = [0, 1].map(|i| base[i].as_f64().unwrap());
    let at = |i: usize, n: usize| answer["origin_m"][i].as_f64().unwrap() + 0.2 * n as f64;
    let heading = ground.app().config.rover.heading_rad + 30.0_f64.to_radians();
    for (i, _) in mask.iter().enumerate().filter(|(_, cell)| **cell & 1 == 1) {
        let way = [at(0, i % size[0]) - bx, at(1, i / size[0]) - by];
        assert!(way[0] * heading.cos() + way[1] * heading.sin() > 1.0, "{way:?}");
    }
    assert_eq!(answer["raw_bytes"], 4 * 1024 * 768);
    let share = answer["seen_share"].as_f64().unwrap();
    assert!(share > 0.02 && share < 0.9, "{share}");
}

/// The captures of a version, by name of the pair.
fn source_of(version: &Value, name: &str) -> u64 {
    let pairs = version["pairs"].as_array().unwrap();
    pairs.iter().find(|pair| pair["name"] == name).unwrap()["source"].as_u64().unwrap()
}

#[tokio::test]
async fn a_pair_can_be_taken_out_its_fit_undone_and_a_version_put_in_use_again() {
    let ground = Ground::start().await;
    let imported = current(&ground).await;
    let wish = |camera: &str, seed: u64| json!({ "cameras": [camera], "scale": 0.25, "seed": seed, "keep_prior": false });
    let first = reconstruct(&ground, &wish("haz1", 3)).await;
    let alone = first["terrain_version"].clone();
    let second = reconstruct(&ground, &wish("haz2", 4)).await;
    let both = second["terrain_version"].clone();
    assert_ne!(alone, both);
    let versions = ground.get("/api/v1/terrain/versions").await.json();
    let told = versions["versions"][0].clone();
    assert_eq!(told["version"], both);
    let changes = &told["changes"];
    assert_eq!((&changes["since"], &changes["step"]), (&alone, &json!("seen")));
    assert_eq!(changes["new_cells"], second["new_cells"]);
    assert_eq!(told["pairs"][1]["reconstruction"], second["id"]);
    let pair = &told["pairs"][1];
    for field in ["epipolar_px", "fill", "plane_residual_m", "shift_m", "cells"] {
        assert_eq!(pair[field], second["pairs"][0][field], "{field}");
    }
    assert_eq!(told["captured"], second["capture_time"]);

    // The layers of who saw what: every cell of the map has a source, and one of these.
    let tile = |layer: &'static str| {
        let path = format!("/api/v1/terrain/{}/tiles/{layer}/0/0/0", both.as_str().unwrap());
        let ground = &ground;
        async move { ground.get(&path).await.bytes[64..].to_vec() }
    };
    let (heights, sources, sigmas) =
        (tile("height").await, tile("source").await, tile("sigma").await);
    let (masks, ages) = (tile("mask").await, tile("age").await);
    let float =
        |bytes: &[u8], i: usize| f32::from_le_bytes(bytes[4 * i..4 * i + 4].try_into().unwrap());
    let names = told["sources"].as_array().unwrap();
    assert_eq!(heights.len(), 4 * sources.len());
    let mut counts = vec![0; names.len() + 1];
    for (i, source) in sources.iter().enumerate() {
        counts[usize::from(*source)] += 1;
        let (height, sigma, age) = (float(&heights, i), float(&sigmas, i), float(&ages, i));
        if height.is_nan() {
            assert!(masks[i] != 1, "unknown ground is not seen ground");
            continue;
        }
        assert!(matches!(masks[i], 1 | 6), "known without the map from before: {}", masks[i]);
        // Beside a rock a cell is as unsure as the rock is high.
        assert!(*source >= 2 && sigma > 0.0 && sigma < 0.3, "{source} {sigma}");
        assert!((0.0..600.0).contains(&age), "{age}");
    }
    let count = |name: &str| counts[names.iter().position(|n| n == name).unwrap() + 1];
    assert!(
        count("haz1") > 200 && count("haz2") > 200 && count("map from before") == 0,
        "{counts:?}"
    );

    // Its fit undone is another map; fitted again it is the same as before, byte for byte.
    let haz2 = source_of(&told, "haz2");
    let fit = |version: &Value, source: u64, fitted: bool| {
        let path = format!("/api/v1/terrain/{}/pairs/{source}/fit", version.as_str().unwrap());
        let ground = &ground;
        async move { ground.call("PUT", &path, Some(&json!({ "fitted": fitted }))).await }
    };
    if told["pairs"][1]["fit_refused"] == false {
        let undone = fit(&both, haz2, false).await.json();
        assert_eq!(undone["changes"]["step"], "fit_undone", "{undone}");
        assert_ne!(undone["version"], both);
        assert_eq!(undone["pairs"][1]["fitted"], false);
        let redone = fit(&undone["version"], haz2, true).await.json();
        assert_eq!(redone["version"], both, "{redone}");
    }
    // A pair that nothing was there to fit to has no fit to undo.
    let haz1 = source_of(&told, "haz1");
    assert_eq!(fit(&both, haz1, false).await.code(), "fit_refused");

    // Without the second pair the map is that of the first alone: rebuilt, not patched.
    let path = |version: &Value, source: u64| {
        format!("/api/v1/terrain/{}/pairs/{source}", version.as_str().unwrap())
    };
    let removed = ground.call("DELETE", &path(&both, haz2), None).await.json();
    assert_eq!(removed["version"], alone, "{removed}");
    assert_eq!(removed["changes"]["step"], "removed");
    assert!(removed["changes"]["gone_cells"].as_u64().unwrap() > 200);
    assert_eq!(removed["pairs"].as_array().unwrap().len(), 1);
    let again = ground.call("DELETE", &path(&both, haz1), None).await;
    assert_eq!((again.status.as_u16(), again.code().as_str()), (409, "not_current"));
    assert_eq!(ground.call("DELETE", &path(&alone, 99), None).await.code(), "capture_unknown");

    // Put in use again, reconstructions go on from it.
    let select = |version: &str| {
        let path = format!("/api/v1/terrain/versions/{version}/select");
        let ground = &ground;
        async move { ground.call("POST", &path, None).await }
    };
    let back = select(both.as_str().unwrap()).await;
    assert_eq!(back.status, 200, "{}", back.json());
    assert_eq!(current(&ground).await, both);
    let third = reconstruct(&ground, &wish("haz3", 5)).await;
    let versions = ground.get("/api/v1/terrain/versions").await.json();
    let names: Vec<_> = versions["versions"][0]["pairs"].as_array().unwrap().iter().collect();
    assert_eq!(names.len(), 3, "{third}");
    assert_eq!(select(imported.as_str().unwrap()).await.status, 200);
    assert_eq!(current(&ground).await, imported);
    assert_eq!(select("0123456789abcdef").await.code(), "terrain_unknown");
    assert_eq!(ground.call("DELETE", &path(&imported, 0), None).await.code(), "capture_unknown");

    // The pictures of the last: as many pixels as it says, the disparity with holes.
    let picture = |name: &str| {
        let id = third["id"].as_str().unwrap();
        format!("/api/v1/terrain/reconstructions/{id}/pairs/haz3/{name}")
    };
    for name in ["left", "right", "rectified_left", "rectified_right", "disparity"] {
        let png = ground.get(&picture(&format!("{name}.png"))).await;
        assert_eq!(png.status, 200, "{name}");
        let side = |at: usize| u32::from_be_bytes(png.bytes[at..at + 4].try_into().unwrap());
        assert_eq!((&png.bytes[1..4], side(16), side(20)), (&b"PNG"[..], 256, 192), "{name}");
        assert_eq!(png.bytes.windows(4).any(|w| w == b"tRNS"), name == "disparity");
    }
    for name in ["left", "depth.png", "left.jpg"] {
        assert_eq!(ground.get(&picture(name)).await.code(), "picture_unknown", "{name}");
    }
}

#[tokio::test]
async fn ground_that_a_leg_hides_is_behind_that_leg() {
    let ground = Ground::start().await;
    let wish = json!({ "cameras": ["haz1", "haz2", "haz3"], "resolution_m": 0.1 });
    let answer = ground.post("rover/cameras/coverage", &wish).await.json();
    let decode = |field: &str| {
        let text = answer[field].as_str().unwrap();
        base64::engine::general_purpose::STANDARD.decode(text).unwrap()
    };
    let (mask, hidden) = (decode("mask_base64"), decode("hidden_base64"));
    let size = [0, 1].map(|i| answer["size"][i].as_u64().unwrap() as usize);
    assert_eq!(hidden.len(), size[0] * size[1]);
    let told = answer["hidden"].as_array().unwrap();
    assert!(told.iter().any(|part| part["by"].as_str().unwrap().starts_with("leg")), "{told:?}");

    // By another method than rays: the middle of the link comes near the line of sight.
    let robot = ground.app().live.robot().clone();
    let posture = Posture::new(&robot, &ground.app().live.configuration().unwrap());
    let scene = RayScene::new(None, Some((&robot, &posture)));
    let toml = testkit::fixture_text("robots/athlete/robot.toml");
    let rig = stereo::rig::Rig::from_toml(&toml, &robot).unwrap();
    let map = map_of(&ground, &current(&ground).await);
    let origin = [0, 1].map(|i| answer["origin_m"][i].as_f64().unwrap());
    let mut areas = vec![0.0; told.len()];
    for (i, by) in hidden.iter().enumerate().filter(|(_, by)| **by > 0) {
        assert_eq!(mask[2 * i..2 * i + 2], [0, 0], "what a pair sees is not hidden");
        areas[usize::from(*by) - 1] += 0.01;
        let name = told[usize::from(*by) - 1]["by"].as_str().unwrap();
        let p = [i % size[0], i / size[0]];
        let p = nalgebra::Point2::new(origin[0] + 0.1 * p[0] as f64, origin[1] + 0.1 * p[1] as f64);
        let foot = nalgebra::Point3::new(p.x, p.y, map.height_at(p).unwrap());
        let near = |eye: nalgebra::Point3<f64>| {
            let parts = scene.solids().iter().filter(|solid| match robot.body_of(solid.link) {
                Some((leg, _)) => robot.leg(leg).name == name,
                None => robot.links()[solid.link.0].name == name,
            });
            parts.clone().any(|solid| {
                (0..=400)
                    .any(|k| solid.distance(&(eye + (foot - eye) * (f64::from(k) / 400.0))) < 0.01)
            })
        };
        let eyes = ["haz1", "haz2", "haz3"].map(|name| rig.pair(name).unwrap().cameras(&posture));
        assert!(eyes.iter().flatten().any(|eye| near(eye.center())), "{name} at {p}");
    }
    for (part, area) in told.iter().zip(areas) {
        assert!((part["area_m2"].as_f64().unwrap() - area).abs() < 1e-6, "{part}");
    }
}
