//! A ground server in this process, with folders of its own and a clock whose speed can be set.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use axum::Router;
use axum::body::Body;
use axum::http::{HeaderMap, Request, StatusCode};
use bridge::clock::Clock;
use http_body_util::BodyExt;
use serde_json::{Value, json};
use server::api;
use server::config::Config;
use server::serve::{Mission, Server};
use tokio::time::Instant;
use tower::ServiceExt;
use wire::time::Timestamp;

/// A folder that is removed at the end.
pub struct TempDir(PathBuf);

impl TempDir {
    pub fn new() -> TempDir {
        static NEXT: AtomicU32 = AtomicU32::new(0);
        let name =
            format!("footfall-{}-{}", std::process::id(), NEXT.fetch_add(1, Ordering::SeqCst));
        let path = std::env::temp_dir().join(name);
        std::fs::create_dir_all(&path).unwrap();
        TempDir(path)
    }

    pub fn path(&self) -> &Path {
        &self.0
    }
}

impl Drop for TempDir {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// A clock that runs as fast as it is told to, so that a test need not wait for a rover.
pub struct TestClock(Mutex<(Instant, Timestamp, f64)>);

impl TestClock {
    fn new() -> TestClock {
        let start = Timestamp::from_rfc3339("2026-11-23T12:00:00Z").unwrap();
        TestClock(Mutex::new((Instant::now(), start, 1.0)))
    }

    /// Goes `speed` times as fast as the machine's clock from now on.
    pub fn run_at(&self, speed: f64) {
        let now = self.now();
        *self.0.lock().unwrap() = (Instant::now(), now, speed);
    }
}

impl Clock for TestClock {
    fn now(&self) -> Timestamp {
        let (since, at, speed) = *self.0.lock().unwrap();
        at.plus_seconds(since.elapsed().as_secs_f64() * speed)
    }
}

/// A ground server in this process.
pub struct Ground {
    pub router: Router,
    pub clock: Arc<TestClock>,
    pub dir: TempDir,
    server: Option<Server>,
}

/// An answer, read whole.
pub struct Answer {
    pub status: StatusCode,
    pub headers: HeaderMap,
    pub bytes: Vec<u8>,
}

impl Answer {
    pub fn json(&self) -> Value {
        serde_json::from_slice(&self.bytes).unwrap_or(Value::Null)
    }

    /// The code of an error answer.
    pub fn code(&self) -> String {
        self.json()["error"]["code"].as_str().unwrap_or_default().to_owned()
    }
}

/// The demo with a small, fast link, on a small ground.
pub fn config(dir: &Path) -> Config {
    let mut config = Config::demo();
    config.server.logs_dir = dir.join("logs");
    config.server.terrain_dir = dir.join("terrain");
    config.terrain.width_m = 14.0;
    config.link.up_delay_s = 0.02;
    config.link.down_delay_s = 0.02;
    // The tests' clocks run faster than the machine can follow at times.
    config.commands.silence_max_s = 0.0;
    config
}

impl Ground {
    /// The demo, on a small ground.
    pub async fn start() -> Ground {
        Ground::with(|_| {}).await
    }

    pub async fn with(change: impl FnOnce(&mut Config)) -> Ground {
        let dir = TempDir::new();
        let mut config = config(dir.path());
        change(&mut config);
        Ground::of(Mission::of(config), dir).await
    }

    pub async fn of(mission: Mission, dir: TempDir) -> Ground {
        let clock = Arc::new(TestClock::new());
        let server = Server::start(mission, clock.clone()).unwrap();
        let router = api::router(server.app.clone());
        let ground = Ground { router, clock, dir, server: Some(server) };
        ground.until("telemetry", || async { ground.get("/ready").await.status == 200 }).await;
        ground
    }

    /// What its routes share.
    pub fn app(&self) -> &server::app::AppState {
        &self.server.as_ref().unwrap().app
    }

    /// Ends the session; gives the folder of its log.
    pub async fn finish(mut self) -> TempDir {
        self.server.take().unwrap().finish().await;
        self.dir
    }

    pub async fn send(&self, request: Request<Body>) -> Answer {
        let response = self.router.clone().oneshot(request).await.unwrap();
        let (parts, body) = response.into_parts();
        let bytes = body.collect().await.unwrap().to_bytes().to_vec();
        Answer { status: parts.status, headers: parts.headers, bytes }
    }

    pub async fn call(&self, method: &str, path: &str, body: Option<&Value>) -> Answer {
        let request = Request::builder().method(method).uri(path);
        let request = match body {
            Some(body) => request
                .header("content-type", "application/json")
                .body(Body::from(body.to_string()))
                .unwrap(),
            None => request.body(Body::empty()).unwrap(),
        };
        self.send(request).await
    }

    pub async fn get(&self, path: &str) -> Answer {
        self.call("GET", path, None).await
    }

    /// Posts below `/api/v1/`.
    pub async fn post(&self, path: &str, body: &Value) -> Answer {
        self.call("POST", &format!("/api/v1/{path}"), Some(body)).await
    }

    /// Waits for something that comes by itself.
    pub async fn until<F: Future<Output = bool>>(&self, what: &str, done: impl Fn() -> F) {
        for _ in 0..6000 {
            if done().await {
                return;
            }
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
        panic!("{what} did not come within a minute");
    }

    /// Waits for the end of a job; gives its report.
    pub async fn job(&self, accepted: &Answer) -> Value {
        assert_eq!(accepted.status, 202, "{}", accepted.json());
        let path = format!("/api/v1/jobs/{}", accepted.json()["id"].as_str().unwrap());
        let ended = |report: &Value| {
            matches!(report["state"].as_str(), Some("done" | "failed" | "cancelled"))
        };
        self.until("the job", || async { ended(&self.get(&path).await.json()) }).await;
        self.get(&path).await.json()
    }

    /// The last frame of the rover.
    pub async fn frame(&self) -> Value {
        self.get("/api/v1/rover").await.json()["latest"]["frame"].take()
    }

    /// Plans a step of a leg to a place relative to its contact; gives the plan.
    pub async fn plan(&self, leg: &str, by: [f64; 2]) -> Value {
        self.plan_with(leg, by, json!({})).await
    }

    /// As [`Ground::plan`] with more fields of the request.
    pub async fn plan_with(&self, leg: &str, [dx, dy]: [f64; 2], more: Value) -> Value {
        let frame = self.frame().await;
        let contact = &frame["contact_points_m"][leg];
        let place = [contact[0].as_f64().unwrap() + dx, contact[1].as_f64().unwrap() + dy, 0.0];
        let mut request = json!({ "leg": leg, "target": { "position_m": place } });
        request.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
        let report = self.job(&self.post("plans", &request).await).await;
        assert_eq!(report["state"], "done", "{report}");
        self.get(report["result"].as_str().unwrap()).await.json()
    }

    /// How far the wheel of a plan's leg is from where the plan puts it (m), as last reported.
    pub async fn off_footfall(&self, plan: &Value) -> f64 {
        let state = self.post("analysis/kinematics", &json!({})).await.json();
        let leg = plan["leg"].as_str().unwrap();
        let wheel = &state["states"][0]["wheels"][leg]["position_m"];
        let planned = &plan["footfall"]["wheel"]["position_m"];
        let off = |i: usize| wheel[i].as_f64().unwrap() - planned[i].as_f64().unwrap();
        off(0).hypot(off(1)).hypot(off(2))
    }

    /// Stages, arms and sends a command of a plan, and waits until it has ended; gives its record.
    pub async fn execute(&self, plan: &str, index: usize) -> Value {
        self.execute_of(json!({ "plan_id": plan, "index": index })).await
    }

    /// As [`Ground::execute`] for a part of the plan's way back.
    pub async fn execute_back(&self, plan: &str, index: usize) -> Value {
        self.execute_of(json!({ "plan_id": plan, "index": index, "retreat": true })).await
    }

    async fn execute_of(&self, plan: Value) -> Value {
        self.execute_request(&json!({ "plan": plan })).await
    }

    /// As [`Ground::execute`] for a command by hand.
    pub async fn execute_body(&self, body: &Value) -> Value {
        self.execute_request(&json!({ "body": body })).await
    }

    async fn execute_request(&self, request: &Value) -> Value {
        let staged = self.post("commands", request).await;
        assert_eq!(staged.status, 201, "{}", staged.json());
        let id = staged.json()["id"].as_str().unwrap().to_owned();
        for act in ["arm", "send"] {
            let answer = self.post(&format!("commands/{id}/{act}"), &json!({})).await;
            assert_eq!(answer.status, 200, "{act}: {}", answer.json());
        }
        self.clock.run_at(40.0);
        let path = format!("/api/v1/commands/{id}");
        let under_way =
            |state: &Value| matches!(state.as_str(), Some("sent" | "received" | "executing"));
        self.until("the end of the command", || async {
            !under_way(&self.get(&path).await.json()["state"])
        })
        .await;
        self.clock.run_at(1.0);
        self.frame_after_now().await;
        self.get(&path).await.json()
    }

    /// Waits for a frame that was true after this moment: acknowledgments go before telemetry, so that the
    /// last frame is older than what is already known of a command.
    async fn frame_after_now(&self) {
        let now = self.clock.now();
        self.until("a frame", || async {
            let latest = self.get("/api/v1/rover").await.json()["latest"].take();
            let true_at = latest["onboard_time"].as_str().map(Timestamp::from_rfc3339);
            true_at.is_some_and(|at| at.unwrap() > now)
        })
        .await;
    }
}
