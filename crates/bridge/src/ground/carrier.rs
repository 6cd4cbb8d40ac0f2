//! A rover that is a process of its own: whether it is there, and what did not reach it.

use wire::live::{CarrierReport, CarrierState, CommandState, EventLevel, Uplink};
use wire::time::Timestamp;

use super::Ground;
use crate::adapter::LostUplink;
use crate::commands::CommandError;

impl Ground {
    /// The carrier to the rover's process, where it is one.
    pub fn carrier(&self) -> Option<CarrierReport> {
        self.adapter.carrier()
    }

    /// Makes the connection to the rover's process anew; false where there is none.
    pub fn reconnect(&mut self, now: Timestamp, who: &str) -> bool {
        let now = self.tick(now);
        if self.adapter.carrier().is_none() {
            return false;
        }
        self.adapter.reconnect();
        let text = "asked for the connection to the rover to be made anew";
        self.notice(now, EventLevel::Caution, who, text);
        true
    }

    /// Tells what has changed, and what became of messages that were not carried.
    pub(super) fn watch_carrier(&mut self, now: Timestamp) {
        for LostUplink { uplink, never_arrived, why } in self.adapter.take_lost() {
            self.lost(now, &uplink, never_arrived, why);
        }
        let Some(report) = self.adapter.carrier() else { return };
        if self.carrier == Some(report.state) {
            return;
        }
        let before = self.carrier.replace(report.state);
        let (level, text) = self.told(now, before, &report);
        self.notice(now, level, "server", &text);
        self.report_link();
    }

    fn told(
        &mut self,
        now: Timestamp,
        before: Option<CarrierState>,
        report: &CarrierReport,
    ) -> (EventLevel, String) {
        let address = &report.address;
        let why = report.why.as_deref().unwrap_or("no reason is known");
        match report.state {
            CarrierState::Up => {
                let text = match self.carrier_lost.take() {
                    Some(lost) => format!(
                        "the connection to the rover at {address} is back after {:.1} s",
                        now.seconds_since(lost)
                    ),
                    None => format!("the rover at {address} is connected"),
                };
                (EventLevel::Info, text)
            }
            CarrierState::Connecting => {
                (EventLevel::Caution, format!("the rover at {address} is being dialed"))
            }
            CarrierState::Reconnecting => {
                if before == Some(CarrierState::Up) {
                    self.carrier_lost = Some(now);
                }
                let text = format!(
                    "the connection to the rover at {address} is lost ({why}); it is dialed anew"
                );
                (EventLevel::Warning, text)
            }
            CarrierState::Refused => {
                if before == Some(CarrierState::Up) {
                    self.carrier_lost = Some(now);
                }
                (EventLevel::Warning, format!("the rover at {address} is not this one: {why}"))
            }
        }
    }

    fn lost(&mut self, now: Timestamp, uplink: &Uplink, never_arrived: bool, why: &str) {
        match uplink {
            Uplink::Command { id, .. } if never_arrived => {
                self.book.never_arrived(now, id, &format!("it never reached the rover: {why}"));
            }
            Uplink::Command { id, .. } => {
                self.book.outcome_unknown(now, id, &format!("{why}; outcome unknown"));
            }
            Uplink::EstopRelease { id } if self.estop.release_lost(id) => {
                let text = format!("the release of the E-stop did not reach the rover: {why}");
                self.notice(now, EventLevel::Warning, "server", &text);
                self.report_link();
            }
            // E-stops are never taken back; the rest is of no consequence.
            _ => {}
        }
        self.publish_events();
    }

    /// Refuses what cannot be handed over now.
    pub(super) fn rover_must_be_there(&self) -> Result<(), CommandError> {
        if self.adapter.takes_commands() {
            return Ok(());
        }
        let why = self.adapter.carrier().and_then(|report| report.why);
        let why = why.unwrap_or_else(|| "it was never there".into());
        Err(CommandError::RoverUnreachable { why })
    }

    /// The commands that are under way, for who exchanges the rover or looks at queues.
    pub fn queues(&self) -> Queues {
        let count = |wanted: fn(CommandState) -> bool| {
            self.book.records().filter(|record| wanted(record.state)).count()
        };
        Queues {
            log_pending: self.pending.len(),
            staged: count(|s| matches!(s, CommandState::Staged | CommandState::Armed)),
            under_way: count(crate::commands::is_outstanding),
        }
    }
}

/// How many commands wait where.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Queues {
    /// Sent, and waiting for the log before they go to the link.
    pub log_pending: usize,
    /// Staged or armed.
    pub staged: usize,
    /// Sent, and not ended yet.
    pub under_way: usize,
}
