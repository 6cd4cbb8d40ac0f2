//! A log, played through the same channels as the live rover.
//!
//! A replay gives [`ChannelMessage`]s and nothing else: it knows neither adapters nor uplinks, so it
//! cannot reach a rover. No clock: the caller gives the time. Messages come in the order of the
//! log, byte for byte as recorded; a message of an earlier time than the one before it is due with
//! that one.

use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

use bytes::Bytes;
use wire::live::channel;
use wire::resources::ReplayState;
use wire::time::Timestamp;

use crate::bus::ChannelMessage;
use crate::reader::{Damage, LogContent};

/// Slowest and fastest speed.
pub const RATES: std::ops::RangeInclusive<f64> = 0.1..=1000.0;
/// Most messages of one [`Replay::advance`]; the rest comes with the next.
pub const ADVANCE_MAX: usize = 20_000;
/// Most commands whose last event a seek gives; the newest ones.
const SEEK_COMMANDS: usize = 1000;

/// Why a replay does not begin or change.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ReplayError {
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
    messages: Vec<Entry>,
    /// Positions in `messages` of each piece of state, see [`state_key`].
    states: BTreeMap<String, Vec<usize>>,
    /// The first message not given yet.
    next: usize,
    /// The place in the log at `anchor_now`.
    at: Timestamp,
    anchor_now: Timestamp,
    rate: f64,
    paused: bool,
    damage: Vec<Damage>,
    skipped: usize,
}

#[derive(Debug)]
struct Entry {
    message: ChannelMessage,
    /// The latest log time up to here, so that times never go back.
    due: Timestamp,
}

impl Replay {
    /// Begins a replay at `from`, or at the log's first message. Messages that are not JSON are
    /// left out, see [`Replay::skipped`].
    pub fn open(
        now: Timestamp,
        id: &str,
        log: &str,
        content: LogContent,
        from: Option<Timestamp>,
        rate: f64,
    ) -> Result<Replay, ReplayError> {
        check_rate(rate)?;
        let total = content.messages.len();
        let mut messages = Vec::with_capacity(total);
        let mut states = BTreeMap::<String, Vec<usize>>::new();
        let mut due = Timestamp(0);
        for logged in content.messages {
            if &*logged.encoding != "json" || !is_json(&logged.data) {
                continue;
            }
            due = due.max(logged.log_time);
            if let Some(key) = state_key(&logged.channel, &logged.data) {
                states.entry(key).or_default().push(messages.len());
            }
            let message = ChannelMessage {
                channel: logged.channel,
                sequence: u64::from(logged.sequence),
                onboard_time: logged.publish_time,
                sent_time: logged.publish_time,
                received_time: logged.log_time,
                json: logged.data,
            };
            messages.push(Entry { message, due });
        }
        let Some(first) = messages.first() else {
            return Err(ReplayError::Empty { log: log.into() });
        };
        let (at, skipped) = (first.due, total - messages.len());
        let mut replay = Replay {
            id: id.into(),
            log: log.into(),
            messages,
            states,
            next: 0,
            at,
            anchor_now: now,
            rate,
            paused: false,
            damage: content.damage,
            skipped,
        };
        if let Some(from) = from {
            replay.place(now, from);
        }
        Ok(replay)
    }

    /// The messages that have become due since the last call, in the order of the log.
    pub fn advance(&mut self, now: Timestamp) -> Vec<ChannelMessage> {
        let at = self.position(now);
        let due = self.messages[self.next..].partition_point(|entry| entry.due <= at);
        let last = self.next + due.min(ADVANCE_MAX);
        let given = self.messages[self.next..last].iter().map(|e| e.message.clone()).collect();
        self.next = last;
        given
    }

    /// Goes to `at`, within the log, and gives the state there: the latest message of each state
    /// channel and of each command (the newest 1000), in the order of the log. Messages after `at`
    /// follow.
    pub fn seek(&mut self, now: Timestamp, at: Timestamp) -> Vec<ChannelMessage> {
        self.place(now, at);
        self.snapshot()
    }

    /// The state where the replay is, as [`Replay::seek`] gives it; for a listener that has just
    /// come.
    pub fn snapshot(&self) -> Vec<ChannelMessage> {
        let latest = |places: &Vec<usize>| {
            let before = places.partition_point(|&place| place < self.next);
            before.checked_sub(1).map(|last| places[last])
        };
        let of_commands = format!("{}\n", channel::COMMAND_EVENT);
        let (mut commands, mut shown) = (Vec::new(), Vec::new());
        for (key, places) in &self.states {
            let list = if key.starts_with(&of_commands) { &mut commands } else { &mut shown };
            list.extend(latest(places));
        }
        commands.sort_unstable();
        shown.extend(commands.iter().rev().take(SEEK_COMMANDS));
        shown.sort_unstable();
        shown.into_iter().map(|place| self.messages[place].message.clone()).collect()
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
            start: self.start(),
            end: self.end(),
            at: self.position(now),
            rate: self.rate,
            paused: self.paused,
            ended: self.next == self.messages.len(),
        }
    }

    /// When the next message is due, at the present speed; `None` while held or at the end.
    pub fn next_due(&self) -> Option<Timestamp> {
        let next = self.messages.get(self.next).filter(|_| !self.paused)?;
        Some(self.anchor_now.plus_seconds(next.due.seconds_since(self.at).max(0.0) / self.rate))
    }

    /// What is wrong with the log.
    pub fn damage(&self) -> &[Damage] {
        &self.damage
    }

    /// Messages left out because they are not JSON.
    pub fn skipped(&self) -> usize {
        self.skipped
    }

    fn start(&self) -> Timestamp {
        self.messages.first().map_or(self.at, |entry| entry.due)
    }

    fn end(&self) -> Timestamp {
        self.messages.last().map_or(self.at, |entry| entry.due)
    }

    fn position(&self, now: Timestamp) -> Timestamp {
        if self.paused {
            return self.at;
        }
        let elapsed_s = now.seconds_since(self.anchor_now).max(0.0);
        self.at.plus_seconds(elapsed_s * self.rate).min(self.end())
    }

    fn anchor(&mut self, now: Timestamp) {
        self.at = self.position(now);
        self.anchor_now = self.anchor_now.max(now);
    }

    /// What is at or before the place counts as given.
    fn place(&mut self, now: Timestamp, at: Timestamp) {
        self.at = at.clamp(self.start(), self.end());
        self.anchor_now = now;
        self.next = self.messages.partition_point(|entry| entry.due <= self.at);
    }
}

fn check_rate(rate: f64) -> Result<(), ReplayError> {
    if RATES.contains(&rate) { Ok(()) } else { Err(ReplayError::BadRate { rate }) }
}

fn is_json(data: &Bytes) -> bool {
    serde_json::from_slice::<serde::de::IgnoredAny>(data).is_ok()
}

/// What a message is the latest word on: its channel, or its command. `None` for happenings.
fn state_key(name: &Arc<str>, data: &Bytes) -> Option<String> {
    match &**name {
        channel::COMMAND_EVENT => {
            let event: HashMap<String, serde_json::Value> = serde_json::from_slice(data).ok()?;
            let id = event.get("command")?.get("id")?.as_str()?;
            Some(format!("{name}\n{id}"))
        }
        channel::COMMAND_UPLINK | channel::EVENT | channel::JOB => None,
        _ => Some(name.to_string()),
    }
}
