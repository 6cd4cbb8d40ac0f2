//! The route for viewers, with the client that viewers use.

use std::collections::BTreeMap;
use std::io::Read;
use std::path::Path;
use std::process::{Command, Stdio};

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use bridge::catalog;
use bridge::reader::Limits;
use prost::Message as _;
use serde_json::{Value, json};
use testkit::note_skipped;
use tokio_tungstenite::tungstenite::client::IntoClientRequest;
use tokio_tungstenite::tungstenite::{Error, Message};
use tokio_tungstenite::{WebSocketStream, connect_async};

use wire::foxglove::schema::FrameTransforms;

use crate::stream::{Socket, listening, say};
use crate::support::Ground;

/// What came of each topic: time and content.
type Heard = BTreeMap<String, Vec<(u64, String)>>;

/// Lets the stock client listen to `url` until it has `count` messages. Time goes fast as long as the
/// client keeps up, so that a slow machine makes the test slow and nothing else.
async fn heard_by_the_stock_client(
    ground: &Ground,
    url: &str,
    protocol: &str,
    count: u32,
    speed: f64,
) -> Heard {
    let path = ground.dir.path().join("heard.txt");
    std::fs::write(&path, "").unwrap();
    let mut client = Command::new("node")
        .arg("--experimental-websocket") // for versions of Node before 22
        .arg(testkit::project_dir().join("web/conformance/foxglove.mjs"))
        .args([url, protocol, &count.to_string()])
        .arg(&path)
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut file = std::fs::File::open(&path).unwrap();
    let (mut heard, mut at_start, mut text) = (0, true, Vec::new());
    // What was published and not heard when the first message came: from before the client was there.
    let mut missed = None;
    let status = loop {
        if let Some(status) = client.try_wait().unwrap() {
            break status;
        }
        text.clear();
        file.read_to_end(&mut text).unwrap();
        // A topic that is drawn begins with a slash, and is published by nobody.
        for byte in &text {
            heard += u64::from(at_start && *byte != b'/');
            at_start = *byte == b'\n';
        }
        if heard > 0 {
            let published = published_messages(ground);
            let missed = *missed.get_or_insert(published.saturating_sub(heard));
            ground.clock.run_at(if published > missed + heard + 500 { 1.0 } else { speed });
        }
        tokio::time::sleep(std::time::Duration::from_millis(10)).await;
    };
    ground.clock.run_at(1.0);
    let mut why = String::new();
    client.stderr.take().unwrap().read_to_string(&mut why).unwrap();
    assert!(status.success(), "after {heard} messages: {why}");
    lines_of(&path)
}

/// Messages of all channels so far; not those that the log has for viewers beside them.
fn published_messages(ground: &Ground) -> u64 {
    let (latest, _) = ground.app().live.bus.subscribe();
    latest.iter().map(|message| message.sequence).sum()
}

fn lines_of(file: &Path) -> Heard {
    let mut heard = Heard::new();
    for line in std::fs::read_to_string(file).unwrap().lines() {
        let mut fields = line.splitn(3, '\t');
        let mut field = || fields.next().unwrap().to_owned();
        let (topic, time, content) = (field(), field().parse().unwrap(), field());
        heard.entry(topic).or_default().push((time, content));
    }
    heard
}

/// What a log of the folder holds of each topic, as a viewer would hear it.
fn logged(logs: &Path, id: &str) -> Heard {
    let log = catalog::read_log(logs, id, Limits::default()).unwrap();
    let mut logged = Heard::new();
    for message in log.messages.into_iter().filter(|message| &*message.encoding == "json") {
        let content = String::from_utf8(message.data.to_vec()).unwrap();
        logged.entry(message.channel.to_string()).or_default().push((message.log_time.0, content));
    }
    logged
}

/// Every topic heard must be a run of the log without gap or repeat.
fn assert_runs(heard: &Heard, logged: &Heard) {
    for (topic, messages) in heard.iter().filter(|(topic, _)| !topic.starts_with('/')) {
        let all = &logged[topic];
        let first = all.iter().position(|message| *message == messages[0]);
        let first = first.unwrap_or_else(|| panic!("{topic}: the first message is in no log"));
        assert!(all[first..].starts_with(messages), "{topic}: what was heard is no run of the log");
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn ten_thousand_messages_reach_the_stock_client_as_they_stand_in_the_log() {
    let test = "server::ten_thousand_messages_reach_the_stock_client";
    if !testkit::project_dir().join("web/node_modules/@foxglove/ws-protocol").is_dir() {
        return note_skipped(test, "web/node_modules has no @foxglove/ws-protocol");
    }
    let ground = Ground::start().await;
    let url = format!("{}/foxglove", listening(&ground).await);
    let heard = heard_by_the_stock_client(&ground, &url, "foxglove.sdk.v1", 10_000, 60.0).await;
    let published = heard.iter().filter(|(topic, _)| !topic.starts_with('/'));
    assert_eq!(published.map(|(_, messages)| messages.len()).sum::<usize>(), 10_000);
    assert!(heard["rover/state"].len() > 3000 && heard["rover/stability"].len() > 3000);

    let log = ground.get("/api/v1/logs").await.json()["logs"][0]["id"].clone();
    // A replay gives the same, under the other name of the protocol.
    let replay = ground.post("replays", &json!({ "log": log, "rate": 20.0 })).await.json();
    let of_replay = format!("{url}?replay={}", replay["id"].as_str().unwrap());
    let replayed =
        heard_by_the_stock_client(&ground, &of_replay, "foxglove.websocket.v1", 1000, 1.0).await;

    let dir = ground.finish().await;
    let logged = logged(&dir.path().join("logs"), log.as_str().unwrap());
    assert_runs(&heard, &logged);
    assert_runs(&replayed, &logged);
    assert_drawn(&heard);
    assert_drawn(&replayed);
}

/// Every frame of the rover is drawn: its links at its time, the base where the frame says.
fn assert_drawn(heard: &Heard) {
    let states = &heard["rover/state"];
    for topic in ["/tf", "/joints", "/scene/forces"] {
        assert_same_times(heard, topic, "rover/state");
    }
    assert_same_times(heard, "/scene/stance", "rover/stability");
    for (time, content) in &heard["/tf"] {
        let Some((_, state)) = states.iter().find(|(at, _)| at == time) else { continue };
        let state: Value = serde_json::from_str(state).unwrap();
        let bytes = STANDARD.decode(content).unwrap();
        let transforms = FrameTransforms::decode(bytes.as_slice()).unwrap().transforms;
        assert!(transforms.len() > 37);
        let base = transforms[0].translation.unwrap();
        assert_eq!(json!([base.x, base.y, base.z]), state["state"]["base"]["position_m"]);
    }
}

/// What is drawn has the times of what it is drawn from, from the moment when both were subscribed to
/// (they are asked for one after the other, while time goes fast) until the client leaves.
fn assert_same_times(heard: &Heard, drawn: &str, source: &str) {
    let of = |topic: &str| heard[topic].iter().map(|(time, _)| *time).collect::<Vec<u64>>();
    let (drawn_at, source_at) = (of(drawn), of(source));
    let both =
        drawn_at[0].max(source_at[0])..=drawn_at.last().min(source_at.last()).copied().unwrap();
    let within = |times: &[u64]| -> Vec<u64> {
        times.iter().copied().filter(|time| both.contains(time)).collect()
    };
    let (drawn_at, source_at) = (within(&drawn_at), within(&source_at));
    let differ = drawn_at.iter().zip(&source_at).position(|(a, b)| a != b);
    let at = |k: usize| (&drawn_at[k - 2..k + 3], &source_at[k - 2..k + 3]);
    assert_eq!(differ, None, "{drawn}: {:?}", differ.map(at));
    // The client leaves after a message that may share its time with others.
    assert!(drawn_at.len().abs_diff(source_at.len()) <= 1, "{drawn}");
    assert!(source_at.len() > heard[source].len() / 2, "{drawn}: hardly anything is common");
}

async fn viewer(url: &str) -> Socket {
    let mut request = url.into_client_request().unwrap();
    request.headers_mut().insert("sec-websocket-protocol", "foxglove.sdk.v1".parse().unwrap());
    let (socket, answer) = connect_async(request).await.unwrap();
    assert_eq!(answer.headers()["sec-websocket-protocol"], "foxglove.sdk.v1");
    socket
}

/// The next text frame; binary ones are passed over.
async fn text<S>(socket: &mut WebSocketStream<S>) -> Value
where
    S: tokio::io::AsyncRead + tokio::io::AsyncWrite + Unpin,
{
    use futures_util::StreamExt;
    loop {
        if let Message::Text(text) = socket.next().await.unwrap().unwrap() {
            return serde_json::from_str(&text).unwrap();
        }
    }
}

#[tokio::test]
async fn a_viewer_that_asks_for_what_is_not_there_is_told() {
    let ground = Ground::start().await;
    let url = format!("{}/foxglove", listening(&ground).await);
    let mut socket = viewer(&url).await;
    let info = text(&mut socket).await;
    assert_eq!((&info["op"], &info["capabilities"]), (&json!("serverInfo"), &json!([])));
    let channels = text(&mut socket).await;
    let topics: Vec<_> = channels["channels"].as_array().unwrap().iter().collect();
    assert!(topics.iter().any(|c| c["topic"] == "command/uplink" && c["encoding"] == "json"));
    let wish = |id: u32, channel: u32| json!({ "op": "subscribe", "subscriptions": [{ "id": id, "channelId": channel }] });
    for (request, word) in [
        (wish(1, 999), "no channel 999"),
        (json!({ "op": "advertise", "channels": [] }), "read-only"),
        (json!({ "op": "subscribe" }), "subscriptions"),
        (json!([]), "read-only"),
    ] {
        say(&mut socket, request).await;
        let answer = text(&mut socket).await;
        assert_eq!((&answer["op"], &answer["level"]), (&json!("status"), &json!(2)));
        assert!(answer["message"].as_str().unwrap().contains(word), "{answer}");
    }
    say(&mut socket, wish(1, 0)).await;
    say(&mut socket, wish(1, 0)).await;
    assert!(text(&mut socket).await["message"].as_str().unwrap().contains("is in use"));
}

/// The next message under a subscription: which, and its content.
async fn message(socket: &mut Socket) -> (u32, Vec<u8>) {
    use futures_util::StreamExt;
    loop {
        if let Some(told) = content(&socket.next().await.unwrap().unwrap()) {
            return told;
        }
    }
}

/// Of a message under a subscription: which, and its content.
fn content(frame: &Message) -> Option<(u32, Vec<u8>)> {
    let Message::Binary(bytes) = frame else { return None };
    let id = u32::from_le_bytes(bytes[1..5].try_into().unwrap());
    (bytes[0] == 1).then(|| (id, bytes[13..].to_vec()))
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn viewers_see_the_cameras_as_the_log_has_them() {
    let ground = Ground::start().await;
    let url = format!("{}/foxglove", listening(&ground).await);
    let mut socket = viewer(&url).await;
    text(&mut socket).await;
    let channels = text(&mut socket).await["channels"].as_array().unwrap().clone();
    let cameras: Vec<&str> = channels.iter().filter_map(|c| c["topic"].as_str()).collect();
    let cameras = cameras.into_iter().filter(|topic| topic.starts_with("/camera/"));
    assert_eq!(cameras.count(), 9 * 2 * 3, "nine pairs, two sides, three topics");
    let topics: Vec<String> = ["left", "right"]
        .into_iter()
        .flat_map(|side| {
            ["image", "calibration", "tf"].map(|what| format!("/camera/haz1/{side}/{what}"))
        })
        .collect();
    let schemas = ["CompressedImage", "CameraCalibration", "FrameTransform"];
    let wishes: Vec<Value> = topics
        .iter()
        .enumerate()
        .map(|(id, topic)| {
            let channel = channels.iter().find(|c| c["topic"] == **topic).unwrap();
            assert_eq!(channel["schemaName"], format!("foxglove.{}", schemas[id % 3]), "{channel}");
            assert_eq!(channel["encoding"], "protobuf");
            json!({ "id": id, "channelId": channel["id"] })
        })
        .collect();
    let subscribe = json!({ "op": "subscribe", "subscriptions": wishes });
    say(&mut socket, subscribe.clone()).await;
    // Heard meanwhile, so that the viewer gives signs of life however long the images take.
    let (told, mut hears) = tokio::sync::mpsc::unbounded_channel();
    tokio::spawn(async move {
        use futures_util::StreamExt;
        // Nobody listens any more once the test is over.
        while let Some(Ok(frame)) = socket.next().await {
            let _ = told.send(frame);
        }
    });
    let order = |pairs: &[&str]| json!({ "type": "image", "pairs": pairs, "scale": 0.25, "simulated": { "seed": 5 } });
    // What another camera sees is not told under these.
    let record = ground.execute_body(&order(&["haz2", "haz1"])).await;
    let capture = format!("/api/v1/rover/images/{}", record["id"].as_str().unwrap());
    let ended = || async { ground.get(&capture).await.json()["state"] == "complete" };
    ground.until("the images", ended).await;
    // All of them come, or, where a busy machine kept the viewer from listening, it is told that some are missed.
    let mut heard: BTreeMap<u32, Vec<u8>> = BTreeMap::new();
    let mut is_gap_told = false;
    let wait = std::time::Duration::from_secs(10);
    while heard.len() < topics.len()
        && let Ok(Some(frame)) = tokio::time::timeout(wait, hears.recv()).await
    {
        match frame {
            Message::Text(text) => is_gap_told |= text.contains("messages were not sent"),
            frame => {
                if let Some((id, content)) = content(&frame) {
                    assert!(heard.insert(id, content).is_none(), "{id} came twice");
                }
            }
        }
    }
    assert!(heard.len() == topics.len() || is_gap_told, "only {:?} came, untold", heard.keys());
    // Who comes later begins with the newest image of each camera.
    let mut late = viewer(&url).await;
    say(&mut late, subscribe).await;
    for _ in 0..topics.len() {
        let (id, content) = message(&mut late).await;
        assert!(heard.get(&id).is_none_or(|before| *before == content), "{id}");
        heard.insert(id, content);
    }
    assert_eq!(heard.len(), topics.len());
    let log = ground.get("/api/v1/rover").await.json()["log_id"].as_str().unwrap().to_owned();
    let dir = ground.finish().await;
    let log = catalog::read_log(&dir.path().join("logs"), &log, Limits::default()).unwrap();
    for (id, topic) in topics.iter().enumerate() {
        let mut logged = log.messages.iter().filter(|message| *message.channel == **topic);
        assert_eq!(heard[&(id as u32)], logged.next().unwrap().data.to_vec(), "{topic}");
        assert!(logged.next().is_none());
    }
}

#[tokio::test]
async fn without_a_known_subprotocol_or_from_another_site_there_is_no_viewer() {
    let ground = Ground::start().await;
    let url = format!("{}/foxglove", listening(&ground).await);
    let refused = |header: &'static str, value: &'static str, url: String| async move {
        let mut request = url.into_client_request().unwrap();
        request.headers_mut().insert(header, value.parse().unwrap());
        match connect_async(request).await.unwrap_err() {
            Error::Http(answer) => answer.status().as_u16(),
            other => panic!("{other:?}"),
        }
    };
    assert_eq!(refused("x-operator", "nobody", url.clone()).await, 400);
    assert_eq!(refused("sec-websocket-protocol", "mqtt", url.clone()).await, 400);
    assert_eq!(refused("origin", "https://evil.example", url.clone()).await, 403);
    let of_replay = format!("{url}?replay=none");
    assert_eq!(refused("sec-websocket-protocol", "foxglove.sdk.v1", of_replay).await, 404);
}
