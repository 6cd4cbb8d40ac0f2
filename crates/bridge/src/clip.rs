//! Clips: a part of a log as a file of its own, complete and sealed by its checksums. The messages
//! are those of the log, byte for byte.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::{self, BufReader, Read, Write};
use std::path::{Path, PathBuf};

use wire::time::Timestamp;

use crate::reader::{self, Damage, Item, Limits, ReadError};
use crate::rewrite::{Contents, Rewriter};

/// Name of the record that says what a clip is of.
pub const CLIP: &str = "footfall.clip";
/// Name of the attachment with the bookmarks.
pub const BOOKMARKS: &str = "footfall.bookmarks";

/// What to take.
#[derive(Debug, Clone, Default)]
pub struct Selection {
    /// From this log time on.
    pub from: Option<Timestamp>,
    /// Up to and with this log time.
    pub to: Option<Timestamp>,
    /// Channels; all where absent.
    pub channels: Option<BTreeSet<String>>,
}

impl Selection {
    fn takes(&self, item: &Item) -> bool {
        let Item::Message(_, message) = item else { return true };
        let time = message.log_time;
        self.from.is_none_or(|from| from <= time)
            && self.to.is_none_or(|to| time <= to)
            && self.channels.as_ref().is_none_or(|names| names.contains(&*message.channel))
    }
}

/// What is said in a clip of itself.
#[derive(Debug, Clone, Default)]
pub struct ClipNote {
    /// Texts by key: source, who asked for it, when, range.
    pub texts: BTreeMap<String, String>,
    /// Bookmarks, as JSON.
    pub bookmarks: Option<Vec<u8>>,
}

/// What came of it.
#[derive(Debug)]
pub struct Clipped {
    /// What the new file holds.
    pub contents: Contents,
    /// What is wrong with the source.
    pub damage: Vec<Damage>,
}

/// A file to copy from.
#[derive(Debug)]
pub struct Source {
    file: File,
    /// What was there when it was opened: more may be written to it.
    size: u64,
}

impl Source {
    /// Opens a file, as far as it is written now.
    pub fn open(path: &Path) -> io::Result<Source> {
        let file = File::open(path)?;
        let size = file.metadata()?.len();
        Ok(Source { file, size })
    }
}

/// Copies what is selected of the files of a log, in order, to a new file. Also the way to make a
/// complete file out of a damaged one: everything that can be read, selected.
pub fn copy(
    sources: impl IntoIterator<Item = io::Result<Source>>,
    selection: &Selection,
    note: &ClipNote,
    out: impl Write,
    limits: Limits,
) -> Result<Clipped, ReadError> {
    let mut writer = Rewriter::new(out)?;
    if !note.texts.is_empty() {
        writer.metadata(CLIP, note.texts.clone())?;
    }
    let (mut damage, mut said) = (Vec::new(), BTreeSet::new());
    for source in sources {
        let mut outcome = Ok(());
        let Source { file, size } = source?;
        let source = BufReader::with_capacity(256 * 1024, file.take(size));
        let met = reader::scan_items(source, limits, |item| {
            if selection.takes(&item) && is_new(&item, &mut said) {
                outcome = writer.take(&item);
            }
            outcome.is_ok()
        })?;
        outcome?;
        // A file that is still written ends where it ends.
        damage.extend(met.into_iter().filter(|d| *d != Damage::Torn { at: size }));
    }
    if let Some(bookmarks) = &note.bookmarks {
        let time = writer.contents().end.unwrap_or(Timestamp(0));
        writer.attach(time, time, BOOKMARKS, "application/json", bookmarks)?;
    }
    Ok(Clipped { contents: writer.finish()?, damage })
}

/// What every segment says again is taken once.
fn is_new(item: &Item, said: &mut BTreeSet<String>) -> bool {
    match item {
        Item::Metadata(name, _) => said.insert(name.clone()),
        _ => true,
    }
}

/// As [`copy`], to a new file that is there only once it is complete and synced.
pub fn copy_to(
    files: &[PathBuf],
    selection: &Selection,
    note: &ClipNote,
    out: &Path,
    limits: Limits,
) -> Result<Clipped, ReadError> {
    let name = out.file_name().ok_or_else(|| io::Error::other("the path names no file"))?;
    let draft = out.with_file_name(format!(".{}.draft", name.to_string_lossy()));
    let clipped = File::create(&draft).map_err(ReadError::from).and_then(|file| {
        let sources = files.iter().map(|path| Source::open(path));
        let clipped = copy(sources, selection, note, &file, limits)?;
        file.sync_all()?;
        std::fs::rename(&draft, out)?;
        Ok(clipped)
    });
    clipped.inspect_err(|_| {
        // What is left behind is a hidden file that nothing lists.
        let _ = std::fs::remove_file(&draft);
    })
}
