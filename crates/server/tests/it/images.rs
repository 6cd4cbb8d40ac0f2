//! Images of the rover: ordered as commands, sent over the link, served, logged, and made into maps again.

use std::process::Command;

use serde_json::{Value, json};
use testkit::note_skipped;

use server::serve::Mission;

use crate::support::{Ground, config};

fn order(pairs: &[&str]) -> Value {
    json!({ "type": "image", "pairs": pairs, "scale": 0.25, "simulated": { "seed": 5 } })
}

/// The capture of an ended command, once all of it has come or will not.
async fn captured(ground: &Ground, id: &str) -> Value {
    let path = format!("/api/v1/rover/images/{id}");
    let ended = || async { ground.get(&path).await.json()["state"] != "on_the_way" };
    ground.until("the images", ended).await;
    ground.get(&path).await.json()
}

#[tokio::test]
async fn images_are_a_command_like_any_other_and_are_served_whole() {
    let ground = Ground::start().await;
    // A dry run tells what it would cost, and stages nothing.
    let dry = json!({ "body": order(&["haz1"]), "dry_run": true });
    let answer = ground.post("commands", &dry).await;
    assert_eq!(answer.status, 200, "{}", answer.json());
    assert!(answer.json()["title"].as_str().unwrap().contains("haz1"), "{}", answer.json());
    let listed = ground.get("/api/v1/commands").await.json();
    assert_eq!(listed["commands"].as_array().unwrap().len(), 0);

    let record = ground.execute_body(&order(&["haz1", "nav2"])).await;
    assert_eq!(record["state"], "done", "{record}");
    let id = record["id"].as_str().unwrap();
    let capture = captured(&ground, id).await;
    assert_eq!(capture["state"], "complete", "{capture}");
    for (i, name) in ["haz1", "nav2"].iter().enumerate() {
        let pair = &capture["pairs"][i];
        assert_eq!((&pair["pair"], &pair["received"]), (&json!(name), &json!(true)));
        assert_eq!(pair["id"], format!("{id}/{name}"));
        assert_eq!(pair["bytes"], pair["bytes_total"]);
        for image in pair["images"].as_array().unwrap() {
            let png = ground.get(image["url"].as_str().unwrap()).await;
            assert_eq!(png.headers["content-type"], "image/png");
            let hash = blake3::hash(&png.bytes).to_hex().to_string();
            assert_eq!(image["hash"], hash);
            let decoded = stereo::codec::decode(&png.bytes).unwrap();
            let size = [decoded.size().width, decoded.size().height];
            assert_eq!(image["size_px"], json!(size));
            // Not an even gray: there is ground, and sky or shadow.
            let (mut low, mut high) = (u8::MAX, 0);
            for value in decoded.pixels() {
                (low, high) = (low.min(*value), high.max(*value));
            }
            assert!(high > low + 50, "{low} to {high}");
        }
    }
    let gone = ground.call("DELETE", &format!("/api/v1/rover/images/{id}"), None).await;
    assert_eq!((gone.status.as_u16(), gone.code().as_str()), (409, "images_ended"));
    for path in ["x", &format!("{id}/haz1/middle.png"), &format!("{id}/haz2/left.png")] {
        let answer = ground.get(&format!("/api/v1/rover/images/{path}")).await;
        assert_eq!(answer.code(), "image_unknown", "{path}");
    }
}

#[tokio::test]
async fn a_map_is_made_of_images_that_are_here_and_made_again_from_the_log() {
    let ground = Ground::start().await;
    let record = ground.execute_body(&order(&["haz1", "haz2"])).await;
    let id = record["id"].as_str().unwrap().to_owned();
    captured(&ground, &id).await;
    let here =
        json!({ "images": [format!("{id}/haz1"), format!("{id}/haz2")], "keep_prior": false });
    let report = ground.job(&ground.post("terrain/reconstructions", &here).await).await;
    assert_eq!(report["state"], "done", "{report}");
    let stages: Vec<&Value> =
        report["pairs"].as_array().unwrap().iter().map(|pair| &pair["stage"]).collect();
    assert_eq!(stages, ["fused", "fused"]);
    // Then more images, over the map from before, and one pair taken out.
    let more = json!({ "cameras": ["nav1"], "scale": 0.25, "seed": 3, "keep_prior": true });
    let more = ground.job(&ground.post("terrain/reconstructions", &more).await).await;
    assert_eq!(more["state"], "done", "{more}");
    let answer = ground.get(report["result"].as_str().unwrap()).await.json();
    assert_eq!(answer["pairs"][0]["capture"], json!(id));
    let versions = ground.get("/api/v1/terrain/versions").await.json();
    let current = versions["current"].as_str().unwrap().to_owned();
    let bad = json!({ "images": [format!("{id}/nav4")] });
    let refused = ground.post("terrain/reconstructions", &bad).await;
    assert_eq!(refused.code(), "image_unknown");
    assert_eq!(refused.json()["error"]["details"]["field"], "images[0]");

    let config = ground.dir.path().join("mission.toml");
    std::fs::write(&config, "[terrain]\nwidth_m = 14.0\n").unwrap();
    let log = ground.get("/api/v1/rover").await.json()["log_id"].as_str().unwrap().to_owned();
    let dir = ground.finish().await;
    let folder = dir.path().join("logs").join(log);
    let rebuild = |config: Option<&std::path::Path>| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_footfall"));
        command.args(["log", "rebuild"]).arg(&folder);
        if let Some(config) = config {
            command.arg("--config").arg(config);
        }
        let output = command.output().unwrap();
        let told: Value = serde_json::from_slice(&output.stdout).unwrap_or_default();
        (output.status.code(), told, String::from_utf8_lossy(&output.stderr).into_owned())
    };
    let (code, told, error) = rebuild(Some(&config));
    let versions = told["versions"].as_array().unwrap_or_else(|| panic!("{told} {error}"));
    assert_eq!(versions.len(), 2, "{told}");
    assert!(versions.iter().all(|version| version["same"] == true), "{told}");
    assert_eq!((code, &versions[0]["version"]), (Some(0), &answer["terrain_version"]));
    assert_eq!(versions[1]["version"], current);
    // Other ground beneath is told by name: what lies on it cannot be the same.
    let (code, told, _) = rebuild(None);
    assert_eq!((code, &told["versions"][0]["same"]), (Some(1), &json!(true)), "{told}");
    let why = told["versions"][1]["message"].as_str().unwrap_or_default();
    assert!(why.contains("configuration"), "{told}");

    // Readers of others see the same images.
    let test = "server::a_map_is_made_of_images_that_are_here_and_made_again_from_the_log";
    let files = bridge::catalog::log_files(
        &dir.path().join("logs"),
        folder.file_name().unwrap().to_str().unwrap(),
    )
    .unwrap();
    let web = testkit::project_dir().join("web");
    if web.join("node_modules/@mcap/core").is_dir() {
        let mut node = Command::new("node");
        let output = node.arg(web.join("conformance/mcap.mjs")).arg(&files[0]).output().unwrap();
        let counts = String::from_utf8_lossy(&output.stdout).into_owned();
        for topic in ["image", "calibration", "tf"] {
            assert!(counts.contains(&format!("/camera/haz1/left/{topic} 1\n")), "{counts}");
        }
    } else {
        note_skipped(test, "web/node_modules has no @mcap/core");
    }
    let Some(python) = std::env::var_os("FOOTFALL_PYTHON") else {
        return note_skipped(test, "FOOTFALL_PYTHON names no Python with the package mcap");
    };
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/camera_images.py");
    let output = Command::new(python).arg(script).args(&files).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let read = String::from_utf8(output.stdout).unwrap();
    assert_eq!(read, "6 images, 6 calibrations, 6 places\n");
}

/// How it ended that the map of the session before was to be made again.
async fn restored(ground: &Ground) -> Value {
    let first = || async {
        let jobs = ground.get("/api/v1/jobs").await.json();
        jobs.as_array().unwrap().iter().find(|job| job["kind"] == "restore").cloned()
    };
    let is_over = |job: &Value| job["state"] == "done" || job["state"] == "failed";
    ground.until("the map", || async { first().await.is_some_and(|job| is_over(&job)) }).await;
    first().await.unwrap()
}

#[tokio::test]
async fn a_server_that_is_started_again_makes_the_map_of_the_cameras_again() {
    let ground = Ground::start().await;
    let request =
        json!({ "cameras": ["haz1", "nav1"], "scale": 0.25, "seed": 3, "keep_prior": true });
    let report = ground.job(&ground.post("terrain/reconstructions", &request).await).await;
    assert_eq!(report["state"], "done", "{report}");
    let told = ground.get("/api/v1/terrain/versions").await.json();
    let version = told["current"].as_str().unwrap().to_owned();
    let before = told["versions"][0].clone();
    let images = ground.get("/api/v1/rover/images").await.json()["captures"].clone();
    let tile = format!("/api/v1/terrain/{version}/tiles/height/0/0/0");
    let heights = ground.get(&tile).await.bytes;
    let log = ground.get("/api/v1/rover").await.json()["log_id"].as_str().unwrap().to_owned();
    let mut dir = ground.finish().await;

    // Again and again: the logs of the sessions between have no images of their own, and one may have ended before its map
    // was made.
    let mut last = log.clone();
    for waits in [true, false, true] {
        let ground = Ground::of(Mission::of(config(dir.path())), dir).await;
        if !waits {
            dir = ground.finish().await;
            continue;
        }
        let job = restored(&ground).await;
        last = ground.get("/api/v1/rover").await.json()["log_id"].as_str().unwrap().to_owned();
        let result = format!("/api/v1/terrain/versions/{version}");
        assert_eq!((&job["state"], &job["result"]), (&json!("done"), &json!(result)), "{job}");
        let versions = ground.get("/api/v1/terrain/versions").await.json();
        // Where the rover stands elsewhere than it did its wheels have corrected the map since.
        let versions = versions["versions"].as_array().unwrap();
        let again = versions.iter().find(|v| v["version"] == version.as_str()).unwrap();
        for field in ["origin_m", "size", "z_range_m", "known_share", "pairs", "captured", "source"]
        {
            assert_eq!(again[field], before[field], "{field}");
        }
        assert_eq!(ground.get(&tile).await.bytes[64..], heights[64..]);
        let texture = ground.get(&format!("/api/v1/terrain/{version}/texture")).await;
        assert_eq!(texture.status, 200, "{}", texture.json());
        dir = ground.finish().await;
    }
    // The log between goes back to the first.
    let folder = |id: &str| dir.path().join("logs").join(id);
    let config_file = dir.path().join("mission.toml");
    std::fs::write(&config_file, "[terrain]\nwidth_m = 14.0\n").unwrap();
    let mut rebuild = Command::new(env!("CARGO_BIN_EXE_footfall"));
    rebuild.args(["log", "rebuild"]).arg(folder(&last)).arg("--config").arg(&config_file);
    let told: Value = serde_json::from_slice(&rebuild.output().unwrap().stdout).unwrap();
    assert_eq!(told["versions"][0], json!({ "version": version, "same": true }), "{told}");

    // On other ground it is not the same map, and is told as such; its images come back in any case.
    let mut other = config(dir.path());
    other.terrain.seed += 1;
    let ground = Ground::of(Mission::of(other), dir).await;
    let job = restored(&ground).await;
    assert_eq!(
        (&job["state"], &job["error"]["code"]),
        (&json!("failed"), &json!("map_not_restored")),
        "{job}"
    );
    assert_ne!(ground.get("/api/v1/terrain/versions").await.json()["current"], json!(version));
    let answer = ground.post("terrain/restore", &json!({ "log": log })).await;
    let report = ground.job(&answer).await;
    assert_eq!(report["state"], "failed", "{report}");
    let back = ground.get("/api/v1/rover/images").await.json()["captures"].clone();
    assert_eq!(back, images);
    assert_eq!(
        ground.post("terrain/restore", &json!({ "log": "none" })).await.code(),
        "log_unknown"
    );
    ground.finish().await;
}

#[tokio::test]
async fn a_lossy_narrow_link_brings_all_pieces_and_telemetry_does_not_wait() {
    let ground = Ground::start().await;
    let link = json!({
        "up_delay_s": 0.02, "down_delay_s": 0.02,
        "down": {
            "rate_bps": 1_000_000.0, "seed": 4,
            "loss": { "kind": "bernoulli", "probability": 0.1 }
        }
    });
    assert_eq!(ground.call("PUT", "/api/v1/link", Some(&link)).await.status, 200);
    let request = json!({ "cameras": ["haz3"], "scale": 0.25, "seed": 1, "keep_prior": false });
    let accepted = ground.post("terrain/reconstructions", &request).await;
    let report = ground.job(&accepted).await;
    assert_eq!(report["state"], "done", "{report}");
    let counters = ground.get("/api/v1/link").await.json()["down"].take();
    assert!(counters["dropped_by"]["loss"].as_u64().unwrap() > 3, "pieces were lost: {counters}");

    // What cannot come is told by the name of its pair; the job then ends by name, too.
    let dead = json!({
        "up_delay_s": 0.02, "down_delay_s": 0.02,
        "down": { "queues": { "bulk": { "bytes": 1, "when_full": "drop_newest" } } }
    });
    assert_eq!(ground.call("PUT", "/api/v1/link", Some(&dead)).await.status, 200);
    let accepted = ground.post("terrain/reconstructions", &request).await;
    // What is armed lapses on a fast clock.
    let started = || async {
        let commands = ground.get("/api/v1/commands").await.json();
        let last = commands["commands"].as_array().unwrap().last().cloned().unwrap_or_default();
        commands["commands"].as_array().unwrap().len() == 2 && last["sent"].is_string()
    };
    ground.until("the command", started).await;
    ground.clock.run_at(60.0);
    let report = ground.job(&accepted).await;
    assert_eq!(
        (&report["state"], &report["error"]["code"]),
        (&json!("failed"), &json!("images_missing"))
    );
    assert_eq!(report["pairs"][0]["stage"], "failed", "{report}");
    assert!(report["error"]["message"].as_str().unwrap().contains("haz3"), "{report}");
}
