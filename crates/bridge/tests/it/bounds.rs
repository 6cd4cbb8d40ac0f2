//! Hostile files cost little: whatever is done with one, in a process of its own, less than 256 MB of
//! memory and 2 s of the processor (X2). `FOOTFALL_FULL=1`: all five uses of each, else two.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

use bridge::catalog;
use bridge::clip::{self, ClipNote, Selection};
use bridge::doctor;
use bridge::reader::{IndexedLog, Limits};
use bridge::replay::Replay;
use mcap::records::op;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use wire::time::Timestamp;

use crate::support::TempDir;

const FILE: &str = "FOOTFALL_HOSTILE_FILE";
const MEMORY_KB: u64 = 256_000;
const CPU_MS: u64 = 2000;

struct File(Vec<u8>);

impl File {
    fn new() -> File {
        let mut file = File(mcap::MAGIC.to_vec());
        file.record(op::HEADER, &[0; 8]);
        file
    }

    fn record(&mut self, opcode: u8, body: &[u8]) -> u64 {
        let at = self.0.len() as u64;
        self.0.push(opcode);
        self.0.extend((body.len() as u64).to_le_bytes());
        self.0.extend(body);
        at
    }

    fn chunk(&mut self, compression: &str, size: u64, content: &[u8]) -> u64 {
        let mut body = vec![0; 16];
        body.extend(size.to_le_bytes());
        body.extend(0_u32.to_le_bytes());
        body.extend((compression.len() as u32).to_le_bytes());
        body.extend(compression.as_bytes());
        body.extend((content.len() as u64).to_le_bytes());
        body.extend(content);
        self.record(op::CHUNK, &body)
    }

    /// A summary of the given records, with a checksum that agrees.
    fn end(mut self, summary: &[(u8, Vec<u8>)]) -> Vec<u8> {
        self.record(op::DATA_END, &[0; 4]);
        let begin = self.0.len();
        for (opcode, body) in summary {
            self.record(*opcode, body);
        }
        let mut footer = vec![op::FOOTER];
        footer.extend(20_u64.to_le_bytes());
        footer.extend((begin as u64).to_le_bytes());
        footer.extend(0_u64.to_le_bytes());
        let crc = crc32fast::hash(&[&self.0[begin..], &footer].concat());
        self.0.extend(footer);
        self.0.extend(crc.to_le_bytes());
        self.0.extend(mcap::MAGIC);
        self.0
    }
}

fn channel(id: u16, topic: &str) -> Vec<u8> {
    let mut body = [id.to_le_bytes(), [0; 2]].concat();
    for text in [topic, "json"] {
        body.extend((text.len() as u32).to_le_bytes());
        body.extend(text.as_bytes());
    }
    body.extend(0_u32.to_le_bytes());
    body
}

fn framed(opcode: u8, body: &[u8]) -> Vec<u8> {
    [&[opcode][..], &(body.len() as u64).to_le_bytes(), body].concat()
}

fn message(id: u16, data: &[u8]) -> Vec<u8> {
    framed(op::MESSAGE, &[&id.to_le_bytes()[..], &[0; 20], data].concat())
}

fn zstd(content: &[u8]) -> Vec<u8> {
    zstd::bulk::compress(content, 1).unwrap()
}

/// A zstd stream of so many mebibytes of zeros.
fn zeros(mebibytes: usize) -> Vec<u8> {
    let mut encoder = zstd::stream::write::Encoder::new(Vec::new(), 1).unwrap();
    let block = vec![0; 1 << 20];
    for _ in 0..mebibytes {
        encoder.write_all(&block).unwrap();
    }
    encoder.finish().unwrap()
}

fn chunk_index(at: u64, length: u64) -> Vec<u8> {
    let mut body = [0_u64.to_le_bytes(), 9_u64.to_le_bytes(), at.to_le_bytes()].concat();
    body.extend(length.to_le_bytes());
    body.extend(10_u32.to_le_bytes());
    body.extend(1_u16.to_le_bytes());
    body.extend(at.to_le_bytes());
    body.extend([0; 8]);
    body.extend(0_u32.to_le_bytes());
    body.extend([0; 16]);
    body
}

/// The files, by name. Each is a way to make little do much.
fn corpus() -> Vec<(&'static str, Vec<u8>)> {
    let mut rng = ChaCha8Rng::seed_from_u64(81);
    let mut noise = |n: usize| -> Vec<u8> {
        let mut bytes = vec![0; n];
        rng.fill(&mut bytes[..]);
        bytes
    };
    let one = |fill: &dyn Fn(&mut File) -> u64| {
        let mut file = File::new();
        fill(&mut file);
        file.end(&[])
    };
    let bomb = zeros(4096);
    let mut files = vec![
        ("4 GB of zeros, told", one(&|f| f.chunk("zstd", 4 << 30, &bomb))),
        ("4 GB of zeros, said to be 60 MiB", one(&|f| f.chunk("zstd", 60 << 20, &bomb))),
        ("4 GB of zeros, said to be 4 MiB", one(&|f| f.chunk("zstd", 4 << 20, &bomb))),
        ("a thousand chunks of 4 MiB of zeros", {
            let small = zeros(4);
            one(&|f| (0..1000).map(|_| f.chunk("zstd", 4 << 20, &small)).max().unwrap())
        }),
        ("lz4 that says 60 MiB", one(&|f| f.chunk("lz4", 60 << 20, &[4, 0x22, 0x4D, 0x18, 0]))),
    ];
    for (name, length) in [
        ("a record of 2^64 - 1", u64::MAX),
        ("a record of 10^11", 100_000_000_000),
        ("a record of 64 MiB that is not there", 64 << 20),
    ] {
        let mut file = File::new();
        file.0.push(op::CHUNK);
        file.0.extend(length.to_le_bytes());
        files.push((name, file.0));
    }
    files.push(("a chunk of 60 MiB of one message", {
        let inner = [framed(op::CHANNEL, &channel(1, "x")), message(1, &noise(60 << 20))].concat();
        one(&|f| f.chunk("", inner.len() as u64, &inner))
    }));
    files.push(("a chunk of a million empty messages", {
        let mut inner = framed(op::CHANNEL, &channel(1, "x"));
        (0..1_000_000).for_each(|_| inner.extend(message(1, b"")));
        let small = zstd(&inner);
        one(&|f| f.chunk("zstd", inner.len() as u64, &small))
    }));
    files.push(("65 535 channels of long names", {
        let long = "x".repeat(900);
        let mut inner = Vec::new();
        (1..=65_535).for_each(|id| inner.extend(framed(op::CHANNEL, &channel(id, &long))));
        let small = zstd(&inner);
        one(&|f| f.chunk("zstd", inner.len() as u64, &small))
    }));
    files.push(("a channel said a million times", {
        let mut inner = Vec::new();
        for n in 0..1_000_000_u32 {
            inner.extend(framed(op::CHANNEL, &channel(1, if n % 2 == 0 { "a" } else { "b" })));
        }
        let small = zstd(&inner);
        one(&|f| f.chunk("zstd", inner.len() as u64, &small))
    }));
    files.push(("an attachment of 60 MiB", {
        let mut body = vec![0; 16];
        body.extend([0; 8]);
        body.extend((60_u64 << 20).to_le_bytes());
        body.extend(noise(60 << 20));
        body.extend([0; 4]);
        one(&|f| f.record(op::ATTACHMENT, &body))
    }));
    files.push(("200 000 chunk indexes of one chunk", {
        let inner = [framed(op::CHANNEL, &channel(1, "x")), message(1, b"{}")].concat();
        let mut file = File::new();
        let at = file.chunk("", inner.len() as u64, &inner);
        let length = file.0.len() as u64 - at;
        let mut summary = vec![(op::CHANNEL, channel(1, "x"))];
        summary.extend((0..200_000).map(|_| (op::CHUNK_INDEX, chunk_index(at, length))));
        file.end(&summary)
    }));
    files.push(("chunk indexes that point anywhere", {
        let mut file = File::new();
        file.record(0x80, &noise(1 << 20));
        let mut summary = vec![(op::CHANNEL, channel(1, "x"))];
        summary.extend((0..5000).map(|n| (op::CHUNK_INDEX, chunk_index(n * 200, 1 << (n % 40)))));
        file.end(&summary)
    }));
    files.push(("bytes that all begin a chunk", vec![op::CHUNK; 8 << 20]));
    files.push(("a chunk within a chunk within a chunk", {
        let mut inner = vec![0; 1 << 20];
        for _ in 0..50 {
            let mut file = File(Vec::new());
            file.chunk("", inner.len() as u64, &inner);
            inner = file.0;
        }
        let mut bytes = mcap::MAGIC.to_vec();
        bytes.extend(inner);
        bytes
    }));
    files
}

/// All that is ever done with a file from elsewhere.
#[test]
#[ignore = "the child of the test below"]
fn victim() {
    let Some(path) = std::env::var_os(FILE).map(PathBuf::from) else { return };
    let open = || std::io::BufReader::new(fs::File::open(&path).unwrap());
    let limits = Limits::default();
    let dir = path.parent().unwrap();
    match std::env::var("FOOTFALL_HOSTILE_USE").unwrap().as_str() {
        "scan" => drop(bridge::reader::scan(open(), limits, |_| true)),
        "examine" => drop(doctor::examine(open(), limits).unwrap()),
        "list" => drop(catalog::list_logs(dir, None).unwrap()),
        "replay" => {
            if let Ok(log) = IndexedLog::open(&[path], limits)
                && let Ok(mut replay) = Replay::open(Timestamp(0), "r", "log", log, None, 1.0)
            {
                let _ = replay.seek(Timestamp(0), Timestamp(5));
                let _ = replay.advance(Timestamp(100));
            }
        }
        _ => {
            let (selection, note) = (Selection::default(), ClipNote::default());
            let out = dir.join("out");
            let _ = clip::copy_to(std::slice::from_ref(&path), &selection, &note, &out, limits);
        }
    }
    let status = fs::read_to_string("/proc/self/status").unwrap();
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).unwrap().trim();
    // Time on a processor, for the machine may have others to serve.
    let cpu = fs::read_to_string("/proc/self/schedstat").unwrap();
    let main = cpu.split(' ').next().unwrap();
    let own = fs::read_to_string("/proc/thread-self/schedstat").unwrap();
    let (peak, own) = (peak.trim_end_matches(" kB"), own.split(' ').next().unwrap());
    writeln!(std::io::stdout(), "used {peak} {main} {own}").unwrap();
}

fn used(path: &Path, what: &str) -> (u64, u64) {
    let output = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "bounds::victim", "--ignored", "--nocapture", "--test-threads=1"])
        .env(FILE, path)
        .env("FOOTFALL_HOSTILE_USE", what)
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&output.stdout);
    let line = text.lines().find_map(|line| Some(line.split_once("used ")?.1));
    let line =
        line.unwrap_or_else(|| panic!("{what}: {}", String::from_utf8_lossy(&output.stderr)));
    let numbers: Vec<u64> = line.split(' ').map(|n| n.parse().unwrap()).collect();
    (numbers[0], (numbers[1] + numbers[2]) / 1_000_000)
}

#[test]
fn a_hostile_file_takes_little_memory_and_time() {
    let full = std::env::var_os("FOOTFALL_FULL").is_some();
    let all = ["scan", "replay", "examine", "list", "clip"];
    let (mut most_kb, mut most_ms, mut uses) = (0, 0, 0);
    for (name, bytes) in corpus() {
        let dir = TempDir::new("hostile");
        let path = dir.path().join("hostile.mcap");
        fs::write(&path, bytes).unwrap();
        for what in if full { &all[..] } else { &all[..2] } {
            let (kb, ms) = used(&path, what);
            if kb > MEMORY_KB / 2 || ms > CPU_MS / 2 {
                eprintln!("{name}, {what}: {} MB, {ms} ms", kb / 1000);
            }
            assert!(kb < MEMORY_KB, "{name}, {what}: {kb} kB");
            assert!(ms < CPU_MS, "{name}, {what}: {ms} ms");
            (most_kb, most_ms) = (most_kb.max(kb), most_ms.max(ms));
            uses += 1;
        }
    }
    eprintln!("{uses} uses of hostile files: at most {} MB and {most_ms} ms", most_kb / 1000);
}
