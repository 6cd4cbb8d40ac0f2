//! What the last session left open, from its log.

use std::io::BufReader;
use std::path::Path;

use bridge::catalog;
use bridge::commands::EstopMemory;
use bridge::reader::{self, Limits, LogMessage, ReadError};
use wire::live::{CommandEvent, LinkReport, Uplink, channel};
use wire::time::Timestamp;

/// What the last session left.
#[derive(Debug, Default)]
pub struct LastSession {
    /// The events of all its commands, in order.
    pub commands: Vec<CommandEvent>,
    /// Its E-stop.
    pub estop: EstopMemory,
}

/// What is in the newest log; nothing where there is none. A log with damage gives what can be read:
/// whatever it has lost was not acknowledged, or is told as damage.
pub fn read(dir: &Path) -> LastSession {
    let newest = match catalog::list_logs(dir, None) {
        Ok(logs) => logs.into_iter().next(),
        Err(error) => {
            tracing::warn!("the logs of earlier sessions cannot be listed: {error}");
            None
        }
    };
    let mut last = LastSession::default();
    let Some(log) = newest else { return last };
    let files = match catalog::log_files(dir, &log.id) {
        Ok(files) => files,
        Err(error) => {
            tracing::warn!("the log {} of the last session cannot be opened: {error}", log.id);
            return last;
        }
    };
    let mut n_bad = 0;
    let mut said = Timestamp(0);
    for path in files {
        let take = |message: LogMessage| {
            let known = match &*message.channel {
                channel::COMMAND_EVENT => serde_json::from_slice::<CommandEvent>(&message.data)
                    .map(|event| last.commands.push(event)),
                channel::COMMAND_UPLINK => {
                    serde_json::from_slice::<Uplink>(&message.data).map(|uplink| {
                        if matches!(uplink, Uplink::Estop { .. } | Uplink::EstopRelease { .. }) {
                            said = said.max(message.log_time);
                        }
                        last.estop.uplink(&uplink);
                    })
                }
                // Reports are not written in the order of commands: one of before says nothing.
                channel::LINK if message.log_time > said => {
                    serde_json::from_slice::<LinkReport>(&message.data)
                        .map(|report| last.estop.report(report.estop))
                }
                _ => return true,
            };
            n_bad += usize::from(known.is_err());
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
        tracing::warn!("{n_bad} messages on commands of the log {} cannot be read", log.id);
    }
    last
}
