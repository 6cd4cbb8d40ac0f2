//! A foot that was put down corrects the map that cameras made.

use std::process::Command;

use nalgebra::Point2;
use serde_json::{Value, json};

use crate::support::Ground;

/// The version in use.
async fn current(ground: &Ground) -> Value {
    let told = ground.get("/api/v1/terrain/versions").await.json();
    let versions = told["versions"].as_array().unwrap();
    versions.iter().find(|version| version["version"] == told["current"]).unwrap().clone()
}

#[tokio::test]
async fn where_a_wheel_was_put_down_the_map_has_its_height_and_a_log_gives_it_again() {
    let ground = Ground::start().await;
    let truth = ground.app().store.current().map.clone();
    let wish = json!({ "cameras": ["nav1", "haz1"], "scale": 0.25, "seed": 3, "keep_prior": true });
    let report = ground.job(&ground.post("terrain/reconstructions", &wish).await).await;
    assert_eq!(report["state"], "done", "{report}");
    let seen = current(&ground).await;

    // A step, command by command: the plan goes on holding when its wheel is told to the map.
    let plan = ground.plan("leg1", [0.25, -0.25]).await;
    assert_eq!(plan["outcome"], "found", "{plan}");
    let n_commands = plan["commands"].as_array().unwrap().len();
    let mut steps = Vec::new();
    for index in 0..n_commands {
        let record = ground.execute(plan["id"].as_str().unwrap(), index).await;
        assert_eq!(record["state"], "done", "{record}");
        // Whatever is asked of the rover once it stands knows of the wheel.
        let stands = ground.frame().await["contacts"]["leg1"] == true;
        for leg in ["leg1", "leg2"].into_iter().filter(|_| stands) {
            let asked = json!({ "advice": { "leg": leg }, "budget": 0 });
            let answer = ground.post("analysis/posture", &asked).await;
            assert_eq!(answer.status, 200, "{index}: {}", answer.json());
        }
        steps.push(current(&ground).await["changes"]["step"].clone());
    }
    assert_eq!(steps.last(), Some(&json!("contact")), "{steps:?}");
    let version = current(&ground).await;
    assert_eq!(version["changes"]["what"], "wheel contact: leg1");
    let frame = ground.frame().await;
    let [x, y, z] = [0, 1, 2].map(|i| frame["contact_points_m"]["leg1"][i].as_f64().unwrap());
    let name = version["version"].as_str().unwrap();
    let cell = ground.get(&format!("/api/v1/terrain/{name}/cell?x_m={x}&y_m={y}")).await.json();
    assert!((cell["height_m"].as_f64().unwrap() - z).abs() < 1e-3, "{cell} {z}");
    assert!(cell["seen"]["camera"].is_null() && cell["seen"]["prior"] == false, "{cell}");
    assert!((z - truth.height_at(Point2::new(x, y)).unwrap()).abs() < 0.05, "{z}");
    // It changed the ground under that wheel and nowhere else.
    let [before, after] = [&seen, &version].map(|v| v["version"].as_str().unwrap().to_owned());
    let at = wire::check::At::root("v");
    let [before, after] = [before, after].map(|v| ground.app().store.get(&at, &v).unwrap());
    let grid = *after.map.grid();
    let mut n_changed = 0;
    for (ix, iy) in (0..grid.ny).flat_map(|iy| (0..grid.nx).map(move |ix| (ix, iy))) {
        let p = grid.position(ix, iy);
        let old = before.map.heights().nearest(p).unwrap_or(f32::NAN);
        if old.to_bits() != after.map.heights().at(ix, iy).to_bits() {
            n_changed += 1;
            assert!((p - Point2::new(x, y)).norm() < 0.17, "{p} is not under the wheel");
        }
    }
    assert!((1..60).contains(&n_changed), "{n_changed}");
    // Nothing more to tell: the map stays what it is.
    tokio::time::sleep(std::time::Duration::from_millis(700)).await;
    assert_eq!(current(&ground).await["version"], version["version"]);

    let config = ground.dir.path().join("mission.toml");
    std::fs::write(&config, "[terrain]\nwidth_m = 14.0\n").unwrap();
    let log = ground.get("/api/v1/rover").await.json()["log_id"].as_str().unwrap().to_owned();
    let dir = ground.finish().await;
    let mut command = Command::new(env!("CARGO_BIN_EXE_footfall"));
    command.args(["log", "rebuild"]).arg(dir.path().join("logs").join(log));
    let output = command.arg("--config").arg(&config).output().unwrap();
    let told: Value = serde_json::from_slice(&output.stdout).unwrap_or_default();
    let versions = told["versions"].as_array().unwrap_or_else(|| panic!("{told}"));
    assert!(versions.iter().all(|version| version["same"] == true), "{told}");
    assert_eq!(versions.last().unwrap()["version"], version["version"], "{told}");
}
