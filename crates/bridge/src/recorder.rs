//! The flight recorder: one thread that owns the log file.
//!
//! A batch of messages becomes one chunk, flushed and synced: every 250 ms, or as soon as 256 kB
//! wait, or at once when a durable message waits. So a crash or power cut costs at most 250 ms of
//! telemetry, and nothing that was acknowledged. The file is at all times a clean prefix that stock
//! readers take (buffered chunks: the file never shows a chunk that is not whole).
//!
//! The first error of a file is final for that file, a failed sync above all: the batch goes to a
//! new file, so that a message may stand in two files but never in none. While no file can be
//! written, telemetry is dropped and counted, durable messages are refused to whoever waits for
//! them but kept, and the disk is tried again every 250 ms and with every durable message.
//!
//! Bounds: telemetry waiting for the disk is limited to 32 MiB (the oldest gives way, counted and
//! told as an event); durable messages to 16 384, beyond which they are refused.

mod queue;
mod storage;
mod writer;

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::thread::JoinHandle;

use bytes::Bytes;
use tokio::sync::{Notify, oneshot};
use wire::live::EventNotice;
use wire::resources::LogInfo;
use wire::time::Timestamp;

use queue::{Item, Queue};
pub use storage::{LogFile, LogFolder, Storage};

/// A batch is written at the latest after this time (ms).
pub const COMMIT_MS: u64 = 250;
/// A batch is written when this many bytes wait.
pub const COMMIT_BYTES: usize = 256 * 1024;
/// Most bytes of telemetry that wait for the disk.
pub const TELEMETRY_BYTES_MAX: usize = 32 * 1024 * 1024;
/// Most durable messages that wait for the disk.
pub const DURABLE_MAX: usize = 16 * 1024;

/// One message for the log.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Record {
    /// Its channel.
    pub channel: Arc<str>,
    /// Its number on that channel; the log keeps the lower 32 bits.
    pub sequence: u64,
    /// When it came to the ground.
    pub log_time: Timestamp,
    /// When it was true: on board for what the rover sent.
    pub publish_time: Timestamp,
    /// The message, as JSON text.
    pub json: Bytes,
}

/// The schema of a channel, for readers of the log.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ChannelSchema {
    /// The channel.
    pub channel: String,
    /// Name of the schema.
    pub name: String,
    /// The schema itself: JSON Schema, as text.
    pub schema_json: String,
}

/// What a recorder is started with.
#[derive(Debug, Clone, Default)]
pub struct RecorderOptions {
    /// The time that names the file.
    pub start: Timestamp,
    /// Kept in the file as metadata record `footfall`.
    pub metadata: BTreeMap<String, String>,
    /// Schemas by channel. A channel without one is written without.
    pub schemas: Vec<ChannelSchema>,
}

/// Why a recorder does not start, or a message is not safe.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum RecorderError {
    /// No log file can be made.
    #[error("no log file can be made: {0}")]
    Open(String),
    /// The message did not come to the disk.
    #[error("the log cannot be written: {0}")]
    Write(String),
    /// Too many durable messages wait.
    #[error("{DURABLE_MAX} messages wait for the disk already")]
    QueueFull,
    /// The recorder has ended.
    #[error("the recorder has ended")]
    Ended,
}

/// The recorder as it is.
#[derive(Debug, Clone, PartialEq)]
pub struct RecorderStatus {
    /// The file being written, with what is safe on the disk.
    pub log: LogInfo,
    /// Batches synced, over all files.
    pub commits: u64,
    /// Messages synced, over all files.
    pub messages: u64,
    /// Messages dropped, over all files.
    pub dropped: u64,
    /// Files begun.
    pub segments: u64,
    /// Why the disk takes nothing at present.
    pub error: Option<String>,
}

/// Completes once a message is on the disk.
#[derive(Debug)]
pub struct Written(oneshot::Receiver<Result<(), RecorderError>>);

impl Written {
    /// Waits until the message is synced, or is known not to be.
    pub async fn wait(self) -> Result<(), RecorderError> {
        self.0.await.unwrap_or(Err(RecorderError::Ended))
    }

    /// As [`Written::wait`], blocking the thread; for tools and tests.
    pub fn wait_blocking(self) -> Result<(), RecorderError> {
        self.0.blocking_recv().unwrap_or(Err(RecorderError::Ended))
    }

    /// The outcome, if there is one yet.
    pub fn poll(&mut self) -> Option<Result<(), RecorderError>> {
        match self.0.try_recv() {
            Ok(outcome) => Some(outcome),
            Err(oneshot::error::TryRecvError::Empty) => None,
            Err(oneshot::error::TryRecvError::Closed) => Some(Err(RecorderError::Ended)),
        }
    }
}

/// A running recorder. Dropping it writes what waits and closes the file.
#[derive(Debug)]
pub struct Recorder {
    queue: Arc<Queue>,
    thread: Option<JoinHandle<()>>,
}

impl Recorder {
    /// Starts a log file in the folder `dir`, which is made if need be.
    pub fn start(dir: &Path, options: RecorderOptions) -> Result<Recorder, RecorderError> {
        Recorder::start_on(Box::new(LogFolder::new(dir)), options)
    }

    /// As [`Recorder::start`], on another kind of storage.
    pub fn start_on(
        storage: Box<dyn Storage>,
        options: RecorderOptions,
    ) -> Result<Recorder, RecorderError> {
        let queue = Arc::new(Queue::default());
        let writer = writer::Writer::open(storage, options, queue.clone())
            .map_err(|e| RecorderError::Open(e.to_string()))?;
        let thread = std::thread::Builder::new()
            .name("flight-recorder".into())
            .spawn(move || writer.run())
            .map_err(|e| RecorderError::Open(e.to_string()))?;
        Ok(Recorder { queue, thread: Some(thread) })
    }

    /// Records telemetry: never waits, and may be dropped when the disk is too slow for 32 MiB.
    pub fn record(&self, record: Record) {
        self.queue.push_telemetry(record);
    }

    /// Records what must not be lost; the answer completes once it is synced.
    pub fn record_durable(&self, record: Record) -> Result<Written, RecorderError> {
        let (sender, receiver) = oneshot::channel();
        self.queue.push_durable(Item { record, written: Some(sender) })?;
        Ok(Written(receiver))
    }

    /// Told whenever a durable message has been synced or refused.
    pub fn committed(&self) -> Arc<Notify> {
        self.queue.committed.clone()
    }

    /// What the recorder has to tell since the last call: drops, a new file, a disk that takes
    /// nothing. Whoever owns the `event` channel publishes it; what nobody took is written to the
    /// log at the end.
    pub fn take_notices(&self) -> Vec<EventNotice> {
        self.queue.take_notices()
    }

    /// The state of the recorder.
    pub fn status(&self) -> RecorderStatus {
        self.queue.status()
    }

    /// Writes what waits, the summary and the end of the file, and syncs it. Blocks. What comes
    /// later is refused, or dropped and counted.
    pub fn finish(&mut self) -> Result<RecorderStatus, RecorderError> {
        self.stop();
        let status = self.status();
        match &status.error {
            Some(error) => Err(RecorderError::Write(error.clone())),
            None => Ok(status),
        }
    }

    fn stop(&mut self) {
        self.queue.end();
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
        {
            tracing::error!("the flight recorder's thread has panicked");
        }
    }
}

impl Drop for Recorder {
    fn drop(&mut self) {
        self.stop();
    }
}
