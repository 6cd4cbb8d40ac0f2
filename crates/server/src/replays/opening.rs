//! Opening a log for a replay: it is read whole, which takes its time where it is long.

use std::fs::File;
use std::io::{self, BufReader, Read};
use std::path::PathBuf;

use bridge::catalog;
use bridge::clock::Clock;
use bridge::reader::{self, Limits};
use bridge::replay::Replay;
use wire::resources::ReplayRequest;

use crate::analyses::OnProgress;
use crate::error::ApiError;
use crate::stop::Stop;

/// Bytes between two tellings of how far the reading is.
const TOLD_EACH: u64 = 1 << 20;
/// Share of the work that is done when all bytes are read.
const READ_SHARE: f64 = 0.45;

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
    /// Reads the log. Ends early, with `cancelled` or `deadline`, when `stop` says so.
    pub fn open(
        &self,
        clock: &dyn Clock,
        stop: &Stop,
        progress: OnProgress<'_>,
    ) -> Result<Replay, ApiError> {
        let ReplayRequest { log, from, rate } = &self.request;
        let file = File::open(catalog::log_path(&self.folder, log)?)
            .map_err(|error| ApiError::from(reader::ReadError::from(error)))?;
        let total = file.metadata().map_or(1, |meta| meta.len().max(1));
        let watched = Watched { source: file, total, read: 0, told: 0, stop, progress };
        let content =
            reader::read_log(BufReader::with_capacity(256 * 1024, watched), Limits::default());
        // What the reader says of a file that was not read to its end is no news.
        stop.check()?;
        progress(READ_SHARE, "looks through the messages");
        let replay = Replay::open(clock.now(), &self.id, log, content?, *from, *rate)?;
        stop.check()?;
        Ok(replay)
    }
}

/// A source that ends when the work is to end, and tells how far it is.
struct Watched<'a, R> {
    source: R,
    total: u64,
    read: u64,
    told: u64,
    stop: &'a Stop,
    progress: OnProgress<'a>,
}

impl<R: Read> Read for Watched<'_, R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.stop.asked() {
            return Err(io::Error::other("stopped"));
        }
        let read = self.source.read(buffer)?;
        self.read += read as u64;
        if self.read >= self.told + TOLD_EACH {
            self.told = self.read;
            let share = READ_SHARE * self.read as f64 / self.total as f64;
            (self.progress)(share, "reads the log");
        }
        Ok(read)
    }
}

#[cfg(test)]
mod tests {
    use std::cell::RefCell;

    use super::*;

    #[test]
    fn the_source_tells_how_far_it_is_and_ends_when_asked() {
        let stop = Stop::after(None).unwrap();
        let shares = RefCell::new(Vec::new());
        let progress = |share: f64, _: &str| shares.borrow_mut().push(share);
        let bytes = vec![7_u8; 4 * TOLD_EACH as usize];
        let total = bytes.len() as u64;
        let mut source =
            Watched { source: &*bytes, total, read: 0, told: 0, stop: &stop, progress: &progress };
        let mut half = vec![0; bytes.len() / 2];
        source.read_exact(&mut half).unwrap();
        assert_eq!(*shares.borrow().last().unwrap(), READ_SHARE / 2.0);
        stop.cancel();
        assert!(source.read_exact(&mut half).is_err());
    }
}
