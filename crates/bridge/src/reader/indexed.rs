//! A log of any size, read chunk by chunk: what is where comes from the summaries, and only the
//! chunks that are asked for are read. Every chunk is checked before anything of it is handed out.
//!
//! A file without a sound summary (still being written, or torn) is looked through once to learn
//! where its chunks are.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::PathBuf;
use std::sync::Arc;

use mcap::records::op;
use wire::live::channel;
use wire::time::Timestamp;

use super::fields::{ChunkIndex, Fields};
use super::items::Items;
use super::{Damage, Item, Limits, LogContent, LogMessage, ReadError};
use crate::rewrite::{COMMANDS, CommandLine};

/// Largest summary that is taken into memory (bytes).
const SUMMARY_BYTES: u64 = 64 << 20;
/// Footer record and magic bytes.
const FOOTER_BYTES: u64 = 9 + 20 + 8;
/// Messages of one piece where they are held in memory.
const PIECE: usize = 1000;

/// A piece of a log: a chunk of a file, or some messages in memory.
#[derive(Debug, Clone)]
pub struct Piece {
    /// Times of its messages.
    pub start: Timestamp,
    /// The latest of them.
    pub end: Timestamp,
    /// The file, by its place in the list.
    pub file: usize,
    place: Place,
}

#[derive(Debug, Clone)]
enum Place {
    Chunk(Range<u64>),
    Memory(Range<usize>),
}

/// A log that is read piece by piece.
#[derive(Debug)]
pub struct IndexedLog {
    limits: Limits,
    files: Vec<IndexedFile>,
    pieces: Vec<Piece>,
    /// The pieces that hold messages of a channel, by its name.
    by_topic: BTreeMap<Arc<str>, Vec<u32>>,
    /// Encodings met, by the name of the channel.
    encodings: BTreeMap<Arc<str>, Arc<str>>,
    memory: Vec<LogMessage>,
    damage: Vec<Damage>,
}

#[derive(Debug)]
struct IndexedFile {
    file: Option<File>,
    /// The file's channels.
    known: Known,
    /// Where the attachment with all command events is.
    commands: Option<Range<u64>>,
    has_commands: bool,
}

/// What a reading of single chunks starts from.
type Known = Items;

impl IndexedLog {
    /// Opens the files of a log, in order.
    pub fn open(files: &[PathBuf], limits: Limits) -> Result<IndexedLog, ReadError> {
        let mut log = IndexedLog::empty(limits);
        for path in files {
            let file = File::open(path)?;
            if !log.take_summary(&file)? {
                log.look_through(file)?;
            }
        }
        if log.pieces.is_empty()
            && let Some(first) = log.damage.iter().find(|d| !matches!(d, Damage::Torn { .. }))
        {
            return Err(first.clone().into());
        }
        Ok(log)
    }

    fn empty(limits: Limits) -> IndexedLog {
        IndexedLog {
            limits,
            files: Vec::new(),
            pieces: Vec::new(),
            by_topic: BTreeMap::new(),
            encodings: BTreeMap::new(),
            memory: Vec::new(),
            damage: Vec::new(),
        }
    }

    /// The pieces, in the order of the log.
    pub fn pieces(&self) -> &[Piece] {
        &self.pieces
    }

    /// The channels, and how their messages are encoded.
    pub fn channels(&self) -> impl Iterator<Item = (&Arc<str>, &Arc<str>)> {
        self.encodings.iter()
    }

    /// The pieces that hold messages of a channel, in order.
    pub fn pieces_of(&self, topic: &str) -> &[u32] {
        self.by_topic.get(topic).map_or(&[], Vec::as_slice)
    }

    /// What is wrong, as far as it was met.
    pub fn damage(&self) -> &[Damage] {
        &self.damage
    }

    /// The messages of a piece, in the order of the log; none of a damaged one, which is noted.
    pub fn read(&mut self, piece: usize) -> Result<Vec<LogMessage>, ReadError> {
        let Some(Piece { file, place, .. }) = self.pieces.get(piece).cloned() else {
            return Ok(Vec::new());
        };
        let range = match place {
            Place::Memory(range) => return Ok(self.memory[range].to_vec()),
            Place::Chunk(range) => range,
        };
        let indexed = &mut self.files[file];
        let Some(source) = &mut indexed.file else { return Ok(Vec::new()) };
        let record = read_range(source, &range, self.limits)?;
        let at = range.start;
        let said = Fields(&record).u8().zip(Fields(record.get(1..).unwrap_or_default()).u64());
        if said != Some((op::CHUNK, record.len() as u64 - 9)) {
            let reason = "it is not where the index says".into();
            self.note(Damage::BadChunk { at, reason });
            return Ok(Vec::new());
        }
        indexed.known.take(op::CHUNK, &record[9..], at);
        let items = std::mem::take(&mut indexed.known.out);
        let met = std::mem::take(&mut indexed.known.damage);
        met.into_iter().for_each(|damage| self.note(damage));
        let messages = items.into_iter().filter_map(|item| match item {
            Item::Message(_, message) => Some(message),
            _ => None,
        });
        Ok(messages.collect())
    }

    /// All command events of a file, where it has them in one place.
    pub fn commands_of(&mut self, file: usize) -> Result<Option<Vec<LogMessage>>, ReadError> {
        let Some(indexed) = self.files.get_mut(file) else { return Ok(None) };
        if !indexed.has_commands {
            return Ok(Some(Vec::new()));
        }
        let (Some(range), Some(source)) = (indexed.commands.clone(), &mut indexed.file) else {
            return Ok(None);
        };
        let record = read_range(source, &range, self.limits)?;
        let mut items = Items::new(self.limits);
        items.take(op::ATTACHMENT, record.get(9..).unwrap_or_default(), range.start);
        let Some(Item::Attachment { data, .. }) = items.out.pop() else {
            // Damaged: the chunks tell the same.
            return Ok(None);
        };
        let mut messages = Vec::new();
        for line in data.split(|&byte| byte == b'\n').filter(|line| !line.is_empty()) {
            let Ok(line) = serde_json::from_slice::<CommandLine<'_>>(line) else { return Ok(None) };
            messages.push(LogMessage {
                channel: channel::COMMAND_EVENT.into(),
                encoding: "json".into(),
                sequence: line.sequence,
                log_time: Timestamp(line.log_time),
                publish_time: Timestamp(line.publish_time),
                data: line.text.into_owned().into(),
            });
        }
        Ok(Some(messages))
    }

    /// All command events of the log, in order: of each file from its own list where it has one, else
    /// from the chunks that hold some.
    pub fn command_events(&mut self) -> Result<Vec<LogMessage>, ReadError> {
        let mut events = Vec::new();
        for file in 0..self.files.len() {
            if let Some(of_file) = self.commands_of(file)? {
                events.extend(of_file);
                continue;
            }
            let list = self.pieces_of(channel::COMMAND_EVENT).iter().map(|&piece| piece as usize);
            let of_file = |piece: &usize| self.pieces[*piece].file == file;
            for piece in list.filter(of_file).collect::<Vec<_>>() {
                let messages = self.read(piece)?.into_iter();
                events.extend(messages.filter(|m| *m.channel == *channel::COMMAND_EVENT));
            }
        }
        Ok(events)
    }

    /// Damage is noted once, however often a place is read.
    fn note(&mut self, damage: Damage) {
        if !self.damage.contains(&damage) && self.damage.len() < PIECE {
            self.damage.push(damage);
        }
    }

    fn add_chunk(&mut self, file: usize, index: &ChunkIndex, topics: &[Arc<str>]) {
        if topics.is_empty() {
            return;
        }
        let number = self.pieces.len() as u32;
        for topic in topics {
            self.by_topic.entry(topic.clone()).or_default().push(number);
        }
        let place = Place::Chunk(index.offset..index.offset.saturating_add(index.length));
        let (start, end) = (Timestamp(index.start), Timestamp(index.end));
        self.pieces.push(Piece { start, end, file, place });
    }

    /// Takes what the summary of a complete file says; false if there is no sound summary.
    fn take_summary(&mut self, mut file: &File) -> Result<bool, ReadError> {
        let size = file.metadata()?.len();
        let Some(footer_at) = size.checked_sub(FOOTER_BYTES) else { return Ok(false) };
        file.seek(SeekFrom::Start(footer_at))?;
        let mut footer = [0; FOOTER_BYTES as usize];
        file.read_exact(&mut footer)?;
        let begin = Fields(&footer[9..]).u64().unwrap_or_default();
        let crc = Fields(&footer[25..]).u32().unwrap_or_default();
        let length = footer_at.checked_sub(begin).filter(|&n| begin > 0 && n <= SUMMARY_BYTES);
        let (Some(length), true) = (length, footer.ends_with(mcap::MAGIC)) else {
            return Ok(false);
        };
        file.seek(SeekFrom::Start(begin))?;
        let mut summary = vec![0; length as usize];
        file.read_exact(&mut summary)?;
        let mut hasher = crc32fast::Hasher::new();
        hasher.update(&summary);
        hasher.update(&footer[..25]);
        if footer[0] != op::FOOTER || crc == 0 || hasher.finalize() != crc {
            return Ok(false);
        }
        let mut known = Items::new(self.limits);
        let (mut chunks, mut commands, mut counted) = (Vec::new(), None, None);
        let walked = super::chunk::records(&summary, |opcode, body, _| {
            match opcode {
                op::SCHEMA | op::CHANNEL => drop(known.take(opcode, body, begin)),
                op::CHUNK_INDEX => chunks.extend(ChunkIndex::read(body)),
                op::ATTACHMENT_INDEX => commands = command_place(body).or(commands.take()),
                op::STATISTICS => counted = Fields(body).u64(),
                _ => {}
            }
            Ok(())
        });
        let topics: HashMap<u16, (Arc<str>, Arc<str>)> = known
            .out
            .drain(..)
            .filter_map(|item| match item {
                Item::Channel(c) => Some((c.id, (c.topic.clone(), c.encoding.clone()))),
                _ => None,
            })
            .collect();
        let listed = |chunk: &ChunkIndex| {
            !chunk.indexes.is_empty() && chunk.indexes.keys().all(|id| topics.contains_key(id))
        };
        // Messages without a place in the index would be passed over.
        let silent = chunks.iter().any(|chunk| !listed(chunk) && chunk.end > 0);
        if walked.is_err() || silent || (chunks.is_empty() && counted != Some(0)) {
            return Ok(false);
        }
        let number = self.files.len();
        let mut has_commands = false;
        for chunk in &chunks {
            let of_chunk: Vec<_> = chunk.indexes.keys().filter_map(|id| topics.get(id)).collect();
            for (topic, encoding) in &of_chunk {
                self.encodings.insert(topic.clone(), encoding.clone());
                has_commands |= **topic == *channel::COMMAND_EVENT;
            }
            let names: Vec<_> = of_chunk.into_iter().map(|(topic, _)| topic.clone()).collect();
            self.add_chunk(number, chunk, &names);
        }
        let file = Some(file.try_clone()?);
        self.files.push(IndexedFile { file, known, commands, has_commands });
        Ok(true)
    }

    /// Learns from the file itself where its chunks are. Messages outside of chunks are held in
    /// memory, up to the limit.
    fn look_through(&mut self, mut file: File) -> Result<(), ReadError> {
        file.seek(SeekFrom::Start(0))?;
        let number = self.files.len();
        let (mut found, mut has_commands) = (Vec::<(ChunkIndex, Vec<Arc<str>>)>::new(), false);
        let (mut loose, mut bytes) = (Vec::new(), 0);
        let mut encodings = std::mem::take(&mut self.encodings);
        let limits = self.limits;
        let (known, mut damage) = super::scan_places(&file, limits, |range, opcode, items| {
            let mut names = BTreeSet::new();
            let (mut start, mut end) = (u64::MAX, 0);
            for item in items {
                let Item::Message(channel, message) = item else { continue };
                encodings.insert(channel.topic.clone(), channel.encoding.clone());
                has_commands |= *channel.topic == *channel::COMMAND_EVENT;
                (start, end) = (start.min(message.log_time.0), end.max(message.log_time.0));
                names.insert(channel.topic.clone());
                if opcode == op::MESSAGE {
                    bytes += message.data.len() + 96;
                    loose.push(message);
                }
            }
            if opcode != op::MESSAGE && !names.is_empty() {
                let (offset, length) = (range.start, range.end - range.start);
                let index = ChunkIndex {
                    start,
                    end,
                    offset,
                    length,
                    indexes: BTreeMap::new(),
                    index_length: 0,
                    compression: String::new(),
                    compressed_size: 0,
                    uncompressed_size: 0,
                };
                found.push((index, names.into_iter().collect()));
            }
            bytes <= limits.total_bytes
        })?;
        if bytes > limits.total_bytes {
            return Err(ReadError::TooLarge { limit: limits.total_bytes });
        }
        self.encodings = encodings;
        for (index, topics) in &found {
            self.add_chunk(number, index, topics);
        }
        self.damage.append(&mut damage);
        self.hold(number, loose);
        let file = Some(file);
        self.files.push(IndexedFile { file, known, commands: None, has_commands });
        Ok(())
    }

    fn hold(&mut self, file: usize, messages: Vec<LogMessage>) {
        for part in messages.chunks(PIECE) {
            let number = self.pieces.len() as u32;
            for message in part {
                let list = self.by_topic.entry(message.channel.clone()).or_default();
                if list.last() != Some(&number) {
                    list.push(number);
                }
                self.encodings.insert(message.channel.clone(), message.encoding.clone());
            }
            let times = || part.iter().map(|message| message.log_time);
            let (Some(start), Some(end)) = (times().min(), times().max()) else { continue };
            let place = Place::Memory(self.memory.len()..self.memory.len() + part.len());
            self.memory.extend_from_slice(part);
            self.pieces.push(Piece { start, end, file, place });
        }
    }
}

impl From<LogContent> for IndexedLog {
    fn from(content: LogContent) -> IndexedLog {
        let mut log = IndexedLog::empty(Limits::default());
        let has_commands = content.messages.iter().any(|m| *m.channel == *channel::COMMAND_EVENT);
        log.hold(0, content.messages);
        log.damage = content.damage;
        let known = Items::new(log.limits);
        log.files.push(IndexedFile { file: None, known, commands: None, has_commands });
        log
    }
}

/// Where the attachment with the command events is, if this is the index of it.
fn command_place(body: &[u8]) -> Option<Range<u64>> {
    let mut fields = Fields(body);
    let (offset, length) = (fields.u64()?, fields.u64()?);
    fields.bytes(24)?;
    (fields.text()? == COMMANDS).then(|| offset..offset.saturating_add(length))
}

fn read_range(file: &mut File, range: &Range<u64>, limits: Limits) -> Result<Vec<u8>, ReadError> {
    let length = range.end.saturating_sub(range.start);
    if length > limits.record_bytes as u64 + 9 || length < 9 {
        return Err(Damage::RecordTooLong { at: range.start, length }.into());
    }
    file.seek(SeekFrom::Start(range.start))?;
    let mut record = Vec::new();
    file.take(length).read_to_end(&mut record)?;
    if (record.len() as u64) < length {
        return Err(Damage::Torn { at: range.start }.into());
    }
    Ok(record)
}
