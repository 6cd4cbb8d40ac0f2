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
                let ack = entry.record.earliest_ack;
                if let Some(ack) = ack.filter(|_| Some(now) < entry.record.arrives) {
                    entry.record.earliest_ack = Some(ack.plus_seconds(seconds));
                }
                entry.deadline = entry.deadline.map(|deadline| deadline.plus_seconds(seconds));
            });
        }
    }

    /// Sets when no word can come: outages of the way down, in order and without overlap. Whatever is due
    /// within one is due when it is over.
    pub fn set_silences(&mut self, now: Timestamp, who: &str, silences: Vec<Silence>) {
        self.silences = silences;
        let told = |e: &Entry| e.deadline.is_none() || e.record.overdue_after == self.deadline(e);
        for id in self.ids(|e| is_outstanding(e.record.state) && !told(e)) {
            let why = "outages of the link were changed";
            let _ = self.transition(now, &id, who, Some(why), |_| ());
        }
    }

    /// The link was changed: the times of what has not arrived yet. What is sent now arrives after `light.up_s`
    /// (s); a word that is said at a moment takes `word_s` of it (s) down.
    pub fn reconsider(
        &mut self,
        now: Timestamp,
        who: &str,
        light: LightTimes,
        word_s: impl Fn(Timestamp) -> f64,
    ) {
        let arrives = |e: &Entry| match e.transmitted {
            false => Some(now.plus_seconds(light.up_s)),
            true => e.record.arrives.filter(|&arrives| arrives > now),
        };
        for id in self.ids(|e| e.record.state == CommandState::Sent) {
            let Some(arrives) = self.entry_mut(&id).and_then(|e| arrives(e)) else { continue };
            let light = LightTimes { down_s: word_s(arrives), ..light };
            let same = |e: &Entry| {
                let ack = arrives.plus_seconds(light.down_s);
                (e.record.arrives, e.record.earliest_ack) == (Some(arrives), Some(ack))
            };
            if self.entry_mut(&id).is_some_and(|e| !same(e)) {
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
        entry.deadline.map(|deadline| beyond(&self.silences, deadline))
    }
}

impl Entry {
    /// It arrives at `arrives` at the earliest; from then on a word is due.
    pub(super) fn expect(&mut self, arrives: Timestamp, light: LightTimes) {
        let earliest_ack = arrives.plus_seconds(light.down_s);
        self.record.arrives = Some(arrives);
        self.record.earliest_ack = Some(earliest_ack);
        self.deadline = Some(earliest_ack.plus_seconds(ACK_SLACK_S + light.spread_s));
    }

    /// Tells when a word is due.
    pub(super) fn tell_deadline(&mut self, silences: &[Silence]) {
        if let Some(deadline) = self.deadline.map(|deadline| beyond(silences, deadline)) {
            self.record.overdue_after = Some(deadline);
            stages::due(&mut self.record, VerificationStage::Transmitted, deadline);
        }
    }
}

/// A deadline, put off where it falls into silence: to a little after its end, as what was held back comes
/// then.
fn beyond(silences: &[Silence], deadline: Timestamp) -> Timestamp {
    let first = silences.partition_point(|silence| silence.end <= deadline);
    silences[first..].iter().fold(deadline, |deadline, silence| {
        let within = silence.begin <= deadline;
        if within { deadline.max(silence.end.plus_seconds(ACK_SLACK_S)) } else { deadline }
    })
}
