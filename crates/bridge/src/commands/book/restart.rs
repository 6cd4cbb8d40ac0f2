//! Unknown outcomes: what a restart of the ground leaves, and how an operator resolves it.

use std::collections::BTreeMap;

use wire::live::{CommandEvent, CommandRecord, CommandState};
use wire::time::Timestamp;

use super::super::{CommandError, is_outstanding};
use super::{CommandBook, Entry, SERVER};

impl CommandBook {
    /// The commands of an earlier session, from its events in order. What was not sent has expired;
    /// of what was sent nobody knows the outcome; nothing is sent again. Plans are not continued.
    pub fn restore(now: Timestamp, events: impl IntoIterator<Item = CommandEvent>) -> CommandBook {
        let mut book = CommandBook::default();
        for CommandEvent { command: record, .. } in events {
            let id = record.id.clone();
            if let Some(entry) = book.entry_mut(&id) {
                entry.record = record;
                continue;
            }
            if book.make_room().is_err() {
                // A thousand commands under way at once: the oldest is in the log only.
                let oldest = book.entries.pop_first();
                oldest.map(|(_, entry)| book.order_of.remove(&entry.record.id));
            }
            let entry = Entry {
                record,
                after: 0,
                basis_joints_rad: BTreeMap::new(),
                basis_tolerance_rad: 0.0,
                model_hash: None,
                armed_by: None,
                restored: true,
                word: None,
                deadline: None,
                transmitted: true,
            };
            book.entries.insert(book.next_order, entry);
            book.order_of.insert(id, book.next_order);
            book.next_order += 1;
        }
        let open = |e: &Entry| matches!(e.record.state, CommandState::Staged | CommandState::Armed);
        for id in book.ids(open) {
            let why = "the ground was restarted; stage it anew";
            book.end(now, &id, SERVER, CommandState::Expired, Some(why));
        }
        // Those of a session before, too: the next restart reads this session's log.
        for id in book.ids(|e| is_outstanding(e.record.state)) {
            let why = "the ground was restarted before the rover's word came; outcome unknown";
            book.lose_track(now, &id, why);
        }
        book
    }

    /// An operator ends a command whose outcome was unknown, by what telemetry shows.
    pub fn resolve(
        &mut self,
        now: Timestamp,
        id: &str,
        who: &str,
        done: bool,
        why: &str,
    ) -> Result<CommandRecord, CommandError> {
        let record = self.known(id)?;
        let (id, state) = (record.id.clone(), record.state);
        if state != CommandState::Overdue {
            return Err(CommandError::NotOverdue { id, state });
        }
        let state = if done { CommandState::Done } else { CommandState::Failed };
        self.end(now, &id, who, state, Some(why));
        self.known(&id).cloned()
    }
}
