//! The catalog of logs: whatever becomes of it, the list is that of the files. And what else is done
//! with a log of several segments: one file made of it, its commands found by the index.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::path::Path;

use bridge::catalog::{
    self, CATALOG_FILE, copy_log, list_logs, log_files, log_info, open_log, read_log,
};
use bridge::clip::{BOOKMARKS, ClipNote};
use bridge::doctor;
use bridge::reader::{Item, Limits, scan_items};
use bridge::recorder::{Recorder, RecorderOptions};
use bridge::seal::OWN;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use wire::resources::LogInfo;

use crate::recorder::{messages, options};
use crate::support::{START, TempDir, after, record};

/// A log of the folder with `n` messages, of several segments where there are many.
fn make_log(dir: &Path, n: u64) -> String {
    let options = RecorderOptions { segment_bytes: 8000, ..options() };
    let mut recorder = Recorder::start(dir, options).unwrap();
    for (number, message) in messages(n).into_iter().enumerate() {
        match number % 20 {
            19 => recorder.record_durable(message).unwrap().wait_blocking().unwrap(),
            _ => recorder.record(message),
        }
    }
    recorder.finish().unwrap().log.id
}

/// The list as the files themselves give it.
fn of_files(dir: &Path) -> Vec<LogInfo> {
    let mut logs: Vec<LogInfo> = fs::read_dir(dir)
        .unwrap()
        .filter_map(|entry| {
            let name = entry.unwrap().file_name().into_string().unwrap();
            log_info(dir, name.strip_suffix(".mcap").unwrap_or(&name)).ok()
        })
        .collect();
    logs.sort_by(|a, b| (b.start, &b.id).cmp(&(a.start, &a.id)));
    logs
}

#[test]
fn a_catalog_that_is_lost_damaged_or_stale_gives_the_same_list() {
    let dir = TempDir::new("catalog");
    let ids: Vec<String> = [30, 400, 90].map(|n| make_log(dir.path(), n)).into();
    let list = || list_logs(dir.path(), None).unwrap();
    let expected = of_files(dir.path());
    assert_eq!(expected.iter().map(|log| log.messages).sum::<u64>(), 520);
    let path = dir.path().join(CATALOG_FILE);
    assert_eq!(list(), expected, "without a catalog");
    assert!(path.is_file());
    assert_eq!(list(), expected, "from the catalog");
    let sound = fs::read(&path).unwrap();
    for bad in [&b""[..], b"no database", &sound[..sound.len() / 2], &[0; 5000]] {
        fs::write(&path, bad).unwrap();
        assert_eq!(list(), expected, "{} bytes that are none", bad.len());
        assert_eq!(list(), expected, "and once more");
    }
    fs::remove_file(&path).unwrap();
    assert_eq!(list(), expected, "lost");
    // Bits of it flip.
    let sound = fs::read(&path).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(71);
    let used: Vec<usize> = (0..sound.len()).filter(|&i| sound[i] != 0).collect();
    for case in 0..crate::support::cases(2000) {
        let mut bytes = sound.clone();
        let at = used[rng.random_range(0..used.len())];
        bytes[at] ^= 1 << rng.random_range(0..8);
        fs::write(&path, bytes).unwrap();
        assert_eq!(list(), expected, "case {case}, byte {at}");
    }
    // The files change: one is gone, one is new, one is cut.
    fs::write(&path, &sound).unwrap();
    fs::remove_dir_all(dir.path().join(&ids[0])).unwrap();
    make_log(dir.path(), 10);
    let cut = log_files(dir.path(), &ids[1]).unwrap().pop().unwrap();
    let bytes = fs::read(&cut).unwrap();
    fs::write(&cut, &bytes[..bytes.len() - 100]).unwrap();
    let expected = of_files(dir.path());
    assert_eq!(list(), expected, "stale");
    assert_eq!(list(), expected, "and as kept after that");
}

#[test]
fn a_list_from_the_catalog_opens_no_log() {
    let dir = TempDir::new("unopened");
    let id = make_log(dir.path(), 400);
    let listed = list_logs(dir.path(), None).unwrap();
    // Same size, same time of change, and nothing in it that could be read.
    for file in log_files(dir.path(), &id).unwrap() {
        let meta = fs::metadata(&file).unwrap();
        fs::write(&file, vec![0; meta.len() as usize]).unwrap();
        File::options()
            .write(true)
            .open(&file)
            .unwrap()
            .set_modified(meta.modified().unwrap())
            .unwrap();
    }
    assert_eq!(list_logs(dir.path(), None).unwrap(), listed);
    assert_ne!(of_files(dir.path()), listed, "the files say otherwise");
}

#[test]
fn a_log_of_several_segments_comes_as_one_sound_file() {
    let dir = TempDir::new("one-file");
    let id = make_log(dir.path(), 3000);
    let segments = log_files(dir.path(), &id).unwrap().len();
    assert!(segments > 3, "{segments} segments");
    let note = ClipNote {
        texts: BTreeMap::from([("log".into(), id.clone())]),
        bookmarks: Some(b"{\"bookmarks\":[]}".into()),
    };
    let mut file = Vec::new();
    let copied = copy_log(dir.path(), &id, &note, &mut file).unwrap();
    assert_eq!((copied.contents.messages, copied.damage), (3000, vec![]));
    let examined = doctor::examine(&*file, OWN).unwrap();
    assert_eq!((examined.findings, examined.messages), (vec![], 3000));
    let one = bridge::reader::read_log(&*file, Limits::default()).unwrap();
    assert_eq!(one, read_log(dir.path(), &id, Limits::default()).unwrap());
    let (mut bookmarks, mut sessions) = (0, 0);
    scan_items(&*file, Limits::default(), |item| {
        match item {
            Item::Attachment { name, .. } => bookmarks += usize::from(name == BOOKMARKS),
            Item::Metadata(name, _) => sessions += usize::from(name == "footfall"),
            _ => {}
        }
        true
    })
    .unwrap();
    assert_eq!((bookmarks, sessions), (1, 1), "what each segment says again is said once");
}

#[test]
fn commands_are_found_without_reading_the_telemetry() {
    let dir = TempDir::new("commands");
    // Telemetry that fills chunks of its own between few commands.
    let options = RecorderOptions { segment_bytes: 3 << 20, ..options() };
    let mut recorder = Recorder::start(dir.path(), options).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(72);
    for number in 0..1500 {
        let noise: String = (0..8000).map(|_| char::from(rng.random_range(b'a'..=b'z'))).collect();
        let at = after(number as f64 * 0.1);
        recorder.record(record("rover/state", number, at, format!("{{\"noise\":\"{noise}\"}}")));
        if number % 500 == 250 {
            let event = record("command/event", number, at, format!("{{\"n\":{number}}}"));
            recorder.record_durable(event).unwrap().wait_blocking().unwrap();
        }
    }
    let id = recorder.finish().unwrap().log.id;
    let files = log_files(dir.path(), &id).unwrap();
    assert!(files.len() > 1, "{} segments", files.len());
    // Every chunk is damaged: whoever reads one is told.
    for file in &files {
        let mut bytes = fs::read(file).unwrap();
        let footer = bytes.len() - 37;
        let summary = u64::from_le_bytes(bytes[footer + 9..footer + 17].try_into().unwrap());
        let chunks: Vec<usize> =
            (0..summary as usize - 400).filter(|&i| bytes[i..].starts_with(b"zstd")).collect();
        chunks.iter().for_each(|&at| bytes[at + 300] ^= 1);
        fs::write(file, bytes).unwrap();
    }
    let mut log = open_log(dir.path(), &id, Limits::default()).unwrap();
    let events = log.command_events().unwrap();
    assert_eq!(events.iter().map(|e| e.sequence).collect::<Vec<_>>(), [250, 750, 1250]);
    assert_eq!(log.damage(), []);
    log.read(0).unwrap();
    assert!(!log.damage().is_empty(), "the chunks are damaged indeed");
    // A log without such a list, as a crash leaves it: by the chunks that hold commands.
    let torn = TempDir::new("torn");
    let mut recorder = Recorder::start(torn.path(), crate::recorder::options()).unwrap();
    for message in messages(60) {
        recorder.record_durable(message).unwrap().wait_blocking().unwrap();
    }
    let log = recorder.status().log.id;
    let left = TempDir::new("left");
    fs::create_dir(left.path().join(&log)).unwrap();
    let open = catalog::log_path(torn.path(), &log).unwrap();
    fs::copy(&open, left.path().join(&log).join(open.file_name().unwrap())).unwrap();
    recorder.finish().unwrap();
    let mut opened = open_log(left.path(), &log, Limits::default()).unwrap();
    let found = opened.command_events().unwrap();
    assert!(found.iter().map(|e| u64::from(e.sequence)).eq((0..60).step_by(3)));
    assert!(found.iter().all(|e| e.log_time >= START));
}
