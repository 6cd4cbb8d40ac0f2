//! One reader and its damaged files, with what was counted.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rustix::time::{ClockId, clock_gettime};

use crate::HEAP;
use crate::mutate::{Seed, mutated};
use crate::readers::title;

/// What a reader made of a file: true if it read it, false if it refused it, or the promise that it broke.
pub type Answer = Result<bool, String>;

/// Reads what has become of a seed, given by its index.
pub type Read = Box<dyn Fn(usize, &[u8]) -> Answer>;

/// A reader of files.
pub struct Reader {
    pub name: &'static str,
    /// Good files, each of which it reads.
    pub seeds: Vec<Seed>,
    pub read: Read,
    /// Most memory beside the file (bytes).
    pub memory_max: usize,
    /// Most time for one file (s of the processor, as a release build; a debug build may take ten times it).
    pub seconds_max: f64,
}

/// Head of the table of docs/RELIABILITY.md, with what broke a promise beside it.
pub const HEAD: &str = "| reader | damaged files | read | most memory | slowest | processor |\n\
    |---|---|---|---|---|---|";

/// A reader at work.
pub struct Run {
    reader: Reader,
    rng: ChaCha8Rng,
    n: u64,
    n_read: u64,
    memory: usize,
    slowest_s: f64,
    used_s: f64,
    /// Each promise that was broken, with the file that did it.
    pub broken: Vec<String>,
}

impl Run {
    pub fn new(reader: Reader, seed: u64) -> Run {
        let name = reader.name.bytes().fold(seed, |h, b| h.wrapping_mul(31).wrapping_add(b.into()));
        let rng = ChaCha8Rng::seed_from_u64(name);
        let (n, n_read, memory, slowest_s, used_s) = (0, 0, 0, 0.0, 0.0);
        Run { reader, rng, n, n_read, memory, slowest_s, used_s, broken: Vec::new() }
    }

    /// The seeds themselves: damage to what is no good file would prove nothing.
    pub fn read_good_files(&mut self) {
        for (i, seed) in self.reader.seeds.iter().enumerate() {
            let answer = (self.reader.read)(i, &seed.bytes);
            if answer != Ok(true) {
                let (name, what) = (self.reader.name, &seed.what);
                self.broken.push(format!("{name}: the good file {i} ({what}) gave {answer:?}"));
            }
        }
    }

    /// So many damaged files.
    pub fn inputs(&mut self, n: u64, watch: &Watch) {
        for _ in 0..n {
            self.one(watch);
        }
    }

    /// Damaged files until `seconds` of the processor are used in all.
    pub fn until(&mut self, seconds: f64, watch: &Watch) {
        let began = cpu_s() - self.used_s;
        while cpu_s() - began < seconds {
            self.one(watch);
        }
        self.used_s = cpu_s() - began;
    }

    fn one(&mut self, watch: &Watch) {
        let i = self.rng.random_range(0..self.reader.seeds.len());
        let bytes = mutated(&mut self.rng, &self.reader.seeds, i);
        watch.begins(self.reader.name, &bytes);
        HEAP.reset_peak_usage();
        let (before, began) = (HEAP.current_usage(), cpu_s());
        let answer = catch_unwind(AssertUnwindSafe(|| (self.reader.read)(i, &bytes)));
        let (taken, memory) = (cpu_s() - began, HEAP.peak_usage().saturating_sub(before));
        watch.ends();
        self.n += 1;
        self.memory = self.memory.max(memory);
        self.slowest_s = self.slowest_s.max(taken);
        match answer {
            Ok(Ok(is_read)) => self.n_read += u64::from(is_read),
            Ok(Err(promise)) => self.breaks(&promise, &bytes),
            Err(_) => self.breaks("it panicked", &bytes),
        }
        if memory > self.reader.memory_max {
            self.breaks(&format!("it took {memory} bytes of memory"), &bytes);
        }
        let slack = if cfg!(debug_assertions) { 10.0 } else { 1.0 };
        if taken > slack * self.reader.seconds_max {
            self.breaks(&format!("it took {taken:.1} s"), &bytes);
        }
    }

    fn breaks(&mut self, promise: &str, bytes: &[u8]) {
        if self.broken.len() < 20 {
            let file = keep(self.reader.name, self.n, bytes);
            let broken = format!("{}: {promise}: {file}", self.reader.name);
            // At once: a long run may be cut off.
            println!("{broken}");
            self.broken.push(broken);
        }
    }

    /// A row of that table.
    pub fn row(&self) -> String {
        let row = format!(
            "| {} | {} | {} | {:.1} MB | {:.0} ms | {:.0} s |",
            title(self.reader.name),
            spaced(self.n),
            spaced(self.n_read),
            self.memory as f64 / 1e6,
            1e3 * self.slowest_s,
            self.used_s,
        );
        match self.broken.len() {
            0 => row,
            n => format!("{row} {n} broken promises"),
        }
    }
}

/// A number with a space every three digits.
fn spaced(n: u64) -> String {
    let digits = n.to_string();
    let is_apart = |i: usize| i > 0 && (digits.len() - i).is_multiple_of(3);
    let parts = digits
        .chars()
        .enumerate()
        .map(|(i, c)| [if is_apart(i) { " " } else { "" }, &c.to_string()].concat());
    parts.collect()
}

/// Keeps a file for whoever mends the reader; where.
fn keep(reader: &str, n: u64, bytes: &[u8]) -> String {
    let folder = testkit::project_dir().join("target/fuzz");
    let file = folder.join(format!("{reader}-{n}"));
    let kept = std::fs::create_dir_all(&folder).and_then(|()| std::fs::write(&file, bytes));
    kept.map_or_else(|e| e.to_string(), |()| file.display().to_string())
}

/// Time of the processor that this process has used (s).
fn cpu_s() -> f64 {
    let time = clock_gettime(ClockId::ProcessCPUTime);
    time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
}

/// The file at hand, of a reader, since when.
type AtHand = Option<(&'static str, Vec<u8>, f64)>;

/// Ends the program when a reader does not come to an end, and keeps the file.
pub struct Watch(Arc<Mutex<AtHand>>);

impl Watch {
    pub fn start() -> Watch {
        let at_hand: Arc<Mutex<AtHand>> = Arc::default();
        let seen = at_hand.clone();
        std::thread::spawn(move || {
            loop {
                std::thread::sleep(Duration::from_secs(1));
                if let Some((reader, bytes, began)) = &*seen.lock().unwrap()
                    && cpu_s() - began > 120.0
                {
                    eprintln!("{reader} does not come to an end: {}", keep(reader, 0, bytes));
                    std::process::abort();
                }
            }
        });
        Watch(at_hand)
    }

    fn begins(&self, reader: &'static str, bytes: &[u8]) {
        *self.0.lock().unwrap() = Some((reader, bytes.to_vec(), cpu_s()));
    }

    fn ends(&self) {
        *self.0.lock().unwrap() = None;
    }
}
