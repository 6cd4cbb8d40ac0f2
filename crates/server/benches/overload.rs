//! Ten times the work that can be done (S7): how soon what is too much is refused, and how long an E-stop takes
//! from the request until it is with the link (L3), with nothing else to do and under that load.

#![allow(missing_docs, clippy::unwrap_used)] // a benchmark

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use axum::Router;
use axum::body::Body;
use axum::http::Request;
use bridge::clock::SystemClock;
use criterion::{Criterion, SamplingMode, criterion_group, criterion_main};
use serde_json::{Value, json};
use server::api;
use server::config::Config;
use server::serve::{Mission, Server};
use tokio::sync::mpsc;
use tokio::time::Instant;
use tower::ServiceExt;

/// Requests that are made again as soon as they are answered; two are worked at, sixteen wait.
const CALLERS: usize = 180;
/// E-stops of one run.
const ESTOPS: usize = 50;

async fn post(router: &Router, path: &str, body: &Value) -> (u16, Duration) {
    let request = Request::post(format!("/api/v1/{path}"))
        .header("content-type", "application/json")
        .header("host", "127.0.0.1")
        .body(Body::from(body.to_string()))
        .unwrap();
    let asked = Instant::now();
    let answer = router.clone().oneshot(request).await.unwrap();
    (answer.status().as_u16(), asked.elapsed())
}

/// Calls for analyses until told to stop; how long each refusal took.
fn load(router: &Router, stop: &Arc<AtomicBool>) -> mpsc::UnboundedReceiver<Duration> {
    let (sender, refused) = mpsc::unbounded_channel();
    for _ in 0..CALLERS {
        let (router, stop, sender) = (router.clone(), stop.clone(), sender.clone());
        tokio::spawn(async move {
            let body = json!({
                "scene": { "terrain": { "plane": {} } }, "legs": ["leg1"], "resolution_m": 0.08,
            });
            while !stop.load(Ordering::Relaxed) {
                match post(&router, "analysis/reachability", &body).await {
                    (200, _) => {}
                    (429, after) => {
                        let _ = sender.send(after);
                        // Told to come again in a second, it comes sooner.
                        tokio::time::sleep(Duration::from_millis(250)).await;
                    }
                    (other, _) => panic!("answered {other}"),
                }
            }
        });
    }
    refused
}

fn overload(c: &mut Criterion) {
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build().unwrap();
    let dir = testkit::project_dir().join("target/bench-overload");
    let mut config = Config::demo();
    config.server.logs_dir = dir.join("logs");
    config.server.terrain_dir = dir.join("terrain");
    let (server, router) = runtime.block_on(async {
        let server = Server::start(Mission::of(config), Arc::new(SystemClock::new())).unwrap();
        let router = api::router(server.app.clone());
        (server, router)
    });
    // The answer comes after the E-stop was handed to the link: what is measured is more than the promise's.
    let estops = || {
        let router = &router;
        async move {
            let mut times = Vec::new();
            for _ in 0..ESTOPS {
                tokio::time::sleep(Duration::from_millis(20)).await;
                let (status, took) = post(router, "estop", &json!({})).await;
                assert_eq!(status, 200);
                times.push(took);
            }
            times.into_iter().max().unwrap()
        }
    };
    let mut group = c.benchmark_group("ten times the work that can be done");
    // What is returned is far less than what it takes: one run a sample, or it would take for ever.
    group.sampling_mode(SamplingMode::Flat).sample_size(10);
    group.warm_up_time(Duration::from_nanos(1)).measurement_time(Duration::from_nanos(1));
    group.bench_function(
        "E-stop until it is with the link, nothing else to do, worst of 50 (baseline)",
        |b| {
            b.iter_custom(|n| (0..n).map(|_| runtime.block_on(estops())).sum());
        },
    );
    let stop = Arc::new(AtomicBool::new(false));
    let mut refused = runtime.block_on(async { load(&router, &stop) });
    group.bench_function("E-stop until it is with the link, worst of 50", |b| {
        b.iter_custom(|n| (0..n).map(|_| runtime.block_on(estops())).sum());
    });
    group.bench_function("refused, p99", |b| {
        b.iter_custom(|n| {
            (0..n)
                .map(|_| {
                    runtime.block_on(async {
                        while refused.try_recv().is_ok() {}
                        let mut times = Vec::new();
                        while times.len() < 500 {
                            times.push(refused.recv().await.unwrap());
                        }
                        times.sort_unstable();
                        times[times.len() * 99 / 100]
                    })
                })
                .sum()
        });
    });
    stop.store(true, Ordering::Relaxed);
    group.finish();
    runtime.block_on(server.finish());
    let _ = std::fs::remove_dir_all(dir);
}

criterion_group!(benches, overload);
criterion_main!(benches);
