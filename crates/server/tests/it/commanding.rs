//! Authority, approval, unknown outcomes and the link's model over HTTP.

use axum::body::Body;
use axum::http::Request;
use serde_json::{Value, json};
use server::serve::Mission;

use crate::support::{Answer, Ground, config};

async fn post(ground: &Ground, who: &str, path: &str, body: &Value) -> Answer {
    let request = Request::post(format!("/api/v1/{path}"))
        .header("content-type", "application/json")
        .header("x-operator", who)
        .body(Body::from(body.to_string()))
        .unwrap();
    ground.send(request).await
}

/// A motion that leaves leg 1 where it is.
async fn still(ground: &Ground) -> Value {
    let joints = ground.frame().await["state"]["joints_rad"]["leg1"].clone();
    let knot = |time_s: u32| json!({ "joints_rad": joints, "time_s": time_s });
    json!({ "body": { "type": "joint_path", "leg": "leg1", "knots": [knot(0), knot(1)] } })
}

async fn stage(ground: &Ground, who: &str) -> Value {
    let staged = post(ground, who, "commands", &still(ground).await).await;
    assert_eq!(staged.status, 201, "{}", staged.json());
    staged.json()
}

#[tokio::test]
async fn one_operator_commands_at_a_time_and_arming_acquires_the_authority() {
    let ground = Ground::start().await;
    assert_eq!(ground.get("/api/v1/authority").await.json().get("holder"), None);
    let (ada, bob) = (stage(&ground, "ada").await, stage(&ground, "bob").await);
    let path =
        |command: &Value, act: &str| format!("commands/{}/{act}", command["id"].as_str().unwrap());
    let armed = post(&ground, "ada", &path(&ada, "arm"), &json!({})).await;
    assert_eq!(armed.json()["state"], "armed");
    let report = ground.get("/api/v1/authority").await.json();
    assert_eq!((&report["holder"], &report["explicit"]), (&json!("ada"), &json!(false)));
    let held = post(&ground, "bob", &path(&bob, "arm"), &json!({})).await;
    assert_eq!((held.status.as_u16(), held.code()), (409, "authority_held".into()));
    let mut dry = still(&ground).await;
    dry["dry_run"] = json!(true);
    assert_eq!(post(&ground, "bob", "commands", &dry).await.code(), "authority_held");
    assert_eq!(
        post(&ground, "bob", "authority/acquire", &json!({})).await.code(),
        "authority_held"
    );
    let taken = post(&ground, "bob", "authority/acquire", &json!({ "take_over": true })).await;
    assert!(taken.json()["epoch"].as_u64() > report["epoch"].as_u64());
    let disarmed = format!("/api/v1/commands/{}", ada["id"].as_str().unwrap());
    let disarmed = ground.get(&disarmed).await;
    assert_eq!(disarmed.json()["state"], "staged", "what ada had armed");
    assert_eq!(
        post(&ground, "ada", &path(&ada, "send"), &json!({})).await.code(),
        "authority_held"
    );
    assert_eq!(
        post(&ground, "ada", "authority/renew", &json!({})).await.code(),
        "authority_needed"
    );
    assert_eq!(post(&ground, "bob", "authority/renew", &json!({})).await.status, 200);
    // The E-stop is anybody's.
    assert_eq!(post(&ground, "eve", "estop", &json!({})).await.json()["state"], "sent");
    let released = post(&ground, "bob", "authority/release", &json!({})).await;
    assert_eq!(released.json().get("holder"), None);
    assert_eq!(ground.get("/api/v1/link").await.json()["authority"], released.json());
}

#[tokio::test]
async fn the_authority_is_asked_for_and_handed_over_without_a_gap() {
    let ground = Ground::start().await;
    let command = stage(&ground, "ada").await;
    let id = command["id"].as_str().unwrap();
    // Free, it is taken by asking.
    let taken = post(&ground, "ada", "authority/request", &json!({})).await.json();
    assert_eq!((&taken["holder"], taken.get("asked_by")), (&json!("ada"), None));
    assert_eq!(taken["lease_s"], 30.0);
    let own = post(&ground, "ada", "authority/request", &json!({})).await;
    assert_eq!((own.status.as_u16(), own.code()), (409, "authority_has_it".into()));
    post(&ground, "ada", &format!("commands/{id}/arm"), &json!({})).await;
    let asked = post(&ground, "bob", "authority/request", &json!({})).await.json();
    assert_eq!((&asked["holder"], &asked["asked_by"]), (&json!("ada"), &json!("bob")));
    let of_link = ground.get("/api/v1/link").await.json()["authority"].clone();
    assert_eq!(of_link["asked_by"], "bob", "every console is told");
    // Only its holder hands it over, to somebody else.
    let to = |name: &str| json!({ "to": name });
    let hand_over =
        async |who: &str, name: &str| post(&ground, who, "authority/hand-over", &to(name)).await;
    assert_eq!(hand_over("bob", "bob").await.code(), "authority_needed");
    assert_eq!(hand_over("ada", " ada ").await.code(), "authority_has_it");
    for name in ["", "  ", "\u{e4}da", "b\nob", &"b".repeat(65)] {
        let refused = hand_over("ada", name).await;
        assert_eq!(
            (refused.code(), refused.json()["error"]["details"]["field"].clone()),
            ("out_of_range".into(), json!("to")),
            "{name:?}"
        );
    }
    let handed = hand_over("ada", "bob").await.json();
    assert_eq!((&handed["holder"], handed.get("asked_by")), (&json!("bob"), None));
    assert!(handed["epoch"].as_u64() > taken["epoch"].as_u64());
    let armed = ground.get(&format!("/api/v1/commands/{id}")).await.json();
    assert_eq!(armed["state"], "staged", "what ada had armed is not sent under bob's authority");
    assert_eq!(hand_over("ada", "ada").await.code(), "authority_needed");
    assert_eq!(post(&ground, "bob", "authority/renew", &json!({})).await.status, 200);
}

#[tokio::test]
async fn a_command_of_two_persons_and_an_authority_that_must_be_asked_for() {
    let ground = Ground::with(|config| {
        config.commands.two_persons = "joint_path".into();
        config.commands.authority = "explicit".into();
    })
    .await;
    let staged = stage(&ground, "ada").await;
    let path = |act: &str| format!("commands/{}/{act}", staged["id"].as_str().unwrap());
    let code = |answer: Answer| answer.code();
    assert_eq!(code(post(&ground, "ada", &path("arm"), &json!({})).await), "authority_needed");
    assert_eq!(post(&ground, "ada", "authority/acquire", &json!({})).await.status, 200);
    assert_eq!(code(post(&ground, "ada", &path("arm"), &json!({})).await), "approval_needed");
    let hash = json!({ "content_hash": staged["approval"]["content_hash"] });
    assert_eq!(code(post(&ground, "ada", &path("approve"), &hash).await), "self_approval");
    let other = json!({ "content_hash": "0" });
    assert_eq!(code(post(&ground, "bob", &path("approve"), &other).await), "approval_of_other");
    let approved = post(&ground, "bob", &path("approve"), &hash).await;
    assert_eq!(approved.json()["approval"]["by"], "bob");
    assert_eq!(post(&ground, "ada", &path("arm"), &json!({})).await.status, 200);
    let resolve = json!({ "done": true, "why": "seen" });
    assert_eq!(code(post(&ground, "ada", &path("resolve"), &resolve).await), "not_overdue");
}

#[tokio::test]
async fn after_a_restart_the_outcome_of_what_was_sent_is_unknown_and_it_is_not_sent_again() {
    let ground = Ground::with(|config| config.link.up_delay_s = 1500.0).await;
    let (sent, staged) = (stage(&ground, "ada").await, stage(&ground, "ada").await);
    let id = sent["id"].as_str().unwrap().to_owned();
    for act in ["arm", "send"] {
        let answer = post(&ground, "ada", &format!("commands/{id}/{act}"), &json!({})).await;
        assert_eq!(answer.status, 200, "{}", answer.json());
    }
    let epoch = ground.get("/api/v1/authority").await.json()["epoch"].as_u64();
    let dir = ground.finish().await;

    let ground = Ground::of(Mission::of(config(dir.path())), dir).await;
    let get = |id: &str| format!("/api/v1/commands/{id}");
    let restored = ground.get(&get(&id)).await.json();
    assert_eq!(restored["state"], "overdue");
    assert!(restored["why"].as_str().unwrap().contains("outcome unknown"), "{restored}");
    let outcome = |stage: usize| restored["verification"][stage]["outcome"].clone();
    assert_eq!(
        [outcome(0), outcome(1), outcome(2), outcome(4)],
        ["ok", "ok", "timeout", "unknown"]
    );
    let other = ground.get(&get(staged["id"].as_str().unwrap())).await.json();
    assert_eq!(other["state"], "expired");
    let again = json!({ "id": id, "body": restored["body"] });
    let again = post(&ground, "ada", "commands", &again).await.json();
    assert_eq!(again["state"], "overdue", "the same id is the same command");
    assert_eq!(
        ground.get("/api/v1/link").await.json()["up"]["bytes_sent"].as_u64().unwrap() % 32,
        0,
        "heartbeats alone went up"
    );
    assert!(ground.get("/api/v1/authority").await.json()["epoch"].as_u64() >= epoch);
    let resolve = json!({ "done": false, "why": "leg 1 has not moved" });
    let resolved = post(&ground, "ada", &format!("commands/{id}/resolve"), &resolve).await;
    assert_eq!(resolved.json()["state"], "failed");
    let empty = json!({ "done": false, "why": "" });
    let refused = post(&ground, "ada", &format!("commands/{id}/resolve"), &empty).await;
    assert_eq!(refused.code(), "out_of_range");
}

#[tokio::test]
async fn the_whole_model_of_the_link_goes_up_and_comes_back() {
    let ground = Ground::start().await;
    let presets = ground.get("/api/v1/link/presets").await.json();
    for preset in presets.as_array().unwrap() {
        let answer = ground.call("PUT", "/api/v1/link", Some(&preset["config"])).await;
        assert_eq!(answer.status, 200, "{}", answer.json());
        let config = ground.get("/api/v1/link").await.json()["config"].clone();
        for field in ["up_delay_s", "down_delay_s"] {
            assert_eq!(config[field], preset["config"][field], "{}", preset["name"]);
        }
    }
    let rate = |rate_bps: f64| json!({ "up_delay_s": 0.02, "down_delay_s": 0.02, "up": {}, "down": { "rate_bps": rate_bps } });
    assert_eq!(ground.call("PUT", "/api/v1/link", Some(&rate(1e6))).await.status, 200);
    // A change of the delays alone leaves the rest.
    let delays = json!({ "up_delay_s": 0.1, "down_delay_s": 0.1 });
    let answer = ground.call("PUT", "/api/v1/link", Some(&delays)).await.json();
    assert_eq!(answer["config"]["down"]["rate_bps"], 1e6);
    let refused = ground.call("PUT", "/api/v1/link", Some(&rate(0.0))).await;
    assert_eq!(refused.code(), "out_of_range");
    assert_eq!(refused.json()["error"]["details"]["field"], "down.rate_bps");
    let unknown = json!({ "up_delay_s": 1, "down_delay_s": 1, "up": { "ratio": 1 } });
    assert_eq!(ground.call("PUT", "/api/v1/link", Some(&unknown)).await.code(), "unknown_field");
    let counters = ground.get("/api/v1/link").await.json()["down"].clone();
    let n = |field: &str| counters[field].as_u64().unwrap();
    assert_eq!(n("sent") + n("duplicated"), n("delivered") + n("dropped") + n("in_flight"));
}

#[tokio::test]
async fn what_waits_in_an_outage_is_told_by_queue_and_adds_up() {
    let ground = Ground::start().await;
    let report = async || ground.get("/api/v1/link").await.json();
    assert_eq!(report().await.get("up_queues"), None, "nothing waits");
    let outage = json!({ "begin": "2026-11-23T11:00:00Z", "end": "2026-11-24T12:00:00Z", "traffic": "hold" });
    let link = json!({ "up_delay_s": 0.02, "down_delay_s": 0.02, "up": { "outages": [outage] } });
    assert_eq!(ground.call("PUT", "/api/v1/link", Some(&link)).await.status, 200);
    let command = stage(&ground, "ada").await;
    for act in ["arm", "send"] {
        let path = format!("commands/{}/{act}", command["id"].as_str().unwrap());
        assert_eq!(post(&ground, "ada", &path, &json!({})).await.status, 200);
    }
    let waiting = report().await;
    let of = |class: &str| {
        let queues = waiting["up_queues"].as_array().unwrap();
        queues.iter().find(|queue| queue["class"] == class).cloned().unwrap_or_default()
    };
    assert_eq!(of("command")["messages"], 1, "{waiting}");
    assert_eq!(of("command")["room_bytes"], 16 << 20, "as the queue's default is");
    assert!(of("command")["bytes"].as_u64().unwrap() > 100);
    let queues = waiting["up_queues"].as_array().unwrap();
    let in_all: u64 = queues.iter().map(|queue| queue["messages"].as_u64().unwrap()).sum();
    assert_eq!(waiting["up"]["queued"], in_all);
    assert_eq!(waiting.get("down_queues"), None);
    // Ended by hand, it lets go what it held.
    let link = json!({ "up_delay_s": 0.02, "down_delay_s": 0.02, "up": {} });
    assert_eq!(ground.call("PUT", "/api/v1/link", Some(&link)).await.status, 200);
    ground.until("an empty queue", || async { report().await.get("up_queues").is_none() }).await;
}

#[tokio::test]
async fn a_command_waits_for_what_telemetry_shows_and_is_refused_by_name() {
    let ground = Ground::start().await;
    let request = |mode: &str, shown: &str, max_age_s: f64, dry_run: bool| {
        let wanted = json!({
            "channel": "rover/state", "field": "operation.mode", "op": "eq", "value": shown,
            "max_age_s": max_age_s
        });
        json!({ "body": { "type": "mode", "mode": mode }, "preconditions": [wanted], "dry_run": dry_run })
    };
    for (shown, max_age_s, code) in
        [("safe", 600.0, "precondition_failed"), ("ready", 0.0, "precondition_stale")]
    {
        let dry =
            post(&ground, "ada", "commands", &request("driving", shown, max_age_s, true)).await;
        assert_eq!((dry.status.as_u16(), dry.code()), (409, code.into()));
        let good = request("driving", shown, max_age_s, false);
        let staged = post(&ground, "ada", "commands", &good).await;
        assert_eq!(staged.status, 201, "{}", staged.json());
        let id = staged.json()["id"].as_str().unwrap().to_owned();
        let armed = post(&ground, "ada", &format!("commands/{id}/arm"), &json!({})).await;
        assert_eq!(armed.json()["state"], "armed");
        let sent = post(&ground, "ada", &format!("commands/{id}/send"), &json!({})).await;
        assert_eq!((sent.status.as_u16(), sent.code()), (409, code.into()));
        let now = ground.get(&format!("/api/v1/commands/{id}")).await;
        assert_eq!(now.json()["state"], "armed", "nothing went up");
        post(&ground, "ada", &format!("commands/{id}/cancel"), &json!({})).await;
    }
    let staged = post(&ground, "ada", "commands", &request("driving", "ready", 600.0, false)).await;
    let id = staged.json()["id"].as_str().unwrap().to_owned();
    post(&ground, "ada", &format!("commands/{id}/arm"), &json!({})).await;
    let sent = post(&ground, "ada", &format!("commands/{id}/send"), &json!({})).await;
    assert_eq!(sent.json()["state"], "sent", "{}", sent.json());
    ground
        .until("mode driving", || async {
            ground.frame().await["state"].is_object()
                && ground.frame().await["operation"]["mode"] == "driving"
        })
        .await;
}
