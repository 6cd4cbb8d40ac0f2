//! Reading any MCAP file, whole or torn, honest or hostile, within stated limits.
//!
//! Every chunk is checked against its CRC before any of its messages is handed out. A bad chunk is
//! passed over and told; damage to the frame of the file (a torn tail, a length beyond the limit)
//! ends the reading with all that came before it, and is told. A file of which nothing can be read
//! for damage is an error. Nothing here panics or takes more memory than the limits say, whatever
//! the bytes.

use std::fs::File;
use std::io::{BufReader, Read};
use std::path::Path;
use std::sync::Arc;

use bytes::Bytes;
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};
use wire::time::Timestamp;

mod chunk;

/// Limits of a reading.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// Longest record, and largest chunk, compressed or not (bytes).
    pub record_bytes: usize,
    /// Largest growth of a chunk by decompression; chunks up to 4 MiB are free of it.
    pub ratio: u64,
    /// Most bytes of messages, each counted with 96 bytes beside its content.
    pub total_bytes: usize,
}

impl Default for Limits {
    fn default() -> Self {
        Limits { record_bytes: 64 << 20, ratio: 200, total_bytes: 512 << 20 }
    }
}

/// A message of a log.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LogMessage {
    /// Its channel.
    pub channel: Arc<str>,
    /// How its content is encoded: `json` in our logs.
    pub encoding: Arc<str>,
    /// Its number on the channel.
    pub sequence: u32,
    /// When it came to the ground.
    pub log_time: Timestamp,
    /// When it was true, on board.
    pub publish_time: Timestamp,
    /// The content, byte for byte as recorded.
    pub data: Bytes,
}

/// What is wrong with a file, and where (byte offset of the record).
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Damage {
    /// Not the magic bytes of an MCAP file.
    #[error("this is not an MCAP file")]
    NotMcap,
    /// The file ends within a record, or without its end: the writer was cut off.
    #[error("the file ends at byte {at} before its end; what stands before that is complete")]
    Torn {
        /// Where the incomplete record begins.
        at: u64,
    },
    /// A record longer than the limit.
    #[error("the record at byte {at} says it is {length} bytes long, beyond the limit")]
    RecordTooLong {
        /// Where it begins.
        at: u64,
        /// What it says (bytes).
        length: u64,
    },
    /// A chunk larger than the limit once decompressed.
    #[error("the chunk at byte {at} says it holds {length} bytes, beyond the limit")]
    ChunkTooLarge {
        /// Where it begins.
        at: u64,
        /// What it says (bytes).
        length: u64,
    },
    /// A chunk that grows suspiciously by decompression.
    #[error("the chunk at byte {at} grows {ratio} times by decompression, beyond the limit")]
    ChunkRatio {
        /// Where it begins.
        at: u64,
        /// Growth as it says.
        ratio: u64,
    },
    /// A chunk whose content is not what was written.
    #[error("the chunk at byte {at} is damaged and was passed over: {reason}")]
    BadChunk {
        /// Where it begins.
        at: u64,
        /// What is wrong.
        reason: String,
    },
    /// A record that cannot be understood.
    #[error("the record at byte {at} cannot be understood: {reason}")]
    BadRecord {
        /// Where it begins.
        at: u64,
        /// What is wrong.
        reason: String,
    },
    /// The file's own checksum of all its data does not agree with the data.
    #[error("the checksum of the whole file does not agree with its content")]
    BadFileCrc,
}

impl Damage {
    /// A stable word for programs.
    pub fn code(&self) -> &'static str {
        match self {
            Damage::NotMcap => "log_not_mcap",
            Damage::Torn { .. } => "log_torn",
            Damage::RecordTooLong { .. } => "log_record_too_long",
            Damage::ChunkTooLarge { .. } => "log_chunk_too_large",
            Damage::ChunkRatio { .. } => "log_chunk_ratio",
            Damage::BadChunk { .. } => "log_chunk_damaged",
            Damage::BadRecord { .. } => "log_record_damaged",
            Damage::BadFileCrc => "log_checksum",
        }
    }
}

/// Why a log gives nothing.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// The file cannot be read.
    #[error("the log cannot be read: {0}")]
    Io(#[from] std::io::Error),
    /// Damage before the first message.
    #[error(transparent)]
    Damaged(#[from] Damage),
    /// More than the limit.
    #[error("the log holds more than {limit} bytes of messages; take a clip of it")]
    TooLarge {
        /// The limit (bytes).
        limit: usize,
    },
    /// No log of that name.
    #[error("there is no log {id:?}")]
    Unknown {
        /// The beginning of the name.
        id: String,
    },
}

impl ReadError {
    /// A stable word for programs.
    pub fn code(&self) -> &'static str {
        match self {
            ReadError::Io(_) => "log_io",
            ReadError::Damaged(damage) => damage.code(),
            ReadError::TooLarge { .. } => "log_too_large",
            ReadError::Unknown { .. } => "log_unknown",
        }
    }
}

/// What was read of a log.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct LogContent {
    /// The messages, in the order of the file.
    pub messages: Vec<LogMessage>,
    /// What is wrong with the file, in the order it was met. Empty for a sound one.
    pub damage: Vec<Damage>,
}

/// Reads a whole file.
pub fn read_file(path: &Path, limits: Limits) -> Result<LogContent, ReadError> {
    read_log(BufReader::with_capacity(256 * 1024, File::open(path)?), limits)
}

/// Reads a whole log from anything that gives bytes.
pub fn read_log(source: impl Read, limits: Limits) -> Result<LogContent, ReadError> {
    let mut content = LogContent::default();
    let mut bytes = 0_usize;
    let damage = scan(source, limits, |message| {
        bytes += message.data.len() + 96;
        content.messages.push(message);
        bytes <= limits.total_bytes
    })?;
    if bytes > limits.total_bytes {
        return Err(ReadError::TooLarge { limit: limits.total_bytes });
    }
    if content.messages.is_empty()
        && let Some(first) = damage.iter().find(|d| !matches!(d, Damage::Torn { .. }))
    {
        return Err(first.clone().into());
    }
    content.damage = damage;
    Ok(content)
}

/// Gives each message to `take` until that answers false; then what is wrong with the file.
pub fn scan(
    mut source: impl Read,
    limits: Limits,
    mut take: impl FnMut(LogMessage) -> bool,
) -> Result<Vec<Damage>, ReadError> {
    let options = LinearReaderOptions::default()
        .with_emit_chunks(true)
        .with_record_length_limit(limits.record_bytes)
        .with_validate_data_section_crc(true);
    let mut reader = LinearReader::new_with_options(options);
    let mut records = chunk::Records::new(limits);
    // The magic bytes stand before the first record.
    let mut at = mcap::MAGIC.len() as u64;
    while let Some(event) = reader.next_event() {
        match event {
            Ok(LinearReadEvent::ReadRequest(wanted)) => {
                let read = source.read(reader.insert(wanted.min(limits.record_bytes + 9)))?;
                reader.notify_read(read);
            }
            Ok(LinearReadEvent::Record { opcode, data }) => {
                let fatal = records.take(opcode, data, at);
                for message in records.messages.drain(..) {
                    if !take(message) {
                        return Ok(records.damage);
                    }
                }
                if fatal {
                    return Ok(records.damage);
                }
                at += 9 + data.len() as u64;
            }
            Err(error) => {
                records.damage.push(frame_damage(error, at));
                return Ok(records.damage);
            }
        }
    }
    Ok(records.damage)
}

fn frame_damage(error: mcap::McapError, at: u64) -> Damage {
    use mcap::McapError;
    match error {
        McapError::BadMagic if at == mcap::MAGIC.len() as u64 => Damage::NotMcap,
        McapError::UnexpectedEof | McapError::BadMagic => Damage::Torn { at },
        McapError::RecordTooLarge { len, .. } => Damage::RecordTooLong { at, length: len },
        McapError::BadDataCrc { .. } => Damage::BadFileCrc,
        other => Damage::BadRecord { at, reason: other.to_string() },
    }
}
