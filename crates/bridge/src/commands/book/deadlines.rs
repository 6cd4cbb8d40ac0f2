//! When words on commands are due, and what it means when none comes.

use wire::live::{CommandState, VerificationStage};
use wire::time::Timestamp;

use super::super::{ACK_SLACK_S, LightTimes, is_outstanding, stages};
use super::{CommandBook, Entry, SERVER};

/// A time in which nothing that the rover says reaches the ground, by the ground's clock.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Silence {
    /// Its first moment.
    pub begin: Timestamp,
    /// The first moment at which a word comes again.
    pub end: Timestamp,
}

impl CommandBook {
    /// What time brings: armed commands lapse, silent ones are overdue.
    pub fn tick(&mut self, now: Timestamp) {
        let lapsed: Vec<String> = self.ids(|e| {
            e.record.state == CommandState::Armed && e.record.armed_until.is_some_and(|t| now > t)
        });
        for id in lapsed {
            self.disarm(now, &id, SERVER, "was not sent within 30 s");
        }
        let overdue =
            self.ids(|e| self.waits_for_word(e) && self.deadline(e).is_some_and(|t| now > t));
        for id in overdue {
            let why = "no word from the rover when there should have been one; outcome unknown";
            self.lose_track(now, &id, why);
        }
    }

    /// When [`CommandBook::tick`] has something to do next.
    pub fn next_deadline(&self) -> Option<Timestamp> {
        let waits = |e: &Entry| match e.record.state {
            CommandState::Armed => e.record.armed_until,
            _ if self.waits_for_word(e) => self.deadline(e),
            _ => None,
        };
        self.entries.values().filter_map(waits).min()
    }

    /// The delay down has grown by `seconds` (s): words on sent commands may take that much longer.
    pub fn allow_longer(&mut self, now: Timestamp, who: &str, seconds: f64) {
        for id in self.ids(|e| is_outstanding(e.record.state)) {
            let why = format!("the delay of telemetry has grown by {seconds} s");
            let _ = self.transition(now, &id, who, Some(&why), |entry| {
                if Some(now) < entry.record.arrives {
                    entry.word = entry.word.map(|word| word.plus_seconds(seconds));
                }
                entry.deadline = entry.deadline.map(|deadline| deadline.plus_seconds(seconds));
            });
        }
    }

    /// Sets when no word can come: outages of the way down, in order and without overlap. Whatever is due
    /// within one is due when it is over.
    pub fn set_silences(&mut self, now: Timestamp, who: &str, silences: Vec<Silence>) {
        self.silences = silences;
        let told = |e: &Entry| {
            let word = e.word.filter(|_| e.record.state == CommandState::Sent);
            let word = word.map(|word| beyond(&self.silences, word, 0.0));
            word.is_none_or(|word| e.record.earliest_ack == Some(word))
                && (e.deadline.is_none() || e.record.overdue_after == self.deadline(e))
        };
        for id in self.ids(|e| is_outstanding(e.record.state) && !told(e)) {
            let why = "outages of the link were changed";
            let _ = self.transition(now, &id, who, Some(why), |_| ());
        }
    }

    /// The link was changed: the times of what has not arrived yet. What is sent now arrives after `light.up_s`.
    pub fn reconsider(&mut self, now: Timestamp, who: &str, light: LightTimes) {
        let arrives = |e: &Entry| match e.transmitted {
            false => Some(now.plus_seconds(light.up_s)),
            true => e.record.arrives.filter(|&arrives| arrives > now),
        };
        for id in self.ids(|e| e.record.state == CommandState::Sent) {
            let Some(entry) = self.entry_mut(&id) else { continue };
            let Some(arrives) = arrives(entry) else { continue };
            let word = Some(arrives.plus_seconds(light.down_s));
            if (entry.record.arrives, entry.word) != (Some(arrives), word) {
                let why = "the link was changed";
                let _ = self.transition(now, &id, who, Some(why), |e| e.expect(arrives, light));
            }
        }
    }

    fn waits_for_word(&self, entry: &Entry) -> bool {
        let state = entry.record.state;
        is_outstanding(state) && state != CommandState::Overdue && entry.transmitted
    }

    /// When a word on it is due.
    fn deadline(&self, entry: &Entry) -> Option<Timestamp> {
        entry.deadline.map(|deadline| beyond(&self.silences, deadline, ACK_SLACK_S))
    }
}

impl Entry {
    /// It arrives at `arrives` at the earliest; from then on a word is due.
    pub(super) fn expect(&mut self, arrives: Timestamp, light: LightTimes) {
        let word = arrives.plus_seconds(light.down_s);
        self.record.arrives = Some(arrives);
        self.word = Some(word);
        self.deadline = Some(word.plus_seconds(ACK_SLACK_S + light.spread_s));
    }

    /// Tells when the first word can be here, and by when one is due.
    pub(super) fn tell_times(&mut self, silences: &[Silence]) {
        if let Some(word) = self.word.filter(|_| self.record.state == CommandState::Sent) {
            self.record.earliest_ack = Some(beyond(silences, word, 0.0));
        }
        if let Some(deadline) = self.deadline {
            let deadline = beyond(silences, deadline, ACK_SLACK_S);
            self.record.overdue_after = Some(deadline);
            stages::due(&mut self.record, VerificationStage::Transmitted, deadline);
        }
    }
}

/// A moment, put off where it falls into silence to so much (s) after its end, when what was held back comes.
fn beyond(silences: &[Silence], at: Timestamp, slack_s: f64) -> Timestamp {
    let first = silences.partition_point(|silence| silence.end <= at);
    silences[first..].iter().fold(at, |at, silence| {
        if silence.begin <= at { at.max(silence.end.plus_seconds(slack_s)) } else { at }
    })
}
