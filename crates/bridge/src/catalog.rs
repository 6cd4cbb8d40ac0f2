//! The logs of a folder.
//!
//! Names from requests are never joined to a path unless they are log ids: `[A-Za-z0-9_-]`, 1 to 64
//! characters.

use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use mcap::records::op;
use mcap::sans_io::{SummaryReadEvent, SummaryReader, SummaryReaderOptions};
use wire::resources::LogInfo;
use wire::time::Timestamp;

use crate::reader::{self, Limits, LogContent, ReadError};

/// Most records looked at in a log without a summary; the counts stop there.
const SCAN_RECORDS: u64 = 2_000_000;
/// Longest record of a summary (bytes).
const SUMMARY_RECORD_BYTES: usize = 64 << 20;

/// True if `id` is a log id.
pub fn is_log_id(id: &str) -> bool {
    let plain = |b: u8| b.is_ascii_alphanumeric() || b == b'_' || b == b'-';
    (1..=64).contains(&id.len()) && id.bytes().all(plain)
}

/// The file of a log, if there is one.
pub fn log_path(dir: &Path, id: &str) -> Result<PathBuf, ReadError> {
    let unknown = || ReadError::Unknown { id: id.chars().take(64).collect() };
    if !is_log_id(id) {
        return Err(unknown());
    }
    let path = dir.join(format!("{id}.mcap"));
    match std::fs::symlink_metadata(&path) {
        Ok(meta) if meta.is_file() => Ok(path),
        _ => Err(unknown()),
    }
}

/// Reads a log of the folder whole, see [`reader::read_log`].
pub fn read_log(dir: &Path, id: &str, limits: Limits) -> Result<LogContent, ReadError> {
    reader::read_file(&log_path(dir, id)?, limits)
}

/// The logs of the folder, newest first; `open` is the one being written, as the recorder has it.
/// A file that cannot be read is listed with no messages. A missing folder has no logs.
pub fn list_logs(dir: &Path, open: Option<&LogInfo>) -> io::Result<Vec<LogInfo>> {
    let entries = match std::fs::read_dir(dir) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        entries => entries?,
    };
    let mut logs = Vec::new();
    for entry in entries {
        let name = entry?.file_name();
        let Some(id) = name.to_str().and_then(|name| name.strip_suffix(".mcap")) else { continue };
        match open.filter(|open| open.id == id && open.open) {
            Some(open) => logs.push(open.clone()),
            None => logs.extend(log_info(dir, id).ok()),
        }
    }
    logs.sort_by(|a, b| (b.start, &b.id).cmp(&(a.start, &a.id)));
    Ok(logs)
}

/// What the list says of one log: from the summary, or from a walk along its chunks. Where a log is
/// torn, the count may lack the messages of the last chunk.
pub fn log_info(dir: &Path, id: &str) -> Result<LogInfo, ReadError> {
    let path = log_path(dir, id)?;
    let mut file = File::open(path)?;
    let size = file.metadata()?.len();
    let found = match summary_extent(&mut file, size) {
        Some(extent) => extent,
        None => {
            file.seek(SeekFrom::Start(0))?;
            walk_extent(BufReader::new(file), size)?
        }
    };
    let Extent { start, end, messages } = found;
    let time = |t: u64| (messages > 0).then_some(Timestamp(t));
    let (start, end) = (time(start), time(end));
    Ok(LogInfo { id: id.into(), size, start, end, messages, open: false })
}

struct Extent {
    start: u64,
    end: u64,
    messages: u64,
}

fn summary_extent(file: &mut File, size: u64) -> Option<Extent> {
    let options = SummaryReaderOptions::default()
        .with_file_size(size)
        .with_record_length_limit(SUMMARY_RECORD_BYTES);
    let mut reader = SummaryReader::new_with_options(options);
    while let Some(event) = reader.next_event() {
        match event.ok()? {
            SummaryReadEvent::ReadRequest(wanted) => {
                let read = file.read(reader.insert(wanted)).ok()?;
                reader.notify_read(read);
            }
            SummaryReadEvent::SeekRequest(to) => reader.notify_seeked(file.seek(to).ok()?),
        }
    }
    let stats = reader.finish()?.stats?;
    let (start, end) = (stats.message_start_time, stats.message_end_time);
    Some(Extent { start, end, messages: stats.message_count })
}

/// Walks from record to record without decompressing: times from the chunks' headers, counts from
/// the message indexes behind them. Ends where the file is torn.
fn walk_extent(mut file: BufReader<File>, size: u64) -> io::Result<Extent> {
    let mut extent = Extent { start: u64::MAX, end: 0, messages: 0 };
    let mut at = mcap::MAGIC.len() as u64;
    file.seek(SeekFrom::Start(at))?;
    for _ in 0..SCAN_RECORDS {
        let mut frame = [0; 9];
        if file.read_exact(&mut frame).is_err() {
            break;
        }
        let length = u64::from_le_bytes(frame[1..].try_into().unwrap_or_default());
        let Some(next) = at.checked_add(9).and_then(|n| n.checked_add(length)) else { break };
        if next > size || frame[0] == op::DATA_END {
            break;
        }
        if frame[0] == op::CHUNK && length >= 16 {
            let mut times = [0; 16];
            file.read_exact(&mut times)?;
            let (start, end) = times.split_at(8);
            let time = |bytes: &[u8]| u64::from_le_bytes(bytes.try_into().unwrap_or_default());
            extent.start = extent.start.min(time(start));
            extent.end = extent.end.max(time(end));
        } else if frame[0] == op::MESSAGE_INDEX {
            extent.messages += length.saturating_sub(6) / 16;
        }
        let read = file.stream_position()?;
        file.seek_relative(i64::try_from(next - read).unwrap_or(i64::MAX))?;
        at = next;
    }
    Ok(extent)
}
