//! What a channel told before the place of a replay, from there backward.

use super::pieces::Pieces;
use super::{Replay, ReplayError};
use crate::bus::ChannelMessage;

/// A place in a log: a piece, and how many of its messages stand before the place.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Place(pub(super) usize, pub(super) usize);

impl Replay {
    /// Where the replay is: before the first message that was not given yet.
    pub fn place(&self) -> Place {
        Place(self.next.0, self.next.1)
    }

    /// The messages of one channel in the last piece of the log that has some before a place, in order,
    /// and the place where that piece begins, to go on from; `None` where none is left. Costs the
    /// reading of one piece, seldom more.
    pub fn earlier(
        &mut self,
        topic: &str,
        before: Place,
    ) -> Result<Option<(Vec<ChannelMessage>, Place)>, ReplayError> {
        in_last_piece(&mut self.pieces, topic, before)
    }
}

fn in_last_piece(
    pieces: &mut Pieces,
    topic: &str,
    Place(piece, within): Place,
) -> Result<Option<(Vec<ChannelMessage>, Place)>, ReplayError> {
    let list = pieces.log.pieces_of(topic);
    // Of the place's own piece only if something of it stands before the place.
    let end = list.partition_point(|&p| (p as usize) < piece + usize::from(within > 0));
    let Some(number) = end.checked_sub(1).and_then(|i| list.get(i)).map(|&p| p as usize) else {
        return Ok(None);
    };
    let entries = pieces.load(number)?;
    let given = if number == piece { within.min(entries.len()) } else { entries.len() };
    let on_topic = entries[..given].iter().filter(|entry| *entry.message.channel == *topic);
    let messages = on_topic.map(|entry| entry.message.clone()).collect();
    Ok(Some((messages, Place(number, 0))))
}
