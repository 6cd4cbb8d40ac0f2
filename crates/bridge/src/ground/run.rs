//! Driving the ground in a program.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use super::Ground;
use super::alarm::Alarm;
use crate::clock::Clock;

/// Longest time between two steps (s).
pub const STEP_S: f64 = 0.05;
/// Shortest (s), so that a clock that stands still, or runs fast, does not turn this into a busy loop; half of
/// how late a message may be.
const SHORTEST_S: f64 = 0.001;

/// Steps the ground for ever: at each arrival, whenever the log has made something safe, and at
/// least every [`STEP_S`]. Ends by being dropped.
pub async fn run(ground: Arc<Mutex<Ground>>, clock: Arc<dyn Clock>) {
    let wake = locked(&ground).wake.clone();
    let alarm = Alarm::new();
    loop {
        let (next, arrivals) = {
            let mut ground = locked(&ground);
            ground.step(clock.now());
            if let Some(by_s) = clock.was_set_by() {
                ground.clock_was_set(clock.now(), by_s);
            }
            (ground.next_step(), ground.adapter.arrivals())
        };
        let arrived = async {
            match &arrivals {
                Some(arrivals) => arrivals.notified().await,
                None => std::future::pending().await,
            }
        };
        let wait_s = next.seconds_since(clock.now()).clamp(SHORTEST_S, STEP_S);
        let wait = Duration::from_secs_f64(wait_s);
        alarm.set(wait);
        tokio::select! {
            () = alarm.ring() => {}
            () = tokio::time::sleep(wait) => {}
            () = wake.notified() => {}
            () = arrived => {}
        }
    }
}

/// A panic in one request must not stop the rover's ground: its state is whole between statements
/// that can panic, so the lock is taken all the same.
fn locked(ground: &Mutex<Ground>) -> std::sync::MutexGuard<'_, Ground> {
    ground.lock().unwrap_or_else(PoisonError::into_inner)
}
