//! Opening a log for a replay: its index is read, or where there is none, its chunks are walked along.

use std::path::PathBuf;

use bridge::catalog;
use bridge::clock::Clock;
use bridge::reader::Limits;
use bridge::replay::Replay;
use wire::resources::ReplayRequest;

use crate::analyses::OnProgress;
use crate::error::ApiError;
use crate::stop::Stop;

/// Share of the work that is done when the log is open.
const OPEN_SHARE: f64 = 0.8;

/// A log to be played.
pub struct Opening {
    /// The folder of the logs.
    pub folder: PathBuf,
    /// Which log, and how it is to be played.
    pub request: ReplayRequest,
    /// Identity of the replay.
    pub id: String,
}

impl Opening {
    /// Opens the log. Ends early, with `cancelled` or `deadline`, when `stop` says so.
    pub fn open(
        &self,
        clock: &dyn Clock,
        stop: &Stop,
        progress: OnProgress<'_>,
    ) -> Result<Replay, ApiError> {
        let ReplayRequest { log, from, rate } = &self.request;
        let content = catalog::open_log(&self.folder, log, Limits::default())?;
        stop.check()?;
        progress(OPEN_SHARE, "goes to the place asked for");
        let replay = Replay::open(clock.now(), &self.id, log, content, *from, *rate)?;
        stop.check()?;
        Ok(replay)
    }
}
