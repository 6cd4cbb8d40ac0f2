//! Recovery at the start: every segment that a crash left open is read as far as it is sound and
//! sealed. Never in place, and the same again when it is itself cut off at any step.

use std::collections::BTreeMap;
use std::io;

use crate::marks;
use crate::reader::{self, Item};
use crate::recorder::Storage;
use crate::seal::{self, OWN, SealError, SealRef, Sealed};
use crate::segments::{self, Kind};

/// Key of the session record: how many bytes count of the segments that ended with an error, as
/// `number:bytes`, separated by spaces.
pub const COMMITTED_KEY: &str = "committed_bytes";

/// What became of a segment that was found open.
#[derive(Debug)]
pub struct Recovered {
    /// The log.
    pub log: String,
    /// The segment.
    pub segment: u32,
    /// What was sealed; or why nothing was.
    pub outcome: Result<Sealed, SealError>,
}

impl Recovered {
    /// True if everything that was in the file is in the sealed one.
    pub fn is_lossless(&self) -> bool {
        self.outcome.as_ref().is_ok_and(|sealed| sealed.damage.is_empty())
    }

    /// What happened, for people.
    pub fn text(&self) -> String {
        let (log, segment) = (&self.log, self.segment);
        match &self.outcome {
            Ok(Sealed { seal, damage, .. }) if damage.is_empty() => {
                let messages = seal.messages;
                format!("log {log}, segment {segment}: {messages} messages recovered, none lost")
            }
            Ok(Sealed { seal, damage, .. }) => format!(
                "log {log}, segment {segment}: {} messages recovered; {}; the file as it was found is kept",
                seal.messages,
                damage.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ")
            ),
            Err(error) => format!("log {log}, segment {segment} is not recovered: {error}"),
        }
    }
}

/// What a recovery found and did.
#[derive(Debug, Default)]
pub struct Recovery {
    /// The segments that were open.
    pub segments: Vec<Recovered>,
    /// The end of the chain of seals.
    pub head: Option<SealRef>,
}

/// Seals what was left open in all logs, but those that a living process writes.
pub fn recover(storage: &dyn Storage) -> io::Result<Recovery> {
    let head = seal::head(&seal::all(storage)?);
    let mut recovery = Recovery { segments: Vec::new(), head };
    for log in segments::logs(storage)? {
        recover_log(storage, &log, &mut recovery)?;
    }
    Ok(recovery)
}

fn recover_log(storage: &dyn Storage, log: &str, recovery: &mut Recovery) -> io::Result<()> {
    let segments = segments::list(storage, log)?;
    for (&number, kinds) in &segments {
        let name = segments::path(log, number, Kind::Open);
        if kinds.contains(&Kind::Open) && storage.in_use(&name)? {
            return Ok(());
        }
    }
    if !segments.is_empty() {
        seal::remove_if_there(storage, &format!("{log}/{}", segments::RESERVE))?;
    }
    let committed = committed_bytes(storage, log, &segments);
    for (&number, kinds) in &segments {
        if kinds.contains(&Kind::Open) {
            let (limit, head) = (committed.get(&number).copied(), recovery.head.clone());
            let outcome = match recover_segment(storage, log, number, kinds, limit, head) {
                // The seal was done, but for its last step.
                Ok(None) => continue,
                Ok(Some(sealed)) => {
                    recovery.head = Some(sealed.reference.clone());
                    Ok(sealed)
                }
                Err(error) => Err(error),
            };
            recovery.segments.push(Recovered { log: log.into(), segment: number, outcome });
        }
    }
    Ok(())
}

fn recover_segment(
    storage: &dyn Storage,
    log: &str,
    number: u32,
    kinds: &[Kind],
    limit: Option<u64>,
    previous: Option<SealRef>,
) -> Result<Option<Sealed>, SealError> {
    if kinds.contains(&Kind::Sealed)
        && let Some((done, _)) = seal::read_seal(storage, log, number)
        && seal::holds(storage, &done)?
    {
        let open = segments::path(log, number, Kind::Open);
        if done.lost.is_empty() {
            storage.remove(&open)?;
        } else {
            storage.rename(&open, &segments::path(log, number, Kind::Torn))?;
        }
        storage.sync_folder(log)?;
        return Ok(None);
    }
    // A seal whose file was not renamed yet is made anew; it is not its own predecessor.
    let own = seal::read_seal(storage, log, number);
    let previous = match own {
        Some((seal, reference)) if previous.as_ref() == Some(&reference) => seal.previous,
        _ => previous,
    };
    seal::seal(storage, log, number, limit, previous, &|| {}).map(Some)
}

/// How much counts of the segments that ended with an error, as those after them say: their last,
/// uncommitted batch was written again to the next one.
fn committed_bytes(
    storage: &dyn Storage,
    log: &str,
    segments: &BTreeMap<u32, Vec<Kind>>,
) -> BTreeMap<u32, u64> {
    let mut committed = BTreeMap::new();
    let open = segments.iter().filter(|(_, kinds)| kinds.contains(&Kind::Open));
    let Some((&first, _)) = open.clone().next() else { return committed };
    for (&number, kinds) in segments.range(first..) {
        let kind = [Kind::Sealed, Kind::Open].into_iter().find(|kind| kinds.contains(kind));
        let source = kind.and_then(|k| storage.open(&segments::path(log, number, k)).ok());
        let Some(source) = source else { continue };
        // It is the first thing that the file says; little of what follows is looked at.
        let mut left = 64;
        let _ = reader::scan_items(source, OWN, |item| {
            left -= 1;
            let Item::Metadata(name, texts) = &item else { return left > 0 };
            if name == marks::SESSION
                && let Some(said) = texts.get(COMMITTED_KEY)
            {
                committed.extend(said.split(' ').filter_map(|pair| {
                    let (number, bytes) = pair.split_once(':')?;
                    Some((number.parse::<u32>().ok()?, bytes.parse::<u64>().ok()?))
                }));
            }
            left > 0 && name != marks::SESSION
        });
    }
    committed
}
