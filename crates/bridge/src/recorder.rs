//! The flight recorder: one thread that owns the log file.
//!
//! A batch of messages becomes one chunk, flushed and synced: every 250 ms, or as soon as 256 kB
//! wait, or at once when a durable message waits. So a crash or power cut costs at most 250 ms of
//! telemetry, and nothing that was acknowledged. The file is at all times a clean prefix that stock
//! readers take (buffered chunks: the file never shows a chunk that is not whole).
//!
//! A log is a folder of segments ([`crate::segments`]); a new one begins every 256 MiB or 15 min, or
//! when asked for. What is no longer written is sealed aside ([`crate::seal`]); what a crash left is
//! recovered and sealed when the next recorder starts ([`crate::recover`]).
//!
//! The first error of a segment is final for it, a failed sync above all: the batch goes to a new
//! one, which says how much of the old one counts. While no segment can be written, telemetry is
//! dropped and counted, durable messages are refused to whoever waits for them but kept, and the
//! disk is tried again every 250 ms and with every durable message.
//!
//! **Full disk**: below 10 % (at most 2 GiB) free it is told, below 5 % (1 GiB) bulk is no longer
//! logged, below 1 % (256 MiB) telemetry neither. A reserve of 64 MiB is held back, and let go when
//! the disk takes nothing more, so that commands and events are logged on. In that state
//! [`RecorderStatus::error`] names the full disk, for whoever must not begin a motion then; all goes
//! on by itself once there is room.
//!
//! **Bounds**, by class: durable messages, 16 384 wait, more are refused; telemetry, 32 MiB wait, the
//! oldest gives way; bulk, 8 MiB wait, the oldest gives way. A message has at most 32 MiB. Whatever
//! gives way is counted, told as an event, and stands in the log as a message on `log/gap`.

mod queue;
mod room;
mod sealer;
mod segment;
mod storage;
mod writer;

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::thread::JoinHandle;

use bytes::Bytes;
use tokio::sync::{Notify, oneshot};
use wire::live::{EventLevel, EventNotice};
use wire::resources::LogInfo;
use wire::time::Timestamp;

use queue::{Class, Item, Queue};
pub use storage::{LogFile, LogFolder, LogSource, Space, Storage};

use crate::recover;

/// A batch is written at the latest after this time (ms).
pub const COMMIT_MS: u64 = 250;
/// A batch is written when this many bytes wait.
pub const COMMIT_BYTES: usize = 256 * 1024;
/// Most bytes of telemetry that wait for the disk.
pub const TELEMETRY_BYTES_MAX: usize = 32 * 1024 * 1024;
/// Most bytes of bulk that wait for the disk.
pub const BULK_BYTES_MAX: usize = 8 * 1024 * 1024;
/// Largest message (bytes).
pub const RECORD_BYTES_MAX: usize = 32 * 1024 * 1024;
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
    /// The message: JSON text, or protobuf on a channel that is one of it.
    pub data: Bytes,
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

/// A channel whose messages are protobuf.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ProtobufChannel {
    /// The channel.
    pub channel: String,
    /// Full name of the messages' type.
    pub schema_name: String,
    /// A `FileDescriptorSet` with that type and all that it uses.
    pub descriptors: Bytes,
}

/// What a recorder is started with.
#[derive(Debug, Clone)]
pub struct RecorderOptions {
    /// The time that names the log.
    pub start: Timestamp,
    /// Kept in each segment as metadata record `footfall`.
    pub metadata: BTreeMap<String, String>,
    /// Schemas by channel. A channel without one is JSON, and written without.
    pub schemas: Vec<ChannelSchema>,
    /// Channels whose messages are not JSON.
    pub protobuf: Vec<ProtobufChannel>,
    /// A segment ends at this size (bytes) …
    pub segment_bytes: u64,
    /// … or after this time (s), by the times of its messages.
    pub segment_s: f64,
    /// Room held back for commands and events on a full disk (bytes).
    pub reserve_bytes: u64,
    /// Seal by a thread of its own; else between two batches, for tests that count every call.
    pub seal_aside: bool,
}

impl Default for RecorderOptions {
    fn default() -> Self {
        RecorderOptions {
            start: Timestamp(0),
            metadata: BTreeMap::new(),
            schemas: Vec::new(),
            protobuf: Vec::new(),
            segment_bytes: 256 << 20,
            segment_s: 900.0,
            reserve_bytes: 64 << 20,
            seal_aside: true,
        }
    }
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
    /// The message is too large.
    #[error("a message of {bytes} bytes is larger than the log takes, {RECORD_BYTES_MAX}")]
    TooLarge {
        /// Its size.
        bytes: usize,
    },
    /// The recorder has ended.
    #[error("the recorder has ended")]
    Ended,
}

/// The recorder as it is.
#[derive(Debug, Clone, PartialEq)]
pub struct RecorderStatus {
    /// The log being written, with what is safe on the disk.
    pub log: LogInfo,
    /// Batches synced.
    pub commits: u64,
    /// Messages synced.
    pub messages: u64,
    /// Messages dropped.
    pub dropped: u64,
    /// Segments begun.
    pub segments: u64,
    /// Why the disk does not take everything at present; no motion should begin then.
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

/// A running recorder. Dropping it writes what waits and seals the log.
#[derive(Debug)]
pub struct Recorder {
    queue: Arc<Queue>,
    thread: Option<JoinHandle<()>>,
}

impl Recorder {
    /// Recovers what a crash has left in the folder `dir`, which is made if need be, and starts a
    /// new log there.
    pub fn start(dir: &Path, options: RecorderOptions) -> Result<Recorder, RecorderError> {
        Recorder::start_on(Box::new(LogFolder::new(dir)), options)
    }

    /// As [`Recorder::start`], on another kind of storage.
    pub fn start_on(
        storage: Box<dyn Storage>,
        options: RecorderOptions,
    ) -> Result<Recorder, RecorderError> {
        let storage: Arc<dyn Storage> = storage.into();
        let queue = Arc::new(Queue::default());
        let open_error = |e: std::io::Error| RecorderError::Open(e.to_string());
        let recovery = recover::recover(&*storage).map_err(open_error)?;
        for recovered in &recovery.segments {
            let level = match recovered.outcome {
                Ok(_) if recovered.is_lossless() => EventLevel::Info,
                Ok(_) => EventLevel::Warning,
                Err(_) => EventLevel::Critical,
            };
            queue.notice(level, recovered.text());
        }
        let writer = writer::Writer::open(storage, options, queue.clone(), recovery.head)
            .map_err(open_error)?;
        let thread = std::thread::Builder::new()
            .name("flight-recorder".into())
            .spawn(move || writer.run())
            .map_err(open_error)?;
        Ok(Recorder { queue, thread: Some(thread) })
    }

    /// Records telemetry: never waits, and may be dropped when the disk is too slow for 32 MiB.
    pub fn record(&self, record: Record) {
        self.queue.push(record, Class::Telemetry);
    }

    /// Records images and the like, which give way before telemetry does.
    pub fn record_bulk(&self, record: Record) {
        self.queue.push(record, Class::Bulk);
    }

    /// Asks for a new segment, as when a part of the mission is over.
    pub fn rotate(&self) {
        self.queue.rotate();
    }

    /// Records what must not be lost; the answer completes once it is synced.
    pub fn record_durable(&self, record: Record) -> Result<Written, RecorderError> {
        let (sender, receiver) = oneshot::channel();
        self.queue.push_durable(Item { record, class: Class::Durable, written: Some(sender) })?;
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

    /// True while the disk does not take everything, as `error` of the status tells why.
    pub fn fails(&self) -> bool {
        self.queue.fails()
    }

    /// Writes what waits and seals the log. Blocks. What comes later is refused, or dropped and counted.
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
