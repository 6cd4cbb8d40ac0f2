//! What the last session left open, from its log.

use std::path::Path;

use bridge::catalog;
use bridge::reader::Limits;
use wire::live::CommandEvent;

/// The events of all commands of the newest log, in order; none where there is none. By the index: of what is
/// sealed, nothing else is read. A log with damage
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
    let read = catalog::open_log(dir, &log.id, Limits::default()).and_then(|mut opened| {
        let messages = opened.command_events()?;
        opened.damage().iter().for_each(|damage| {
            tracing::warn!("the log {} of the last session is damaged: {damage}", log.id);
        });
        Ok(messages)
    });
    let messages = read.unwrap_or_else(|error| {
        tracing::warn!("the log {} of the last session cannot be read: {error}", log.id);
        Vec::new()
    });
    let n_all = messages.len();
    let parse = |data: &[u8]| serde_json::from_slice::<CommandEvent>(data).ok();
    let events: Vec<_> = messages.iter().filter_map(|message| parse(&message.data)).collect();
    let n_bad = n_all - events.len();
    if n_bad > 0 {
        tracing::warn!("{n_bad} command events of the log {} cannot be read", log.id);
    }
    events
}
