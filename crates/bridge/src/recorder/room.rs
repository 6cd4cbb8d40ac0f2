//! Room on the disk: what is given up first when it runs short.

use std::io;
use std::sync::Arc;

use wire::live::EventLevel;

use super::storage::{Space, Storage};

const MIB: u64 = 1 << 20;

/// How short room is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Level {
    /// Not at all.
    Ample,
    /// Soon; people are told.
    Low,
    /// Bulk is no longer logged.
    NoBulk,
    /// Durable messages only.
    Full,
}

/// The level for what is free. Shares of the disk, but never more than a fixed amount: a tenth of a
/// large disk is a lot.
pub fn level(space: Space) -> Level {
    let below = |percent: u64, most: u64| space.free < (space.total / 100 * percent).min(most);
    match () {
        () if below(1, 256 * MIB) => Level::Full,
        () if below(5, 1024 * MIB) => Level::NoBulk,
        () if below(10, 2048 * MIB) => Level::Low,
        () => Level::Ample,
    }
}

/// The watch on the disk, with the reserve.
pub struct Room {
    storage: Arc<dyn Storage>,
    name: String,
    bytes: u64,
    held: bool,
    level: Level,
}

impl Room {
    /// Takes the reserve, if the disk has it.
    pub fn new(storage: Arc<dyn Storage>, name: String, bytes: u64) -> Room {
        let mut room = Room { storage, name, bytes, held: false, level: Level::Ample };
        room.hold();
        room
    }

    pub fn level(&self) -> Level {
        self.level
    }

    /// Looks at the disk; tells a change of level.
    pub fn look(&mut self) -> Option<(EventLevel, String)> {
        // A disk that does not tell its room is found full by writing.
        let space = self.storage.space().ok();
        let mut now = space.map_or(Level::Ample, level);
        if self.level == Level::Full && now < Level::Full {
            // Not before there is room for the reserve and some more.
            let spare = space.is_none_or(|s| s.free > self.bytes + self.bytes / 4);
            if !(self.held || (spare && self.hold())) {
                now = Level::Full;
            }
        }
        let before = std::mem::replace(&mut self.level, now);
        let free = space.map_or_else(String::new, |s| format!(", {} MiB free", s.free / MIB));
        match now {
            _ if now == before => None,
            Level::Full => Some((
                EventLevel::Critical,
                format!("the disk is full{free}: telemetry is no longer logged, commands are"),
            )),
            Level::NoBulk => Some((
                EventLevel::Warning,
                format!("the disk is nearly full{free}: no bulk logged"),
            )),
            Level::Low => {
                Some((EventLevel::Warning, format!("the disk of the flight log fills up{free}")))
            }
            Level::Ample => {
                Some((EventLevel::Info, format!("the disk of the flight log has room again{free}")))
            }
        }
    }

    /// The disk took nothing more: lets the reserve go. What to tell, the first time.
    pub fn exhausted(&mut self) -> Option<(EventLevel, String)> {
        if std::mem::take(&mut self.held) {
            // A reserve that cannot be removed helps nobody; the next write tells.
            let _ = self.storage.remove(&self.name);
        }
        let before = std::mem::replace(&mut self.level, Level::Full);
        (before != Level::Full).then(|| {
            let text = "the disk is full: telemetry is no longer logged, commands are";
            (EventLevel::Critical, text.into())
        })
    }

    /// True if a copy of `bytes` can be made without coming near the end of the disk.
    pub fn has_room_for(storage: &dyn Storage, bytes: u64) -> bool {
        storage.space().map_or(true, |space| {
            level(Space { free: space.free.saturating_sub(bytes), ..space }) < Level::Full
        })
    }

    fn hold(&mut self) -> bool {
        self.held = self.bytes == 0 || self.storage.reserve(&self.name, self.bytes).is_ok();
        self.held
    }
}

impl Drop for Room {
    fn drop(&mut self) {
        if self.held && self.bytes > 0 {
            // What is left behind is removed when the next recorder starts.
            let _ = self.storage.remove(&self.name);
        }
    }
}

/// True for errors that mean that there is no room.
pub fn is_full(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded)
}
