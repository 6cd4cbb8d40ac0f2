//! One direction of the link: a delay line, pure and deterministic.
//!
//! Three promises hold at every instant, whatever the order of calls:
//!
//! - nothing arrives before the time it was sent plus the delay at that time;
//! - [`LinkCounters`]: sent = delivered + dropped + in flight;
//! - messages in order (all but [`Priority::Urgent`]) arrive in the order they were offered, also
//!   after the delay was made shorter: a later message waits for the ones before it.
//!
//! An urgent message waits for nothing but its own light time: it passes whatever is in order
//! before it, and comes out first among those that arrive at the same instant. Two urgent messages
//! keep their order unless the delay was made shorter between them.
//!
//! Jitter, rate and loss come in front of the light time when they come; the interface leaves room.
//! No clock: the caller gives the time. A time that goes back counts as the latest one seen.

use std::collections::VecDeque;

use wire::live::LinkCounters;
use wire::time::Timestamp;

/// Longest one-way delay that can be set (s): beyond Mars at its farthest.
pub const MAX_DELAY_S: f64 = 1800.0;

/// How a message is treated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Priority {
    /// In order; refused when the line is full.
    Normal,
    /// In order with the normal ones; the oldest of these gives way when the line is full.
    Expendable,
    /// Passes everything. Has room of its own.
    Urgent,
}

/// The line has no room for another message. The message was counted as dropped.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("{in_flight} messages are under way, which is all the link takes")]
pub struct QueueFull {
    /// Messages under way.
    pub in_flight: usize,
}

/// A delay that cannot be set.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error("{field} is {delay_s} s; a delay is between 0 and 1800 s")]
pub struct BadDelay {
    /// The field of the request.
    pub field: &'static str,
    /// The value (s).
    pub delay_s: f64,
}

/// A message that has arrived.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Delivered<T> {
    /// The message.
    pub item: T,
    /// When it was offered to the link.
    pub sent: Timestamp,
    /// When it arrived.
    pub arrived: Timestamp,
    /// Its number among all that were offered, from 0.
    pub sequence: u64,
}

#[derive(Debug)]
struct InFlight<T> {
    delivery: Delivered<T>,
    expendable: bool,
}

/// One direction of the link.
#[derive(Debug)]
pub struct DelayLine<T> {
    delay_ns: u64,
    capacity: usize,
    latest: Timestamp,
    next_sequence: u64,
    /// In order of offering, which is also the order of arrival.
    line: VecDeque<InFlight<T>>,
    /// Sorted by arrival, then sequence.
    urgent: VecDeque<Delivered<T>>,
    counters: LinkCounters,
}

impl<T> DelayLine<T> {
    /// A line with the given delay (s, see [`MAX_DELAY_S`]) that holds at most `capacity` messages
    /// in order, and as many urgent ones.
    pub fn new(delay_s: f64, capacity: usize) -> Result<DelayLine<T>, BadDelay> {
        Ok(DelayLine {
            delay_ns: nanos(delay_s)?,
            capacity,
            latest: Timestamp(0),
            next_sequence: 0,
            line: VecDeque::new(),
            urgent: VecDeque::new(),
            counters: LinkCounters::default(),
        })
    }

    /// Hands a message to the link; gives its number. A full line refuses a normal message,
    /// gives up its oldest expendable one for an expendable one, and both count as dropped.
    pub fn offer(&mut self, now: Timestamp, priority: Priority, item: T) -> Result<u64, QueueFull> {
        let sent = self.tick(now);
        let sequence = self.next_sequence;
        self.next_sequence += 1;
        self.counters.sent += 1;
        let mut arrived = Timestamp(sent.0.saturating_add(self.delay_ns));
        if priority == Priority::Urgent {
            if self.urgent.len() >= self.capacity {
                return Err(self.refuse(self.urgent.len()));
            }
            let at = self.urgent.partition_point(|u| u.arrived <= arrived);
            self.urgent.insert(at, Delivered { item, sent, arrived, sequence });
        } else {
            let expendable = priority == Priority::Expendable;
            if self.line.len() >= self.capacity && !(expendable && self.give_up_oldest()) {
                return Err(self.refuse(self.line.len()));
            }
            if let Some(before) = self.line.back() {
                arrived = arrived.max(before.delivery.arrived);
            }
            let delivery = Delivered { item, sent, arrived, sequence };
            self.line.push_back(InFlight { delivery, expendable });
        }
        self.counters.in_flight += 1;
        Ok(sequence)
    }

    /// Everything that has arrived by `now`, in order of arrival; urgent first at equal times.
    pub fn take_due(&mut self, now: Timestamp) -> Vec<Delivered<T>> {
        let now = self.tick(now);
        let mut due = Vec::new();
        loop {
            let urgent = self.urgent.front().map(|u| u.arrived).filter(|&t| t <= now);
            let inline = self.line.front().map(|m| m.delivery.arrived).filter(|&t| t <= now);
            let next = match (urgent, inline) {
                (Some(u), Some(i)) if i < u => self.line.pop_front().map(|m| m.delivery),
                (Some(_), _) => self.urgent.pop_front(),
                (None, Some(_)) => self.line.pop_front().map(|m| m.delivery),
                (None, None) => break,
            };
            due.extend(next);
        }
        self.counters.delivered += due.len() as u64;
        self.counters.in_flight -= due.len() as u64;
        due
    }

    /// When the next message arrives, if one is under way.
    pub fn next_arrival(&self) -> Option<Timestamp> {
        let urgent = self.urgent.front().map(|u| u.arrived);
        let inline = self.line.front().map(|m| m.delivery.arrived);
        urgent.into_iter().chain(inline).min()
    }

    /// Sets the delay (s) of what is offered from `now` on; what is under way keeps its arrival.
    pub fn set_delay(&mut self, now: Timestamp, delay_s: f64) -> Result<(), BadDelay> {
        self.delay_ns = nanos(delay_s)?;
        self.tick(now);
        Ok(())
    }

    /// The delay (s) of what is offered now.
    pub fn delay_s(&self) -> f64 {
        self.delay_ns as f64 / 1e9
    }

    /// The counters at this instant.
    pub fn counters(&self) -> LinkCounters {
        self.counters
    }

    fn tick(&mut self, now: Timestamp) -> Timestamp {
        self.latest = self.latest.max(now);
        self.latest
    }

    fn refuse(&mut self, in_flight: usize) -> QueueFull {
        self.counters.dropped += 1;
        QueueFull { in_flight }
    }

    fn give_up_oldest(&mut self) -> bool {
        let Some(oldest) = self.line.iter().position(|m| m.expendable) else { return false };
        self.line.remove(oldest);
        self.counters.dropped += 1;
        self.counters.in_flight -= 1;
        true
    }
}

fn nanos(delay_s: f64) -> Result<u64, BadDelay> {
    if !(0.0..=MAX_DELAY_S).contains(&delay_s) {
        return Err(BadDelay { field: "delay_s", delay_s });
    }
    Ok((delay_s * 1e9).round() as u64)
}
