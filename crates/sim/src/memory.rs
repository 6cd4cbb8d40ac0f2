//! Which identities the rover has seen.

use std::collections::VecDeque;

/// How many identities the rover remembers; beyond, the oldest is forgotten.
pub const REMEMBERED_IDS: usize = 1024;

/// The last identities received, oldest first.
#[derive(Debug, Clone, Default)]
pub(crate) struct Memory {
    ids: VecDeque<String>,
}

impl Memory {
    /// True if `id` is remembered.
    pub fn holds(&self, id: &str) -> bool {
        self.ids.iter().any(|known| known == id)
    }

    /// Remembers `id`.
    pub fn keep(&mut self, id: &str) {
        if self.ids.len() == REMEMBERED_IDS {
            self.ids.pop_front();
        }
        self.ids.push_back(id.to_owned());
    }
}
