//! What a rover remembers over the end of its process, in a file.
//!
//! A line for each thing, its check sum in front. What must not be forgotten is synced before it is
//! acted upon: the identity of a command before it is executed, an E-stop before it is confirmed. A
//! line that was torn by a kill is the last one, and is left out.

use std::collections::VecDeque;
use std::fs::{File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use sim::SimRover;
use wire::live::{AckStage, Downlink, RoverMode, Uplink};
use wire::scene::RoverState;
use wire::time::Timestamp;

use super::remote::Said;

/// Identities remembered; as many as the simulated rover has room for.
const IDS: usize = 1024;
/// Last words said again to a ground that is another process than before.
const WORDS: usize = 64;
/// Size (bytes) beyond which the file is written anew, without what is no longer needed.
const BYTES_MAX: u64 = 4 << 20;

/// Why a journal cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum JournalError {
    /// The disk.
    #[error("the rover's memory {path} cannot be used: {reason}")]
    Disk {
        /// The file.
        path: String,
        /// Why.
        reason: String,
    },
    /// Of another rover or ground.
    #[error(
        "the rover's memory {path} is of {found}, but this rover is {wanted}: give another --state, or \
         remove the folder to begin anew"
    )]
    Other {
        /// The file.
        path: String,
        /// What it is of.
        found: String,
        /// What is wanted.
        wanted: String,
    },
}

/// What was said of a command last.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Word {
    /// Its identity.
    pub id: String,
    /// What; none where nothing was said yet.
    pub stage: Option<AckStage>,
    /// Why.
    pub detail: Option<String>,
    /// When, on board.
    pub at: Timestamp,
}

/// Where the rover was, and how.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Place {
    /// Pose and joints.
    pub state: RoverState,
    /// What it was doing.
    pub mode: RoverMode,
    /// Why it is in mode `fault`.
    pub fault: Option<String>,
}

#[derive(Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Line {
    Of(String),
    Epoch(u64),
    Begin { id: String, epoch: Option<u64>, at: Timestamp },
    Word(Word),
    Stopped(bool),
    Place(Place),
}

/// What is remembered.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Memory {
    /// Commands and releases, oldest first.
    pub words: VecDeque<Word>,
    /// The highest authority seen.
    pub epoch: Option<u64>,
    /// Is a stop in force?
    pub stopped: bool,
    /// Where the rover was last.
    pub place: Option<Place>,
}

impl Memory {
    fn take(&mut self, line: Line) {
        match line {
            Line::Of(_) => {}
            Line::Epoch(epoch) => self.epoch = self.epoch.max(Some(epoch)),
            Line::Begin { id, epoch, at } => {
                self.epoch = self.epoch.max(epoch);
                self.put(Word { id, stage: None, detail: None, at });
            }
            Line::Word(word) => self.put(word),
            Line::Stopped(stopped) => self.stopped = stopped,
            Line::Place(place) => self.place = Some(place),
        }
    }

    fn put(&mut self, word: Word) {
        if let Some(known) = self.words.iter_mut().rev().find(|known| known.id == word.id) {
            let copy = known.stage.is_some() && word.stage == Some(AckStage::Received);
            if !copy && word.stage.is_some() && !known.stage.is_some_and(is_last) {
                *known = word;
            }
            return;
        }
        if self.words.len() == IDS {
            self.words.pop_front();
        }
        self.words.push_back(word);
    }

    /// Gives a simulated rover back what it knew. Where it was is for who builds it.
    pub fn recall(&self, rover: &mut SimRover) {
        let fault = self.place.as_ref().filter(|place| place.mode == RoverMode::Fault);
        let fault = fault.map(|place| place.fault.clone().or_else(|| Some("unknown".into())));
        let stop = if self.stopped { Some(None) } else { fault };
        rover.recall(self.words.iter().map(|word| word.id.clone()), self.epoch, stop);
    }

    /// The last words of the newest commands, oldest first.
    pub fn last_words(&self) -> Vec<Said> {
        let skip = self.words.len().saturating_sub(WORDS);
        let said = |word: &Word| {
            let Word { id, stage, detail, at } = word.clone();
            Some(Said { at, message: Downlink::Ack { id, stage: stage?, detail } })
        };
        self.words.iter().skip(skip).filter_map(said).collect()
    }
}

fn is_last(stage: AckStage) -> bool {
    !matches!(stage, AckStage::Received | AckStage::Started)
}

/// The memory of a rover, kept in a file of a folder.
#[derive(Debug)]
pub struct Journal {
    path: PathBuf,
    file: File,
    bytes: u64,
    of: String,
    memory: Memory,
}

impl Journal {
    /// Opens the memory in `folder`, or begins one. `of` names robot and ground: a memory of others
    /// is refused. Commands that were begun and not ended are ended here as aborted, at `now`.
    pub fn open(folder: &Path, of: &str, now: Timestamp) -> Result<Journal, JournalError> {
        let path = folder.join("rover.journal");
        let failed = |error: std::io::Error| disk(&path, &error);
        std::fs::create_dir_all(folder).map_err(failed)?;
        let text = match std::fs::read(&path) {
            Ok(bytes) => String::from_utf8_lossy(&bytes).into_owned(),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => String::new(),
            Err(error) => return Err(failed(error)),
        };
        let mut memory = Memory::default();
        for line in text.lines() {
            let Some(line) = parse(line) else {
                tracing::warn!("the rover's memory ends in a torn line");
                break;
            };
            if let Line::Of(found) = &line
                && found != of
            {
                let (found, wanted) = (found.clone(), of.to_owned());
                return Err(JournalError::Other {
                    path: path.display().to_string(),
                    found,
                    wanted,
                });
            }
            memory.take(line);
        }
        for word in &mut memory.words {
            if !word.stage.is_some_and(is_last) {
                word.stage = Some(AckStage::Aborted);
                word.at = now;
                let why = "the rover's process ended before the command did; it holds where it was";
                word.detail = Some(why.into());
            }
        }
        let (file, bytes) = rewrite(&path, of, &memory).map_err(|error| disk(&path, &error))?;
        Ok(Journal { path, file, bytes, of: of.into(), memory })
    }

    /// What is remembered.
    pub fn memory(&self) -> &Memory {
        &self.memory
    }

    /// An uplink is about to be given to the rover. Synced when this returns.
    pub fn begin(&mut self, now: Timestamp, uplink: &Uplink) -> Result<(), JournalError> {
        match uplink {
            Uplink::Command { id, epoch, .. } => {
                self.put(Line::Begin { id: id.clone(), epoch: *epoch, at: now }, true)
            }
            Uplink::EstopRelease { id } => {
                self.put(Line::Begin { id: id.clone(), epoch: None, at: now }, true)
            }
            Uplink::Estop { .. } => self.put(Line::Stopped(true), true),
            _ => Ok(()),
        }
    }

    /// The rover has said something.
    pub fn said(&mut self, at: Timestamp, message: &Downlink) -> Result<(), JournalError> {
        if let Downlink::Ack { id, stage, detail } = message {
            let known = self.memory.words.iter().any(|word| word.id == *id);
            if !known {
                // Words on E-stops are not kept: that one is in force is.
                return Ok(());
            }
            let word = Word { id: id.clone(), stage: Some(*stage), detail: detail.clone(), at };
            return self.put(Line::Word(word), is_last(*stage));
        }
        if let Downlink::Telemetry(frame) = message {
            let stopped = frame.mode == RoverMode::Stopped;
            if stopped != self.memory.stopped {
                self.put(Line::Stopped(stopped), true)?;
            }
            let (state, mode, fault) = (frame.state.clone(), frame.mode, frame.fault.clone());
            let place = Place { state, mode, fault };
            if self.memory.place.as_ref() != Some(&place) {
                // A kill loses nothing that was written; a power cut costs a part of a motion.
                self.put(Line::Place(place), false)?;
            }
        }
        Ok(())
    }

    fn put(&mut self, line: Line, sync: bool) -> Result<(), JournalError> {
        let text = print(&line);
        let path = self.path.clone();
        let written = self.file.write_all(text.as_bytes());
        let synced = if sync { written.and_then(|()| self.file.sync_data()) } else { written };
        synced.map_err(|error| disk(&path, &error))?;
        self.bytes += text.len() as u64;
        self.memory.take(line);
        if self.bytes > BYTES_MAX {
            let anew = rewrite(&self.path, &self.of, &self.memory);
            (self.file, self.bytes) = anew.map_err(|error| disk(&path, &error))?;
        }
        Ok(())
    }
}

fn disk(path: &Path, error: &std::io::Error) -> JournalError {
    JournalError::Disk { path: path.display().to_string(), reason: error.to_string() }
}

/// Writes the file anew beside the old one, which it then replaces.
fn rewrite(path: &Path, of: &str, memory: &Memory) -> std::io::Result<(File, u64)> {
    let mut text = print(&Line::Of(of.into()));
    if let Some(epoch) = memory.epoch {
        text += &print(&Line::Epoch(epoch));
    }
    for word in &memory.words {
        text += &print(&Line::Word(word.clone()));
    }
    text += &print(&Line::Stopped(memory.stopped));
    if let Some(place) = &memory.place {
        text += &print(&Line::Place(place.clone()));
    }
    let beside = path.with_extension("new");
    let mut file = OpenOptions::new().create(true).write(true).truncate(true).open(&beside)?;
    file.write_all(text.as_bytes())?;
    file.sync_all()?;
    std::fs::rename(&beside, path)?;
    if let Some(folder) = path.parent() {
        File::open(folder)?.sync_all()?;
    }
    Ok((file, text.len() as u64))
}

fn print(line: &Line) -> String {
    // Text, numbers and poses always encode.
    let json = serde_json::to_string(line).unwrap_or_default();
    format!("{:08x} {json}\n", crc32fast::hash(json.as_bytes()))
}

fn parse(line: &str) -> Option<Line> {
    let (sum, json) = line.split_once(' ')?;
    let sum = u32::from_str_radix(sum, 16).ok()?;
    if crc32fast::hash(json.as_bytes()) != sum {
        return None;
    }
    serde_json::from_str(json).ok()
}
