//! A replay at speed 1: how far from its time a message comes, 99 times of a hundred (R5).

#![allow(missing_docs, clippy::unwrap_used)] // a benchmark

use std::sync::Arc;
use std::time::Duration;

use bridge::clock::{Clock, SystemClock};
use bridge::reader::{LogContent, LogMessage};
use bridge::replay::Replay;
use criterion::{Criterion, SamplingMode, criterion_group, criterion_main};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use server::replays::{ReplayItem, Replays};

/// Messages of one run, which takes two seconds.
const MESSAGES: usize = 400;
const LENGTH_S: f64 = 2.0;

/// Messages at random times: some on top of each other, some far apart.
fn content(start: wire::time::Timestamp, rng: &mut ChaCha8Rng) -> LogContent {
    let mut at: Vec<f64> = (0..MESSAGES).map(|_| rng.random_range(0.0..LENGTH_S)).collect();
    at.sort_by(f64::total_cmp);
    let message = |(number, at_s): (usize, &f64)| LogMessage {
        channel: "rover/state".into(),
        encoding: "json".into(),
        sequence: number as u32,
        log_time: start.plus_seconds(*at_s),
        publish_time: start.plus_seconds(*at_s),
        data: b"{}"[..].into(),
    };
    LogContent { messages: at.iter().enumerate().map(message).collect(), damage: Vec::new() }
}

fn timing(c: &mut Criterion) {
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build().unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let mut run = || {
        runtime.block_on(async {
            let clock = Arc::new(SystemClock::new());
            let content = content(clock.now(), &mut rng);
            let first = content.messages[0].log_time;
            let replays = Replays::new(1);
            let opened = clock.now();
            let replay = Replay::open(opened, "r", "log", content, None, 1.0).unwrap();
            replays.start("r", replay, clock.clone()).unwrap();
            let (_, mut heard) = replays.get("r").unwrap().subscribe();
            let mut errors = Vec::new();
            loop {
                match heard.recv().await.unwrap() {
                    ReplayItem::State(state) if state.ended => break,
                    ReplayItem::State(_) => {}
                    ReplayItem::Message(message) => {
                        let due_s = message.received_time.seconds_since(first);
                        let came_s = clock.now().seconds_since(opened);
                        assert!(came_s - due_s > -1e-6, "before its time by {} s", due_s - came_s);
                        errors.push(Duration::from_secs_f64((came_s - due_s).max(0.0)));
                    }
                }
            }
            // What came before anybody listened is not judged.
            assert!(errors.len() > MESSAGES * 9 / 10, "{} heard", errors.len());
            errors.sort_unstable();
            errors[errors.len() * 99 / 100]
        })
    };
    let mut group = c.benchmark_group("replay at speed 1, 200 messages a second");
    // What is returned is far less than what it takes: one run a sample, or it would take for ever.
    group.sampling_mode(SamplingMode::Flat).sample_size(10);
    group.warm_up_time(Duration::from_nanos(1)).measurement_time(Duration::from_nanos(1));
    group.bench_function("timing error, p99", |b| b.iter_custom(|n| (0..n).map(|_| run()).sum()));
    group.finish();
}

criterion_group!(benches, timing);
criterion_main!(benches);
