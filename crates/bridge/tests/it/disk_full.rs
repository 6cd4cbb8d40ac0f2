//! A disk that runs full: commands are logged on from the reserve, telemetry is told as lost, whoever
//! asks is told why no motion should begin, and all goes on by itself.

use std::collections::BTreeSet;
use std::io::ErrorKind;

use bridge::reader::{Limits, read_log};
use bridge::recorder::{Recorder, RecorderOptions, Storage};
use bridge::recover::recover;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use wire::live::{GapReason, LogGap};

use crate::recorder::options;
use crate::sim_fs::SimFs;
use crate::support::{after, record};

fn with_reserve() -> RecorderOptions {
    RecorderOptions {
        reserve_bytes: 200_000,
        segment_bytes: 30_000,
        seal_aside: false,
        ..options()
    }
}

struct Session {
    recorder: Recorder,
    next: u64,
}

impl Session {
    /// A frame of telemetry, and a command that must be safe.
    fn go_on(&mut self) {
        let (number, at) = (self.next, after(self.next as f64 * 0.1));
        self.next += 1;
        self.recorder.record(record("rover/state", number, at, format!("{{\"n\":{number}}}")));
        let event = record("command/event", number, at, format!("{{\"e\":{number}}}"));
        self.recorder.record_durable(event).unwrap().wait_blocking().unwrap();
    }
}

#[test]
fn commands_are_logged_on_a_full_disk_and_all_is_logged_again_once_there_is_room() {
    let moments = 100;
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    for moment in 0..moments {
        let disk = SimFs::default();
        let recorder = Recorder::start_on(Box::new(disk.clone()), with_reserve()).unwrap();
        let mut session = Session { recorder, next: 0 };
        for _ in 0..rng.random_range(0..60) {
            session.go_on();
        }
        // Somebody else fills the disk, to the last byte or nearly.
        disk.set_room(Some(rng.random_range(0..4000)));
        for _ in 0..60 {
            session.go_on();
        }
        let status = session.recorder.status();
        let why = status.error.as_deref().unwrap_or_default();
        assert!(why.contains("the disk is full"), "moment {moment}: {why:?}");
        disk.set_room(None);
        let back = session.next + 1;
        for _ in 0..20 {
            session.go_on();
        }
        assert_eq!(session.recorder.status().error, None, "moment {moment}");
        session.recorder.finish().unwrap();
        assert!(disk.files().keys().all(|name| !name.contains(".open.")), "all is sealed");

        let mut messages = Vec::new();
        for bytes in disk.files().into_values() {
            let content = read_log(&*bytes, Limits::default()).unwrap();
            assert_eq!(content.damage, []);
            messages.extend(content.messages);
        }
        let numbers = |channel: &str| -> BTreeSet<u64> {
            let on = messages.iter().filter(|m| &*m.channel == channel);
            on.map(|m| u64::from(m.sequence)).collect()
        };
        assert!(numbers("command/event").into_iter().eq(0..session.next), "moment {moment}");
        let frames = numbers("rover/state");
        assert!((back..session.next).all(|n| frames.contains(&n)), "moment {moment}");
        let gaps = messages.iter().filter(|m| &*m.channel == "log/gap");
        let gaps: Vec<LogGap> = gaps.map(|m| serde_json::from_slice(&m.data).unwrap()).collect();
        let told: u64 = gaps.iter().map(|gap| gap.dropped).sum();
        assert_eq!(told, session.next - frames.len() as u64, "moment {moment}: every loss is told");
        assert!(gaps.iter().all(|gap| gap.reason == GapReason::DiskFull));
        assert_eq!(disk.space().unwrap().free, u64::MAX / 2);
    }
}

#[test]
fn a_disk_that_becomes_read_only_refuses_commands_by_name_and_loses_none_once_it_is_back() {
    let mut rng = ChaCha8Rng::seed_from_u64(6);
    let mut refusals = 0;
    for moment in 0..100 {
        let disk = SimFs::default();
        let recorder = Recorder::start_on(Box::new(disk.clone()), with_reserve()).unwrap();
        let mut session = Session { recorder, next: 0 };
        (0..rng.random_range(0..40)).for_each(|_| session.go_on());
        disk.set_refusal(Some(ErrorKind::ReadOnlyFilesystem));
        for _ in 0..rng.random_range(1..40) {
            let (number, at) = (session.next, after(session.next as f64 * 0.1));
            session.next += 1;
            session.recorder.record(record("rover/state", number, at, "{}".into()));
            let event = record("command/event", number, at, "{}".into());
            let refused = session.recorder.record_durable(event).unwrap().wait_blocking();
            let text = refused.unwrap_err().to_string();
            assert!(text.contains("read-only"), "moment {moment}: {text}");
            let why = session.recorder.status().error.unwrap_or_default();
            assert!(why.contains("read-only"), "moment {moment}: no motion begins, for {why:?}");
            refusals += 1;
        }
        disk.set_refusal(None);
        let back = session.next;
        (0..10).for_each(|_| session.go_on());
        assert_eq!(session.recorder.status().error, None, "moment {moment}: it goes on by itself");
        session.recorder.finish().unwrap();
        recover(&disk).unwrap();
        let (mut events, mut frames, mut told) = (BTreeSet::new(), BTreeSet::new(), 0);
        for bytes in disk.files().into_values() {
            for message in read_log(&*bytes, Limits::default()).unwrap().messages {
                let number = u64::from(message.sequence);
                match &*message.channel {
                    "command/event" => assert!(events.insert(number), "{number} is there twice"),
                    "rover/state" => drop(frames.insert(number)),
                    "log/gap" => {
                        let gap: LogGap = serde_json::from_slice(&message.data).unwrap();
                        told += gap.dropped;
                    }
                    _ => {}
                }
            }
        }
        assert!(events.into_iter().eq(0..session.next), "moment {moment}");
        assert!((back..session.next).all(|n| frames.contains(&n)), "moment {moment}");
        assert_eq!(told, session.next - frames.len() as u64, "moment {moment}: every loss is told");
    }
    eprintln!("100 moments, {refusals} commands refused by name, 0 lost");
}

#[test]
fn what_is_given_up_depends_on_the_room_that_is_left() {
    const MIB: usize = 1 << 20;
    let disk = SimFs::default();
    disk.set_total(10_000 * MIB as u64);
    disk.set_room(Some(5000 * MIB));
    let recorder = Recorder::start_on(Box::new(disk.clone()), with_reserve()).unwrap();
    let mut next = 0;
    let mut step = |room_mib: usize| {
        disk.set_room(Some(room_mib * MIB));
        next += 1;
        let of = |channel| record(channel, next, after(next as f64), format!("{{\"n\":{next}}}"));
        let before = recorder.status();
        recorder.record_bulk(of("camera/image"));
        recorder.record(of("rover/state"));
        recorder.record_durable(of("command/event")).unwrap().wait_blocking().unwrap();
        let now = recorder.status();
        (now.dropped - before.dropped, now.error.is_some(), recorder.take_notices().len())
    };
    // A tenth is 1000 MiB here, a twentieth 500, a hundredth 100.
    assert_eq!(step(1001), (0, false, 0));
    assert_eq!(step(999), (0, false, 1), "it is told");
    assert_eq!(step(499), (1, false, 2), "bulk is shed: the level, and the drop");
    assert_eq!(
        step(99),
        (2, true, 2),
        "and telemetry: the level, its first drop; bulk was told just now"
    );
    assert_eq!(step(5000), (0, false, 2), "the level, and what was not told yet");
}

/// A minute of full disk: what was lost is told to the last message, and in few words, for each of
/// them is one more event for the disk.
#[test]
fn what_a_full_disk_loses_is_told_once_in_a_while_and_adds_up() {
    let disk = SimFs::default();
    let recorder = Recorder::start_on(Box::new(disk.clone()), with_reserve()).unwrap();
    let mut session = Session { recorder, next: 0 };
    session.go_on();
    disk.set_room(Some(100));
    let (mut words, mut told) = (0, 0);
    let mut hear = |session: &Session| {
        for notice in session.recorder.take_notices() {
            words += 1;
            if let Some((n, _)) = notice.text.split_once(" messages of rover/state") {
                told += n.parse::<u64>().unwrap();
            }
        }
    };
    for _ in 0..600 {
        session.go_on();
        hear(&session);
    }
    assert!(session.recorder.fails());
    disk.set_room(None);
    session.go_on();
    session.go_on();
    hear(&session);
    assert!(!session.recorder.fails());
    let dropped = session.recorder.status().dropped;
    assert!((590..=601).contains(&dropped), "{dropped}");
    assert_eq!(told, dropped);
    assert!(words <= 12, "{words} events of a minute");
}
