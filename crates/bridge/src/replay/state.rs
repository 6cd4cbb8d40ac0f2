//! The state at a place of a log: what a listener needs to know who has not heard what came before.

use std::collections::BTreeMap;
use std::sync::Arc;

use serde::Deserialize;
use wire::live::channel;

use super::ReplayError;
use super::pieces::{Pieces, message};
use crate::bus::ChannelMessage;
use crate::reader::LogMessage;

/// Most commands whose last event is given; the newest ones.
const COMMANDS_MAX: usize = 1000;

/// Channels that tell what happened, not how things are.
const HAPPENINGS: [&str; 6] = [
    channel::COMMAND_UPLINK,
    channel::COMMAND_EVENT,
    channel::EVENT,
    channel::JOB,
    channel::PLAN,
    channel::LOG_GAP,
];

/// The latest message of each state channel and of each command before a place, in the order of
/// their times.
pub fn snapshot(
    pieces: &mut Pieces,
    next: (usize, usize),
) -> Result<Vec<ChannelMessage>, ReplayError> {
    // Views are drawn anew; a search for them would find nothing that is played.
    let played = pieces.log.channels().filter(|(_, encoding)| ***encoding == *"json");
    let topics: Vec<Arc<str>> = played.map(|(topic, _)| topic.clone()).collect();
    let mut shown = Vec::new();
    for topic in topics.iter().filter(|topic| !HAPPENINGS.contains(&&***topic)) {
        shown.extend(latest(pieces, topic, next)?);
    }
    shown.extend(commands(pieces, next)?);
    shown.sort_by_key(|message| message.received_time);
    Ok(shown)
}

fn latest(
    pieces: &mut Pieces,
    topic: &str,
    (piece, within): (usize, usize),
) -> Result<Option<ChannelMessage>, ReplayError> {
    let list = pieces.log.pieces_of(topic);
    let mut place = list.partition_point(|&p| p as usize <= piece);
    while let Some(before) = place.checked_sub(1) {
        let Some(number) = pieces.log.pieces_of(topic).get(before).map(|&p| p as usize) else {
            break;
        };
        let entries = pieces.load(number)?;
        let given = if number == piece { within.min(entries.len()) } else { entries.len() };
        let found = entries[..given].iter().rev().find(|e| *e.message.channel == *topic);
        if let Some(entry) = found {
            return Ok(Some(entry.message.clone()));
        }
        place = before;
    }
    Ok(None)
}

#[derive(Deserialize)]
struct EventHead {
    command: CommandHead,
}

#[derive(Deserialize)]
struct CommandHead {
    id: String,
}

fn command_id(event: &ChannelMessage) -> Option<String> {
    serde_json::from_slice::<EventHead>(&event.json).ok().map(|head| head.command.id)
}

/// The last event of each command, looking back from the place until there are enough of them.
fn commands(
    pieces: &mut Pieces,
    (piece, within): (usize, usize),
) -> Result<Vec<ChannelMessage>, ReplayError> {
    let mut newest = BTreeMap::<String, ChannelMessage>::new();
    let mut file = match pieces.log.pieces().get(piece).or(pieces.log.pieces().last()) {
        Some(piece) => piece.file,
        None => return Ok(Vec::new()),
    };
    // In the place's own file, what was given of it.
    let mut of_file = walk(pieces, file, Some((piece, within)))?;
    loop {
        for event in of_file.into_iter().rev() {
            if newest.len() == COMMANDS_MAX {
                return Ok(newest.into_values().collect());
            }
            if let Some(id) = command_id(&event) {
                newest.entry(id).or_insert(event);
            }
        }
        let Some(before) = file.checked_sub(1) else { return Ok(newest.into_values().collect()) };
        file = before;
        of_file = match pieces.log.commands_of(file)? {
            Some(events) => events.into_iter().map(message).collect(),
            None => walk(pieces, file, None)?,
        };
    }
}

/// The command events of a file up to a place, in order. Up to a place within the file, those before
/// its piece come from the file's own list where it has one.
fn walk(
    pieces: &mut Pieces,
    file: usize,
    until: Option<(usize, usize)>,
) -> Result<Vec<ChannelMessage>, ReplayError> {
    let topic = channel::COMMAND_EVENT;
    let (last, within) = until.unwrap_or((usize::MAX, 0));
    let of_file = |p: &usize| pieces.log.pieces().get(*p).is_some_and(|piece| piece.file == file);
    let list: Vec<usize> = pieces.log.pieces_of(topic).iter().map(|&p| p as usize).collect();
    let mut list: Vec<usize> = list.into_iter().filter(|p| *p <= last && of_file(p)).collect();
    let mut events = Vec::new();
    let tail: Vec<ChannelMessage> = match list.last() {
        Some(&piece) if piece == last => {
            list.pop();
            let entries = pieces.load(piece)?;
            let given = &entries[..within.min(entries.len())];
            let on_topic = given.iter().filter(|entry| *entry.message.channel == *topic);
            on_topic.map(|entry| entry.message.clone()).collect()
        }
        _ => Vec::new(),
    };
    if !list.is_empty() {
        match events_before(pieces, file, last)? {
            Some(known) => events.extend(known.into_iter().map(message)),
            None => {
                for piece in list {
                    let entries = pieces.load(piece)?;
                    let on_topic = entries.iter().filter(|entry| *entry.message.channel == *topic);
                    events.extend(on_topic.map(|entry| entry.message.clone()));
                }
            }
        }
    }
    events.extend(tail);
    Ok(events)
}

/// The command events of a file that stand before a piece, from the file's own list: up to the first
/// event at or after that piece. `None` where there is no such list.
fn events_before(
    pieces: &mut Pieces,
    file: usize,
    piece: usize,
) -> Result<Option<Vec<LogMessage>>, ReplayError> {
    let topic = channel::COMMAND_EVENT;
    let Some(mut all) = pieces.log.commands_of(file)? else { return Ok(None) };
    let of_file = |p: &usize| pieces.log.pieces().get(*p).is_some_and(|piece| piece.file == file);
    let after = pieces.log.pieces_of(topic).iter().map(|&p| p as usize);
    let Some(next) = after.filter(|p| *p >= piece).find(of_file) else { return Ok(Some(all)) };
    let entries = pieces.load(next)?;
    let Some(first) = entries.iter().find(|entry| *entry.message.channel == *topic) else {
        return Ok(None);
    };
    let (sequence, time) = (first.message.sequence, first.message.received_time);
    let is_first = |m: &LogMessage| u64::from(m.sequence) == sequence && m.log_time == time;
    let place = all.iter().position(is_first);
    Ok(place.map(|place| {
        all.truncate(place);
        all
    }))
}
