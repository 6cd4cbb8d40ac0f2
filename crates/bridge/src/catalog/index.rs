//! What the list of logs says of each file, kept in SQLite (`catalog.sqlite` beside the logs), so that
//! the list of a thousand logs opens none of them.
//!
//! It holds nothing that is not in the files. A row counts only for a file of the size and the time of
//! change that it names, and only if its own checksum agrees. So a catalog that is lost, damaged or
//! stale costs time, and never an answer: what it lacks is read from the files and written to it.

use std::collections::{HashMap, HashSet};
use std::fs::Metadata;
use std::path::{Path, PathBuf};
use std::time::UNIX_EPOCH;

use rusqlite::{Connection, params};

use super::Extent;

/// The catalog's file in the folder of the logs.
pub const FILE: &str = "catalog.sqlite";
/// Form of the table; another one is made anew.
const VERSION: i32 = 1;
/// Most rows that are read: as many files as a folder may have.
const ROWS_MAX: usize = 1_000_000;
/// How long another reader is waited for (ms).
const BUSY_MS: u64 = 500;

const TABLE: &str = "CREATE TABLE IF NOT EXISTS segment (
    file TEXT PRIMARY KEY,
    size INTEGER NOT NULL,
    changed_ns INTEGER NOT NULL,
    start INTEGER NOT NULL,
    end INTEGER NOT NULL,
    messages INTEGER NOT NULL,
    sum TEXT NOT NULL
) WITHOUT ROWID";

/// A file as it is, by what tells that it has not changed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stamp {
    pub size: u64,
    changed_ns: u64,
}

impl Stamp {
    pub fn of(meta: &Metadata) -> Stamp {
        let changed = meta.modified().ok().and_then(|t| t.duration_since(UNIX_EPOCH).ok());
        let changed_ns = changed.map_or(0, |since| since.as_nanos() as u64);
        Stamp { size: meta.len(), changed_ns }
    }
}

/// The catalog of a folder while one list is made.
pub struct Index {
    folder: PathBuf,
    db: Option<Connection>,
    known: HashMap<String, (Stamp, Extent)>,
    met: HashSet<String>,
    new: Vec<(String, Stamp, Extent)>,
    /// Rows that are no longer to be there.
    gone: Vec<String>,
}

impl Index {
    /// Opens the catalog of a folder; makes it anew where it cannot be read. Where it cannot be made
    /// either, as in a folder that is not to be written, everything is read from the files.
    pub fn open(folder: &Path) -> Index {
        let path = folder.join(FILE);
        let mut opened = read(&path);
        if let Err(error) = &opened {
            tracing::warn!("the catalog of the logs is made anew: {error}");
            // What cannot be removed is told by the next attempt.
            let _ = std::fs::remove_file(&path);
            let _ = std::fs::remove_file(folder.join(format!("{FILE}-journal")));
            opened = read(&path);
        }
        let (db, known, gone) = match opened {
            Ok((db, known, gone)) => (Some(db), known, gone),
            Err(error) => {
                tracing::warn!("there is no catalog of the logs: {error}");
                (None, HashMap::new(), Vec::new())
            }
        };
        let (met, new) = (HashSet::new(), Vec::new());
        Index { folder: folder.into(), db, known, met, new, gone }
    }

    /// What a file holds: from the catalog where that knows it as it is, else from `read`.
    pub fn extent<E>(
        &mut self,
        path: &Path,
        stamp: Stamp,
        read: impl FnOnce() -> Result<Extent, E>,
    ) -> Result<Extent, E> {
        let name = path.strip_prefix(&self.folder).unwrap_or(path).to_string_lossy().into_owned();
        let known = self.known.get(&name).filter(|(known, _)| *known == stamp);
        let extent = match known {
            Some((_, extent)) => *extent,
            None => {
                let extent = read()?;
                self.new.push((name.clone(), stamp, extent));
                extent
            }
        };
        self.met.insert(name);
        Ok(extent)
    }

    /// Writes what is new, and forgets files that were not met.
    pub fn keep(mut self) {
        let Some(mut db) = self.db.take() else { return };
        let gone = self.known.keys().filter(|name| !self.met.contains(*name));
        let gone: Vec<&String> = gone.chain(&self.gone).collect();
        if self.new.is_empty() && gone.is_empty() {
            return;
        }
        if let Err(error) = write(&mut db, &self.new, &gone) {
            // The next list begins with a new one, or does without.
            tracing::warn!("the catalog of the logs cannot be written: {error}");
            drop(db);
            let _ = std::fs::remove_file(self.folder.join(FILE));
        }
    }
}

type Read = (Connection, HashMap<String, (Stamp, Extent)>, Vec<String>);

fn read(path: &Path) -> rusqlite::Result<Read> {
    let db = Connection::open(path)?;
    db.busy_timeout(std::time::Duration::from_millis(BUSY_MS))?;
    let version: i32 = db.pragma_query_value(None, "user_version", |row| row.get(0))?;
    if version != VERSION {
        db.execute_batch("DROP TABLE IF EXISTS segment")?;
        db.pragma_update(None, "user_version", VERSION)?;
    }
    db.execute_batch(TABLE)?;
    let (mut known, mut gone) = (HashMap::new(), Vec::new());
    {
        let mut query =
            db.prepare("SELECT file, size, changed_ns, start, end, messages, sum FROM segment")?;
        let mut rows = query.query([])?;
        while let Some(row) = rows.next()? {
            let file: String = row.get(0)?;
            let number = |column| row.get::<_, i64>(column).map(|n| n as u64);
            let stamp = Stamp { size: number(1)?, changed_ns: number(2)? };
            let extent = Extent { start: number(3)?, end: number(4)?, messages: number(5)? };
            if row.get::<_, String>(6)? == sum(&file, stamp, extent) && known.len() < ROWS_MAX {
                known.insert(file, (stamp, extent));
            } else {
                gone.push(file);
            }
        }
    }
    Ok((db, known, gone))
}

fn write(
    db: &mut Connection,
    new: &[(String, Stamp, Extent)],
    gone: &[&String],
) -> rusqlite::Result<()> {
    let change = db.transaction()?;
    for name in gone {
        change.execute("DELETE FROM segment WHERE file = ?1", [name])?;
    }
    for (file, stamp, extent) in new {
        let number = |n: u64| n as i64;
        change.execute(
            "INSERT OR REPLACE INTO segment VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7)",
            params![
                file,
                number(stamp.size),
                number(stamp.changed_ns),
                number(extent.start),
                number(extent.end),
                number(extent.messages),
                sum(file, *stamp, *extent)
            ],
        )?;
    }
    change.commit()
}

/// The checksum of a row: SQLite has none of its own.
fn sum(file: &str, stamp: Stamp, extent: Extent) -> String {
    let mut hasher = blake3::Hasher::new();
    for number in [stamp.size, stamp.changed_ns, extent.start, extent.end, extent.messages] {
        hasher.update(&number.to_le_bytes());
    }
    hasher.update(file.as_bytes());
    hasher.finalize().to_hex()[..16].into()
}
