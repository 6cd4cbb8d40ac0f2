//! The ground's end: a rover that is another process, as an adapter.

use std::sync::Arc;
use std::time::Duration;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use tokio::net::TcpStream;
use tokio::sync::Notify;
use wire::live::{CarrierReport, CarrierState, Downlink, LinkClass, Uplink};
use wire::time::Timestamp;

use super::converse::{Shared, converse};
use super::end::{Bounds, End, Fate, Identity, Parcel};
use super::frame::{CarrierError, Side};
use crate::adapter::{LostUplink, RoverAdapter};
use crate::clock::Clock;

/// Longest time for a connection to be made (s).
const DIAL_S: f64 = 2.0;
/// Pause before it is tried again (s), at first and at most; in between it doubles.
const BACKOFF_S: [f64; 2] = [0.1, 2.0];

/// What the rover has said, as it is carried.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Said {
    /// Time on board, by the rover's clock.
    pub at: Timestamp,
    /// What.
    pub message: Downlink,
}

impl Parcel for Uplink {
    fn class(&self) -> LinkClass {
        match self {
            Uplink::Estop { .. } => LinkClass::Estop,
            Uplink::Heartbeat {} => LinkClass::Housekeeping,
            // A release that comes late is as unwelcome as a command.
            _ => LinkClass::Command,
        }
    }
}

impl Parcel for Said {
    fn class(&self) -> LinkClass {
        if matches!(self.message, Downlink::Telemetry(_)) {
            LinkClass::Telemetry
        } else if matches!(self.message, Downlink::Ack { .. }) {
            LinkClass::Ack
        } else {
            LinkClass::Bulk
        }
    }
}

/// The carrier as the ground shares it with the task that dials.
pub type GroundEnd = Shared<Uplink, Said>;

/// A rover behind a carrier.
pub struct RemoteRover {
    shared: Arc<GroundEnd>,
    address: String,
    last_onboard: Timestamp,
}

impl RemoteRover {
    /// A rover that is dialed at `address` by [`RemoteRover::dial`], or reached otherwise through
    /// [`RemoteRover::shared`]. `run` names this run of the ground, `robot` its robot model.
    pub fn new(
        now: Timestamp,
        address: &str,
        run: String,
        robot: String,
        bounds: Bounds,
    ) -> RemoteRover {
        let end = End::new(now, Identity { side: Side::Ground, run, robot }, bounds);
        let address = address.into();
        RemoteRover { shared: Arc::new(Shared::new(end)), address, last_onboard: Timestamp(0) }
    }

    /// What a connection needs.
    pub fn shared(&self) -> Arc<GroundEnd> {
        self.shared.clone()
    }

    /// Dials for ever; ends by being dropped.
    pub fn dial(&self, clock: Arc<dyn Clock>) -> impl Future<Output = ()> + Send + use<> {
        dial(self.shared.clone(), self.address.clone(), clock)
    }
}

/// Dials the address for ever, with growing pauses.
async fn dial(shared: Arc<GroundEnd>, address: String, clock: Arc<dyn Clock>) {
    // So that many grounds that lost a rover do not all come at the same instant.
    let mut rng = ChaCha8Rng::seed_from_u64(clock.now().0);
    let mut pause_s = BACKOFF_S[0];
    loop {
        let dialed = tokio::time::timeout(
            Duration::from_secs_f64(DIAL_S),
            TcpStream::connect(address.as_str()),
        );
        let why = match dialed.await {
            Ok(Ok(stream)) => {
                // An E-stop does not wait for more to say.
                let _ = stream.set_nodelay(true);
                let ups = shared.end().counters().connections;
                let why = converse(&*shared, &*clock, stream).await;
                if shared.end().counters().connections > ups {
                    pause_s = BACKOFF_S[0];
                }
                why
            }
            Ok(Err(error)) => no_connection(&shared, &*clock, error.to_string()),
            Err(_) => no_connection(&shared, &*clock, format!("no answer within {DIAL_S} s")),
        };
        tracing::debug!("rover at {address}: {why}");
        let wait = Duration::from_secs_f64(pause_s * rng.random_range(0.7..1.0));
        pause_s = (pause_s * 2.0).min(BACKOFF_S[1]);
        let asked = tokio::time::timeout(wait, shared.again.notified()).await.is_ok();
        if asked {
            pause_s = BACKOFF_S[0];
        }
        // What is too old is taken back while nobody is there, too.
        let _ = shared.end().tick(clock.now());
    }
}

fn no_connection(shared: &GroundEnd, clock: &dyn Clock, why: String) -> CarrierError {
    let why = CarrierError::Connection(why);
    shared.end().close(clock.now(), &why);
    shared.arrived.notify_one();
    why
}

impl RoverAdapter for RemoteRover {
    fn uplink(&mut self, now: Timestamp, message: Uplink) {
        self.shared.end().push(now, message);
        self.shared.write.notify_one();
    }

    fn advance(&mut self, now: Timestamp) -> Vec<(Timestamp, Downlink)> {
        let (heard, ahead_s) = {
            let mut end = self.shared.end();
            if !end.is_up() {
                // Down, nothing but the age of what waits can come of it.
                let _ = end.tick(now);
            }
            (end.take_received(), end.peer_ahead_s())
        };
        if !heard.is_empty() {
            self.shared.write.notify_one();
        }
        let mut all = Vec::with_capacity(heard.len());
        for said in heard {
            match said {
                Ok(Said { at, message }) => {
                    // Times on board are told in the ground's time, and never go back.
                    self.last_onboard = self.last_onboard.max(at.plus_seconds(-ahead_s).min(now));
                    all.push((self.last_onboard, message));
                }
                Err(text) => {
                    let text: String = text.chars().take(200).collect();
                    tracing::warn!("the rover says what this version does not know: {text}");
                }
            }
        }
        all
    }

    fn carrier(&self) -> Option<CarrierReport> {
        let end = self.shared.end();
        let (state, since, heard, why) = end.state();
        let (why, counters) = (why.map(str::to_owned), end.counters());
        Some(CarrierReport { address: self.address.clone(), state, since, heard, why, counters })
    }

    fn takes_commands(&self) -> bool {
        self.shared.end().state().0 == CarrierState::Up
    }

    fn take_lost(&mut self) -> Vec<LostUplink> {
        let lost = self.shared.end().take_lost();
        let lost = lost.into_iter().map(|(uplink, fate)| match fate {
            Fate::NeverArrived(reason) => {
                LostUplink { uplink, never_arrived: true, why: reason.text() }
            }
            Fate::Unknown => {
                let why = "the rover's process was restarted before it confirmed the command";
                LostUplink { uplink, never_arrived: false, why }
            }
        });
        lost.collect()
    }

    fn reconnect(&mut self) {
        self.shared.again.notify_one();
    }

    fn arrivals(&self) -> Option<Arc<Notify>> {
        Some(self.shared.arrived.clone())
    }
}
