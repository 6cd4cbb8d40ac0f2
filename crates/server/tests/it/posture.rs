//! What the posture adviser offers for the live rover, taken up as a plan.

use serde_json::{Value, json};

use crate::support::Ground;

/// The adviser's answer about a leg, as it is kept.
async fn advised(ground: &Ground, leg: &str, conservative_m: f64) -> Value {
    let advice = json!({ "leg": leg, "conservative_m": conservative_m, "replace": false });
    let request = json!({ "advice": advice, "deadline_s": 300 });
    let report = ground.job(&ground.post("rover/posture", &request).await).await;
    assert_eq!((&report["kind"], &report["state"]), (&json!("posture"), &json!("done")));
    ground.get(report["result"].as_str().unwrap()).await.json()
}

async fn taken_up(ground: &Ground, answer: &Value, proposal: usize) -> crate::support::Answer {
    let path = format!("rover/posture/{}/plans", answer["id"].as_str().unwrap());
    ground.post(&path, &json!({ "proposal": proposal })).await
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
}

fn apart(a: &Value, b: &Value) -> f64 {
    let (a, b) = (numbers(a), numbers(b));
    a.iter().zip(&b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

#[tokio::test]
async fn a_posture_that_was_offered_is_a_plan_like_any_other_there_and_back() {
    // One that moves the chassis only, one that lifts and folds the leg before.
    for (leg, margin_m, first) in [("leg1", 0.2, "shift"), ("leg2", 0.3, "lift")] {
        let ground = Ground::start().await;
        let stood = ground.frame().await["contact_points_m"][leg].take();
        let answer = advised(&ground, leg, margin_m).await;
        assert_eq!(answer["advice"]["outcome"], "found", "{answer}");
        let offered = &answer["advice"]["proposals"][0];
        let taken = taken_up(&ground, &answer, 0).await;
        assert_eq!(taken.status, 201, "{}", taken.json());
        let plan = taken.json();
        let id = plan["id"].as_str().unwrap();
        assert_eq!(ground.get(&format!("/api/v1/plans/{id}")).await.json(), plan);
        assert_eq!(plan["commands"], offered["commands"]);
        assert_eq!(plan["commands"][0]["phase"], first, "{plan}");
        let of = &plan["posture"];
        assert_eq!((&of["leg"], &of["wish_met"]), (&json!(leg), &json!(true)));

        // The knots carry the whole rover from where it stands to the posture, in the commands' time.
        let knots = plan["waypoints"].as_array().unwrap();
        let now = ground.frame().await["state"].take();
        let (begin, end) = (&knots[0]["stance"], &knots[knots.len() - 1]["stance"]);
        assert!(apart(&begin["base"]["position_m"], &now["base"]["position_m"]) < 1e-6);
        assert_eq!(end["base"], offered["end"]["base"]);
        let commands = plan["commands"].as_array().unwrap();
        let took_s: f64 = commands.iter().map(|c| c["duration_s"].as_f64().unwrap()).sum();
        assert!((knots[knots.len() - 1]["time_s"].as_f64().unwrap() - took_s).abs() < 1e-6);
        for pair in knots.windows(2) {
            assert!(pair[0]["time_s"].as_f64().unwrap() <= pair[1]["time_s"].as_f64().unwrap());
        }

        for index in 0..commands.len() {
            let ended = ground.execute(id, index).await;
            assert_eq!(ended["state"], "done", "{ended}");
        }
        let at = |place: Value| {
            let ground = &ground;
            move || {
                let place = place.clone();
                async move {
                    let frame = ground.frame().await;
                    let base = &frame["state"]["base"]["position_m"];
                    frame["mode"] == "idle" && apart(base, &place) < 0.01
                }
            }
        };
        ground.until("the posture", at(end["base"]["position_m"].clone())).await;

        // What it was taken up for: the leg steps with the wished margin and no shift of the body first.
        let [x, y] = [0, 1].map(|i| stood[i].as_f64().unwrap() + 0.1);
        let target = json!({ "position_m": [x, y, 0.0] });
        let step = json!({ "leg": leg, "target": target, "stability": "conservative" });
        let report = ground.job(&ground.post("plans", &step).await).await;
        let step = ground.get(report["result"].as_str().unwrap()).await.json();
        assert_eq!(step["outcome"], "found", "{leg}: {}", step["reason"]);
        assert!(step["commands"].as_array().unwrap().iter().all(|c| c["phase"] != "shift"));

        // What was offered for the stance before does not fit any more.
        let late = taken_up(&ground, &answer, 0).await;
        assert_eq!((late.status.as_u16(), late.code().as_str()), (409, "basis_changed"));
        let n = commands.len();
        for index in 0..n {
            let ended = ground.execute_back(id, index).await;
            assert_eq!(ended["state"], "done", "{ended}");
        }
        ground.until("the way back", at(begin["base"]["position_m"].clone())).await;
    }
}

#[tokio::test]
async fn what_was_not_offered_is_not_taken_up() {
    let ground = Ground::start().await;
    let unknown = json!({ "id": "nothing" });
    assert_eq!(taken_up(&ground, &unknown, 0).await.code(), "posture_unknown");
    assert_eq!(ground.get("/api/v1/rover/posture/nothing").await.code(), "posture_unknown");

    // The rule holds as the rover stands: nothing is offered.
    let advice = json!({ "leg": "leg1" });
    let accepted = ground.post("rover/posture", &json!({ "advice": advice })).await;
    let report = ground.job(&accepted).await;
    let met = ground.get(report["result"].as_str().unwrap()).await.json();
    assert_eq!(met["advice"]["outcome"], "already_met", "{met}");
    assert_eq!(taken_up(&ground, &met, 0).await.code(), "proposal_index");

    // Where the wish cannot be met, the best posture alone is offered.
    let far = json!({ "leg": "leg1", "regular_m": 5.0, "fold": false, "replace": false });
    let far = json!({ "advice": far, "budget": 0 });
    let report = ground.job(&ground.post("rover/posture", &far).await).await;
    let best = ground.get(report["result"].as_str().unwrap()).await.json();
    assert_eq!(best["advice"]["outcome"], "best", "{best}");
    let plan = taken_up(&ground, &best, 0).await.json();
    assert_eq!(plan["posture"]["wish_met"], false, "{plan}");
    assert_eq!(plan["commands"], best["advice"]["best"]["posture"]["commands"]);
    let beyond = taken_up(&ground, &best, 1).await;
    assert_eq!((beyond.status.as_u16(), beyond.code().as_str()), (422, "proposal_index"));
    let other = ground.post("rover/posture/x/plans", &json!({ "proposals": 0 })).await;
    assert_eq!(other.code(), "unknown_field");
}
