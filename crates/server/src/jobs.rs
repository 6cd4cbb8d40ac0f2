//! Long work: a bounded table of jobs that can be asked for, watched and cancelled.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};

use wire::live::{JobReport, JobState};

use crate::error::ApiError;
use crate::stop::Stop;

/// Ended jobs that can still be asked for.
const ENDED_MAX: usize = 256;

/// Told of every change of a job.
pub type OnChange = Box<dyn Fn(&JobReport) + Send + Sync>;

/// The jobs.
pub struct Jobs(Arc<Shared>);

struct Shared {
    active_max: usize,
    jobs: Mutex<BTreeMap<String, Job>>,
    on_change: OnChange,
}

struct Job {
    report: JobReport,
    stop: Stop,
}

/// A job under way, held by the work itself. Dropped without an outcome it counts as failed.
pub struct JobHandle {
    id: String,
    shared: Weak<Shared>,
    stop: Stop,
    ended: bool,
}

fn is_active(state: JobState) -> bool {
    matches!(state, JobState::Queued | JobState::Running)
}

impl Jobs {
    /// A table with at most `active_max` jobs that have not ended.
    pub fn new(active_max: usize, on_change: OnChange) -> Jobs {
        Jobs(Arc::new(Shared { active_max, jobs: Mutex::default(), on_change }))
    }

    /// Begins a job of the given kind, ended by `stop`.
    pub fn begin(&self, kind: &str, stop: Stop) -> Result<JobHandle, ApiError> {
        let id = uuid::Uuid::now_v7().to_string();
        let report = JobReport {
            id: id.clone(),
            kind: kind.into(),
            state: JobState::Queued,
            progress: 0.0,
            doing: "waits for its turn".into(),
            pairs: Vec::new(),
            result: None,
            error: None,
        };
        let mut jobs = self.0.locked();
        if jobs.values().filter(|job| is_active(job.report.state)).count() >= self.0.active_max {
            let message = "as many jobs as are taken are under way; wait for one or cancel one";
            return Err(ApiError::new("busy", message));
        }
        while jobs.len() >= self.0.active_max + ENDED_MAX {
            // Ids grow with time, so the first ended one is the oldest.
            let ended = jobs.iter().find(|(_, job)| !is_active(job.report.state));
            let Some(oldest) = ended.map(|(id, _)| id.clone()) else { break };
            jobs.remove(&oldest);
        }
        (self.0.on_change)(&report);
        jobs.insert(id.clone(), Job { report, stop: stop.clone() });
        Ok(JobHandle { id, shared: Arc::downgrade(&self.0), stop, ended: false })
    }

    /// A job by its id.
    pub fn get(&self, id: &str) -> Result<JobReport, ApiError> {
        self.0.locked().get(id).map(|job| job.report.clone()).ok_or_else(unknown)
    }

    /// All jobs, oldest first.
    pub fn list(&self) -> Vec<JobReport> {
        self.0.locked().values().map(|job| job.report.clone()).collect()
    }

    /// Asks a job to end; it does so at its next look at the stop check.
    pub fn cancel(&self, id: &str) -> Result<JobReport, ApiError> {
        let mut jobs = self.0.locked();
        let job = jobs.get_mut(id).ok_or_else(unknown)?;
        if !is_active(job.report.state) {
            return Err(ApiError::new("job_ended", "the job has ended already"));
        }
        job.stop.cancel();
        job.report.doing = "is being cancelled".into();
        (self.0.on_change)(&job.report);
        Ok(job.report.clone())
    }

    /// Ends everything, as when the server does.
    pub fn cancel_all(&self) {
        self.0.locked().values().for_each(|job| job.stop.cancel());
    }
}

fn unknown() -> ApiError {
    ApiError::new("job_unknown", "there is no such job, or it ended long ago")
}

impl Shared {
    fn locked(&self) -> MutexGuard<'_, BTreeMap<String, Job>> {
        self.jobs.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl JobHandle {
    /// The job's id.
    pub fn id(&self) -> &str {
        &self.id
    }

    /// Its stop check.
    pub fn stop(&self) -> &Stop {
        &self.stop
    }

    /// Tells how far it is and what it is doing.
    pub fn progress(&self, share: f64, doing: &str) {
        self.change(|report| {
            report.state = JobState::Running;
            report.progress = share.clamp(0.0, 1.0);
            report.doing = doing.into();
        });
    }

    /// Ends with a result, or a refusal; `cancelled` ends as cancelled.
    pub fn end(mut self, outcome: Result<String, ApiError>) {
        self.ended = true;
        self.change(|report| match outcome {
            Ok(result) => {
                report.state = JobState::Done;
                report.progress = 1.0;
                report.doing = "done".into();
                report.result = Some(result);
            }
            Err(ApiError(info)) => {
                let cancelled = info.code == "cancelled";
                report.state = if cancelled { JobState::Cancelled } else { JobState::Failed };
                report.doing = if cancelled { "cancelled" } else { "failed" }.into();
                report.error = Some(info);
            }
        });
    }

    fn change(&self, change: impl FnOnce(&mut JobReport)) {
        let Some(shared) = self.shared.upgrade() else { return };
        let mut jobs = shared.locked();
        if let Some(job) = jobs.get_mut(&self.id) {
            change(&mut job.report);
            (shared.on_change)(&job.report);
        }
    }
}

impl Drop for JobHandle {
    fn drop(&mut self) {
        if self.ended {
            return;
        }
        self.change(|report| {
            report.state = JobState::Failed;
            report.doing = "failed".into();
            report.error = Some(ApiError::new("internal", "the work ended by a fault").0);
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn jobs() -> Jobs {
        Jobs::new(2, Box::new(|_| {}))
    }

    fn stop() -> Stop {
        Stop::after(None).unwrap()
    }

    #[test]
    fn a_job_is_queued_runs_and_ends_with_its_result() {
        let jobs = jobs();
        let handle = jobs.begin("plan", stop()).unwrap();
        let id = handle.id().to_owned();
        assert_eq!(jobs.get(&id).unwrap().state, JobState::Queued);
        handle.progress(0.5, "searches");
        assert_eq!(jobs.get(&id).unwrap().progress, 0.5);
        handle.end(Ok("/x".into()));
        let report = jobs.get(&id).unwrap();
        assert_eq!((report.state, report.result.as_deref()), (JobState::Done, Some("/x")));
        assert_eq!(jobs.cancel(&id).unwrap_err().0.code, "job_ended");
        assert_eq!(jobs.get("x").unwrap_err().0.code, "job_unknown");
    }

    #[test]
    fn no_more_than_the_bound_are_active_and_a_lost_one_has_failed() {
        let jobs = jobs();
        let (first, second) = (jobs.begin("a", stop()).unwrap(), jobs.begin("b", stop()).unwrap());
        assert_eq!(jobs.begin("c", stop()).err().unwrap().0.code, "busy");
        let id = first.id().to_owned();
        drop(first);
        assert_eq!(jobs.get(&id).unwrap().state, JobState::Failed);
        assert!(jobs.begin("c", stop()).is_ok());
        jobs.cancel(second.id()).unwrap();
        assert!(second.stop().asked());
    }

    #[test]
    fn the_oldest_ended_jobs_give_way() {
        let jobs = jobs();
        let first = jobs.begin("a", stop()).unwrap();
        let id = first.id().to_owned();
        first.end(Ok(String::new()));
        for _ in 0..ENDED_MAX + 2 {
            jobs.begin("a", stop()).unwrap().end(Ok(String::new()));
        }
        assert!(jobs.get(&id).is_err());
        assert!(jobs.list().len() <= ENDED_MAX + 2);
    }
}
