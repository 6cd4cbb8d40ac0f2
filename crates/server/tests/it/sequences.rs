//! Commands by hand over HTTP: arcs, sequences in order and their first failure, preconditions on the
//! ground and on board, and the dry run check by check.

use axum::body::Body;
use axum::http::Request;
use serde_json::{Value, json};

use crate::support::{Answer, Ground};

async fn post(ground: &Ground, who: &str, path: &str, body: &Value) -> Answer {
    let request = Request::post(format!("/api/v1/{path}"))
        .header("content-type", "application/json")
        .header("x-operator", who)
        .body(Body::from(body.to_string()))
        .unwrap();
    ground.send(request).await
}

async fn done(ground: &Ground, body: Value) -> Value {
    let record = ground.execute_body(&body).await;
    assert_eq!(record["state"], "done", "{record}");
    record
}

fn mode(mode: &str) -> Value {
    json!({ "type": "mode", "mode": mode })
}

fn shows(field: &str, op: &str, value: Value) -> Value {
    json!({ "channel": "rover/state", "field": field, "op": op, "value": value, "max_age_s": 600 })
}

/// Position (m) and heading (rad) of the base, by the quaternion's own formula.
async fn place(ground: &Ground) -> [f64; 3] {
    let base = ground.frame().await["state"]["base"].clone();
    let p = |i: usize| base["position_m"][i].as_f64().unwrap();
    let q = |i: usize| base["orientation_xyzw"][i].as_f64().unwrap();
    let [x, y, z, w] = [q(0), q(1), q(2), q(3)];
    [p(0), p(1), (2.0 * (w * z + x * y)).atan2(1.0 - 2.0 * (y * y + z * z))]
}

#[tokio::test]
async fn an_arc_ends_where_its_chord_says() {
    let ground = Ground::start().await;
    let arc = json!({ "type": "drive_arc", "distance_m": 0.6, "turn_rad": 0.4, "course_rad": 0.3 });
    let refused = post(&ground, "ada", "commands", &json!({ "body": arc })).await;
    assert_eq!(refused.code(), "command_invalid", "the rover is not in mode driving");
    assert!(refused.json()["error"]["message"].as_str().unwrap().contains("mode driving"));
    done(&ground, mode("driving")).await;
    done(&ground, json!({ "type": "wheel_brake", "on": false })).await;
    let [x, y, heading] = place(&ground).await;
    done(&ground, arc).await;
    // A chord of an arc: 2 r sin(θ/2), half the turn to the left of the course.
    let (radius, half) = (0.6 / 0.4, 0.2_f64);
    let chord = 2.0 * radius * half.sin();
    let along = heading + 0.3 + half;
    let [to_x, to_y, to_heading] = place(&ground).await;
    let off = (to_x - x - chord * along.cos()).hypot(to_y - y - chord * along.sin());
    assert!(off < 0.02, "{off} m beside the end of the arc");
    assert!((to_heading - heading - 0.4).abs() < 0.02, "turned by {}", to_heading - heading);
}

#[tokio::test]
async fn steps_go_in_order_and_the_first_that_fails_ends_the_sequence() {
    let ground = Ground::start().await;
    let step = |body: Value| json!({ "body": body });
    let release = json!({ "type": "wheel_brake", "on": false });
    let sequence = |steps: Vec<Value>| json!({ "type": "sequence", "steps": steps });
    // In the other order the rover would refuse: told for the step before anything is sent.
    let wrong = sequence(vec![step(release.clone()), step(mode("driving"))]);
    let refused = post(&ground, "ada", "commands", &json!({ "body": wrong })).await;
    assert_eq!(refused.code(), "command_invalid");
    assert_eq!(refused.json()["error"]["details"]["field"], "body.steps[0]");

    let right = sequence(vec![step(mode("driving")), step(release)]);
    let record = done(&ground, right).await;
    assert_eq!(record["progress"], 1.0);
    let operation = ground.frame().await["operation"].clone();
    assert_eq!(operation["mode"], "driving");
    let brakes: Vec<&Value> =
        operation["wheels"].as_object().unwrap().values().map(|wheel| &wheel["brake"]).collect();
    assert_eq!(brakes, vec![&json!(false); 6]);

    // The second step waits for what the first has just undone.
    let waits = shows("operation.mode", "eq", json!("driving"));
    let failing = sequence(vec![
        step(mode("ready")),
        json!({ "body": mode("safe"), "preconditions": [waits] }),
        step(mode("driving")),
    ]);
    let record = ground.execute_body(&failing).await;
    assert_eq!(record["state"], "failed", "{record}");
    let why = record["why"].as_str().unwrap();
    assert!(why.starts_with("step 2 of 3:") && why.ends_with("step 3 was not begun"), "{why}");
    assert_eq!(ground.frame().await["operation"]["mode"], "ready", "step 3 was not begun");
}

#[tokio::test]
async fn what_held_when_it_was_sent_is_refused_on_board_when_it_holds_no_more() {
    let ground = Ground::with(|config| config.link.up_delay_s = 5.0).await;
    let send = async |request: Value| {
        let staged = post(&ground, "ada", "commands", &request).await;
        assert_eq!(staged.status, 201, "{}", staged.json());
        let id = staged.json()["id"].as_str().unwrap().to_owned();
        for act in ["arm", "send"] {
            let answer = post(&ground, "ada", &format!("commands/{id}/{act}"), &json!({})).await;
            assert_eq!(answer.status, 200, "{act}: {}", answer.json());
        }
        id
    };
    let first = send(json!({ "body": mode("driving") })).await;
    // As far as the ground knows the rover is in mode ready when this goes up, 2 s later.
    ground.clock.run_at(10.0);
    tokio::time::sleep(std::time::Duration::from_millis(200)).await;
    ground.clock.run_at(1.0);
    let waits = shows("operation.mode", "eq", json!("ready"));
    let second = send(json!({ "body": mode("safe"), "preconditions": [waits] })).await;
    ground.clock.run_at(10.0);
    let record = async |id: &str| ground.get(&format!("/api/v1/commands/{id}")).await.json();
    ground
        .until("both ends", || async {
            record(&first).await["state"] == "done" && record(&second).await["state"] == "failed"
        })
        .await;
    let why = record(&second).await["why"].clone();
    assert!(why.as_str().unwrap().contains("operation.mode is \"driving\""), "{why}");
    assert_eq!(ground.frame().await["operation"]["mode"], "driving");
}

async fn checks(ground: &Ground, who: &str, request: &Value) -> Value {
    let answer = post(ground, who, "commands/checks", request).await;
    assert_eq!(answer.status, 200, "{}", answer.json());
    answer.json()
}

fn outcome(report: &Value, name: &str) -> String {
    let checks = report["checks"].as_array().unwrap();
    let found = checks.iter().find(|check| check["check"] == name);
    found.unwrap_or_else(|| panic!("no check {name}"))["outcome"].as_str().unwrap().to_owned()
}

const ALL: [&str; 9] = [
    "content",
    "log",
    "estop",
    "connection",
    "rover",
    "authority",
    "order",
    "approval",
    "preconditions",
];

#[tokio::test]
async fn a_dry_run_tells_every_check_and_stages_nothing() {
    let ground = Ground::with(|config| config.commands.two_persons = "drive_arc".into()).await;
    let good = checks(&ground, "ada", &json!({ "body": mode("driving") })).await;
    assert_eq!(good["ready"], true, "{good}");
    assert!(good["duration_s"].as_f64().unwrap() > 0.0 && good["title"] == "Take mode driving");
    for name in ALL {
        assert_eq!(outcome(&good, name), "passed", "{name}");
    }

    let step = |body: Value, waits: Vec<Value>| json!({ "body": body, "preconditions": waits });
    let steps = [
        step(mode("driving"), vec![shows("operation.mode", "eq", json!("safe"))]),
        step(json!({ "type": "wheel_brake", "on": false }), vec![]),
        // A wheel that stands is not rolled.
        step(json!({ "type": "wheel_roll", "leg": "leg1", "angle_rad": 1.0 }), vec![]),
        step(
            json!({ "type": "drive_arc", "distance_m": 0.2 }),
            vec![shows("mode", "eq", json!("idle"))],
        ),
    ];
    let margin = json!({
        "channel": "rover/stability", "field": "regular.margin_m", "op": "ge", "value": 0.05,
        "max_age_s": 600
    });
    let request = json!({
        "body": { "type": "sequence", "steps": steps }, "preconditions": [margin],
    });
    let bad = checks(&ground, "ada", &request).await;
    assert_eq!(bad["ready"], false);
    let of_steps: Vec<&str> =
        bad["steps"].as_array().unwrap().iter().map(|s| s["outcome"].as_str().unwrap()).collect();
    assert_eq!(of_steps, ["passed", "passed", "failed", "not_reached"], "{bad}");
    assert!(bad["steps"][2]["message"].as_str().unwrap().contains("wheel stands"));
    assert_eq!(outcome(&bad, "content"), "failed");
    assert_eq!(outcome(&bad, "order"), "not_reached");
    assert_eq!(outcome(&bad, "preconditions"), "failed");
    let conditions = bad["conditions"].as_array().unwrap();
    let told: Vec<(&Value, &str)> = conditions
        .iter()
        .map(|c| (c.get("step").unwrap_or(&Value::Null), c["outcome"].as_str().unwrap()))
        .collect();
    assert_eq!(told, [(&Value::Null, "passed"), (&json!(0), "failed"), (&json!(3), "waits")]);
    assert_eq!(conditions[1]["found"], "ready");
    assert!(conditions[0]["found"].as_f64().unwrap() >= 0.05);

    // Without the wheel that stands it needs a second person, for it drives.
    let steps = json!([steps[0]["body"], steps[1]["body"], steps[3]["body"]]);
    let steps: Vec<Value> =
        steps.as_array().unwrap().iter().map(|body| step(body.clone(), vec![])).collect();
    let drives = json!({ "body": { "type": "sequence", "steps": steps } });
    let drives = checks(&ground, "ada", &drives).await;
    assert_eq!((outcome(&drives, "approval").as_str(), &drives["ready"]), ("waits", &json!(false)));
    assert!(ALL[..7].iter().all(|name| outcome(&drives, name) == "passed"), "{drives}");

    // Authority of another, and an E-stop, are told beside what passes.
    assert_eq!(post(&ground, "bob", "authority/acquire", &json!({})).await.status, 200);
    let held = checks(&ground, "ada", &json!({ "body": mode("driving") })).await;
    assert_eq!(
        (outcome(&held, "authority").as_str(), outcome(&held, "content").as_str()),
        ("failed", "passed")
    );
    assert_eq!(held["checks"][5]["code"], "authority_held");
    post(&ground, "eve", "estop", &json!({})).await;
    let stopped = checks(&ground, "bob", &json!({ "body": mode("driving") })).await;
    assert_eq!(outcome(&stopped, "estop"), "failed");
    assert_eq!(outcome(&stopped, "authority"), "passed");
    let staged = ground.get("/api/v1/commands").await.json();
    assert_eq!(staged["commands"], json!([]), "nothing was staged");
}

#[tokio::test]
async fn a_dry_run_of_a_plan_shows_its_order_and_its_basis() {
    let ground = Ground::start().await;
    let plan = ground.plan("leg2", [0.1, 0.0]).await;
    assert_eq!(plan["outcome"], "found", "{plan}");
    let of = |index: usize| json!({ "plan": { "plan_id": plan["id"], "index": index } });
    assert_eq!(checks(&ground, "ada", &of(0)).await["ready"], true);
    let later = checks(&ground, "ada", &of(1)).await;
    assert_eq!(later["ready"], false);
    assert_eq!(outcome(&later, "order"), "waits", "{later}");
    assert_eq!(outcome(&later, "content"), "passed", "it can be staged");
    done(&ground, json!({ "type": "body_move", "translation_m": [0.0, 0.0, 0.05] })).await;
    let stale = checks(&ground, "ada", &of(0)).await;
    assert_eq!(outcome(&stale, "content"), "failed");
    assert_eq!(stale["checks"][0]["code"], "basis_changed");
}
