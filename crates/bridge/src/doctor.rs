//! Is a file exactly as the MCAP specification wants it? The rules of the format's own `doctor`,
//! checked on what really stands in the file: identities, checksums, times, indexes and counts.

use std::collections::{BTreeMap, HashMap};
use std::io::{self, Read};

use mcap::records::op;

use crate::reader::fields::{ChunkHeader, ChunkIndex, Fields, MessageHead, Statistics};
use crate::reader::frames::Window;
use crate::reader::{Limits, chunk};

/// Most findings that are kept.
const FINDINGS_MAX: usize = 100;

/// How bad a finding is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Severity {
    /// Readers may stumble.
    Warning,
    /// Not as the specification wants it.
    Error,
}

/// Something that is not as it should be.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Finding {
    /// How bad it is.
    pub severity: Severity,
    /// Byte offset of the record.
    pub at: u64,
    /// What is wrong.
    pub text: String,
}

/// What an examination gives.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Examination {
    /// What is wrong; at most a hundred.
    pub findings: Vec<Finding>,
    /// Messages met.
    pub messages: u64,
    /// Size of the file (bytes).
    pub bytes: u64,
    /// BLAKE3 hash of the file, hexadecimal.
    pub blake3: String,
}

/// Examines a file from its first byte to its last.
pub fn examine(source: impl Read, limits: Limits) -> io::Result<Examination> {
    let mut hasher = blake3::Hasher::new();
    let mut patient = Patient { limits, ..Patient::default() };
    let mut source = Hashed { source, hasher: &mut hasher };
    let bytes = patient.walk(&mut source)?;
    // What stands behind the point where the walk gave up belongs to the hash, too.
    let bytes = bytes.max(io::copy(&mut source, &mut io::sink()).map(|more| bytes + more)?);
    patient.compare();
    Ok(Examination {
        findings: patient.findings,
        messages: patient.messages,
        bytes,
        blake3: hasher.finalize().to_hex().to_string(),
    })
}

struct Hashed<'a, R> {
    source: R,
    hasher: &'a mut blake3::Hasher,
}

impl<R: Read> Read for Hashed<'_, R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = self.source.read(buffer)?;
        self.hasher.update(&buffer[..read]);
        Ok(read)
    }
}

/// Times and places of the messages of one channel in a chunk.
type Places = BTreeMap<u16, Vec<(u64, u64)>>;

#[derive(Default)]
struct Patient {
    limits: Limits,
    findings: Vec<Finding>,
    messages: u64,
    by_channel: BTreeMap<u16, u64>,
    times: Option<(u64, u64)>,
    latest: u64,
    /// Bodies of the records, by id.
    schemas: HashMap<u16, Vec<u8>>,
    channels: HashMap<u16, Vec<u8>>,
    /// Chunks as they are, and the places of the messages of the last one.
    chunks: Vec<ChunkIndex>,
    open: Option<Places>,
    /// Offset and length of attachments and metadata.
    attachments: Vec<(u64, u64)>,
    metadata: Vec<(u64, u64)>,
    outside: u64,
    /// What the summary says.
    said_chunks: Vec<ChunkIndex>,
    said_attachments: Vec<(u64, u64)>,
    said_metadata: Vec<(u64, u64)>,
    statistics: Vec<Statistics>,
    /// First record of each kind in the summary, and the end of the last.
    groups: BTreeMap<u8, (u64, u64)>,
    offsets: Vec<(u8, u64, u64)>,
}

impl Patient {
    fn error(&mut self, at: u64, text: impl Into<String>) {
        self.find(Severity::Error, at, text.into());
    }

    fn warn(&mut self, at: u64, text: impl Into<String>) {
        self.find(Severity::Warning, at, text.into());
    }

    fn find(&mut self, severity: Severity, at: u64, text: String) {
        if self.findings.len() < FINDINGS_MAX {
            self.findings.push(Finding { severity, at, text });
        }
    }

    /// Goes over the file; gives the bytes that were read.
    fn walk(&mut self, source: &mut impl Read) -> io::Result<u64> {
        let mut window = Window::new(source);
        let end = |window: &Window<_>| window.at() + window.rest().len() as u64;
        if !window.fill(mcap::MAGIC.len())? || !window.rest().starts_with(mcap::MAGIC) {
            self.error(0, "the magic bytes are missing");
            return Ok(end(&window));
        }
        window.pass(mcap::MAGIC.len());
        let (mut first, mut summary) = (true, false);
        let mut summary_at = 0;
        loop {
            let at = window.at();
            let whole = window.fill(9)?;
            let Some((opcode, length)) = window.frame().filter(|_| whole) else {
                self.error(at, "the file ends without a footer");
                return Ok(end(&window));
            };
            let size = usize::try_from(length).ok().filter(|&n| n <= self.limits.record_bytes);
            let Some(size) = size else {
                self.error(at, format!("a record says it is {length} bytes long"));
                return Ok(end(&window));
            };
            if !window.fill(9 + size)? {
                self.error(at, "the file ends within a record");
                return Ok(end(&window));
            }
            if first && opcode != op::HEADER {
                self.error(at, "the first record is not a header");
            }
            first = false;
            let crc = window.crc();
            let body = &window.rest()[9..9 + size];
            match (opcode, summary) {
                (op::FOOTER, _) => {
                    if !summary {
                        self.error(at, "there is no end of the data before the footer");
                    }
                    return self.footer(window, at, size, summary_at);
                }
                (op::DATA_END, false) => {
                    let said = Fields(body).u32().unwrap_or_default();
                    if said != 0 && said != crc {
                        self.error(at, "the checksum of the data does not agree");
                    }
                    self.close_chunk(at);
                    summary = true;
                }
                (_, false) => self.data(opcode, body, at),
                (_, true) => self.summary(opcode, body, at),
            }
            window.pass(9 + size);
            if opcode == op::DATA_END && summary_at == 0 {
                window.reset_crc();
                summary_at = window.at();
            }
        }
    }

    fn footer(
        &mut self,
        mut window: Window<&mut impl Read>,
        at: u64,
        size: usize,
        summary_at: u64,
    ) -> io::Result<u64> {
        let mut fields = Fields(&window.rest()[9..]);
        let (begin, offsets) = (fields.u64().unwrap_or(1), fields.u64().unwrap_or(1));
        if size != 20 {
            self.error(at, "the footer has another length than 20");
        }
        let groups_begin = self.groups.values().map(|&(first, _)| first).min();
        if begin != groups_begin.unwrap_or(0) || (begin != 0 && begin != summary_at) {
            self.error(at, "the footer says another begin of the summary");
        }
        let offsets_begin = self.groups.get(&op::SUMMARY_OFFSET).map_or(0, |&(first, _)| first);
        if offsets != offsets_begin {
            self.error(at, "the footer says another begin of the summary offsets");
        }
        window.pass((9 + 16).min(9 + size));
        let crc = window.crc();
        let said = Fields(window.rest()).u32().unwrap_or_default();
        if said != 0 && said != crc {
            self.error(at, "the checksum of the summary does not agree");
        }
        window.pass(4);
        window.fill(mcap::MAGIC.len() + 1)?;
        if window.rest() != mcap::MAGIC {
            self.error(window.at(), "the file does not end with the magic bytes");
        }
        Ok(window.at() + window.rest().len() as u64)
    }

    fn data(&mut self, opcode: u8, body: &[u8], at: u64) {
        if opcode != op::MESSAGE_INDEX {
            self.close_chunk(at);
        }
        let length = 9 + body.len() as u64;
        match opcode {
            op::HEADER => {
                let mut fields = Fields(body);
                match (fields.text(), fields.text()) {
                    (Some(_), Some("")) => self.warn(at, "the header names no library"),
                    (Some(_), Some(_)) => {}
                    _ => self.error(at, "the header is shorter than it says"),
                }
            }
            op::CHUNK => self.chunk(body, at),
            op::MESSAGE_INDEX => self.message_index(body, at),
            op::ATTACHMENT => {
                self.attachments.push((at, length));
                let mut fields = Fields(body);
                let content = (|| {
                    fields.bytes(16)?;
                    fields.text()?;
                    fields.text()?;
                    fields.long_block()?;
                    Some(&body[..body.len() - fields.0.len()])
                })();
                let said = fields.u32().unwrap_or_default();
                if content.is_none_or(|content| said != 0 && said != crc32fast::hash(content)) {
                    self.error(at, "the checksum of an attachment does not agree");
                }
            }
            op::METADATA => {
                self.metadata.push((at, length));
                let mut fields = Fields(body);
                if fields.text().is_none() || fields.texts().is_none() {
                    self.error(at, "a metadata record is shorter than it says");
                }
            }
            op::SCHEMA | op::CHANNEL => {
                if let Err(text) = self.define(opcode, body) {
                    self.error(at, text);
                }
            }
            op::MESSAGE => {
                self.outside += 1;
                if let Err(text) = self.message(body, at) {
                    self.error(at, text);
                }
            }
            0x80.. => {}
            _ => self.error(at, format!("a record of kind {opcode:#04x} stands in the data")),
        }
    }

    fn define(&mut self, opcode: u8, body: &[u8]) -> Result<(), String> {
        let mut fields = Fields(body);
        let id = fields.u16().ok_or("a record is shorter than it says")?;
        let kept = if opcode == op::SCHEMA {
            if id == 0 {
                return Err("a schema has the number 0".into());
            }
            let (name, encoding, data) = (fields.text(), fields.text(), fields.block());
            let (Some(_), Some(encoding), Some(data)) = (name, encoding, data) else {
                return Err(format!("schema {id} is shorter than it says"));
            };
            let json = serde_json::from_slice::<serde::de::IgnoredAny>;
            if encoding == "jsonschema" && json(data).is_err() {
                return Err(format!("schema {id} is not JSON"));
            }
            self.schemas.entry(id).or_insert_with(|| body.to_vec())
        } else {
            let schema = fields.u16().ok_or("a record is shorter than it says")?;
            if schema != 0 && !self.schemas.contains_key(&schema) {
                return Err(format!("channel {id} names schema {schema}, which is unknown"));
            }
            if fields.text().is_none() || fields.text().is_none() || fields.texts().is_none() {
                return Err(format!("channel {id} is shorter than it says"));
            }
            self.channels.entry(id).or_insert_with(|| body.to_vec())
        };
        if kept != body {
            return Err(format!("two records with the number {id} differ"));
        }
        Ok(())
    }

    fn message(&mut self, body: &[u8], at: u64) -> Result<MessageHead, String> {
        let (head, _) = MessageHead::read(body).ok_or("a message is shorter than its header")?;
        if !self.channels.contains_key(&head.channel) {
            return Err(format!("a message is on channel {}, which is unknown", head.channel));
        }
        if head.log_time < self.latest {
            self.warn(at, "a message has an earlier time than the one before it");
        }
        self.latest = self.latest.max(head.log_time);
        let (start, end) = self.times.unwrap_or((head.log_time, head.log_time));
        self.times = Some((start.min(head.log_time), end.max(head.log_time)));
        self.messages += 1;
        *self.by_channel.entry(head.channel).or_default() += 1;
        Ok(head)
    }

    fn chunk(&mut self, body: &[u8], at: u64) {
        let Some(header) = ChunkHeader::read(body) else {
            return self.error(at, "a chunk is shorter than it says");
        };
        let content = match chunk::content(&header, at, self.limits) {
            Ok(content) => content,
            Err(damage) => return self.error(at, damage.to_string()),
        };
        let mut places = Places::new();
        let outcome = chunk::records(&content, |opcode, body, offset| match opcode {
            op::SCHEMA | op::CHANNEL => self.define(opcode, body),
            op::MESSAGE => {
                let head = self.message(body, at)?;
                places.entry(head.channel).or_default().push((head.log_time, offset));
                Ok(())
            }
            _ => Err(format!("a record of kind {opcode:#04x} stands in a chunk")),
        });
        if let Err(text) = outcome {
            self.error(at, text);
        }
        let times = || places.values().flatten().map(|&(time, _)| time);
        let (start, end) = (times().min().unwrap_or(0), times().max().unwrap_or(0));
        if (start, end) != (header.start, header.end) {
            self.error(at, "a chunk says other times than its messages have");
        }
        self.chunks.push(ChunkIndex {
            start,
            end,
            offset: at,
            length: 9 + body.len() as u64,
            indexes: BTreeMap::new(),
            index_length: 0,
            compression: header.compression.into(),
            compressed_size: header.body.len() as u64,
            uncompressed_size: header.uncompressed_size,
        });
        self.open = Some(places);
    }

    fn message_index(&mut self, body: &[u8], at: u64) {
        let mut fields = Fields(body);
        let (id, pairs) = (fields.u16(), fields.pairs(|f| Some((f.u64()?, f.u64()?))));
        let (Some(id), Some(mut pairs)) = (id, pairs) else {
            return self.error(at, "a message index is shorter than it says");
        };
        let (Some(places), Some(chunk)) = (&mut self.open, self.chunks.last_mut()) else {
            return self.error(at, "a message index follows no chunk");
        };
        chunk.indexes.insert(id, at);
        chunk.index_length += 9 + body.len() as u64;
        let mut real = places.remove(&id).unwrap_or_default();
        pairs.sort_unstable();
        real.sort_unstable();
        if pairs != real {
            self.error(at, format!("the message index of channel {id} names other places"));
        }
    }

    /// After the message indexes of a chunk: what has no index?
    fn close_chunk(&mut self, at: u64) {
        if self.open.take().is_some_and(|places| !places.is_empty()) {
            self.warn(at, "a chunk has messages without a message index");
        }
    }

    fn summary(&mut self, opcode: u8, body: &[u8], at: u64) {
        let end = at + 9 + body.len() as u64;
        let group = self.groups.entry(opcode).or_insert((at, at));
        if group.1 != at {
            self.warn(at, "records of one kind do not stand together in the summary");
        }
        self.groups.entry(opcode).and_modify(|group| group.1 = end);
        let pair = |body: &[u8]| {
            let mut fields = Fields(body);
            Some((fields.u64()?, fields.u64()?))
        };
        let whole = match opcode {
            op::SCHEMA | op::CHANNEL => {
                if let Err(text) = self.define(opcode, body) {
                    self.error(at, text);
                }
                true
            }
            op::CHUNK_INDEX => ChunkIndex::read(body).map(|c| self.said_chunks.push(c)).is_some(),
            op::ATTACHMENT_INDEX => pair(body).map(|p| self.said_attachments.push(p)).is_some(),
            op::METADATA_INDEX => pair(body).map(|p| self.said_metadata.push(p)).is_some(),
            op::STATISTICS => Statistics::read(body).map(|s| self.statistics.push(s)).is_some(),
            op::SUMMARY_OFFSET => {
                let mut fields = Fields(body);
                let offset = (|| Some((fields.u8()?, fields.u64()?, fields.u64()?)))();
                offset.map(|offset| self.offsets.push(offset)).is_some()
            }
            0x80.. => true,
            _ => {
                self.error(at, format!("a record of kind {opcode:#04x} stands in the summary"));
                true
            }
        };
        if !whole {
            self.error(at, "a record of the summary is shorter than it says");
        }
    }

    /// What is said against what is.
    fn compare(&mut self) {
        if self.said_chunks != self.chunks {
            self.error(0, "the chunk indexes do not agree with the chunks");
        }
        if self.said_attachments != self.attachments {
            self.error(0, "the attachment indexes do not agree with the attachments");
        }
        if self.said_metadata != self.metadata {
            self.error(0, "the metadata indexes do not agree with the metadata");
        }
        if self.outside > 0 && !self.chunks.is_empty() {
            self.error(0, "there are messages outside of the chunks");
        }
        for (kind, begin, length) in std::mem::take(&mut self.offsets) {
            if self.groups.get(&kind) != Some(&(begin, begin + length)) {
                self.error(0, format!("the summary offset of kind {kind:#04x} is wrong"));
            }
        }
        let (start, end) = self.times.unwrap_or_default();
        let real = Statistics {
            messages: self.messages,
            schemas: self.schemas.len() as u16,
            channels: self.channels.len() as u32,
            attachments: self.attachments.len() as u32,
            metadata: self.metadata.len() as u32,
            chunks: self.chunks.len() as u32,
            start,
            end,
            by_channel: self.by_channel.clone(),
        };
        match &self.statistics[..] {
            [said] if *said == real => {}
            [_] => self.error(0, "the statistics do not agree with the file"),
            more => {
                let text = format!("there are {} records of statistics", more.len());
                self.error(0, text);
            }
        }
    }
}
