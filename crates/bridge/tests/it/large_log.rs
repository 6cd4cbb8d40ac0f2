//! A day of log, 10 GB: a place in it is found in less than 200 ms, in little memory (R6).
//!
//! `FOOTFALL_FULL=1`: a day of 10 GB in 96 segments, else ten minutes of it in two.

use std::collections::BTreeMap;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use bridge::catalog::{list_logs, open_log};
use bridge::reader::{ChannelDef, Item, Limits, LogMessage};
use bridge::replay::Replay;
use bridge::rewrite::Rewriter;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rustix::fs::{Advice, fadvise};
use tokio::time::Instant;

use crate::support::{START, TempDir, after};

const LOG: &str = "footfall-day";
/// A segment has so many frames: ten a second for 15 minutes.
const FRAMES: u64 = 9000;
/// Length of a message: random letters shrink to three quarters, and a day has 10.4 GB of them.
const BYTES: usize = 7900;
/// Random letters to take messages from.
const POOL: usize = 32 << 20;

fn channel(id: u16, topic: &str) -> Arc<ChannelDef> {
    let (topic, encoding) = (topic.into(), "json".into());
    Arc::new(ChannelDef { id, topic, encoding, schema: None, metadata: BTreeMap::new() })
}

/// Writes segments as the sealer does; of each minute, a command of two events.
fn write_segments(dir: &Path, segments: u64, frames: u64) -> Vec<PathBuf> {
    let mut rng = ChaCha8Rng::seed_from_u64(91);
    let mut letters = vec![0; POOL];
    rng.fill(&mut letters[..]);
    letters.iter_mut().for_each(|byte| *byte = b'0' + (*byte & 63));
    letters.iter_mut().filter(|byte| **byte == b'\\').for_each(|byte| *byte = b'p');
    let channels = [(1, "rover/state"), (2, "rover/stability"), (3, "command/event")]
        .map(|(id, topic)| channel(id, topic));
    let folder = dir.join(LOG);
    std::fs::create_dir(&folder).unwrap();
    let mut files = Vec::new();
    for segment in 0..segments {
        let path = folder.join(format!("seg-{:06}.mcap", segment + 1));
        let mut writer = Rewriter::new(File::create(&path).unwrap()).unwrap();
        channels.iter().for_each(|c| writer.take(&Item::Channel(c.clone())).unwrap());
        for frame in segment * frames..(segment + 1) * frames {
            let time = after(frame as f64 * 0.1);
            let mut put = |channel: &Arc<ChannelDef>, data: Vec<u8>| {
                let message = LogMessage {
                    channel: channel.topic.clone(),
                    encoding: channel.encoding.clone(),
                    sequence: frame as u32,
                    log_time: time,
                    publish_time: time,
                    data: data.into(),
                };
                writer.take(&Item::Message(channel.clone(), message)).unwrap();
            };
            for (which, channel) in channels[..2].iter().enumerate() {
                let at = ((2 * frame as usize + which) * 104_729 * 61) % (POOL - BYTES);
                let text = std::str::from_utf8(&letters[at..at + BYTES]).unwrap();
                put(channel, format!("{{\"n\":{frame},\"x\":\"{text}\"}}").into_bytes());
            }
            if frame % 300 == 0 {
                let id = frame / 600;
                put(&channels[2], format!("{{\"command\":{{\"id\":\"c{id}\"}}}}").into_bytes());
            }
        }
        writer.finish().unwrap();
        files.push(path);
    }
    files
}

/// The most memory used since the last call (MB).
fn peak_mb() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).unwrap();
    std::fs::write("/proc/self/clear_refs", "5").unwrap();
    peak.trim().trim_end_matches(" kB").parse::<u64>().unwrap() / 1000
}

#[test]
fn a_place_in_a_day_of_log_is_found_at_once() {
    let full = std::env::var_os("FOOTFALL_FULL").is_some();
    let (segments, frames) = if full { (96, FRAMES) } else { (2, FRAMES / 30) };
    let dir = TempDir::new("day");
    let files = write_segments(dir.path(), segments, frames);
    let length = (segments * frames) as f64 * 0.1;
    let forget = || {
        for file in &files {
            let file = File::open(file).unwrap();
            file.sync_all().unwrap();
            fadvise(&file, 0, None, Advice::DontNeed).unwrap();
        }
    };
    forget();
    peak_mb();
    let begun = Instant::now();
    let info = list_logs(dir.path(), None).unwrap().remove(0);
    let listed = begun.elapsed();
    forget();
    let begun = Instant::now();
    let content = open_log(dir.path(), LOG, Limits::default()).unwrap();
    let mut replay = Replay::open(START, "r", LOG, content, None, 1.0).unwrap();
    let opened = begun.elapsed();
    let mut rng = ChaCha8Rng::seed_from_u64(92);
    let mut times = Vec::new();
    for _ in 0..200 {
        forget();
        let at = rng.random_range(0.0..length - 0.2);
        let begun = Instant::now();
        let state = replay.seek(START, after(at)).unwrap();
        let next = replay.step(START).unwrap().unwrap();
        times.push(begun.elapsed());
        // The frame before the place and the one after it, by the times they were given.
        let before = (at / 0.1 + 1e-6).floor() as u64;
        let shown = state.iter().find(|message| *message.channel == *"rover/state").unwrap();
        assert_eq!((shown.sequence, next.sequence), (before, before + 1), "at {at} s");
        let commands = state.iter().filter(|m| *m.channel == *"command/event").count() as u64;
        assert_eq!(commands, (before / 600 + 1).min(1000));
    }
    let peak = peak_mb();
    times.sort_unstable();
    eprintln!(
        "log of {:.2} GB, {} messages in {segments} segments, nothing of it in the page cache: listed in \
         {listed:.0?}, opened in {opened:.0?}, seek p50 {:.1?}, p95 {:.1?}, most {:.1?}; memory at most {peak} MB",
        info.size as f64 / 1e9,
        info.messages,
        times[100],
        times[190],
        times[199]
    );
    if full {
        assert!(info.size > 10_000_000_000, "{}", info.size);
        assert!(times[190].as_millis() < 200, "{:?}", times[190]);
        assert!(peak < 200, "{peak} MB");
    }
}
