//! The main job: plan, stage, arm, send, and see the wheel at its new footfall; then the log.

use bridge::catalog;
use bridge::reader::Limits;
use serde_json::json;

use crate::support::Ground;

#[tokio::test]
async fn a_planned_step_brings_the_wheel_to_its_footfall_and_is_in_the_log() {
    let ground = Ground::start().await;
    let plan = ground.plan("leg1", [0.25, 0.1]).await;
    assert_eq!(plan["outcome"], "found", "{plan}");
    assert!(plan["findings"].as_array().unwrap().iter().all(|f| f["ok"] == true));
    let phases: Vec<&str> =
        plan["commands"].as_array().unwrap().iter().map(|c| c["phase"].as_str().unwrap()).collect();
    assert_eq!(phases, ["lift", "transit", "drop"]);
    let id = plan["id"].as_str().unwrap();
    for index in 0..3 {
        let ended = ground.execute(id, index).await;
        assert_eq!(ended["state"], "done", "{ended}");
    }
    let there = || async {
        let rover = ground.get("/api/v1/rover").await.json();
        let frame = &rover["latest"]["frame"];
        frame["mode"] == "idle"
            && frame["contacts"]["leg1"] == true
            && ground.off_footfall(&plan).await < 1e-6
    };
    ground.until("the wheel at its footfall", there).await;
    let rover = ground.get("/api/v1/rover").await.json();
    let log = rover["log_id"].as_str().unwrap().to_owned();

    let dir = ground.finish().await;
    let logs = dir.path().join("logs");
    let info = catalog::log_info(&logs, &log).unwrap();
    let content = catalog::read_log(&logs, &log, Limits::default()).unwrap();
    assert_eq!(content.messages.len() as u64, info.messages);
    assert!(content.damage.is_empty(), "{:?}", content.damage);
    let of = |channel: &str| content.messages.iter().filter(|m| &*m.channel == channel).count();
    assert_eq!(of("command/uplink"), 3);
    assert!(of("rover/state") > 50 && of("rover/state") == of("rover/stability"));
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
