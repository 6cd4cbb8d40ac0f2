//! A wait that ends on time: timers of the runtime end up to two milliseconds late, by design.

use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::sync::Notify;

/// Rings once after the time it was last set to, by a thread of its own. A waiting task should have a timer of
/// the runtime beside it: under tokio's paused time only that one follows.
pub(super) struct Alarm(Arc<Shared>);

#[derive(Default)]
struct Shared {
    state: Mutex<State>,
    changed: Condvar,
    rings: Notify,
}

#[derive(Default)]
struct State {
    /// Set and not begun to wait for.
    wait: Option<Duration>,
    closed: bool,
}

impl Alarm {
    /// Without a thread, where none can be had, it never rings.
    pub fn new() -> Alarm {
        let shared = Arc::new(Shared::default());
        let of_thread = shared.clone();
        let thread = std::thread::Builder::new().name("alarm".into());
        if let Err(error) = thread.spawn(move || of_thread.keep()) {
            tracing::warn!("messages may come 2 ms late: no thread for the alarm ({error})");
        }
        Alarm(shared)
    }

    /// Rings after `wait` from now, and not at the time set before.
    pub fn set(&self, wait: Duration) {
        self.0.locked().wait = Some(wait);
        self.0.changed.notify_one();
    }

    /// Waits for the ring.
    pub async fn ring(&self) {
        self.0.rings.notified().await;
    }
}

impl Drop for Alarm {
    fn drop(&mut self) {
        self.0.locked().closed = true;
        self.0.changed.notify_one();
    }
}

impl Shared {
    fn keep(&self) {
        let mut state = self.locked();
        while !state.closed {
            state = match state.wait.take() {
                None => self.changed.wait(state).unwrap_or_else(PoisonError::into_inner),
                Some(wait) => {
                    let waited = self.changed.wait_timeout(state, wait);
                    let (state, ended) = waited.unwrap_or_else(PoisonError::into_inner);
                    if ended.timed_out() && state.wait.is_none() {
                        self.rings.notify_one();
                    }
                    state
                }
            };
        }
    }

    fn locked(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
