//! One end of a carrier: what is to be said, what was said and is not confirmed, what was heard.
//!
//! No I/O and no clock: bytes and times come in, bytes come out. The same code serves both ends.

use std::collections::VecDeque;
use std::marker::PhantomData;

use serde::Serialize;
use serde::de::DeserializeOwned;
use wire::live::{CarrierCounters, CarrierState, LinkClass};
use wire::time::Timestamp;

use super::clocks::PeerClock;
use super::frame::{
    BODY_MAX, Body, CarrierError, Decoder, GREETING_MAX, Hello, PROTOCOL, Side, encode,
    encode_message,
};

/// What is carried.
pub trait Parcel: Serialize {
    /// Its class: an E-stop passes what waits and ends the commands among it, bulk goes last,
    /// telemetry gives way when too much waits, commands are not carried late.
    fn class(&self) -> LinkClass;
}

/// Who an end is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Identity {
    /// Which end.
    pub side: Side,
    /// This run of this process.
    pub run: String,
    /// Digest of the robot model.
    pub robot: String,
}

/// Times and bounds of an end.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    /// Time between two beats (s).
    pub beat_s: f64,
    /// A connection on which nothing is heard for so long (s) is ended.
    pub silence_s: f64,
    /// A command that could not be handed over for so long (s) is taken back.
    pub command_s: f64,
    /// Most messages written and not confirmed.
    pub window: usize,
    /// Most bytes written and not confirmed; a single message may be larger.
    pub window_bytes: usize,
    /// Most messages that wait, bulk apart: ten minutes of telemetry.
    pub waiting: usize,
    /// Most bytes that wait, bulk apart, and as many of bulk.
    pub waiting_bytes: usize,
}

impl Default for Bounds {
    fn default() -> Self {
        Bounds {
            beat_s: 0.5,
            silence_s: 2.5,
            command_s: 10.0,
            window: 256,
            window_bytes: 1 << 20,
            waiting: 6000,
            waiting_bytes: 64 << 20,
        }
    }
}

/// What became of a message that will not be carried.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fate {
    /// The other end has never seen it, and never will.
    NeverArrived(Reason),
    /// It was written, and the other end that could tell is gone.
    Unknown,
}

/// Why a message was taken back.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reason {
    /// It waited longer than a command may.
    TooOld,
    /// An E-stop came before it was written.
    Estop,
    /// The other end was restarted before it was written.
    Restarted,
    /// Too many waited.
    Full,
}

impl Reason {
    /// In words, to be read after "not handed over to the rover".
    pub fn text(self) -> &'static str {
        match self {
            Reason::TooOld => {
                "the connection to the rover was down for longer than a command waits"
            }
            Reason::Estop => "an E-stop came before it was handed over",
            Reason::Restarted => "the rover's process was restarted before it was handed over",
            Reason::Full => "too many messages wait for the rover",
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    Down,
    /// The connection is there; the other end's greeting is awaited.
    Greeting,
    Up,
}

struct Item<O> {
    message: O,
    json: Vec<u8>,
    class: LinkClass,
    since: Timestamp,
}

/// One end of a carrier for messages `O` out and `I` in.
pub struct End<O, I> {
    identity: Identity,
    bounds: Bounds,
    phase: Phase,
    state: CarrierState,
    since: Timestamp,
    opened: Timestamp,
    heard: Option<Timestamp>,
    why: Option<String>,
    decoder: Decoder,
    control: Vec<u8>,
    urgent: VecDeque<Item<O>>,
    ordered: VecDeque<Item<O>>,
    ordered_bytes: usize,
    bulk: VecDeque<Item<O>>,
    bulk_bytes: usize,
    /// Numbered and not confirmed, in order; none where it was taken back.
    window: VecDeque<(u64, Option<Item<O>>)>,
    window_bytes: usize,
    /// The last number given.
    numbered: u64,
    /// The last number written on this connection.
    written: u64,
    peer_run: Option<String>,
    /// The last number received, in order.
    received: u64,
    /// The last number taken over here, and the last that was told so.
    taken: u64,
    told: u64,
    /// Counts the runs of the other end, so that what came from an earlier one confirms nothing.
    era: u64,
    /// Taken by [`End::take_one`], not confirmed yet.
    taking: Option<u64>,
    inbox: VecDeque<(u64, u64, Result<I, String>)>,
    lost: Vec<(O, Fate)>,
    fresh: bool,
    beat: Timestamp,
    clock: PeerClock,
    counters: CarrierCounters,
    incoming: PhantomData<I>,
}

impl<O: Parcel, I: DeserializeOwned> End<O, I> {
    /// An end without a connection at `now`.
    pub fn new(now: Timestamp, identity: Identity, bounds: Bounds) -> End<O, I> {
        End {
            identity,
            bounds,
            phase: Phase::Down,
            state: CarrierState::Connecting,
            since: now,
            opened: now,
            heard: None,
            why: None,
            decoder: Decoder::default(),
            control: Vec::new(),
            urgent: VecDeque::new(),
            ordered: VecDeque::new(),
            ordered_bytes: 0,
            bulk: VecDeque::new(),
            bulk_bytes: 0,
            window: VecDeque::new(),
            window_bytes: 0,
            numbered: 0,
            written: 0,
            peer_run: None,
            received: 0,
            taken: 0,
            told: 0,
            era: 0,
            taking: None,
            inbox: VecDeque::new(),
            lost: Vec::new(),
            fresh: false,
            beat: now,
            clock: PeerClock::default(),
            counters: CarrierCounters::default(),
            incoming: PhantomData,
        }
    }

    /// Times and bounds.
    pub fn bounds(&self) -> Bounds {
        self.bounds
    }

    /// How it is, since when, when anything was heard, and why it is not up.
    pub fn state(&self) -> (CarrierState, Timestamp, Option<Timestamp>, Option<&str>) {
        (self.state, self.since, self.heard, self.why.as_deref())
    }

    /// Do both ends hear each other?
    pub fn is_up(&self) -> bool {
        self.phase == Phase::Up
    }

    /// What was counted.
    pub fn counters(&self) -> CarrierCounters {
        CarrierCounters {
            waiting: (self.urgent.len() + self.ordered.len() + self.bulk.len()) as u64,
            unconfirmed: self.window.iter().filter(|(_, item)| item.is_some()).count() as u64,
            ..self.counters
        }
    }

    /// By how much the other end's clock is ahead of this one's (s); zero where that cannot be told
    /// from the way between them.
    pub fn peer_ahead_s(&self) -> f64 {
        self.clock.ahead_s()
    }

    /// Hands a message over to be carried.
    pub fn push(&mut self, now: Timestamp, message: O) {
        let class = message.class();
        // Who is there is told to who hears it, not later.
        if class == LinkClass::Housekeeping && self.phase != Phase::Up {
            return;
        }
        self.counters.sent += 1;
        let json = match serde_json::to_vec(&message) {
            Ok(json) if json.len() < BODY_MAX / 2 => json,
            _ => {
                tracing::error!("a message cannot be carried: it does not encode, or is too large");
                self.counters.dropped += 1;
                return;
            }
        };
        let item = Item { message, json, class, since: now };
        match class {
            LinkClass::Estop => {
                self.end_commands();
                if self.urgent.iter().any(|waiting| waiting.json == item.json) {
                    // The same E-stop again: one is enough.
                    self.counters.withdrawn += 1;
                } else {
                    self.urgent.push_back(item);
                }
            }
            LinkClass::Bulk => {
                self.bulk_bytes += item.json.len();
                self.bulk.push_back(item);
                while self.bulk_bytes > self.bounds.waiting_bytes && self.bulk.len() > 1 {
                    let oldest = self.bulk.pop_front();
                    self.bulk_bytes -= oldest.map_or(0, |item| item.json.len());
                    self.counters.dropped += 1;
                }
            }
            _ => {
                self.ordered_bytes += item.json.len();
                self.ordered.push_back(item);
                self.make_room();
            }
        }
    }

    /// An E-stop is handed over: commands that wait do not go up behind it.
    fn end_commands(&mut self) {
        let fate = Fate::NeverArrived(Reason::Estop);
        self.take_back(|item| item.class == LinkClass::Command, fate);
    }

    /// Takes back what waits, unwritten, and is such.
    fn take_back(&mut self, such: impl Fn(&Item<O>) -> bool, fate: Fate) {
        let mut kept = VecDeque::with_capacity(self.ordered.len());
        for item in std::mem::take(&mut self.ordered) {
            if such(&item) {
                self.ordered_bytes -= item.json.len();
                self.counters.withdrawn += 1;
                self.lost.push((item.message, fate));
            } else {
                kept.push_back(item);
            }
        }
        self.ordered = kept;
    }

    fn make_room(&mut self) {
        while self.ordered.len() > self.bounds.waiting
            || (self.ordered_bytes > self.bounds.waiting_bytes && self.ordered.len() > 1)
        {
            // Telemetry gives way first, then what is oldest.
            let telemetry = |item: &Item<O>| item.class == LinkClass::Telemetry;
            let place = self.ordered.iter().position(telemetry).unwrap_or(0);
            let Some(item) = self.ordered.remove(place) else { return };
            self.ordered_bytes -= item.json.len();
            self.counters.dropped += 1;
            if item.class == LinkClass::Command {
                self.lost.push((item.message, Fate::NeverArrived(Reason::Full)));
            }
        }
    }

    /// A connection is there.
    pub fn open(&mut self, now: Timestamp) {
        self.phase = Phase::Greeting;
        (self.opened, self.beat) = (now, now);
        self.decoder = Decoder::default();
        self.control.clear();
        let hello = Hello {
            protocol: PROTOCOL,
            side: self.identity.side,
            run: self.identity.run.clone(),
            robot: self.identity.robot.clone(),
            peer_run: self.peer_run.clone(),
            received: self.received,
            time_ns: now.0,
        };
        encode(&mut self.control, &Body::Hello(hello));
    }

    /// The connection is gone, or none could be made.
    pub fn close(&mut self, now: Timestamp, why: &CarrierError) {
        use CarrierError::{Connection, Refused, Silent};
        if !matches!(why, Connection(_) | Refused(_) | Silent(_)) {
            self.counters.damaged += 1;
        }
        let state = match why {
            CarrierError::Refused(_) => CarrierState::Refused,
            _ => self.state_without(),
        };
        self.phase = Phase::Down;
        self.control.clear();
        self.set_state(now, state);
        self.why = Some(why.to_string());
    }

    fn state_without(&self) -> CarrierState {
        if self.counters.connections > 0 {
            CarrierState::Reconnecting
        } else {
            CarrierState::Connecting
        }
    }

    fn set_state(&mut self, now: Timestamp, state: CarrierState) {
        if self.state != state {
            (self.state, self.since) = (state, now);
        }
    }

    /// Takes over what came. After an error the connection is to be closed.
    pub fn receive(&mut self, now: Timestamp, bytes: &[u8]) -> Result<(), CarrierError> {
        if self.phase == Phase::Down {
            return Err(CarrierError::Connection("there is none".into()));
        }
        self.decoder.push(bytes);
        loop {
            let most = if self.phase == Phase::Up { BODY_MAX } else { GREETING_MAX };
            let Some(body) = self.decoder.next(most)? else { return Ok(()) };
            match body {
                Body::Refusal(why) => {
                    return Err(CarrierError::Refused(format!("the other end refuses: {why}")));
                }
                Body::Hello(hello) if self.phase == Phase::Greeting => self.greet(now, hello)?,
                Body::Message { number, taken, json } if self.phase == Phase::Up => {
                    self.confirm(taken)?;
                    self.take_in(number, json)?;
                }
                Body::Beat { taken, time_ns } if self.phase == Phase::Up => {
                    self.confirm(taken)?;
                    self.clock.told(Timestamp(time_ns), now);
                }
                _ => {
                    let why = "it does not belong here".into();
                    return Err(CarrierError::NotUnderstood(why));
                }
            }
            self.heard = Some(now);
        }
    }

    /// Tells the other end, before the connection is closed, why; gives the bytes.
    pub fn refusal(why: &str) -> Vec<u8> {
        let mut bytes = Vec::new();
        encode(&mut bytes, &Body::Refusal(why.into()));
        bytes
    }

    fn greet(&mut self, now: Timestamp, hello: Hello) -> Result<(), CarrierError> {
        let own = &self.identity;
        if hello.protocol != PROTOCOL {
            return Err(CarrierError::Refused(format!(
                "the other end speaks version {} of the protocol, this one {PROTOCOL}",
                hello.protocol
            )));
        }
        if hello.side == own.side {
            let why = "both ends are of the same side: a ground dials a rover";
            return Err(CarrierError::Refused(why.into()));
        }
        if hello.robot != own.robot {
            let shown: String = hello.robot.chars().take(64).collect();
            return Err(CarrierError::Refused(format!(
                "the other end has the robot model {shown}, this one {}: start both with the same \
                 robot, scale and payload",
                own.robot
            )));
        }
        let same = self.peer_run.as_deref() == Some(&hello.run);
        // Who has greeted nobody yet has missed our greeting, and all that was written behind it.
        let known = hello.peer_run.as_ref().is_none_or(|run| *run == own.run);
        if same && known {
            self.resume(now, hello.received)?;
        } else {
            self.begin_anew(hello.run);
        }
        self.clock.restart(Timestamp(hello.time_ns), now);
        self.phase = Phase::Up;
        self.counters.connections += 1;
        self.set_state(now, CarrierState::Up);
        self.why = None;
        // Said at once, so that the other end knows that it is heard.
        self.beat = now;
        self.put_beat(now);
        Ok(())
    }

    /// Both ends have each other in memory: goes on behind the last message that arrived.
    fn resume(&mut self, now: Timestamp, received: u64) -> Result<(), CarrierError> {
        if received > self.numbered {
            let expected = self.numbered;
            return Err(CarrierError::OutOfOrder { got: received, expected });
        }
        self.confirm(received)?;
        self.written = received;
        // What is written again now never arrived; of commands, only while they are young.
        for (_, place) in &mut self.window {
            let old = place.as_ref().is_some_and(|item| {
                item.class == LinkClass::Command
                    && now.seconds_since(item.since) > self.bounds.command_s
            });
            if old && let Some(item) = place.take() {
                self.window_bytes -= item.json.len();
                self.counters.withdrawn += 1;
                self.lost.push((item.message, Fate::NeverArrived(Reason::TooOld)));
            }
        }
        Ok(())
    }

    /// One of the ends is another process than before: numbers begin anew, and no command that the
    /// former one may have got is said to the new one.
    fn begin_anew(&mut self, run: String) {
        let was_other = self.peer_run.is_some();
        self.peer_run = Some(run);
        self.era += 1;
        self.fresh = true;
        (self.received, self.taken, self.told) = (0, 0, 0);
        self.taking = None;
        (self.numbered, self.written, self.window_bytes) = (0, 0, 0);
        for (_, item) in std::mem::take(&mut self.window).into_iter().rev() {
            let Some(item) = item else { continue };
            match item.class {
                LinkClass::Command => {
                    self.counters.withdrawn += 1;
                    self.lost.push((item.message, Fate::Unknown));
                }
                LinkClass::Estop => self.urgent.push_front(item),
                LinkClass::Bulk => {
                    self.bulk_bytes += item.json.len();
                    self.bulk.push_front(item);
                }
                LinkClass::Ack | LinkClass::Housekeeping | LinkClass::Telemetry => {
                    self.ordered_bytes += item.json.len();
                    self.ordered.push_front(item);
                }
            }
        }
        if was_other {
            let fate = Fate::NeverArrived(Reason::Restarted);
            self.take_back(|item| item.class == LinkClass::Command, fate);
        }
    }

    fn confirm(&mut self, number: u64) -> Result<(), CarrierError> {
        if number > self.numbered {
            return Err(CarrierError::OutOfOrder { got: number, expected: self.numbered });
        }
        while self.window.front().is_some_and(|(first, _)| *first <= number) {
            if let Some((_, Some(item))) = self.window.pop_front() {
                self.window_bytes -= item.json.len();
                self.counters.confirmed += 1;
            }
        }
        Ok(())
    }

    fn take_in(&mut self, number: u64, json: Option<Vec<u8>>) -> Result<(), CarrierError> {
        if number <= self.received {
            self.counters.repeated += 1;
            return Ok(());
        }
        if number != self.received + 1 {
            let expected = self.received + 1;
            return Err(CarrierError::OutOfOrder { got: number, expected });
        }
        self.received = number;
        let Some(json) = json else {
            // Nothing to hand on; confirmed with what comes before and after it.
            if self.inbox.is_empty() {
                self.taken = number;
            }
            return Ok(());
        };
        self.counters.received += 1;
        // One that this version does not know is handed on as text: it is not asked for again.
        let message =
            serde_json::from_slice(&json).map_err(|_| String::from_utf8_lossy(&json).into_owned());
        self.inbox.push_back((self.era, number, message));
        Ok(())
    }

    /// What came since the last call, in order, each once; what is taken here is confirmed to the
    /// other end. A message that this version does not know comes as text.
    pub fn take_received(&mut self) -> Vec<Result<I, String>> {
        self.taken = self.received;
        self.inbox.drain(..).map(|(_, _, message)| message).collect()
    }

    /// As [`End::take_received`], the oldest only, and confirmed by [`End::took`] alone: for who must
    /// store each before it is confirmed.
    pub fn take_one(&mut self) -> Option<Result<I, String>> {
        let (era, number, message) = self.inbox.pop_front()?;
        let number = if self.inbox.is_empty() { self.received } else { number };
        self.taking = (era == self.era).then_some(number);
        Some(message)
    }

    /// What [`End::take_one`] gave is safe.
    pub fn took(&mut self) {
        if let Some(number) = self.taking.take() {
            self.taken = self.taken.max(number);
        }
    }

    /// What will not be carried, with what became of it.
    pub fn take_lost(&mut self) -> Vec<(O, Fate)> {
        std::mem::take(&mut self.lost)
    }

    /// True once after the other end has turned out to be another process than before, or the first.
    pub fn take_fresh(&mut self) -> bool {
        std::mem::take(&mut self.fresh)
    }

    /// Goes on to `now`: beats, and whether the other end is still there. After an error the
    /// connection is to be closed.
    pub fn tick(&mut self, now: Timestamp) -> Result<(), CarrierError> {
        if self.phase != Phase::Up {
            let most = self.bounds.command_s;
            let old = |item: &Item<O>| {
                item.class == LinkClass::Command && now.seconds_since(item.since) > most
            };
            self.take_back(old, Fate::NeverArrived(Reason::TooOld));
        }
        if self.phase == Phase::Down {
            return Ok(());
        }
        let heard = self.heard.map_or(self.opened, |heard| heard.max(self.opened));
        let silent_s = now.seconds_since(heard);
        if silent_s > self.bounds.silence_s {
            return Err(CarrierError::Silent(silent_s));
        }
        if self.phase == Phase::Up && now.seconds_since(self.beat) >= self.bounds.beat_s {
            self.beat = now;
            self.put_beat(now);
        }
        Ok(())
    }

    fn put_beat(&mut self, now: Timestamp) {
        self.told = self.taken;
        encode(&mut self.control, &Body::Beat { taken: self.taken, time_ns: now.0 });
    }

    /// What is to be written now, about one piece: what was written before and did not arrive, then
    /// E-stops, then the rest as far as the window goes. Empty where there is nothing.
    pub fn output(&mut self, now: Timestamp) -> Vec<u8> {
        let mut out = std::mem::take(&mut self.control);
        if self.phase != Phase::Up {
            return out;
        }
        let first = self.window.partition_point(|(number, _)| *number <= self.written);
        for (number, item) in self.window.iter().skip(first) {
            if out.len() > PIECE {
                break;
            }
            let json = item.as_ref().map(|item| &item.json[..]);
            encode_message(&mut out, *number, self.taken, json);
            (self.written, self.told) = (*number, self.taken);
        }
        while out.len() <= PIECE
            && let Some(item) = self.next_item()
        {
            self.numbered += 1;
            encode_message(&mut out, self.numbered, self.taken, Some(&item.json));
            (self.written, self.told) = (self.numbered, self.taken);
            self.window_bytes += item.json.len();
            self.window.push_back((self.numbered, Some(item)));
        }
        if self.told != self.taken {
            self.put_beat(now);
            out.append(&mut self.control);
        }
        out
    }

    /// What is to get the next number, if the window has room; an E-stop needs none.
    fn next_item(&mut self) -> Option<Item<O>> {
        if let Some(item) = self.urgent.pop_front() {
            return Some(item);
        }
        let room = self.window.len() < self.bounds.window
            && (self.window_bytes < self.bounds.window_bytes || self.window.is_empty());
        if !room {
            return None;
        }
        if let Some(item) = self.ordered.pop_front() {
            self.ordered_bytes -= item.json.len();
            return Some(item);
        }
        let item = self.bulk.pop_front()?;
        self.bulk_bytes -= item.json.len();
        Some(item)
    }
}

/// Written at once at most (bytes), so that an E-stop waits for little.
const PIECE: usize = 64 << 10;
