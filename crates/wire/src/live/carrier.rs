//! The connection to a rover that is a process of its own.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::time::Timestamp;

/// The connection that carries messages between ground and the rover's process. It has nothing to do
/// with the light time, which the link model adds on the ground.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CarrierReport {
    /// Where the rover's process listens.
    pub address: String,
    /// How it is.
    pub state: CarrierState,
    /// Since when it has been so.
    pub since: Timestamp,
    /// When anything came from the rover's process last; never where absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub heard: Option<Timestamp>,
    /// Why it is not up.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub why: Option<String>,
    /// What was counted since the ground began.
    pub counters: CarrierCounters,
}

/// How a carrier is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum CarrierState {
    /// It was never up.
    Connecting,
    /// Both ends hear each other.
    Up,
    /// It was lost, and is tried again.
    Reconnecting,
    /// The other end is not the one that is wanted; it is tried again all the same.
    Refused,
}

/// What one end of a carrier has counted.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CarrierCounters {
    /// Times that it came up.
    pub connections: u64,
    /// Messages handed over to be carried.
    pub sent: u64,
    /// Of these, how many the other end has confirmed.
    pub confirmed: u64,
    /// Of these, how many wait to be written.
    pub waiting: u64,
    /// Of these, how many are written and not confirmed.
    pub unconfirmed: u64,
    /// Of these, how many were taken back: too old, overtaken by an E-stop, or the other end was
    /// restarted.
    pub withdrawn: u64,
    /// Of these, how many gave way because too many waited.
    pub dropped: u64,
    /// Messages received, each once.
    pub received: u64,
    /// Messages that came again and were recognized.
    pub repeated: u64,
    /// Connections that were ended because what came was damaged or broke the protocol.
    pub damaged: u64,
}
