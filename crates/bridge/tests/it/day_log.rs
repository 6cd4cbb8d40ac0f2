//! A log of a day as the sealer leaves it, for tests and benchmarks of seeking in a large one.

use std::collections::BTreeMap;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use bridge::reader::{ChannelDef, Item, LogMessage};
use bridge::rewrite::Rewriter;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rustix::fs::{Advice, fadvise};
use wire::time::Timestamp;

/// Time of the first message.
pub const START: Timestamp = Timestamp(1_000_000_000_000_000_000);
pub const LOG: &str = "footfall-day";
/// A segment has so many frames: ten a second for 15 minutes.
pub const FRAMES: u64 = 9000;
/// Length of a message: random letters shrink to three quarters, and a day has 10.4 GB of them.
const BYTES: usize = 7900;
/// Random letters to take messages from.
const POOL: usize = 32 << 20;

fn channel(id: u16, topic: &str) -> Arc<ChannelDef> {
    let (topic, encoding) = (topic.into(), "json".into());
    Arc::new(ChannelDef { id, topic, encoding, schema: None, metadata: BTreeMap::new() })
}

/// Writes segments as the sealer does; of each minute, a command of two events.
pub fn write_segments(dir: &Path, segments: u64, frames: u64) -> Vec<PathBuf> {
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
            let time = START.plus_seconds(frame as f64 * 0.1);
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

/// Has the machine forget what it read of the files: nothing of them stays in the page cache.
pub fn forget(files: &[PathBuf]) {
    for file in files {
        let file = File::open(file).unwrap();
        file.sync_all().unwrap();
        fadvise(&file, 0, None, Advice::DontNeed).unwrap();
    }
}
