//! Messages per second of the recorder, against plain buffered writes of the same bytes.

#![allow(missing_docs, clippy::unwrap_used)] // a benchmark

use std::io::{BufWriter, Write};
use std::sync::Arc;

use bridge::recorder::{Record, Recorder, RecorderOptions};
use bytes::Bytes;
use criterion::{BatchSize, Criterion, Throughput, criterion_group, criterion_main};
use wire::time::Timestamp;

/// The load of the budget: messages of 200 bytes.
const MESSAGES: u64 = 100_000;

fn messages() -> Vec<Record> {
    let channel: Arc<str> = "rover/state".into();
    let record = |i: u64| {
        let mut json =
            format!("{{\"sequence\":{i},\"height_m\":{}.{},\"text\":\"", i % 7, i % 1009);
        while json.len() < 198 {
            json.push(char::from(b'a' + ((i + json.len() as u64) % 26) as u8));
        }
        json.push_str("\"}");
        let time = Timestamp(1_000_000 * i);
        let json = Bytes::from(json);
        Record {
            channel: channel.clone(),
            sequence: i,
            log_time: time,
            publish_time: time,
            data: json,
        }
    };
    (0..MESSAGES).map(record).collect()
}

fn recorder(c: &mut Criterion) {
    let dir = testkit::project_dir().join("target/bench-recorder");
    let messages = messages();
    let mut group = c.benchmark_group("recorder, 200 B messages");
    group.sample_size(10).throughput(Throughput::Elements(MESSAGES));
    group.bench_function("record, commit, close", |b| {
        b.iter_batched(
            || messages.clone(),
            |messages| {
                let mut recorder = Recorder::start(&dir, RecorderOptions::default()).unwrap();
                messages.into_iter().for_each(|message| recorder.record(message));
                let status = recorder.finish().unwrap();
                assert_eq!(status.messages, MESSAGES);
                let _ = std::fs::remove_file(dir.join(format!("{}.mcap", status.log.id)));
            },
            BatchSize::PerIteration,
        );
    });
    group.bench_function("plain buffered file, one sync", |b| {
        b.iter(|| {
            let path = dir.join("plain.bin");
            let mut file =
                BufWriter::with_capacity(64 * 1024, std::fs::File::create(&path).unwrap());
            for message in &messages {
                file.write_all(&message.log_time.0.to_le_bytes()).unwrap();
                file.write_all(&message.data).unwrap();
            }
            file.into_inner().unwrap().sync_data().unwrap();
            let _ = std::fs::remove_file(path);
        });
    });
    group.finish();
    let _ = std::fs::remove_dir_all(dir);
}

criterion_group!(benches, recorder);
criterion_main!(benches);
