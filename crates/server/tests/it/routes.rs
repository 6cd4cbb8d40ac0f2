//! Routes one by one: what they give, with which headers.

use axum::body::Body;
use axum::http::Request;
use serde_json::{Value, json};

use crate::support::Ground;

#[tokio::test]
async fn the_rover_and_its_model_are_told() {
    let ground = Ground::start().await;
    let rover = ground.get("/api/v1/rover").await.json();
    assert_eq!(rover["model"]["legs"].as_array().unwrap().len(), 6);
    assert_eq!(rover["model"]["mass_kg"].as_f64().unwrap().round(), 1150.0);
    assert!(rover["stability"]["regular"]["margin_m"].as_f64().unwrap() > 0.15);
    let urdf = ground.get("/api/v1/robots/athlete/urdf").await;
    assert!(String::from_utf8(urdf.bytes).unwrap().contains("<robot"));
    assert_eq!(ground.get("/api/v1/robots/..%2F..%2Fetc/urdf").await.code(), "robot_unknown");
    assert_eq!(ground.get("/health").await.bytes, b"ok\n");
}

#[tokio::test]
async fn a_tile_is_immutable_and_answered_once() {
    let ground = Ground::start().await;
    let versions = ground.get("/api/v1/terrain/versions").await.json();
    let version = versions["current"].as_str().unwrap();
    for layer in ["height", "goodness", "class"] {
        let path = format!("/api/v1/terrain/{version}/tiles/{layer}/0/0/0");
        let tile = ground.get(&path).await;
        assert_eq!(tile.status, 200);
        assert_eq!(&tile.bytes[..4], b"FFT1");
        let etag = tile.headers["etag"].clone();
        assert!(tile.headers["cache-control"].to_str().unwrap().contains("immutable"));
        let again = Request::get(&path).header("if-none-match", etag).body(Body::empty()).unwrap();
        assert_eq!(ground.send(again).await.status, 304);
        let zipped = Request::get(&path).header("accept-encoding", "gzip").body(Body::empty());
        let zipped = ground.send(zipped.unwrap()).await;
        assert_eq!(zipped.headers["content-encoding"], "gzip");
        assert!(zipped.bytes.len() < tile.bytes.len());
    }
    for (path, code) in [
        ("tiles/height/0/9/0", "tile_unknown"),
        ("tiles/height/2/0/0", "tile_unknown"),
        ("tiles/height/1/1/0", "tile_unknown"),
        ("tiles/height/99999999999/0/0", "tile_unknown"),
        ("tiles/nothing/0/0/0", "tile_unknown"),
        ("tiles/height/0/-1/0", "query_invalid"),
    ] {
        let answer = ground.get(&format!("/api/v1/terrain/{version}/{path}")).await;
        assert_eq!(answer.code(), code, "{path}");
    }
    assert_eq!(
        ground.get("/api/v1/terrain/none/tiles/height/0/0/0").await.code(),
        "terrain_unknown"
    );
}

#[tokio::test]
async fn a_cell_tells_what_is_known_of_it() {
    let ground = Ground::start().await;
    let versions = ground.get("/api/v1/terrain/versions").await.json();
    let path = |query: &str| {
        format!("/api/v1/terrain/{}/cell?{query}", versions["current"].as_str().unwrap())
    };
    let cell = ground.get(&path("x_m=0.5&y_m=-0.5")).await.json();
    assert!(cell["height_m"].is_number() && cell["goodness"].is_number(), "{cell}");
    let outside = ground.get(&path("x_m=500&y_m=0")).await.json();
    assert_eq!((&outside["height_m"], &outside["class"]), (&json!(null), &json!(0)));
    for query in ["x_m=1", "x_m=1&y_m=a", "x_m=1&y_m=2&z_m=3", ""] {
        assert_eq!(ground.get(&path(query)).await.code(), "query_invalid", "{query}");
    }
    for query in ["x_m=NaN&y_m=0", "x_m=inf&y_m=0"] {
        assert_eq!(ground.get(&path(query)).await.code(), "not_finite", "{query}");
    }
    let components = cell["components"].as_array().unwrap();
    let least = components.iter().map(|c| c["goodness"].as_f64().unwrap()).fold(1.0, f64::min);
    assert!((least - cell["goodness"].as_f64().unwrap()).abs() < 1e-6, "{cell}");
    assert!(components.iter().all(|c| c["reason"].as_str().unwrap().len() > 20), "{cell}");
    let coarse = ground.get(&path("").replace("cell?", "tiles/height/1/0/0")).await;
    let fine = ground.get(&path("").replace("cell?", "tiles/height/0/0/0")).await;
    // At zoom 1 every second node is left, the first of them the same.
    let info = &versions["versions"][0];
    let n = (info["size"][0].as_u64().unwrap() as usize - 1) / 2 + 1;
    assert_eq!((&info["zooms"], coarse.bytes.len()), (&json!(2), 64 + 4 * n * n));
    let apart = 2.0 * info["resolution_m"].as_f64().unwrap();
    assert_eq!(coarse.bytes[32..40], apart.to_le_bytes());
    assert_eq!(coarse.bytes[64..68], fine.bytes[64..68]);
    assert_eq!(coarse.bytes[68..72], fine.bytes[72..76]);
    let export = |query: &str| path("").replace("cell?", &format!("export{query}"));
    let tiff = ground.get(&export("")).await;
    assert_eq!(&tiff.bytes[..4], b"II*\0");
    let ply = ground.get(&export("?format=ply")).await;
    assert!(ply.bytes.starts_with(b"ply\n"), "a mesh");
    let simple = ground.get(&export("?format=ply&error_m=0.05")).await;
    assert!(4 * simple.bytes.len() < ply.bytes.len(), "{} bytes", simple.bytes.len());
    let obj = ground.get(&export("?format=obj&error_m=0.1")).await;
    assert!(obj.bytes.starts_with(b"# FootFall map"));
    for (query, code) in [
        ("?format=dxf", "query_invalid"),
        ("?error_m=-1", "out_of_range"),
        ("?error_m=NaN", "not_finite"),
        ("?size=3", "query_invalid"),
    ] {
        assert_eq!(ground.get(&export(query)).await.code(), code, "{query}");
    }
}

#[tokio::test]
async fn files_are_uploaded_listed_and_imported() {
    let ground = Ground::start().await;
    let off = "OFF\n4 2 0\n0 0 0\n30 0 0\n0 30 0\n30 30 0\n3 0 1 2\n3 1 3 2\n";
    let put = |name: &str, body: Vec<u8>| {
        Request::put(format!("/api/v1/terrain/files/{name}")).body(Body::from(body)).unwrap()
    };
    let answer = ground.send(put("flat.off", off.into())).await;
    assert_eq!(answer.status, 200, "{}", answer.json());
    let files = ground.get("/api/v1/terrain/files").await.json();
    assert_eq!(files["files"], json!([{ "name": "flat.off", "size": off.len() }]));
    let request = json!({ "file": "flat.off", "place_m": [15.0, 15.0] });
    let report = ground.job(&ground.post("terrain/imports", &request).await).await;
    assert_eq!(report["state"], "done", "{report}");
    let current = ground.get("/api/v1/terrain/versions").await.json()["versions"][0].clone();
    assert_eq!(current["source"], "flat.off");
    let ply = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n\
               property float z\nend_header\n0 0 0\n30 0 0\n0 30 0\n30 30 0\n";
    assert_eq!(ground.send(put("flat.ply", ply.into())).await.status, 200);
    let request = json!({ "file": "flat.ply", "cell_m": 30.0, "place_m": [15.0, 15.0] });
    let report = ground.job(&ground.post("terrain/imports", &request).await).await;
    assert_eq!(report["state"], "done", "{report}");
    for name in [
        "..%2Fflat.off",
        "%2e%2e%2fflat.off",
        "a%00.off",
        ".hidden.off",
        "flat.exe",
        "x%5C..%5Cy.off",
    ] {
        let answer = ground.send(put(name, off.into())).await;
        assert_eq!(answer.code(), "file_name_invalid", "{name}");
    }
    assert_eq!(std::fs::read_dir(ground.dir.path().join("terrain")).unwrap().count(), 2);
    let bad = ground.send(put("bad.tif", b"no tiff".to_vec())).await;
    assert_eq!(bad.status, 200);
    let report =
        ground.job(&ground.post("terrain/imports", &json!({ "file": "bad.tif" })).await).await;
    assert_eq!(report["error"]["code"], "terrain_file_invalid", "{report}");
    let missing = ground.post("terrain/imports", &json!({ "file": "none.tif" })).await;
    assert_eq!((missing.status.as_u16(), missing.code().as_str()), (404, "terrain_file_unknown"));
}

#[tokio::test]
async fn the_link_changes_while_it_runs() {
    let ground = Ground::start().await;
    let change = json!({ "up_delay_s": 0.5, "down_delay_s": 0.25 });
    let answer = ground.call("PUT", "/api/v1/link", Some(&change)).await;
    assert_eq!(answer.json()["config"], change);
    let bad = json!({ "up_delay_s": -1.0, "down_delay_s": 0.0 });
    let refused = ground.call("PUT", "/api/v1/link", Some(&bad)).await;
    assert_eq!(refused.code(), "out_of_range");
    assert_eq!(refused.json()["error"]["details"]["field"], "up_delay_s");
    assert_eq!(ground.get("/api/v1/link").await.json()["config"], change);
}

#[tokio::test]
async fn a_log_is_listed_downloaded_and_replayed() {
    let ground = Ground::start().await;
    ground.clock.run_at(20.0);
    let listed = || async {
        let logs = ground.get("/api/v1/logs").await.json();
        logs["logs"][0]["messages"].as_u64().unwrap_or(0) > 50
    };
    ground.until("messages in the log", listed).await;
    let id = ground.get("/api/v1/logs").await.json()["logs"][0]["id"].as_str().unwrap().to_owned();
    let download = ground.get(&format!("/api/v1/logs/{id}/download")).await;
    assert_eq!(&download.bytes[1..5], b"MCAP");
    assert_eq!(download.headers["content-type"], "application/x-mcap");
    // A bookmark, and a clip that takes it along.
    let start = ground.get(&format!("/api/v1/logs/{id}")).await.json()["start"].clone();
    let mark = json!({ "at": start, "text": "here it begins" });
    let marked = ground.post(&format!("logs/{id}/bookmarks"), &mark).await;
    assert_eq!(marked.status, 201, "{}", marked.json());
    let listed = ground.get(&format!("/api/v1/logs/{id}/bookmarks")).await.json();
    assert_eq!(listed["bookmarks"], json!([marked.json()]));
    let clip =
        ground.post(&format!("logs/{id}/clips"), &json!({ "channels": ["rover/state"] })).await;
    assert_eq!(clip.status, 201, "{}", clip.json());
    let clip = clip.json()["id"].as_str().unwrap().to_owned();
    let bytes = ground.get(&format!("/api/v1/logs/{clip}/download")).await.bytes;
    let mut attached = Vec::new();
    let damage = bridge::reader::scan_items(&*bytes, bridge::reader::Limits::default(), |item| {
        match item {
            bridge::reader::Item::Message(_, m) => assert_eq!(&*m.channel, "rover/state"),
            bridge::reader::Item::Attachment { name, data, .. } => attached.push((name, data)),
            _ => {}
        }
        true
    });
    assert_eq!(damage.unwrap(), []);
    let (_, marks) = attached.iter().find(|(name, _)| name == "footfall.bookmarks").unwrap();
    assert_eq!(serde_json::from_slice::<Value>(marks).unwrap(), listed);
    // Of the clip they are listed as of any log, and removing them from the log leaves them there.
    let of_the_clip = format!("/api/v1/logs/{clip}/bookmarks");
    assert_eq!(ground.get(&of_the_clip).await.json(), listed);
    let gone = format!("/api/v1/logs/{id}/bookmarks/{}", marked.json()["id"].as_str().unwrap());
    assert_eq!(ground.call("DELETE", &gone, None).await.status, 204);
    assert_eq!(ground.call("DELETE", &gone, None).await.code(), "bookmark_unknown");
    assert_eq!(ground.get(&of_the_clip).await.json(), listed);
    let replay = ground.post("replays", &json!({ "log": id, "rate": 2.0 })).await;
    assert_eq!(replay.status, 201, "{}", replay.json());
    let path = format!("/api/v1/replays/{}", replay.json()["id"].as_str().unwrap());
    let end = replay.json()["end"].clone();
    let change = json!({ "at": end, "paused": true });
    let changed = ground.call("PATCH", &path, Some(&change)).await.json();
    assert_eq!((&changed["at"], &changed["paused"]), (&end, &json!(true)));
    let back = json!({ "at": start, "paused": true, "step": true });
    let stepped = ground.call("PATCH", &path, Some(&back)).await;
    assert_eq!((stepped.status.as_u16(), &stepped.json()["paused"]), (200, &json!(true)));
    let bad = ground.call("PATCH", &path, Some(&json!({ "rate": 0.0 }))).await;
    assert_eq!(bad.code(), "rate_invalid");
    assert_eq!(ground.call("DELETE", &path, None).await.status, 204);
    assert_eq!(ground.get(&path).await.code(), "replay_unknown");

    // A long log is opened as a job.
    let request = json!({ "log": id, "rate": 2.0 }).to_string();
    let request = Request::post("/api/v1/replays")
        .header("content-type", "application/json")
        .header("prefer", "respond-async, wait=1")
        .body(Body::from(request))
        .unwrap();
    let report = ground.job(&ground.send(request).await).await;
    assert_eq!((&report["kind"], &report["state"]), (&json!("replay"), &json!("done")), "{report}");
    let path = report["result"].as_str().unwrap();
    let opened = ground.get(path).await.json();
    assert_eq!((&opened["log"], &opened["rate"]), (&json!(id), &json!(2.0)));
    assert_eq!(ground.call("DELETE", path, None).await.status, 204);
    for id in ["..%2F..%2Fetc%2Fpasswd", "nothing", "%2e%2e"] {
        let answer = ground.get(&format!("/api/v1/logs/{id}/download")).await;
        assert_eq!(answer.code(), "log_unknown", "{id}");
        let answer = ground.post("replays", &json!({ "log": id, "rate": 1.0 })).await;
        assert_eq!(answer.code(), "log_unknown", "{id}");
    }
}

#[tokio::test]
async fn commands_by_hand_are_checked_and_a_repeat_stages_nothing_twice() {
    let ground = Ground::start().await;
    let rover = ground.get("/api/v1/rover").await.json();
    let joints = rover["latest"]["frame"]["state"]["joints_rad"]["leg1"].clone();
    let knots =
        json!([{ "joints_rad": joints, "time_s": 0 }, { "joints_rad": joints, "time_s": 1 }]);
    let id = "018f6b1c-7b1a-7000-8000-000000000001";
    let request =
        json!({ "id": id, "body": { "type": "joint_path", "leg": "leg1", "knots": knots } });
    let mut dry = request.clone();
    dry["dry_run"] = json!(true);
    assert_eq!(ground.post("commands", &dry).await.status, 200);
    assert_eq!(ground.get("/api/v1/commands").await.json()["commands"], json!([]));
    for _ in 0..2 {
        let staged = ground.post("commands", &request).await;
        assert_eq!((staged.status.as_u16(), &staged.json()["id"]), (201, &json!(id)));
    }
    assert_eq!(
        ground.get("/api/v1/commands").await.json()["commands"].as_array().unwrap().len(),
        1
    );
    let cancelled = ground.post(&format!("commands/{id}/cancel"), &json!({})).await;
    assert_eq!(cancelled.json()["state"], "cancelled");
    let line =
        |p: [f64; 3]| json!({ "body": { "type": "wheel_line", "leg": "leg1", "position_m": p } });
    assert_eq!(ground.post("commands", &line([99.0, 0.0, 0.0])).await.code(), "command_invalid");
    let far = json!([{ "joints_rad": [0, 0, 0, 0, 0, 9], "time_s": 0 }, { "joints_rad": joints, "time_s": 1 }]);
    let far = json!({ "body": { "type": "joint_path", "leg": "leg1", "knots": far } });
    assert_eq!(ground.post("commands", &far).await.code(), "out_of_range");
    let shift = |knots: serde_json::Value| json!({ "dry_run": true, "body": { "type": "body_path", "knots": knots } });
    let all = rover["latest"]["frame"]["state"]["joints_rad"].clone();
    let knot =
        |joints: &serde_json::Value, time: f64| json!({ "joints_rad": joints, "time_s": time });
    let good = ground.post("commands", &shift(json!([knot(&all, 0.0), knot(&all, 2.5)]))).await;
    assert_eq!(good.status, 200, "{}", good.json());
    assert_eq!(good.json()["title"], "Shift the body through 2 knots");
    assert_eq!(good.json()["duration_s"], 2.5);
    let mut five = all.clone();
    five.as_object_mut().unwrap().remove("leg4");
    let mut beyond = all.clone();
    beyond["leg2"][2] = json!(9);
    let mut off = all.clone();
    off["leg2"][0] = json!(all["leg2"][0].as_f64().unwrap() + 0.1);
    for (knots, code, text) in [
        (json!([knot(&all, 0.0)]), "command_invalid", "body.knots takes two knots or more"),
        (
            json!([knot(&five, 0.0), knot(&five, 1.0)]),
            "command_invalid",
            "lacks leg4, which stands",
        ),
        (
            json!([knot(&all, 0.0), knot(&five, 1.0)]),
            "command_invalid",
            "other legs than the first",
        ),
        (
            json!([knot(&all, 0.0), knot(&beyond, 1.0)]),
            "out_of_range",
            "knots[1].joints_rad.leg2[2] is 9",
        ),
        (json!([knot(&off, 0.0), knot(&all, 1.0)]), "command_invalid", "it is 0.1000 rad away"),
        (json!([knot(&all, 2.0), knot(&all, 1.0)]), "out_of_range", "knots[1].time_s is 1;"),
        (json!(vec![knot(&all, 0.0); 1001]), "too_many", "body.knots has 1001 elements"),
    ] {
        let answer = ground.post("commands", &shift(knots)).await;
        assert_eq!(answer.code(), code, "{}", answer.json());
        assert!(answer.json().to_string().contains(text), "{}", answer.json());
    }
    let both = json!({ "plan": { "plan_id": "x", "index": 0 }, "body": { "type": "stop" } });
    assert_eq!(ground.post("commands", &both).await.code(), "target_ambiguous");
}

#[tokio::test]
async fn a_job_is_cancelled_and_remembered() {
    let ground = Ground::start().await;
    assert_eq!(ground.get("/api/v1/jobs").await.json(), json!([]));
    let plan = ground.plan("leg1", [0.2, 0.0]).await;
    assert!(plan["id"].is_string());
    let jobs = ground.get("/api/v1/jobs").await.json();
    assert_eq!(jobs.as_array().unwrap().len(), 1);
    let path = format!("/api/v1/jobs/{}", jobs[0]["id"].as_str().unwrap());
    assert_eq!(ground.call("DELETE", &path, None).await.code(), "job_ended");
    assert_eq!(ground.call("DELETE", "/api/v1/jobs/none", None).await.code(), "job_unknown");
}

#[tokio::test]
async fn the_console_or_a_word_about_it_is_served_with_its_headers() {
    let ground = Ground::start().await;
    for path in ["/", "/anywhere"] {
        let page = ground.get(path).await;
        assert_eq!(page.status, 200);
        assert!(page.headers["content-type"].to_str().unwrap().starts_with("text/html"));
        assert_eq!(page.headers["x-content-type-options"], "nosniff");
        let policy = page.headers["content-security-policy"].to_str().unwrap();
        assert!(policy.starts_with("default-src 'self'"), "{policy}");
    }
    for path in
        ["/missing.js", "/../Cargo.toml", "/%2e%2e/Cargo.toml", "/assets/../../../Cargo.toml"]
    {
        assert_eq!(ground.get(path).await.status, 404, "{path}");
    }
    assert_eq!(ground.get("/api/v1/nothing").await.code(), "route_unknown");
    assert_eq!(ground.call("DELETE", "/api/v1/rover", None).await.code(), "method_not_allowed");
}

#[tokio::test]
async fn who_asks_from_elsewhere_is_refused() {
    let ground = Ground::start().await;
    let request = Request::post("/api/v1/estop").header("origin", "https://evil.example");
    let refused = ground.send(request.body(Body::empty()).unwrap()).await;
    assert_eq!((refused.status.as_u16(), refused.code().as_str()), (403, "origin_refused"));
    let request = Request::get("/api/v1/rover").header("host", "evil.example");
    let refused = ground.send(request.body(Body::empty()).unwrap()).await;
    assert_eq!((refused.status.as_u16(), refused.code().as_str()), (403, "host_refused"));
    assert_eq!(ground.get("/api/v1/link").await.json()["estop"], "clear");
}
