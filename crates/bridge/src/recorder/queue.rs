//! What waits for the disk, shared by the callers and the writer's thread.

use std::collections::{BTreeMap, VecDeque};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::sync::{Notify, oneshot};
use wire::live::{EventLevel, EventNotice};
use wire::resources::LogInfo;

use super::{
    COMMIT_BYTES, COMMIT_MS, DURABLE_MAX, Record, RecorderError, RecorderStatus,
    TELEMETRY_BYTES_MAX,
};

/// What a message costs in memory beside its text.
const OVERHEAD_BYTES: usize = 96;
/// Notices kept for the owner of the `event` channel.
const NOTICES_MAX: usize = 256;

/// A message and who waits for it.
#[derive(Debug)]
pub struct Item {
    pub record: Record,
    pub written: Option<oneshot::Sender<Result<(), RecorderError>>>,
}

/// Everything that waited, in the order it came.
#[derive(Debug, Default)]
pub struct Batch {
    pub items: Vec<Item>,
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
    /// Both with a running number, to merge them in the order they came.
    telemetry: VecDeque<(u64, Record)>,
    durable: VecDeque<(u64, Item)>,
    next: u64,
    telemetry_bytes: usize,
    ended: bool,
    dropped: u64,
    /// Drops by channel that were not told yet.
    untold: BTreeMap<Arc<str>, u64>,
    notices: VecDeque<EventNotice>,
    progress: Progress,
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
    pub fn push_telemetry(&self, record: Record) {
        let mut state = self.lock();
        if state.ended {
            return state.drop_one(&record.channel);
        }
        state.telemetry_bytes += record.json.len() + OVERHEAD_BYTES;
        let number = state.number();
        state.telemetry.push_back((number, record));
        while state.telemetry_bytes > TELEMETRY_BYTES_MAX
            && let Some((_, oldest)) = state.telemetry.pop_front()
        {
            state.telemetry_bytes -= oldest.json.len() + OVERHEAD_BYTES;
            state.drop_one(&oldest.channel);
        }
        if state.telemetry_bytes >= COMMIT_BYTES {
            self.wake.notify_one();
        }
    }

    pub fn push_durable(&self, item: Item) -> Result<(), RecorderError> {
        let mut state = self.lock();
        if state.ended {
            return Err(RecorderError::Ended);
        }
        if state.durable.len() >= DURABLE_MAX {
            return Err(RecorderError::QueueFull);
        }
        let number = state.number();
        state.durable.push_back((number, item));
        self.wake.notify_one();
        Ok(())
    }

    /// Waits until a batch is due and takes it. `retry`: the disk has just refused one, and is tried
    /// again after a period or with the next durable message, not with every bit of telemetry.
    pub fn take_batch(&self, retry: bool) -> Batch {
        let period = Duration::from_millis(COMMIT_MS);
        let waits = |s: &mut State| {
            !s.ended && s.durable.is_empty() && (retry || s.telemetry_bytes < COMMIT_BYTES)
        };
        let guard = self.wake.wait_timeout_while(self.lock(), period, waits);
        let mut state = guard.unwrap_or_else(PoisonError::into_inner).0;
        Batch { items: state.drain(), last: state.ended }
    }

    pub fn end(&self) {
        self.lock().ended = true;
        self.wake.notify_one();
    }

    /// Counts messages that the writer could not write.
    pub fn drop_all<'a>(&self, channels: impl Iterator<Item = &'a Arc<str>>) {
        let mut state = self.lock();
        channels.for_each(|channel| state.drop_one(channel));
    }

    pub fn notice(&self, level: EventLevel, text: String) {
        self.lock().notice(level, text);
    }

    pub fn take_notices(&self) -> Vec<EventNotice> {
        let mut state = self.lock();
        for (channel, dropped) in std::mem::take(&mut state.untold) {
            let text = format!("the disk was too slow: {dropped} messages of {channel} not logged");
            state.notice(EventLevel::Warning, text);
        }
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

    fn drop_one(&mut self, channel: &Arc<str>) {
        self.dropped += 1;
        *self.untold.entry(channel.clone()).or_default() += 1;
    }

    fn notice(&mut self, level: EventLevel, text: String) {
        if self.notices.len() == NOTICES_MAX {
            self.notices.pop_front();
        }
        self.notices.push_back(EventNotice { level, text, who: "recorder".into() });
    }

    fn drain(&mut self) -> Vec<Item> {
        self.telemetry_bytes = 0;
        let mut telemetry = std::mem::take(&mut self.telemetry).into_iter().peekable();
        let mut durable = std::mem::take(&mut self.durable).into_iter().peekable();
        let mut items = Vec::with_capacity(telemetry.len() + durable.len());
        loop {
            let first = match (telemetry.peek(), durable.peek()) {
                (Some((t, _)), Some((d, _))) => t < d,
                (Some(_), None) => true,
                (None, Some(_)) => false,
                (None, None) => return items,
            };
            if first {
                items.extend(telemetry.next().map(|(_, record)| Item { record, written: None }));
            } else {
                items.extend(durable.next().map(|(_, item)| item));
            }
        }
    }
}
