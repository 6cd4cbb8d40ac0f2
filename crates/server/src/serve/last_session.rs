//! What the last session left behind: its commands and its E-stop.

use std::path::Path;

use bridge::catalog;
use bridge::commands::EstopMemory;
use bridge::reader::{IndexedLog, Limits, LogMessage, ReadError};
use wire::live::{CommandEvent, EstopState, LinkReport, Uplink, channel};
use wire::reconstruction::MapRecord;
use wire::time::Timestamp;

/// What the last session left.
#[derive(Debug, Default)]
pub struct LastSession {
    /// The events of all its commands, in order.
    pub commands: Vec<CommandEvent>,
    /// Its E-stop.
    pub estop: EstopMemory,
    /// The map that cameras had made, in use at its end, and the log that it can be made of.
    pub seen_map: Option<(String, String)>,
}

/// What is in the newest log; nothing where there is none. By the index: of what is sealed, only the
/// commands and the end are read. A log with damage gives what can be read: whatever it has lost was
/// not acknowledged, or is told as damage.
pub fn read(dir: &Path) -> LastSession {
    let logs = catalog::list_logs(dir, None).unwrap_or_else(|error| {
        tracing::warn!("the logs of earlier sessions cannot be listed: {error}");
        Vec::new()
    });
    let ids: Vec<&str> = logs.iter().map(|log| log.id.as_str()).collect();
    let Some(log) = logs.first() else { return LastSession::default() };
    let read = catalog::open_log(dir, &log.id, Limits::default()).and_then(|mut opened| {
        let last = LastSession {
            commands: commands(&mut opened)?,
            estop: estop(&mut opened)?,
            seen_map: None,
        };
        opened.damage().iter().for_each(|damage| {
            tracing::warn!("the log {} of the last session is damaged: {damage}", log.id);
        });
        Ok(last)
    });
    let last = read.unwrap_or_else(|error| {
        tracing::warn!("the log {} of the last session cannot be read: {error}", log.id);
        LastSession::default()
    });
    LastSession { seen_map: newest_map(dir, &ids), ..last }
}

/// The map that cameras had made, in use at the end of the last session in which the map changed, with the log of that
/// session: one that ended before its own map was made again has changed none.
fn newest_map(dir: &Path, ids: &[&str]) -> Option<(String, String)> {
    for id in ids.iter().take(SESSIONS_MAX) {
        let found = catalog::open_log(dir, id, Limits::default()).and_then(|mut log| {
            let is_other = terrains(&mut log)? > 1;
            Ok((seen_map(&mut log)?, is_other))
        });
        match found {
            Ok((Some(version), _)) => return Some((version, (*id).to_owned())),
            Ok((None, true)) => return None,
            Ok((None, false)) => {}
            Err(error) => tracing::warn!("the log {id} cannot be read: {error}"),
        }
    }
    None
}

/// Sessions that are looked back at for a map.
const SESSIONS_MAX: usize = 4;

/// How often a log tells that a map is in use, up to two: once at its beginning.
fn terrains(log: &mut IndexedLog) -> Result<usize, ReadError> {
    let mut n = 0;
    for piece in log.pieces_of(channel::TERRAIN).to_vec() {
        let messages = log.read(piece as usize)?;
        n += messages.iter().filter(|message| *message.channel == *channel::TERRAIN).count();
        if n > 1 {
            break;
        }
    }
    Ok(n)
}

fn commands(log: &mut IndexedLog) -> Result<Vec<CommandEvent>, ReadError> {
    let messages = log.command_events()?;
    let events: Vec<CommandEvent> =
        messages.iter().filter_map(|message| serde_json::from_slice(&message.data).ok()).collect();
    let n_bad = messages.len() - events.len();
    if n_bad > 0 {
        tracing::warn!("{n_bad} command events of the last session cannot be read");
    }
    Ok(events)
}

/// The map in use at the end, if cameras made it.
fn seen_map(log: &mut IndexedLog) -> Result<Option<String>, ReadError> {
    let Some(last) = log.pieces_of(channel::MAP).last().copied() else { return Ok(None) };
    let messages = log.read(last as usize)?;
    let records = messages.iter().filter(|message| *message.channel == *channel::MAP);
    let last = records.filter_map(|m| serde_json::from_slice::<MapRecord>(&m.data).ok()).last();
    Ok(last.filter(|record| record.blended.is_some()).map(|record| record.terrain_version))
}

/// What the log tells of an E-stop.
enum Told {
    Report(EstopState),
    Uplink(Box<Uplink>),
}

impl Told {
    fn of(message: &LogMessage) -> Option<Told> {
        match &*message.channel {
            channel::LINK => serde_json::from_slice::<LinkReport>(&message.data)
                .ok()
                .map(|report| Told::Report(report.estop)),
            channel::COMMAND_UPLINK => serde_json::from_slice::<Uplink>(&message.data)
                .ok()
                .filter(|up| matches!(up, Uplink::Estop { .. } | Uplink::EstopRelease { .. }))
                .map(|uplink| Told::Uplink(Box::new(uplink))),
            _ => None,
        }
    }
}

/// The E-stop at the end. Read backward as far as a report that there was none.
fn estop(log: &mut IndexedLog) -> Result<EstopMemory, ReadError> {
    let of = |topic| log.pieces_of(topic).iter().map(|&piece| piece as usize);
    let mut pieces: Vec<usize> = of(channel::LINK).chain(of(channel::COMMAND_UPLINK)).collect();
    pieces.sort_unstable();
    pieces.dedup();
    let mut told: Vec<(Timestamp, bool, Told)> = Vec::new();
    let mut clear: Option<Timestamp> = None;
    for piece in pieces.into_iter().rev() {
        if clear.is_some_and(|clear| log.pieces()[piece].end <= clear) {
            break;
        }
        let mut of_piece: Vec<_> = log
            .read(piece)?
            .iter()
            .filter_map(|message| Told::of(message).map(|told| (message.log_time, told)))
            .map(|(time, told)| (time, matches!(told, Told::Uplink(_)), told))
            .collect();
        let clears =
            of_piece.iter().filter(|(.., told)| matches!(told, Told::Report(EstopState::Clear)));
        clear = clear.max(clears.map(|(time, ..)| *time).max());
        of_piece.append(&mut told);
        told = of_piece;
    }
    // Reports are not written in the order of commands: one of before a command, or of its instant,
    // says nothing of it.
    told.sort_by_key(|(time, is_uplink, _)| (*time, *is_uplink));
    let mut memory = EstopMemory::default();
    for (.., told) in told {
        match told {
            Told::Report(state) => memory.report(state),
            Told::Uplink(uplink) => memory.uplink(&uplink),
        }
    }
    Ok(memory)
}
