//! The logs of a folder.
//!
//! Names from requests are never joined to a path unless they are log ids: `[A-Za-z0-9_-]`, 1 to 64
//! characters.

use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use mcap::records::op;
use wire::resources::LogInfo;
use wire::time::Timestamp;

use crate::reader::{self, Limits, LogContent, ReadError};

/// Most records looked at in a log without a summary; the counts stop there.
const SCAN_RECORDS: u64 = 2_000_000;
/// Most records of a summary that are passed over in search of the statistics.
const SUMMARY_RECORDS: u64 = 200_000;
/// Length of the footer record and the magic bytes behind it.
const FOOTER_BYTES: u64 = 9 + 20 + 8;

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
    let mut file = BufReader::new(File::open(path)?);
    let size = file.get_ref().metadata()?.len();
    let found = match summary_extent(&mut file, size)? {
        Some(extent) => extent,
        None => walk_extent(&mut file, size)?,
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

/// What the statistics say, in a file that was closed.
fn summary_extent(file: &mut BufReader<File>, size: u64) -> io::Result<Option<Extent>> {
    let Some(footer_at) = size.checked_sub(FOOTER_BYTES) else { return Ok(None) };
    file.seek(SeekFrom::Start(footer_at))?;
    let mut footer = [0; FOOTER_BYTES as usize];
    file.read_exact(&mut footer)?;
    let summary_at = u64_at(&footer, 9);
    if footer[0] != op::FOOTER || footer[29..] != *mcap::MAGIC || summary_at == 0 {
        return Ok(None);
    }
    let mut statistics = None;
    walk(file, summary_at, footer_at, SUMMARY_RECORDS, |opcode, length, file| {
        if opcode == op::STATISTICS && length >= 42 {
            let mut body = [0; 42];
            file.read_exact(&mut body)?;
            let messages = u64_at(&body, 0);
            // Between them stand five counts of schemas, channels, attachments, metadata, chunks.
            statistics =
                Some(Extent { start: u64_at(&body, 26), end: u64_at(&body, 34), messages });
        }
        Ok(())
    })?;
    Ok(statistics)
}

/// Times from the chunks' headers, counts from the message indexes behind them, nothing
/// decompressed. Ends where the file is torn.
fn walk_extent(file: &mut BufReader<File>, size: u64) -> io::Result<Extent> {
    let mut extent = Extent { start: u64::MAX, end: 0, messages: 0 };
    walk(file, mcap::MAGIC.len() as u64, size, SCAN_RECORDS, |opcode, length, file| {
        if opcode == op::CHUNK && length >= 16 {
            let mut times = [0; 16];
            file.read_exact(&mut times)?;
            extent.start = extent.start.min(u64_at(&times, 0));
            extent.end = extent.end.max(u64_at(&times, 8));
        } else if opcode == op::MESSAGE_INDEX {
            extent.messages += length.saturating_sub(6) / 16;
        }
        Ok(())
    })?;
    Ok(extent)
}

/// Goes from record to record between two offsets, at most `most` of them, and shows each one's
/// opcode and length to `look`, with the file at the beginning of its body.
fn walk(
    file: &mut BufReader<File>,
    from: u64,
    to: u64,
    most: u64,
    mut look: impl FnMut(u8, u64, &mut BufReader<File>) -> io::Result<()>,
) -> io::Result<()> {
    let mut at = from;
    file.seek(SeekFrom::Start(at))?;
    for _ in 0..most {
        let mut frame = [0; 9];
        if at.saturating_add(9) > to {
            break;
        }
        file.read_exact(&mut frame)?;
        let length = u64_at(&frame, 1);
        let Some(next) = (at + 9).checked_add(length).filter(|&next| next <= to) else { break };
        look(frame[0], length, file)?;
        let read = file.stream_position()?;
        file.seek_relative(i64::try_from(next.saturating_sub(read)).unwrap_or(i64::MAX))?;
        at = next;
    }
    Ok(())
}

fn u64_at(bytes: &[u8], at: usize) -> u64 {
    let field = bytes.get(at..at + 8).and_then(|field| field.try_into().ok());
    u64::from_le_bytes(field.unwrap_or_default())
}
