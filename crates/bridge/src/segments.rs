//! Names of the files of a log.
//!
//! ```text
//! <logs>/<log>/seg-000017.open.mcap    being written, or left by a crash
//!              seg-000016.mcap         sealed
//!              seg-000016.seal.json    its hash, its counts, and the hash of the seal before it
//!              seg-000015.torn         what a crash or a disk had damaged, as it was found
//! ```

use std::collections::BTreeMap;
use std::io;

use crate::recorder::Storage;

/// What a file of a log is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// Being written, or left by a crash.
    Open,
    /// Being made from an open one.
    Sealing,
    /// Complete.
    Sealed,
    /// The seal of a complete one.
    Seal,
    /// The seal being written.
    SealDraft,
    /// A damaged open one, kept after what could be read was sealed.
    Torn,
}

/// File of a log's folder that holds room back while the log is written.
pub const RESERVE: &str = "reserve";

const ENDINGS: [(Kind, &str); 6] = [
    (Kind::Open, ".open.mcap"),
    (Kind::Sealing, ".sealing"),
    (Kind::Seal, ".seal.json"),
    (Kind::SealDraft, ".seal.draft"),
    (Kind::Torn, ".torn"),
    // Last, for `.open.mcap` ends like it.
    (Kind::Sealed, ".mcap"),
];

/// The file's name within the folder of its log.
pub fn file_name(number: u32, kind: Kind) -> String {
    let ending = ENDINGS.iter().find(|(k, _)| *k == kind).map_or("", |(_, ending)| ending);
    format!("seg-{number:06}{ending}")
}

/// The file's name within the folder of all logs.
pub fn path(log: &str, number: u32, kind: Kind) -> String {
    format!("{log}/{}", file_name(number, kind))
}

/// Number and kind of a file, if it is one of ours.
pub fn parse(name: &str) -> Option<(u32, Kind)> {
    let rest = name.strip_prefix("seg-")?;
    let (kind, number) =
        ENDINGS.iter().find_map(|(kind, ending)| Some((*kind, rest.strip_suffix(ending)?)))?;
    let digits = (6..=9).contains(&number.len()) && number.bytes().all(|b| b.is_ascii_digit());
    digits.then(|| Some((number.parse().ok()?, kind)))?
}

/// The segments of a log, by number: the kinds of files of each.
pub fn list(storage: &dyn Storage, log: &str) -> io::Result<BTreeMap<u32, Vec<Kind>>> {
    let mut segments = BTreeMap::<u32, Vec<Kind>>::new();
    for name in storage.files(log)? {
        if let Some((number, kind)) = parse(&name) {
            segments.entry(number).or_default().push(kind);
        }
    }
    Ok(segments)
}

/// The logs, in the order of their names: those of one second by their number.
pub fn logs(storage: &dyn Storage) -> io::Result<Vec<String>> {
    let mut logs = storage.folders()?;
    let key = |log: &String| {
        let numbered = log.rsplit_once('-').and_then(|(name, n)| Some((name, n.parse().ok()?)));
        numbered.map_or((log.clone(), 1_u32), |(name, n)| (name.to_owned(), n))
    };
    logs.sort_by_key(key);
    Ok(logs)
}
