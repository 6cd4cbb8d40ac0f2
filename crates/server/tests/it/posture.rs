//! What the posture adviser offers for the live rover, taken up as a plan.

use serde_json::{Value, json};

use crate::support::Ground;

/// The adviser's answer about a leg, as it is kept.
async fn advised(ground: &Ground, leg: &str, conservative_m: f64) -> Value {
    let advice = json!({ "leg": leg, "conservative_m": conservative_m, "replace": false });
    kept(ground, &json!({ "advice": advice, "deadline_s": 300 })).await
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
        assert_eq!(plan["margins"], offered["margins_along"]);
        check_margins(&plan, &offered["margins"], leg);
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

/// Margins along a plan: from its first to its last instant, above the rule, and at the end those of the
/// posture over the same feet.
fn check_margins(plan: &Value, after: &Value, lifted: &str) {
    let margins = &plan["margins"];
    let times = numbers(&margins["time_s"]);
    assert!((2..=64).contains(&times.len()), "{}", times.len());
    assert!(times.windows(2).all(|w| w[0] <= w[1]));
    let knots = plan["waypoints"].as_array().unwrap();
    let last_s = knots[knots.len() - 1]["time_s"].as_f64().unwrap();
    assert!(times[0] == 0.0 && (times[times.len() - 1] - last_s).abs() < 1e-6);
    let regular = numbers(&margins["regular_m"]);
    assert!(regular.iter().all(|m| *m > 0.1), "{regular:?}");
    // Once the leg is folded the last part is over the feet that stay.
    let standing = after["standing"].as_array().unwrap();
    if plan["commands"][0]["phase"] == "lift" {
        assert!(standing.iter().all(|leg| leg != lifted));
        let [there, then] = [regular[regular.len() - 1], after["regular_m"].as_f64().unwrap()];
        assert!((there - then).abs() < 1e-6, "{there} {then}");
    }
}

#[tokio::test]
async fn a_way_back_that_was_rehearsed_is_executed_like_any_plan() {
    let ground = Ground::start().await;
    // A rover on six feet survives every loss: first leg 2 is folded, so that without one of its neighbors
    // less than m1 is left.
    let folded = advised(&ground, "leg2", 0.03).await;
    let proposals = folded["advice"]["proposals"].as_array().unwrap();
    let fold = proposals.iter().position(|proposal| proposal["change"] == "fold").unwrap();
    let plan = taken_up(&ground, &folded, fold).await.json();
    carried_out(&ground, &plan).await;
    let rehearse = json!({ "rehearsal": {}, "deadline_s": 300 });
    let answer = kept(&ground, &rehearse).await;
    let accident = |leg: &str, kind: &str| json!({ "way_back": { "leg": leg, "kind": kind } });
    let path = format!("rover/posture/{}/plans", answer["id"].as_str().unwrap());
    let refused = async |asked: Value| ground.post(&path, &asked).await.code();
    assert_eq!(refused(accident("leg2", "lost")).await, "way_back_unknown");
    assert_eq!(refused(accident("leg5", "settled")).await, "plan_not_sendable");

    let legs = answer["rehearsal"]["legs"].as_array().unwrap();
    let lost = &legs.iter().find(|of| of["leg"] == "leg3").unwrap()["lost"];
    let told_m = lost["margin_m"].as_f64().unwrap();
    assert!((margin_without(&ground, "leg3").await - told_m).abs() < 0.002 && told_m < 0.1);
    let taken = ground.post(&path, &accident("leg3", "lost")).await;
    assert_eq!(taken.status, 201, "{}", taken.json());
    let plan = taken.json();
    let of = json!({ "leg": "leg3", "change": "chassis", "wish_met": true, "accident": "lost" });
    assert_eq!(plan["posture"], of);
    // Along it the feet that bear are those without the lost leg.
    let margins = numbers(&plan["margins"]["regular_m"]);
    assert!((margins[0] - told_m).abs() < 1e-9, "{} {told_m}", margins[0]);
    carried_out(&ground, &plan).await;
    let then_m = margin_without(&ground, "leg3").await;
    assert!(then_m > 0.099 && (then_m - margins[margins.len() - 1]).abs() < 0.005, "{then_m}");
    assert_eq!(ground.post(&path, &accident("leg3", "lost")).await.code(), "basis_changed");
    let again = kept(&ground, &rehearse).await;
    let legs = again["rehearsal"]["legs"].as_array().unwrap();
    let lost = &legs.iter().find(|of| of["leg"] == "leg3").unwrap()["lost"];
    assert_eq!(lost["way_back"]["outcome"], "not_needed");
}

/// How far the reported center of mass is inside of the hull of all reported contacts but one (m).
async fn margin_without(ground: &Ground, leg: &str) -> f64 {
    let frame = ground.frame().await;
    let known = ground.post("analysis/kinematics", &json!({})).await.json();
    let com = numbers(&known["states"][0]["com_m"]);
    let stands = |name: &str| name != leg && frame["contacts"][name] == true;
    let contacts = frame["contact_points_m"].as_object().unwrap();
    let feet: Vec<Vec<f64>> =
        contacts.iter().filter(|(name, _)| stands(name)).map(|(_, p)| numbers(p)).collect();
    // By brute force: a pair of feet is an edge if all others are on one side of it.
    let mut margin = f64::INFINITY;
    for (i, a) in feet.iter().enumerate() {
        for (j, b) in feet.iter().enumerate().filter(|(j, _)| *j != i) {
            let length = (b[0] - a[0]).hypot(b[1] - a[1]);
            let left = |p: &[f64]| {
                ((b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])) / length
            };
            let others = feet.iter().enumerate().filter(|(k, _)| *k != i && *k != j);
            if others.into_iter().all(|(_, p)| left(p) >= 0.0) {
                margin = margin.min(left(&com));
            }
        }
    }
    margin
}

/// The answer about the live rover, as it is kept.
async fn kept(ground: &Ground, request: &Value) -> Value {
    let report = ground.job(&ground.post("rover/posture", request).await).await;
    assert_eq!((&report["kind"], &report["state"]), (&json!("posture"), &json!("done")));
    ground.get(report["result"].as_str().unwrap()).await.json()
}

/// Sends all commands of a plan, and waits until the body is where it ends.
async fn carried_out(ground: &Ground, plan: &Value) {
    for index in 0..plan["commands"].as_array().unwrap().len() {
        let ended = ground.execute(plan["id"].as_str().unwrap(), index).await;
        assert_eq!(ended["state"], "done", "{ended}");
    }
    let knots = plan["waypoints"].as_array().unwrap();
    let there = &knots[knots.len() - 1]["stance"]["base"]["position_m"];
    let stands = || async move {
        let frame = ground.frame().await;
        frame["mode"] == "idle" && apart(&frame["state"]["base"]["position_m"], there) < 0.01
    };
    ground.until("the body where the plan ends", stands).await;
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
