//! The one place where time enters the project.

use std::sync::atomic::{AtomicI64, AtomicU64, Ordering};

use wire::time::Timestamp;

/// Tells the time. Never goes back.
pub trait Clock: Send + Sync {
    /// The present time.
    fn now(&self) -> Timestamp;

    /// By how much the machine's clock was set since the last call (s, forward positive), where it was:
    /// to be told, for [`Clock::now`] goes on as before.
    fn was_set_by(&self) -> Option<f64> {
        None
    }
}

/// The machine's clock counts as set from this step on (ns): less is its being kept in time.
const SET_NS: i64 = 500_000_000;

/// The machine's clock as it was at the start, carried on by the monotonic clock: steps of the
/// wall clock, forward or back, do not reach the log. Follows tokio's paused time in tests.
pub struct SystemClock {
    base: Timestamp,
    started: tokio::time::Instant,
    /// Reads the machine's clock.
    wall: Box<dyn Fn() -> Timestamp + Send + Sync>,
    /// By how much that was ahead of this clock when it was looked at last (ns).
    ahead_ns: AtomicI64,
}

impl SystemClock {
    /// A clock set to the machine's time.
    pub fn new() -> SystemClock {
        SystemClock::reading(Box::new(machine_time))
    }

    /// A clock set by this reading of a machine's clock, which it goes on to watch.
    pub fn reading(wall: Box<dyn Fn() -> Timestamp + Send + Sync>) -> SystemClock {
        let (base, started) = (wall(), tokio::time::Instant::now());
        SystemClock { base, started, wall, ahead_ns: AtomicI64::new(0) }
    }

    /// A clock that shows `base` now and goes on from there, watching no other.
    pub fn starting_at(base: Timestamp) -> SystemClock {
        let started = tokio::time::Instant::now();
        let wall = move || Timestamp(base.0.saturating_add(nanos(started.elapsed())));
        SystemClock { base, started, wall: Box::new(wall), ahead_ns: AtomicI64::new(0) }
    }
}

impl std::fmt::Debug for SystemClock {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("SystemClock").field("base", &self.base).finish_non_exhaustive()
    }
}

fn machine_time() -> Timestamp {
    // The only reading of the wall clock in the project; see clippy.toml.
    #[allow(clippy::disallowed_methods)]
    let since_1970 =
        std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap_or_default();
    Timestamp(nanos(since_1970))
}

impl Default for SystemClock {
    fn default() -> Self {
        SystemClock::new()
    }
}

impl Clock for SystemClock {
    fn now(&self) -> Timestamp {
        Timestamp(self.base.0.saturating_add(nanos(self.started.elapsed())))
    }

    fn was_set_by(&self) -> Option<f64> {
        let ahead = i128::from((self.wall)().0) - i128::from(self.now().0);
        let ahead = i64::try_from(ahead).unwrap_or(if ahead < 0 { i64::MIN } else { i64::MAX });
        let step = ahead.saturating_sub(self.ahead_ns.load(Ordering::SeqCst));
        if step.saturating_abs() < SET_NS {
            // Being kept in time adds up to nothing that would be told at once.
            if step.saturating_abs() > SET_NS / 10 {
                self.ahead_ns.store(ahead, Ordering::SeqCst);
            }
            return None;
        }
        self.ahead_ns.store(ahead, Ordering::SeqCst);
        Some(step as f64 / 1e9)
    }
}

/// A clock that stands still until it is moved; for tests.
#[derive(Debug, Default)]
pub struct ManualClock(AtomicU64);

impl ManualClock {
    /// A clock that shows `start`.
    pub fn new(start: Timestamp) -> ManualClock {
        ManualClock(AtomicU64::new(start.0))
    }

    /// Moves on by `seconds` (s); negative values are ignored, for a clock never goes back.
    pub fn advance(&self, seconds: f64) -> Timestamp {
        self.set(self.now().plus_seconds(seconds))
    }

    /// Moves on to `time`, or stays if that has passed.
    pub fn set(&self, time: Timestamp) -> Timestamp {
        self.0.fetch_max(time.0, Ordering::SeqCst);
        self.now()
    }
}

impl Clock for ManualClock {
    fn now(&self) -> Timestamp {
        Timestamp(self.0.load(Ordering::SeqCst))
    }
}

fn nanos(duration: std::time::Duration) -> u64 {
    u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX)
}
