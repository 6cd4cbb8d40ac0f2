//! A foot that was put down corrects the map that cameras made.

use std::process::Command;

use nalgebra::{Point2, Point3, Vector3};
use rover::Posture;
use serde_json::{Value, json};
use wire::reconstruction::ContactStep;

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
    // No point of a standing wheel is below the ground of the map: points of its solid, by number.
    let map = &ground.app().store.current().map;
    let robot = ground.app().live.robot();
    let posture = Posture::new(robot, &ground.app().live.configuration().unwrap());
    for leg in robot.leg_ids() {
        let wheel = posture.wheel(robot, leg);
        // What is told of the wheel is pressed down by its preload.
        let contact = &ground.frame().await["contact_points_m"][&robot.leg(leg).name];
        let contact = Point3::from([0, 1, 2].map(|i| contact[i].as_f64().unwrap()));
        let is_inside = |up: f64| {
            let p = wheel.world_from_wheel.inverse() * (contact - Vector3::z() * up);
            p.y.abs() < 0.5 * wheel.width && p.x.hypot(p.z) < wheel.radius
        };
        let sunk = f64::from((0..60).find(|i| !is_inside(2e-4 * f64::from(*i))).unwrap()) * 2e-4;
        for i in 0..20_000 {
            let share = |n: i32| f64::from(i % n) / f64::from(n - 1);
            let angle = f64::from(i) * 2.399_963;
            let rim = Vector3::new(angle.cos(), 0.0, angle.sin()) * wheel.radius;
            let along = Vector3::y() * (share(41) - 0.5) * wheel.width;
            let p = wheel.world_from_wheel * Point3::from(rim * share(7) + along);
            let Some(of_map) = map.height_at(p.xy()) else { continue };
            assert!(
                p.z + sunk - of_map > -1e-6,
                "leg {}: {p} is {} m in the ground",
                leg.0,
                of_map - p.z
            );
        }
    }
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
            let d = p - Point2::new(x, y);
            let new = *after.map.heights().at(ix, iy);
            let lowered = d.norm() < 0.45 && new < old;
            assert!(d.norm() < 0.17 || lowered, "{p} is not under the wheel: {old} {new}");
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

#[test]
fn a_contact_of_an_old_log_is_understood_and_written_as_it_was() {
    let old = json!({
        "wheels": [{ "leg": "leg1", "contact_m": [1.0, 2.0, 0.5] }],
        "wheel_radius_m": 0.264,
        "time": "2026-11-23T12:00:03.224125598Z",
    });
    let step: ContactStep = serde_json::from_value(old.clone()).unwrap();
    assert_eq!(step.wheels[0].solid, None);
    assert_eq!(serde_json::to_value(&step).unwrap(), old);
}
