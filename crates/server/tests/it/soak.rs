//! Many generated bodies of `POST /analysis/plan`: no panic, an answer with a known outcome or an
//! error with a name. A tenth as many as the planner's own soak (`FOOTFALL_SOAK`, `make soak`).

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::Arc;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::{Value, json};
use server::analyses;
use server::body;
use server::config::Config;
use server::robots::Robots;
use server::scene::{Context, standing_at_origin};
use server::stop::Stop;
use server::terrains::{FileRoot, Terrains};
use wire::analysis::PlanRequest;
use wire::check::{At, RequestError};

/// Requests in an ordinary run of the planner's soak.
const ORDINARY: u64 = 1_000;

const OUTCOMES: [&str; 9] = [
    "found",
    "no_path",
    "unreachable",
    "no_lift",
    "unstable",
    "colliding",
    "unknown_ground",
    "refused",
    "deadline",
];

fn n_requests() -> u64 {
    let asked = std::env::var("FOOTFALL_SOAK").ok().and_then(|n| n.parse().ok());
    asked.unwrap_or(ORDINARY).div_ceil(10)
}

fn context() -> Context {
    Context {
        robots: Arc::new(Robots::new(vec![testkit::project_dir().join("fixtures/robots")])),
        terrains: Arc::new(Terrains::new(FileRoot::Relative(PathBuf::new()), None)),
        config: Arc::new(Config::demo()),
        live: None,
    }
}

struct Source {
    rng: ChaCha8Rng,
}

impl Source {
    fn one_in(&mut self, n: u32) -> bool {
        self.rng.random_range(0..n) == 0
    }

    fn pick(&mut self, of: &[Value]) -> Value {
        of[self.rng.random_range(0..of.len())].clone()
    }

    fn wild(&mut self) -> Value {
        let wild = [
            json!(1e308),
            json!(-1e308),
            json!(0),
            json!(-1),
            json!(1e-300),
            json!(null),
            json!("NaN"),
            json!([]),
            json!({}),
            json!(u64::MAX),
            json!(true),
        ];
        self.pick(&wild)
    }

    fn number(&mut self, least: f64, most: f64) -> Value {
        if self.one_in(40) { self.wild() } else { json!(self.rng.random_range(least..most)) }
    }

    fn obstacle(&mut self, at: [f64; 3]) -> Value {
        let place: Vec<Value> = at.map(|x| self.number(x - 1.0, x + 1.0)).into();
        match self.rng.random_range(0..4) {
            0 => {
                let (x, y, z) = (at[0] + 0.4, at[1] + 0.4, at[2]);
                let flat = self.one_in(3);
                let top = if flat { z } else { z + 0.4 };
                let vertices = json!([[x, y, z], [x + 0.3, y, z], [x, y + 0.3, z], [x, y, top]]);
                let triangles = self.pick(&[
                    json!([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]),
                    json!([[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]]),
                    json!([[0, 2, 1], [0, 1, 3]]),
                    json!([[0, 0, 0]]),
                    json!([[0, 1, 77]]),
                ]);
                json!({ "vertices_m": vertices, "triangles": triangles })
            }
            _ => {
                let edges: Vec<Value> = (0..3).map(|_| self.number(0.02, 0.6)).collect();
                json!({ "box_m": edges, "position_m": place, "orientation_xyzw": [0, 0, 0, 1] })
            }
        }
    }

    fn request(&mut self, context: &Context) -> Value {
        let names = ["athlete", "athlete", "athlete", "hexapod", "quadruped", "slider"];
        let name = names[self.rng.random_range(0..names.len())];
        let robot = context.robots.load(&At::root("robot"), name).unwrap();
        let scale = self.pick(&[json!(1), json!(1), json!(0.001), json!(1000), json!(0.3)]);
        let factor = scale.as_f64().unwrap();
        let size = factor * if name == "athlete" { 1.0 } else { 0.15 };
        let leg = self.rng.random_range(0..robot.legs().len());
        let scaled = robot.scaled(factor).unwrap();
        let start = standing_at_origin(&scaled, "bent");
        let wheel = rover::Posture::new(&scaled, &start).wheel(&scaled, rover::LegId(leg));
        let low = wheel.lowest_point(&nalgebra::Vector3::z_axis());
        let terrain = self.pick(&[
            json!({ "plane": {} }),
            json!({ "plane": {}, "friction": 0.4 }),
            json!({ "recipe": { "name": "boulder_field", "width_m": 8.0 }, "seed": 3 }),
            json!({}),
        ]);
        let n = [0, 0, 1, 3][self.rng.random_range(0..4)];
        let obstacles: Vec<Value> = (0..n).map(|_| self.obstacle([low.x, low.y, low.z])).collect();
        let far = 0.8 * size;
        let position: Vec<Value> =
            [low.x, low.y, low.z].map(|x| self.number(x - far, x + far)).into();
        let mut request = json!({
            "scene": {
                "robot": name, "scale": scale, "terrain": terrain, "obstacles": obstacles,
                "gravity_m_s2": self.number(1.0, 10.0),
            },
            "leg": robot.legs()[leg].name,
            "target": { "position_m": position },
            "planner": self.pick(&["auto", "astar", "sbl", "rrt_connect", "line"].map(|p| json!(p))),
            "shift": "never",
            "lift_m": self.number(0.0, 0.4 * size),
            "budget": self.rng.random_range(2..60),
            "seed": self.rng.random::<u32>(),
            "smoothing": { "max_edges": 20 },
        });
        if self.one_in(3) {
            request["deadline_s"] = self.pick(&[json!(0), json!(0.001), json!(30), json!(-1)]);
        }
        if self.one_in(4) {
            request["tolerances"] = json!({
                "environment_m": self.number(0.0, 0.2), "pairs_m": self.number(0.0, 0.2),
                "inflation_m": self.number(0.0, 1.2),
            });
        }
        if self.one_in(4) {
            request["buffers"] = json!({ "terrain_lift_m": self.number(0.0, 1.2), "obstacle_m": self.number(0.0, 1.2) });
        }
        if self.one_in(4) {
            request["epsilon_rad"] = self.number(0.0, 0.12);
        }
        if self.one_in(8) {
            let joints: Vec<Value> =
                (0..self.rng.random_range(0..8)).map(|_| self.number(-2.0, 2.0)).collect();
            request["target"] = json!({ "joints_rad": joints });
            request["transit_only"] = json!(self.one_in(2));
        }
        if self.one_in(12) {
            request["leg"] = json!("leg99");
        }
        if self.one_in(20) {
            request["stability"] = json!("friction");
        }
        if self.one_in(20) {
            // Ranges that leave a joint nothing, or contradict it.
            request["scene"]["payloads"] = json!([{
                "link": "chassis", "mass_kg": self.number(0.0, 100.0), "com_m": [0, 0, 0],
                "limits_rad": { "leg1_hip_yaw": [self.number(-2.0, 2.0), self.number(-2.0, 2.0)] },
            }]);
        }
        request
    }
}

fn plan(context: &Context, text: &str) -> Result<String, RequestError> {
    let request: PlanRequest = body::parse(text.as_bytes())?;
    let stop = Stop::after(request.deadline_s)?;
    let planned = analyses::plan(context, &request, &stop, &|_, _| {})?;
    let answer = planned.answer;
    assert!(OUTCOMES.contains(&answer.outcome.as_str()), "{}", answer.outcome);
    let offered = answer.outcome == "found" && !request.transit_only;
    assert_eq!(offered, !answer.commands.is_empty(), "{}", answer.outcome);
    assert!(answer.outcome == "found" || answer.reason.is_some());
    // What cannot be written would break the connection.
    let written = serde_json::to_string(&answer).unwrap();
    assert!(serde_json::from_str::<Value>(&written).is_ok());
    Ok(answer.outcome)
}

#[test]
fn no_body_brings_the_analysis_down_and_every_refusal_has_a_name() {
    let context = context();
    let mut ends = std::collections::BTreeMap::new();
    let mut failed = Vec::new();
    for n in 0..n_requests() {
        let mut source = Source { rng: ChaCha8Rng::seed_from_u64(n) };
        let mut text = source.request(&context).to_string();
        if source.one_in(25) {
            text = text.replace("\"budget\":", "\"budget\":1e999,\"was\":");
        }
        if source.one_in(25) {
            text.truncate(text.len() / 2);
        }
        match catch_unwind(AssertUnwindSafe(|| plan(&context, &text))) {
            Ok(Ok(outcome)) => *ends.entry(outcome).or_insert(0) += 1,
            Ok(Err(error)) => {
                assert!(!error.code.is_empty() && !error.message.is_empty(), "{error:?}");
                assert_ne!(error.code, "internal", "request {n}: {error:?}");
                *ends.entry(error.code.to_string()).or_insert(0) += 1;
            }
            Err(_) => {
                eprintln!("request {n}: {text}");
                failed.push(n);
            }
        }
    }
    eprintln!("{ends:?}");
    assert!(failed.is_empty(), "requests {failed:?}: see the panics above");
    assert!(n_requests() < 100 || ends.len() >= 8, "too few kinds of ends: {ends:?}");
}

#[test]
fn a_hundred_thousand_obstacles_are_refused_by_the_limit() {
    let solid = json!({ "box_m": [1, 1, 1], "position_m": [9, 9, 9],
                        "orientation_xyzw": [0, 0, 0, 1] });
    let request = json!({
        "scene": { "robot": "athlete", "obstacles": vec![solid; 100_000] },
        "leg": "leg1", "target": { "position_m": [2, 0, 0] },
    });
    let error = plan(&context(), &request.to_string()).unwrap_err();
    assert_eq!(error.code, "too_many", "{error:?}");
}
