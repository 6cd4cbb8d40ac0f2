//! What the last session left open, from its log.

use std::io::BufReader;
use std::path::Path;

use bridge::catalog;
use bridge::reader::{self, Limits, LogMessage, ReadError};
use wire::live::{CommandEvent, channel};

/// The events of all commands of the newest log, in order; none where there is none. A log with damage
/// gives what can be read: whatever it has lost was not acknowledged, or is told as damage.
pub fn commands(dir: &Path) -> Vec<CommandEvent> {
    let newest = match catalog::list_logs(dir, None) {
        Ok(logs) => logs.into_iter().next(),
        Err(error) => {
            tracing::warn!("the logs of earlier sessions cannot be listed: {error}");
            None
        }
    };
    let Some(log) = newest else { return Vec::new() };
    let files = match catalog::log_files(dir, &log.id) {
        Ok(files) => files,
        Err(error) => {
            tracing::warn!("the log {} of the last session cannot be opened: {error}", log.id);
            return Vec::new();
        }
    };
    let mut events = Vec::new();
    let mut n_bad = 0;
    for path in files {
        let take = |message: LogMessage| {
            if &*message.channel == channel::COMMAND_EVENT {
                match serde_json::from_slice::<CommandEvent>(&message.data) {
                    Ok(event) => events.push(event),
                    Err(_) => n_bad += 1,
                }
            }
            true
        };
        let opened = std::fs::File::open(&path).map_err(ReadError::from);
        let read = opened.and_then(|file| {
            reader::scan(BufReader::with_capacity(256 * 1024, file), Limits::default(), take)
        });
        let name = path.display();
        match read {
            Ok(damage) => damage.iter().for_each(|damage| {
                tracing::warn!("{name} of the last session is damaged: {damage}");
            }),
            Err(error) => tracing::warn!("{name} of the last session cannot be read: {error}"),
        }
    }
    if n_bad > 0 {
        tracing::warn!("{n_bad} command events of the log {} cannot be read", log.id);
    }
    events
}
