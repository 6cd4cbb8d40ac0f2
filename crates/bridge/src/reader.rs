//! Reading any MCAP file, whole or torn, honest or hostile, within stated limits.
//!
//! Every chunk is checked against its CRC before any of its messages is handed out. A bad chunk is
//! passed over and told. Where the frame of the file is damaged (a torn tail, a length beyond the
//! limit, garbage), reading goes on at the next whole chunk whose CRC agrees, and that is told. A
//! file of which nothing can be read for damage is an error. Nothing here panics or takes more
//! memory than the limits say, whatever the bytes.

use std::fs::File;
use std::io::{BufReader, Read};
use std::path::Path;
use std::sync::Arc;

use bytes::Bytes;
use mcap::records::op;
use wire::time::Timestamp;

pub(crate) mod chunk;
pub(crate) mod fields;
pub(crate) mod frames;
mod indexed;
mod items;

pub use indexed::{IndexedLog, Piece};
pub use items::{ChannelDef, Item, SchemaDef};

use fields::{ChunkHeader, Fields};
use frames::Window;
use items::Items;

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
    /// What stands behind the messages, the index and the summary, is damaged.
    #[error("the summary of the file is damaged at byte {at}: {reason}")]
    BadSummary {
        /// Where.
        at: u64,
        /// What is wrong.
        reason: String,
    },
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
            Damage::BadSummary { .. } => "log_summary_damaged",
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
    /// The log is more than one file.
    #[error("the log {id} has {segments} segments; take a clip of it")]
    Segments {
        /// The log.
        id: String,
        /// Its segments.
        segments: usize,
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
            ReadError::TooLarge { .. } | ReadError::Segments { .. } => "log_too_large",
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
    source: impl Read,
    limits: Limits,
    mut take: impl FnMut(LogMessage) -> bool,
) -> Result<Vec<Damage>, ReadError> {
    scan_items(source, limits, |item| match item {
        Item::Message(_, message) => take(message),
        _ => true,
    })
}

/// Gives everything that the log holds to `take` until that answers false; then what is wrong with
/// the file.
pub fn scan_items(
    source: impl Read,
    limits: Limits,
    mut take: impl FnMut(Item) -> bool,
) -> Result<Vec<Damage>, ReadError> {
    let taken = scan_places(source, limits, |_, _, mut items| Iterator::all(&mut items, &mut take));
    taken.map(|(_, damage)| damage)
}

/// Ends of the data that a scan goes on behind, where messages follow: damage makes few of them.
const ENDS_MAX: usize = 64;

/// As [`scan_items`], record by record of the file: where it is, its kind, and what it holds.
fn scan_places(
    source: impl Read,
    limits: Limits,
    mut take: impl FnMut(std::ops::Range<u64>, u8, &mut dyn Iterator<Item = Item>) -> bool,
) -> Result<(Items, Vec<Damage>), ReadError> {
    let mut window = Window::new(source);
    let mut items = Items::new(limits);
    if !window.fill(mcap::MAGIC.len())? {
        let torn = mcap::MAGIC.starts_with(window.rest());
        items.damage.push(if torn { Damage::Torn { at: 0 } } else { Damage::NotMcap });
        return Ok(done(items));
    }
    let mut lost = !window.rest().starts_with(mcap::MAGIC);
    if lost {
        items.damage.push(Damage::NotMcap);
    } else {
        window.pass(mcap::MAGIC.len());
    }
    let sound = |header: &ChunkHeader<'_>| chunk::content(header, 0, limits).is_ok();
    let mut ends = 0;
    loop {
        let at = window.at();
        if lost {
            if !window.find_chunk(limits.record_bytes, sound)? {
                return Ok(done(items));
            }
            lost = false;
            continue;
        }
        let whole = window.fill(9)?;
        let Some((opcode, length)) = window.frame().filter(|_| whole) else {
            items.damage.push(Damage::Torn { at });
            return Ok(done(items));
        };
        let Some(size) = usize::try_from(length).ok().filter(|&n| n <= limits.record_bytes) else {
            items.damage.push(Damage::RecordTooLong { at, length });
            lost = true;
            continue;
        };
        if !window.fill(9 + size)? {
            items.damage.push(Damage::Torn { at });
            lost = true;
            continue;
        }
        let data = &window.rest()[9..9 + size];
        if opcode == op::DATA_END && size >= 4 {
            let said = Fields(data).u32().unwrap_or_default();
            if said != 0 && said != window.crc() {
                items.damage.push(Damage::BadFileCrc);
            }
            window.pass(9 + size);
            let (damage, more) = summary_damage(&mut window, limits)?;
            items.damage.extend(damage);
            ends += 1;
            if more && ends < ENDS_MAX {
                // An index of messages is one flipped bit away from the end of the data.
                continue;
            }
            return Ok(done(items));
        }
        let mut trusted = items.take(opcode, data, at);
        let mut out = std::mem::take(&mut items.out);
        let went_on = take(at..at + 9 + size as u64, opcode, &mut out.drain(..));
        items.out = out;
        if !went_on {
            return Ok(done(items));
        }
        let surplus = std::mem::take(&mut items.surplus);
        if surplus > 0 && !window.is_padding(9 + size, surplus, limits.record_bytes)? {
            // A length that grew by damage swallows what stands behind the record.
            let reason = "it is longer than its fields, and what follows does not agree".into();
            items.damage.push(Damage::BadRecord { at, reason });
            trusted = false;
        }
        if trusted {
            window.pass(9 + size);
        } else {
            // Its length may be what was hit: what stands within it may be good.
            lost = true;
        }
    }
}

fn done(mut items: Items) -> (Items, Vec<Damage>) {
    let damage = std::mem::take(&mut items.damage);
    (items, damage)
}

/// What is wrong from the end of the data to the end of the file; true if the window is at messages,
/// so that it was not the end.
fn summary_damage(
    window: &mut Window<impl Read>,
    limits: Limits,
) -> Result<(Option<Damage>, bool), ReadError> {
    window.reset_crc();
    loop {
        let at = window.at();
        let bad = |reason: &str| Some(Damage::BadSummary { at, reason: reason.into() });
        if !window.fill(9)? {
            return Ok((Some(Damage::Torn { at }), false));
        }
        let Some((opcode, length)) = window.frame() else {
            return Ok((Some(Damage::Torn { at }), false));
        };
        let Some(size) = usize::try_from(length).ok().filter(|&n| n <= limits.record_bytes) else {
            return Ok((Some(Damage::RecordTooLong { at, length }), false));
        };
        if !window.fill(9 + size)? {
            return Ok((Some(Damage::Torn { at }), false));
        }
        if opcode != op::FOOTER {
            if opcode == op::CHUNK || opcode == op::MESSAGE {
                return Ok((bad("messages stand behind the end of the data"), true));
            }
            window.pass(9 + size);
            continue;
        }
        // The checksum covers the footer up to itself.
        window.pass((9 + 16).min(9 + size));
        let crc = window.crc();
        if size != 20 || !window.fill(4 + mcap::MAGIC.len())? {
            return Ok((bad("the footer is not whole"), false));
        }
        let said = Fields(window.rest()).u32().unwrap_or_default();
        if said != 0 && said != crc {
            return Ok((bad("its checksum does not agree"), false));
        }
        window.pass(4);
        if !window.rest().starts_with(mcap::MAGIC) {
            return Ok((bad("the magic bytes of the end are others"), false));
        }
        window.pass(mcap::MAGIC.len());
        if window.fill(1)? {
            let at = window.at();
            let reason = "there are bytes behind the end of the file".into();
            return Ok((Some(Damage::BadSummary { at, reason }), false));
        }
        return Ok((None, false));
    }
}
