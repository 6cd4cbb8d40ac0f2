//! What telemetry shows of the preconditions of a command.

use serde_json::Value;
use wire::live::{Precondition, channel};
use wire::precondition::{CHANNELS, Unmet, find, met};
use wire::time::Timestamp;

use super::Ground;

/// A precondition beside what telemetry shows.
#[derive(Debug, Clone, PartialEq)]
pub struct Shown {
    /// The field's value in the last message of its channel; none where there is no such field.
    pub found: Option<Value>,
    /// Age of that message by its time on board (s); none before the first.
    pub age_s: Option<f64>,
    /// Does it hold?
    pub holds: Result<(), Unmet>,
}

impl Ground {
    /// What the last messages received show of each of these.
    pub fn show(&self, now: Timestamp, preconditions: &[Precondition]) -> Vec<Shown> {
        let now = self.now.max(now);
        let latest = self.latest.as_ref();
        let onboard = latest.map_or(Timestamp(0), |latest| latest.onboard_time);
        let age_s = latest.map(|latest| now.seconds_since(latest.onboard_time));
        let messages = CHANNELS.map(|channel| (channel, self.last_message(channel)));
        let shown = |wanted: &Precondition| {
            let of_channel = messages.iter().find(|(channel, _)| *channel == wanted.channel);
            let message = of_channel.and_then(|(_, message)| message.as_ref());
            let found = message.and_then(|message| find(message, &wanted.field)).cloned();
            Shown { found, age_s, holds: met(wanted, message, onboard, now) }
        };
        preconditions.iter().map(shown).collect()
    }

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
