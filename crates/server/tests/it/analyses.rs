//! The analyses: over HTTP as on the command line.

use axum::body::Body;
use axum::http::Request;
use serde_json::{Value, json};

use crate::command_line::footfall;
use crate::support::Ground;

/// A scene that is the same over HTTP and on the command line: nothing of the live rover in it.
fn scene() -> Value {
    let bent = [0.0, -0.05235987756, 2.00712863979, 0.0, -0.38397243544, 0.0];
    let joints: serde_json::Map<String, Value> =
        (1..=6).map(|leg| (format!("leg{leg}"), json!(bent))).collect();
    json!({
        "robot": "athlete", "scale": 1.0, "gravity_m_s2": 1.62,
        "payloads": [{ "link": "chassis", "mass_kg": 120, "com_m": [0, 0, 0.4] }],
        "terrain": { "plane": {} },
        "obstacles": [{ "box_m": [0.3, 0.3, 0.4], "position_m": [4, 0, 0.2],
                        "orientation_xyzw": [0, 0, 0, 1] }],
        "state": { "base": { "position_m": [0, 0, standing_height()],
                             "orientation_xyzw": [0, 0, 0, 1] }, "joints_rad": joints }
    })
}

/// Height of the base at which the wheels of the bent stance touch level ground: hip 0.36 m below
/// the base, thigh 0.735 m at -3 degrees, calf 0.489 m at 112 degrees, fork 0.552 m at 90 degrees,
/// wheel 0.264 m; positive pitch lowers the leg.
fn standing_height() -> f64 {
    let sin = |degrees: f64| degrees.to_radians().sin();
    0.36 + 0.735 * sin(-3.0) + 0.489 * sin(112.0) + 0.552 * sin(90.0) + 0.264
}

fn requests() -> Vec<(&'static str, Value)> {
    let contact = |x: f64, y: f64| json!({ "position_m": [x, y, 0.0] });
    vec![
        ("kinematics", json!({ "scene": scene(), "links": true })),
        (
            "inverse-kinematics",
            json!({ "scene": scene(), "leg": "leg2", "targets": [
                { "position_m": [1.2, 2.0, 0.264], "axis": [0, 0, -1] },
                { "position_m": [50, 0, 0], "axis": [0, 0, -1] },
            ] }),
        ),
        (
            "stability",
            json!({ "cases": [{ "contacts": [contact(0.0, 0.0), contact(2.0, 0.0), contact(0.0, 2.0)],
                                "com_m": [0.5, 0.5, 1.0], "mass_kg": 100 }] }),
        ),
        ("reachability", json!({ "scene": scene(), "legs": ["leg1"], "resolution_m": 0.25 })),
        (
            "traversability",
            json!({ "terrain": { "recipe": { "name": "boulder_field", "width_m": 6.0 }, "seed": 2 } }),
        ),
        (
            "plan",
            json!({ "scene": scene(), "leg": "leg1", "target": { "position_m": [2.4, 0.2, 0.0] } }),
        ),
        (
            "posture",
            json!({ "scene": scene(), "rehearsal": { "settlement_m": 0.2 },
                    "advice": { "leg": "leg1", "conservative_m": 0.05, "replace": false } }),
        ),
    ]
}

/// The answer without what depends on the machine's speed.
fn timeless(mut answer: Value) -> Value {
    if let Some(statistics) = answer.get_mut("statistics").and_then(Value::as_object_mut) {
        statistics.retain(|name, _| !name.ends_with("_ms"));
    }
    answer
}

#[tokio::test]
async fn http_and_command_line_give_the_same_answers() {
    let ground = Ground::start().await;
    for (name, request) in requests() {
        let over_http = ground.post(&format!("analysis/{name}"), &request).await;
        assert_eq!(over_http.status, 200, "{name}: {}", over_http.json());
        let run = footfall(&[name, "-", "--json"], &request.to_string());
        assert_eq!(run.status, 0, "{name}: {}", run.errors);
        let on_command_line: Value = serde_json::from_str(&run.output).unwrap();
        assert_eq!(timeless(on_command_line), timeless(over_http.json()), "{name}");
    }
}

#[tokio::test]
async fn the_bent_stance_stands_where_its_angles_say() {
    let ground = Ground::start().await;
    let answer = ground.post("analysis/kinematics", &json!({ "scene": scene() })).await.json();
    let state = &answer["states"][0];
    assert_eq!(state["standing"].as_array().unwrap().len(), 6, "{state}");
    assert_eq!(state["self_collision"], Value::Null);
    assert_eq!(state["terrain_collision"], Value::Null);
    let cos = |degrees: f64| degrees.to_radians().cos();
    // Leg 1 points along x: hip at 1.341 m, hip pitch 0.351 m further out.
    let x = 1.341 + 0.351 + 0.735 * cos(-3.0) + 0.489 * cos(112.0) + 0.552 * cos(90.0);
    let contact = &state["wheels"]["leg1"]["contact_m"];
    for (value, expected) in [(&contact[0], x), (&contact[1], 0.0), (&contact[2], 0.0)] {
        assert!((value.as_f64().unwrap() - expected).abs() < 1e-8, "{contact} {x}");
    }
}

#[tokio::test]
async fn what_is_left_out_is_the_live_rovers() {
    let ground = Ground::start().await;
    let live = ground.post("analysis/kinematics", &json!({})).await.json();
    let rover = ground.get("/api/v1/rover").await.json();
    let contact = &rover["latest"]["frame"]["contact_points_m"]["leg3"];
    let computed = &live["states"][0]["wheels"]["leg3"]["contact_m"];
    for i in 0..3 {
        let difference = contact[i].as_f64().unwrap() - computed[i].as_f64().unwrap();
        assert!(difference.abs() < 1e-3, "{contact} {computed}");
    }
    let com = rover["stability"]["com_m"][2].as_f64().unwrap();
    assert!((live["states"][0]["com_m"][2].as_f64().unwrap() - com).abs() < 1e-9);
}

#[tokio::test]
async fn grids_come_in_binary_when_asked_for() {
    let ground = Ground::start().await;
    let request = json!({ "legs": ["leg1"], "resolution_m": 0.2 });
    let binary = Request::post("/api/v1/analysis/reachability")
        .header("content-type", "application/json")
        .header("accept", "application/octet-stream")
        .body(Body::from(request.to_string()))
        .unwrap();
    let binary = ground.send(binary).await;
    let json = ground.post("analysis/reachability", &request).await.json();
    let size = &json["legs"]["leg1"]["size"];
    let n = (size[0].as_u64().unwrap() * size[1].as_u64().unwrap()) as usize;
    assert_eq!(binary.bytes.len(), 64 + (2 * n).next_multiple_of(4) + 8 * n);
    assert_eq!(&binary.bytes[..4], b"FFT1");
    let classes = &binary.bytes[64..64 + n];
    assert_eq!(
        json["legs"]["leg1"]["class"].as_str().unwrap(),
        wire::analysis::base64_bytes(classes)
    );
    assert!(classes.contains(&4) && classes.contains(&1), "some cells can be reached, some not");
    assert_eq!(json["legend"]["class"][4], "reachable");
}

#[tokio::test]
async fn a_plan_depends_on_its_inputs_alone() {
    let ground = Ground::start().await;
    let request = json!({
        "scene": scene(), "leg": "leg1", "target": { "position_m": [2.4, 0.2, 0.0] },
        "planner": "sbl", "seed": 5, "budget": 5000
    });
    let first = ground.post("analysis/plan", &request).await.json();
    let second = ground.post("analysis/plan", &request).await.json();
    assert_eq!(first["outcome"], "found", "{first}");
    assert_eq!(timeless(first), timeless(second));
}

#[tokio::test]
async fn a_leg_has_as_many_numbers_as_joints() {
    let ground = Ground::start().await;
    // Thigh and calf of 0.2 m at ±0.8 rad from the vertical, a ball of 0.02 m below.
    let height = 0.4 * 0.8_f64.cos() + 0.02;
    let joints: serde_json::Map<String, Value> = ["FL", "FR", "RL", "RR"]
        .map(|leg| (leg.to_owned(), json!([0.0, 0.8, -1.6])))
        .into_iter()
        .collect();
    let scene = json!({
        "robot": "quadruped", "payloads": [], "terrain": { "plane": {} },
        "state": { "base": { "position_m": [0, 0, height], "orientation_xyzw": [0, 0, 0, 1] },
                   "joints_rad": joints }
    });
    let answer = ground.post("analysis/kinematics", &json!({ "scene": scene })).await.json();
    let state = &answer["states"][0];
    assert_eq!(state["standing"].as_array().unwrap().len(), 4, "{state}");
    assert_eq!(state["joint_torques_nm"]["FL"].as_array().unwrap().len(), 3);
    assert_eq!(state["terrain_collision"], Value::Null);

    let ask = |target: Value| json!({ "scene": scene, "leg": "FL", "targets": [target] });
    let foot = json!({ "position_m": [0.2, 0.14, 0.03] });
    let found = ground.post("analysis/inverse-kinematics", &ask(foot)).await.json();
    let target = &found["targets"][0];
    assert_eq!(target["solutions"][0].as_array().unwrap().len(), 3, "{found}");
    assert!(target["residuals"][0]["position_m"].as_f64().unwrap() < 1e-9);
    for (position, proven) in [(json!([9, 0, 0]), true), (json!([0.2, 0.14, height]), false)] {
        let request = ask(json!({ "position_m": position }));
        let none = ground.post("analysis/inverse-kinematics", &request).await.json();
        assert_eq!(none["targets"][0]["unreachable"]["proven"], proven, "{none}");
    }
    let turned = json!({ "position_m": [0.2, 0.14, 0.03], "axis": [0, 0, -1] });
    let refused = ground.post("analysis/inverse-kinematics", &ask(turned)).await;
    assert_eq!(refused.code(), "target_ambiguous");

    let mut six = scene.clone();
    six["state"]["joints_rad"]["FL"] = json!([0, 0, 0, 0, 0, 0]);
    let refused = ground.post("analysis/kinematics", &json!({ "scene": six })).await;
    assert_eq!(refused.code(), "joint_count");
}

#[tokio::test]
async fn a_tool_cuts_the_range_of_a_joint() {
    let ground = Ground::start().await;
    let with = |tool: Value| {
        let mut scene = scene();
        scene["payloads"] = json!([tool]);
        json!({ "scene": scene, "leg": "leg1",
                "targets": [{ "position_m": [1.5, 0.9, 0.264], "axis": [0, 0, -1] }] })
    };
    let tool = |limits: Value| {
        json!({ "link": "chassis", "mass_kg": 50, "com_m": [0, 0, 0.1], "limits_rad": limits,
                "shapes": [{ "position_m": [0, 0, 0.3], "cylinder_m": [0.1, 0.5] }] })
    };
    let free = ground.post("analysis/inverse-kinematics", &with(tool(json!({})))).await.json();
    assert!(!free["targets"][0]["solutions"].as_array().unwrap().is_empty(), "{free}");
    let cut = with(tool(json!({ "leg1_hip_yaw": [-0.2, 0.2] })));
    let cut = ground.post("analysis/inverse-kinematics", &cut).await.json();
    assert!(cut["targets"][0]["solutions"].as_array().unwrap().is_empty(), "{cut}");
    let wide = with(tool(json!({ "leg1_hip_yaw": [-3.1, 0.2] })));
    let refused = ground.post("analysis/inverse-kinematics", &wide).await;
    assert_eq!(refused.code(), "payload_invalid");
    let mut both = tool(json!({}));
    both["shapes"][0]["sphere_m"] = json!(0.1);
    let refused = ground.post("analysis/inverse-kinematics", &with(both)).await;
    assert_eq!(refused.code(), "payload_invalid");
}

#[tokio::test]
async fn the_rover_executes_what_the_adviser_proposes() {
    for (leg, margin_m, change) in [("leg1", 0.2, "chassis"), ("leg2", 0.3, "fold")] {
        let ground = Ground::start().await;
        let advice = json!({ "leg": leg, "conservative_m": margin_m, "replace": false });
        let request = json!({ "advice": advice, "deadline_s": 300 });
        let answer = ground.post("analysis/posture", &request).await.json();
        let advice = &answer["advice"];
        assert_eq!(advice["outcome"], "found", "{advice}");
        let proposal = &advice["proposals"][0];
        assert_eq!(proposal["change"], change, "{proposal}");
        for command in proposal["commands"].as_array().unwrap() {
            let ended = ground.execute_body(&command["body"]).await;
            assert_eq!(ended["state"], "done", "{ended}");
        }
        let there = || async {
            let frame = ground.frame().await;
            let base = &frame["state"]["base"]["position_m"];
            let end = &proposal["end"]["base"]["position_m"];
            let off = |i: usize| base[i].as_f64().unwrap() - end[i].as_f64().unwrap();
            frame["mode"] == "idle" && off(0).hypot(off(1)).hypot(off(2)) < 0.01
        };
        ground.until("the rover in the posture proposed", there).await;
    }
}
