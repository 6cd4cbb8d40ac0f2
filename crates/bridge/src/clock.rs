//! The one place where time enters the project.

use std::sync::atomic::{AtomicU64, Ordering};

use wire::time::Timestamp;

/// Tells the time. Never goes back.
pub trait Clock: Send + Sync {
    /// The present time.
    fn now(&self) -> Timestamp;
}

/// The machine's clock as it was at the start, carried on by the monotonic clock: steps of the
/// wall clock, forward or back, do not reach the log. Follows tokio's paused time in tests.
#[derive(Debug)]
pub struct SystemClock {
    base: Timestamp,
    started: tokio::time::Instant,
}

impl SystemClock {
    /// A clock set to the machine's time.
    pub fn new() -> SystemClock {
        // The only reading of the wall clock in the project; see clippy.toml.
        #[allow(clippy::disallowed_methods)]
        let since_1970 =
            std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap_or_default();
        SystemClock::starting_at(Timestamp(nanos(since_1970)))
    }

    /// A clock that shows `base` now and goes on from there.
    pub fn starting_at(base: Timestamp) -> SystemClock {
        SystemClock { base, started: tokio::time::Instant::now() }
    }
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
