//! Sealing: a segment that is no longer written becomes a complete file with a hash, and its seal
//! holds the hash of the seal before it. A change, a loss or an exchange of sealed segments breaks
//! that chain; the loss of the newest ones does not, so each session takes up the chain of the one
//! before it.
//!
//! Order, safe at every step: write `.sealing`, sync, read it back and examine it; write the seal,
//! sync, rename; rename the file; remove `.open`. Until the last step `.open` stands as it was.

use std::collections::{BTreeMap, BTreeSet};
use std::io::{self, Read, Seek, SeekFrom, Write};

use serde::{Deserialize, Serialize};
use wire::time::Timestamp;

use crate::doctor::{self, Examination};
use crate::reader::{self, Damage, Limits, ReadError};
use crate::recorder::Storage;
use crate::rewrite::{ChannelCount, Contents, Out, Rewriter};
use crate::segments::{self, Kind};

/// Limits for what the recorder wrote itself: its chunks of repeated text shrink without end.
pub const OWN: Limits = Limits { record_bytes: 64 << 20, ratio: u64::MAX, total_bytes: usize::MAX };

/// Where the chain stands: a seal by its place and hash.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct SealRef {
    /// The log.
    pub log: String,
    /// The segment.
    pub segment: u32,
    /// BLAKE3 hash of the seal's file, hexadecimal.
    pub blake3: String,
}

/// What is said of a sealed segment.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Seal {
    /// Form of this file: 1.
    pub version: u32,
    /// The log.
    pub log: String,
    /// The segment.
    pub segment: u32,
    /// Size of its file.
    pub bytes: u64,
    /// BLAKE3 hash of its file, hexadecimal.
    pub blake3: String,
    /// The seal before this one; absent for the first of all.
    pub previous: Option<SealRef>,
    /// Time of the first message.
    pub start: Option<Timestamp>,
    /// Time of the last message.
    pub end: Option<Timestamp>,
    /// Messages.
    pub messages: u64,
    /// By channel.
    pub channels: BTreeMap<String, ChannelCount>,
    /// What could not be read of the file that was sealed.
    pub lost: Vec<String>,
}

/// Why a segment was not sealed. It stays open, and whole.
#[derive(Debug, thiserror::Error)]
pub enum SealError {
    /// The disk.
    #[error("the disk refuses: {0}")]
    Io(#[from] io::Error),
    /// What was read back is not what was written.
    #[error("the new file is not sound: {0}")]
    NotSound(String),
}

impl From<ReadError> for SealError {
    fn from(error: ReadError) -> SealError {
        match error {
            ReadError::Io(error) => SealError::Io(error),
            other => SealError::Io(io::Error::other(other)),
        }
    }
}

/// A sealed segment.
#[derive(Debug, Clone)]
pub struct Sealed {
    /// Its seal.
    pub seal: Seal,
    /// The seal's place in the chain.
    pub reference: SealRef,
    /// What was wrong with the open file, but for an end that was cut clean.
    pub damage: Vec<Damage>,
}

/// Seals segment `number` of `log`, of whose file the first `limit` bytes count (all where absent).
/// `pace` is called after every mebibyte, to leave room for others.
pub fn seal(
    storage: &dyn Storage,
    log: &str,
    number: u32,
    limit: Option<u64>,
    previous: Option<SealRef>,
    pace: &dyn Fn(),
) -> Result<Sealed, SealError> {
    let name = |kind| segments::path(log, number, kind);
    let (open, sealing) = (name(Kind::Open), name(Kind::Sealing));
    remove_if_there(storage, &sealing)?;
    let file = storage.create(&sealing)?;
    let mut source = storage.open(&open)?;
    let size = source.seek(SeekFrom::End(0))?;
    source.rewind()?;
    let size = size.min(limit.unwrap_or(u64::MAX));
    let mut writer = Rewriter::new(Out(file.clone()))?;
    let damage = copy(source.take(size), &mut writer, pace)?;
    let contents = writer.finish()?;
    file.sync_data()?;
    drop(file);
    let damage: Vec<Damage> =
        damage.into_iter().filter(|d| *d != Damage::Torn { at: size }).collect();
    let examination = doctor::examine(storage.open(&sealing)?, OWN)?;
    check(&examination, &contents)?;
    let seal = Seal {
        version: 1,
        log: log.into(),
        segment: number,
        bytes: examination.bytes,
        blake3: examination.blake3,
        previous,
        start: contents.start,
        end: contents.end,
        messages: contents.messages,
        channels: contents.channels,
        lost: damage.iter().map(ToString::to_string).collect(),
    };
    let reference = write_seal(storage, &seal)?;
    storage.rename(&sealing, &name(Kind::Sealed))?;
    storage.sync_folder(log)?;
    if damage.is_empty() {
        storage.remove(&open)?;
    } else {
        storage.rename(&open, &name(Kind::Torn))?;
    }
    storage.sync_folder(log)?;
    Ok(Sealed { seal, reference, damage })
}

fn copy(
    source: impl Read,
    writer: &mut Rewriter<Out>,
    pace: &dyn Fn(),
) -> Result<Vec<Damage>, SealError> {
    let (mut outcome, mut since) = (Ok(()), 0);
    let damage = reader::scan_items(source, OWN, |item| {
        if let reader::Item::Message(_, message) = &item {
            since += message.data.len();
        }
        if since > 1 << 20 {
            since = 0;
            pace();
        }
        outcome = writer.take(&item);
        outcome.is_ok()
    })?;
    outcome?;
    Ok(damage)
}

fn check(examination: &Examination, contents: &Contents) -> Result<(), SealError> {
    if let Some(finding) = examination.findings.first() {
        return Err(SealError::NotSound(format!("{} (byte {})", finding.text, finding.at)));
    }
    if examination.messages != contents.messages {
        let (there, wanted) = (examination.messages, contents.messages);
        return Err(SealError::NotSound(format!("it holds {there} messages instead of {wanted}")));
    }
    Ok(())
}

fn write_seal(storage: &dyn Storage, seal: &Seal) -> Result<SealRef, SealError> {
    let draft = segments::path(&seal.log, seal.segment, Kind::SealDraft);
    remove_if_there(storage, &draft)?;
    let mut text = serde_json::to_vec_pretty(seal).map_err(io::Error::other)?;
    text.push(b'\n');
    let file = storage.create(&draft)?;
    Out(file.clone()).write_all(&text)?;
    file.sync_data()?;
    storage.rename(&draft, &segments::path(&seal.log, seal.segment, Kind::Seal))?;
    storage.sync_folder(&seal.log)?;
    let blake3 = blake3::hash(&text).to_hex().to_string();
    Ok(SealRef { log: seal.log.clone(), segment: seal.segment, blake3 })
}

/// Removes a file that may be absent.
pub fn remove_if_there(storage: &dyn Storage, name: &str) -> io::Result<()> {
    match storage.remove(name) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
        outcome => outcome,
    }
}

/// Longest seal that is read (bytes).
const SEAL_BYTES_MAX: u64 = 8 << 20;

/// The seal of a segment with its place in the chain; `None` where it is not readable.
pub fn read_seal(storage: &dyn Storage, log: &str, number: u32) -> Option<(Seal, SealRef)> {
    let source = storage.open(&segments::path(log, number, Kind::Seal)).ok()?;
    let mut text = Vec::new();
    source.take(SEAL_BYTES_MAX).read_to_end(&mut text).ok()?;
    let seal: Seal = serde_json::from_slice(&text).ok()?;
    let blake3 = blake3::hash(&text).to_hex().to_string();
    Some((seal, SealRef { log: log.into(), segment: number, blake3 }))
}

/// True if the sealed file of a segment is what its seal says.
pub fn holds(storage: &dyn Storage, seal: &Seal) -> io::Result<bool> {
    let mut source = storage.open(&segments::path(&seal.log, seal.segment, Kind::Sealed))?;
    let mut hasher = blake3::Hasher::new();
    let bytes = io::copy(&mut source, &mut hasher)?;
    Ok(bytes == seal.bytes && hasher.finalize().to_hex().to_string() == seal.blake3)
}

/// Seals with their places in the chain, by log and segment.
pub type Seals = Vec<((String, u32), Seal, SealRef)>;

/// All seals, in the order of logs and segments.
pub fn all(storage: &dyn Storage) -> io::Result<Seals> {
    let mut seals = Vec::new();
    for log in segments::logs(storage)? {
        for (number, kinds) in segments::list(storage, &log)? {
            if kinds.contains(&Kind::Seal)
                && let Some((seal, reference)) = read_seal(storage, &log, number)
            {
                seals.push(((log.clone(), number), seal, reference));
            }
        }
    }
    Ok(seals)
}

/// The end of the chain: the last seal that no other follows. Names do not tell, for clocks are set
/// back at times.
pub fn head(seals: &Seals) -> Option<SealRef> {
    let previous = seals.iter().filter_map(|(_, seal, _)| seal.previous.as_ref());
    let followed: BTreeSet<&str> = previous.map(|p| p.blake3.as_str()).collect();
    let mut ends = seals.iter().filter(|(.., r)| !followed.contains(r.blake3.as_str()));
    ends.next_back().map(|(.., reference)| reference.clone())
}
