//! What is laid over the ground: textures of camera images, imported rasters.

use axum::body::Body;
use axum::http::Request;
use geometry::Grid;
use nalgebra::Point2;
use serde_json::{Value, json};
use terrain::Placement;
use terrain::formats::geotiff;
use wire::check::At;

use crate::support::{Answer, Ground};

/// The pixels of a PNG, and how many bytes each has.
fn pixels(answer: &Answer) -> (usize, usize, Vec<u8>) {
    let mut reader =
        png::Decoder::new(std::io::Cursor::new(&answer.bytes[..])).read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut pixels).unwrap();
    pixels.truncate(info.buffer_size());
    (info.width as usize, info.height as usize, pixels)
}

async fn current(ground: &Ground) -> String {
    ground.get("/api/v1/terrain/versions").await.json()["current"].as_str().unwrap().to_owned()
}

async fn reconstruct(ground: &Ground, request: &Value) -> String {
    let report = ground.job(&ground.post("terrain/reconstructions", request).await).await;
    assert_eq!(report["state"], "done", "{report}");
    current(ground).await
}

#[tokio::test]
async fn what_pairs_saw_lies_over_the_ground_that_they_saw() {
    let ground = Ground::start().await;
    let imported = current(&ground).await;
    let none = ground.get(&format!("/api/v1/terrain/{imported}/texture")).await;
    assert_eq!((none.status.as_u16(), none.code().as_str()), (404, "texture_none"));
    let wish = json!({ "cameras": ["haz1", "nav1"], "scale": 0.5, "seed": 7, "keep_prior": true });
    let version = reconstruct(&ground, &wish).await;
    let path = format!("/api/v1/terrain/{version}/texture");
    let told = ground.get(&path).await.json();
    assert_eq!(told["terrain_version"], json!(version));
    let views = told["views"].as_array().unwrap();
    let mut names: Vec<&str> = views.iter().map(|view| view["pair"].as_str().unwrap()).collect();
    names.sort_unstable();
    assert_eq!(names, ["haz1", "nav1"]);
    let shares: f64 = views.iter().map(|view| view["share"].as_f64().unwrap()).sum();
    assert!((shares - 1.0).abs() < 1e-9, "{told}");
    let number = |pointer: &str| told.pointer(pointer).unwrap().as_f64().unwrap();
    let texel = number("/shape/texel_m");
    assert_eq!(texel, 0.02);
    // Every known texel is over known ground that no solid of the robot hides from above the camera's image: it is
    // ground that a pair has in its image, and the tiles have as many known texels as is told.
    let map = ground.app().store.get(&At::root("v"), &version).unwrap().map.clone();
    let rig = ground.app().live.rig().clone();
    let robot = ground.app().live.robot().clone();
    let state = ground.app().live.configuration().unwrap();
    let posture = rover::Posture::new(&robot, &state);
    let cameras: Vec<_> = ["haz1", "nav1"]
        .iter()
        .map(|name| rig.pair(name).unwrap().cameras(&posture)[0].clone())
        .collect();
    let (tiles_x, tiles_y) = (number("/shape/tiles/0") as usize, number("/shape/tiles/1") as usize);
    let (mut n_known, mut n_bright, mut n_seen) = (0_usize, 0_usize, 0_usize);
    for (x, y) in (0..tiles_x).flat_map(|x| (0..tiles_y).map(move |y| (x, y))) {
        let answer = ground.get(&format!("{path}/{x}/{y}")).await;
        assert_eq!(answer.status, 200);
        let (w, h, pixels) = pixels(&answer);
        for (k, pixel) in pixels.chunks_exact(2).enumerate() {
            if pixel[1] == 0 {
                continue;
            }
            n_known += 1;
            n_bright += usize::from(pixel[0] > 20);
            let at = |tile: usize, i: usize| (256 * tile + i) as f64 + 0.5;
            let p = Point2::new(
                number("/shape/origin_m/0") + texel * at(x, k % w),
                number("/shape/origin_m/1") + texel * at(y, h - 1 - k / w),
            );
            let z = map.height_at(p).expect("over known ground");
            let point = nalgebra::Point3::new(p.x, p.y, z);
            // Fits move the picture by centimeters.
            let sees = |camera: &stereo::camera::Camera| {
                let size = camera.size();
                camera.project(&point).is_some_and(|q| {
                    (-20.0..size.width as f64 + 20.0).contains(&q.x)
                        && (-20.0..size.height as f64 + 20.0).contains(&q.y)
                })
            };
            n_seen += usize::from(cameras.iter().any(sees));
        }
    }
    let size = number("/shape/size/0") * number("/shape/size/1");
    assert!((n_known as f64 / size - number("/known_share")).abs() < 1e-9);
    assert!(n_known > 20_000 && n_seen == n_known, "{n_seen} of {n_known}");
    assert!(n_bright * 10 > n_known * 5, "{n_bright} of {n_known} are bright");
    assert_eq!(ground.get(&format!("{path}/{tiles_x}/0")).await.code(), "tile_unknown");
    let tif = ground.get(&format!("/api/v1/terrain/{version}/export?format=texture")).await;
    assert_eq!((tif.status.as_u16(), &tif.bytes[..4]), (200, &b"II\x2a\0"[..]));
    let classes = ground.get(&format!("/api/v1/terrain/{version}/export?format=classes")).await;
    assert_eq!(classes.status, 200);

    // Without a pair its image is gone too.
    let source = views.iter().find(|v| v["pair"] == "nav1").unwrap()["source"].as_u64().unwrap();
    let gone =
        ground.call("DELETE", &format!("/api/v1/terrain/{version}/pairs/{source}"), None).await;
    let left = gone.json()["version"].as_str().unwrap().to_owned();
    let told = ground.get(&format!("/api/v1/terrain/{left}/texture")).await.json();
    assert_eq!(told["views"].as_array().unwrap().len(), 1);
    assert_eq!(told["views"][0]["pair"], "haz1");
}

#[tokio::test]
async fn a_raster_is_laid_over_the_ground_told_and_removed() {
    let ground = Ground::start().await;
    let put = async |name: &str, bytes: Vec<u8>| {
        let request = Request::put(format!("/api/v1/terrain/files/{name}"))
            .header("host", "localhost")
            .header("x-operator", "anna")
            .body(Body::from(bytes))
            .unwrap();
        assert_eq!(ground.send(request).await.status, 200);
    };
    let grid = Grid { origin: Point2::new(-3.0, -2.0), resolution: 0.25, nx: 24, ny: 16 };
    let gray: Vec<u8> = (0..grid.len()).map(|i| (i % 251) as u8).collect();
    let alpha: Vec<u8> = (0..grid.len()).map(|i| if i == 5 { 0 } else { 255 }).collect();
    put("over.tif", geotiff::write_picture(&grid, &gray, &alpha, &Placement::default()).unwrap())
        .await;
    let added = ground.post("terrain/overlays", &json!({ "file": "over.tif" })).await;
    assert_eq!(added.status, 201, "{}", added.json());
    let told = added.json();
    assert_eq!(told["shape"]["size"], json!([24, 16]));
    assert_eq!(told["shape"]["origin_m"], json!([-3.125, -2.125]));
    assert_eq!((&told["gray"], &told["stretch"]), (&json!(true), &Value::Null));
    let id = told["id"].as_str().unwrap();
    let tile = ground.get(&format!("/api/v1/terrain/overlays/{id}/0/0")).await;
    let (w, h, texels) = pixels(&tile);
    assert_eq!((w, h), (24, 16));
    for (k, texel) in texels.chunks_exact(4).enumerate() {
        let i = grid.index(k % w, h - 1 - k / w);
        let g = gray[i];
        assert_eq!(texel, if i == 5 { [0; 4] } else { [g, g, g, 255] });
    }
    // What does not fit is refused by name.
    let far = Grid { origin: Point2::new(900.0, 900.0), ..grid };
    put("far.tif", geotiff::write_picture(&far, &gray, &alpha, &Placement::default()).unwrap())
        .await;
    put("none.tif", b"II\x2a\0 and no more".to_vec()).await;
    for (file, status, code) in [
        ("far.tif", 422, "overlay_elsewhere"),
        ("none.tif", 422, "terrain_file_invalid"),
        ("gone.tif", 404, "terrain_file_unknown"),
        ("over.png", 422, "file_name_invalid"),
        ("../over.tif", 422, "file_name_invalid"),
    ] {
        let refused = ground.post("terrain/overlays", &json!({ "file": file })).await;
        assert_eq!((refused.status.as_u16(), refused.code().as_str()), (status, code), "{file}");
    }
    for _ in 1..8 {
        assert_eq!(
            ground.post("terrain/overlays", &json!({ "file": "over.tif" })).await.status,
            201
        );
    }
    let full = ground.post("terrain/overlays", &json!({ "file": "over.tif" })).await;
    assert_eq!(full.code(), "too_many");
    let path = format!("/api/v1/terrain/overlays/{id}");
    assert_eq!(ground.call("DELETE", &path, None).await.status, 204);
    assert_eq!(ground.call("DELETE", &path, None).await.code(), "overlay_unknown");
    assert_eq!(ground.get(&format!("{path}/0/0")).await.code(), "overlay_unknown");
    assert_eq!(
        ground.get("/api/v1/terrain/overlays").await.json()["overlays"].as_array().unwrap().len(),
        7
    );
    // The next server has them as they were: the same identities and texels. One whose file has changed is told.
    let listed = ground.get("/api/v1/terrain/overlays").await.json()["overlays"].clone();
    let one = listed[0]["id"].as_str().unwrap().to_owned();
    let tile = ground.get(&format!("/api/v1/terrain/overlays/{one}/0/0")).await.bytes;
    let dir = ground.finish().await;
    let again = async |dir: crate::support::TempDir| {
        Ground::of(server::serve::Mission::of(crate::support::config(dir.path())), dir).await
    };
    let list = async |ground: &Ground| {
        ground.get("/api/v1/terrain/overlays").await.json()["overlays"].clone()
    };
    let ground = again(dir).await;
    ground.until("the rasters", || async { list(&ground).await == listed }).await;
    assert_eq!(ground.get(&format!("/api/v1/terrain/overlays/{one}/0/0")).await.bytes, tile);
    let dir = ground.finish().await;
    let file = dir.path().join("terrain/over.tif");
    let other = geotiff::write_picture(&grid, &alpha, &alpha, &Placement::default()).unwrap();
    std::fs::write(&file, [other, vec![0; 9]].concat()).unwrap();
    let ground = again(dir).await;
    let why = |ground: &Ground| {
        let (n, why) = ground.app().overlays.bring_back(&ground.app().store.current().map);
        assert_eq!(n, 0);
        why.join("; ")
    };
    assert!(why(&ground).contains("over.tif: its file is another now"), "{}", why(&ground));
    // A list that is none harms nothing.
    let dir = ground.finish().await;
    std::fs::write(dir.path().join("terrain/.overlays.json"), b"{\"ground\": 3}").unwrap();
    let ground = again(dir).await;
    assert!(why(&ground).contains("cannot be used"), "{}", why(&ground));
    assert_eq!(list(&ground).await, json!([]));
    let added = ground.post("terrain/overlays", &json!({ "file": "over.tif" })).await;
    assert_eq!(added.status, 201, "{}", added.json());
    // Another ground has none of them.
    let import = json!({ "recipe": { "name": "smooth_mare", "width_m": 20.0 }, "seed": 3 });
    let report = ground.job(&ground.post("terrain/imports", &import).await).await;
    assert_eq!(report["state"], "done", "{report}");
    assert_eq!(ground.get("/api/v1/terrain/overlays").await.json()["overlays"], json!([]));
}
