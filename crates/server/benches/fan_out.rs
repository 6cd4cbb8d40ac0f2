//! Two hundred consoles on the stream, each of which hears 50 messages of 1 kB a second: how long from
//! the moment a message is published until a console has it, 99 times of a hundred.

#![allow(missing_docs, clippy::unwrap_used)] // a benchmark

use std::sync::Arc;
use std::time::Duration;

use bridge::bus::ChannelMessage;
use bridge::clock::SystemClock;
use criterion::{Criterion, SamplingMode, criterion_group, criterion_main};
use futures_util::{SinkExt, StreamExt};
use server::api;
use server::config::Config;
use server::serve::{Mission, Server};
use tokio::time::Instant;
use tokio_tungstenite::connect_async;
use tokio_tungstenite::tungstenite::Message;
use wire::live::channel;

const CONSOLES: usize = 200;
const RATE_HZ: u32 = 50;
const BYTES: usize = 1000;
/// Messages of one run.
const MESSAGES: u32 = 100;
/// In logs only, so that nobody else publishes on it.
const CHANNEL: &str = channel::LOG_GAP;

/// What comes before a message's number of nanoseconds.
const MARK: &str = "\"message\":\"";

async fn console(url: String, start: Instant, heard: tokio::sync::mpsc::UnboundedSender<Duration>) {
    let (mut socket, _) = connect_async(&url).await.unwrap();
    let subscribe = format!("{{\"op\":\"subscribe\",\"channels\":[\"{CHANNEL}\"]}}");
    socket.send(Message::text(subscribe)).await.unwrap();
    while let Some(Ok(message)) = socket.next().await {
        let Message::Text(text) = message else { continue };
        assert!(!text.contains("\"op\":\"gap\""), "a console has missed messages");
        let Some(at) = text.find(MARK) else { continue };
        let sent: u64 = text[at + MARK.len()..].split(' ').next().unwrap().parse().unwrap();
        let latency = start.elapsed().saturating_sub(Duration::from_nanos(sent));
        if heard.send(latency).is_err() {
            return;
        }
    }
}

fn fan_out(c: &mut Criterion) {
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build().unwrap();
    let dir = testkit::project_dir().join("target/bench-fan-out");
    let mut config = Config::demo();
    config.server.logs_dir = dir.join("logs");
    config.server.terrain_dir = dir.join("terrain");
    config.server.listeners_max = CONSOLES + 10;
    let (server, url) = runtime.block_on(async {
        let server = Server::start(Mission::of(config), Arc::new(SystemClock::new())).unwrap();
        let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
        let url = format!("ws://{}/api/v1/stream", listener.local_addr().unwrap());
        let router = api::router(server.app.clone());
        tokio::spawn(async move {
            let (_open, closed) = tokio::sync::watch::channel(false);
            server::serve::connections::serve(listener, router, closed).await;
        });
        (server, url)
    });
    let start = Instant::now();
    let (sender, mut heard) = tokio::sync::mpsc::unbounded_channel();
    for _ in 0..CONSOLES {
        runtime.spawn(console(url.clone(), start, sender.clone()));
    }
    let bus = server.app.live.bus.clone();
    let mut sequence = 0;
    let mut run = |messages: u32| {
        runtime.block_on(async {
            let mut tick = tokio::time::interval(Duration::from_secs(1) / RATE_HZ);
            let now = server.app.clock.now();
            for _ in 0..messages {
                tick.tick().await;
                sequence += 1;
                let mut json = format!("\"{} ", start.elapsed().as_nanos());
                json.extend(std::iter::repeat_n('x', BYTES - 1 - json.len()));
                json.push('"');
                bus.publish(ChannelMessage {
                    channel: CHANNEL.into(),
                    sequence,
                    onboard_time: now,
                    sent_time: now,
                    received_time: now,
                    json: json.into(),
                });
            }
            let mut times = Vec::new();
            while times.len() < messages as usize * CONSOLES {
                times.push(heard.recv().await.unwrap());
            }
            times.sort_unstable();
            times[times.len() * 99 / 100]
        })
    };
    // All are connected once they hear what is said.
    runtime.block_on(async { tokio::time::sleep(Duration::from_secs(3)).await });
    let mut group = c.benchmark_group("fan-out, 200 consoles, 50 messages of 1 kB a second");
    // What is returned is far less than what it takes: one run a sample, or it would take for ever.
    group.sampling_mode(SamplingMode::Flat).sample_size(10);
    group.warm_up_time(Duration::from_nanos(1)).measurement_time(Duration::from_nanos(1));
    group.bench_function("from bus to console, p99", |b| {
        b.iter_custom(|n| (0..n).map(|_| run(MESSAGES)).sum());
    });
    group.finish();
    runtime.block_on(server.finish());
    let _ = std::fs::remove_dir_all(dir);
}

criterion_group!(benches, fan_out);
criterion_main!(benches);
