//! Many consoles: who takes nothing or little loses messages, is told how many, and harms nobody else (S1).
//!
//! `FOOTFALL_FULL=1`: 100 consoles, of which ten take nothing and ten take 10 kB/s; times are printed, and
//! belong to a machine with nothing else to do.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use bridge::bus::ChannelMessage;
use futures_util::StreamExt;
use serde_json::{Value, json};
use tokio::sync::watch;
use tokio::time::Instant;
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
/// The last of these are published at 50 a second, to see how long they take to healthy consoles.
const TIMED: u64 = 100;
/// What a slow console takes (bytes a second).
const SLOW_BYTES_S: f64 = 10_000.0;

/// What a console has heard.
#[derive(Debug)]
struct Heard {
    /// The last number of each channel.
    last: BTreeMap<String, u64>,
    /// What comes is still the latest message of each channel, in order of their names.
    beginning: bool,
    /// Numbers left out, over all channels.
    holes: u64,
    /// What it was told to have missed.
    told: u64,
    /// From publishing to here, of the last messages.
    delays_s: Vec<f64>,
}

impl Heard {
    fn new() -> Heard {
        Heard { last: BTreeMap::new(), beginning: true, holes: 0, told: 0, delays_s: Vec::new() }
    }

    /// Takes a frame; the message that it is, if it is one.
    fn take(&mut self, text: &str) -> Option<(String, u64, Value)> {
        let mut frame: Value = serde_json::from_str(text).unwrap();
        match frame["op"].as_str() {
            Some("gap") => {
                self.beginning = false;
                self.told += frame["missed"].as_u64().unwrap();
                None
            }
            Some("message") => {
                let name = frame["channel"].as_str().unwrap().to_owned();
                let sequence = frame["sequence"].as_u64().unwrap();
                self.beginning &= self.last.keys().next_back().is_none_or(|last| *last < name);
                // A channel that was silent before has its first message later, with number 1.
                let before = self.last.insert(name.clone(), sequence).unwrap_or(0);
                self.holes += if self.beginning { 0 } else { sequence - before - 1 };
                Some((name, sequence, frame["message"].take()))
            }
            _ => None,
        }
    }
}

/// Listens until the last message; tells how far it is. Takes its time over each until it may go on.
async fn listen(
    mut socket: Socket,
    mut heard: Heard,
    progress: Arc<AtomicU64>,
    begin: Instant,
    slow: Option<watch::Receiver<bool>>,
) -> Heard {
    while heard.last.get(CHANNEL) != Some(&MESSAGES) {
        let Message::Text(text) = socket.next().await.unwrap().unwrap() else { continue };
        if slow.as_ref().is_some_and(|going| !*going.borrow()) {
            tokio::time::sleep(Duration::from_secs_f64(text.len() as f64 / SLOW_BYTES_S)).await;
        }
        let Some((name, sequence, message)) = heard.take(&text) else { continue };
        if name == CHANNEL {
            progress.store(sequence, Ordering::Release);
            if sequence > MESSAGES - TIMED {
                let at_s = message["at_s"].as_f64().unwrap();
                heard.delays_s.push(begin.elapsed().as_secs_f64() - at_s);
            }
        }
    }
    heard
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn consoles_that_take_little_are_told_what_they_missed_and_the_others_miss_nothing() {
    let full = std::env::var_os("FOOTFALL_FULL").is_some();
    // Healthy, stopped, and slow ones.
    let kinds = if full { [80, 10, 10] } else { [4, 2, 1] };
    let ground = Ground::with(|config| config.server.listeners_max = 120).await;
    let url = format!("{}/api/v1/stream", listening(&ground).await);
    let begin = Instant::now();
    let (go_on, going) = watch::channel(false);
    let (mut healthy, mut behind, mut progress) = (Vec::new(), Vec::new(), Vec::new());
    for (kind, n) in kinds.into_iter().enumerate() {
        for _ in 0..n {
            let (mut socket, _) = connect_async(&url).await.unwrap();
            say(&mut socket, json!({ "op": "subscribe" })).await;
            // Its latest messages come: it is a listener now.
            let mut heard = Heard::new();
            while !heard.last.contains_key(channel::ROVER_STATE) {
                if let Message::Text(text) = socket.next().await.unwrap().unwrap() {
                    heard.take(&text);
                }
            }
            let at = Arc::new(AtomicU64::new(0));
            let mut going = going.clone();
            match kind {
                0 => {
                    progress.push(at.clone());
                    healthy.push(tokio::spawn(listen(socket, heard, at, begin, None)));
                }
                1 => behind.push(tokio::spawn(async move {
                    going.wait_for(|going| *going).await.unwrap();
                    listen(socket, heard, at, begin, None).await
                })),
                _ => behind.push(tokio::spawn(listen(socket, heard, at, begin, Some(going)))),
            }
        }
    }
    let text: Arc<str> = "x".repeat(BYTES).into();
    let mut tick = tokio::time::interval(Duration::from_millis(20));
    for sequence in 1..=MESSAGES {
        if sequence > MESSAGES - TIMED {
            tick.tick().await;
        }
        // What is timed does not wait behind what was too much.
        let behind = if sequence == MESSAGES - TIMED { 0 } else { BURST };
        let now = ground.app().clock.now();
        let at_s = begin.elapsed().as_secs_f64();
        ground.app().live.bus.publish(ChannelMessage {
            channel: CHANNEL.into(),
            sequence,
            onboard_time: now,
            sent_time: now,
            received_time: now,
            json: format!("{{\"at_s\":{at_s},\"filler\":\"{text}\"}}").into(),
        });
        while progress.iter().any(|at| at.load(Ordering::Acquire) + behind < sequence) {
            tokio::time::sleep(Duration::from_millis(1)).await;
        }
    }
    // All hear the same order, so that this is what there was before the last message, on each channel.
    let mut all = BTreeMap::new();
    let mut delays_s = Vec::new();
    for console in healthy {
        let heard = console.await.unwrap();
        assert_eq!((heard.holes, heard.told), (0, 0), "{:?}", heard.last);
        delays_s.extend(heard.delays_s);
        all = heard.last;
    }
    go_on.send(true).unwrap();
    let mut missed = 0;
    for console in behind {
        let heard = console.await.unwrap();
        assert!(heard.told > 0, "it was far behind");
        // Of a channel that then was silent no later number shows the hole.
        let at_end = |(name, last): (&String, &u64)| last - heard.last.get(name).unwrap_or(&0);
        let holes = heard.holes + all.iter().map(at_end).sum::<u64>();
        assert_eq!(holes, heard.told, "{:?} of {all:?}", heard.last);
        missed += heard.told;
    }
    let status = ground.app().live.locked().0.recorder_status();
    assert_eq!(status.dropped, 0, "the flight log has it all");
    delays_s.sort_by(f64::total_cmp);
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).unwrap_or_default();
    let peak_mb = peak.trim().trim_end_matches(" kB").parse().unwrap_or(0) / 1000;
    eprintln!(
        "consoles {kinds:?}: delay to healthy ones {:.1} ms p99, {missed} messages missed by the others and \
         told; memory at most {peak_mb} MB, that of the consoles included",
        delays_s[delays_s.len() * 99 / 100] * 1e3
    );
    assert!(!full || peak_mb < 500, "{peak_mb} MB");
}
