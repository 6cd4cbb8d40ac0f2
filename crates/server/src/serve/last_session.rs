//! What the last session left open, from its log.

use std::path::Path;

use bridge::catalog;
use bridge::reader::{self, Limits};
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
    let file = catalog::log_path(dir, &log.id).and_then(|path| Ok(std::fs::File::open(path)?));
    let file = match file {
        Ok(file) => std::io::BufReader::with_capacity(256 * 1024, file),
        Err(error) => {
            tracing::warn!("the log {} of the last session cannot be opened: {error}", log.id);
            return Vec::new();
        }
    };
    let mut events = Vec::new();
    let mut n_bad = 0;
    let damage = reader::scan(file, Limits::default(), |message| {
        if &*message.channel == channel::COMMAND_EVENT {
            match serde_json::from_slice::<CommandEvent>(&message.data) {
                Ok(event) => events.push(event),
                Err(_) => n_bad += 1,
            }
        }
        true
    });
    if n_bad > 0 {
        tracing::warn!("{n_bad} command events of the log {} cannot be read", log.id);
    }
    match damage {
        Ok(damage) => damage.iter().for_each(|damage| {
            tracing::warn!("the log {} of the last session is damaged: {damage}", log.id);
        }),
        Err(error) => tracing::warn!("the log {} cannot be read: {error}", log.id),
    }
    events
}
