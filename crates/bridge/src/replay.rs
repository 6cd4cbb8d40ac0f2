//! A log, played through the same channels as the live rover.
//!
//! A replay gives [`ChannelMessage`]s and nothing else: it knows neither adapters nor uplinks, so it
//! cannot reach a rover. No clock: the caller gives the time. Messages come in the order of the
//! log, byte for byte as recorded; a message of an earlier time than the one before it is due with
//! that one. The log is read piece by piece ([`IndexedLog`]), and few pieces are held.

mod earlier;
mod pieces;
mod state;

use wire::resources::ReplayState;
use wire::time::Timestamp;

use crate::bus::ChannelMessage;
use crate::reader::{Damage, IndexedLog, ReadError};

pub use earlier::Place;
use pieces::Pieces;

/// Slowest and fastest speed.
pub const RATES: std::ops::RangeInclusive<f64> = 0.1..=1000.0;
/// Most messages of one [`Replay::advance`]; the rest comes with the next.
pub const ADVANCE_MAX: usize = 20_000;

/// Why a replay does not begin or change.
#[derive(Debug, thiserror::Error)]
pub enum ReplayError {
    /// The log cannot be read.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// Nothing to play.
    #[error("the log {log} holds no messages that can be played")]
    Empty {
        /// The log.
        log: String,
    },
    /// A speed out of range.
    #[error("rate is {rate}; it goes from 0.1 to 1000")]
    BadRate {
        /// The value.
        rate: f64,
    },
}

impl ReplayError {
    /// A stable word for programs.
    pub fn code(&self) -> &'static str {
        match self {
            ReplayError::Read(error) => error.code(),
            ReplayError::Empty { .. } => "log_empty",
            ReplayError::BadRate { .. } => "rate_invalid",
        }
    }
}

/// A log being played.
#[derive(Debug)]
pub struct Replay {
    id: String,
    log: String,
    pieces: Pieces,
    /// The first message not given yet: its piece, and its place there.
    next: (usize, usize),
    /// The place in the log at `anchor_now`.
    at: Timestamp,
    anchor_now: Timestamp,
    rate: f64,
    paused: bool,
}

impl Replay {
    /// Begins a replay at `from`, or at the log's first message. Messages that are not JSON are
    /// left out, see [`Replay::skipped`].
    pub fn open(
        now: Timestamp,
        id: &str,
        log: &str,
        content: impl Into<IndexedLog>,
        from: Option<Timestamp>,
        rate: f64,
    ) -> Result<Replay, ReplayError> {
        check_rate(rate)?;
        let mut pieces = Pieces::new(content.into());
        let Some(first) = pieces.first()? else {
            return Err(ReplayError::Empty { log: log.into() });
        };
        let mut replay = Replay {
            id: id.into(),
            log: log.into(),
            pieces,
            next: (0, 0),
            at: first,
            anchor_now: now,
            rate,
            paused: false,
        };
        if let Some(from) = from {
            replay.put(now, from)?;
        }
        Ok(replay)
    }

    /// The messages that have become due since the last call, in the order of the log.
    pub fn advance(&mut self, now: Timestamp) -> Result<Vec<ChannelMessage>, ReplayError> {
        let at = self.position(now);
        let mut given = Vec::new();
        while given.len() < ADVANCE_MAX && self.pieces.begin(self.next.0).is_some_and(|t| t <= at) {
            let piece = self.pieces.load(self.next.0)?;
            let rest = piece.get(self.next.1..).unwrap_or_default();
            let due = rest.partition_point(|entry| entry.due <= at).min(ADVANCE_MAX - given.len());
            given.extend(rest[..due].iter().map(|entry| entry.message.clone()));
            if due < rest.len() {
                self.next.1 += due;
                break;
            }
            self.next = (self.next.0 + 1, 0);
        }
        Ok(given)
    }

    /// Goes to the next message and gives it, whenever it was; `None` at the end. Holds there.
    pub fn step(&mut self, now: Timestamp) -> Result<Option<ChannelMessage>, ReplayError> {
        self.paused = true;
        self.anchor_now = self.anchor_now.max(now);
        while self.next.0 < self.pieces.count() {
            let piece = self.pieces.load(self.next.0)?;
            if let Some(entry) = piece.get(self.next.1) {
                (self.at, self.next.1) = (entry.due.max(self.at), self.next.1 + 1);
                return Ok(Some(entry.message.clone()));
            }
            self.next = (self.next.0 + 1, 0);
        }
        Ok(None)
    }

    /// Goes to `at`, within the log, and gives the state there: the latest message of each state
    /// channel and of each command (the newest 1000), in the order of their times. Messages after
    /// `at` follow.
    pub fn seek(
        &mut self,
        now: Timestamp,
        at: Timestamp,
    ) -> Result<Vec<ChannelMessage>, ReplayError> {
        self.put(now, at)?;
        self.snapshot()
    }

    /// The state where the replay is, as [`Replay::seek`] gives it; for a listener that has just
    /// come.
    pub fn snapshot(&mut self) -> Result<Vec<ChannelMessage>, ReplayError> {
        state::snapshot(&mut self.pieces, self.next)
    }

    /// Sets the speed, within [`RATES`].
    pub fn set_rate(&mut self, now: Timestamp, rate: f64) -> Result<(), ReplayError> {
        check_rate(rate)?;
        self.anchor(now);
        self.rate = rate;
        Ok(())
    }

    /// Holds.
    pub fn pause(&mut self, now: Timestamp) {
        self.anchor(now);
        self.paused = true;
    }

    /// Goes on.
    pub fn resume(&mut self, now: Timestamp) {
        self.anchor(now);
        self.paused = false;
    }

    /// The replay as it is.
    pub fn state(&self, now: Timestamp) -> ReplayState {
        ReplayState {
            id: self.id.clone(),
            log: self.log.clone(),
            start: self.pieces.start(),
            end: self.pieces.end(),
            at: self.position(now),
            rate: self.rate,
            paused: self.paused,
            ended: self.ended(),
        }
    }

    /// When the next message is due, at the present speed; `None` while held or at the end. Early,
    /// where that message stands in a piece that was not read yet.
    pub fn next_due(&self) -> Option<Timestamp> {
        if self.paused || self.ended() {
            return None;
        }
        let due = self.pieces.due(self.next)?;
        Some(self.anchor_now.plus_seconds(due.seconds_since(self.at).max(0.0) / self.rate))
    }

    /// What is wrong with the log, as far as it was met.
    pub fn damage(&self) -> &[Damage] {
        self.pieces.log.damage()
    }

    /// Messages left out because they are not JSON, in the pieces read so far.
    pub fn skipped(&self) -> usize {
        self.pieces.skipped()
    }

    fn ended(&self) -> bool {
        self.next.0 >= self.pieces.count()
    }

    fn position(&self, now: Timestamp) -> Timestamp {
        if self.paused {
            return self.at;
        }
        let elapsed_s = now.seconds_since(self.anchor_now).max(0.0);
        self.at.plus_seconds(elapsed_s * self.rate).min(self.pieces.end())
    }

    fn anchor(&mut self, now: Timestamp) {
        self.at = self.position(now);
        self.anchor_now = self.anchor_now.max(now);
    }

    /// What is at or before the place counts as given.
    fn put(&mut self, now: Timestamp, at: Timestamp) -> Result<(), ReplayError> {
        self.at = at.clamp(self.pieces.start(), self.pieces.end());
        self.anchor_now = now;
        let piece = self.pieces.first_ending_after(self.at);
        let within = match piece < self.pieces.count() {
            true => self.pieces.load(piece)?.partition_point(|entry| entry.due <= self.at),
            false => 0,
        };
        self.next = (piece, within);
        Ok(())
    }
}

fn check_rate(rate: f64) -> Result<(), ReplayError> {
    if RATES.contains(&rate) { Ok(()) } else { Err(ReplayError::BadRate { rate }) }
}
