//! What our logs say beside their messages, in metadata records.
//!
//! A metadata record has no checksum of its own, so each of ours carries one. Channels are said a
//! second time in such records, for in an MCAP file they stand in the first chunk that uses them,
//! and the loss of that chunk would make all later ones unreadable.

use std::collections::BTreeMap;

use mcap::write::Metadata;

/// Name of the record that says what the log is of.
pub const SESSION: &str = "footfall";
/// Name of the record that repeats a channel.
const CHANNEL: &str = "footfall.channel";
/// Name of the record that keeps the two sayings of the channels apart.
const SPACE: &str = "footfall.space";
/// Bytes between them: more than a sector, so that one bad sector leaves one of them.
const SPACE_BYTES: usize = 4096;
/// Key of the checksum.
const CHECK: &str = "check";

type Texts = BTreeMap<String, String>;

fn check(name: &str, texts: &Texts) -> String {
    let mut hasher = blake3::Hasher::new();
    hasher.update(name.as_bytes());
    for (key, value) in texts.iter().filter(|(key, _)| *key != CHECK) {
        for text in [key, value] {
            hasher.update(&(text.len() as u64).to_le_bytes());
            hasher.update(text.as_bytes());
        }
    }
    hasher.finalize().to_hex()[..16].into()
}

/// A record with its checksum.
pub fn record(name: &str, mut texts: Texts) -> Metadata {
    texts.insert(CHECK.into(), check(name, &texts));
    Metadata { name: name.into(), metadata: texts }
}

/// The records that repeat channels (number, name, encoding), for the place before the chunk that
/// introduces them: all of them twice, some distance apart.
pub fn channels<'a>(list: impl Iterator<Item = (u16, &'a str, &'a str)>) -> Vec<Metadata> {
    let once: Vec<Metadata> =
        list.map(|(id, topic, encoding)| channel(id, topic, encoding)).collect();
    let space = BTreeMap::from([("space".into(), " ".repeat(SPACE_BYTES))]);
    once.iter().cloned().chain([record(SPACE, space)]).chain(once.clone()).collect()
}

/// True for records that are of use in their own file only.
pub fn is_of_the_file(name: &str) -> bool {
    name == CHANNEL || name == SPACE
}

fn channel(id: u16, topic: &str, encoding: &str) -> Metadata {
    let pairs = [("id", id.to_string()), ("topic", topic.into()), ("encoding", encoding.into())];
    record(CHANNEL, pairs.map(|(key, value)| (key.into(), value)).into())
}

/// True unless the record carries a checksum that does not agree.
pub fn is_sound(name: &str, texts: &Texts) -> bool {
    texts.get(CHECK).is_none_or(|said| *said == check(name, texts))
}

/// The channel that a record repeats: number, topic, encoding.
pub fn channel_of<'a>(name: &str, texts: &'a Texts) -> Option<(u16, &'a str, &'a str)> {
    if name != CHANNEL {
        return None;
    }
    Some((texts.get("id")?.parse().ok()?, texts.get("topic")?, texts.get("encoding")?))
}
