//! One direction of the link as a deterministic queue of discrete events.
//!
//! ```text
//! offer ─▶ queue of its class ─▶ transmitter ─▶ light time + jitter ─▶ take_due
//!             │ overflow, ttl       │ outage, loss        │ corruption
//! ```
//!
//! The transmitter serves the highest class first, one frame at a time, so that an E-stop waits for
//! one frame at most. A message arrives at the end of its last frame + the light time of that moment +
//! jitter; with `in_order` not before what was transmitted before it. E-stops are not held up by that
//! order, and come out first among what arrives at the same instant.
//!
//! Promises at every instant, whatever the order of calls:
//!
//! - nothing arrives before sent + size / rate + light time;
//! - [`LinkCounters`]: sent + duplicated = delivered + dropped (by cause) + in flight;
//! - a change of the model moves nothing that is under way;
//! - same seed and same calls, same trace; asking more or less often changes nothing of it.
//!
//! No clock: the caller gives the time. A time that goes back counts as the latest one seen. Bounded:
//! every class has its room in bytes, and all that waits or is under way together its number.

mod dice;
mod presets;
mod settings;

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use wire::live::{LinkClass, LinkCounters, QueueFill, WhenFull};
use wire::time::Timestamp;

use dice::Dice;
pub use presets::{PRESETS, preset};
pub use settings::{LinkError, MAX_DELAY_S, Settings, check};

/// Most notices kept for a caller that does not take them; the oldest give way.
const NOTICES_MAX: usize = 65_536;

/// The link has no room for another message. It was counted as dropped.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("{in_flight} messages wait or are under way, and the link takes no more of this class")]
pub struct QueueFull {
    /// Messages that wait or are under way.
    pub in_flight: usize,
}

/// A message that has arrived.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Delivered<T> {
    /// The message.
    pub item: T,
    /// Its class.
    pub class: LinkClass,
    /// When it was offered to the link.
    pub sent: Timestamp,
    /// When its first frame began.
    pub begun: Timestamp,
    /// When its last frame ended.
    pub transmitted: Timestamp,
    /// When it arrived.
    pub arrived: Timestamp,
    /// Its number among all that were offered, from 0. A copy has the number of its original.
    pub sequence: u64,
}

/// Why a message was dropped.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum DropCause {
    /// Lost on the way.
    Loss,
    /// Arrived damaged.
    Corruption,
    /// Would have been transmitted in an outage that loses.
    Outage,
    /// Waited longer than allowed.
    Ttl,
    /// Found no room, or gave way to another.
    Overflow,
}

/// What the link has to tell beside deliveries.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Notice<T> {
    /// A message has left: the end of its last frame, or what the sending end takes for that in an
    /// outage that loses.
    Transmitted {
        /// Its number.
        sequence: u64,
        /// The message.
        item: T,
        /// When.
        at: Timestamp,
        /// When it arrives at the earliest (its light time alone).
        arrives: Timestamp,
    },
    /// A message will not arrive. The sending end knows of [`DropCause::Ttl`] and
    /// [`DropCause::Overflow`] only; the others are for the record.
    Dropped {
        /// Its number.
        sequence: u64,
        /// The message.
        item: T,
        /// When.
        at: Timestamp,
        /// Why.
        cause: DropCause,
    },
}

#[derive(Debug)]
struct Waiting<T> {
    sequence: u64,
    sent: Timestamp,
    /// Bytes not yet transmitted.
    left: u32,
    begun: Option<Timestamp>,
    expires: Option<Timestamp>,
    lost: bool,
    corrupt: bool,
    item: T,
}

#[derive(Debug, Default)]
struct ClassQueue<T> {
    /// In order of sequence.
    messages: VecDeque<Waiting<T>>,
    bytes: u64,
}

#[derive(Debug, Clone, Copy)]
struct Sending {
    class: LinkClass,
    end: Timestamp,
    bytes: u32,
}

/// What happens next at the sending end; in this order at the same instant.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Step {
    FrameEnds,
    FrameBegins,
    Expires,
}

/// Arrival, not an E-stop, order of transmission.
type Arrival = (Timestamp, bool, u64);

/// One direction of the link.
#[derive(Debug)]
pub struct Direction<T> {
    settings: Settings,
    dice: Dice,
    capacity: usize,
    now: Timestamp,
    next_sequence: u64,
    next_order: u64,
    queues: [ClassQueue<T>; 6],
    expiries: BTreeSet<(Timestamp, LinkClass, u64)>,
    sending: Option<Sending>,
    last_arrival: Timestamp,
    flight: BTreeMap<Arrival, Delivered<T>>,
    /// Damaged messages under way: dropped on arrival.
    damaged: BTreeMap<(Timestamp, u64), (u64, bool, T)>,
    /// E-stops that wait or are under way.
    n_estops: usize,
    notices: VecDeque<Notice<T>>,
    counters: LinkCounters,
}

impl<T: Clone> Direction<T> {
    /// An idle link that takes at most `capacity` messages at once, and as many E-stops.
    pub fn new(settings: Settings, capacity: usize) -> Direction<T> {
        let queue = || ClassQueue { messages: VecDeque::new(), bytes: 0 };
        Direction {
            dice: Dice::new(settings.model().seed),
            settings,
            capacity,
            now: Timestamp(0),
            next_sequence: 0,
            next_order: 0,
            queues: std::array::from_fn(|_| queue()),
            expiries: BTreeSet::new(),
            sending: None,
            last_arrival: Timestamp(0),
            flight: BTreeMap::new(),
            damaged: BTreeMap::new(),
            n_estops: 0,
            notices: VecDeque::new(),
            counters: LinkCounters::default(),
        }
    }

    /// Hands a message of this size to the link; gives its number. In a full queue the rule of its
    /// class decides; with [`WhenFull::Reject`] this is an error.
    pub fn offer(
        &mut self,
        now: Timestamp,
        class: LinkClass,
        bytes: u32,
        item: T,
    ) -> Result<u64, QueueFull> {
        self.pump(now);
        let (now, bytes) = (self.now, bytes.max(1));
        let sequence = self.next_sequence;
        self.next_sequence += 1;
        self.counters.sent += 1;
        self.counters.bytes_sent += u64::from(bytes);
        self.counters.in_flight += 1;
        let rule = *self.settings.model().queues.of(class);
        if !self.make_room(class, bytes) {
            self.drop_message(sequence, now, DropCause::Overflow, item);
            return match rule.when_full {
                WhenFull::Reject => Err(QueueFull { in_flight: self.counters.in_flight as usize }),
                _ => Ok(sequence),
            };
        }
        let expires = rule.ttl_s.map(|ttl_s| now.plus_seconds(ttl_s));
        if let Some(expires) = expires {
            self.expiries.insert((expires, class, sequence));
        }
        let (begun, lost, corrupt) = (None, false, false);
        let message =
            Waiting { sequence, sent: now, left: bytes, begun, expires, lost, corrupt, item };
        let queue = &mut self.queues[class as usize];
        queue.messages.push_back(message);
        queue.bytes += u64::from(bytes);
        self.counters.queued += 1;
        self.n_estops += usize::from(class == LinkClass::Estop);
        self.pump(now);
        Ok(sequence)
    }

    /// Everything that has arrived by `now`, in order of arrival; E-stops first at equal times.
    pub fn take_due(&mut self, now: Timestamp) -> Vec<Delivered<T>> {
        self.pump(now);
        let mut due = Vec::new();
        while let Some(first) = self.flight.first_entry().filter(|e| e.key().0 <= self.now) {
            let delivered = first.remove();
            self.n_estops -= usize::from(delivered.class == LinkClass::Estop);
            due.push(delivered);
        }
        self.counters.delivered += due.len() as u64;
        self.counters.in_flight -= due.len() as u64;
        due
    }

    /// What has left or was dropped since the last call.
    pub fn take_notices(&mut self) -> Vec<Notice<T>> {
        self.notices.drain(..).collect()
    }

    /// When something happens next: [`Direction::take_due`] is wanted then.
    pub fn next_event(&self) -> Option<Timestamp> {
        let arrival = self.flight.keys().next().map(|(at, ..)| *at);
        let damaged = self.damaged.keys().next().map(|(at, _)| *at);
        let step = self.next_step().map(|(at, _)| at);
        arrival.into_iter().chain(damaged).chain(step).min()
    }

    /// Changes the model from `now` on. What is under way keeps its arrival; a frame that has begun
    /// ends when it would have.
    pub fn set(&mut self, now: Timestamp, settings: Settings) {
        self.pump(now);
        if settings.model().seed != self.settings.model().seed {
            self.dice = Dice::new(settings.model().seed);
        }
        self.settings = settings;
        self.pump(now);
    }

    /// The model.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// The counters at the latest time given.
    pub fn counters(&self) -> LinkCounters {
        self.counters
    }

    /// The queues in which something waits at the latest time given, highest class first.
    pub fn queues(&self) -> Vec<QueueFill> {
        let fill = |class: LinkClass| {
            let queue = &self.queues[class as usize];
            QueueFill {
                class,
                messages: queue.messages.len() as u64,
                bytes: queue.bytes,
                room_bytes: self.settings.model().queues.of(class).bytes,
            }
        };
        LinkClass::ALL.map(fill).into_iter().filter(|queue| queue.messages > 0).collect()
    }

    /// Handles everything at the sending end, and damaged arrivals, up to `now`.
    fn pump(&mut self, now: Timestamp) {
        let until = self.now.max(now);
        while let Some((at, step)) = self.next_step().filter(|(at, _)| *at <= until) {
            self.now = self.now.max(at);
            match step {
                Step::FrameEnds => self.end_frame(),
                Step::FrameBegins => self.begin_frame(),
                Step::Expires => self.expire(),
            }
        }
        self.now = until;
        while let Some(first) = self.damaged.first_entry().filter(|e| e.key().0 <= until) {
            let ((at, _), (sequence, is_estop, item)) = first.remove_entry();
            self.n_estops -= usize::from(is_estop);
            self.drop_message(sequence, at, DropCause::Corruption, item);
        }
    }

    fn next_step(&self) -> Option<(Timestamp, Step)> {
        let transmitter = match self.sending {
            Some(sending) => Some((sending.end, Step::FrameEnds)),
            None if self.counters.queued > 0 => {
                Some((self.settings.open_from(self.now), Step::FrameBegins))
            }
            None => None,
        };
        // Transmission may begin at the very end of the time to live.
        let expiry = self.expiries.first().map(|(at, ..)| (Timestamp(at.0 + 1), Step::Expires));
        transmitter.into_iter().chain(expiry).min()
    }

    fn begin_frame(&mut self) {
        let now = self.now;
        let waits = |class: &LinkClass| !self.queues[*class as usize].messages.is_empty();
        let Some(class) = LinkClass::ALL.into_iter().find(waits) else { return };
        if self.settings.loses(now) {
            let Some(Waiting { sequence, item, .. }) = self.remove(class, 0) else { return };
            // The sending end transmits into the void and knows nothing of it.
            let arrives = Timestamp(now.0.saturating_add(self.settings.light_ns(now)));
            self.notice(Notice::Transmitted { sequence, item: item.clone(), at: now, arrives });
            self.drop_message(sequence, now, DropCause::Outage, item);
            return;
        }
        let mtu = self.settings.model().mtu_bytes;
        let Some(message) = self.queues[class as usize].messages.front_mut() else { return };
        if message.begun.is_none() {
            message.begun = Some(now);
            if let Some(expires) = message.expires.take() {
                self.expiries.remove(&(expires, class, message.sequence));
            }
        }
        let bytes = message.left.min(mtu);
        self.sending = Some(Sending { class, end: self.settings.frame_end(now, bytes), bytes });
    }

    fn end_frame(&mut self) {
        let Some(Sending { class, end, bytes }) = self.sending.take() else { return };
        self.counters.bytes_transmitted += u64::from(bytes);
        let (lost, corrupt) = self.dice.frame(self.settings.model());
        let queue = &mut self.queues[class as usize];
        let Some(message) = queue.messages.front_mut() else { return };
        queue.bytes -= u64::from(bytes);
        message.left -= bytes;
        message.lost |= lost;
        message.corrupt |= corrupt;
        if message.left == 0
            && let Some(message) = queue.messages.pop_front()
        {
            self.counters.queued -= 1;
            self.launch(class, end, message);
        }
    }

    /// A message has left: it is lost, or on its way, perhaps with a copy.
    fn launch(&mut self, class: LinkClass, end: Timestamp, message: Waiting<T>) {
        let Waiting { sequence, sent, begun, lost, corrupt, item, .. } = message;
        let begun = begun.unwrap_or(end);
        let light = Timestamp(end.0.saturating_add(self.settings.light_ns(end)));
        self.notice(Notice::Transmitted { sequence, item: item.clone(), at: end, arrives: light });
        if lost {
            self.n_estops -= usize::from(class == LinkClass::Estop);
            self.drop_message(sequence, end, DropCause::Loss, item);
            return;
        }
        let again = self.dice.again(self.settings.model());
        if let Some(copy_corrupt) = again {
            self.counters.duplicated += 1;
            self.counters.in_flight += 1;
            self.n_estops += usize::from(class == LinkClass::Estop);
            let (transmitted, arrived, copy) = (end, light, item.clone());
            let flight = Delivered { item, class, sent, begun, transmitted, arrived, sequence };
            self.fly(flight, corrupt);
            let flight =
                Delivered { item: copy, class, sent, begun, transmitted, arrived, sequence };
            self.fly(flight, copy_corrupt);
        } else {
            let (transmitted, arrived) = (end, light);
            self.fly(
                Delivered { item, class, sent, begun, transmitted, arrived, sequence },
                corrupt,
            );
        }
    }

    /// `flight.arrived` is the light time alone.
    fn fly(&mut self, mut flight: Delivered<T>, corrupt: bool) {
        let jitter_ns = self.dice.jitter_ns(&self.settings.model().jitter);
        flight.arrived = Timestamp(flight.arrived.0.saturating_add(jitter_ns));
        let is_estop = flight.class == LinkClass::Estop;
        if !is_estop && self.settings.model().in_order {
            flight.arrived = flight.arrived.max(self.last_arrival);
        }
        if !is_estop {
            self.last_arrival = self.last_arrival.max(flight.arrived);
        }
        let order = self.next_order;
        self.next_order += 1;
        if corrupt {
            let Delivered { arrived, sequence, item, .. } = flight;
            self.damaged.insert((arrived, order), (sequence, is_estop, item));
        } else {
            self.flight.insert((flight.arrived, !is_estop, order), flight);
        }
    }

    fn expire(&mut self) {
        let Some((expires, class, sequence)) = self.expiries.pop_first() else { return };
        let messages = &self.queues[class as usize].messages;
        let Ok(at) = messages.binary_search_by_key(&sequence, |message| message.sequence) else {
            return;
        };
        if let Some(message) = self.remove(class, at) {
            self.drop_message(sequence, expires, DropCause::Ttl, message.item);
        }
    }

    /// Room for a message of a class, made by what gives way if its rule says so.
    fn make_room(&mut self, class: LinkClass, bytes: u32) -> bool {
        let rule = *self.settings.model().queues.of(class);
        let bytes = u64::from(bytes);
        if bytes > rule.bytes {
            return false;
        }
        loop {
            // The new message is counted as under way already.
            let is_estop = class == LinkClass::Estop;
            let others = self.counters.in_flight as usize - 1 - self.n_estops;
            let number = if is_estop { self.n_estops } else { others };
            if number < self.capacity && self.queues[class as usize].bytes + bytes <= rule.bytes {
                return true;
            }
            let messages = &self.queues[class as usize].messages;
            let oldest = messages.iter().position(|message| message.begun.is_none());
            let gives_way = rule.when_full == WhenFull::DropOldest;
            let Some(message) = oldest.filter(|_| gives_way).and_then(|at| self.remove(class, at))
            else {
                return false;
            };
            self.drop_message(message.sequence, self.now, DropCause::Overflow, message.item);
        }
    }

    /// Takes a waiting message out of its queue.
    fn remove(&mut self, class: LinkClass, at: usize) -> Option<Waiting<T>> {
        let queue = &mut self.queues[class as usize];
        let message = queue.messages.remove(at)?;
        queue.bytes -= u64::from(message.left);
        self.counters.queued -= 1;
        self.n_estops -= usize::from(class == LinkClass::Estop);
        if let Some(expires) = message.expires {
            self.expiries.remove(&(expires, class, message.sequence));
        }
        Some(message)
    }

    fn drop_message(&mut self, sequence: u64, at: Timestamp, cause: DropCause, item: T) {
        self.counters.dropped += 1;
        self.counters.in_flight -= 1;
        let by = &mut self.counters.dropped_by;
        *match cause {
            DropCause::Loss => &mut by.loss,
            DropCause::Corruption => &mut by.corruption,
            DropCause::Outage => &mut by.outage,
            DropCause::Ttl => &mut by.ttl,
            DropCause::Overflow => &mut by.overflow,
        } += 1;
        self.notice(Notice::Dropped { sequence, item, at, cause });
    }

    fn notice(&mut self, notice: Notice<T>) {
        if self.notices.len() == NOTICES_MAX {
            self.notices.pop_front();
        }
        self.notices.push_back(notice);
    }
}
