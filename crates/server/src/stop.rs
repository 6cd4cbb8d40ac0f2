//! When work must end early: its deadline has passed, or nobody waits for it any more.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use tokio::time::Instant;
use wire::analysis::{DEADLINE_DEFAULT_S, DEADLINE_S};
use wire::check::{self, At, RequestError};

/// Asked by long work now and then.
#[derive(Debug, Clone)]
pub struct Stop {
    cancelled: Arc<AtomicBool>,
    deadline: Instant,
}

/// Why work was stopped.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cause {
    /// Nobody waits for it any more.
    Cancelled,
    /// Its time is over.
    Deadline,
}

/// Cancels the work when it is dropped: held by whoever waits for the answer.
#[derive(Debug)]
pub struct CancelOnDrop(Arc<AtomicBool>);

impl Stop {
    /// For work with this deadline (s), checked; the default one where there is none.
    pub fn after(deadline_s: Option<f64>) -> Result<Stop, RequestError> {
        let at = At::root("deadline_s");
        let seconds = match deadline_s {
            Some(seconds) => check::within(&at, seconds, DEADLINE_S, " s")?,
            None => DEADLINE_DEFAULT_S,
        };
        let deadline = Instant::now() + Duration::from_secs_f64(seconds);
        Ok(Stop { cancelled: Arc::default(), deadline })
    }

    /// For work that waits for the rover: as long as that may take (s), at most a week.
    pub fn within(seconds: f64) -> Stop {
        let deadline = Instant::now() + Duration::from_secs_f64(seconds.clamp(0.0, 6e5));
        Stop { cancelled: Arc::default(), deadline }
    }

    /// Must the work end?
    pub fn asked(&self) -> bool {
        self.cause().is_some()
    }

    /// Why it must end.
    pub fn cause(&self) -> Option<Cause> {
        if self.cancelled.load(Ordering::Relaxed) {
            Some(Cause::Cancelled)
        } else {
            (Instant::now() >= self.deadline).then_some(Cause::Deadline)
        }
    }

    /// An error if the work must end: for analyses without an outcome of their own.
    pub fn check(&self) -> Result<(), RequestError> {
        match self.cause() {
            None => Ok(()),
            Some(Cause::Cancelled) => Err(RequestError::new("cancelled", "it was cancelled")),
            Some(Cause::Deadline) => Err(RequestError::new(
                "deadline",
                "deadline_s passed before the answer was complete; ask for less or allow more time",
            )),
        }
    }

    /// Cancels the work.
    pub fn cancel(&self) {
        self.cancelled.store(true, Ordering::Relaxed);
    }

    /// Cancels the work when dropped.
    pub fn guard(&self) -> CancelOnDrop {
        CancelOnDrop(self.cancelled.clone())
    }
}

impl Drop for CancelOnDrop {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}
