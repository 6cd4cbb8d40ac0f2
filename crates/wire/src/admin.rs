//! Managing the server while it runs.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::live::{CarrierReport, LinkCounters};

/// What the server consists of, and how full it is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct AdminReport {
    /// What drives the rover.
    pub adapter: AdapterReport,
    /// Everything that waits, with its bound where it has one.
    pub queues: Vec<QueueReport>,
    /// The link, up.
    pub link_up: LinkCounters,
    /// The link, down.
    pub link_down: LinkCounters,
    /// The flight log.
    pub recorder: RecorderReport,
    /// Which of its messages the server tells, as `info,bridge=debug`; none where that cannot be changed.
    pub log_filter: Option<String>,
}

/// The adapter in use.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct AdapterReport {
    /// `simulated` within the server, or `remote`: a process of its own.
    pub kind: AdapterKind,
    /// Its connection, where it is remote.
    pub carrier: Option<CarrierReport>,
}

/// Kinds of adapters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum AdapterKind {
    /// The simulated rover, within the server.
    Simulated,
    /// A rover that is a process of its own.
    Remote,
}

/// A queue.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct QueueReport {
    /// Its name.
    pub name: String,
    /// How many are in it.
    pub waiting: u64,
    /// How many it takes; no bound of its own where absent.
    pub most: Option<u64>,
}

/// What the flight recorder has counted.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct RecorderReport {
    /// The log being written.
    pub log_id: String,
    /// Batches synced.
    pub commits: u64,
    /// Messages synced.
    pub messages: u64,
    /// Messages dropped.
    pub dropped: u64,
    /// Segments begun.
    pub segments: u64,
    /// Why the disk does not take everything at present.
    pub error: Option<String>,
}

/// Which messages the server is to tell.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct LogFilter {
    /// Level, or levels by part, as `info` or `warn,bridge=debug`; 1 to 400 characters.
    pub filter: String,
}
