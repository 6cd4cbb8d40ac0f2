//! How the margins went before a place of a replay: against the log itself.

use std::collections::BTreeMap;
use std::io::Cursor;

use mcap::records::MessageHeader;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::{Value, json};
use server::serve::Mission;
use wire::time::Timestamp;

use crate::support::{Ground, TempDir, config};

const START: Timestamp = Timestamp(1_790_000_000_000_000_000);
/// Time on board before time on the ground (s).
const AGE_S: f64 = 1.3;

/// Regular and friction margin (m), four times a second; now and then there is no region.
fn told() -> Vec<(Timestamp, [Option<f64>; 2])> {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    (0..4 * 600)
        .map(|i| {
            let mut margin =
                || rng.random_bool(0.95).then(|| f64::from(rng.random_range(0..1000)) / 1000.0);
            (START.plus_seconds(f64::from(i) / 4.0), [margin(), margin()])
        })
        .collect()
}

/// The log, in small chunks, between frames of another channel. One message cannot be understood.
fn file() -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let options = mcap::WriteOptions::new().chunk_size(Some(10_000));
    let mut writer = options.create(&mut bytes).unwrap();
    let [margins, other] = ["rover/stability", "event"]
        .map(|topic| writer.add_channel(0, topic, "json", &BTreeMap::new()).unwrap());
    for (sequence, (at, [regular, friction])) in (0..).zip(told()) {
        let polygon = |margin: Option<f64>| margin.map(|m| json!({ "margin_m": m }));
        let message = match sequence {
            40 => json!({ "regular": "none" }),
            _ => json!({
                "regular": polygon(regular), "conservative": null,
                "forces": { "friction": { "region": polygon(friction) } },
            }),
        };
        let event = json!({ "level": "info", "text": "goes on", "who": "server" });
        for (channel_id, message) in [(other, event), (margins, message)] {
            let log_time = at.plus_seconds(AGE_S).0;
            let header = MessageHeader { channel_id, sequence, log_time, publish_time: at.0 };
            writer.write_to_known_channel(&header, message.to_string().as_bytes()).unwrap();
        }
    }
    writer.finish().unwrap();
    drop(writer);
    bytes.into_inner()
}

/// The least of each half second that came by `place`, of five minutes, in order.
fn expected(place: Timestamp) -> Vec<(u64, [Option<f64>; 2])> {
    let by_then = |at: Timestamp| at.plus_seconds(AGE_S).0 <= place.0;
    let all: Vec<_> = told().into_iter().filter(|(at, _)| by_then(*at)).collect();
    let Some((last, _)) = all.last().copied() else { return Vec::new() };
    let mut least = BTreeMap::new();
    for (i, (at, margins)) in all.into_iter().enumerate() {
        if i == 40 || last.seconds_since(at) > 300.0 {
            continue;
        }
        let so_far = least.entry(at.0 / 500_000_000).or_insert(margins);
        for (least, margin) in so_far.iter_mut().zip(margins) {
            *least = least.zip(margin).map(|(a, b): (f64, f64)| a.min(b));
        }
    }
    least.into_iter().collect()
}

#[tokio::test]
async fn after_a_jump_the_margins_of_the_minutes_before_are_those_of_the_log() {
    let dir = TempDir::new();
    let config = config(dir.path());
    let logs = config.server.logs_dir.clone();
    std::fs::create_dir_all(&logs).unwrap();
    std::fs::write(logs.join("flown.mcap"), file()).unwrap();
    let ground = Ground::of(Mission::of(config), dir).await;
    let replay = ground.post("replays", &json!({ "log": "flown", "rate": 1.0 })).await.json();
    let path = format!("/api/v1/replays/{}", replay["id"].as_str().unwrap());
    for (seconds, n_samples) in [(700.0, 601), (400.3, 601), (12.0, 23), (590.0, 601), (0.0, 0)] {
        let place = START.plus_seconds(seconds);
        let change = json!({ "at": place, "paused": true });
        assert_eq!(ground.call("PATCH", &path, Some(&change)).await.status, 200);
        let answer = ground.get(&format!("{path}/margins")).await.json();
        assert_eq!(answer["complete"], true);
        let samples: Vec<(u64, [Option<f64>; 2])> = answer["samples"]
            .as_array()
            .unwrap()
            .iter()
            .map(|sample| {
                let at: Timestamp = serde_json::from_value(sample["at"].clone()).unwrap();
                assert_eq!(sample.get("conservative_m"), None);
                (at.0 / 500_000_000, ["regular_m", "friction_m"].map(|k| sample[k].as_f64()))
            })
            .collect();
        // A replay begins with its first message.
        let by = if seconds == 0.0 { START.plus_seconds(AGE_S) } else { place };
        assert_eq!(samples, expected(by), "at {seconds} s");
        assert!(samples.len().abs_diff(n_samples) <= 2, "{} at {seconds} s", samples.len());
    }
    let gone = ground.get("/api/v1/replays/none/margins").await;
    assert_eq!((gone.status.as_u16(), gone.code().as_str()), (404, "replay_unknown"));
    assert_ne!(replay["id"], Value::Null);
}
