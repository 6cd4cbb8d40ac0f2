//! Bookmarks of a log: a small JSON file beside it, for a log itself is never changed.

use std::fs::File;
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

use wire::resources::{Bookmark, BookmarkList};

use crate::catalog;
use crate::reader::ReadError;

/// Most bookmarks of one log.
pub const BOOKMARKS_MAX: usize = 1000;
/// Longest text of a bookmark (characters).
pub const TEXT_MAX: usize = 500;
/// Largest file of bookmarks that is read (bytes).
const FILE_BYTES: u64 = 8 << 20;

/// Why a bookmark is not taken.
#[derive(Debug, thiserror::Error)]
pub enum BookmarkError {
    /// The log.
    #[error(transparent)]
    Log(#[from] ReadError),
    /// The disk, or a file that is not what was written.
    #[error("the bookmarks cannot be kept: {0}")]
    Io(#[from] io::Error),
    /// Too many.
    #[error("the log has {BOOKMARKS_MAX} bookmarks; remove some first")]
    TooMany,
    /// No text, or too long a one.
    #[error("the text of a bookmark has 1 to {TEXT_MAX} characters, not {length}")]
    Text {
        /// Its length.
        length: usize,
    },
    /// A stretch that ends before it begins.
    #[error("until is before at")]
    Order,
    /// No such bookmark.
    #[error("there is no such bookmark")]
    Unknown,
}

fn file_of(dir: &Path, log: &str) -> Result<PathBuf, BookmarkError> {
    catalog::log_files(dir, log)?;
    Ok(dir.join(format!("{log}.bookmarks.json")))
}

/// The bookmarks of a log, by their places.
pub fn list(dir: &Path, log: &str) -> Result<BookmarkList, BookmarkError> {
    let file = match File::open(file_of(dir, log)?) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(BookmarkList::default()),
        file => file?,
    };
    let mut text = Vec::new();
    file.take(FILE_BYTES).read_to_end(&mut text)?;
    Ok(serde_json::from_slice(&text).map_err(io::Error::from)?)
}

/// Adds a bookmark. Calls must not overlap.
pub fn add(dir: &Path, log: &str, bookmark: Bookmark) -> Result<(), BookmarkError> {
    let length = bookmark.text.chars().count();
    if !(1..=TEXT_MAX).contains(&length) {
        return Err(BookmarkError::Text { length });
    }
    if bookmark.until.is_some_and(|until| until < bookmark.at) {
        return Err(BookmarkError::Order);
    }
    let mut all = list(dir, log)?;
    if all.bookmarks.len() >= BOOKMARKS_MAX {
        return Err(BookmarkError::TooMany);
    }
    let place = all.bookmarks.partition_point(|other| other.at <= bookmark.at);
    all.bookmarks.insert(place, bookmark);
    keep(dir, log, &all)
}

/// Removes a bookmark. Calls must not overlap.
pub fn remove(dir: &Path, log: &str, id: &str) -> Result<(), BookmarkError> {
    let mut all = list(dir, log)?;
    let place = all.bookmarks.iter().position(|bookmark| bookmark.id == id);
    all.bookmarks.remove(place.ok_or(BookmarkError::Unknown)?);
    keep(dir, log, &all)
}

/// Gives a new log, as a clip is, the bookmarks that were attached to it.
pub fn take_along(dir: &Path, log: &str, attached: &[u8]) -> Result<(), BookmarkError> {
    keep(dir, log, &serde_json::from_slice(attached).map_err(io::Error::from)?)
}

fn keep(dir: &Path, log: &str, all: &BookmarkList) -> Result<(), BookmarkError> {
    let path = file_of(dir, log)?;
    let draft = path.with_extension("draft");
    let text = serde_json::to_vec_pretty(all).map_err(io::Error::from)?;
    let mut file = File::create(&draft)?;
    file.write_all(&text)?;
    file.sync_all()?;
    std::fs::rename(&draft, &path)?;
    File::open(dir)?.sync_all()?;
    Ok(())
}
