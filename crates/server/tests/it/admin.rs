//! Managing the server while it runs.

use std::net::SocketAddr;

use axum::body::Body;
use axum::http::Request;
use serde_json::{Value, json};
use server::serve::connections::Peer;

use crate::support::{Answer, Ground};

async fn ask(ground: &Ground, method: &str, path: &str, body: Value, from: Option<&str>) -> Answer {
    let mut request = Request::builder()
        .method(method)
        .uri(format!("/api/v1/{path}"))
        .header("content-type", "application/json");
    if let Some(from) = from {
        request = request.extension(Peer(from.parse::<SocketAddr>().unwrap()));
    }
    ground.send(request.body(Body::from(body.to_string())).unwrap()).await
}

const HERE: Option<&str> = Some("127.0.0.1:5000");

#[tokio::test]
async fn only_this_machine_manages_the_server() {
    let ground = Ground::start().await;
    let routes = [
        ("GET", "admin", Value::Null),
        ("PUT", "admin/log-level", json!({ "filter": "info" })),
        ("POST", "admin/reconnect", json!({})),
    ];
    for (method, path, body) in &routes {
        for from in [
            None,
            Some("10.0.0.1:80"),
            Some("128.0.0.1:80"),
            Some("0.0.0.0:80"),
            Some("[::2]:80"),
            Some("[::ffff:192.168.0.1]:80"),
        ] {
            let refused = ask(&ground, method, path, body.clone(), from).await;
            let code = (refused.status.as_u16(), refused.code());
            assert_eq!(code, (403, "admin_refused".into()), "{method} {path} from {from:?}");
        }
        for from in ["127.0.0.1:80", "127.9.9.9:80", "[::1]:80", "[::ffff:127.0.0.1]:80"] {
            let answer = ask(&ground, method, path, body.clone(), Some(from)).await;
            assert_ne!(answer.status, 403, "{method} {path} from {from}");
        }
    }
}

#[tokio::test]
async fn adapter_queues_and_counters_are_told() {
    let ground = Ground::start().await;
    let report = ask(&ground, "GET", "admin", Value::Null, HERE).await.json();
    assert_eq!(report["adapter"], json!({ "kind": "simulated", "carrier": null }));
    assert_eq!(report["recorder"]["dropped"], 0);
    let queue = |report: &Value, name: &str| {
        let all = report["queues"].as_array().unwrap();
        all.iter().find(|queue| queue["name"] == name).unwrap()["waiting"].as_u64().unwrap()
    };
    assert_eq!(queue(&report, "commands staged"), 0);
    let joints = ground.frame().await["state"]["joints_rad"]["leg1"].clone();
    let knot = |time_s: u32| json!({ "joints_rad": joints, "time_s": time_s });
    let body = json!({ "type": "joint_path", "leg": "leg1", "knots": [knot(0), knot(1)] });
    assert_eq!(ground.post("commands", &json!({ "body": body })).await.status, 201);
    let after = ask(&ground, "GET", "admin", Value::Null, HERE).await.json();
    assert_eq!(queue(&after, "commands staged"), 1);
    assert!(after["link_down"]["sent"].as_u64() >= report["link_down"]["sent"].as_u64());
    let refused = ask(&ground, "POST", "admin/reconnect", json!({}), HERE).await;
    assert_eq!((refused.status.as_u16(), refused.code()), (409, "rover_in_process".into()));
    for (filter, code) in [("", "out_of_range"), ("x=loud", "out_of_range")] {
        let refused =
            ask(&ground, "PUT", "admin/log-level", json!({ "filter": filter }), HERE).await;
        assert_eq!((refused.status.as_u16(), refused.code()), (422, code.into()));
    }
    let unknown = json!({ "filter": "info", "level": 1 });
    assert_eq!(ask(&ground, "PUT", "admin/log-level", unknown, HERE).await.code(), "unknown_field");
    // No messages are told by tests, so there is no level to be set.
    let fixed = ask(&ground, "PUT", "admin/log-level", json!({ "filter": "info" }), HERE).await;
    assert_eq!((fixed.status.as_u16(), fixed.code()), (409, "log_level_fixed".into()));
}
