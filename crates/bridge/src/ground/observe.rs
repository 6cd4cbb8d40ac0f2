//! What telemetry shows of the preconditions of a command.

use serde_json::Value;
use wire::live::{Precondition, channel};
use wire::precondition::{Unmet, met};
use wire::time::Timestamp;

use super::Ground;

impl Ground {
    /// Do these hold by the last messages received? They come back with the time on board of the
    /// message that each was found in.
    pub fn observe(
        &self,
        now: Timestamp,
        preconditions: &[Precondition],
    ) -> Result<Vec<Precondition>, Unmet> {
        let now = self.now.max(now);
        let mut messages: Vec<(&str, Option<Value>)> = Vec::new();
        let mut observed = Vec::with_capacity(preconditions.len());
        let onboard = self.latest.as_ref().map_or(Timestamp(0), |latest| latest.onboard_time);
        for wanted in preconditions {
            if !messages.iter().any(|(name, _)| *name == wanted.channel) {
                messages.push((&wanted.channel, self.last_message(&wanted.channel)));
            }
            let of_channel = messages.iter().find(|(name, _)| *name == wanted.channel);
            let message = of_channel.and_then(|(_, message)| message.as_ref());
            met(wanted, message, onboard, now)?;
            observed.push(Precondition { observed: Some(onboard), ..wanted.clone() });
        }
        Ok(observed)
    }

    /// The last message of a channel that commands may wait for.
    fn last_message(&self, name: &str) -> Option<Value> {
        match name {
            channel::ROVER_STATE => {
                self.latest.as_ref().and_then(|latest| serde_json::to_value(&latest.frame).ok())
            }
            channel::ROVER_STABILITY => {
                self.stability.as_ref().and_then(|stability| serde_json::to_value(stability).ok())
            }
            _ => None,
        }
    }
}
