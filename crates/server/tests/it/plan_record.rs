//! A plan in the log is asked for again, and is the same to the last bit.

use bridge::catalog;
use bridge::reader::Limits;
use serde_json::{Value, json};

use crate::support::Ground;

/// An answer without its id and the times it took.
fn lasting(mut answer: Value) -> Value {
    answer["id"] = Value::Null;
    for time in ["search_ms", "smoothing_ms", "check_ms"] {
        answer["statistics"][time] = Value::Null;
    }
    answer
}

#[tokio::test]
async fn a_logged_plan_request_gives_the_same_plan_bit_for_bit() {
    let ground = Ground::start().await;
    for (planner, seed) in [("auto", 1), ("sbl", 5), ("rrt_connect", 9)] {
        let plan =
            ground.plan_with("leg2", [0.1, 0.1], json!({ "planner": planner, "seed": seed }));
        assert_eq!(plan.await["outcome"], "found", "{planner}");
    }
    let logs = ground.dir.path().join("logs");
    let id = ground.get("/api/v1/logs").await.json()["logs"][0]["id"].as_str().unwrap().to_owned();
    let plans = || {
        let log = catalog::read_log(&logs, &id, Limits::default()).unwrap();
        let records = log.messages.into_iter().filter(|m| &*m.channel == "plan/record");
        records.map(|m| serde_json::from_slice::<Value>(&m.data).unwrap()).collect::<Vec<_>>()
    };
    ground.until("three plans in the log", || async { plans().len() == 3 }).await;
    // Another session, on the same ground; its rover need not be where this one is.
    let other = Ground::start().await;
    for record in plans() {
        let again = other.post("analysis/plan", &record["request"]).await;
        assert_eq!(again.status, 200, "{}", again.json());
        let (again, logged) = (lasting(again.json()), lasting(record["answer"].clone()));
        assert_eq!(logged["outcome"], "found", "{}", logged["reason"]);
        assert_eq!(again.to_string(), logged.to_string());
    }
}
