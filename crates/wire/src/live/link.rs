//! The model of the link, one direction at a time, and what is counted of it.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::time::Timestamp;

/// The link, changeable while it runs.
///
/// A direction that a change leaves out stays as it is, its delay apart; `{}` makes it a plain delay.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct LinkConfig {
    /// One-way delay of commands (s), 0 to 1800; where `up` has a table the light time of now.
    pub up_delay_s: f64,
    /// One-way delay of telemetry (s), 0 to 1800; where `down` has a table the light time of now.
    pub down_delay_s: f64,
    /// What else happens to commands; nothing where absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub up: Option<DirectionModel>,
    /// What else happens to telemetry; nothing where absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub down: Option<DirectionModel>,
}

impl LinkConfig {
    /// A link that does nothing but delay (s, one way).
    pub const fn delays(up_delay_s: f64, down_delay_s: f64) -> LinkConfig {
        LinkConfig { up_delay_s, down_delay_s, up: None, down: None }
    }
}

/// What one direction of the link does to messages, beside its delay.
///
/// A message waits in the queue of its class. The transmitter takes the highest class first, one
/// frame at a time. A message arrives at the end of its last frame + light time + jitter.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields)]
pub struct DirectionModel {
    /// Light time over time instead of a fixed one: linear between entries, constant beyond; at most
    /// 1000, in order of time.
    pub light_times: Vec<LightTime>,
    /// What comes on top of the light time, never less than nothing.
    pub jitter: Jitter,
    /// Rate (bit/s), 1 to 10^12; no limit where absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rate_bps: Option<f64>,
    /// Largest frame (bytes), 16 to 1048576. An E-stop waits for one at most.
    pub mtu_bytes: u32,
    /// Queues, highest class first.
    pub queues: Queues,
    /// Which frames are lost; a message is lost with any of its frames.
    pub loss: Loss,
    /// Probability that a frame arrives damaged; its message is dropped on arrival.
    pub corruption: f64,
    /// Probability that a message arrives a second time.
    pub duplication: f64,
    /// When nothing is transmitted; at most 1000, in order, without overlap.
    pub outages: Vec<Outage>,
    /// Do messages keep the order of their transmission? E-stops pass in any case.
    pub in_order: bool,
    /// Seed of what is drawn, 0 to 2^53.
    pub seed: u64,
}

impl Default for DirectionModel {
    fn default() -> Self {
        DirectionModel {
            light_times: Vec::new(),
            jitter: Jitter::None {},
            rate_bps: None,
            mtu_bytes: 1024,
            queues: Queues::default(),
            loss: Loss::None {},
            corruption: 0.0,
            duplication: 0.0,
            outages: Vec::new(),
            in_order: true,
            seed: 0,
        }
    }
}

/// Light time from a moment on.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct LightTime {
    /// The moment.
    pub time: Timestamp,
    /// Light time (s), 0 to 1800.
    pub delay_s: f64,
}

/// Random delay on top of the light time.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum Jitter {
    /// None.
    None {},
    /// Uniform from 0 to `most_s`.
    Uniform {
        /// Largest value (s), 0 to 60.
        most_s: f64,
    },
    /// Size of a normally distributed value, drawn again while beyond `most_s`.
    TruncatedNormal {
        /// Standard deviation before truncation (s), 0 to 60.
        sigma_s: f64,
        /// Largest value (s), 0 to 60.
        most_s: f64,
    },
}

/// Which frames are lost.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum Loss {
    /// None.
    None {},
    /// Each with the same probability.
    Bernoulli {
        /// The probability.
        probability: f64,
    },
    /// In bursts: two states, each with a probability of loss; the state may change after each frame.
    GilbertElliott {
        /// Probability to go from good to bad.
        to_bad: f64,
        /// Probability to go from bad to good.
        to_good: f64,
        /// Probability of loss in the good state.
        loss_good: f64,
        /// Probability of loss in the bad state.
        loss_bad: f64,
    },
}

/// A time in which nothing is transmitted. What is under way arrives.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Outage {
    /// Its first moment.
    pub begin: Timestamp,
    /// The first moment after it.
    pub end: Timestamp,
    /// What becomes of messages.
    pub traffic: OutageTraffic,
}

/// What becomes of messages in an outage.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum OutageTraffic {
    /// They wait.
    Hold,
    /// What would be transmitted is lost.
    Lose,
}

/// Classes of messages, highest first.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, ToSchema,
)]
#[serde(rename_all = "snake_case")]
pub enum LinkClass {
    /// E-stops: pass everything.
    Estop,
    /// Commands.
    Command,
    /// Words on commands.
    Ack,
    /// Heartbeats and events.
    Housekeeping,
    /// Frames of telemetry.
    Telemetry,
    /// Images, map tiles.
    Bulk,
}

impl LinkClass {
    /// All, highest first.
    pub const ALL: [LinkClass; 6] = [
        LinkClass::Estop,
        LinkClass::Command,
        LinkClass::Ack,
        LinkClass::Housekeeping,
        LinkClass::Telemetry,
        LinkClass::Bulk,
    ];
}

/// The queue of each class.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields)]
#[allow(missing_docs)] // named as the classes
pub struct Queues {
    pub estop: QueueRule,
    pub command: QueueRule,
    pub ack: QueueRule,
    pub housekeeping: QueueRule,
    pub telemetry: QueueRule,
    pub bulk: QueueRule,
}

impl Default for Queues {
    fn default() -> Self {
        use WhenFull::{DropNewest, DropOldest, Reject};
        let rule = |bytes, when_full| QueueRule { bytes, when_full, ttl_s: None };
        Queues {
            estop: rule(1 << 20, Reject),
            command: rule(16 << 20, Reject),
            ack: rule(1 << 20, Reject),
            housekeeping: rule(1 << 20, DropOldest),
            telemetry: rule(1 << 20, DropOldest),
            bulk: rule(16 << 20, DropNewest),
        }
    }
}

impl Queues {
    /// The rule of a class.
    pub fn of(&self, class: LinkClass) -> &QueueRule {
        match class {
            LinkClass::Estop => &self.estop,
            LinkClass::Command => &self.command,
            LinkClass::Ack => &self.ack,
            LinkClass::Housekeeping => &self.housekeeping,
            LinkClass::Telemetry => &self.telemetry,
            LinkClass::Bulk => &self.bulk,
        }
    }
}

/// How messages of a class wait.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct QueueRule {
    /// Room (bytes), 1 to 67108864.
    pub bytes: u64,
    /// What happens when there is none.
    pub when_full: WhenFull,
    /// A message whose transmission has not begun after this time (s, 0.001 to 86400) is dropped;
    /// a command is then `expired`. Never where absent, and not allowed for E-stops.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ttl_s: Option<f64>,
}

/// What gives way in a full queue.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum WhenFull {
    /// The oldest messages whose transmission has not begun.
    DropOldest,
    /// The new message.
    DropNewest,
    /// The new message, and whoever sends it is told.
    Reject,
}

/// Counters of one direction; sent + duplicated = delivered + dropped + in flight, always.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct LinkCounters {
    /// Messages handed to the link.
    pub sent: u64,
    /// Messages that arrived, copies included.
    pub delivered: u64,
    /// Messages dropped, for whatever cause.
    pub dropped: u64,
    /// Messages waiting or under way.
    pub in_flight: u64,
    /// Of these, still waiting for the end of their transmission.
    #[serde(default)]
    pub queued: u64,
    /// Copies that the link made.
    #[serde(default)]
    pub duplicated: u64,
    /// Why messages were dropped.
    #[serde(default)]
    pub dropped_by: DropCounters,
    /// Bytes handed to the link.
    #[serde(default)]
    pub bytes_sent: u64,
    /// Bytes transmitted, those that were lost then included.
    #[serde(default)]
    pub bytes_transmitted: u64,
}

/// What waits in the queue of a class.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct QueueFill {
    /// The class.
    pub class: LinkClass,
    /// Messages that wait for the end of their transmission.
    pub messages: u64,
    /// Bytes of them that are not yet transmitted.
    pub bytes: u64,
    /// Bytes that the queue takes.
    pub room_bytes: u64,
}

/// Messages dropped, by cause.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct DropCounters {
    /// Lost on the way.
    pub loss: u64,
    /// Arrived damaged.
    pub corruption: u64,
    /// Would have been transmitted in an outage.
    pub outage: u64,
    /// Waited longer than allowed.
    pub ttl: u64,
    /// Found no room, or gave way.
    pub overflow: u64,
}
