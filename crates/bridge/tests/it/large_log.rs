//! A day of log, 10 GB: a place in it is found in less than 200 ms, in little memory (R6).
//!
//! `FOOTFALL_FULL=1`: a day of 10 GB in 96 segments, else ten minutes of it in two.

use bridge::catalog::{list_logs, open_log};
use bridge::reader::Limits;
use bridge::replay::Replay;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tokio::time::Instant;

use crate::day_log::{FRAMES, LOG, forget, write_segments};
use crate::support::{START, TempDir, after};

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
    forget(&files);
    peak_mb();
    let begun = Instant::now();
    let info = list_logs(dir.path(), None).unwrap().remove(0);
    let listed = begun.elapsed();
    forget(&files);
    let begun = Instant::now();
    let content = open_log(dir.path(), LOG, Limits::default()).unwrap();
    let mut replay = Replay::open(START, "r", LOG, content, None, 1.0).unwrap();
    let opened = begun.elapsed();
    let mut rng = ChaCha8Rng::seed_from_u64(92);
    let mut times = Vec::new();
    for _ in 0..200 {
        forget(&files);
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
