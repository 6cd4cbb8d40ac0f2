//! What depends on the machine's clock and disk: how late a message comes that the link has delayed, and
//! how long a seek in a large log takes.
//!
//! `FOOTFALL_BENCH_GB`: size of that log, 0.2 unless told; a day of log has 10.4.

#![allow(missing_docs, clippy::unwrap_used)] // a benchmark

use std::sync::{Arc, Mutex};
use std::time::Duration;

use bridge::adapter::RoverAdapter;
use bridge::bus::{Bus, BusItem};
use bridge::catalog::open_log;
use bridge::clock::{Clock, SystemClock};
use bridge::ground::{self, Ground};
use bridge::reader::Limits;
use bridge::recorder::{Recorder, RecorderOptions};
use bridge::replay::Replay;
use criterion::{Criterion, SamplingMode, criterion_group, criterion_main};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tokio::time::Instant;
use wire::live::{Downlink, LinkConfig, RoverMode, RoverTelemetry, Uplink, channel};
use wire::scene::{Pose, RoverState};
use wire::time::Timestamp;

#[path = "../tests/it/day_log.rs"]
mod day_log;

/// Messages of one run.
const MESSAGES: usize = 200;
const RATE_HZ: f64 = 100.0;
const DELAY_S: f64 = 1.3;

/// A rover that says a frame of telemetry a hundred times a second.
struct Speaker {
    next: Timestamp,
    frame: RoverTelemetry,
}

impl Speaker {
    fn new(start: Timestamp) -> Speaker {
        let base = Pose { position_m: [0.0, 0.0, 1.968], orientation_xyzw: [0.0, 0.0, 0.0, 1.0] };
        let state =
            RoverState { base, joints_rad: Default::default(), wheels_rad: Default::default() };
        let frame = RoverTelemetry {
            state,
            contacts: Default::default(),
            contact_points_m: Default::default(),
            wheel_forces_n: Default::default(),
            joint_torques_nm: Default::default(),
            mode: RoverMode::Idle,
            executing: None,
            fault: None,
            operation: None,
        };
        Speaker { next: start, frame }
    }
}

impl RoverAdapter for Speaker {
    fn uplink(&mut self, _: Timestamp, _: Uplink) {}

    fn advance(&mut self, now: Timestamp) -> Vec<(Timestamp, Downlink)> {
        let mut said = Vec::new();
        while self.next <= now {
            said.push((self.next, Downlink::Telemetry(self.frame.clone())));
            self.next = self.next.plus_seconds(1.0 / RATE_HZ);
        }
        said
    }
}

fn percentile(times: &mut [Duration], share: f64) -> Duration {
    times.sort_unstable();
    times[((times.len() - 1) as f64 * share) as usize]
}

/// One run a sample: what is returned is far less than what it takes, or it would go on for ever.
fn by_the_clock<'a>(
    c: &'a mut Criterion,
    name: &str,
) -> criterion::BenchmarkGroup<'a, criterion::measurement::WallTime> {
    let mut group = c.benchmark_group(name);
    group.sampling_mode(SamplingMode::Flat).sample_size(10);
    group.warm_up_time(Duration::from_nanos(1)).measurement_time(Duration::from_nanos(1));
    group
}

fn delay_error(c: &mut Criterion) {
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build().unwrap();
    let dir = testkit::project_dir().join("target/bench-delay");
    let clock: Arc<SystemClock> = Arc::new(SystemClock::new());
    let start = clock.now();
    let recorder = Recorder::start(&dir, RecorderOptions { start, ..Default::default() }).unwrap();
    let bus = Bus::new(10_000);
    let link = LinkConfig::delays(DELAY_S, DELAY_S);
    let rover = Box::new(Speaker::new(start));
    let ground =
        Ground::new(start, rover, link, recorder, bus.clone(), Box::new(|_| None)).unwrap();
    let ground = Arc::new(Mutex::new(ground));
    let driver = runtime.spawn(ground::run(ground.clone(), clock.clone()));
    let run = || {
        runtime.block_on(async {
            let mut listener = bus.subscribe().1;
            let mut errors = Vec::new();
            while errors.len() < MESSAGES {
                let Some(BusItem::Message(message)) = listener.next().await else {
                    panic!("missed")
                };
                if &*message.channel == channel::ROVER_STATE {
                    let due = message.sent_time.plus_seconds(DELAY_S);
                    let late_s = clock.now().seconds_since(due);
                    assert!(late_s >= 0.0, "before its light time by {late_s} s");
                    errors.push(Duration::from_secs_f64(late_s));
                }
            }
            percentile(&mut errors, 0.99)
        })
    };
    let mut group = by_the_clock(c, "link of 1.3 s, 100 messages a second");
    group.bench_function("delay error, p99", |b| b.iter_custom(|n| (0..n).map(|_| run()).sum()));
    group.finish();
    driver.abort();
    ground.lock().unwrap().finish(clock.now()).unwrap();
    let _ = std::fs::remove_dir_all(dir);
}

fn seek(c: &mut Criterion) {
    let size_gb = std::env::var("FOOTFALL_BENCH_GB").map_or(0.2, |size| size.parse().unwrap());
    // 96 full segments are 10.4 GB.
    let segments = ((size_gb / 10.4 * 96.0) as u64).max(2);
    let dir = testkit::project_dir().join("target/bench-seek");
    let _ = std::fs::remove_dir_all(&dir);
    std::fs::create_dir_all(&dir).unwrap();
    let files = day_log::write_segments(&dir, segments, day_log::FRAMES);
    let content = open_log(&dir, day_log::LOG, Limits::default()).unwrap();
    let length_s = (segments * day_log::FRAMES) as f64 * 0.1;
    let wall = day_log::START;
    let mut replay = Replay::open(wall, "r", day_log::LOG, content, None, 1.0).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(92);
    let mut run = |share: f64| {
        let mut times = Vec::new();
        for _ in 0..50 {
            day_log::forget(&files);
            let at = day_log::START.plus_seconds(rng.random_range(0.0..length_s - 0.2));
            let begun = Instant::now();
            let state = replay.seek(wall, at).unwrap();
            let next = replay.step(wall).unwrap();
            times.push(begun.elapsed());
            assert!(!state.is_empty() && next.is_some());
        }
        percentile(&mut times, share)
    };
    let mut group = by_the_clock(c, "replay, seek in a large log, nothing of it in the page cache");
    for (name, share) in [("p50", 0.5), ("p99", 0.99)] {
        group.bench_function(name, |b| b.iter_custom(|n| (0..n).map(|_| run(share)).sum()));
    }
    group.finish();
    let _ = std::fs::remove_dir_all(dir);
}

criterion_group!(benches, delay_error, seek);
criterion_main!(benches);
