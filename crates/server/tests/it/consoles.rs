//! Many consoles at once hear everything or are told what they missed (S2); more work than can be done
//! is refused, and the E-stop passes (S7).
//!
//! `FOOTFALL_FULL=1`: 200 consoles at 50 messages of 1 kB a second for a minute, or for as long as
//! `FOOTFALL_CONSOLES_S` tells (s; the promise says 600); times are printed, and belong to a machine with
//! nothing else to do.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use futures_util::StreamExt;
use serde_json::{Value, json};
use tokio::time::Instant;
use tokio_tungstenite::connect_async;
use tokio_tungstenite::tungstenite::Message;
use wire::live::channel;

use crate::stream::{listening, say};
use crate::support::Ground;

/// What a console heard.
#[derive(Default)]
struct Heard {
    /// First and last number, and how many, of each channel.
    channels: BTreeMap<String, (u64, u64, u64)>,
    missed: u64,
    delays_s: Vec<f64>,
}

impl Heard {
    fn expected(&self) -> u64 {
        self.channels.values().map(|(first, last, _)| last - first + 1).sum()
    }

    fn heard(&self) -> u64 {
        self.channels.values().map(|(.., n)| n).sum()
    }
}

async fn console(url: String, begin: Instant) -> Heard {
    let (mut socket, _) = connect_async(url).await.unwrap();
    say(&mut socket, json!({ "op": "subscribe" })).await;
    let mut heard = Heard::default();
    loop {
        let next = tokio::time::timeout(Duration::from_secs(30), socket.next()).await;
        let Ok(Some(Ok(message))) = next else { panic!("the stream has ended") };
        let Message::Text(text) = message else { continue };
        let frame: Value = serde_json::from_str(&text).unwrap();
        match frame["op"].as_str() {
            Some("gap") => heard.missed += frame["missed"].as_u64().unwrap(),
            Some("message") => {
                let number = frame["sequence"].as_u64().unwrap();
                let name = frame["channel"].as_str().unwrap();
                let entry = heard.channels.entry(name.into()).or_insert((number, number, 0));
                assert!(entry.2 == 0 || number > entry.1, "{name}: {number} after {}", entry.1);
                (entry.1, entry.2) = (number, entry.2 + 1);
                let data = &frame["message"];
                if data["last"] == true {
                    return heard;
                }
                if let Some(at) = data["at_s"].as_f64() {
                    heard.delays_s.push(begin.elapsed().as_secs_f64() - at);
                }
            }
            _ => {}
        }
    }
}

/// Lets consoles listen while `per_s` messages of 1 kB are published for so long.
async fn serve(consoles: usize, per_s: f64, seconds: f64) -> Vec<Heard> {
    let ground = Ground::with(|config| config.server.listeners_max = 300).await;
    let url = format!("{}/api/v1/stream", listening(&ground).await);
    let begin = Instant::now();
    let consoles: Vec<_> =
        (0..consoles).map(|_| tokio::spawn(console(url.clone(), begin))).collect();
    tokio::time::sleep(Duration::from_millis(500)).await;
    let filler = "x".repeat(1000);
    let publish = |last: bool| {
        let (mut live, now) = ground.app().live.locked();
        let at_s = begin.elapsed().as_secs_f64();
        let message = json!({ "at_s": at_s, "last": last, "filler": filler });
        live.publish(now, channel::JOB, &message);
    };
    let mut tick = tokio::time::interval(Duration::from_secs_f64(1.0 / per_s));
    for _ in 0..(per_s * seconds) as u64 {
        tick.tick().await;
        publish(false);
    }
    publish(true);
    let mut heard = Vec::new();
    for console in consoles {
        heard.push(console.await.unwrap());
    }
    assert_eq!(ground.app().live.locked().0.recorder_status().dropped, 0, "the log has all");
    heard
}

fn told(heard: &[Heard]) {
    let mut delays: Vec<f64> = heard.iter().flat_map(|heard| heard.delays_s.clone()).collect();
    delays.sort_by(f64::total_cmp);
    let at = |share: f64| delays[((delays.len() - 1) as f64 * share) as usize] * 1e3;
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let rss = status.lines().find(|line| line.starts_with("VmHWM")).unwrap_or_default();
    let missed: u64 = heard.iter().map(|heard| heard.missed).sum();
    eprintln!(
        "{} consoles, {} messages, delay {:.1} ms median, {:.1} ms p99, {missed} missed and told; {rss}",
        heard.len(),
        delays.len(),
        at(0.5),
        at(0.99)
    );
    for (i, heard) in heard.iter().enumerate() {
        assert_eq!(
            heard.heard() + heard.missed,
            heard.expected(),
            "console {i}: a gap is not told"
        );
    }
}

fn full() -> bool {
    std::env::var_os("FOOTFALL_FULL").is_some()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn many_consoles_hear_everything_or_are_told_what_they_missed() {
    let asked = std::env::var("FOOTFALL_CONSOLES_S").map_or(60.0, |text| text.parse().unwrap());
    let (consoles, seconds) = if full() { (200, asked) } else { (20, 2.0) };
    told(&serve(consoles, 50.0, seconds).await);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn more_work_than_can_be_done_is_refused_and_the_estop_passes() {
    let ground = Arc::new(Ground::start().await);
    let load = if full() { 1000 } else { 60 };
    let before = ground.get("/api/v1/rover").await.json()["latest"]["sequence"].as_u64().unwrap();
    let begin = Instant::now();
    let asked: Vec<_> = (0..load)
        .map(|_| {
            let ground = ground.clone();
            tokio::spawn(async move {
                let body = json!({ "scene": { "terrain": { "plane": {} } }, "legs": ["leg1"], "resolution_m": 0.08 });
                let asked = Instant::now();
                let answer = ground.post("analysis/reachability", &body).await;
                (answer.status.as_u16(), answer.headers.contains_key("retry-after"), asked.elapsed())
            })
        })
        .collect();
    tokio::time::sleep(Duration::from_millis(100)).await;
    let stopped = ground.post("estop", &json!({})).await;
    assert_eq!(stopped.status, 200);
    let (taken, mut refused, mut slowest) = (begin.elapsed(), 0, Duration::ZERO);
    for asked in asked {
        let (status, retry, after) = asked.await.unwrap();
        match status {
            200 => {}
            429 => {
                assert!(retry, "when to come again is told");
                refused += 1;
                slowest = slowest.max(after);
            }
            other => panic!("answered {other}"),
        }
    }
    // Two places and sixteen that wait: the rest is sent away, at once.
    assert!(refused >= load - 18 - 20 && refused < load, "{refused} of {load} refused");
    ground
        .until("the rover's word", || async {
            ground.get("/api/v1/link").await.json()["estop"] == "confirmed"
        })
        .await;
    let after = ground.get("/api/v1/rover").await.json()["latest"]["sequence"].as_u64().unwrap();
    assert!(after > before, "telemetry goes on");
    eprintln!(
        "{refused} of {load} refused within {slowest:?}; E-stop taken {taken:?} after the begin"
    );
}
