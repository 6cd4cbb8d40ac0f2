//! The main job: plan, stage, arm, send, and see the wheel at its new footfall; then the log.

use bridge::catalog;
use bridge::reader::Limits;
use serde_json::{Value, json};

use crate::support::Ground;

#[tokio::test]
async fn a_planned_step_brings_the_wheel_to_its_footfall_and_is_in_the_log() {
    let ground = Ground::start().await;
    let plan = ground.plan("leg1", [0.25, 0.1]).await;
    assert_eq!(plan["outcome"], "found", "{plan}");
    assert!(plan["findings"].as_array().unwrap().iter().all(|f| f["ok"] == true));
    assert_eq!(phases(&plan["commands"]), ["lift", "transit", "drop", "preload"]);
    let id = plan["id"].as_str().unwrap();
    for index in 0..3 {
        let ended = ground.execute(id, index).await;
        assert_eq!(ended["state"], "done", "{ended}");
    }
    let there = || async {
        let frame = ground.frame().await;
        frame["mode"] == "idle"
            && frame["contacts"]["leg1"] == true
            && ground.off_footfall(&plan).await < 1e-6
    };
    ground.until("the wheel at its footfall", there).await;
    let put_down_n = load_n(&ground.frame().await, "leg1");
    assert_eq!(ground.execute(id, 3).await["state"], "done");
    until_idle(&ground).await;
    let preload_n = plan["preload_n"].as_f64().unwrap();
    let pressed_n = load_n(&ground.frame().await, "leg1");
    let pressed = pressed_n >= preload_n && pressed_n > put_down_n;
    assert!(pressed, "{put_down_n} N, then {pressed_n} N of {preload_n} N");
    let rover = ground.get("/api/v1/rover").await.json();
    let log = rover["log_id"].as_str().unwrap().to_owned();

    let dir = ground.finish().await;
    let logs = dir.path().join("logs");
    let info = catalog::log_info(&logs, &log).unwrap();
    let content = catalog::read_log(&logs, &log, Limits::default()).unwrap();
    assert_eq!(content.messages.len() as u64, info.messages);
    assert!(content.damage.is_empty(), "{:?}", content.damage);
    let of = |channel: &str| content.messages.iter().filter(|m| &*m.channel == channel).count();
    assert_eq!(of("command/uplink"), 4);
    assert!(of("rover/state") > 50 && of("rover/state") == of("rover/stability"));
}

fn phases(commands: &Value) -> Vec<&str> {
    commands.as_array().unwrap().iter().map(|c| c["phase"].as_str().unwrap()).collect()
}

/// Force of the ground on a wheel (N).
fn load_n(frame: &Value, leg: &str) -> f64 {
    frame["wheel_forces_n"][leg][2].as_f64().unwrap()
}

/// Largest change of any coordinate between two vectors of numbers.
fn apart(a: &Value, b: &Value) -> f64 {
    let number = |v: &Value| v.as_f64().unwrap();
    let pairs = a.as_array().unwrap().iter().zip(b.as_array().unwrap());
    pairs.map(|(a, b)| (number(a) - number(b)).abs()).fold(0.0, f64::max)
}

/// The demo's own ground, on which some legs stand at the edge of the conservative support.
async fn on_uneven_ground() -> Ground {
    Ground::with(|config| config.terrain.width_m = 24.0).await
}

/// Where base and wheels are, as last reported.
async fn places(ground: &Ground) -> (Value, Value) {
    let at = ground.post("analysis/kinematics", &json!({})).await.json()["states"][0].take();
    (ground.frame().await["state"]["base"]["position_m"].take(), at["wheels"].clone())
}

async fn until_idle(ground: &Ground) {
    ground.until("rest", || async { ground.frame().await["mode"] == "idle" }).await;
}

#[tokio::test]
async fn a_conservative_step_shifts_the_body_over_its_feet_first() {
    let ground = on_uneven_ground().await;
    let wish = json!({ "stability": "conservative" });
    let plan = ground.plan_with("leg3", [-0.15, -0.15], wish).await;
    assert_eq!(plan["outcome"], "found", "{plan}");
    assert_eq!(phases(&plan["commands"]), ["shift", "lift", "transit", "drop", "preload"]);
    let id = plan["id"].as_str().unwrap();
    // All may be staged at once; each holds when its turn comes.
    let (base, wheels) = places(&ground).await;
    let shifted = ground.execute(id, 0).await;
    assert_eq!((&shifted["state"], &shifted["title"]), (&json!("done"), &json!("Shift the body")));
    until_idle(&ground).await;
    let (base_now, wheels_now) = places(&ground).await;
    assert!(apart(&base, &base_now) > 0.05, "{base} {base_now}");
    for (leg, wheel) in wheels.as_object().unwrap() {
        let slip = apart(&wheel["position_m"], &wheels_now[leg]["position_m"]);
        assert!(slip < 0.002, "{leg} slips by {slip} m");
    }
    let planned = plan["waypoints"].as_array().unwrap().iter().rfind(|w| w["phase"] == "shift");
    let planned = &planned.unwrap()["stance"]["base"]["position_m"];
    assert!(apart(planned, &base_now) < 0.001, "{planned} {base_now}");
    for index in 1..5 {
        let ended = ground.execute(id, index).await;
        assert_eq!(ended["state"], "done", "{ended}");
    }
    let there = || async { ground.off_footfall(&plan).await < 0.02 };
    ground.until("the wheel at its footfall", there).await;
    until_idle(&ground).await;
    assert!(ground.frame().await["contacts"].as_object().unwrap().values().all(|c| c == true));
    assert!(apart(&base_now, &places(&ground).await.0) < 1e-9);
}

#[tokio::test]
async fn a_shift_held_by_the_wheel_drives_goes_where_brakes_do_not() {
    let ground = on_uneven_ground().await;
    let wish = |drive_hold| json!({ "stability": "conservative", "drive_hold": drive_hold });
    let plan = ground.plan_with("leg2", [0.1, 0.1], wish(true)).await;
    assert_eq!(plan["outcome"], "found", "{plan}");
    let body = &plan["commands"][0]["body"];
    assert_eq!((&body["type"], &body["drive_hold"]), (&json!("body_path"), &json!(true)));
    let id = plan["id"].as_str().unwrap();
    for index in 0..phases(&plan["commands"]).len() {
        let ended = ground.execute(id, index).await;
        assert_eq!(ended["state"], "done", "{ended}");
    }
    // The same path with brakes on is one that the rover refuses: the wheels would slip.
    until_idle(&ground).await;
    let mut back = plan["retreat"].as_array().unwrap().last().unwrap()["body"].clone();
    let start = ground.frame().await["state"]["joints_rad"].clone();
    back["knots"].as_array_mut().unwrap().iter_mut().for_each(|knot| {
        knot["joints_rad"]["leg2"] = start["leg2"].clone();
    });
    back["drive_hold"] = json!(false);
    let ended = ground.execute_body(&back).await;
    assert_eq!(ended["state"], "failed", "{ended}");
    assert!(ended["why"].as_str().unwrap().contains("slip"), "{ended}");
}

#[tokio::test]
async fn a_step_that_was_begun_is_backed_out() {
    let ground = on_uneven_ground().await;
    let wish = json!({ "stability": "conservative" });
    let plan = ground.plan_with("leg3", [-0.15, -0.15], wish).await;
    let id = plan["id"].as_str().unwrap();
    let before = places(&ground).await;
    let back = |index| json!({ "plan": { "plan_id": id, "index": index, "retreat": true } });
    assert_eq!(ground.post("commands", &back(4)).await.code(), "not_executed");
    let dry = json!({ "dry_run": true, "plan": { "plan_id": id, "index": 4, "retreat": true } });
    assert_eq!(ground.post("commands", &dry).await.code(), "not_executed");
    assert_eq!(ground.post("commands", &back(5)).await.code(), "command_index");
    for index in 0..3 {
        assert_eq!(ground.execute(id, index).await["state"], "done");
    }
    until_idle(&ground).await;
    assert_eq!(ground.post("commands", &back(0)).await.code(), "not_executed");
    // A later part may be staged; it waits for its turn.
    let staged = ground.post("commands", &back(4)).await;
    assert_eq!(staged.status, 201, "{}", staged.json());
    let last = staged.json()["id"].as_str().unwrap().to_owned();
    let early = ground.post(&format!("commands/{last}/arm"), &json!({})).await;
    assert_eq!((early.status.as_u16(), early.code().as_str()), (409, "order"));
    assert_eq!(ground.post(&format!("commands/{last}/cancel"), &json!({})).await.status, 200);

    let forward = json!({ "plan": { "plan_id": id, "index": 3 } });
    let forward = ground.post("commands", &forward).await.json()["id"].as_str().unwrap().to_owned();
    let titles = ["Move leg3 back", "Put leg3 back", "Shift the body back"];
    for (index, title) in (2..5).zip(titles) {
        let ended = ground.execute_back(id, index).await;
        assert_eq!((&ended["state"], &ended["title"]), (&json!("done"), &json!(title)), "{ended}");
        until_idle(&ground).await;
        if index == 2 {
            let record = ground.get(&format!("/api/v1/commands/{forward}")).await.json();
            assert_eq!(record["state"], "expired", "{record}");
        }
    }
    let after = places(&ground).await;
    assert!(apart(&before.0, &after.0) < 0.001, "{before:?} {after:?}");
    for (leg, wheel) in before.1.as_object().unwrap() {
        assert!(apart(&wheel["position_m"], &after.1[leg]["position_m"]) < 0.002, "{leg}");
    }
    let anew = json!({ "plan": { "plan_id": id, "index": 0 } });
    assert_eq!(ground.post("commands", &anew).await.code(), "backing_out");
    assert_eq!(ground.plan("leg3", [-0.15, -0.15]).await["outcome"], "found");
}

#[tokio::test]
async fn what_ended_elsewhere_is_not_undone() {
    let ground = Ground::start().await;
    let plan = ground.plan("leg1", [0.25, 0.1]).await;
    let id = plan["id"].as_str().unwrap();
    assert_eq!(ground.execute(id, 0).await["state"], "done");
    until_idle(&ground).await;
    // By hand the leg goes on from there.
    let now = ground.frame().await["state"]["joints_rad"]["leg1"].clone();
    let mut there = now.clone();
    there[0] = json!(now[0].as_f64().unwrap() + 0.05);
    let knots =
        json!([{ "joints_rad": now, "time_s": 0.0 }, { "joints_rad": there, "time_s": 1.0 }]);
    let body = json!({ "type": "joint_path", "leg": "leg1", "knots": knots });
    let request = json!({ "plan": { "plan_id": id, "index": 3, "retreat": true } });
    let staged = ground.post("commands", &request).await.json();
    assert_eq!(ground.execute_body(&body).await["state"], "done");
    until_idle(&ground).await;
    let path = format!("commands/{}/arm", staged["id"].as_str().unwrap());
    let armed = ground.post(&path, &json!({})).await;
    assert_eq!((armed.status.as_u16(), armed.code().as_str()), (409, "basis_changed"));
}

#[tokio::test]
async fn a_step_that_cannot_be_names_what_is_missing() {
    let ground = on_uneven_ground().await;
    let wish = json!({ "stability": "conservative", "shift": "never" });
    let unstable = ground.plan_with("leg4", [0.1, 0.0], wish).await;
    assert_eq!(unstable["outcome"], "unstable", "{unstable}");
    let constraint = &unstable["constraint"];
    assert_eq!((&constraint["name"], &constraint["unit"]), (&json!("stability"), &json!("m")));
    assert!(constraint["missing"].as_f64().unwrap() > 0.01, "{constraint}");
    let request = json!({ "plan": { "plan_id": unstable["id"], "index": 0 } });
    assert_eq!(ground.post("commands", &request).await.code(), "plan_not_sendable");

    let far = ground.plan("leg1", [1.3, 0.0]).await;
    assert_eq!(far["outcome"], "unreachable", "{far}");
    let constraint = &far["constraint"];
    assert_eq!((&constraint["name"], &constraint["unit"]), (&json!("reach"), &json!("m")));
    assert!(constraint["missing"].as_f64().unwrap() > 0.1, "{constraint}");
    let request = json!({ "leg": "leg1", "target": { "position_m": far["nearest_m"] } });
    let report = ground.job(&ground.post("plans", &request).await).await;
    let near = ground.get(report["result"].as_str().unwrap()).await.json();
    assert_eq!(near["outcome"], "found", "{near}");
    assert_eq!(ground.execute(near["id"].as_str().unwrap(), 0).await["state"], "done");
}

#[tokio::test]
async fn a_plan_that_no_longer_holds_is_not_sent() {
    let ground = Ground::start().await;
    let plan = ground.plan("leg1", [0.2, 0.0]).await;
    let other = ground.plan("leg2", [0.1, 0.1]).await;
    let (plan, other) = (plan["id"].as_str().unwrap(), other["id"].as_str().unwrap());
    let request = json!({ "plan": { "plan_id": other, "index": 0 } });
    let staged = ground.post("commands", &request).await;
    assert_eq!(staged.status, 201, "{}", staged.json());
    assert_eq!(ground.execute(plan, 0).await["state"], "done");
    // The other leg has moved since: the staged command expires at the latest when it is armed.
    let id = staged.json()["id"].as_str().unwrap().to_owned();
    let moved = || async {
        let rover = ground.get("/api/v1/rover").await.json();
        rover["latest"]["frame"]["contacts"]["leg1"] == false
    };
    ground.until("the lifted leg", moved).await;
    let armed = ground.post(&format!("commands/{id}/arm"), &json!({})).await;
    assert_eq!((armed.status.as_u16(), armed.code().as_str()), (409, "basis_changed"));
    let record = ground.get(&format!("/api/v1/commands/{id}")).await.json();
    assert_eq!(record["state"], "expired");
    let staged = ground.post("commands", &request).await;
    assert_eq!(staged.code(), "basis_changed");
}

#[tokio::test]
async fn an_estop_stops_the_rover_and_is_released_in_two_steps() {
    let ground = Ground::start().await;
    let plan = ground.plan("leg1", [0.25, 0.1]).await;
    let request = json!({ "plan": { "plan_id": plan["id"], "index": 0 } });
    let id = ground.post("commands", &request).await.json()["id"].as_str().unwrap().to_owned();
    for act in ["arm", "send"] {
        assert_eq!(ground.post(&format!("commands/{id}/{act}"), &json!({})).await.status, 200);
    }
    let path = format!("/api/v1/commands/{id}");
    let state = |name: &'static str| {
        let (ground, path) = (&ground, &path);
        move || async move { ground.get(path).await.json()["state"] == name }
    };
    ground.until("the motion", state("executing")).await;
    // An E-stop needs no body, no name and no content type.
    let answer = ground.call("POST", "/api/v1/estop", None).await;
    assert_eq!((answer.status.as_u16(), &answer.json()["state"]), (200, &json!("sent")));
    ground.until("the end of the motion", state("aborted")).await;
    let confirmed = || async { ground.get("/api/v1/link").await.json()["estop"] == "confirmed" };
    ground.until("the confirmation", confirmed).await;
    let arm = ground.post("commands", &json!({ "body": { "type": "stop" } })).await;
    let stop = arm.json()["id"].as_str().unwrap().to_owned();
    assert_eq!(
        ground.post(&format!("commands/{stop}/arm"), &json!({})).await.code(),
        "estop_in_force"
    );
    let first = ground.call("POST", "/api/v1/estop/release", None).await;
    let token = first.json()["token"].clone();
    assert!(token.is_string(), "{}", first.json());
    let wrong = ground.post("estop/release", &json!({ "token": "x" })).await;
    assert_eq!(wrong.code(), "token_unknown");
    let first = ground.call("POST", "/api/v1/estop/release", None).await;
    let second = ground.post("estop/release", &json!({ "token": first.json()["token"] })).await;
    assert_eq!(second.status, 200, "{}", second.json());
    let clear = || async { ground.get("/api/v1/link").await.json()["estop"] == "clear" };
    ground.until("the release", clear).await;
}

#[tokio::test]
async fn an_import_seats_the_rover_on_new_ground_and_only_while_it_is_idle() {
    let ground = Ground::start().await;
    let before = ground.get("/api/v1/terrain/versions").await.json()["current"].clone();
    let recipe = json!({ "name": "smooth_mare", "width_m": 12.0, "resolution_m": 0.1 });
    let request = json!({ "recipe": recipe, "seed": 3, "heading_rad": 0.5 });
    let report = ground.job(&ground.post("terrain/imports", &request).await).await;
    assert_eq!(report["state"], "done", "{report}");
    let versions = ground.get("/api/v1/terrain/versions").await.json();
    assert_ne!(versions["current"], before);
    assert_eq!(versions["versions"].as_array().unwrap().len(), 2);
    let rover = ground.get("/api/v1/rover").await.json();
    assert_eq!(rover["terrain_version"], versions["current"]);
    // Under an E-stop the rover is not placed anew.
    ground.call("POST", "/api/v1/estop", None).await;
    let stopped = || async {
        ground.get("/api/v1/rover").await.json()["latest"]["frame"]["mode"] == "stopped"
    };
    ground.until("the stop", stopped).await;
    let refused = ground.post("terrain/imports", &request).await;
    assert_eq!((refused.status.as_u16(), refused.code().as_str()), (409, "rover_busy"));
}
