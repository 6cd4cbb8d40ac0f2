//! What a rover, simulated or real, must do to be driven through the bridge.

use std::sync::Arc;

use tokio::sync::Notify;
use wire::live::{CarrierReport, Downlink, Uplink};
use wire::time::Timestamp;

/// A rover behind the link. The light time is not its business: the link model has it.
///
/// The calls come in order of time, and between two calls of `uplink` the adapter is advanced to
/// the second one's instant, so that a simulated rover gets each message exactly when it arrives.
/// What is said below of a carrier is for rovers that are a process of their own.
pub trait RoverAdapter: Send {
    /// `message` reaches the rover at `now`.
    fn uplink(&mut self, now: Timestamp, message: Uplink);

    /// Goes on to `now` and gives what the rover has said since the last call, each with its time
    /// on board, in the order of sending. Times on board later than `now` count as `now` for the
    /// link.
    fn advance(&mut self, now: Timestamp) -> Vec<(Timestamp, Downlink)>;

    /// The carrier, where there is one.
    fn carrier(&self) -> Option<CarrierReport> {
        None
    }

    /// Can a command be handed over now?
    fn takes_commands(&self) -> bool {
        true
    }

    /// Messages of earlier calls of `uplink` that will not be carried, since the last call.
    fn take_lost(&mut self) -> Vec<LostUplink> {
        Vec::new()
    }

    /// Makes the connection anew.
    fn reconnect(&mut self) {}

    /// Notified when the rover has said something.
    fn arrivals(&self) -> Option<Arc<Notify>> {
        None
    }
}

/// A message that will not be carried to the rover.
#[derive(Debug, Clone, PartialEq)]
pub struct LostUplink {
    /// The message.
    pub uplink: Uplink,
    /// True where the rover has certainly never seen it; else nobody knows.
    pub never_arrived: bool,
    /// Why.
    pub why: &'static str,
}
