//! Computing without harm to others: a few analyses at a time, a bounded number that wait, each
//! on a thread of its own, ended when nobody waits for it any more. A panic ends its request only.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use tokio::sync::{OwnedSemaphorePermit, Semaphore};

use crate::error::ApiError;
use crate::stop::Stop;

/// Lets a few in at a time.
#[derive(Debug, Clone)]
pub struct Gate {
    places: Arc<Semaphore>,
    waiting: Arc<AtomicUsize>,
    waiting_max: usize,
}

/// Counts itself out when it leaves, however it leaves.
struct Waiting(Arc<AtomicUsize>);

impl Drop for Waiting {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::Relaxed);
    }
}

impl Gate {
    /// A gate with `places`, before which `waiting_max` may wait.
    pub fn new(places: usize, waiting_max: usize) -> Gate {
        Gate { places: Arc::new(Semaphore::new(places)), waiting: Arc::default(), waiting_max }
    }

    /// Waits for a place; an error if too many wait already.
    pub async fn enter(&self) -> Result<OwnedSemaphorePermit, ApiError> {
        let busy = || {
            let message = "as many analyses as are taken run and wait already; try again";
            ApiError::new("busy", message)
        };
        if let Ok(permit) = self.places.clone().try_acquire_owned() {
            return Ok(permit);
        }
        let before = self.waiting.fetch_add(1, Ordering::Relaxed);
        let _waiting = Waiting(self.waiting.clone());
        if before >= self.waiting_max {
            return Err(busy());
        }
        self.places.clone().acquire_owned().await.map_err(|_| busy())
    }

    /// Computes `work` on a thread of its own. When the caller goes away, `stop` is told.
    pub async fn run<T: Send + 'static>(
        &self,
        stop: &Stop,
        work: impl FnOnce() -> T + Send + 'static,
    ) -> Result<T, ApiError> {
        let guard = stop.guard();
        let permit = self.enter().await?;
        let outcome = tokio::task::spawn_blocking(move || {
            let _place = permit;
            work()
        })
        .await;
        drop(guard);
        outcome.map_err(|error| ApiError::internal("the computation", error))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn more_than_may_wait_are_told_to_try_again() {
        let gate = Gate::new(1, 1);
        let inside = gate.enter().await.unwrap();
        let waiter = tokio::spawn({
            let gate = gate.clone();
            async move { gate.enter().await.map(drop) }
        });
        while gate.waiting.load(Ordering::Relaxed) == 0 {
            tokio::task::yield_now().await;
        }
        assert_eq!(gate.enter().await.unwrap_err().0.code, "busy");
        drop(inside);
        assert!(waiter.await.unwrap().is_ok());
        assert!(gate.enter().await.is_ok());
    }

    #[tokio::test]
    async fn who_goes_away_stops_the_work_and_a_panic_is_an_answer() {
        let gate = Gate::new(1, 0);
        let stop = Stop::after(None).unwrap();
        let (asked, work_stop) = (stop.clone(), stop.clone());
        let (started, on_start) = tokio::sync::oneshot::channel();
        let caller = tokio::spawn({
            let gate = gate.clone();
            async move {
                gate.run(&stop, move || {
                    let _ = started.send(());
                    while !work_stop.asked() {
                        std::thread::yield_now();
                    }
                })
                .await
            }
        });
        on_start.await.unwrap();
        caller.abort();
        assert!(caller.await.unwrap_err().is_cancelled());
        assert!(asked.asked());
        let gate = Gate::new(1, 0);
        let stop = Stop::after(None).unwrap();
        let fault = gate.run(&stop, || panic!("on purpose")).await.map(|(): ()| ()).unwrap_err();
        assert_eq!(fault.0.code, "internal");
        assert!(gate.run(&stop, || 1).await.is_ok());
    }
}
