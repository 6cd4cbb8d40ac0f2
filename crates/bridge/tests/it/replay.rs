//! Replay: the same bytes at the right time, from any place, at any speed.

use bridge::bus::ChannelMessage;
use bridge::reader::{Limits, LogContent, LogMessage, read_log};
use bridge::recorder::{Record, Recorder, RecorderOptions};
use bridge::replay::{Replay, ReplayError};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use wire::time::Timestamp;

use crate::recorder::{messages, options};
use crate::support::{FaultyDisk, START, TempDir, after, record};

/// The wall clock of these tests is another one than the log's.
fn wall(seconds: f64) -> Timestamp {
    Timestamp(1_900_000_000_000_000_000).plus_seconds(seconds)
}

fn logged(records: &[Record]) -> LogContent {
    let disk = FaultyDisk::default();
    let mut recorder = Recorder::start_on(Box::new(disk.clone()), options()).unwrap();
    records.iter().for_each(|r| recorder.record(r.clone()));
    recorder.finish().unwrap();
    read_log(&*disk.files().into_values().next().unwrap(), Limits::default()).unwrap()
}

fn open(records: &[Record], rate: f64) -> Replay {
    Replay::open(wall(0.0), "r1", "log", logged(records), None, rate).unwrap()
}

fn sequences(messages: &[ChannelMessage]) -> Vec<u64> {
    messages.iter().map(|message| message.sequence).collect()
}

#[test]
fn what_comes_out_is_byte_for_byte_what_was_recorded() {
    let records = messages(1000);
    let mut replay = open(&records, 1.0);
    let (mut out, mut rng) = (Vec::new(), ChaCha8Rng::seed_from_u64(5));
    let mut seconds = 0.0;
    while !replay.state(wall(seconds)).ended {
        out.extend(replay.advance(wall(seconds)).unwrap());
        seconds += rng.random_range(0.0..0.7);
    }
    assert_eq!(out.len(), records.len());
    for (given, recorded) in out.iter().zip(&records) {
        assert_eq!((&given.channel, &given.json), (&recorded.channel, &recorded.data));
        assert_eq!(given.sequence, recorded.sequence);
        assert_eq!(given.received_time, recorded.log_time);
        assert_eq!(given.onboard_time, recorded.publish_time);
    }
}

#[test]
fn each_message_comes_when_it_is_due_and_the_rate_changes_on_the_way() {
    // One message every 0.1 s.
    let mut replay = open(&messages(1000), 1.0);
    assert_eq!(sequences(&replay.advance(wall(0.0)).unwrap()), [0]);
    assert_eq!(replay.next_due(), Some(wall(0.1)));
    assert_eq!(replay.advance(wall(0.099)).unwrap(), []);
    assert_eq!(sequences(&replay.advance(wall(0.25)).unwrap()), [1, 2]);
    replay.set_rate(wall(0.25), 10.0).unwrap();
    assert_eq!(replay.advance(wall(0.351)).unwrap().len(), 10, "a second of log in 0.1 s");
    replay.pause(wall(0.351));
    assert_eq!(replay.advance(wall(100.0)).unwrap(), []);
    assert_eq!(replay.next_due(), None);
    assert_eq!(replay.state(wall(100.0)).at, after(1.26));
    replay.resume(wall(100.0));
    assert_eq!(sequences(&replay.advance(wall(100.01)).unwrap()), [13]);
    replay.set_rate(wall(100.01), 1000.0).unwrap();
    assert_eq!(replay.advance(wall(101.0)).unwrap().len(), 1000 - 14);
    let state = replay.state(wall(101.0));
    assert_eq!((state.at, state.ended), (after(99.9), true));
    assert_eq!((state.start, state.end), (START, after(99.9)));
}

#[test]
fn speeds_out_of_range_are_refused() {
    let mut replay = open(&messages(3), 1.0);
    for rate in [0.0, 0.09, 1000.1, -1.0, f64::NAN] {
        let refused = replay.set_rate(wall(0.0), rate).unwrap_err();
        assert_eq!(refused.code(), "rate_invalid", "{rate}");
    }
}

fn command_event(sequence: u64, at: f64, id: &str, state: &str) -> Record {
    let json = format!(r#"{{"command":{{"id":"{id}"}},"state":"{state}"}}"#);
    record("command/event", sequence, after(at), json)
}

#[test]
fn a_seek_gives_the_state_there_and_then_what_follows() {
    let frame = |n: u64, at: f64| record("rover/state", n, after(at), format!("{{\"n\":{n}}}"));
    let records = [
        frame(1, 0.0),
        record("link/report", 1, after(0.1), "{}".into()),
        command_event(1, 0.2, "a", "staged"),
        command_event(2, 0.3, "b", "staged"),
        record("event", 1, after(0.4), "{}".into()),
        frame(2, 1.0),
        command_event(3, 1.1, "a", "armed"),
        frame(3, 2.0),
        command_event(4, 2.1, "b", "cancelled"),
    ];
    let mut replay = open(&records, 1.0);
    let names = |messages: Vec<ChannelMessage>| -> Vec<String> {
        messages.iter().map(|m| format!("{} {}", m.channel, m.sequence)).collect()
    };
    let state = names(replay.seek(wall(0.0), after(1.5)).unwrap());
    assert_eq!(state, ["link/report 1", "command/event 2", "rover/state 2", "command/event 3"]);
    assert_eq!(names(replay.advance(wall(0.5)).unwrap()), ["rover/state 3"]);
    assert_eq!(
        names(replay.seek(wall(1.0), after(-5.0)).unwrap()),
        ["rover/state 1"],
        "back to the start"
    );
    assert_eq!(replay.state(wall(1.0)).at, START);
    let end = names(replay.seek(wall(2.0), after(99.0)).unwrap());
    let all_latest = ["link/report 1", "command/event 3", "rover/state 3", "command/event 4"];
    assert_eq!(end, all_latest);
    assert!(replay.state(wall(2.0)).ended);
}

#[test]
fn every_seek_agrees_with_a_scan_from_the_beginning() {
    let records = messages(400);
    let mut replay = open(&records, 1.0);
    let mut rng = ChaCha8Rng::seed_from_u64(6);
    for _ in 0..500 {
        let at = after(rng.random_range(-1.0..41.0));
        let state = replay.seek(wall(0.0), at).unwrap();
        let place = at.clamp(records[0].log_time, records[399].log_time);
        let before: Vec<_> = records.iter().filter(|r| r.log_time <= place).collect();
        let frame = before.iter().rev().find(|r| &*r.channel == "rover/state");
        let expected: Vec<u64> = frame.map(|r| r.sequence).into_iter().collect();
        assert_eq!(sequences(&state), expected, "at {at:?}");
        let next = replay.advance(wall(1e6)).unwrap();
        assert_eq!(next.len(), records.len() - before.len());
        assert!(next.first().is_none_or(|m| m.sequence == before.len() as u64));
    }
}

#[test]
fn a_replay_may_begin_in_the_middle() {
    let content = logged(&messages(100));
    let from = Some(after(5.05));
    let mut replay = Replay::open(wall(0.0), "r1", "log", content, from, 1.0).unwrap();
    assert_eq!(sequences(&replay.snapshot().unwrap()), [50]);
    assert_eq!(sequences(&replay.advance(wall(0.06)).unwrap()), [51]);
}

#[test]
fn a_message_of_an_earlier_time_comes_with_the_one_before_it() {
    let times = [0.0, 2.0, 1.0, 3.0];
    let record = |(i, at): (usize, &f64)| record("event", i as u64, after(*at), "{}".into());
    let mut replay = open(&times.iter().enumerate().map(record).collect::<Vec<_>>(), 1.0);
    assert_eq!(sequences(&replay.advance(wall(1.5)).unwrap()), [0]);
    assert_eq!(
        sequences(&replay.advance(wall(2.0)).unwrap()),
        [1, 2],
        "the order of the log is kept"
    );
}

#[test]
fn what_is_not_json_is_left_out_and_counted() {
    let message = |encoding: &str, data: &'static [u8]| LogMessage {
        channel: "x".into(),
        encoding: encoding.into(),
        sequence: 0,
        log_time: START,
        publish_time: START,
        data: data.into(),
    };
    let foreign =
        vec![message("cdr", b"\0\x01"), message("json", b"{\"a\":"), message("json", b"1")];
    let content = LogContent { messages: foreign, damage: vec![] };
    let replay = Replay::open(wall(0.0), "r1", "log", content, None, 1.0).unwrap();
    assert_eq!(replay.skipped(), 2);
    let none = LogContent { messages: vec![message("cdr", b"")], damage: vec![] };
    let refused = Replay::open(wall(0.0), "r1", "log", none, None, 1.0).unwrap_err();
    assert!(matches!(refused, ReplayError::Empty { log } if log == "log"));
}

/// A log of several segments on the disk: frames, the link once in a while, and commands of four
/// events each.
fn long_log(dir: &std::path::Path, n: u64, text_bytes: usize) -> (String, Vec<Record>) {
    let options = RecorderOptions { segment_bytes: n * 10, ..options() };
    let mut recorder = Recorder::start(dir, options).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(31);
    let mut records = Vec::new();
    for number in 0..n {
        let at = number as f64 * 0.01;
        let next = match number % 50 {
            7 => record("link/report", number, after(at), format!("{{\"n\":{number}}}")),
            11 | 31 => {
                let id = format!("c{}", number / 100);
                command_event(number, at, &id, ["staged", "armed"][number as usize % 2])
            }
            _ => {
                let noise: String =
                    (0..text_bytes).map(|_| char::from(rng.random_range(b'a'..=b'z'))).collect();
                let text = format!("{{\"n\":{number},\"noise\":\"{noise}\"}}");
                record("rover/state", number, after(at), text)
            }
        };
        recorder.record(next.clone());
        records.push(next);
        if number % 100 == 99 {
            // In pace with the disk, as a rover is.
            let last = record("event", number, after(at), "{}".into());
            recorder.record_durable(last.clone()).unwrap().wait_blocking().unwrap();
            records.push(last);
        }
    }
    let status = recorder.finish().unwrap();
    assert_eq!((status.messages, status.dropped), (records.len() as u64, 0));
    (status.log.id, records)
}

fn full() -> bool {
    std::env::var_os("FOOTFALL_FULL").is_some()
}

#[test]
fn a_log_of_many_segments_is_replayed_byte_for_byte() {
    let dir = TempDir::new("many");
    let (log, records) = long_log(dir.path(), if full() { 1_000_000 } else { 20_000 }, 40);
    let files = bridge::catalog::log_files(dir.path(), &log).unwrap();
    assert!(files.len() > 2, "{} segments", files.len());
    let content = bridge::catalog::open_log(dir.path(), &log, Limits::default()).unwrap();
    let mut replay = Replay::open(wall(0.0), "r1", &log, content, None, 1000.0).unwrap();
    let (mut seconds, mut expected) = (0.0, records.iter());
    while !replay.state(wall(seconds)).ended {
        for given in replay.advance(wall(seconds)).unwrap() {
            let recorded = expected.next().unwrap();
            assert_eq!((&given.channel, &given.json), (&recorded.channel, &recorded.data));
            let times = (given.sequence, given.received_time, given.onboard_time);
            assert_eq!(times, (recorded.sequence, recorded.log_time, recorded.publish_time));
        }
        seconds += 0.01;
    }
    assert!(expected.next().is_none() && replay.damage().is_empty());
    eprintln!("{} messages of {} segments, all equal", records.len(), files.len());

    // Every seek against a scan from the beginning.
    let mut rng = ChaCha8Rng::seed_from_u64(32);
    let length = records.last().unwrap().log_time.seconds_since(START);
    for _ in 0..60 {
        let at = after(rng.random_range(0.0..length));
        let mut latest = std::collections::BTreeMap::new();
        for record in records.iter().take_while(|record| record.log_time <= at) {
            let key = match &*record.channel {
                "event" => continue,
                "command/event" => {
                    let value: serde_json::Value = serde_json::from_slice(&record.data).unwrap();
                    value["command"]["id"].as_str().unwrap().to_owned()
                }
                channel => channel.to_owned(),
            };
            latest.insert(key, record.sequence);
        }
        let mut expected: Vec<u64> = latest.into_values().collect();
        expected.sort_unstable();
        expected.drain(..expected.len().saturating_sub(1002));
        let mut found = sequences(&replay.seek(wall(seconds), at).unwrap());
        found.sort_unstable();
        assert_eq!(found, expected, "at {at:?}");
        let next = replay.step(wall(seconds)).unwrap();
        assert_eq!(
            next.map(|m| m.json),
            records.iter().find(|r| r.log_time > at).map(|r| r.data.clone())
        );
    }
}

/// R5: nothing in a replay could hand anything to a rover, for its sources name nothing that does. The
/// channel of what was handed to the link is one that it shows.
#[test]
fn the_sources_of_a_replay_name_nothing_that_reaches_a_rover() {
    let crate_dir = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut sources = vec![crate_dir.join("replay.rs")];
    let parts = std::fs::read_dir(crate_dir.join("replay")).unwrap();
    sources.extend(parts.map(|entry| entry.unwrap().path()));
    assert!(sources.len() >= 3, "{sources:?}");
    for path in sources {
        let text = std::fs::read_to_string(&path).unwrap().replace("channel::COMMAND_UPLINK", "");
        let code = text.lines().filter(|line| !line.trim_start().starts_with("//"));
        for (number, line) in code.enumerate() {
            for name in ["Uplink", "adapter", "ground", "Ground", "link::", "carrier", "Direction"]
            {
                assert!(!line.contains(name), "{path:?}, line {number} of code: {line}");
            }
        }
    }
}
