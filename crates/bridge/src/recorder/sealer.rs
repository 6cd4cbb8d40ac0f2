//! Sealing aside from the writing, in the order of the segments.

use std::collections::{BTreeMap, VecDeque};
use std::sync::{Arc, Mutex, PoisonError, mpsc};
use std::thread::JoinHandle;
use std::time::Duration;

use wire::live::EventLevel;

use super::queue::Queue;
use super::room::Room;
use super::storage::Storage;
use crate::seal::{self, SealRef};

/// A pause after every mebibyte, to leave disk and processor to the writer.
const PAUSE: Duration = Duration::from_millis(2);

/// A segment that is no longer written.
pub struct Job {
    pub segment: u32,
    pub bytes: u64,
    /// How much of it counts; all where absent.
    pub limit: Option<u64>,
}

/// Sizes of the segments that are no longer written (bytes).
pub type Sizes = Arc<Mutex<BTreeMap<u32, u64>>>;

/// Seals one segment after the other.
pub struct Worker {
    storage: Arc<dyn Storage>,
    log: String,
    previous: Option<SealRef>,
    waiting: VecDeque<Job>,
    queue: Arc<Queue>,
    sizes: Sizes,
}

impl Worker {
    pub fn new(
        storage: Arc<dyn Storage>,
        log: String,
        previous: Option<SealRef>,
        queue: Arc<Queue>,
        sizes: Sizes,
    ) -> Worker {
        Worker { storage, log, previous, waiting: VecDeque::new(), queue, sizes }
    }

    /// Seals what waits. Where one cannot be sealed, it and all after it wait for the next call:
    /// the chain has an order. What waits at the end is sealed when the next recorder starts.
    fn work(&mut self, pace: &dyn Fn()) {
        while let Some(job) = self.waiting.front() {
            if !Room::has_room_for(&*self.storage, job.bytes) {
                return;
            }
            let (segment, previous) = (job.segment, self.previous.clone());
            match seal::seal(&*self.storage, &self.log, segment, job.limit, previous, pace) {
                Ok(sealed) => {
                    let mut sizes = self.sizes.lock().unwrap_or_else(PoisonError::into_inner);
                    sizes.insert(segment, sealed.seal.bytes);
                    drop(sizes);
                    for damage in &sealed.damage {
                        let text = format!("segment {segment} was found damaged: {damage}");
                        self.queue.notice(EventLevel::Warning, text);
                    }
                    self.previous = Some(sealed.reference);
                    self.waiting.pop_front();
                }
                Err(error) => {
                    tracing::warn!("segment {segment} of the log is not sealed yet: {error}");
                    return;
                }
            }
        }
    }
}

/// Who seals.
pub enum Sealer {
    /// The writer itself.
    Inline(Worker),
    /// A thread of its own.
    Aside(mpsc::Sender<Job>, JoinHandle<()>),
}

impl Sealer {
    /// Starts a thread for the worker, or not.
    pub fn start(mut worker: Worker, aside: bool) -> std::io::Result<Sealer> {
        if !aside {
            return Ok(Sealer::Inline(worker));
        }
        let (sender, jobs) = mpsc::channel::<Job>();
        let thread = std::thread::Builder::new().name("log-sealer".into()).spawn(move || {
            for job in jobs {
                worker.waiting.push_back(job);
                worker.work(&|| std::thread::sleep(PAUSE));
            }
            worker.work(&|| {});
        })?;
        Ok(Sealer::Aside(sender, thread))
    }

    /// Takes a segment.
    pub fn take(&mut self, job: Job) {
        match self {
            Sealer::Inline(worker) => {
                worker.waiting.push_back(job);
                worker.work(&|| {});
            }
            // A sealer that is gone leaves the segment open, and the next start seals it.
            Sealer::Aside(sender, _) => drop(sender.send(job)),
        }
    }

    /// Waits until all is sealed that can be.
    pub fn finish(self) {
        match self {
            Sealer::Inline(mut worker) => worker.work(&|| {}),
            Sealer::Aside(sender, thread) => {
                drop(sender);
                if thread.join().is_err() {
                    tracing::error!("the sealer's thread has panicked");
                }
            }
        }
    }
}
