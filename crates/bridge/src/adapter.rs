//! What a rover, simulated or real, must do to be driven through the bridge.

use wire::live::{Downlink, Uplink};
use wire::time::Timestamp;

/// A rover behind the link. The light time is not its business: the link model has it.
///
/// The calls come in order of time, and between two calls of `uplink` the adapter is advanced to
/// the second one's instant, so that a simulated rover gets each message exactly when it arrives.
pub trait RoverAdapter: Send {
    /// `message` reaches the rover at `now`.
    fn uplink(&mut self, now: Timestamp, message: Uplink);

    /// Goes on to `now` and gives what the rover has said since the last call, each with its time
    /// on board, in the order of sending. Times on board later than `now` count as `now` for the
    /// link.
    fn advance(&mut self, now: Timestamp) -> Vec<(Timestamp, Downlink)>;
}
