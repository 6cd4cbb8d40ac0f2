//! The pieces of a log as a replay wants them: JSON only, each message with the time it is due.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use wire::time::Timestamp;

use crate::bus::ChannelMessage;
use crate::reader::{IndexedLog, LogMessage, ReadError};

/// Pieces held.
const HELD: usize = 8;
/// Bytes of pieces held, beyond the one in use.
const HELD_BYTES: usize = 64 << 20;

/// A message with the latest log time up to it, so that times never go back.
#[derive(Debug, Clone)]
pub struct Entry {
    pub message: ChannelMessage,
    pub due: Timestamp,
}

/// A log's pieces, of which a few are held.
#[derive(Debug)]
pub struct Pieces {
    pub log: IndexedLog,
    /// The latest log time before each piece, and after the last.
    floors: Vec<Timestamp>,
    start: Timestamp,
    held: VecDeque<(usize, Arc<Vec<Entry>>, usize)>,
    /// Messages left out, by piece.
    skipped: BTreeMap<usize, usize>,
}

impl Pieces {
    pub fn new(log: IndexedLog) -> Pieces {
        let mut floors = vec![Timestamp(0)];
        for piece in log.pieces() {
            let last = floors.last().copied().unwrap_or(Timestamp(0));
            floors.push(last.max(piece.end));
        }
        let (held, skipped) = (VecDeque::new(), BTreeMap::new());
        Pieces { log, floors, start: Timestamp(0), held, skipped }
    }

    /// Time of the first message; `None` if there is none to play.
    pub fn first(&mut self) -> Result<Option<Timestamp>, ReadError> {
        let playable = self.log.channels().any(|(_, encoding)| &**encoding == "json");
        for piece in 0..self.count() {
            if !playable {
                break;
            }
            if let Some(first) = self.load(piece)?.first().map(|entry| entry.due) {
                self.start = first;
                return Ok(Some(first));
            }
        }
        Ok(None)
    }

    pub fn count(&self) -> usize {
        self.floors.len() - 1
    }

    pub fn start(&self) -> Timestamp {
        self.start
    }

    pub fn end(&self) -> Timestamp {
        self.floors.last().copied().unwrap_or(self.start)
    }

    /// The earliest time at which a message of a piece can be due.
    pub fn begin(&self, piece: usize) -> Option<Timestamp> {
        let (piece, floor) = (self.log.pieces().get(piece)?, self.floors.get(piece)?);
        Some(piece.start.max(*floor))
    }

    /// The first piece of which a message may be due after `at`.
    pub fn first_ending_after(&self, at: Timestamp) -> usize {
        self.floors[1..].partition_point(|&end| end <= at)
    }

    /// When the message at a place is due; the earliest it can be where its piece is not held.
    pub fn due(&self, (piece, within): (usize, usize)) -> Option<Timestamp> {
        match self.held.iter().find(|(held, ..)| *held == piece) {
            Some((_, entries, _)) if within < entries.len() => Some(entries[within].due),
            Some(_) => self.begin(piece + 1).or(Some(self.end())),
            None => self.begin(piece),
        }
    }

    /// The messages of a piece.
    pub fn load(&mut self, piece: usize) -> Result<Arc<Vec<Entry>>, ReadError> {
        if let Some(place) = self.held.iter().position(|(held, ..)| *held == piece)
            && let Some(found) = self.held.remove(place)
        {
            let entries = found.1.clone();
            self.held.push_front(found);
            return Ok(entries);
        }
        let mut due = self.floors.get(piece).copied().unwrap_or(Timestamp(0));
        let messages = self.log.read(piece)?;
        let (total, mut bytes) = (messages.len(), 0);
        let mut entries = Vec::with_capacity(total);
        for logged in messages {
            if &*logged.encoding != "json" || !is_json(&logged.data) {
                continue;
            }
            due = due.max(logged.log_time);
            bytes += logged.data.len() + 200;
            entries.push(Entry { message: message(logged), due });
        }
        self.skipped.insert(piece, total - entries.len());
        let entries = Arc::new(entries);
        self.held.push_front((piece, entries.clone(), bytes));
        while self.held.len() > HELD
            || (self.held.len() > 1
                && self.held.iter().map(|(.., bytes)| bytes).sum::<usize>() > HELD_BYTES)
        {
            self.held.pop_back();
        }
        Ok(entries)
    }

    pub fn skipped(&self) -> usize {
        self.skipped.values().sum()
    }
}

/// A message of a log as the bus gives it.
pub fn message(logged: LogMessage) -> ChannelMessage {
    ChannelMessage {
        channel: logged.channel,
        sequence: u64::from(logged.sequence),
        onboard_time: logged.publish_time,
        sent_time: logged.publish_time,
        received_time: logged.log_time,
        json: logged.data,
    }
}

fn is_json(data: &[u8]) -> bool {
    serde_json::from_slice::<serde::de::IgnoredAny>(data).is_ok()
}
