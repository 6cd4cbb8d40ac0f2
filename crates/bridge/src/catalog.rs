//! The logs of a folder: folders of segments, or single files as earlier versions wrote them.
//!
//! Names from requests are never joined to a path unless they are log ids: `[A-Za-z0-9_-]`, 1 to 64
//! characters.

use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use mcap::records::op;
use wire::resources::LogInfo;
use wire::time::Timestamp;

use crate::clip::{self, ClipNote, Clipped, Selection};
use crate::reader::{self, IndexedLog, Limits, LogContent, ReadError};
use crate::recorder::LogFolder;
use crate::segments::{self, Kind};

mod index;

pub use index::FILE as CATALOG_FILE;
use index::{Index, Stamp};

/// Times that a log is looked at again because one of its segments was sealed meanwhile.
const SEALED_MEANWHILE: usize = 4;
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

/// The file of a log of one file: a log of an earlier version, or one with a single segment.
pub fn log_path(dir: &Path, id: &str) -> Result<PathBuf, ReadError> {
    let mut files = log_files(dir, id)?;
    match (files.len(), files.pop()) {
        (1, Some(file)) => Ok(file),
        (n, _) => Err(ReadError::Segments { id: id.into(), segments: n }),
    }
}

/// The files of a log, in order: its segments, each sealed or still open; or the one file that a log
/// of an earlier version is.
pub fn log_files(dir: &Path, id: &str) -> Result<Vec<PathBuf>, ReadError> {
    let unknown = || ReadError::Unknown { id: id.chars().take(64).collect() };
    if !is_log_id(id) {
        return Err(unknown());
    }
    let path = dir.join(format!("{id}.mcap"));
    if std::fs::symlink_metadata(&path).is_ok_and(|meta| meta.is_file()) {
        return Ok(vec![path]);
    }
    let folder = dir.join(id);
    if !std::fs::symlink_metadata(&folder).is_ok_and(|meta| meta.is_dir()) {
        return Err(unknown());
    }
    let mut files = Vec::new();
    for (number, kinds) in segments::list(&LogFolder::new(dir), id)? {
        let kind = [Kind::Sealed, Kind::Open].into_iter().find(|kind| kinds.contains(kind));
        files.extend(kind.map(|kind| folder.join(segments::file_name(number, kind))));
    }
    if files.is_empty() { Err(unknown()) } else { Ok(files) }
}

/// Calls `look` with the files of a log; again where one of them was sealed meanwhile and has
/// another name now.
fn with_files<T>(
    dir: &Path,
    id: &str,
    mut look: impl FnMut(&[PathBuf]) -> Result<T, ReadError>,
) -> Result<T, ReadError> {
    for _ in 0..SEALED_MEANWHILE {
        match look(&log_files(dir, id)?) {
            Err(ReadError::Io(error)) if error.kind() == io::ErrorKind::NotFound => {}
            outcome => return outcome,
        }
    }
    look(&log_files(dir, id)?)
}

/// Reads a log of the folder whole, see [`reader::read_log`].
pub fn read_log(dir: &Path, id: &str, limits: Limits) -> Result<LogContent, ReadError> {
    with_files(dir, id, |files| {
        let mut content = LogContent::default();
        let mut left = limits.total_bytes;
        for file in files {
            let part = match reader::read_file(file, Limits { total_bytes: left, ..limits }) {
                Err(ReadError::TooLarge { .. }) => {
                    return Err(ReadError::TooLarge { limit: limits.total_bytes });
                }
                // One segment that gives nothing does not take the others away.
                Err(ReadError::Damaged(damage)) if files.len() > 1 => {
                    content.damage.push(damage);
                    continue;
                }
                part => part?,
            };
            left = left.saturating_sub(part.messages.iter().map(|m| m.data.len() + 96).sum());
            content.messages.extend(part.messages);
            content.damage.extend(part.damage);
        }
        Ok(content)
    })
}

/// Opens a log of the folder to read it piece by piece.
pub fn open_log(dir: &Path, id: &str, limits: Limits) -> Result<IndexedLog, ReadError> {
    with_files(dir, id, |files| IndexedLog::open(files, limits))
}

/// Writes a part of a log to a new log of the folder, named `clip`.
pub fn clip_log(
    dir: &Path,
    id: &str,
    clip: &str,
    selection: &Selection,
    note: &ClipNote,
) -> Result<Clipped, ReadError> {
    if !is_log_id(clip) {
        return Err(ReadError::Unknown { id: clip.chars().take(64).collect() });
    }
    let out = dir.join(format!("{clip}.mcap"));
    with_files(dir, id, |files| {
        let inside = files.iter().filter(|file| may_hold(file, selection)).cloned();
        clip::copy_to(&inside.collect::<Vec<_>>(), selection, note, &out, Limits::default())
    })
}

/// Writes a log as one complete file, whatever the number of its segments: as it is read, so that only
/// a chunk and the index of the new file are in memory. The files are opened at once, and stay readable
/// when one of them is sealed meanwhile.
pub fn copy_log(
    dir: &Path,
    id: &str,
    note: &ClipNote,
    out: impl Write,
) -> Result<Clipped, ReadError> {
    let sources = with_files(dir, id, |files| {
        let opened = files.iter().map(|path| clip::Source::open(path));
        Ok(opened.collect::<io::Result<Vec<_>>>()?)
    })?;
    clip::copy(sources.into_iter().map(Ok), &Selection::default(), note, out, Limits::default())
}

/// False if the summary of a file says that nothing of the wished time is in it.
fn may_hold(path: &Path, selection: &Selection) -> bool {
    let extent = File::open(path).and_then(|file| {
        let size = file.metadata()?.len();
        summary_extent(&mut BufReader::new(file), size)
    });
    let Ok(Some(extent)) = extent else { return true };
    selection.from.is_none_or(|from| from.0 <= extent.end)
        && selection.to.is_none_or(|to| extent.start <= to.0)
}

/// The logs of the folder, newest first; `open` is the one being written, as the recorder has it.
/// A file that cannot be read is listed with no messages. A missing folder has no logs. What is known of
/// files that have not changed comes from the catalog beside them.
pub fn list_logs(dir: &Path, open: Option<&LogInfo>) -> io::Result<Vec<LogInfo>> {
    let entries = match std::fs::read_dir(dir) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        entries => entries?,
    };
    let mut logs = Vec::new();
    let mut index = Index::open(dir);
    for entry in entries {
        let name = entry?.file_name();
        let Some(name) = name.to_str() else { continue };
        let id = name.strip_suffix(".mcap").unwrap_or(name);
        match open.filter(|open| open.id == id && open.open) {
            Some(open) => logs.push(open.clone()),
            None => {
                let of_file = |path: &Path| {
                    let stamp = Stamp::of(&std::fs::metadata(path)?);
                    index.extent(path, stamp, || file_extent(path)).map(|e| (stamp.size, e))
                };
                logs.extend(info_of(dir, id, of_file).ok());
            }
        }
    }
    index.keep();
    logs.sort_by(|a, b| (b.start, &b.id).cmp(&(a.start, &a.id)));
    Ok(logs)
}

/// What the list says of one log: from the summaries, or from a walk along the chunks. Where a log
/// is torn, the count may lack the messages of the last chunk.
pub fn log_info(dir: &Path, id: &str) -> Result<LogInfo, ReadError> {
    info_of(dir, id, |path| Ok((std::fs::metadata(path)?.len(), file_extent(path)?)))
}

/// What a log's files, each by its size and extent, make together.
fn info_of(
    dir: &Path,
    id: &str,
    mut of_file: impl FnMut(&Path) -> io::Result<(u64, Extent)>,
) -> Result<LogInfo, ReadError> {
    with_files(dir, id, |files| {
        let none = Extent { start: u64::MAX, end: 0, messages: 0 };
        let (mut all, mut size) = (none, 0);
        for path in files {
            let (bytes, found) = of_file(path)?;
            size += bytes;
            if found.messages > 0 {
                all.start = all.start.min(found.start);
                all.end = all.end.max(found.end);
                all.messages += found.messages;
            }
        }
        let Extent { start, end, messages } = all;
        let time = |t: u64| (messages > 0).then_some(Timestamp(t));
        let (start, end) = (time(start), time(end));
        Ok(LogInfo { id: id.into(), size, start, end, messages, open: false })
    })
}

/// What a file holds: times of its first and last message (ns), and their number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Extent {
    start: u64,
    end: u64,
    messages: u64,
}

fn file_extent(path: &Path) -> io::Result<Extent> {
    let mut file = BufReader::new(File::open(path)?);
    let bytes = file.get_ref().metadata()?.len();
    match summary_extent(&mut file, bytes)? {
        Some(extent) => Ok(extent),
        None => walk_extent(&mut file, bytes),
    }
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
            // A chunk that only introduces channels has no times.
            if times != [0; 16] {
                extent.start = extent.start.min(u64_at(&times, 0));
                extent.end = extent.end.max(u64_at(&times, 8));
            }
        } else if opcode == op::MESSAGE_INDEX {
            extent.messages += length.saturating_sub(6) / 16;
        } else if opcode == op::MESSAGE && length >= 22 {
            // Outside of chunks, as files of others may have them; behind channel and number, the time.
            let mut head = [0; 14];
            file.read_exact(&mut head)?;
            extent.start = extent.start.min(u64_at(&head, 6));
            extent.end = extent.end.max(u64_at(&head, 6));
            extent.messages += 1;
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
