//! The ground's end of the link, all parts together.
//!
//! A [`Ground`] does no I/O: its methods take the time and return at once. What must be on the disk
//! before it is answered comes back as [`Logged`] or [`Release`], to be awaited after the lock on
//! the ground was given back.
//!
//! *Write-ahead*: a command goes to the link only once its uplink message and its event are synced.
//! An E-stop waits for nothing: neither for the log nor for what waits for the log, which it ends.

mod alarm;
mod carrier;
mod imaging;
mod observe;
mod operate;
mod run;
mod size;

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use serde::Serialize;
use tokio::sync::{Notify, oneshot};
use wire::live::{
    AckStage, CarrierState, CommandEvent, CommandRecord, CommandState, Downlink, EventLevel,
    EventNotice, FlightLogReport, ImageDown, LinkClass, LinkConfig, LinkReport, RoverTelemetry,
    StabilityDerived, Uplink, channel,
};
use wire::resources::LatestFrame;
use wire::time::Timestamp;

use crate::adapter::RoverAdapter;
use crate::bus::{Bus, ChannelMessage};
use crate::commands::{
    Authority, AuthorityRules, CommandBook, CommandError, Estop, EstopMemory, LightTimes, Silence,
};
use crate::images::Images;
use crate::link::{self, Delivered, Direction, DropCause, LinkError, Notice};
use crate::recorder::{Record, Recorder, RecorderError, RecorderStatus, Written};
use crate::views::Views;

pub use carrier::Queues;
pub use imaging::CameraRecords;
pub use observe::Shown;
pub use operate::Rehearsed;
pub use run::{STEP_S, run};

/// Most commands under way at once.
pub const UPLINK_MAX: usize = 2048;
/// Most messages from the rover under way at once: 10 Hz over the longest delay, and as much again.
pub const DOWNLINK_MAX: usize = 36_000;
/// A release of an earlier session that has had no effect so long (s) after its light time never will.
const RELEASE_SLACK_S: f64 = 2.0;
/// The link is reported at least this often (s).
const LINK_REPORT_S: f64 = 1.0;

/// Computes what the ground derives from a telemetry frame; injected, so that the bridge holds no
/// stability. Called with the ground locked: it is to take microseconds.
pub type Derive = Box<dyn Fn(&RoverTelemetry) -> Option<StabilityDerived> + Send>;

/// Rover, link, commands, log and listeners of one session.
pub struct Ground {
    adapter: Box<dyn RoverAdapter>,
    up: Direction<Uplink>,
    down: Direction<(Timestamp, Downlink)>,
    book: CommandBook,
    estop: Estop,
    authority: Authority,
    /// Time between heartbeats (s); none where absent.
    heartbeat_s: Option<f64>,
    heartbeat: Timestamp,
    images: Images,
    cameras: Option<CameraRecords>,
    /// Channels of cameras, with the number of their messages.
    topics: BTreeMap<String, (Arc<str>, u64)>,
    recorder: Recorder,
    bus: Bus,
    derive: Derive,
    wake: Arc<Notify>,
    /// Commands that wait for the log, in the order they were sent.
    pending: VecDeque<Pending>,
    channels: BTreeMap<&'static str, (Arc<str>, u64)>,
    now: Timestamp,
    latest_log_time: Timestamp,
    link_reported: Option<Timestamp>,
    /// The log failed at the last step.
    log_failed: bool,
    latest: Option<LatestFrame>,
    stability: Option<StabilityDerived>,
    views: Option<Views>,
    /// How the carrier was when it was looked at last.
    carrier: Option<CarrierState>,
    /// When a carrier that is not up was up last.
    carrier_lost: Option<Timestamp>,
}

struct Pending {
    id: String,
    uplink: Uplink,
    written: Written,
    done: oneshot::Sender<Result<CommandRecord, CommandError>>,
}

/// A value that may be told once it is on the disk.
#[derive(Debug)]
#[must_use = "await `written` before the value is told to anyone"]
pub struct Logged<T> {
    value: T,
    written: Option<Result<Written, RecorderError>>,
}

impl<T> Logged<T> {
    /// Waits until the log has it.
    pub async fn written(self) -> Result<T, CommandError> {
        match self.written {
            None => Ok(self.value),
            Some(Ok(written)) => written.wait().await.map(|()| self.value).map_err(log_error),
            Some(Err(error)) => Err(log_error(error)),
        }
    }

    /// As [`Logged::written`], blocking the thread; for tools and tests.
    pub fn written_blocking(self) -> Result<T, CommandError> {
        match self.written {
            None => Ok(self.value),
            Some(Ok(written)) => written.wait_blocking().map(|()| self.value).map_err(log_error),
            Some(Err(error)) => Err(log_error(error)),
        }
    }

    /// The value, whether the log has it or not.
    pub fn unlogged(self) -> T {
        self.value
    }
}

/// A command on its way to the link. Dropping this does not hold it up.
#[derive(Debug)]
pub struct Release(oneshot::Receiver<Result<CommandRecord, CommandError>>);

impl Release {
    /// Waits until the command was handed to the link, or is known not to be. [`run`] (or
    /// [`Ground::step`]) must go on meanwhile.
    pub async fn wait(self) -> Result<CommandRecord, CommandError> {
        let gone = CommandError::LogUnavailable { reason: RecorderError::Ended.to_string() };
        self.0.await.unwrap_or(Err(gone))
    }

    /// The outcome, if there is one yet.
    pub fn poll(&mut self) -> Option<Result<CommandRecord, CommandError>> {
        self.0.try_recv().ok()
    }
}

/// The rover cannot be exchanged now.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("a command is under way or an E-stop in force; end them before the rover is placed anew")]
pub struct RoverBusy;

impl RoverBusy {
    /// A stable word for programs.
    pub fn code(self) -> &'static str {
        "rover_busy"
    }
}

impl Ground {
    /// A session with the given rover and link that begins at `now`.
    pub fn new(
        now: Timestamp,
        adapter: Box<dyn RoverAdapter>,
        link: LinkConfig,
        recorder: Recorder,
        bus: Bus,
        derive: Derive,
    ) -> Result<Ground, LinkError> {
        let [up, down] = link::check(&link)?;
        let wake = recorder.committed();
        let mut ground = Ground {
            adapter,
            up: Direction::new(up, UPLINK_MAX),
            down: Direction::new(down, DOWNLINK_MAX),
            book: CommandBook::default(),
            estop: Estop::default(),
            authority: Authority::new(now, AuthorityRules::default(), 0),
            heartbeat_s: None,
            heartbeat: now,
            images: Images::default(),
            cameras: None,
            topics: BTreeMap::new(),
            recorder,
            bus,
            derive,
            wake,
            pending: VecDeque::new(),
            channels: channel::ALL.map(|name| (name, (Arc::from(name), 0))).into(),
            now,
            latest_log_time: now,
            link_reported: None,
            log_failed: false,
            latest: None,
            stability: None,
            views: None,
            carrier: None,
            carrier_lost: None,
        };
        ground.tell_silences(now, "server");
        Ok(ground)
    }

    /// Has what stock viewers draw logged, too. To be called first; the recorder must have been given
    /// [`crate::views::channels`].
    pub fn log_views(&mut self, views: Views) {
        self.views = Some(views);
    }

    /// How authority is given, and how often the rover is told that the ground is there (s).
    pub fn configure(&mut self, rules: AuthorityRules, heartbeat_s: Option<f64>) {
        self.authority = Authority::new(self.now, rules, self.authority.report(self.now).epoch);
        self.heartbeat_s = heartbeat_s;
    }

    /// Takes over the commands of an earlier session from its events in order, see
    /// [`CommandBook::restore`]; gives how many have an unknown outcome. To be called first.
    pub fn restore(
        &mut self,
        now: Timestamp,
        events: impl IntoIterator<Item = CommandEvent>,
    ) -> usize {
        let now = self.tick(now);
        self.book = CommandBook::restore(now, events);
        self.tell_silences(now, "server");
        let last = self.book.records().filter_map(|record| record.epoch).max().unwrap_or(0);
        let last = last.max(self.authority.report(now).epoch);
        self.authority = Authority::new(now, self.authority.rules(), last);
        self.publish_events();
        self.book.records().filter(|record| record.state == CommandState::Overdue).count()
    }

    /// Goes on to `now`: what has arrived is handled at the instant of its arrival, in order.
    pub fn step(&mut self, now: Timestamp) {
        let now = self.tick(now);
        self.release_written(now);
        self.repeat_estop(now);
        self.beat(now);
        for arrived in self.up.take_due(now) {
            self.listen(arrived.arrived);
            self.adapter.uplink(arrived.arrived, arrived.item);
        }
        self.hear_of_uplinks();
        self.listen(now);
        self.watch_carrier(now);
        for arrived in self.down.take_due(now) {
            self.receive(arrived);
        }
        self.ask_for_images(now);
        self.book.tick(now);
        self.publish_events();
        for notice in self.recorder.take_notices() {
            self.publish(now, channel::EVENT, &notice);
        }
        // That the log fails, or is well again, is told at once, as no command passes meanwhile.
        let log_fails = self.recorder.fails();
        if std::mem::replace(&mut self.log_failed, log_fails) != log_fails {
            self.report_link();
        }
        if self.link_reported.is_none_or(|at| now.seconds_since(at) >= LINK_REPORT_S) {
            self.report_link();
        }
    }

    /// Takes over the E-stop of an earlier session: in force it stays, until an operator releases it.
    pub fn restore_estop(&mut self, now: Timestamp, memory: EstopMemory) {
        let now = self.tick(now);
        let light = self.light_times(now);
        let arrives = now.plus_seconds(light.up_s + light.spread_s + RELEASE_SLACK_S);
        self.estop = Estop::restore(now, arrives, memory);
        if self.estop.in_force() {
            let text = "an E-stop of the last session is in force still: release it to go on";
            self.notice(now, EventLevel::Critical, "server", text);
            self.report_link();
        }
    }

    /// When [`Ground::step`] is wanted next: when the link does something, at the latest after [`STEP_S`].
    pub fn next_step(&self) -> Timestamp {
        let latest = self.now.plus_seconds(STEP_S);
        let arrivals = [self.up.next_event(), self.down.next_event()];
        arrivals.into_iter().flatten().fold(latest, Timestamp::min)
    }

    /// Publishes a message of the ground on a channel of `wire::live::channel`, and logs it (all
    /// but `job/progress`). For what the bridge does not publish itself: jobs, terrain, events.
    pub fn publish(&mut self, now: Timestamp, channel: &'static str, message: &impl Serialize) {
        let now = self.tick(now);
        self.put(channel, now, now, now, message);
    }

    /// Publishes an event.
    pub fn notice(&mut self, now: Timestamp, level: EventLevel, who: &str, text: &str) {
        let notice = EventNotice { level, text: text.into(), who: who.into() };
        self.publish(now, channel::EVENT, &notice);
    }

    /// The machine's clock was set by so much (s): told, and nothing else.
    pub fn clock_was_set(&mut self, now: Timestamp, by_s: f64) {
        let text = format!(
            "the machine's clock was set by {by_s:+.1} s; times here go on as before until a restart"
        );
        self.notice(now, EventLevel::Caution, "server", &text);
    }

    /// The link as it is.
    pub fn link(&self) -> LinkReport {
        LinkReport {
            config: LinkConfig {
                up_delay_s: self.up.settings().light_s(self.now),
                down_delay_s: self.down.settings().light_s(self.now),
                up: self.up.settings().beyond_delay(),
                down: self.down.settings().beyond_delay(),
            },
            up: self.up.counters(),
            down: self.down.counters(),
            up_queues: self.up.queues(),
            down_queues: self.down.queues(),
            estop: self.estop.state(),
            authority: self.authority.report(self.now),
            carrier: self.adapter.carrier(),
            flight_log: Some(self.flight_log()),
        }
    }

    fn flight_log(&self) -> FlightLogReport {
        let status = self.recorder.status();
        FlightLogReport { error: status.error, dropped: status.dropped }
    }

    /// The last frame received.
    pub fn latest(&self) -> Option<&LatestFrame> {
        self.latest.as_ref()
    }

    /// What was derived from it.
    pub fn stability(&self) -> Option<&StabilityDerived> {
        self.stability.as_ref()
    }

    /// The commands.
    pub fn commands(&self) -> &CommandBook {
        &self.book
    }

    /// The bus that everything is published on.
    pub fn bus(&self) -> Bus {
        self.bus.clone()
    }

    /// The flight log.
    pub fn recorder_status(&self) -> RecorderStatus {
        self.recorder.status()
    }

    /// Ends the session: writes the end of the log. Blocks; commands are refused from then on.
    pub fn finish(&mut self, now: Timestamp) -> Result<RecorderStatus, RecorderError> {
        self.step(now);
        self.recorder.finish()
    }

    fn tick(&mut self, now: Timestamp) -> Timestamp {
        self.now = self.now.max(now);
        self.now
    }

    /// Takes what the rover has said until `at` and hands it to the link at the time it was said.
    fn listen(&mut self, at: Timestamp) {
        for (onboard, message) in self.adapter.advance(at) {
            let class = match message {
                Downlink::Telemetry(_) => LinkClass::Telemetry,
                Downlink::Ack { .. } => LinkClass::Ack,
                Downlink::Image(ImageDown::Head(_)) => LinkClass::Housekeeping,
                Downlink::Image(_) => LinkClass::Bulk,
            };
            let bytes = size::of_downlink(&message);
            if let Err(full) = self.down.offer(onboard.min(at), class, bytes, (onboard, message)) {
                // Counted by the link; told at most once a second with the link's report.
                tracing::warn!("an acknowledgement of the rover was dropped: {full}");
            }
        }
        // What happens on the way down the ground learns by what comes, or does not.
        drop(self.down.take_notices());
    }

    /// What the transmitter on the ground knows of the commands: they have left, or expired before.
    fn hear_of_uplinks(&mut self) {
        for notice in self.up.take_notices() {
            match notice {
                Notice::Transmitted { item: Uplink::Command { id, .. }, at, arrives, .. } => {
                    let light = self.light_times(at);
                    self.book.transmitted(at, &id, arrives, light);
                }
                Notice::Dropped {
                    item: Uplink::Command { id, .. },
                    at,
                    cause: DropCause::Ttl,
                    ..
                } => {
                    let why = "it waited for the link longer than a command may";
                    self.images.acknowledge(at, &id, AckStage::Rejected, Some(why));
                    self.book.withdraw(at, &id, CommandState::Expired, why);
                }
                _ => {}
            }
        }
    }

    /// Sends an E-stop again that the rover has given no word on.
    fn repeat_estop(&mut self, now: Timestamp) {
        let light = self.light_times(now);
        let word_s = light.up_s + light.down_s + light.spread_s;
        let Some(id) = self.estop.repeat(now, word_s) else { return };
        let uplink = Uplink::Estop { id };
        if let Err(full) = self.offer_up(now, LinkClass::Estop, uplink.clone()) {
            tracing::warn!("an E-stop was not repeated: {full}, all of them E-stops");
            return;
        }
        self.put_durable(channel::COMMAND_UPLINK, now, &uplink);
        self.notice(
            now,
            EventLevel::Critical,
            "server",
            "E-stop sent again: no word from the rover",
        );
    }

    fn beat(&mut self, now: Timestamp) {
        let Some(every_s) = self.heartbeat_s.filter(|_| now >= self.heartbeat) else { return };
        self.heartbeat = now.plus_seconds(every_s);
        if let Err(full) = self.offer_up(now, LinkClass::Housekeeping, Uplink::Heartbeat {}) {
            tracing::debug!("a heartbeat was not sent: {full}");
        }
    }

    /// The light times of now, and how much later than these a message may come.
    fn light_times(&self, now: Timestamp) -> LightTimes {
        let (up, down) = (self.up.settings(), self.down.settings());
        LightTimes {
            up_s: up.light_s(now),
            down_s: down.light_s(now),
            spread_s: up.jitter_max_s() + down.jitter_max_s(),
        }
    }

    /// As [`Ground::light_times`], of a command that is released at `now`: with what outages hold back on the way up.
    fn command_times(&self, now: Timestamp) -> LightTimes {
        let leaves = self.up.settings().open_from(now);
        let up_s = leaves.seconds_since(now) + self.up.settings().light_s(leaves);
        let down_s = self.down.settings().light_s(now.plus_seconds(up_s));
        LightTimes { up_s, down_s, ..self.light_times(now) }
    }

    /// When an E-stop that is wanted at `now` reaches the rover at the earliest: what is lost in an outage is
    /// sent again until it has come.
    fn estop_arrives(&self, now: Timestamp) -> Timestamp {
        let up = self.up.settings();
        let leaves = up.clear_from(now);
        leaves.plus_seconds(up.light_s(leaves))
    }

    /// The book of commands learns when no word can come.
    fn tell_silences(&mut self, now: Timestamp, who: &str) {
        let silences = self.down.settings().silences();
        let silences = silences.map(|[begin, end]| Silence { begin, end }).collect();
        self.book.set_silences(now, who, silences);
    }

    fn receive(&mut self, arrived: Delivered<(Timestamp, Downlink)>) {
        let Delivered { item: (onboard, message), sent, arrived, .. } = arrived;
        match message {
            Downlink::Telemetry(frame) => self.receive_frame(onboard, sent, arrived, frame),
            Downlink::Image(part) => self.receive_image(sent, arrived, part),
            Downlink::Ack { id, stage, detail } => {
                self.images.acknowledge(arrived, &id, stage, detail.as_deref());
                let changed = if self.estop.knows(&id) {
                    let changed = self.estop.acknowledged(onboard, &id, stage);
                    if changed {
                        self.report_link();
                    }
                    changed
                } else {
                    self.book.acknowledge(arrived, &id, stage, detail.as_deref())
                };
                if !changed {
                    tracing::debug!("the rover's word {stage:?} on {id} changes nothing");
                }
            }
        }
        self.publish_events();
    }

    fn receive_frame(
        &mut self,
        onboard: Timestamp,
        sent: Timestamp,
        arrived: Timestamp,
        frame: RoverTelemetry,
    ) {
        let sequence = self.put(channel::ROVER_STATE, onboard, sent, arrived, &frame);
        let stability = (self.derive)(&frame);
        if let Some(derived) = &stability {
            self.put(channel::ROVER_STABILITY, onboard, sent, arrived, derived);
        }
        if let Some(views) = &mut self.views {
            let records = views.of(onboard, self.latest_log_time, &frame, stability.as_ref());
            // What can be drawn again gives way before telemetry does.
            records.into_iter().for_each(|record| self.recorder.record_bulk(record));
        }
        if let Some(executing) = &frame.executing {
            self.book.progress(arrived, executing);
        }
        if self.estop.seen(onboard, frame.mode) {
            self.report_link();
        }
        self.stability = stability;
        let received_time = arrived;
        self.latest = Some(LatestFrame { onboard_time: onboard, received_time, sequence, frame });
    }

    /// Publishes and logs the events of the book; gives the last one's way to the disk.
    fn publish_events(&mut self) -> Option<Result<Written, RecorderError>> {
        let mut last = None;
        for event in self.book.take_events() {
            last = self.put_durable(channel::COMMAND_EVENT, event.time, &event);
        }
        last
    }

    fn report_link(&mut self) {
        let (now, report) = (self.now, self.link());
        self.link_reported = Some(now);
        self.put(channel::LINK, now, now, now, &report);
    }

    fn put(
        &mut self,
        name: &'static str,
        onboard: Timestamp,
        sent: Timestamp,
        received: Timestamp,
        message: &impl Serialize,
    ) -> u64 {
        let Some(message) = self.encode(name, onboard, sent, received, message) else { return 0 };
        let sequence = message.sequence;
        match name {
            channel::JOB => {}
            channel::EVENT => {
                if let Err(error) = self.recorder.record_durable(record_of(&message)) {
                    tracing::error!("an event is not in the log: {error}");
                }
            }
            _ => self.recorder.record(record_of(&message)),
        }
        self.bus.publish(message);
        sequence
    }

    fn put_durable(
        &mut self,
        name: &'static str,
        now: Timestamp,
        message: &impl Serialize,
    ) -> Option<Result<Written, RecorderError>> {
        let message = self.encode(name, now, now, now, message)?;
        let written = self.recorder.record_durable(record_of(&message));
        self.bus.publish(message);
        Some(written)
    }

    /// Numbers and encodes a message. Times of receipt never go back from message to message.
    fn encode(
        &mut self,
        name: &'static str,
        onboard: Timestamp,
        sent: Timestamp,
        received: Timestamp,
        message: &impl Serialize,
    ) -> Option<ChannelMessage> {
        let json = match serde_json::to_vec(message) {
            Ok(json) => json.into(),
            Err(error) => {
                tracing::error!("a message of {name} cannot be encoded: {error}");
                return None;
            }
        };
        let (channel, sequence) = self.channels.entry(name).or_insert_with(|| (Arc::from(name), 0));
        *sequence += 1;
        self.latest_log_time = self.latest_log_time.max(received);
        Some(ChannelMessage {
            channel: channel.clone(),
            sequence: *sequence,
            onboard_time: onboard,
            sent_time: sent,
            received_time: self.latest_log_time,
            json,
        })
    }
}

fn record_of(message: &ChannelMessage) -> Record {
    Record {
        channel: message.channel.clone(),
        sequence: message.sequence,
        log_time: message.received_time,
        publish_time: message.onboard_time,
        data: message.json.clone(),
    }
}

fn log_error(error: RecorderError) -> CommandError {
    CommandError::LogUnavailable { reason: error.to_string() }
}
