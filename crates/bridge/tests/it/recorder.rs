//! The recorder: what is safe when, and what a disk that fails does to it.

use std::collections::BTreeMap;

use bridge::catalog::{list_logs, log_info, log_path};
use bridge::reader::{Damage, Limits, read_log};
use bridge::recorder::{ChannelSchema, Record, Recorder, RecorderError, RecorderOptions};
use wire::live::{EventLevel, GapReason, LogGap};
use wire::resources::LogInfo;

use crate::support::{FaultyDisk, START, TempDir, after, record};

/// For messages of padding, which compress like bombs.
const ANY_RATIO: Limits =
    Limits { record_bytes: 64 << 20, ratio: u64::MAX, total_bytes: 512 << 20 };

pub fn options() -> RecorderOptions {
    RecorderOptions {
        start: START,
        metadata: BTreeMap::from([("robot".into(), "athlete".into())]),
        schemas: vec![ChannelSchema {
            channel: "rover/state".into(),
            name: "RoverTelemetry".into(),
            schema_json: r#"{"type":"object"}"#.into(),
        }],
        // The disks of the tests are full when the tests say so.
        reserve_bytes: 0,
        ..RecorderOptions::default()
    }
}

/// `n` messages, every third of them an event, with distinct contents.
pub fn messages(n: u64) -> Vec<Record> {
    let channel = |i: u64| if i.is_multiple_of(3) { "command/event" } else { "rover/state" };
    let json = |i: u64| format!("{{\"n\":{i},\"x\":{}}}", (i * 7919) % 1009);
    (0..n).map(|i| record(channel(i), i, after(i as f64 / 10.0), json(i))).collect()
}

/// Writes `records` in batches of ten, each synced before the next.
fn write_all(recorder: &Recorder, records: &[Record]) {
    for batch in records.chunks(10) {
        let (last, others) = batch.split_last().unwrap();
        others.iter().for_each(|r| recorder.record(r.clone()));
        recorder.record_durable(last.clone()).unwrap().wait_blocking().unwrap();
    }
}

#[test]
fn a_log_reads_back_as_it_was_recorded() {
    let dir = TempDir::new("reads-back");
    let mut recorder = Recorder::start(dir.path(), options()).unwrap();
    let records = messages(500);
    write_all(&recorder, &records);
    let status = recorder.finish().unwrap();
    assert_eq!((status.messages, status.dropped, status.segments), (500, 0, 1));
    assert_eq!(status.log.id, "footfall-20010909T014640Z");
    let content = bridge::catalog::read_log(dir.path(), &status.log.id, Limits::default()).unwrap();
    assert_eq!(content.damage, []);
    assert_eq!(content.messages.len(), records.len());
    for (read, written) in content.messages.iter().zip(&records) {
        assert_eq!((&read.channel, &read.data), (&written.channel, &written.data));
        assert_eq!((read.log_time, read.publish_time), (written.log_time, written.publish_time));
        assert_eq!(u64::from(read.sequence), written.sequence);
    }
}

#[test]
fn the_crates_own_indexed_reader_finds_messages_schemas_and_metadata() {
    let disk = FaultyDisk::default();
    let mut recorder = Recorder::start_on(Box::new(disk.clone()), options()).unwrap();
    write_all(&recorder, &messages(100));
    recorder.finish().unwrap();
    let bytes = disk.files().into_values().next().unwrap();
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    let stats = summary.stats.unwrap();
    assert_eq!((stats.message_count, stats.channel_count), (100, 2));
    assert_eq!((stats.message_start_time, stats.message_end_time), (START.0, after(9.9).0));
    assert_eq!(stats.chunk_count, 1, "a chunk for each commit became one of a mebibyte");
    let schema = summary.schemas.values().next().unwrap();
    assert_eq!((&*schema.name, &*schema.encoding), ("RoverTelemetry", "jsonschema"));
    assert_eq!(mcap::MessageStream::new(&bytes).unwrap().filter(Result::is_ok).count(), 100);
    let index = summary.metadata_indexes.iter().find(|index| index.name == "footfall").unwrap();
    let metadata = mcap::read::metadata(&bytes, index).unwrap();
    assert_eq!(metadata.metadata["robot"], "athlete");
}

#[test]
fn a_durable_message_is_in_the_file_when_it_is_acknowledged() {
    let disk = FaultyDisk::default();
    let recorder = Recorder::start_on(Box::new(disk.clone()), options()).unwrap();
    for (i, message) in messages(30).into_iter().enumerate() {
        recorder.record_durable(message).unwrap().wait_blocking().unwrap();
        // The file as a power cut would leave it now.
        let bytes = disk.files().into_values().next().unwrap();
        let content = read_log(&*bytes, Limits::default()).unwrap();
        assert_eq!(content.messages.len(), i + 1);
        assert!(matches!(content.damage[..], [Damage::Torn { .. }]), "{:?}", content.damage);
    }
}

#[test]
fn a_log_cut_off_at_any_byte_gives_every_batch_before_the_cut() {
    let disk = FaultyDisk::default();
    let mut recorder = Recorder::start_on(Box::new(disk.clone()), options()).unwrap();
    let records = messages(60);
    let mut safe = Vec::new();
    for batch in records.chunks(10) {
        write_all(&recorder, batch);
        safe.push(disk.files().into_values().next().unwrap().len());
    }
    let bytes = disk.files().into_values().next().unwrap();
    recorder.finish().unwrap();
    for cut in 0..bytes.len() {
        let content = read_log(&bytes[..cut], Limits::default()).unwrap();
        let batches = safe.iter().filter(|&&size| size <= cut).count();
        let expected = &records[..content.messages.len()];
        assert!(content.messages.len() >= batches * 10, "cut at {cut}");
        assert!(content.messages.iter().zip(expected).all(|(a, b)| a.data == b.data));
        assert!(matches!(content.damage[..], [Damage::Torn { .. }]), "cut at {cut} is told");
    }
}

#[test]
fn a_disk_that_fails_at_any_byte_loses_nothing_that_was_acknowledged() {
    let records = messages(40);
    let mut cases = 0;
    for room in (0..16_000).step_by(67) {
        let disk = FaultyDisk::default();
        disk.set_room(Some(room));
        let Ok(mut recorder) = Recorder::start_on(Box::new(disk.clone()), options()) else {
            continue;
        };
        let mut acknowledged = Vec::new();
        for message in &records {
            let outcome = recorder.record_durable(message.clone()).unwrap().wait_blocking();
            match outcome {
                Ok(()) => acknowledged.push(message.sequence),
                Err(error) => {
                    assert!(matches!(error, RecorderError::Write(_)), "{error}");
                    assert!(recorder.status().error.is_some());
                    disk.set_room(None);
                }
            }
        }
        let _ = recorder.finish();
        let mut found: Vec<u64> = Vec::new();
        for bytes in disk.files().into_values() {
            let content = read_log(&*bytes, Limits::default()).unwrap();
            found.extend(content.messages.iter().map(|m| u64::from(m.sequence)));
        }
        assert!(acknowledged.iter().all(|sequence| found.contains(sequence)), "room {room}");
        cases += 1;
    }
    assert!(cases > 100, "most of these disks take the beginning of a file");
}

#[test]
fn a_failed_sync_ends_the_file_and_the_batch_goes_to_a_new_one() {
    let disk = FaultyDisk::default();
    // The first sync is that of the file's header, the second of the first batch.
    disk.set_syncs(Some(1));
    let mut recorder = Recorder::start_on(Box::new(disk.clone()), options()).unwrap();
    let message = messages(1).remove(0);
    let refused = recorder.record_durable(message.clone()).unwrap().wait_blocking();
    assert_eq!(refused, Err(RecorderError::Write("sync failed".into())));
    disk.set_syncs(None);
    recorder.record_durable(messages(2).remove(1)).unwrap().wait_blocking().unwrap();
    let notices = recorder.take_notices();
    let levels: Vec<_> = notices.iter().map(|notice| notice.level).collect();
    assert_eq!(levels, [EventLevel::Warning, EventLevel::Critical], "{notices:?}");
    let status = recorder.finish().unwrap();
    assert_eq!(status.error, None);
    assert_eq!((status.segments, disk.files().len()), (2, 2));
    let newest = disk.files().into_values().next_back().unwrap();
    let content = read_log(&*newest, Limits::default()).unwrap();
    let sequences: Vec<_> = content.messages.iter().map(|m| m.sequence).collect();
    assert_eq!(sequences, [0, 1], "the refused message was kept and comes first");
}

#[test]
fn telemetry_beyond_the_bound_is_dropped_oldest_first_counted_and_told() {
    let disk = FaultyDisk::default();
    let mut recorder = Recorder::start_on(Box::new(disk.clone()), options()).unwrap();
    let stall = disk.stall();
    let padding = "x".repeat(10_000);
    // Beside the 32 MiB that wait, the writer may hold as much in the batch that the disk does not take.
    let total = 8000;
    for i in 0..total {
        recorder.record(record("rover/state", i, after(0.0), format!("\"{padding}{i}\"")));
    }
    let dropped = recorder.status().dropped;
    assert!(
        dropped > 1000,
        "80 MB are more than twice the 32 MiB that may wait; dropped {dropped}"
    );
    let told = recorder.take_notices().remove(0).text;
    assert!(told.contains(&format!("{dropped} messages of rover/state")), "{told}");
    drop(stall);
    let status = recorder.finish().unwrap();
    assert_eq!(status.messages + status.dropped, total + 1, "and one that tells the gap");
    let bytes = disk.files().into_values().next().unwrap();
    let content = read_log(&*bytes, ANY_RATIO).unwrap();
    assert_eq!(content.messages.last().unwrap().sequence, total as u32 - 1, "the newest is kept");
    let kept: Vec<u32> = content
        .messages
        .iter()
        .filter(|m| &*m.channel == "rover/state")
        .map(|m| m.sequence)
        .collect();
    let gaps = content.messages.iter().filter(|m| &*m.channel == "log/gap");
    let gaps: Vec<LogGap> = gaps.map(|m| serde_json::from_slice(&m.data).unwrap()).collect();
    let missing: Vec<u64> = (0..total).filter(|n| !kept.contains(&(*n as u32))).collect();
    let expected = LogGap {
        channel: "rover/state".into(),
        dropped,
        first_sequence: missing[0],
        last_sequence: *missing.last().unwrap(),
        from: after(0.0),
        to: after(0.0),
        reason: GapReason::TooSlow,
    };
    assert_eq!((missing.len() as u64, gaps), (dropped, vec![expected]));
}

#[test]
fn what_nobody_was_told_stands_in_the_log_as_an_event() {
    let big = format!("\"{}\"", "x".repeat(20_000_000));
    let disk = FaultyDisk::default();
    let mut recorder = Recorder::start_on(Box::new(disk.clone()), options()).unwrap();
    let stall = disk.stall();
    for i in 0..3 {
        recorder.record(record("rover/state", i, after(0.0), big.clone()));
    }
    let dropped = recorder.status().dropped;
    assert!(dropped > 0);
    drop(stall);
    recorder.finish().unwrap();
    let bytes = disk.files().into_values().next().unwrap();
    let content = read_log(&*bytes, ANY_RATIO).unwrap();
    let event = content.messages.iter().find(|m| &*m.channel == "event").unwrap();
    let text = std::str::from_utf8(&event.data).unwrap();
    assert!(text.contains(&format!("{dropped} messages of rover/state")), "{text}");
}

#[test]
fn an_ended_recorder_refuses_and_counts() {
    let disk = FaultyDisk::default();
    let mut recorder = Recorder::start_on(Box::new(disk), options()).unwrap();
    recorder.finish().unwrap();
    let message = messages(1).remove(0);
    let refused = recorder.record_durable(message.clone()).unwrap_err();
    assert_eq!(refused, RecorderError::Ended);
    recorder.record(message);
    assert_eq!(recorder.finish().unwrap().dropped, 1);
}

#[test]
fn a_folder_lists_its_logs_open_closed_and_torn() {
    let dir = TempDir::new("lists");
    assert_eq!(list_logs(&dir.path().join("absent"), None).unwrap(), []);
    let mut first = Recorder::start(dir.path(), options()).unwrap();
    write_all(&first, &messages(50));
    let closed = first.finish().unwrap().log;
    let second = Recorder::start(dir.path(), options()).unwrap();
    write_all(&second, &messages(30));
    let open = second.status().log;
    assert_eq!((&*open.id, open.open), ("footfall-20010909T014640Z-2", true), "the name was taken");
    let logs = list_logs(dir.path(), Some(&open)).unwrap();
    assert_eq!(logs, [open.clone(), closed.clone()]);
    let expected = LogInfo {
        id: closed.id.clone(),
        size: std::fs::metadata(log_path(dir.path(), &closed.id).unwrap()).unwrap().len(),
        start: Some(START),
        end: Some(after(4.9)),
        messages: 50,
        open: false,
    };
    assert_eq!(closed, expected);
    let torn = log_info(dir.path(), &open.id).unwrap();
    assert_eq!((torn.messages, torn.end), (30, Some(after(2.9))), "found without a summary");
    drop(second);
    assert_eq!(log_info(dir.path(), &open.id).unwrap().messages, 30);
}

#[test]
fn names_that_are_no_log_ids_reach_no_file() {
    let dir = TempDir::new("names");
    std::fs::create_dir(dir.path().join("logs")).unwrap();
    std::fs::write(dir.path().join("secret.mcap"), "secret").unwrap();
    let logs = dir.path().join("logs");
    let long = "a".repeat(65);
    for name in ["../secret", "..", "", "a/b", "a\\b", "a.b", "a\0", "%2e%2e", "é", &long] {
        assert_eq!(log_path(&logs, name).unwrap_err().code(), "log_unknown", "{name}");
    }
    std::os::unix::fs::symlink(dir.path().join("secret.mcap"), logs.join("link.mcap")).unwrap();
    assert_eq!(log_path(&logs, "link").unwrap_err().code(), "log_unknown", "no links");
}
