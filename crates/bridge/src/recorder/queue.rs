//! What waits for the disk, shared by the callers and the writer's thread.

use std::collections::{BTreeMap, VecDeque};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::sync::{Notify, oneshot};
use wire::live::{EventLevel, EventNotice, GapReason, LogGap};
use wire::resources::LogInfo;
use wire::time::Timestamp;

use super::{
    BULK_BYTES_MAX, COMMIT_BYTES, COMMIT_MS, DURABLE_MAX, RECORD_BYTES_MAX, Record, RecorderError,
    RecorderStatus, TELEMETRY_BYTES_MAX,
};

/// What a message costs in memory beside its text.
const OVERHEAD_BYTES: usize = 96;
/// Notices kept for the owner of the `event` channel.
const NOTICES_MAX: usize = 256;
/// While the disk refuses, drops of a channel are told so often (s).
const TELL_DROPS_S: f64 = 10.0;

/// How a message is treated where not all can be kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Class {
    /// Never dropped.
    Durable,
    /// The oldest gives way.
    Telemetry,
    /// Gives way before telemetry does.
    Bulk,
}

/// A message and who waits for it.
#[derive(Debug)]
pub struct Item {
    pub record: Record,
    pub class: Class,
    pub written: Option<oneshot::Sender<Result<(), RecorderError>>>,
}

/// Everything that waited, in the order it came.
#[derive(Debug, Default)]
pub struct Batch {
    pub items: Vec<Item>,
    /// True if a new file was asked for.
    pub rotate: bool,
    /// True once the recorder is to end: no batch comes after this one.
    pub last: bool,
}

#[derive(Debug, Default)]
pub struct Queue {
    state: Mutex<State>,
    wake: Condvar,
    pub committed: Arc<Notify>,
}

#[derive(Debug, Default)]
struct State {
    /// All with a running number, to merge them in the order they came.
    telemetry: Waiting,
    bulk: Waiting,
    durable: VecDeque<(u64, Item)>,
    next: u64,
    rotate: bool,
    ended: bool,
    dropped: u64,
    /// Drops by channel that no event has told yet, and those that the log has not told yet.
    untold: BTreeMap<Arc<str>, Untold>,
    gaps: BTreeMap<Arc<str>, LogGap>,
    notices: VecDeque<EventNotice>,
    progress: Progress,
}

/// Drops of one channel.
#[derive(Debug, Default)]
struct Untold {
    dropped: u64,
    /// Log time of the last of them.
    last: Timestamp,
    /// `last` when an event told of this channel before.
    told: Option<Timestamp>,
}

/// Messages that may give way to newer ones.
#[derive(Debug, Default)]
struct Waiting {
    records: VecDeque<(u64, Record)>,
    bytes: usize,
}

impl Waiting {
    fn push(&mut self, number: u64, record: Record) {
        self.bytes += record.data.len() + OVERHEAD_BYTES;
        self.records.push_back((number, record));
    }

    /// Takes the oldest out where more than `most` bytes wait.
    fn surplus(&mut self, most: usize) -> Option<Record> {
        let (_, oldest) = (self.bytes > most).then(|| self.records.pop_front())??;
        self.bytes -= oldest.data.len() + OVERHEAD_BYTES;
        Some(oldest)
    }
}

/// What the writer tells of its work.
#[derive(Debug, Clone, Default)]
pub struct Progress {
    pub log: Option<LogInfo>,
    pub commits: u64,
    pub messages: u64,
    pub segments: u64,
    pub error: Option<String>,
}

impl Queue {
    /// Takes a message that may give way, in the class `Telemetry` or `Bulk`.
    pub fn push(&self, record: Record, class: Class) {
        let mut state = self.lock();
        if state.ended {
            return state.drop_one(&record, GapReason::Ended);
        }
        if record.data.len() > RECORD_BYTES_MAX {
            return state.drop_one(&record, GapReason::TooLarge);
        }
        let number = state.number();
        let (waiting, most) = match class {
            Class::Bulk => (&mut state.bulk, BULK_BYTES_MAX),
            _ => (&mut state.telemetry, TELEMETRY_BYTES_MAX),
        };
        waiting.push(number, record);
        let surplus: Vec<Record> = std::iter::from_fn(|| waiting.surplus(most)).collect();
        surplus.iter().for_each(|record| state.drop_one(record, GapReason::TooSlow));
        if state.expendable_bytes() >= COMMIT_BYTES {
            self.wake.notify_one();
        }
    }

    pub fn push_durable(&self, item: Item) -> Result<(), RecorderError> {
        let mut state = self.lock();
        if state.ended {
            return Err(RecorderError::Ended);
        }
        if item.record.data.len() > RECORD_BYTES_MAX {
            return Err(RecorderError::TooLarge { bytes: item.record.data.len() });
        }
        if state.durable.len() >= DURABLE_MAX {
            return Err(RecorderError::QueueFull);
        }
        let number = state.number();
        state.durable.push_back((number, item));
        self.wake.notify_one();
        Ok(())
    }

    /// Asks for a new file.
    pub fn rotate(&self) {
        self.lock().rotate = true;
        self.wake.notify_one();
    }

    /// Waits until a batch is due and takes it. `retry`: the disk has just refused one, and is tried
    /// again after a period or with the next durable message, not with every bit of telemetry.
    pub fn take_batch(&self, retry: bool) -> Batch {
        let period = Duration::from_millis(COMMIT_MS);
        let waits = |s: &mut State| {
            let busy = retry || s.expendable_bytes() < COMMIT_BYTES;
            !s.ended && !s.rotate && s.durable.is_empty() && busy
        };
        let guard = self.wake.wait_timeout_while(self.lock(), period, waits);
        let mut state = guard.unwrap_or_else(PoisonError::into_inner).0;
        let rotate = std::mem::take(&mut state.rotate);
        Batch { items: state.drain(), rotate, last: state.ended }
    }

    /// What the log lacks and has not told yet.
    pub fn take_gaps(&self) -> Vec<LogGap> {
        std::mem::take(&mut self.lock().gaps).into_values().collect()
    }

    pub fn end(&self) {
        self.lock().ended = true;
        self.wake.notify_one();
    }

    /// Counts messages that the writer could not write.
    pub fn drop_all<'a>(&self, records: impl Iterator<Item = &'a Record>, reason: GapReason) {
        let mut state = self.lock();
        records.for_each(|record| state.drop_one(record, reason));
    }

    pub fn notice(&self, level: EventLevel, text: String) {
        self.lock().notice(level, text);
    }

    pub fn take_notices(&self) -> Vec<EventNotice> {
        let mut state = self.lock();
        // While the disk refuses, of each channel once in a while only: every event is for the disk, too.
        let well = state.progress.error.is_none() || state.ended;
        let mut texts = Vec::new();
        for (channel, untold) in &mut state.untold {
            let due = untold.told.is_none_or(|at| untold.last.seconds_since(at) >= TELL_DROPS_S);
            if untold.dropped > 0 && (well || due) {
                let dropped = std::mem::take(&mut untold.dropped);
                untold.told = Some(untold.last);
                texts.push(format!(
                    "{dropped} messages of {channel} are not in the log; log/gap tells why"
                ));
            }
        }
        texts.into_iter().for_each(|text| state.notice(EventLevel::Warning, text));
        std::mem::take(&mut state.notices).into()
    }

    pub fn set_progress(&self, progress: Progress) {
        self.lock().progress = progress;
    }

    pub fn status(&self) -> RecorderStatus {
        let state = self.lock();
        let progress = state.progress.clone();
        let none = LogInfo {
            id: String::new(),
            size: 0,
            start: None,
            end: None,
            messages: 0,
            open: false,
        };
        RecorderStatus {
            log: progress.log.unwrap_or(none),
            commits: progress.commits,
            messages: progress.messages,
            dropped: state.dropped,
            segments: progress.segments,
            error: progress.error,
        }
    }

    /// True while the disk does not take everything.
    pub fn fails(&self) -> bool {
        self.lock().progress.error.is_some()
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        // Every method leaves the state whole, so a panic elsewhere has not harmed it.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl State {
    fn number(&mut self) -> u64 {
        self.next += 1;
        self.next
    }

    fn expendable_bytes(&self) -> usize {
        self.telemetry.bytes + self.bulk.bytes
    }

    fn drop_one(&mut self, record: &Record, reason: GapReason) {
        self.dropped += 1;
        let untold = self.untold.entry(record.channel.clone()).or_default();
        untold.dropped += 1;
        untold.last = untold.last.max(record.log_time);
        let gap = self.gaps.entry(record.channel.clone()).or_insert_with(|| LogGap {
            channel: record.channel.to_string(),
            dropped: 0,
            first_sequence: record.sequence,
            last_sequence: record.sequence,
            from: record.log_time,
            to: record.log_time,
            reason,
        });
        gap.dropped += 1;
        gap.last_sequence = gap.last_sequence.max(record.sequence);
        gap.to = gap.to.max(record.log_time);
        gap.reason = reason;
    }

    fn notice(&mut self, level: EventLevel, text: String) {
        if self.notices.len() == NOTICES_MAX {
            self.notices.pop_front();
        }
        self.notices.push_back(EventNotice { level, text, who: "recorder".into() });
    }

    /// Everything that waits, in the order it came.
    fn drain(&mut self) -> Vec<Item> {
        let mut items: Vec<(u64, Item)> = self.durable.drain(..).collect();
        for (waiting, class) in
            [(&mut self.telemetry, Class::Telemetry), (&mut self.bulk, Class::Bulk)]
        {
            waiting.bytes = 0;
            let taken = waiting.records.drain(..);
            items.extend(taken.map(|(n, record)| (n, Item { record, class, written: None })));
        }
        // Three sorted runs: quick for this sort.
        items.sort_by_key(|(number, _)| *number);
        items.into_iter().map(|(_, item)| item).collect()
    }
}
