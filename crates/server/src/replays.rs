//! Replays of logs: each is advanced by a task of its own and heard by any number of listeners.

mod margins;
mod opening;

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use bridge::bus::ChannelMessage;
use bridge::clock::Clock;
use bridge::replay::Replay;
use tokio::sync::{Notify, broadcast};
use wire::resources::{ReplayChange, ReplayState};

use crate::error::ApiError;

pub use opening::Opening;

/// Messages kept for slow listeners of one replay.
const CAPACITY: usize = 4096;
/// Longest time between two looks at a replay (s).
const STEP_S: f64 = 0.1;
/// Shortest (s).
const SHORTEST_S: f64 = 0.002;
/// The state of a replay is told this often (s).
const TELL_S: f64 = 1.0;

/// What listeners of a replay get.
#[derive(Debug, Clone)]
pub enum ReplayItem {
    /// A message of the log.
    Message(Arc<ChannelMessage>),
    /// Where the replay is.
    State(ReplayState),
}

/// A replay with its listeners.
pub struct Player {
    replay: Mutex<Replay>,
    sender: broadcast::Sender<ReplayItem>,
    changed: Notify,
    clock: Arc<dyn Clock>,
}

/// The replays held.
pub struct Replays {
    most: usize,
    players: Mutex<BTreeMap<String, Arc<Player>>>,
}

impl Replays {
    /// At most `most` replays at a time.
    pub fn new(most: usize) -> Replays {
        Replays { most, players: Mutex::default() }
    }

    /// An error if there is no room for another one.
    pub fn room(&self) -> Result<(), ApiError> {
        if self.locked().len() < self.most {
            return Ok(());
        }
        let message = "as many replays as are taken are held; end one (DELETE /replays/{id})";
        Err(ApiError::new("busy", message))
    }

    /// Takes a replay in and begins to play it.
    pub fn start(
        &self,
        id: &str,
        replay: Replay,
        clock: Arc<dyn Clock>,
    ) -> Result<ReplayState, ApiError> {
        self.room()?;
        let (sender, _) = broadcast::channel(CAPACITY);
        let changed = Notify::new();
        let player = Arc::new(Player { replay: Mutex::new(replay), sender, changed, clock });
        let state = player.state();
        self.locked().insert(id.into(), player.clone());
        let weak = Arc::downgrade(&player);
        drop(player);
        tokio::spawn(async move {
            let mut told_s = f64::INFINITY;
            // Ends when the replay is no longer held.
            while let Some(player) = weak.upgrade() {
                let wait_s = player.advance(&mut told_s);
                let changed = tokio::time::timeout(
                    Duration::from_secs_f64(wait_s),
                    player.changed.notified(),
                );
                told_s += wait_s;
                if changed.await.is_ok() {
                    told_s = f64::INFINITY;
                }
            }
        });
        Ok(state)
    }

    /// A replay by its id.
    pub fn get(&self, id: &str) -> Result<Arc<Player>, ApiError> {
        self.locked().get(id).cloned().ok_or_else(unknown)
    }

    /// All replays.
    pub fn list(&self) -> Vec<ReplayState> {
        self.locked().values().map(|player| player.state()).collect()
    }

    /// Ends a replay.
    pub fn end(&self, id: &str) -> Result<(), ApiError> {
        self.locked().remove(id).map(|_| ()).ok_or_else(unknown)
    }

    fn locked(&self) -> MutexGuard<'_, BTreeMap<String, Arc<Player>>> {
        self.players.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn unknown() -> ApiError {
    ApiError::new("replay_unknown", "there is no such replay; begin one with POST /replays")
}

impl Player {
    /// The replay as it is.
    pub fn state(&self) -> ReplayState {
        self.locked().state(self.clock.now())
    }

    /// Changes place, speed or pause; what is absent stays.
    pub fn change(&self, change: &ReplayChange) -> Result<ReplayState, ApiError> {
        let now = self.clock.now();
        let mut replay = self.locked();
        if let Some(rate) = change.rate {
            replay.set_rate(now, rate)?;
        }
        match change.paused {
            Some(true) => replay.pause(now),
            Some(false) => replay.resume(now),
            None => {}
        }
        if let Some(at) = change.at {
            let shown = replay.seek(now, at)?;
            self.tell(shown);
        }
        if change.step == Some(true) {
            let next = replay.step(now)?;
            self.tell(next.into_iter().collect());
        }
        let state = replay.state(now);
        drop(replay);
        self.changed.notify_one();
        Ok(state)
    }

    /// The state where the replay is, and all that follows.
    pub fn subscribe(&self) -> (Vec<Arc<ChannelMessage>>, broadcast::Receiver<ReplayItem>) {
        let mut replay = self.locked();
        // A disk that does not give the state now is told by the next message.
        let shown = replay.snapshot().unwrap_or_default().into_iter().map(Arc::new).collect();
        (shown, self.sender.subscribe())
    }

    /// Gives what is due; the time until more is (s).
    fn advance(&self, told_s: &mut f64) -> f64 {
        let now = self.clock.now();
        let mut replay = self.locked();
        match replay.advance(now) {
            Ok(messages) => self.tell(messages),
            Err(error) => {
                tracing::error!("a replay is held: {error}");
                replay.pause(now);
            }
        }
        if *told_s >= TELL_S {
            *told_s = 0.0;
            // Nobody listening is no error.
            let _ = self.sender.send(ReplayItem::State(replay.state(now)));
        }
        let due_s = replay.next_due().map_or(STEP_S, |due| due.seconds_since(now));
        due_s.clamp(SHORTEST_S, STEP_S)
    }

    fn tell(&self, messages: Vec<ChannelMessage>) {
        for message in messages {
            // Nobody listening is no error.
            let _ = self.sender.send(ReplayItem::Message(Arc::new(message)));
        }
    }

    fn locked(&self) -> MutexGuard<'_, Replay> {
        self.replay.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
