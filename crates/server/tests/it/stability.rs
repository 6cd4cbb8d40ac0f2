//! Friction, torque, energy and reachability over HTTP, and what is derived for the live rover.

use serde_json::{Value, json};

use crate::support::Ground;

fn hexagon(friction: f64) -> Vec<Value> {
    (0..6_u32)
        .map(|k| {
            let yaw = std::f64::consts::TAU * f64::from(k) / 6.0;
            json!({ "position_m": [yaw.cos(), yaw.sin(), 0.0], "friction": friction })
        })
        .collect()
}

#[tokio::test]
async fn a_case_is_answered_with_regions_forces_energy_and_slip() {
    let ground = Ground::start().await;
    let case = json!({
        "contacts": hexagon(0.7), "com_m": [0.0, 0.0, 1.0], "mass_kg": 600.0, "gravity_m_s2": 1.0,
        "energy_surface_m": 0.25, "energy_heading_rad": 0.0,
        "uncertainty": { "height_m": 0.01, "normal_rad": 0.05, "friction": 0.1 },
    });
    let answer = ground.post("analysis/stability", &json!({ "cases": [case] })).await.json();
    let case = &answer["cases"][0];
    let near = |value: &Value, expected: f64| {
        let value = value.as_f64().unwrap_or(f64::NAN);
        assert!((value - expected).abs() < 1e-6, "{value}, expected {expected}");
    };
    // Level feet: the friction region is the hexagon itself.
    near(&case["friction"]["margin_m"], 0.75_f64.sqrt());
    near(&case["friction_conservative"]["region"]["margin_m"], 0.5);
    near(&case["energy_margin_m"], 1.75_f64.sqrt() - 1.0);
    near(&case["energy_margin_j"], 600.0 * (1.75_f64.sqrt() - 1.0));
    near(&case["slip_margin"], 0.7);
    assert_eq!(case["stable"], true);
    let forces = case["contact_forces_n"].as_array().unwrap();
    assert!(forces.iter().all(|f| (f[2].as_f64().unwrap() - 100.0).abs() < 1e-6), "{forces:?}");
    assert_eq!(case["energy_surface"]["size"], json!([9, 7]));
    assert_eq!(case["energy_slice"]["height_m"].as_array().unwrap().len(), 33);
    let robust = case["robust"]["energy_margin_m"].as_f64().unwrap();
    assert!(robust < 1.75_f64.sqrt() - 1.0 && robust > 0.25, "{robust}");
    assert_eq!(case["torque"], Value::Null);
}

#[tokio::test]
async fn steep_ground_is_answered_by_its_reason_and_a_rope_holds_it() {
    let ground = Ground::start().await;
    let tilt = 0.7_f64;
    let (sin, cos) = tilt.sin_cos();
    let contacts: Vec<Value> = (0..6_u32)
        .map(|k| {
            let yaw = std::f64::consts::TAU * f64::from(k) / 6.0;
            json!({
                "position_m": [yaw.cos() * cos, yaw.sin(), -yaw.cos() * sin],
                "normal": [sin, 0.0, cos], "friction": 0.3,
            })
        })
        .collect();
    let case = |tension: f64| {
        json!({
            "contacts": contacts, "com_m": [0.3 * sin, 0.0, 0.3 * cos], "mass_kg": 100.0,
            "gravity_m_s2": 1.0, "tethers": [{
                "position_m": [0.3 * sin, 0.0, 0.3 * cos], "direction": [-cos, 0.0, sin],
                "max_tension_n": tension,
            }],
        })
    };
    let request = json!({ "cases": [case(0.0), case(100.0)] });
    let answer = ground.post("analysis/stability", &request).await.json();
    assert_eq!(answer["cases"][0]["friction_kind"], "empty");
    assert!(answer["cases"][0]["why_not"].as_str().unwrap().contains("too steep"));
    assert_eq!(answer["cases"][1]["stable"], true, "{}", answer["cases"][1]);
    // The loss of the rope is one of the losses.
    assert_eq!(answer["cases"][1]["friction_conservative"]["kind"], "empty");
}

#[tokio::test]
async fn legs_that_are_named_have_their_torques() {
    let ground = Ground::start().await;
    let frame = ground.frame().await;
    let contacts: Vec<Value> = frame["contact_points_m"]
        .as_object()
        .unwrap()
        .iter()
        .map(|(leg, p)| json!({ "position_m": p, "leg": leg }))
        .collect();
    let rover = ground.get("/api/v1/rover").await.json();
    let request = json!({
        "scene": { "state": frame["state"] },
        "cases": [{
            "contacts": contacts, "com_m": rover["stability"]["com_m"],
            "mass_kg": rover["model"]["mass_kg"],
        }],
    });
    let answer = ground.post("analysis/stability", &request).await.json();
    let case = &answer["cases"][0];
    assert_eq!(case["torque"]["kind"], "area", "{case}");
    let ratio = case["least_torque"]["ratio"].as_f64().unwrap();
    assert!(ratio > 0.0 && ratio < 0.3, "{ratio}");
    let mut unknown = request.clone();
    unknown["cases"][0]["contacts"][0]["leg"] = json!("leg9");
    assert_eq!(ground.post("analysis/stability", &unknown).await.code(), "leg_unknown");
}

#[tokio::test]
async fn every_frame_has_friction_torque_and_energy_derived() {
    let ground = Ground::start().await;
    let rover = ground.get("/api/v1/rover").await.json();
    let forces = &rover["stability"]["forces"];
    assert_eq!(forces["friction"]["kind"], "area", "{forces}");
    assert_eq!(forces["torque_safe"], true);
    let weight = rover["model"]["mass_kg"].as_f64().unwrap() * 1.62;
    let sum = |of: &Value, at: usize| -> f64 {
        of.as_object().unwrap().values().map(|f| f[at].as_f64().unwrap()).sum()
    };
    assert!((sum(&forces["contact_forces_n"], 2) - weight).abs() < 1e-6 * weight);
    assert!((sum(&forces["load_share_n"], 1) - weight).abs() < 1e-6 * weight);
    // The measured forces act together below the center of mass.
    for axis in 0..2 {
        let center = forces["center_of_force_m"][axis].as_f64().unwrap();
        let com = rover["stability"]["com_m"][axis].as_f64().unwrap();
        assert!((center - com).abs() < 0.05, "{center} {com}");
    }
}

#[tokio::test]
async fn the_reachability_of_all_legs_comes_by_itself_and_again_after_a_step() {
    let ground = Ground::with(|config| config.terrain.width_m = 10.0).await;
    let path = "/api/v1/rover/reachability";
    let summary = || async { ground.get(path).await.json() };
    ground.until("all legs", || async { summary().await["progress"] == 1.0 }).await;
    let first = summary().await;
    let cells = &first["legs"]["leg1"]["cells"];
    assert!(cells["reachable"].as_u64().unwrap() > 0, "{first}");
    assert_eq!(first["legs"]["leg6"]["resolution_m"], 0.02, "{first}");
    let leg = ground.get(&format!("{path}/leg1")).await;
    assert_eq!(leg.status, 200);
    assert_eq!(&leg.bytes[..4], b"FFT1");
    assert_eq!(ground.get(&format!("{path}/leg9")).await.code(), "not_ready");
    // Steps are planned to reachable cells, the nearest first, until nobody wants to know more.
    let job = ground.call("POST", &format!("{path}/leg1/plans"), None).await;
    assert_eq!(job.status, 202);
    let plannable = || async { summary().await["legs"]["leg1"]["cells"]["plannable"].as_u64() };
    ground.until("plannable cells", || async { plannable().await > Some(0) }).await;
    let job_path = format!("/api/v1/jobs/{}", job.json()["id"].as_str().unwrap());
    ground.call("DELETE", &job_path, None).await;
    assert_eq!(ground.job(&job).await["state"], "cancelled");
    assert!(plannable().await > Some(0), "what is known stays known");
    // Another preference is another basis.
    let conservative = json!({ "stability": "conservative" });
    assert_eq!(ground.call("PUT", path, Some(&conservative)).await.status, 200);
    ground
        .until("another basis", || async {
            let now = summary().await;
            now["basis"] != first["basis"] && now["progress"] == 1.0
        })
        .await;
    // Whoever asks for more finds fewer places: what was reachable is unstable by the stricter rule.
    let now = summary().await;
    assert_eq!(now["stability"], "conservative");
    let of = |summary: &Value, class| summary["legs"]["leg1"]["cells"][class].as_u64().unwrap();
    assert!(of(&now, "reachable") < of(&first, "reachable"), "{now}");
    assert!(of(&now, "unstable") > of(&first, "unstable"), "{now}");
    // A change ends the work that has begun, and what was known before is found again.
    let regular = json!({ "stability": "regular" });
    assert_eq!(ground.call("PUT", path, Some(&regular)).await.status, 200);
    ground.until("work begun", || async { summary().await["basis"] == first["basis"] }).await;
    assert_eq!(ground.call("PUT", path, Some(&conservative)).await.status, 200);
    ground
        .until("what was ended, again", || async {
            let again = summary().await;
            again["basis"] == now["basis"] && again["progress"] == 1.0
        })
        .await;
    assert_eq!(of(&summary().await, "reachable"), of(&now, "reachable"));
}

#[tokio::test]
async fn planning_to_the_cells_of_a_leg_ends_after_few_plans() {
    let ground = Ground::with(|config| config.terrain.width_m = 10.0).await;
    let path = "/api/v1/rover/reachability";
    let summary = || async { ground.get(path).await.json() };
    ground.until("all legs", || async { summary().await["progress"] == 1.0 }).await;
    let of = |summary: &Value, class| summary["legs"]["leg1"]["cells"][class].as_u64().unwrap();
    let reachable = of(&summary().await, "reachable");
    let job = ground.call("POST", &format!("{path}/leg1/plans"), None).await;
    let report = ground.job(&job).await;
    assert_eq!(report["state"], "done", "{report}");
    let after = summary().await;
    let planned = of(&after, "plannable") + of(&after, "not_plannable");
    // A square of 10 cm has 25 cells of 2 cm; along the border of what can be reached it has fewer. The
    // cells beside planned ones stay what they are.
    assert!(planned > 0 && planned * 10 < reachable, "{planned} of {reachable}");
    assert_eq!(planned + of(&after, "reachable"), reachable, "{after}");
}

#[tokio::test]
async fn a_plan_takes_friction_as_its_rule_and_tells_all_margins_along_it() {
    let ground = Ground::start().await;
    let plan = ground.plan_with("leg2", [0.1, 0.1], json!({ "stability": "friction" })).await;
    assert_eq!(plan["outcome"], "found", "{plan}");
    let rule = plan["findings"].as_array().unwrap().iter().find(|f| f["check"] == "margin_rule");
    assert_eq!(rule.unwrap()["ok"], true);
    let margins = &plan["margins"];
    let of = |name: &str| margins[name].as_array().unwrap();
    let n = of("time_s").len();
    assert_eq!(n, 64);
    let numbers = |name: &str| of(name).iter().map(|v| v.as_f64().unwrap()).collect::<Vec<f64>>();
    let (times, regular, friction) =
        (numbers("time_s"), numbers("regular_m"), numbers("friction_m"));
    assert!(times.windows(2).all(|w| w[1] >= w[0]));
    let end = plan["waypoints"].as_array().unwrap().last().unwrap()["time_s"].as_f64().unwrap();
    assert!((times[n - 1] - end).abs() < 1e-9);
    // The rule asks for m1 in both, and the final check saw it.
    assert!(regular.iter().chain(&friction).all(|margin| *margin >= 0.15), "{margins}");
    let (joules, rises) = (numbers("energy_j"), numbers("energy_m"));
    let weight = joules[0] / rises[0];
    assert!(weight > 1000.0);
    assert!(joules.iter().zip(&rises).all(|(j, m)| (j - weight * m).abs() < 1e-6 * j));
    // Five feet of a hexagon survive no loss with the center of mass in their middle.
    assert_eq!(of("conservative_m").len(), n);
    let edges = of("critical");
    assert_eq!(edges.len(), n);
    assert!(edges.iter().all(|edge| edge.as_str().unwrap().contains(", leg")), "{margins}");
    assert!(edges.iter().all(|edge| !edge.as_str().unwrap().contains("leg2")), "{margins}");
}
