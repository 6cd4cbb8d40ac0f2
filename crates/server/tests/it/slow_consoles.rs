//! Many consoles: who takes nothing loses messages, is told how many, and harms nobody else (S1).

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use bridge::bus::ChannelMessage;
use futures_util::StreamExt;
use serde_json::{Value, json};
use tokio::sync::watch;
use tokio_tungstenite::connect_async;
use tokio_tungstenite::tungstenite::Message;
use wire::live::channel;

use crate::stream::{Socket, listening, say};
use crate::support::Ground;

/// A channel that is in logs only, so that nobody else publishes on it.
const CHANNEL: &str = channel::LOG_GAP;
/// More than the bus, the queue of a listener and the buffers of its socket hold together.
const MESSAGES: u64 = 9000;
const BYTES: usize = 2000;
/// Healthy consoles are let so far behind.
const BURST: u64 = 200;

/// What a console has heard.
#[derive(Debug, Default)]
struct Heard {
    /// The last number of each channel.
    last: BTreeMap<String, u64>,
    /// Numbers left out, over all channels.
    holes: u64,
    /// What it was told to have missed.
    told: u64,
}

/// Listens until the last message; tells how far it is.
async fn listen(mut socket: Socket, progress: Arc<AtomicU64>) -> Heard {
    let mut heard = Heard::default();
    while heard.last.get(CHANNEL) != Some(&MESSAGES) {
        let Message::Text(text) = socket.next().await.unwrap().unwrap() else { continue };
        let frame: Value = serde_json::from_str(&text).unwrap();
        match frame["op"].as_str() {
            Some("gap") => heard.told += frame["missed"].as_u64().unwrap(),
            Some("message") => {
                let name = frame["channel"].as_str().unwrap().to_owned();
                let sequence = frame["sequence"].as_u64().unwrap();
                let before = heard.last.insert(name.clone(), sequence);
                heard.holes += before.map_or(0, |before| sequence - before - 1);
                if name == CHANNEL {
                    progress.store(sequence, Ordering::Release);
                }
            }
            _ => {}
        }
    }
    heard
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_console_that_takes_nothing_is_told_what_it_missed_and_the_others_miss_nothing() {
    let ground = Ground::start().await;
    let url = format!("{}/api/v1/stream", listening(&ground).await);
    let (go_on, going) = watch::channel(false);
    let (mut healthy, mut stopped, mut progress) = (Vec::new(), Vec::new(), Vec::new());
    for number in 0..6 {
        let (mut socket, _) = connect_async(&url).await.unwrap();
        say(&mut socket, json!({ "op": "subscribe" })).await;
        // Its latest messages come: it is a listener now.
        while !matches!(socket.next().await, Some(Ok(Message::Text(t))) if t.contains("rover/state"))
        {
        }
        let at = Arc::new(AtomicU64::new(0));
        if number < 4 {
            progress.push(at.clone());
            healthy.push(tokio::spawn(listen(socket, at)));
        } else {
            let mut going = going.clone();
            stopped.push(tokio::spawn(async move {
                going.wait_for(|going| *going).await.unwrap();
                listen(socket, at).await
            }));
        }
    }
    let text: Arc<str> = "x".repeat(BYTES).into();
    for sequence in 1..=MESSAGES {
        let now = ground.app().clock.now();
        ground.app().live.bus.publish(ChannelMessage {
            channel: CHANNEL.into(),
            sequence,
            onboard_time: now,
            sent_time: now,
            received_time: now,
            json: format!("\"{text}\"").into(),
        });
        while progress.iter().any(|at| at.load(Ordering::Acquire) + BURST < sequence) {
            tokio::time::sleep(Duration::from_millis(1)).await;
        }
    }
    for console in healthy {
        let heard = console.await.unwrap();
        assert_eq!((heard.holes, heard.told), (0, 0), "{heard:?}");
    }
    go_on.send(true).unwrap();
    for console in stopped {
        let heard = console.await.unwrap();
        assert!(heard.told > 0, "it was far behind");
        assert_eq!(heard.holes, heard.told, "{heard:?}");
    }
    let status = ground.app().live.locked().0.recorder_status();
    assert_eq!(status.dropped, 0, "the flight log has it all");
}
